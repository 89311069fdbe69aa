"""The verdict on a segmentation: whether the scan bears out the grains that were found.

It does not depend on how the grains were found. Grey values are compared with labels at the grains'
surfaces, and wherever else the scan shows a sharp change; shapes are compared with what grains look like;
and touching grains are parted again, a little more and a little less readily.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

from mbstudio.core.errors import SegmentationError
from mbstudio.core.translation import mark

Level = Literal["green", "amber", "red"]
LEVELS: tuple[Level, ...] = ("green", "amber", "red")


@dataclass(frozen=True)
class Criterion:
    """What one figure says about a segmentation.

    Attributes
    ----------
    name : str
        Key in records, such as ``contrast_to_noise``.
    title : str
    amber, red : float
        From where on the figure is doubtful, and bad.
    is_high_good : bool
        Whether figures below `amber` are doubtful, rather than those above it.
    advice : str
        What to do where it is doubtful.
    is_share : bool
        Whether the figure is written in percent.
    """

    name: str
    title: str
    amber: float
    red: float
    is_high_good: bool
    advice: str
    is_share: bool = False

    def level_of(self, figure: float) -> Level:
        """Return how good a figure is."""
        sign = 1.0 if self.is_high_good else -1.0
        if sign * figure < sign * self.red:
            return "red"
        return "amber" if sign * figure < sign * self.amber else "green"

    def written(self, figure: float) -> str:
        """Return a figure as it is read."""
        if self.is_share:
            return f"{100 * figure:.3g} %"
        return f"{figure:,.0f}" if abs(figure) >= 100 else f"{figure:.2g}"

    @property
    def wanted(self) -> str:
        """Which figures are green, in words."""
        return f"{self.written(self.amber)} or {'more' if self.is_high_good else 'less'}"


RULES = 2
"""Which criteria and ways of measuring them a verdict is of."""

# The limits, and the weights below, were set by scans with known grains; benchmarks/segmentation_verdict.py
# tells how well they part good segmentations from bad ones on other scans.
CRITERIA: tuple[Criterion, ...] = (
    Criterion(
        "likely_agreement",
        mark("Likely agreement with the true grains (F1)"),
        0.82,
        0.7,
        True,
        "Some grains are likely merged, cut or missed: look at touching ones, move the splitting, smooth "
        "more, or scan with smaller voxels.",
        is_share=True,
    ),
    Criterion(
        "surface_compared",
        mark("Surface compared with the scan, in voxels"),
        100.0,
        0.0,
        True,
        "Too little of the grains' surfaces lies in the scan to compare them with it: look at the grains.",
    ),
    Criterion(
        "contrast_to_noise",
        mark("Contrast to noise"),
        0.9,
        0.6,
        True,
        "Noise hides the surfaces: smooth more, bin the scan, or scan longer.",
    ),
    Criterion(
        "surface_borne_out",
        mark("Surface with a change in grey value"),
        0.84,
        0.7,
        True,
        "Grains end where the scan shows no edge: state a threshold, or crop away what is uneven.",
        is_share=True,
    ),
    Criterion(
        "edges_inside",
        mark("Edges inside grains"),
        0.12,
        0.25,
        False,
        "Grains hold sharp edges, as if a liquid around them were taken for grain: state the grey values of "
        "the grains as a range.",
        is_share=True,
    ),
    Criterion(
        "edges_outside",
        mark("Edges outside all grains"),
        0.1,
        0.3,
        False,
        "The scan shows bodies that are not among the grains: lower the smallest grain, or state the "
        "threshold.",
        is_share=True,
    ),
    Criterion(
        "void_or_liquid",
        mark("Void or liquid between the grains"),
        0.45,
        0.35,
        True,
        "What seems to be a liquid may be a drift of the grey values, or grains that were missed: state the "
        "threshold.",
        is_share=True,
    ),
    Criterion(
        "one_tone",
        mark("Surfaces that meet the grains' tone, in a liquid"),
        0.6,
        0.4,
        True,
        "What seems to be a liquid may be streaks, or grains of another tone: state the threshold.",
        is_share=True,
    ),
    Criterion(
        "texture_of_void",
        mark("Texture of the void, in contrasts"),
        0.2,
        0.3,
        False,
        "The void is not even: look for faint grains that were missed, rings and streaks, and state the "
        "threshold.",
        is_share=True,
    ),
    Criterion(
        "solidity",
        mark("Median solidity"),
        0.8,
        0.65,
        True,
        "Grains are hollow or ragged beyond the ordinary: check whether they are the bright or the dark "
        "side, the threshold, and the splitting.",
    ),
    Criterion(
        "splitting_agreement",
        mark("Agreement with other splittings"),
        0.7,
        0.5,
        True,
        "Which grains are one depends on the splitting: look at them, and move it until necks are cut and "
        "grains are whole.",
        is_share=True,
    ),
    Criterion(
        "smooth_agreement",
        mark("Agreement with smoother grains"),
        0.7,
        0.5,
        True,
        "Which grains are one depends on the roughness of their surfaces: smooth more.",
        is_share=True,
    ),
    Criterion(
        "thin_agreement",
        mark("Agreement with thinner grains"),
        0.7,
        0.5,
        True,
        "Half a voxel decides on which grains are one: scan with smaller voxels, or check the threshold.",
        is_share=True,
    ),
    Criterion(
        "unconvex_share",
        mark("Volume in grains of solidity below 0.85"),
        0.5,
        0.8,
        False,
        "Many grains are far from convex, as merged ones are: move the splitting towards 1.",
        is_share=True,
    ),
    Criterion(
        "edge_sharpness",
        mark("Sharpness of edges"),
        0.3,
        0.2,
        True,
        "Surfaces are blurred over several voxels: look for a motion of the sample, or scan anew.",
    ),
    Criterion(
        "median_diameter",
        mark("Median diameter in voxels"),
        8.0,
        5.0,
        True,
        "Grains are hardly resolved: scan with smaller voxels.",
    ),
    Criterion(
        "cut_by_border",
        mark("Grains cut by the border"),
        0.98,
        1.01,
        False,
        "Hardly any grain is whole: take a larger region.",
        is_share=True,
    ),
    Criterion(
        "solid_share",
        mark("Solid share of the field of view"),
        0.8,
        0.95,
        False,
        "Pores hardly remain: check the threshold, and whether grains are the bright or the dark side.",
        is_share=True,
    ),
)


def _short_of(most: float) -> Callable[[float], float]:
    return lambda figure: math.log(max(most - figure, 0.01))


def _beyond(least: float) -> Callable[[float], float]:
    return lambda figure: math.log(least + max(figure, 0.0))


def _as_it_is(figure: float) -> float:
    return min(max(figure, 0.0), 1.2)


_LIKELY = 0.271
"""Likely agreement where all terms are zero."""
_TERMS: tuple[tuple[str, float, float, Callable[[float], float]], ...] = (
    ("splitting_agreement", 1.0, -0.0503, _short_of(1.05)),
    ("smooth_agreement", 1.0, -0.0238, _short_of(1.02)),
    ("thin_agreement", 1.0, -0.0383, _short_of(1.02)),
    ("unconvex_share", 0.0, -0.1765, _as_it_is),
    ("edge_sharpness", 0.5, 0.6392, _as_it_is),
    ("texture_of_void", 0.02, -0.0225, _beyond(0.03)),
)
"""Figure, its value where it cannot be measured, weight, and what is weighed."""


def likely_agreement(figures: Mapping[str, float]) -> float:
    """Return which agreement with the true grains (F1) is likely, from 0 to 1.

    It is linear in logarithms of some figures, by least squares on scans whose grains are known, degraded in
    many ways; where the grains agreed less than 0.6, 0.6 was put.

    Parameters
    ----------
    figures : mapping of str to float
        By the criteria's names.
    """
    total = _LIKELY
    for name, usual, weight, function in _TERMS:
        figure = figures.get(name, usual)
        total += weight * function(figure if math.isfinite(figure) else usual)
    return min(max(total, 0.0), 1.0)


@dataclass(frozen=True)
class SegmentationVerdict:
    """What the scan says of the grains that were found in it.

    Attributes
    ----------
    figures : mapping of str to float
        By the criteria's names; what could not be measured is left out.
    phases : int
        Number of phases seen: void, liquid, and each tone of grains; 0 if unknown.
    view : str
        The field of view in words.
    edits : int
        How many edits by hand were made since the scan was compared with the grains.
    """

    figures: Mapping[str, float]
    phases: int = 0
    view: str = ""
    edits: int = 0

    def after_edit(self, figures: Mapping[str, float]) -> SegmentationVerdict:
        """Return the verdict after one more edit by hand, with the figures that are known anew."""
        return replace(self, figures={**self.figures, **figures}, edits=self.edits + 1)

    @property
    def edited_note(self) -> str:
        """What the verdict does not know of edits by hand, in words; empty if there were none."""
        if not self.edits:
            return ""
        times = "once" if self.edits == 1 else f"{self.edits} times"
        return (
            f"Edited by hand {times} since: sizes follow, but the scan was compared with the grains as they "
            "were found."
        )

    def level_of(self, criterion: Criterion) -> Level:
        """Return how good one figure is; green where it was not measured."""
        figure = self.figures.get(criterion.name)
        return "green" if figure is None else criterion.level_of(figure)

    @property
    def level(self) -> Level:
        """The worst of all levels."""
        return max((self.level_of(criterion) for criterion in CRITERIA), key=LEVELS.index)

    @property
    def doubts(self) -> list[Criterion]:
        """Criteria that are not green, the worst first."""
        found = [criterion for criterion in CRITERIA if self.level_of(criterion) != "green"]
        return sorted(found, key=lambda criterion: -LEVELS.index(self.level_of(criterion)))

    @property
    def described(self) -> list[str]:
        """Each doubt in a sentence or two: the figure, what it should be, and what to do."""
        return [
            f"{criterion.title}: {criterion.written(self.figures[criterion.name])}, should be "
            f"{criterion.wanted}. {criterion.advice}"
            for criterion in self.doubts
        ]

    def to_record(self) -> dict[str, Any]:
        """Return the verdict for JSON: level, figures, and for each doubt what to do."""
        return {
            "rules": RULES,
            "level": self.level,
            "phases": self.phases,
            "field_of_view": self.view,
            "edits": self.edits,
            "figures": {name: float(figure) for name, figure in self.figures.items()},
            "doubts": [
                {
                    "criterion": criterion.name,
                    "level": self.level_of(criterion),
                    "figure": float(self.figures[criterion.name]),
                    "limit": criterion.amber,
                    "advice": criterion.advice,
                }
                for criterion in self.doubts
            ],
        }

    @staticmethod
    def is_readable(record: Mapping[str, Any]) -> bool:
        """Return whether a record is of today's rules: what other versions measured says nothing here."""
        return record.get("rules") == RULES

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> SegmentationVerdict:
        """Return the verdict that a record of :meth:`to_record` describes, by today's limits.

        Raises
        ------
        SegmentationError
            If it is no such record, or one of other rules (see :meth:`is_readable`).
        """
        if not cls.is_readable(record):
            raise SegmentationError(
                "The verdict on the segmentation was made by other rules: find the grains again."
            )
        figures, phases = record.get("figures"), record.get("phases")
        known = {criterion.name for criterion in CRITERIA}
        if not isinstance(figures, dict) or not isinstance(phases, int):
            raise SegmentationError("The verdict on the segmentation is none: find the grains again.")
        for name, figure in figures.items():
            if name not in known or not isinstance(figure, int | float) or not math.isfinite(figure):
                raise SegmentationError(f"The verdict's figure '{name}' is none: find the grains again.")
        edits = record.get("edits", 0)
        if type(edits) is not int or edits < 0:
            raise SegmentationError("The verdict's number of edits is none: find the grains again.")
        return cls(dict(figures), phases, str(record.get("field_of_view", "")), edits)
