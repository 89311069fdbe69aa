"""The example deck of a PFC export: some of each template fall into a box."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from mbstudio.core.dem.reading_back import read_text
from mbstudio.core.dem.shapes.clump import Clump
from mbstudio.core.dem.specimen.pouring import (
    NOT_RUN,
    Pouring,
    check_count,
    check_names,
    check_pouring,
    extent_of,
    plan_pouring,
)
from mbstudio.core.dem.target import Job
from mbstudio.core.errors import ExportError

DECK_NAME = "settle.dat"
_REPLICATE = re.compile(
    r"^clump replicate name '(?P<name>[^']+)' density \[density\] "
    r"position \((?P<place>[^()]*)\) axis \((?P<axis>[^()]*)\) angle (?P<angle>\S+)$",
    re.MULTILINE,
)


def settling_deck(job: Job, clumps: Sequence[Clump], templates: str) -> str:
    """Return a deck for PFC3D 6 to 9, in kg, s and the unit of the export.

    PFC chooses the time step by itself, from the stiffness and the masses.

    Parameters
    ----------
    job : Job
    clumps : sequence of Clump
    templates : str
        The file that makes all templates.
    """
    plan = plan_pouring(job, *extent_of(clumps))
    half, top = plan.stack.half, plan.stack.top
    domain = f"{-2 * half:.9g} {2 * half:.9g} {-2 * half:.9g} {2 * half:.9g} {-half:.9g} {1.5 * top:.9g}"
    return f"""; {len(plan.stack.places)} grains fall into a box.
; In PFC3D, within this folder: program call '{DECK_NAME}'
; {NOT_RUN}
; Units: {job.unit}, kg, s. Density in kg/{job.unit}3, gravity in {job.unit}/s2, stiffness in N/m.
model new
model large-strain on
[density = {plan.density:.9g}]
[gravity = {plan.gravity:.9g}]
[stiffness = {plan.contact.stiffness:.6g}]
model domain extent {domain} condition stop
contact cmat default model linear property kn [stiffness] ks [0.5*stiffness] fric 0.5 dp_nratio 0.35
wall generate box {-half:.9g} {half:.9g} {-half:.9g} {half:.9g} 0 {1.4 * top:.9g}
program call '{templates}'
{_replicates(plan, [body.name for body in job.bodies])}
model gravity 0 0 [-gravity]
model solve time {plan.seconds:.6g}
model save 'settled'
"""


def _replicates(plan: Pouring, names: Sequence[str]) -> str:
    turns = Rotation.from_quat(plan.stack.quaternions[:, [1, 2, 3, 0]]).as_rotvec()
    lines = []
    for number, (place, turn) in enumerate(zip(plan.stack.places, turns, strict=True)):
        angle = float(np.linalg.norm(turn))
        axis = turn / angle if angle > 0 else np.array([0.0, 0.0, 1.0])
        lines.append(
            f"clump replicate name '{names[number % len(names)]}' density [density] "
            f"position ({', '.join(f'{value:.9g}' for value in place)}) "
            f"axis ({', '.join(f'{value:.9g}' for value in axis)}) angle {np.degrees(angle):.9g}"
        )
    return "\n".join(lines)


def check_deck(path: Path, manifest: Mapping[str, Any], templates: str) -> None:
    """Raise ExportError unless a deck calls the templates and places them with the manifest's density.

    Raises
    ------
    ExportError
        If it calls another file, names other templates, has another number of particles, or another density,
        gravity or unit.
    """
    text = read_text(path)
    if f"\nprogram call '{templates}'\n" not in text:
        raise ExportError(f"{path} does not call {templates}.")
    placed = list(_REPLICATE.finditer(text))
    check_count(path, len(placed), manifest)
    names = [item["name"] for item in manifest["items"]]
    wanted = [names[number % len(names)] for number in range(len(placed))]
    check_names(path, [match["name"] for match in placed], wanted)
    words = [
        ",".join([match["place"], match["axis"], match["angle"]]).replace(" ", "").split(",")
        for match in placed
    ]
    try:
        numbers = np.array(words, dtype=float).reshape(len(placed), 7)
    except ValueError as error:
        raise ExportError(f"{path} has places or axes that are not numbers ({error}).") from error
    if not np.isfinite(numbers).all() or not np.allclose(
        np.linalg.norm(numbers[:, 3:6], axis=1), 1, atol=1e-6
    ):
        raise ExportError(f"{path} has places that are not finite, or axes that are not of length 1.")
    check_pouring(path, text, manifest, has_step=False)
