"""Metaball-Imaging: sphere clustering, then gradient search, each a step at a time."""

from mbstudio.core.imaging.fitting import fit, start_fit
from mbstudio.core.imaging.goals.fit_goal import FitGoal
from mbstudio.core.imaging.steps import FitResult, FitRun, SearchStep
from mbstudio.core.metaball.validity import Verdict

FitTarget = FitGoal
"""The earlier name of `FitGoal`."""

__all__ = ["FitGoal", "FitResult", "FitRun", "FitTarget", "SearchStep", "Verdict", "fit", "start_fit"]
