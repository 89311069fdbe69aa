"""The report of a generation: clones and their parents on one page."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import mbstudio
from mbstudio.core.metrics.bodies import UNITLESS
from mbstudio.core.metrics.factor_table import FACTORS
from mbstudio.core.populations import Population, size_distribution
from mbstudio.core.replacement import replacing
from mbstudio.core.units import unit_label
from mbstudio.core.vae.generate.generation import Generation
from mbstudio.core.vae.generate.quality import Floor, Quality
from mbstudio.scene.figures.form_figures import zingg_figure
from mbstudio.scene.figures.population_figures import cdf_figure, joint_figure, pdf_figure, sieve_figure
from mbstudio.scene.figures.population_style import readable_scale, select_measured
from mbstudio.scene.reports.report_page import facts, heading, page, paragraph, picture, table

_ERRORS = (
    "δ = 100 |clones − parents| / |parents| of means and standard deviations. K-S D is the largest distance "
    "of the two cumulative distributions; the Wasserstein distance, the area between them, is in standard "
    "deviations of the parents. 'True' is the score of as many true new grains (median; in brackets the "
    "score that one sample in twenty exceeds). Errors below it say nothing more about the population."
)
_NEW = (
    "Distances are root mean square differences of ln r over 144 directions, the smallest over the eight "
    "flips of the axes. Novelty and diversity are medians of the nearest distance over that of the parents "
    "among themselves: 1 means as new, and as varied, as real grains. A copy is nearer to a parent than 0.3 "
    "of it. A random forest tells clones from parents by their factors and radii: an area of 0.5 under its "
    "ROC curve is guessing."
)


def write_generation_report(
    path: Path,
    name: str,
    generation: Generation,
    parents: Population,
    quality: Quality,
    *,
    progress: Callable[[float, str], None] | None = None,
) -> Path:
    """Write clones against their parents as one HTML file: how they were made, errors, novelty, figures.

    Parameters
    ----------
    path : Path
    name : str
        Of the style, for the title.
    generation : Generation
        Its clones measured.
    parents : Population
    quality : Quality
        As `mbstudio.core.vae.generate.quality.assess` returns it.
    progress : callable, optional
        ``progress(share, message)``; what it raises ends the work and leaves what was there.

    Raises
    ------
    MeasureError
        If no body could be measured.
    OSError
        If the file cannot be written.
    """
    report = progress or (lambda _share, _message: None)
    assert generation.factors is not None
    shown = select_measured([parents, generation.factors])
    parts = [heading("How they were made"), facts(_describe_making(generation, quality))]
    if generation.reached:
        parts += [heading("What was asked for"), _list_conditions(generation)]
    parts += quality_section(quality, shown)
    report(0.2, "tables")
    parts += [heading("Figures"), *_draw_figures(shown, report)]
    lead = f"{quality.clones} clones of {quality.parents} parents · mbstudio {mbstudio.__version__}"
    with replacing(path) as temporary:
        temporary.write_text(page(f"Clones in the style of {name}", lead, parts), encoding="utf-8")
    report(1.0, "written")
    return path


def quality_section(quality: Quality, shown: list[Population]) -> list[str]:
    """Return the part of a page that says how good a generation is: tables and what they mean."""
    rows = []
    for row in quality.factors:
        scale, unit = readable_scale(shown, row.factor)
        moments = (scale * value for value in (*row.means, *row.deviations))
        rows.append([
            FACTORS[row.factor].heading(unit), *map(_number, moments),
            f"{row.mean_error:.2f}", _floor_words(row.floor, "mean_error", 2),
            f"{row.deviation_error:.2f}", _floor_words(row.floor, "deviation_error", 2),
            f"{row.ks:.3f}", _floor_words(row.floor, "ks", 3),
            f"{row.wasserstein:.3f}", _floor_words(row.floor, "wasserstein", 3),
        ])  # fmt: skip
    columns = (
        "Clones against parents", "mean, parents", "mean, clones", "s.d., parents", "s.d., clones",
        "δ mean (%)", "true", "δ s.d. (%)", "true", "K-S D", "true", "Wasserstein", "true",
    )  # fmt: skip
    return [
        heading("Errors of the factors"), table(columns, rows), paragraph(_ERRORS),
        paragraph(f"The figures of true grains come from {quality.floor}."),
        heading("Correlations of the factors"), _correlation_table(quality),
        heading("How new they are"), facts(_describe_novelty(quality)), paragraph(_NEW),
    ]  # fmt: skip


def _describe_making(generation: Generation, quality: Quality) -> dict[str, str]:
    counts = generation.counts
    refused = ", ".join(f"{number} {reason}" for reason, number in counts.refused.items() if number)
    return {
        "Clones": f"{len(generation)}, seed {generation.seed}",
        "Candidates": f"{counts.candidates}, of which {counts.valid} were valid when drawn "
        f"({100 * counts.valid_share:.1f} %), {counts.repaired} were repaired",
        "Refused": refused or "none",
        "Replaced": f"{counts.replaced} after exact measurement",
        "Valid clones": f"{100 * quality.valid_after:.1f} %",
        "Selected": generation.how,
        "Selected from": f"effectively {generation.effective:.0f} candidates",
        "Unit of length": unit_label(generation.clones.unit),
    }


def _list_conditions(generation: Generation) -> str:
    rows = [
        [figure.what, _number(figure.wanted), _number(figure.found), "yes" if figure.is_met else "no"]
        for figure in generation.reached
    ]
    return table(("", "wanted", "found", "within the tolerance"), rows)


def _correlation_table(quality: Quality) -> str:
    rows = [
        [f"{FACTORS[a].title}, {FACTORS[b].title.lower()}", f"{x:.3f}", f"{y:.3f}", f"{y - x:+.3f}"]
        for a, b, x, y in quality.correlations
    ]
    low, high = quality.correlation_floor
    rows.append(["root mean square difference", "", "", f"{quality.correlation_error:.3f}"])
    rows.append(["of true new grains", "", "", f"{low:.3f} ({high:.3f})"])
    return table(("Two factors", "parents", "clones", "difference"), rows)


def _describe_novelty(quality: Quality) -> dict[str, str]:
    new, told = quality.novelty, quality.discrimination
    known = {
        "Novelty": f"{new.novelty:.2f}",
        "Copies": f"{100 * new.copies:.2f} %",
        "Diversity": f"{new.diversity:.2f}",
        "Parents among themselves": f"{new.parents:.4f} (median nearest distance)",
    }
    if told is not None:
        known["Recognised as clones"] = (
            f"area {told.auc:.2f} ± {told.error:.2f}, {100 * told.accuracy:.0f} % classified correctly; the "
            "parents "
            "as they were serialized ('mbstudio judge' compares with the grains themselves)"
        )
    return known


def _draw_figures(shown: list[Population], report: Callable[[float, str], None]) -> list[str]:
    parts = [
        picture(
            cdf_figure(shown),
            "Cumulative distributions of six factors, by number. In the legends: errors of mean and s.d.",
        )
    ]
    report(0.35, "figures")
    parts.append(picture(pdf_figure(shown), "Densities of the same factors."))
    report(0.5, "figures")
    if shown[0].unit != UNITLESS:
        curves = [(population, size_distribution(population)) for population in shown]
        parts.append(picture(sieve_figure(curves), "Percent finer by mass, by the intermediate axis."))
    report(0.65, "figures")
    parts.append(picture(zingg_figure(shown), "Zingg diagram, with the share of the bodies in every class."))
    parts.append(picture(joint_figure(shown), "Pairs of factors; on the diagonal their densities."))
    return parts


def _floor_words(floor: Floor, name: str, digits: int) -> str:
    low, high = getattr(floor, name)
    return f"{low:.{digits}f} ({high:.{digits}f})"


def _number(value: float) -> str:
    return f"{value:.4g}"
