"""Metaball-Imaging: sphere clustering, then gradient search, each a step at a time."""

from mbstudio.core.imaging.fitting import fit, start_fit
from mbstudio.core.imaging.goals.target import FitTarget
from mbstudio.core.imaging.steps import FitResult, FitRun, SearchStep
from mbstudio.core.metaball.validity import Verdict

__all__ = ["FitResult", "FitRun", "FitTarget", "SearchStep", "Verdict", "fit", "start_fit"]
