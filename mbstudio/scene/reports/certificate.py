"""A certificate of a sample: its sizes, form and pores on one page of A4, to be signed."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import mbstudio
from mbstudio.core.errors import MeasureError
from mbstudio.core.metrics.factor_table import FACTORS
from mbstudio.core.populations.bootstrap import Bootstrap
from mbstudio.core.populations.findings import Findings
from mbstudio.core.porosity import porosity_profiles
from mbstudio.core.project.measuring import ProjectPopulations
from mbstudio.core.units import unit_label
from mbstudio.scene.figures.population_figures import sieve_figure
from mbstudio.scene.figures.population_style import readable_scale
from mbstudio.scene.reports.blocks import Block, Facts, Heading, Picture, Table
from mbstudio.scene.reports.laboratory_blocks import read_number
from mbstudio.scene.reports.pdf_pages import PdfPages

if TYPE_CHECKING:
    from mbstudio.core.project import Project

_FORM = ("sphericity", "elongation", "flatness", "csf")


def write_certificate(
    path: Path, project: Project, populations: ProjectPopulations, findings: Findings
) -> Path:
    """Write a certificate on one page, as PDF.

    Parameters
    ----------
    path : Path
    project : Project
    populations : ProjectPopulations
    findings : Findings
        Of the grains.

    Raises
    ------
    MeasureError
        If it does not fit onto one page.
    OSError
        If the file cannot be written.
    """
    name = project.path.stem if project.path is not None else "unsaved project"
    pages = PdfPages(f"Certificate of {name} · mbstudio {mbstudio.__version__}")
    pages.write(f"Certificate of {name}", 17, weight="bold")
    pages.gap()
    for block in _blocks(project, populations, findings):
        pages.add(block)
    pages.sign("Date", "Name", "Signature")
    if len(pages.pages) > 1:
        raise MeasureError("The certificate takes more than one page: leave out laboratory tables.")
    return pages.save(path, {"Title": f"Certificate of {name}", "Creator": "mbstudio"})


def _blocks(project: Project, populations: ProjectPopulations, findings: Findings) -> list[Block]:
    grains, reference = populations.grains, project.state.scan
    known = {"Grains": f"{int(grains.measured.sum())} measured; {_told_enough(findings)}"}
    if project.grains is not None:
        known["Voxel size"] = str(project.grains.voxel_size)
        if project.grains.verdict is not None:
            known["Segmentation"] = f"verdict: {project.grains.verdict.level}"
        if not project.grains.is_of_meshes:
            mean = porosity_profiles(project.grains)["z"].mean
            known["Porosity"] = f"{mean:.3f} of the segmented scan"
    if reference is not None:
        if reference.path is not None:
            known = {"Scan": reference.path.name, **known}
        known["SHA-256 of its voxels"] = reference.digest
    if findings.classes:
        shares = findings.classes["iso14688"]
        known["ISO 14688-1"] = ", ".join(
            f"{word} {share:.0f} %" for word, share in shares.items() if share >= 0.5
        )
        symbol, why = findings.symbol
        known["ASTM D2487"] = f"{symbol or '–'}. {why}"
    known |= {
        f"{one.standard} ({one.name.split('_')[0]})": f"{one.percent:.1f} % of the mass tested, "
        f"{one.bodies} grains"
        for one in findings.indices
        if one.bodies and "d4791" not in one.name
    }
    if findings.is_corrected:
        known["Corrected for the border"] = (
            "the curve and the last column, after Miles and Lantuéjoul; values, intervals, classes and "
            "indices "
            "are those of the grains inside as they are"
        )
    for against in findings.against:
        known[f"Against {against.table.name}"] = (
            f"largest difference {against.gap:+.1f} % finer at {against.gap_at:g} mm"
        )
    curves = [(grains, findings.curve)]
    tables = [one.table for one in findings.against]
    return [
        Facts(known), Heading("Size by mass, and form by number"), _numbers(findings),
        Picture(
            sieve_figure(curves, laboratory=tables, bands=not findings.is_corrected),
            "Percent finer by mass at the intermediate axis of each grain"
            + (", corrected for the border." if findings.is_corrected else ", with a 95 % band."),
        ),
    ]  # fmt: skip


def _numbers(findings: Findings) -> Table:
    scale, unit = readable_scale([findings.population], "intermediate")
    rows = []
    for title in ("d10", "d50", "d90", "cu", "cc"):
        is_ratio = title in ("cu", "cc")
        found, factor = findings.sizes[title], 1.0 if is_ratio else scale
        label = f"C_{title[1]}" if is_ratio else f"{title.upper()} ({unit_label(unit)})"
        cells = [found.value, found.low, found.high, read_number(findings.curve, title)]
        rows.append([label, *(_number(factor * value) for value in cells)])
    drawn = Bootstrap(findings.population, level=findings.level, seed=findings.seed)
    for name in _FORM:
        found = drawn.mean(name)
        cells = [found.value, found.low, found.high, float("nan")]
        rows.append([f"{FACTORS[name].label}, mean", *(_number(value) for value in cells)])
    columns = [
        "Of the grains inside",
        "value",
        f"{100 * findings.level:g} % from",
        "to",
        "corrected for the border",
    ]
    # Without a correction the last column would repeat the first.
    count = 5 if findings.is_corrected else 4
    return Table(columns[:count], [row[:count] for row in rows])


def _told_enough(findings: Findings) -> str:
    wanted = f"±{100 * findings.precision:g} %"
    median = next(need for need in findings.needs if need.name == "d50")
    if median.is_enough is None:
        return f"too few to tell whether they are enough for D50 within {wanted}"
    if median.is_enough:
        return f"enough for D50 within {wanted}"
    return f"D50 within {wanted} needs {median.needed}"


def _number(value: float) -> str:
    return f"{value:.3g}" if value == value else "–"
