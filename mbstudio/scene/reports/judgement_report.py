"""The report of a judge: whether clones can be told from true grains, on one page."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

import mbstudio
from mbstudio.core.judging.features import FEATURES
from mbstudio.core.judging.judgement import Area, Comparison, Drift, Judgement
from mbstudio.core.replacement import replacing
from mbstudio.scene.figures.side_by_side import Surface, side_by_side_figure
from mbstudio.scene.reports.report_page import facts, heading, page, paragraph, picture, table

_AREAS = (
    "Area under the ROC curve of bodies held out, together with all their relatives: 0.5 cannot be told "
    "apart, 1 always; areas below 0.5 are left as they are. ± is one standard error, by drawing groups of "
    "relatives again, widened to what permuted labels show. 'Chance' is what permuted labels stay below in "
    "19 of 20 cases. Told apart: more than 1.645 errors above 0.5, and above chance, for one of the two "
    "classifiers."
)
_DRIFTS = (
    "Drift: mean of the clones less that of true grains, in standard deviations of the true grains, ± one "
    "standard error. K-S: largest distance of the two cumulative distributions; 'halves' is that of random "
    "halves of the true grains, brought to the same numbers (median; in brackets what one in twenty exceeds)."
)


def write_judgement_report(
    path: Path,
    title: str,
    judgement: Judgement,
    true: Sequence[Surface],
    clones: Sequence[Surface],
    *,
    progress: Callable[[float, str], None] | None = None,
) -> Path:
    """Write a judgement as one HTML file: tables, what they mean, and true grains beside clones.

    Parameters
    ----------
    path : Path
    title : str
        What was judged.
    judgement : Judgement
    true, clones : sequence of (vertices, triangles)
        Of the pictures.
    progress : callable, optional
        ``progress(share, message)``; what it raises ends the work and leaves what was there.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    report = progress or (lambda _share, _message: None)
    parts = [paragraph(verdict_of(judgement)), heading("Can they be told apart?"), paragraph(_AREAS)]
    for comparison in judgement.comparisons:
        parts += [paragraph(f"{comparison.title}."), _area_table(comparison)]
    parts += [heading("What has drifted"), _drift_table(judgement.drifts), paragraph(_DRIFTS)]
    parts += [heading("How new they are"), facts(_likeness(judgement))]
    report(0.3, "tables")
    parts += [
        heading("True grains beside clones"),
        picture(
            side_by_side_figure(true, clones, judgement.seed),
            "Drawn and turned at random by the seed, of one size (D_n), in one light; not retouched.",
        ),
        heading("To be known with these numbers"),
        *(paragraph(note) for note in judgement.notes),
    ]
    lead = (
        f"{judgement.numbers[0]} true grains, {judgement.numbers[1]} clones · mbstudio {mbstudio.__version__}"
    )
    with replacing(path) as temporary:
        temporary.write_text(page(title, lead, parts), encoding="utf-8")
    report(1.0, "written")
    return path


def verdict_of(judgement: Judgement) -> str:
    """Return in one sentence whether clones were told from true grains."""
    told = [result.features for result in judgement.comparisons[0].results if result.is_told_apart]
    if judgement.is_told_apart:
        return f"The clones are told from the true grains, by: {', '.join(told)}."
    if told:
        return (
            "The clones are not told from the true grains by a margin that allows for fourteen looks; single "
            f"sets of features say so: {', '.join(told)}."
        )
    return "The clones are not told from the true grains, within the error, by any set of features."


def _area_table(comparison: Comparison) -> str:
    rows = [
        [
            result.features, f"{result.numbers[0]}, {result.numbers[1]}",
            area_words(result.logistic), chance_words(result.logistic),
            area_words(result.forest), chance_words(result.forest), result.verdict,
        ]
        for result in comparison.results
    ]  # fmt: skip
    columns = ("Features", "bodies", "logistic regression", "chance", "forest", "chance", "")
    return table(columns, rows, words=True)


def area_words(area: Area) -> str:
    """Return an area with its error."""
    return f"{area.value:.2f} ± {area.error:.2f}"


def chance_words(area: Area) -> str:
    """Return what chance stays below, or a dash where it was not found."""
    return f"< {area.chance:.2f}" if np.isfinite(area.chance) else "–"


def _drift_table(drifts: Sequence[Drift]) -> str:
    titles = {kind.name: kind.title for kind in FEATURES}
    rows = [
        [
            titles[row.feature], *(_number(value) for value in (*row.means, *row.deviations)),
            f"{row.drift:+.2f} ± {row.error:.2f}", f"{row.ks:.2f}",
            f"{row.ks_floor[0]:.2f} ({row.ks_floor[1]:.2f})",
        ]
        for row in drifts
    ]  # fmt: skip
    columns = ("", "mean, true", "mean, clones", "s.d., true", "s.d., clones", "drift", "K-S", "halves")
    return table(columns, rows)


def _likeness(judgement: Judgement) -> dict[str, str]:
    found = judgement.likeness
    known = {
        "Nearest other true grain": f"{found.distance[0]:.3f} apart, correlation {found.correlation[0]:.2f}",
        "Nearest true grain or parent of a clone": f"{found.distance[1]:.3f} apart, "
        f"correlation {found.correlation[1]:.2f}",
        "Copies": f"{100 * found.copies:.1f} %",
    }
    if np.isfinite(found.source_distance):
        known["Own parent of a clone"] = (
            f"{found.source_distance:.3f} apart, correlation {found.source_correlation:.2f}"
        )
    return known


def _number(value: float) -> str:
    return f"{value:.4g}"
