"""A method's options from and to text: for the command line, the window and the project file."""

from __future__ import annotations

import inspect
import math
from collections.abc import Iterable, Mapping
from dataclasses import fields
from typing import Any, Literal, get_args, get_origin, get_type_hints

from mbstudio.core.errors import FitError
from mbstudio.core.imaging.steps import Method

_SWITCH = {"yes": True, "true": True, "on": True, "1": True,
           "no": False, "false": False, "off": False, "0": False}  # fmt: skip


def options_kind(method: Method) -> type[Any]:
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


def make_options(method: Method, given: Mapping[str, Any]) -> Any:
    """Return the record of a method's options with these given, the others at their defaults.

    Raises
    ------
    FitError
        If there is no such method, it has no such option, or a value does not suit it.
    """
    kind = options_kind(method)
    known = [field.name for field in fields(kind)]
    for name in given:
        if name not in known:
            raise FitError(f"Method '{method}' has no option '{name}': it has {', '.join(known)}.")
    return kind(**given)


def plain_options(method: Method) -> dict[str, tuple[Any, Any]]:
    """Return type and default of each option that is a number, a word or a switch, by name."""
    kind = options_kind(method)
    hints = get_type_hints(kind)
    return {
        field.name: (hints[field.name], field.default)
        for field in fields(kind)
        if hints[field.name] in (int, float, bool) or get_origin(hints[field.name]) is Literal
    }


def changed_options(options: Any) -> dict[str, Any]:
    """Return those options of a method's record that are not at their defaults, by name."""
    default = type(options)()
    pairs = ((field.name, getattr(options, field.name)) for field in fields(options))
    return {name: value for name, value in pairs if value != getattr(default, name)}


def read_options(method: Method, texts: Iterable[str]) -> dict[str, Any]:
    """Read options written as ``name=value``; those that say the default are left out.

    Parameters
    ----------
    method : {'fast', 'paper'}
    texts : iterable of str
        Numbers as Python writes them, switches as yes or no, words as they are.

    Raises
    ------
    FitError
        If a text has no ``=``, the method no such option, or the value does not suit it.
    """
    known = plain_options(method)
    given: dict[str, Any] = {}
    for text in texts:
        name, equals, word = (part.strip() for part in text.partition("="))
        if not equals:
            raise FitError(f"Option '{text}' has no value: write it as name=value.")
        if name not in known:
            raise FitError(f"Method '{method}' has no option '{name}': it has {', '.join(known)}.")
        given[name] = _value(name, word, known[name][0])
    return changed_options(make_options(method, given))


def _value(name: str, word: str, kind: Any) -> Any:
    if get_origin(kind) is Literal:
        if word not in get_args(kind):
            choices = ", ".join(f"{name}={choice}" for choice in get_args(kind))
            raise FitError(f"'{name}={word}' is no choice: write {choices}.")
        return word
    if kind is bool:
        if word.lower() not in _SWITCH:
            raise FitError(f"'{name}={word}' is neither on nor off: write {name}=yes or {name}=no.")
        return _SWITCH[word.lower()]
    wanted = "a whole number" if kind is int else "a number"
    try:
        value = kind(word)
    except ValueError as error:
        raise FitError(f"'{name}={word}' cannot be read: give {wanted}, for example {name}=3.") from error
    if not math.isfinite(value):
        raise FitError(f"'{name}={word}' is not finite: give {wanted}.")
    return value


def option_notes(method: Method) -> dict[str, str]:
    """Return what the documentation of a method says of each option, by name, for tool tips."""
    notes: dict[str, str] = {}
    names: list[str] = []
    text = (inspect.getdoc(options_kind(method)) or "").partition("----------")[2]
    for line in text.splitlines():
        if line.strip() and not line.startswith(" "):
            names = [name.strip() for name in line.partition(":")[0].split(",")]
        else:
            for name in names:
                notes[name] = f"{notes.get(name, '')} {line.strip()}".strip()
    return notes
