"""The options of each fit method, by its name."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from mbstudio.core.errors import FitError
from mbstudio.core.imaging.steps import Method

if TYPE_CHECKING:
    from mbstudio.core.imaging.fast.fast import FastOptions
    from mbstudio.core.imaging.paper.gradient_search import PaperOptions


def find_options(method: Method) -> type[FastOptions | PaperOptions]:
    """Return the record of a method's options.

    Raises
    ------
    FitError
        If there is no such method.
    """
    # A method's module is imported when it is used: their kernels need not all be loaded.
    if method == "fast":
        from mbstudio.core.imaging.fast.fast import FastOptions

        return FastOptions
    if method == "paper":
        from mbstudio.core.imaging.paper.gradient_search import PaperOptions

        return PaperOptions
    raise FitError(f"There is no fit method '{method}': use 'fast' or 'paper'.")


def make_options(method: Method, given: Mapping[str, Any]) -> FastOptions | PaperOptions:
    """Return the record of a method's options with these given, the others at their defaults.

    Raises
    ------
    FitError
        If there is no such method, it has no such option, or a value does not suit it.
    """
    return find_options(method).make(given)


def read_options(method: Method, texts: Iterable[str]) -> dict[str, Any]:
    """Read options written as ``name=value``; those that say the default are left out.

    Raises
    ------
    FitError
        If a text has no ``=``, the method no such option, or the value does not suit it.
    """
    return find_options(method).read(texts).list_changed()
