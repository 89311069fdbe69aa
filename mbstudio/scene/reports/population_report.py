"""The report of a project: its grains and avatars as populations, on one page."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path, PureWindowsPath
from typing import TYPE_CHECKING

import numpy as np

import mbstudio
from mbstudio.core.metrics.factor_table import AXES, FACTORS
from mbstudio.core.populations import (
    Population,
    compare,
    moments,
    relative_errors,
    size_distribution,
    zingg_diagram,
)
from mbstudio.core.populations.comparison import FactorComparison
from mbstudio.core.populations.sieving import SERIES_NAMES, SieveSeries
from mbstudio.core.project.measuring import ProjectPopulations
from mbstudio.core.replacement import replacing
from mbstudio.core.units import unit_label
from mbstudio.scene.figures.form_figures import sneed_folk_figure, zingg_figure
from mbstudio.scene.figures.population_figures import cdf_figure, joint_figure, pdf_figure, sieve_figure
from mbstudio.scene.figures.population_style import readable_scale, select_measured
from mbstudio.scene.reports.report_page import facts, heading, page, paragraph, picture, table

if TYPE_CHECKING:
    from mbstudio.core.grains import GrainSet
    from mbstudio.core.project import Project

_SURFACES = {
    "crofton voxels": "grains: corrected Crofton formula on the voxels",
    "smoothed voxels": "grains: lightly smoothed surface of the voxels",
    "avatar": "avatars: nested meshes on the metaball surface, extrapolated",
    "mesh": "triangles of the mesh",
}

_DISTANCES = (
    "δ = 100 |avatars − grains| / |grains|, of the means and of the sample standard deviations of the two "
    "populations; 'each' is the median over single avatars against their own grains. K-S D is the largest "
    "distance of the two cumulative distributions, p its probability if both were independent samples of one "
    "distribution (avatars are not independent of their grains, so p errs to the large side). The "
    "Wasserstein distance is the area between the cumulative distributions, in the factor's unit."
)
_SIZES = (
    "Percent finer by mass; the size of a body is its intermediate axis b. D_x is found linearly in the "
    "logarithm of the size. C_u = D60 / D10, C_c = D30² / (D10 D60)."
)


def write_report(
    path: Path,
    project: Project,
    populations: ProjectPopulations,
    *,
    sieves: SieveSeries = "iso",
    progress: Callable[[float, str], None] | None = None,
) -> Path:
    """Write the populations of a project as one HTML file: tables, figures and what went wrong.

    The file loads nothing from anywhere. It takes its place when it is complete.

    Parameters
    ----------
    path : Path
    project : Project
    populations : ProjectPopulations
        As `measure_project` returns them.
    sieves : {"iso", "astm"}
        Standard series of the sieve curve.
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
    both = [populations.grains] + ([populations.avatars] if populations.avatars is not None else [])
    shown = select_measured(both)
    name = project.path.name if project.path is not None else "unsaved project"
    parts = [heading("What was measured"), facts(_describe_measuring(project, populations))]
    parts += [heading("Shape factors"), *_factor_tables(populations)]
    parts += [heading("Particle size"), *_size_tables(shown, sieves), heading("Form"), *_form_table(shown)]
    report(0.1, "tables")
    for place, part in enumerate(_draw_figures(shown, sieves)):
        parts.append(part)
        report(0.1 + 0.14 * (place + 1), "figures")
    parts += _list_troubles(project, populations)
    parts += _list_files(project, populations)
    lead = f"Shape and size of {_count_bodies(populations)} · mbstudio {mbstudio.__version__}"
    with replacing(path) as temporary:
        temporary.write_text(page(f"Report on {name}", lead, parts), encoding="utf-8")
    report(1.0, "written")
    return path


def _count_bodies(populations: ProjectPopulations) -> str:
    words = f"{int(populations.grains.measured.sum())} grains"
    if populations.avatars is not None:
        words += f" and {int(populations.avatars.measured.sum())} avatars"
    return words


def _describe_scan(project: Project) -> dict[str, str]:
    """Return the scan's file, and which part of it the grains are of."""
    reference = project.state.scan
    known = {}
    if reference is not None and reference.path is not None:
        known["Scan"] = reference.path.name
    if reference is not None and reference.excerpt is not None:
        known["Part of it"] = f"voxels {reference.excerpt.describe()} (z, y, x)"
    return known


def _describe_measuring(project: Project, populations: ProjectPopulations) -> dict[str, str]:
    grains, avatars = populations.grains, populations.avatars
    assert project.grains is not None
    border = set(project.grains.table.loc[project.grains.table["touches_border"], "label"].tolist())
    cut = len(border & set(grains.labels.tolist()))
    known = {
        "Project": "not saved" if project.path is None else project.path.name,
        **_describe_scan(project),
        "Voxel size": str(project.grains.voxel_size),
        "Grains": f"{_describe_source(project.grains)}, {len(grains)} chosen, "
        f"{int(grains.measured.sum())} measured"
        + (f"; {cut} of the chosen are cut off by the scan's border" if cut else ""),
    }
    if project.grains.verdict is not None:
        verdict = project.grains.verdict
        told = (f"Verdict: {verdict.level}.", verdict.edited_note, *verdict.described)
        known["Segmentation"] = " ".join(filter(None, told))
    if avatars is not None:
        fits = [project.fits[int(label)] for label in avatars.labels]
        valid = sum(fit.verdict.valid for fit in fits)
        methods = Counter(f"{fit.method}, n = {fit.n}" for fit in fits)
        known["Avatars"] = f"{len(avatars)} fitted, {valid} valid, {int(avatars.measured.sum())} measured"
        known["Fitted by"] = "; ".join(f"{method} ({count})" for method, count in methods.most_common())
    surfaces = {word for p in (grains, avatars) if p is not None for word in p.surface.split(", ") if word}
    return {
        **known,
        "Axes a ≥ b ≥ c": _lower_first(AXES[grains.axes].meaning),
        "Surface area": "; ".join(_SURFACES[surface] for surface in sorted(surfaces, reverse=True)),
        "Unit of length": unit_label(grains.unit),
        "Weighting": "by number of bodies, unless 'by mass' is stated (volume at one density)",
        "Avatars that are not valid": "are measured and compared like the others where they are one body",
    }


def _describe_source(grains: GrainSet) -> str:
    if "file" not in grains.table:
        return f"{len(grains)} in the scan"
    return f"{len(grains)} bodies of {grains.table['file'].nunique()} mesh files"


def _list_files(project: Project, populations: ProjectPopulations) -> list[str]:
    """Return which grain came from which mesh file, for grains of meshes."""
    assert project.grains is not None
    known = project.grains.table
    if "file" not in known:
        return []
    names = dict(zip(known["label"].tolist(), zip(known["name"], known["file"], strict=True), strict=True))
    rows = []
    for label in populations.grains.labels.tolist():
        name, file = names[label]
        rows.append([str(label), str(name), PureWindowsPath(str(file)).name])  # knows both slashes
    return [heading("Files"), table(["grain", "name", "file"], rows, words=True)]


def _factor_tables(populations: ProjectPopulations) -> list[str]:
    grains, avatars = populations.grains, populations.avatars
    parts = [_statistics_table(population) for population in select_measured([grains])]
    if avatars is None:
        return parts
    if not (grains.measured.any() and avatars.measured.any()):
        return parts
    rows = []
    for name, found in compare(grains, avatars).items():
        single = relative_errors(grains, avatars, name).values()
        errors = [abs(error) for error in single if np.isfinite(error)]
        rows.append(_comparison_row(found, errors, *readable_scale([grains], name)))
    columns = (
        "Avatars against grains", "mean, grains", "mean, avatars", "s.d., grains", "s.d., avatars",
        "δ mean (%)", "δ s.d. (%)", "each, median |δ| (%)", "K-S D", "p", "Wasserstein",
    )  # fmt: skip
    return [*parts, table(columns, rows), paragraph(_DISTANCES)]


def _statistics_table(population: Population) -> str:
    rows = []
    for name in population.factors:
        scale, unit = readable_scale([population], name)
        values = scale * population.values(name)
        if not len(values):
            continue
        mean, deviation = moments(values)
        cells = [mean, deviation, *np.percentile(values, [0, 10, 50, 90, 100]).tolist()]
        rows.append([FACTORS[name].heading(unit), str(len(values)), *map(_number, cells)])
    columns = (
        population.name.capitalize(),
        "n",
        "mean",
        "s.d.",
        "least",
        "10 %",
        "median",
        "90 %",
        "largest",
    )
    return table(columns, rows)


def _comparison_row(found: FactorComparison, errors: list[float], scale: float, unit: str) -> list[str]:
    moved = (scale * value for value in (*found.means, *found.deviations))
    return [
        FACTORS[found.factor].heading(unit),
        *map(_number, moved),
        *(_percent(error) for error in (found.mean_error, found.deviation_error)),
        _percent(100 * float(np.median(errors))) if errors else "–",
        f"{found.ks:.3f}",
        "< 0.001" if found.p < 0.001 else f"{found.p:.3f}",
        _number(scale * found.wasserstein),
    ]


def _size_tables(shown: list[Population], sieves: SieveSeries) -> list[str]:
    unit = unit_label(shown[0].unit)
    rows = []
    for population in shown:
        for curve in (size_distribution(population), size_distribution(population, sieves)):
            sizes = (curve.d10, curve.d30, curve.d50, curve.d60, curve.cu, curve.cc)
            read = curve.sieves or "size of each body"
            rows.append([population.name, read, *map(_number, sizes)])
    columns = ["", "read at", *(f"D{x} ({unit})" for x in (10, 30, 50, 60)), "C_u", "C_c"]
    return [
        table(columns, rows),
        paragraph(_SIZES),
    ]


def _form_table(shown: list[Population]) -> list[str]:
    rows = []
    for population in shown:
        diagram = zingg_diagram(population)
        shares = diagram.volume_shares
        cells = [f"{count} ({100 * shares[name]:.1f} %)" for name, count in diagram.counts.items()]
        rows.append([population.name, *cells])
    return [table(["Zingg: bodies (share of mass)", "disc", "equant", "blade", "rod"], rows)]


def _draw_figures(shown: list[Population], sieves: SieveSeries) -> Iterator[str]:
    curves = [(population, size_distribution(population, sieves)) for population in shown]
    against = " In the legends: relative errors of mean and standard deviation." if len(shown) > 1 else ""
    yield heading("Figures") + picture(
        cdf_figure(shown), f"Cumulative distributions of six factors, by number.{against}"
    )
    yield picture(
        pdf_figure(shown),
        "Densities of the same factors: histograms with bins by Freedman and Diaconis, and Gaussian kernel "
        "densities.",
    )
    yield picture(sieve_figure(curves), f"Percent finer by mass on the sieves of {SERIES_NAMES[sieves]}.")
    yield picture(zingg_figure(shown), "Zingg diagram, with the share of the bodies in every class.")
    yield picture(sneed_folk_figure(shown), "Sneed and Folk's diagram, with the share in every class.")
    yield picture(joint_figure(shown), "Pairs of factors; on the diagonal their densities.")


def _list_troubles(project: Project, populations: ProjectPopulations) -> list[str]:
    grains, avatars = populations.grains, populations.avatars
    parts = [heading("Avatars that are not valid")]
    invalid = []
    if avatars is not None:
        for label in avatars.labels.tolist():
            verdict = project.fits[label].verdict
            if not verdict.valid:
                invalid.append([str(label), " ".join(verdict.reasons)])
    parts.append(
        table(["grain", "why"], invalid, words=True)
        if invalid
        else paragraph("None." if avatars is not None else "No avatar was fitted to these grains.")
    )
    given = [population for population in (grains, avatars) if population is not None]
    rows = [[p.name, str(label), why] for p in given for label, why in p.failures.items()]
    parts.append(heading("Bodies that could not be measured"))
    parts.append(table(["", "label", "why"], rows, words=True) if rows else paragraph("None."))
    warned = [
        [p.name, str(label), warning]
        for p in given
        for label, warning in zip(p.labels.tolist(), p.warnings, strict=True)
        if warning
    ]
    if warned:
        parts += [heading("To be minded"), table(["", "label", "warning"], warned, words=True)]
    return parts


def _lower_first(words: str) -> str:
    return words[0].lower() + words[1:]


def _number(value: float) -> str:
    return f"{value:.4g}" if np.isfinite(value) else "–"


def _percent(value: float) -> str:
    return f"{value:.2f}" if np.isfinite(value) else "–"
