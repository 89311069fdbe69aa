"""The example deck of a DEM-Engine export: some of each clump fall into a box."""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mbstudio.core.dem.reading_back import read_text
from mbstudio.core.dem.shapes.clump import Clump
from mbstudio.core.dem.specimen.pouring import (
    NOT_RUN,
    check_count,
    check_pouring,
    extent_of,
    hertz_young,
    plan_pouring,
)
from mbstudio.core.dem.specimen.settling import POISSON
from mbstudio.core.dem.target import Job
from mbstudio.core.errors import ExportError

DECK_NAME = "settle.py"

_SCRIPT = '''"""Let the grains fall into a box. On a machine with a CUDA device, anywhere: python settle.py

{not_run}
"""

from load_clumps import load

# SI units. STIFFNESS is what YOUNG means for the smallest sphere; STEP is a 30th of the shortest contact.
DENSITY = {density:.9g}
GRAVITY = {gravity:.9g}
STIFFNESS = {stiffness:.6g}
YOUNG = {young:.6g}
STEP = {step:.6g}
HALF, TOP, SPEED, SECONDS = {half:.9g}, {top:.9g}, {speed:.6g}, {seconds:.6g}
POSITIONS = {positions}
QUATERNIONS = {quaternions}  # x, y, z, w


def make(engine):
    """Return a simulation with every grain in its place."""
    solver = engine.DEMSolver()
    grain = solver.LoadMaterial({{"E": YOUNG, "nu": {poisson}, "CoR": 0.3, "mu": 0.5, "Crr": 0.0}})
    solver.InstructBoxDomainDimension((-HALF, HALF), (-HALF, HALF), (0.0, 1.4 * TOP))
    solver.InstructBoxDomainBoundingBC("top_open", grain)
    kinds = list(load(solver, grain).values())
    grains = solver.AddClumps([kinds[i % len(kinds)] for i in range(len(POSITIONS))], POSITIONS)
    grains.SetOriQ(QUATERNIONS)
    solver.SetInitTimeStep(STEP)
    solver.SetGravitationalAcceleration([0.0, 0.0, -GRAVITY])
    solver.SetMaxVelocity(2.0 * SPEED)
    solver.SetErrorOutVelocity(10.0 * SPEED)
    return solver


def main():
    """Run until the grains are at rest, and tell their energy."""
    try:
        import DEME as engine
    except ImportError:
        import deme as engine  # its name in later versions
    solver = make(engine)
    energy, lowest, highest = (
        solver.CreateInspector(name) for name in ("clump_kinetic_energy", "clump_min_z", "clump_max_z")
    )
    solver.Initialize()
    for _ in range(20):
        solver.DoDynamicsThenSync(SECONDS / 20)
        told = [inspector.GetValue() for inspector in (energy, lowest, highest)]
        print("SETTLING", len(POSITIONS), *told, flush=True)


if __name__ == "__main__":
    main()
'''


def settling_deck(job: Job, clumps: Sequence[Clump]) -> str:
    """Return a script in SI units for the Python module of DEM-Engine.

    Its contacts are Hertz's; Young's modulus is such that the stiffness at an overlap of a tenth of the
    smallest sphere is that of :func:`~mbstudio.core.dem.specimen.settling.spring_contact`.
    """
    reach, smallest = extent_of(clumps)
    plan = plan_pouring(job, reach, smallest)
    return _SCRIPT.format(
        not_run=NOT_RUN,
        density=plan.density,
        gravity=plan.gravity,
        stiffness=plan.contact.stiffness,
        young=hertz_young(plan.contact.stiffness, smallest),
        step=plan.contact.step,
        half=plan.stack.half,
        top=plan.stack.top,
        speed=plan.speed,
        seconds=plan.seconds,
        poisson=POISSON,
        positions=repr([[float(f"{value:.9g}") for value in row] for row in plan.stack.places]),
        quaternions=repr(
            [[float(f"{value:.9g}") for value in row] for row in plan.stack.quaternions[:, [1, 2, 3, 0]]]
        ),
    )


def check_deck(path: Path, manifest: Mapping[str, Any]) -> None:
    """Raise ExportError unless a script places as many grains as the manifest says, with its numbers.

    Raises
    ------
    ExportError
        If the script cannot be read, has another number of grains, places or turns that cannot be, or another
        density, gravity or a longer time step.
    """
    text = read_text(path)
    try:
        stated = {
            node.targets[0].id: node.value
            for node in ast.parse(text).body
            if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name)
        }
        places = np.array(ast.literal_eval(stated["POSITIONS"]), dtype=float).reshape(-1, 3)
        turns = np.array(ast.literal_eval(stated["QUATERNIONS"]), dtype=float).reshape(-1, 4)
    except (SyntaxError, ValueError, KeyError) as error:
        raise ExportError(f"{path} is not a script with positions and rotations ({error!r}).") from error
    check_count(path, len(places), manifest)
    check_count(path, len(turns), manifest)
    if not np.isfinite(places).all() or not np.allclose(np.linalg.norm(turns, axis=1), 1.0, atol=1e-6):
        raise ExportError(f"{path} has places that are not finite, or quaternions that are not of length 1.")
    if "from load_clumps import load\n" not in text:
        raise ExportError(f"{path} does not load the clumps beside it.")
    check_pouring(path, text, manifest)
