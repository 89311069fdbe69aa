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
from mbstudio.core.dem.specimen.deck_cost import ENERGY_MARGIN
from mbstudio.core.dem.specimen.settling import GRAVITY, stacked_grains
from mbstudio.core.dem.target import Job, Target, Written
from mbstudio.core.errors import ExportError
from mbstudio.core.units import METRES_PER_UNIT

SCRIPT_NAME = "settle.py"

_SCRIPT = '''"""Let the grains fall into a box. Run within this folder: python settle.py

It writes settled.csv: where every grain came to rest and how it is turned (m, quaternion w x y z), for
'mbstudio packing read'. The last line that it prints begins with SETTLED.
It ends with an error if a grain is lost, more energy is there than there was to fall, or grains lie deeper in
each other than a cell of their grids.
"""

import csv
import sys

import numpy as np
from peclet import dem

FILES = {files}
UNIT = "{unit}"
HALF, TOP, SPEED = {half:.9g}, {top:.9g}, {speed:.9g}  # the box and the fastest fall, in UNIT and UNIT/s
GRAVITY = {gravity:.9g}  # UNIT/s2
STEP, STEPS = {step:.6g}, {steps}
ENERGY = {energy:.6g}  # kg UNIT2/s2, all that there is to fall
CELL, METRES, SOLID = {cell:.6g}, {metres:g}, {solid:.9g}  # of the grids, of UNIT, volume of all grains
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


def look(sim, kinds):
    """Return positions, energy and largest overlap; end with an error where something is wrong."""
    positions = sim.get_positions()
    inside = (np.abs(positions[:, :2]) < HALF).all(axis=1) & (positions[:, 2] > 0)
    lost = len(POSITIONS) - int(inside.sum())
    if lost:
        sys.exit(f"{{lost}} of {{len(POSITIONS)}} grains are lost.")
    found, deepest = energy(sim, kinds), float(sim.compute_overlaps())
    if not found <= ENERGY:
        sys.exit(f"There is more energy than there was to fall: {{found:.3g}}, not {{ENERGY:.3g}}.")
    if not deepest <= CELL:
        sys.exit(f"Grains overlap by {{deepest:.3g}} {{UNIT}}, more than a cell of their grids.")
    return positions, found, deepest


def save(positions, turns, kinds):
    """Write where every grain came to rest."""
    with open("settled.csv", "w", newline="") as stream:
        rows = csv.writer(stream)
        rows.writerow(["number", "avatar", "scale", "x_m", "y_m", "z_m", "qw", "qx", "qy", "qz"])
        for number, (kind, place, (x, y, z, w)) in enumerate(zip(kinds, positions, turns), start=1):
            rows.writerow([number, FILES[kind][:-4], 1.0, *(METRES * place.astype(float)), w, x, y, z])


if __name__ == "__main__":
    sim, kinds = make()
    for _ in range(20):
        sim.step(STEPS // 20)
        positions, found, deepest = look(sim, kinds)
        print("SETTLING", len(positions), found, float(positions[:, 2].max()), deepest, flush=True)
    save(positions, sim.get_quaternions(), kinds)
    # Of an even layer the centres lie, in the mean, at half its height.
    height = 2 * float(positions[:, 2].mean())
    porosity = 1 - SOLID / (4 * HALF * HALF * height)
    print(
        f"SETTLED {{len(positions)}} grains, porosity {{porosity:.4g}}, height {{height * METRES:.4g}} m,"
        f" {{2 * sim.num_manifolds / len(positions):.3g}} contacts a grain,"
        f" overlap {{deepest * METRES:.3g}} m,"
        f" kinetic energy {{found * METRES**2:.3g}} J",
        flush=True,
    )
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
    kinds = np.arange(len(stack.places)) % len(job.bodies)
    masses = np.array([body.mass.mass for body in job.bodies])
    volumes = np.array([body.mass.volume for body in job.bodies])
    return _SCRIPT.format(
        energy=ENERGY_MARGIN * float(masses[kinds].sum()) * gravity * top,
        cell=spacing,
        metres=METRES_PER_UNIT[job.unit],
        solid=float(volumes[kinds].sum()),
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
    same = _SCRIPT[_SCRIPT.index("def load(sim)") :].replace("{{", "{").replace("}}", "}")
    if not read_text(folder / SCRIPT_NAME).endswith(same):
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
