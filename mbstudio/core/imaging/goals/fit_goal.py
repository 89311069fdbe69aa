"""What an avatar is to reach: errors at most, overlap at least."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from mbstudio.core.errors import FitError, MbstudioError
from mbstudio.core.goals import OVERLAP, Goal, Grammar
from mbstudio.core.imaging.goals.likeness import Likeness
from mbstudio.core.imaging.steps import FitResult


def list_measures() -> tuple[str, ...]:
    """Return the names that the goal of a fit may hold, beside ``n``."""
    from mbstudio.core.metrics import FACTORS

    return ("rms", "hausdorff", OVERLAP, *FACTORS.core)


@dataclass(frozen=True)
class FitGoal(Goal):
    """What an avatar is to reach with as few control points as may be, by an avatar that is valid.

    Measures are 'iou', the 'hausdorff' and 'rms' distance of the surfaces over D_n, and the relative error of
    any core shape factor, by its name.
    """

    grammar: ClassVar[Grammar] = Grammar("a fit", "control points", "volume 0.5 %", FitError, list_measures)

    def values(self, result: FitResult, likeness: Likeness) -> dict[str, float]:
        """Return what a fit has reached of each measure; NaN where it is not defined for this avatar."""
        found: dict[str, float] = {}
        verdict, names = result.verdict, [aim.measure for aim in self.aims]
        if "volume" in names:
            found["volume"] = abs(verdict.volume_error)
        if "rms" in names:
            found["rms"] = verdict.rms / likeness.grain.nominal_diameter
        if OVERLAP in names:
            found[OVERLAP] = likeness.iou(result.avatar)
        if "hausdorff" in names:
            found["hausdorff"] = likeness.hausdorff(result.avatar)
        wanted = [name for name in names if name not in found]
        if wanted:
            errors = _factor_errors(result, likeness)
            found.update({name: abs(errors.get(name, float("nan"))) for name in wanted})
        return {name: found[name] for name in names}


def _factor_errors(result: FitResult, likeness: Likeness) -> dict[str, float]:
    _ = likeness.factors  # a grain that cannot be measured is an error of the target, not of an avatar
    try:
        return likeness.factor_errors(result.avatar)
    except MbstudioError:  # an avatar in several pieces has no factors, so it does not reach the target
        return {}
