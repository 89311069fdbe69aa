"""Metaball-Imaging of one grain: the entry points."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from mbstudio.core.grains.grain import Grain
from mbstudio.core.imaging.options import make_options
from mbstudio.core.imaging.steps import FitResult, FitRun, Method, SearchStep

if TYPE_CHECKING:
    from mbstudio.core.imaging.goals.fit_goal import FitGoal
    from mbstudio.core.imaging.run import StepRun


def start_fit(
    grain: Grain,
    n: int = 40,
    method: Method = "fast",
    seed: int = 0,
    *,
    target: str | FitGoal | None = None,
    **options: Any,
) -> FitRun:
    """Return the step object of a fit; nothing is computed before its first step.

    Parameters
    ----------
    grain : Grain
    n : int
        Number of control points; not used with a target.
    method : {'fast', 'paper'}
        Guarded Levenberg-Marquardt, or Algorithms 1 and 2 of Zhao et al. (2023).
    seed : int
        Of everything random; the same seed gives the same avatar.
    target : str or FitGoal, optional
        What the avatar is to reach, such as ``"volume 0.5 % and hausdorff 2 %"``, with as few control points
        as may be; see :meth:`~mbstudio.core.imaging.goals.fit_goal.FitGoal.parse`.
    **options
        Of :class:`~mbstudio.core.imaging.fast.fast.FastOptions` or
        :class:`~mbstudio.core.imaging.paper.gradient_search.PaperOptions`.

    Raises
    ------
    FitError
        If n is no positive whole number, the grain is too small for it, an option is unknown, or the target
        cannot be understood.
    """
    chosen = make_options(method, options)
    if not target:
        return _run_of(grain, n, method, seed, chosen)
    from mbstudio.core.imaging.goals.fit_goal import FitGoal
    from mbstudio.core.imaging.goals.goal_fit import GoalFit

    return GoalFit(grain, FitGoal.parse(target), lambda number: _run_of(grain, number, method, seed, chosen))


def _run_of(grain: Grain, n: int, method: Method, seed: int, chosen: Any) -> StepRun:
    if method == "fast":
        from mbstudio.core.imaging.fast.fast import FastFit

        return FastFit(grain, n, seed, chosen)
    from mbstudio.core.imaging.paper.gradient_search import PaperFit

    return PaperFit(grain, n, seed, chosen)


def fit(
    grain: Grain,
    n: int = 40,
    method: Method = "fast",
    seed: int = 0,
    *,
    target: str | FitGoal | None = None,
    on_step: Callable[[SearchStep], None] | None = None,
    **options: Any,
) -> FitResult:
    """Fit an avatar of n control points to a grain, or one of as few as reach a target.

    Parameters
    ----------
    grain, n, method, seed, target, **options
        As in :func:`start_fit`.
    on_step : callable, optional
        Called with every step; raising in it cancels the fit.

    Returns
    -------
    FitResult
        With a target, `n` is the number found and `reached` what it reached; where no number up to the
        most allowed reaches it, the best avatar, with a warning in its verdict that says so.

    Raises
    ------
    FitError
        As in :func:`start_fit`.
    MeasureError
        If the target names a shape factor, and the grain has none.
    """
    run = start_fit(grain, n, method, seed, target=target, **options)
    for step in run:
        if on_step is not None:
            on_step(step)
    return run.result()
