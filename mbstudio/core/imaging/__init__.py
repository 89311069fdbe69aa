"""Metaball-Imaging: sphere clustering, then gradient search, each a step at a time."""

from mbstudio.core.imaging.fitting import fit, start_fit
from mbstudio.core.imaging.steps import FitResult, FitRun, SearchStep, Verdict
from mbstudio.core.imaging.target import FitTarget

__all__ = ["FitResult", "FitRun", "FitTarget", "SearchStep", "Verdict", "fit", "start_fit"]
