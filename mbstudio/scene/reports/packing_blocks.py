"""The packings of a project in its report: numbers, profiles, and whether kinds of grains pack alike."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mbstudio.core.errors import PackingError
from mbstudio.core.packing.trial import Findings, PackingTrial
from mbstudio.core.units import unit_label
from mbstudio.scene.reports.blocks import Block, Heading, Paragraph, Picture, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_NAMES = {"parents": "avatars"}
_COLOURS = ("#d99b45", "#2a7fb8", "#a33b76")  # of the scene: sand, blue, reddish purple
_DIGITS = {"porosity": 4, "coordination": 2, "anisotropy": 2}
_NOTE = (
    "Measured in the inner part, {inset:g} mean diameters away from walls, floor and surface; porosity is "
    "counted on the avatars, contacts are those of the clumps. Overlap: the largest, over the mean diameter."
)
_COMPARED = (
    "Mean ± standard error of {seeds} packings of each kind; 'by chance' is how often packings that are "
    "alike differ so much (Welch's test), and they differ where that is less than once in twenty."
)


def packing_blocks(trial: PackingTrial) -> list[Block]:
    """Return what a report says of the packings of a trial."""
    found: dict[str, Findings] = {}
    parts: list[Block] = [Heading("Packing")]
    for name, packing in trial.packings.items():
        try:
            found[_NAMES.get(name, name)] = Findings.of(packing, trial.inset)
        except PackingError as error:
            parts.append(Paragraph(f"{_NAMES.get(name, name)}: {error}"))
    if found:
        parts += [_numbers(found), Paragraph(_NOTE.format(inset=trial.inset))]
    if trial.comparison is not None:
        parts += _comparison(trial)
    if found:
        parts.append(
            Picture(
                profile_figure(found),
                "Porosity by height away from the side walls, and by the distance from them; how often "
                "contact normals point so far up, over chance.",
            )
        )
    return parts


def packing_record(trial: PackingTrial) -> dict[str, Any]:
    """Return the numbers of a trial for JSON: of each kind, or why it has none, and the comparison."""
    record: dict[str, Any] = {"inset": trial.inset, "kinds": {}}
    for name, packing in trial.packings.items():
        try:
            record["kinds"][name] = packing.summary(trial.inset)
        except PackingError as error:
            record["kinds"][name] = {"not_measured": str(error)}
    record["comparison"] = None if trial.comparison is None else trial.comparison.as_dict()
    return record


def _numbers(found: dict[str, Findings]) -> Table:
    rows = []
    for name, findings in found.items():
        told = findings.summary
        rows.append(
            [
                name, str(told["grains"]), str(told["grains_inside"]), f"{told['friction']:g}", told["mould"],
                f"{told['porosity']:.4f}", f"{told['coordination']:.2f}", f"{told['anisotropy']:.2f}",
                f"{100 * told['overlap']:.3f} %", f"{told['height']:.4g}", f"{told['width']:.4g}",
            ]
        )  # fmt: skip
    unit = unit_label(str(next(iter(found.values())).summary["unit"]))
    columns = (
        "Grains of", "n", "inside", "friction", "mould", "porosity", "coordination", "anisotropy", "overlap",
        f"height ({unit})", f"width ({unit})",
    )  # fmt: skip
    return Table(columns, rows)


def _comparison(trial: PackingTrial) -> list[Block]:
    comparison = trial.comparison
    assert comparison is not None
    rows = [
        [
            _NAMES.get(name, name),
            *(f"{means[m].value:.{n}f} ± {means[m].error:.{n}f}" for m, n in _DIGITS.items()),
        ]
        for name, means in comparison.means.items()
    ]
    first = next(iter(next(iter(comparison.means.values())).values()))
    parts: list[Block] = [Table(("Means", *_DIGITS), rows)]
    if comparison.differences:
        rows = [
            [
                one.measure,
                f"{_NAMES.get(one.second, one.second)} less {_NAMES.get(one.first, one.first)}",
                f"{one.value:+.4f} ± {one.error:.4f}",
                f"{one.chance:.2g}",
                "differ" if one.differs else "no difference is seen",
            ]
            for one in comparison.differences
        ]
        parts.append(Table(("Differences", "of", "difference", "by chance", "verdict"), rows, words=True))
    return [*parts, Paragraph(_COMPARED.format(seeds=len(first.values)))]


def profile_figure(found: dict[str, Findings]) -> Figure:
    """Return porosity by height and by distance from the walls, and the rose of contact normals."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 3.4), layout="constrained")
    height, walls = figure.add_subplot(1, 3, 1), figure.add_subplot(1, 3, 2)
    rose = figure.add_subplot(1, 3, 3, projection="polar")
    unit = ""
    for place, (name, findings) in enumerate(found.items()):
        colour = _COLOURS[place % len(_COLOURS)]
        unit = unit_label(str(findings.summary["unit"]))
        height.plot(findings.by_height, findings.heights, color=colour, label=name)
        walls.plot(findings.distances, findings.by_distance, color=colour, label=name)
        edges = np.linspace(0, np.pi / 2, len(findings.rose) + 1)
        rose.stairs(findings.rose, edges, color=colour, label=name)
    height.set(xlabel="porosity", ylabel=f"height ({unit})", xlim=(0, 1))
    walls.set(xlabel=f"distance from the walls ({unit})", ylabel="porosity", ylim=(0, 1))
    rose.set_xlim(0, np.pi / 2)
    rose.set_title("contact normals", fontsize=9)
    height.legend(fontsize=8)
    return figure
