"""Metaball-Imaging of one grain: the entry points."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from typing import Any

from mbstudio.core.errors import FitError
from mbstudio.core.grains.grain import Grain
from mbstudio.core.imaging.steps import FitResult, FitRun, Method, SearchStep


def start_fit(grain: Grain, n: int = 40, method: Method = "fast", seed: int = 0, **options: Any) -> FitRun:
    """Return the step object of a fit; nothing is computed before its first step.

    Parameters
    ----------
    grain : Grain
    n : int
        Number of control points.
    method : {'fast', 'paper'}
        Guarded Levenberg-Marquardt, or Algorithms 1 and 2 of Zhao et al. (2023).
    seed : int
        Of everything random; the same seed gives the same avatar.
    **options
        Of :class:`~mbstudio.core.imaging.fast.FastOptions` or
        :class:`~mbstudio.core.imaging.gradient_search.PaperOptions`.

    Raises
    ------
    FitError
        If n is no positive whole number, the grain is too small for it, or an option is unknown.
    """
    # A method's module is imported when it is used: their kernels need not all be loaded.
    if method == "fast":
        from mbstudio.core.imaging.fast import FastFit, FastOptions

        return FastFit(grain, n, seed, _options(FastOptions, options, method))
    if method == "paper":
        from mbstudio.core.imaging.gradient_search import PaperFit, PaperOptions

        return PaperFit(grain, n, seed, _options(PaperOptions, options, method))
    raise FitError(f"There is no fit method '{method}': use 'fast' or 'paper'.")


def _options(kind: type[Any], options: dict[str, Any], method: str) -> Any:
    known = [field.name for field in fields(kind)]
    for name in options:
        if name not in known:
            raise FitError(f"Method '{method}' has no option '{name}': it has {', '.join(known)}.")
    if options.get("cavities", "fill") not in ("fill", "keep"):
        raise FitError(f"cavities='{options['cavities']}' is not known: use 'fill' or 'keep'.")
    return kind(**options)


def fit(
    grain: Grain,
    n: int = 40,
    method: Method = "fast",
    seed: int = 0,
    *,
    on_step: Callable[[SearchStep], None] | None = None,
    **options: Any,
) -> FitResult:
    """Fit an avatar of n control points to a grain.

    Parameters
    ----------
    grain, n, method, seed, **options
        As in :func:`start_fit`.
    on_step : callable, optional
        Called with every step; raising in it cancels the fit.

    Raises
    ------
    FitError
        As in :func:`start_fit`.
    """
    run = start_fit(grain, n, method, seed, **options)
    for step in run:
        if on_step is not None:
            on_step(step)
    return run.result()
