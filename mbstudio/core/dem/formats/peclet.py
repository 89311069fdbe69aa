"""peclet-dem shapes: a padded signed-distance grid and contact points of each avatar, and a script.

The grids are those of :mod:`mbstudio.core.dem.formats.level_set_files`; ``settle.py`` reads them and lets
some of each fall into a box, with each particle's own mass and moments.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from mbstudio.core.dem.formats.clump_files import POURED
from mbstudio.core.dem.formats.level_set_files import OPTIONS, check_level_set_file, write_level_sets
from mbstudio.core.dem.reading_back import read_text
from mbstudio.core.dem.specimen.settling import GRAVITY, stacked_grains
from mbstudio.core.dem.target import Job, Target, Written
from mbstudio.core.errors import ExportError
from mbstudio.core.units import METRES_PER_UNIT

SCRIPT_NAME = "settle.py"

_SCRIPT = '''"""Let the grains fall into a box. Run within this folder: python settle.py"""

import numpy as np
from peclet import dem

FILES = {files}
UNIT = "{unit}"
HALF, TOP, SPEED = {half:.9g}, {top:.9g}, {speed:.9g}  # the box and the fastest fall, in UNIT and UNIT/s
GRAVITY = {gravity:.9g}  # UNIT/s2
STEP, STEPS = {step:.6g}, {steps}
POSITIONS = np.array({positions})
QUATERNIONS = np.array({quaternions})  # w, x, y, z


def load(sim):
    """Register every grid; return mass and moments of each."""
    masses, moments = [], []
    for number, name in enumerate(FILES):
        with np.load(name) as shape:
            unit_inertia = tuple(float(v) for v in shape["mass"] / shape["moments"])
            register = sim.set_sdf_shape if number == 0 else sim.add_sdf_shape
            register(
                np.asfortranarray(shape["grid"]), tuple(map(float, shape["origin"])),
                (float(shape["spacing"]),) * 3, np.ascontiguousarray(shape["shell"]),
                unit_inertia, float(shape["radius"]),
            )
            masses.append(float(shape["mass"]))
            moments.append(np.array(shape["moments"]))
    return np.array(masses), np.array(moments)


def make():
    """Return a simulation with every particle in its place, and each particle's kind."""
    sim = dem.Simulation(capacity=4 * len(POSITIONS) + 64)
    masses, moments = load(sim)
    sim.set_global_scale(1.0)
    sim.set_domain(
        extent=(2 * HALF, 2 * HALF, 1.5 * TOP), origin=(-HALF, -HALF, 0.0), periodic=(False, False, False)
    )
    sim.add_plane(point=(0, 0, 0), normal=(0, 0, 1))
    for axis, sign in ((0, 1), (0, -1), (1, 1), (1, -1)):
        point, normal = [0.0] * 3, [0.0] * 3
        point[axis], normal[axis] = -sign * HALF, float(sign)
        sim.add_plane(point=point, normal=normal)
    kinds = np.arange(len(POSITIONS)) % len(FILES)
    sim.set_positions(np.ascontiguousarray(POSITIONS, dtype=np.float32))
    sim.set_shape_ids(kinds.astype(np.int32))  # after set_positions, which resets the shapes
    sim.set_quaternions(np.ascontiguousarray(QUATERNIONS[:, [1, 2, 3, 0]], dtype=np.float32))
    sim.set_inv_mass((1.0 / masses[kinds]).astype(np.float32))
    sim.set_inv_inertia(np.ascontiguousarray(1.0 / moments[kinds], dtype=np.float32))
    sim.set_gravity((0.0, 0.0, -GRAVITY))
    sim.set_material_params(restitution_normal=0.2, friction=0.5)
    sim.set_solver_iterations(pos=10, vel=8)
    sim.set_dt(STEP)
    return sim, kinds


def energy(sim, kinds):
    """Return the kinetic energy of translation, in kg UNIT2/s2."""
    masses = np.array([float(np.load(name)["mass"]) for name in FILES])
    return float(0.5 * (masses[kinds] * (sim.get_velocities() ** 2).sum(axis=1)).sum())


if __name__ == "__main__":
    sim, kinds = make()
    for _ in range(20):
        sim.step(STEPS // 20)
        positions = sim.get_positions()
        inside = (np.abs(positions[:, :2]) < HALF).all(axis=1) & (positions[:, 2] > 0)
        print("SETTLING", int(inside.sum()), energy(sim, kinds), float(positions[:, 2].max()), flush=True)
'''


def write(job: Job) -> Written:
    """Write a grid file for each body, and one script for all."""
    written = write_level_sets(job)
    reach = max(details["radius"] for details in written.item_details)
    (job.folder / SCRIPT_NAME).write_text(_script(job, written, reach), encoding="ascii")
    return Written(written.item_files, written.item_details, (SCRIPT_NAME,))


def _script(job: Job, written: Written, reach: float) -> str:
    stack = stacked_grains(int(job.options["poured"]), len(job.bodies), reach)
    top = stack.top
    gravity = GRAVITY / METRES_PER_UNIT[job.unit]
    speed = float(np.sqrt(2 * gravity * top))
    spacing = min(details["spacing"] for details in written.item_details)
    # No grain may fall further than half a grid cell in one step.
    step = float(f"{0.5 * spacing / speed:.3g}")
    steps = int(np.ceil(4 * np.sqrt(2 * top / gravity) / step / 20) * 20)
    return _SCRIPT.format(
        files=repr([files[0] for files in written.item_files]),
        unit=job.unit,
        half=stack.half,
        top=top,
        speed=speed,
        gravity=gravity,
        step=step,
        steps=steps,
        positions=np.array2string(stack.places, precision=9, separator=", ", threshold=10**9),
        quaternions=np.array2string(stack.quaternions, precision=9, separator=", ", threshold=10**9),
    )


def validate(folder: Path, manifest: Mapping[str, Any]) -> None:
    """Read grids and script back and compare them with the manifest."""
    for item in manifest["items"]:
        check_level_set_file(folder / item["files"][0], item, manifest["unit"])
    stated = repr([item["files"][0] for item in manifest["items"]])
    if f"FILES = {stated}\n" not in read_text(folder / SCRIPT_NAME):
        raise ExportError(f"{folder / SCRIPT_NAME} does not load the grids of the manifest.")
    if not read_text(folder / SCRIPT_NAME).endswith(_SCRIPT[_SCRIPT.index("def load(sim)") :]):
        raise ExportError(f"{folder / SCRIPT_NAME} is cut off, or not the script that mbstudio writes.")


TARGET = Target(
    name="peclet",
    title="peclet-dem level sets",
    geometry="grid",
    needs_density=True,
    default_unit="mm",
    write=write,
    validate=validate,
    options=MappingProxyType({**OPTIONS, "poured": POURED}),
)
