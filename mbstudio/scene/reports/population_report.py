"""The report of a project: its grains and avatars as populations, on one page."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path, PureWindowsPath
from typing import TYPE_CHECKING, Any

import numpy as np

import mbstudio
from mbstudio.core.metrics.factor_table import AXES, FACTORS, FITTED_FACTORS
from mbstudio.core.populations import (
    Population,
    compare,
    moments,
    relative_errors,
    size_distribution,
    zingg_diagram,
)
from mbstudio.core.populations.comparison import FactorComparison
from mbstudio.core.populations.findings import Findings, find_sizes
from mbstudio.core.populations.findings_record import record_of
from mbstudio.core.populations.sieving import SERIES_NAMES, SieveSeries
from mbstudio.core.project.measuring import ProjectPopulations
from mbstudio.core.replacement import replacing
from mbstudio.core.units import unit_label
from mbstudio.scene.figures.form_figures import sneed_folk_figure, zingg_figure
from mbstudio.scene.figures.population_figures import cdf_figure, joint_figure, pdf_figure, sieve_figure
from mbstudio.scene.figures.population_style import readable_scale, select_measured
from mbstudio.scene.reports.blocks import Block, Facts, Heading, Paragraph, Picture, Table, html_of
from mbstudio.scene.reports.laboratory_blocks import (
    against_blocks,
    class_blocks,
    size_blocks,
    specimen_blocks,
    test_blocks,
)
from mbstudio.scene.reports.methods import describe_methods, repeat_record
from mbstudio.scene.reports.packing_blocks import packing_blocks, packing_record
from mbstudio.scene.reports.pdf_pages import write_pdf
from mbstudio.scene.reports.report_page import page
from mbstudio.scene.reports.twin_blocks import twin_blocks

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
    "Wasserstein distance is the area between the cumulative distributions, in the factor's unit. "
    "* Volume and area are what the search fits, so that their errors, and those of what follows from them "
    "alone, are small by construction; 'mbstudio judge --fits' compares edge angles, curvature and "
    "harmonics, which are not fitted."
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
    findings: Findings | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> Path:
    """Write the populations of a project as one file: tables, figures and what went wrong.

    By its ending it is a page of HTML that loads nothing from anywhere, a PDF on pages of A4, or JSON for
    machines with every number and all that is needed to repeat it. It takes its place when it is complete.

    Parameters
    ----------
    path : Path
        Ends with .html, .pdf or .json; any other ending is HTML too.
    project : Project
    populations : ProjectPopulations
        As `measure_project` returns them.
    sieves : {"iso", "astm"}
        Standard series of the sieve curve.
    findings : Findings, optional
        Of the grains; by default as `find_sizes` gives them.
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
    found = findings or find_sizes(shown[0])
    if path.suffix.lower() == ".json":
        with replacing(path) as temporary:
            temporary.write_text(_machine_text(project, populations, found), encoding="utf-8")
        report(1.0, "written")
        return path
    name = project.path.name if project.path is not None else "unsaved project"
    title = f"Report on {name}"
    lead = f"Shape and size of {_count_bodies(populations)} · mbstudio {mbstudio.__version__}"
    blocks: list[Block] = [Heading("What was measured"), Facts(_describe_measuring(project, populations))]
    blocks += [Heading("Shape factors"), *_factor_tables(populations), *test_blocks(populations)]
    blocks += [Heading("Particle size"), *size_blocks(found), *against_blocks(found)]
    blocks += [*_size_tables(shown, sieves), *class_blocks(found), Heading("Form"), *_form_table(shown)]
    blocks += specimen_blocks(project, populations)
    report(0.1, "tables")
    for place, block in enumerate(_draw_figures(shown, sieves, found)):
        blocks.append(block)
        report(0.1 + 0.1 * (place + 1), "figures")
    if project.state.packing is not None:
        blocks += packing_blocks(project.state.packing)
    if project.state.twin is not None:
        blocks += twin_blocks(project.state.twin)
    blocks += [*_list_troubles(project, populations), *_list_files(project, populations)]
    blocks += _tell_methods(project, populations, found)
    if path.suffix.lower() == ".pdf":
        write_pdf(path, title, lead, blocks, progress=lambda share, told: report(0.75 + 0.2 * share, told))
    else:
        with replacing(path) as temporary:
            temporary.write_text(page(title, lead, [html_of(block) for block in blocks]), encoding="utf-8")
    report(1.0, "written")
    return path


def _machine_text(project: Project, populations: ProjectPopulations, findings: Findings) -> str:
    """Return every number and what is needed to repeat it, as JSON."""
    text, references = describe_methods(project, populations, findings)
    record = {
        "repeat": repeat_record(project, populations, findings),
        "methods": {"text": text, "references": references},
        "findings": record_of(findings),
        "packing": None if project.state.packing is None else packing_record(project.state.packing),
        "grains": _rows_of(populations.grains),
        "avatars": None if populations.avatars is None else _rows_of(populations.avatars),
    }
    return json.dumps(_plain(record), indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _rows_of(population: Population) -> list[dict[str, object]]:
    return [
        {"label": label, **{name: float(column[place]) for name, column in population.factors.items()},
         "warning": population.warnings[place], "not_measured": population.reasons[place]}
        for place, label in enumerate(population.labels.tolist())
    ]  # fmt: skip


def _plain(value: Any) -> Any:
    """Return a value as JSON knows it: what is not a finite number is null."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return value


def _tell_methods(project: Project, populations: ProjectPopulations, findings: Findings) -> list[Block]:
    text, references = describe_methods(project, populations, findings)
    record = repeat_record(project, populations, findings)
    scan = record["scan"] or {}
    repeat = {
        "Versions": f"mbstudio {record['mbstudio']}, Python {record['python']}, "
        + ", ".join(f"{name} {number}" for name, number in record["packages"].items()),
        "SHA-256 of the scan's voxels": str(scan.get("sha256", "no scan")),
        "Segmentation": _list_settings(record["segmentation"])
        if record["segmentation"]
        else "made elsewhere",
        "Corrections by hand": str(record["edits_by_hand"]),
        "Drawn again": f"{record['bootstrap']['samples']} times, seed {record['bootstrap']['seed']}",
    }
    return [
        Heading("Methods"), Paragraph(text), *map(Paragraph, references),
        Heading("To repeat it"), Facts(repeat),
    ]  # fmt: skip


def _list_settings(settings: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} = {value}" for name, value in settings.items() if value is not None)


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


def _list_files(project: Project, populations: ProjectPopulations) -> list[Block]:
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
    return [Heading("Files"), Table(["grain", "name", "file"], rows, words=True)]


def _factor_tables(populations: ProjectPopulations) -> list[Block]:
    grains, avatars = populations.grains, populations.avatars
    parts: list[Block] = [_statistics_table(population) for population in select_measured([grains])]
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
    return [*parts, Table(columns, rows), Paragraph(_DISTANCES)]


def _statistics_table(population: Population) -> Block:
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
    return Table(columns, rows)


def _comparison_row(found: FactorComparison, errors: list[float], scale: float, unit: str) -> list[str]:
    moved = (scale * value for value in (*found.means, *found.deviations))
    return [
        FACTORS[found.factor].heading(unit) + (" *" if found.factor in FITTED_FACTORS else ""),
        *map(_number, moved),
        *(_percent(error) for error in (found.mean_error, found.deviation_error)),
        _percent(100 * float(np.median(errors))) if errors else "–",
        f"{found.ks:.3f}",
        "< 0.001" if found.p < 0.001 else f"{found.p:.3f}",
        _number(scale * found.wasserstein),
    ]


def _size_tables(shown: list[Population], sieves: SieveSeries) -> list[Block]:
    unit = unit_label(shown[0].unit)
    rows = []
    for population in shown:
        for curve in (size_distribution(population), size_distribution(population, sieves)):
            sizes = (curve.d10, curve.d30, curve.d50, curve.d60, curve.cu, curve.cc)
            read = curve.sieves or "size of each body"
            rows.append([population.name, read, *map(_number, sizes)])
    columns = ["", "read at", *(f"D{x} ({unit})" for x in (10, 30, 50, 60)), "C_u", "C_c"]
    return [
        Table(columns, rows),
        Paragraph(_SIZES),
    ]


def _form_table(shown: list[Population]) -> list[Block]:
    rows = []
    for population in shown:
        diagram = zingg_diagram(population)
        shares = diagram.volume_shares
        cells = [f"{count} ({100 * shares[name]:.1f} %)" for name, count in diagram.counts.items()]
        rows.append([population.name, *cells])
    return [Table(["Zingg: bodies (share of mass)", "disc", "equant", "blade", "rod"], rows)]


def _draw_figures(shown: list[Population], sieves: SieveSeries, findings: Findings) -> Iterator[Block]:
    curves = [(population, size_distribution(population, sieves)) for population in shown]
    against = " In the legends: relative errors of mean and standard deviation." if len(shown) > 1 else ""
    yield Heading("Figures")
    yield Picture(
        cdf_figure(shown, bands=True),
        f"Cumulative distributions of six factors, by number, with 95 % bands.{against}",
    )
    yield Picture(
        pdf_figure(shown),
        "Densities of the same factors: histograms with bins by Freedman and Diaconis, and Gaussian kernel "
        "densities.",
    )
    yield Picture(
        sieve_figure(curves, laboratory=[one.table for one in findings.against], bands=True),
        f"Percent finer by mass on the sieves of {SERIES_NAMES[sieves]}, with 95 % bands.",
    )
    yield Picture(zingg_figure(shown), "Zingg diagram, with the share of the bodies in every class.")
    yield Picture(sneed_folk_figure(shown), "Sneed and Folk's diagram, with the share in every class.")
    yield Picture(joint_figure(shown), "Pairs of factors; on the diagonal their densities.")


def _list_troubles(project: Project, populations: ProjectPopulations) -> list[Block]:
    grains, avatars = populations.grains, populations.avatars
    parts: list[Block] = [Heading("Avatars that are not valid")]
    invalid = []
    if avatars is not None:
        for label in avatars.labels.tolist():
            verdict = project.fits[label].verdict
            if not verdict.valid:
                invalid.append([str(label), " ".join(verdict.reasons)])
    parts.append(
        Table(["grain", "why"], invalid, words=True)
        if invalid
        else Paragraph("None." if avatars is not None else "No avatar was fitted to these grains.")
    )
    given = [population for population in (grains, avatars) if population is not None]
    rows = [[p.name, str(label), why] for p in given for label, why in p.failures.items()]
    parts.append(Heading("Bodies that could not be measured"))
    parts.append(Table(["", "label", "why"], rows, words=True) if rows else Paragraph("None."))
    warned = [
        [p.name, str(label), warning]
        for p in given
        for label, warning in zip(p.labels.tolist(), p.warnings, strict=True)
        if warning
    ]
    if warned:
        parts += [Heading("To be minded"), Table(["", "label", "warning"], warned, words=True)]
    return parts


def _lower_first(words: str) -> str:
    return words[0].lower() + words[1:]


def _number(value: float) -> str:
    return f"{value:.4g}" if np.isfinite(value) else "–"


def _percent(value: float) -> str:
    return f"{value:.2f}" if np.isfinite(value) else "–"
