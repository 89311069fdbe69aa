"""Metaball-Imaging: an avatar is fitted to a grain, a step at a time.

`start` places control points, `fast` and `paper` are the two methods, `goals` says how near is near enough.
Begin at :func:`~mbstudio.core.imaging.fitting.fit`.
"""

from mbstudio.core.imaging.fitting import fit, start_fit
from mbstudio.core.imaging.goals.fit_goal import FitGoal
from mbstudio.core.imaging.steps import FitResult, FitRun, SearchStep
from mbstudio.core.metaball.validity import Verdict

FitTarget = FitGoal
"""The earlier name of `FitGoal`."""

__all__ = ["FitGoal", "FitResult", "FitRun", "FitTarget", "SearchStep", "Verdict", "fit", "start_fit"]
