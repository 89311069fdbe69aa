"""specimen.csv: every particle of a specimen, for any engine; and its entry in the manifest."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mbstudio.core.dem.particles import Specimen
from mbstudio.core.dem.reading_back import number_rows, read_text
from mbstudio.core.dem.specimen.specimen import SpecimenPlan
from mbstudio.core.errors import ExportError

FILE_NAME = "specimen.csv"
_HEADER = "avatar,scale,size,x,y,z,qw,qx,qy,qz"


def write_specimen(folder: Path, specimen: Specimen) -> None:
    """Write a row for each particle, in the unit of the export."""
    lines = [_HEADER]
    for kind, *numbers in zip(
        specimen.kinds,
        specimen.scales,
        specimen.sizes,
        *specimen.positions.T,
        *specimen.quaternions.T,
        strict=True,
    ):
        lines.append(",".join([specimen.names[kind], *(f"{number:.12g}" for number in numbers)]))
    (folder / FILE_NAME).write_text("\n".join(lines) + "\n", encoding="ascii")


def describe_specimen(specimen: Specimen, plan: SpecimenPlan) -> dict[str, Any]:
    """Return what the manifest says about a specimen."""
    curve = specimen.curve()
    numbers = np.bincount(specimen.kinds, minlength=len(specimen.names))
    return {
        "count": len(specimen.kinds),
        "seed": plan.seed,
        "numbers": dict(zip(specimen.names, numbers.tolist(), strict=True)),
        "wanted": None
        if plan.curve is None
        else {
            "unit": plan.curve.unit,
            "sizes": plan.curve.sizes.tolist(),
            "finer": plan.curve.finer.tolist(),
        },
        "scales": [float(specimen.scales.min()), float(specimen.scales.max())],
        "d10": curve.d10,
        "d50": curve.d50,
        "d60": curve.d60,
        "solid_volume": float((specimen.volumes[specimen.kinds] * specimen.scales**3).sum()),
        "box": {"half_width": specimen.half, "top": specimen.top, "periodic": specimen.periodic},
    }


def check_specimen(folder: Path, manifest: Mapping[str, Any]) -> None:
    """Raise ExportError unless the table holds the particles that the manifest counts, inside the box."""
    path, said = folder / FILE_NAME, manifest["specimen"]
    header, *lines = read_text(path).splitlines() or [""]
    if header != _HEADER:
        raise ExportError(f"{path} has the header '{header}' instead of '{_HEADER}'.")
    names = [line.partition(",")[0] for line in lines]
    rows = number_rows(path, [line.partition(",")[2] for line in lines], 9, ",")
    found = {name: names.count(name) for name in said["numbers"]}
    if found != said["numbers"] or len(rows) != said["count"]:
        raise ExportError(f"{path} does not hold the particles that the manifest counts.")
    if rows[:, :2].min() <= 0:
        raise ExportError(f"{path} has a scale or size that is not positive.")
    half, top = said["box"]["half_width"], said["box"]["top"]
    if np.abs(rows[:, 2:4]).max() > half or rows[:, 4].min() < 0 or rows[:, 4].max() > top:
        raise ExportError(f"{path} has particles outside the box.")
    if np.abs(np.linalg.norm(rows[:, 5:], axis=1) - 1).max() > 1e-9:
        raise ExportError(f"{path} has quaternions that are not of length 1.")
    volumes = {item["name"]: item["volume"] for item in manifest["items"]}
    volume = sum(volumes[name] * scale**3 for name, scale in zip(names, rows[:, 0], strict=True))
    if abs(volume / said["solid_volume"] - 1) > 1e-9:
        raise ExportError(f"{path} has particles whose volume differs from the manifest.")
