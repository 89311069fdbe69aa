"""The example script of both Yade exports: some of each grain settle in a box."""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mbstudio.core.dem.reading_back import read_text
from mbstudio.core.dem.specimen.deck_cost import DeckCost, bounds_of, require_affordable
from mbstudio.core.dem.specimen.settling import GRAVITY, POISSON, SettlingBox, stacked_grains
from mbstudio.core.dem.target import Job
from mbstudio.core.errors import ExportError

SCRIPT_NAME = "settle.py"

_SCRIPT = '''"""Let the grains fall into a box. Run within this folder: yade -n -x settle.py

It takes {told}.
It writes settled.csv: where every grain came to rest and how it is turned (m, quaternion w x y z), for
'mbstudio packing read'; and settled.yade.gz. The last line that it prints begins with SETTLED.
It ends with an error if a grain is lost, more energy is there than there was to fall, or grains lie deeper in
each other or in a wall than twice the hardest fall by design.
"""

import csv
import sys
from math import atan

import numpy as np
from yade import *
from yade.utils import *

# File, mass in kg, principal moments in kg m2 (ascending) of each kind; SI units throughout.
KINDS = {kinds}
HALF, TOP, YOUNG, STEP, STEPS = {half:.9g}, {top:.9g}, {young:.6g}, {step:.6g}, {steps}
ENERGY = {energy:.6g}  # J, all that there is to fall
IMPACT, REST = {impact:.6g}, {rest:.6g}  # m, most overlap in the fall and at rest
SOLID = {solid:.9g}  # m3, of all grains
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

# The engine's own centres and axes of a clump, from its spheres, are not quite the avatar's.
BEGUN = [(O.bodies[number].state.pos, O.bodies[number].state.ori) for number in GRAINS]


def poses():
    """Return where the centre of mass of every avatar is, and how it is turned."""
    found = []
    for number, (place, turn), start, q in zip(GRAINS, BEGUN, POSITIONS, QUATERNIONS):
        state = O.bodies[number].state
        turned = state.ori * turn.inverse()
        found.append((state.pos + turned * (Vector3(start) - place), turned * Quaternion(*q)))
    return found


def fail(message):
    """End with an error."""
    print("ERROR:", message)
    sys.stdout.flush()
    sys.exit(1)


def look():
    """Return energy, largest overlap and pairs that touch; end with an error where something is wrong."""
    states = [O.bodies[number].state for number in GRAINS]
    inside = [s for s in states if abs(s.pos[0]) < HALF and abs(s.pos[1]) < HALF and s.pos[2] > 0]
    if len(inside) != len(states):
        fail("%d of %d grains are lost." % (len(states) - len(inside), len(states)))
    kinetic = sum(0.5 * s.mass * s.vel.squaredNorm() for s in states)
    if not kinetic <= ENERGY:
        fail("there is more energy (%.3g J) than there was to fall: the time step is too long." % kinetic)
    deepest, pairs = 0.0, set()
    for contact in O.interactions:
        if not contact.isReal:
            continue
        deepest = max(deepest, contact.geom.penetrationDepth)
        first, second = O.bodies[contact.id1], O.bodies[contact.id2]
        owners = [body.clumpId if body.isClumpMember else body.id for body in (first, second)]
        if owners[0] in AMONG and owners[1] in AMONG and contact.geom.penetrationDepth > 0:
            pairs.add(tuple(sorted(owners)))
    if not deepest <= IMPACT:
        fail("grains overlap by %.3g m, more than they are designed to: %.3g m." % (deepest, IMPACT))
    return kinetic, deepest, pairs


AMONG = set(GRAINS)
for _ in range(20):
    O.run(STEPS // 20, True)
    kinetic, deepest, pairs = look()
    print("SETTLING", len(GRAINS), kinetic, deepest)
    sys.stdout.flush()

if deepest > REST:
    fail("at rest grains overlap by %.3g m, more than %.3g m: they are too soft." % (deepest, REST))
with open("settled.csv", "w", newline="") as stream:
    rows = csv.writer(stream)
    rows.writerow(["number", "avatar", "scale", "x_m", "y_m", "z_m", "qw", "qx", "qy", "qz"])
    for number, (p, q) in enumerate(poses()):
        name = KINDS[number % len(KINDS)][0].rpartition(".")[0]
        rows.writerow([number + 1, name, 1.0, p[0], p[1], p[2], q[3], q[0], q[1], q[2]])
O.save("settled.yade.gz")
# Of an even layer the centres lie, in the mean, at half its height.
height = 2 * sum(p[2] for p, _ in poses()) / len(GRAINS)
print(
    "SETTLED %d grains, porosity %.4g, height %.4g m, %.3g neighbours a grain,"
    " overlap %.3g m, kinetic energy %.3g J"
    % (
        len(GRAINS), 1 - SOLID / (4 * HALF * HALF * height), height, 2.0 * len(pairs) / len(GRAINS), deepest,
        kinetic,
    )
)
sys.stdout.flush()
'''


def write_script(
    job: Job,
    kinds: Sequence[tuple[str, float, list[float]]],
    loader: str,
    reach: float,
    smallest: float,
    *,
    spheres: int,
    level_set: bool = False,
) -> Mapping[str, Any]:
    """Write a script in SI units that runs as it is, from within its folder; return what it costs.

    Parameters
    ----------
    job : Job
    kinds : sequence of (file, mass, moments)
    loader : str
        Source of the function ``make(kind, position, orientation)``.
    reach : float
        Radius of the largest bounding sphere, in m.
    smallest : float
        Smallest radius of curvature that touches, in m.
    spheres : int
        Of each grain; what takes as long, for level sets.
    level_set : bool
        Whether the shapes are level sets and not spheres.

    Raises
    ------
    ExportError
        If it would take longer than the export allows.
    """
    density = float(job.density or 0.0)
    stack = stacked_grains(int(job.options["poured"]), len(kinds), reach)
    top, count = stack.top, len(stack.places)
    masses = np.array([mass for _, mass, _ in kinds])
    heaviest, lightest = float(masses.max()), float(masses.min())
    # Yade's normal stiffness of two equal spheres is young * radius.
    stiffness = heaviest * 2 * GRAVITY * top / (0.1 * smallest) ** 2
    step = float(f"{np.pi / np.sqrt(2 * stiffness / lightest) / 40:.3g}")
    steps = int(np.ceil(4 * np.sqrt(2 * top / GRAVITY) / step / 20) * 20)
    poured = masses[np.arange(count) % len(masses)]
    box = SettlingBox(
        count, reach, smallest, heaviest, float(poured.mean()), lightest, smallest / reach, stack.half, 0.0,
        top,
    )  # fmt: skip
    cost = DeckCost("Yade", steps, step, count * spheres)
    require_affordable(job, SCRIPT_NAME, cost, box)
    # A tenth of the smallest sphere is what the heaviest grain makes on the softest contact.
    bounds = bounds_of(box, 0.1 * smallest, density)
    name = "LevelSet" if level_set else "Sphere"
    geometry = [f"Ig2_{name}_{name}_ScGeom()", f"Ig2_Wall_{name}_ScGeom()"]
    text = _SCRIPT.format(
        told=cost.told,
        energy=bounds.energy,
        impact=bounds.impact,
        rest=bounds.rest,
        solid=float(poured.sum()) / density,
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
    (job.folder / SCRIPT_NAME).write_text(text, encoding="ascii")
    return cost.record()


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
