"""The example script of both Yade exports: some of each grain settle in a box."""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mbstudio.core.dem.reading_back import read_text
from mbstudio.core.dem.specimen.settling import GRAVITY, POISSON, stacked_grains
from mbstudio.core.errors import ExportError

SCRIPT_NAME = "settle.py"

_SCRIPT = '''"""Let the grains fall into a box. Run within this folder: yade -n -x settle.py"""

import sys
from math import atan

import numpy as np
from yade import *
from yade.utils import *

# File, mass in kg, principal moments in kg m2 (ascending) of each kind; SI units throughout.
KINDS = {kinds}
HALF, TOP, YOUNG, STEP, STEPS = {half:.9g}, {top:.9g}, {young:.6g}, {step:.6g}, {steps}
POSITIONS = {positions}
QUATERNIONS = {quaternions}  # w, x, y, z

O.materials.append(
    FrictMat(young=YOUNG, poisson={poisson}, frictionAngle=atan(0.5), density={density:.9g}, label="grain")
)
{loader}

for axis, position, sense in ((2, 0, 1), (0, -HALF, 1), (0, HALF, -1), (1, -HALF, 1), (1, HALF, -1)):
    O.bodies.append(wall(position, axis=axis, sense=sense, material="grain"))
GRAINS = [
    make(number % len(KINDS), place, turn)
    for number, (place, turn) in enumerate(zip(POSITIONS, QUATERNIONS))
]
O.engines = [
    ForceResetter(),
    InsertionSortCollider([{bounds}, Bo1_Wall_Aabb()]),
    InteractionLoop(
        [{geometry}],
        [Ip2_FrictMat_FrictMat_FrictPhys()],
        [Law2_ScGeom_FrictPhys_CundallStrack(sphericalBodies={spherical})],
    ),
    NewtonIntegrator(gravity=(0, 0, -{gravity}), damping=0.3),
]
O.dt = STEP

for _ in range(20):
    O.run(STEPS // 20, True)
    states = [O.bodies[number].state for number in GRAINS]
    inside = [s for s in states if abs(s.pos[0]) < HALF and abs(s.pos[1]) < HALF and s.pos[2] > 0]
    print("SETTLING", len(inside), sum(0.5 * s.mass * s.vel.squaredNorm() for s in states))
    sys.stdout.flush()
'''


def settling_script(
    kinds: Sequence[tuple[str, float, list[float]]],
    loader: str,
    reach: float,
    smallest: float,
    poured: int,
    *,
    density: float,
    level_set: bool = False,
) -> str:
    """Return a script in SI units that runs as it is, from within its folder.

    Parameters
    ----------
    kinds : sequence of (file, mass, moments)
    loader : str
        Source of the function ``make(kind, position, orientation)``.
    reach : float
        Radius of the largest bounding sphere, in m.
    smallest : float
        Smallest radius of curvature that touches, in m.
    poured : int
    level_set : bool
        Whether the shapes are level sets and not spheres.
    density : float
        In kg/m**3.
    """
    stack = stacked_grains(poured, len(kinds), reach)
    top = stack.top
    heaviest, lightest = (pick(mass for _, mass, _ in kinds) for pick in (max, min))
    # Yade's normal stiffness of two equal spheres is young * radius.
    stiffness = heaviest * 2 * GRAVITY * top / (0.1 * smallest) ** 2
    step = float(f"{np.pi / np.sqrt(2 * stiffness / lightest) / 40:.3g}")
    steps = int(np.ceil(4 * np.sqrt(2 * top / GRAVITY) / step / 20) * 20)
    name = "LevelSet" if level_set else "Sphere"
    geometry = [f"Ig2_{name}_{name}_ScGeom()", f"Ig2_Wall_{name}_ScGeom()"]
    return _SCRIPT.format(
        kinds=repr(list(kinds)),
        half=stack.half,
        top=top,
        young=stiffness / smallest,
        step=step,
        steps=steps,
        positions=repr([tuple(round(float(value), 12) for value in row) for row in stack.places]),
        quaternions=repr([tuple(round(float(value), 9) for value in row) for row in stack.quaternions]),
        poisson=POISSON,
        density=density,
        loader=loader.strip(),
        bounds=f"Bo1_{name}_Aabb()",
        geometry=", ".join(geometry),
        spherical=not level_set,
        gravity=GRAVITY,
    )


def check_kinds(path: Path, manifest: Mapping[str, Any]) -> None:
    """Raise ExportError unless a script names files, masses and moments of the manifest."""
    text = read_text(path)
    if not text.endswith(_SCRIPT[_SCRIPT.index("O.dt = STEP") :]):
        raise ExportError(f"{path} is cut off: it does not end by running and telling the energy.")
    line = next((line for line in text.splitlines() if line.startswith("KINDS = ")), None)
    try:
        kinds = ast.literal_eval(line.removeprefix("KINDS = ")) if line else []
        numbers = np.array([[mass, *moments] for _, mass, moments in kinds], dtype=float)
        names = [name for name, _, _ in kinds]
    except (ValueError, SyntaxError, TypeError) as error:
        raise ExportError(f"{path} has a list of kinds that cannot be read ({error}).") from error
    wanted = np.array([[item["mass"], *item["moments"]] for item in manifest["items"]])
    if names != [item["files"][0] for item in manifest["items"]] or numbers.shape != wanted.shape:
        raise ExportError(f"{path} does not load the files of the manifest, each once and in order.")
    if not np.allclose(numbers, wanted, rtol=1e-9, atol=0):
        raise ExportError(f"Mass or moments in {path} differ from the manifest.")
