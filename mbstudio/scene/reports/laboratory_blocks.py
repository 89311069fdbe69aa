"""Sections of a report that a laboratory signs: sizes, grains needed, classes, tests, pores."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mbstudio.core.errors import MeasureError
from mbstudio.core.metrics.factor_table import FACTORS
from mbstudio.core.populations.findings import Findings
from mbstudio.core.populations.sieving import SizeDistribution
from mbstudio.core.populations.significance import POWER, FactorTest, find_differences
from mbstudio.core.porosity import (
    PorosityProfile,
    RepresentativeVolume,
    SizeProfile,
    porosity_profiles,
    representative_volume,
    size_profiles,
)
from mbstudio.core.project.measuring import ProjectPopulations
from mbstudio.core.project.project import Project
from mbstudio.core.units import unit_label
from mbstudio.scene.figures.population_style import readable_scale
from mbstudio.scene.figures.specimen_figure import specimen_figure
from mbstudio.scene.reports.blocks import Block, Facts, Heading, Paragraph, Picture, Table

_SCALES = {"wentworth": "Wentworth (1922)", "uscs": "ASTM D2487", "iso14688": "ISO 14688-1"}
_TITLES = {"mean": "Mean size by mass", "cu": "C_u", "cc": "C_c"}


def size_blocks(findings: Findings) -> list[Block]:
    """Return sizes with their intervals, and how many grains they need."""
    scale, unit = readable_scale([findings.population], "intermediate")
    label = unit_label(unit)
    rows = []
    for name, found in findings.sizes.items():
        factor = 1.0 if name in ("cu", "cc") else scale
        value = read_number(findings.curve, name)
        cells = [factor * found.value, factor * found.low, factor * found.high]
        if findings.is_corrected:
            cells.append(factor * value)
        rows.append([_title(name, label), *map(_number, cells)])
    percent = f"{100 * findings.level:g} %"
    columns = ["Size of the grains", "value", f"{percent} from", "to"]
    if findings.is_corrected:
        columns.append("corrected for the border")
    blocks: list[Block] = [Table(columns, rows)]
    needs = [
        [
            _title(need.name, label), str(need.bodies), _percent(100 * need.found.half_width),
            _count(need.by_bootstrap), _count(need.by_lognormal),
            {None: "cannot be told", True: "yes", False: "no"}[need.is_enough],
        ]
        for need in findings.needs
    ]  # fmt: skip
    blocks.append(
        Table(["Enough grains?", "grains", "reached ± (%)", "needed, as drawn again", "needed, log-normal",
               f"enough for ±{100 * findings.precision:g} %"], needs)
    )  # fmt: skip
    blocks.append(
        Paragraph(
            f"Intervals of {percent} by drawing the grains again, none of fewer than ten. The larger number "
            "of needed grains counts: one follows from these grains, the other from ISO 13322-1 for "
            "log-normal sizes."
            + (
                " Values, intervals, classes and indices are those of the grains inside as they are. "
                "Corrected for the border are the last column and the comparison with a laboratory: each "
                "grain inside counts for those of its size that the border cuts (Miles-Lantuéjoul)."
                if findings.is_corrected
                else ""
            )
        )
    )
    return blocks


def against_blocks(findings: Findings) -> list[Block]:
    """Return the laboratory's curves beside that of the scan."""
    blocks: list[Block] = []
    for one in findings.against:
        rows = [
            [f"{size:g}", f"{lab:.1f}", f"{scan:.1f}", f"{scan - lab:+.1f}"]
            for size, lab, scan in zip(
                one.table.curve.sizes.tolist(),
                one.table.curve.finer.tolist(),
                one.scan.finer.tolist(),
                strict=True,
            )
        ]
        blocks += [
            Table(
                [f"{one.table.name}: opening (mm)", "laboratory (% finer)", "scan (% finer)", "difference"],
                rows,
            ),
            Paragraph(
                f"Read as: {one.table.read_as} The largest difference is {one.gap:+.1f} % at {one.gap_at:g} "
                "mm."
            ),
        ]
    return blocks


def class_blocks(findings: Findings) -> list[Block]:
    """Return classes of sizes and indices of form; nothing for bodies without a unit."""
    if not findings.classes:
        return []
    rows = [
        [
            _SCALES[scale],
            ", ".join(f"{name} {share:.1f} %" for name, share in shares.items() if share >= 0.05),
        ]
        for scale, shares in findings.classes.items()
    ]
    symbol, why = findings.symbol
    rows.append(["ASTM D2487, symbol", f"{symbol or '–'}. {why}"])
    blocks: list[Block] = [Heading("Classes and indices of standards"), Facts(dict(map(tuple, rows)))]  # type: ignore[arg-type]
    tested = [one for one in findings.indices if one.bodies]
    if tested:
        blocks.append(
            Table(
                ["Index", "standard", "% of the mass tested", "grains", "share of the mass (%)"],
                [[one.name.replace("_", " "), one.standard, f"{one.percent:.1f}", str(one.bodies),
                  f"{100 * one.mass_share:.0f}"] for one in tested],
            )
        )  # fmt: skip
    else:
        blocks.append(
            Paragraph(
                "No grain is of a size that BS 812, EN 933 or ASTM D4791 test (from 4 mm on): their indices "
                "are not defined here."
            )
        )
    return blocks


def test_blocks(populations: ProjectPopulations) -> list[Block]:
    """Return which factors differ between grains and their own avatars; nothing without avatars."""
    grains, avatars = populations.grains, populations.avatars
    if avatars is None or not (grains.measured.any() and avatars.measured.any()):
        return []
    paired = find_differences(grains, avatars, paired=True)
    rows = [_test_row(test) for test in paired.values()]
    return [
        Heading("Tests"),
        Table(
            ["Avatars against their grains", "pairs", "p", "p after Holm", "differ", "detectable (s.d.)"],
            rows,
        ),
        Paragraph(
            "Signed ranks (Wilcoxon) of each avatar's relative error; probabilities adjusted after Holm for "
            "all factors together. Detectable: the smallest mean error that is found with a probability of "
            f"{POWER:g}, in standard deviations of the errors. A factor that does not differ may differ by "
            f"less."
        ),
    ]


test_blocks.__test__ = False  # type: ignore[attr-defined]  # pytest takes the name for a test


def specimen_blocks(project: Project, populations: ProjectPopulations) -> list[Block]:
    """Return porosity, profiles and where which sizes lie; nothing for bodies of mesh files."""
    grains = project.grains
    if grains is None or grains.is_of_meshes:
        return []
    profiles = porosity_profiles(grains)
    boxes: RepresentativeVolume | None
    try:
        boxes, told = representative_volume(grains), ""
    except MeasureError as error:
        boxes, told = None, str(error)
    sizes: Mapping[str, SizeProfile]
    try:
        sizes = size_profiles(populations.grains, grains)
    except MeasureError:
        sizes = {}
    facts = describe_porosity(profiles, boxes, unit_label(grains.unit))
    if told:
        facts["Boxes"] = told
    return [
        Heading("Specimen"),
        Facts(facts),
        Picture(
            specimen_figure(profiles, boxes, sizes),
            "Porosity along the axes of the scan; porosity of boxes at random places; size of the grains "
            "against height and distance from the axis, with means and 95 % intervals.",
        ),
    ]


def describe_porosity(
    profiles: Mapping[str, PorosityProfile], boxes: RepresentativeVolume | None, unit: str
) -> dict[str, str]:
    """Return porosity, void ratio and the representative edge in words."""
    mean = profiles["z"].mean
    known = {
        "Porosity": f"{mean:.3f} (solid fraction {1 - mean:.3f}, void ratio "
        + (f"{mean / (1 - mean):.3f})" if mean < 1 else "not defined)"),
        "Solid": "all voxels of grains, also of those that the border cuts",
    }
    if boxes is not None:
        known["Representative box"] = (
            f"from {boxes.edge:.3g} {unit} on the porosity of boxes stays within {100 * boxes.tolerance:g} %"
            if boxes.edge is not None
            else f"none: boxes up to half of the scan still differ by more than {100 * boxes.tolerance:g} %"
        )
    return known


def read_number(curve: SizeDistribution, name: str) -> float:
    """Return 'd10' to 'd90', 'cu' or 'cc' of a curve."""
    return float(getattr(curve, name)) if name in ("cu", "cc") else curve.diameter(int(name[1:]))


def _test_row(test: FactorTest) -> list[str]:
    return [
        FACTORS[test.factor].label, str(test.numbers[0]), _probability(test.p), _probability(test.p_adjusted),
        "yes" if test.differs else "no", f"{test.detectable_mean:.2f}",
    ]  # fmt: skip


def _title(name: str, unit: str) -> str:
    words = _TITLES.get(name, name.upper())
    return words if name in ("cu", "cc") else f"{words} ({unit})"


def _count(number: int | None) -> str:
    return "–" if number is None else f"{number:,}".replace(",", "\u202f")


def _probability(p: float) -> str:
    return "–" if not np.isfinite(p) else "< 0.001" if p < 0.001 else f"{p:.3f}"


def _number(value: float) -> str:
    return f"{value:.4g}" if np.isfinite(value) else "–"


def _percent(value: float) -> str:
    return f"{value:.1f}" if np.isfinite(value) else "–"
