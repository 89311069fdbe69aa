"""The deck of a LIGGGHTS specimen: templates of a few sizes each, inserted in their exact numbers.

LIGGGHTS places and turns particles itself; what a specimen gives it are sizes and numbers. Each kind of
grain is scaled to a few sizes, and one insertion for each size, the largest first, puts in as many as the
specimen has.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mbstudio.core.dem.formats.liggghts.deck import (
    check_end,
    closing,
    cost_of,
    hertz_contact,
    opening,
    prime_above,
    template_command,
)
from mbstudio.core.dem.particles import Specimen
from mbstudio.core.dem.reading_back import read_lines
from mbstudio.core.dem.shapes.clump import Clump
from mbstudio.core.dem.specimen.deck_cost import require_affordable
from mbstudio.core.dem.specimen.settling import specimen_box
from mbstudio.core.dem.specimen.specimen import in_classes
from mbstudio.core.dem.target import Job
from mbstudio.core.errors import ExportError
from mbstudio.core.units import METRES_PER_UNIT

DECK_NAME = "in.specimen"


def write_specimen_deck(job: Job, specimen: Specimen, clumps: Sequence[Clump]) -> Mapping[str, Any]:
    """Write the deck in SI units; the specimen is in the unit of the export. Returns what the deck costs.

    Raises
    ------
    ExportError
        If it would take longer than the export allows.
    """
    if specimen.periodic:
        raise ExportError("The deck of LIGGGHTS has walls: leave periodic sides out, or export for LAMMPS.")
    rounded = in_classes(specimen, int(job.options["classes"]))
    groups = sorted(
        {(float(scale), int(kind)) for kind, scale in zip(rounded.kinds, rounded.scales, strict=True)},
        key=lambda group: -group[0] * float(specimen.reaches[group[1]]),
    )
    parts: list[str] = []
    total = 0
    for number, (scale, kind) in enumerate(groups, start=1):
        many = int(np.count_nonzero((rounded.kinds == kind) & (rounded.scales == scale)))
        body = job.bodies[kind]
        template = template_command(
            body,
            f"{body.name}.multisphere",
            len(clumps[kind].radii),
            number,
            int(job.options["ntry"]),
            scale,
        )
        total += many
        parts.append(template + _insertion(number, total))
    box = specimen_box(rounded, job.bodies, clumps)
    contact = hertz_contact(box, job.bodies[0].mass.density)
    cost = cost_of(box, contact, sum(len(clumps[kind].radii) for kind in rounded.kinds))
    require_affordable(job, DECK_NAME, cost, box)
    title = f"A specimen of {box.particles} particles settles in a box"
    head = opening(box, contact, title, DECK_NAME, cost)
    text = "\n".join([head, *parts, closing(box, contact, cost, DECK_NAME)])
    (job.folder / DECK_NAME).write_text(text, encoding="ascii")
    return cost.record()


def _insertion(number: int, total: int) -> str:
    """Return distribution and insertion of one size.

    LIGGGHTS fills the region up to a number and counts what is there already: `total` is this size and
    all before.
    """
    first, second = (prime_above(32452843 + 2000 * number + 1000 * i) for i in range(2))
    return f"""fix kind{number} all particledistribution/discrete/numberbased {first} 1 template{number} 1.0
fix pour{number} all insert/pack seed {second} distributiontemplate kind{number} maxattempt 1000 &
    insert_every once overlapcheck yes orientation random all_in yes vel constant 0. 0. 0. &
    region above particles_in_region {total}
"""


def check_specimen_deck(folder: Path, manifest: Mapping[str, Any]) -> None:
    """Raise ExportError unless a deck inserts the particles of the manifest, with their mass."""
    path = folder / DECK_NAME
    check_end(path)
    text = " ".join(line.removesuffix("&").strip() for line in read_lines(path) if not line.startswith("#"))
    masses = [float(word) for word in re.findall(r" mass (\S+) inertia_tensor", text)]
    totals = [int(word) for word in re.findall(r"particles_in_region (\d+)", text)]
    said = manifest["specimen"]
    many = np.diff([0, *totals])
    if len(masses) != len(many) or totals[-1:] != [said["count"]] or many.min() <= 0:
        raise ExportError(f"{path} does not insert the particles that the manifest counts.")
    wanted = manifest["density"] * said["solid_volume"] * METRES_PER_UNIT[manifest["unit"]] ** 3
    if abs(float(many @ np.array(masses)) / wanted - 1) > 1e-6:
        raise ExportError(f"{path} inserts a mass that differs from the specimen's.")
