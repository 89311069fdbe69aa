"""Yade level sets: a padded signed-distance grid of each avatar, and a script.

The grids are those of :mod:`mbstudio.core.dem.formats.level_set_files`; Yade has no file format for them, so
``settle.py`` hands the values to ``levelSetBody``. Yade takes a cropped grid as a smaller grain, crashes
on one of another size, and goes on where the axes are not principal: all three are refused here.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from mbstudio.core.dem.formats.clump_files import POURED
from mbstudio.core.dem.formats.level_set_files import OPTIONS, check_level_set_file, write_level_sets
from mbstudio.core.dem.formats.yade.script import SCRIPT_NAME, check_kinds, write_script
from mbstudio.core.dem.formats.yade.target import kinds_of
from mbstudio.core.dem.specimen.deck_cost import HOURS
from mbstudio.core.dem.target import Job, Target, Written
from mbstudio.core.options import Option

_LOADER = '''
def make(kind, position, orientation):
    """Make one grain of a kind; return its id."""
    name, mass, moments = KINDS[kind]
    shape = np.load(name)
    grid = RegularGrid(
        min=Vector3([float(v) for v in shape["origin"]]), nGP=shape["grid"].shape,
        spacing=float(shape["spacing"]),
    )
    body = levelSetBody(
        grid=grid, distField=shape["grid"].astype(float).tolist(), nSurfNodes={nodes}, nodesPath=1,
        material="grain",
    )
    body.state.pos, body.state.ori = Vector3(position), Quaternion(*orientation)
    body.state.mass, body.state.inertia = mass, Vector3(moments)
    return O.bodies.append(body)
'''


def write(job: Job) -> Written:
    """Write a grid file for each body, and one script for all."""
    written = write_level_sets(job)
    names = [files[0] for files in written.item_files]
    reach = max(details["radius"] for details in written.item_details)
    # What a level set touches by is not known: a quarter of the bounding sphere stands for it.
    cost = write_script(
        job,
        kinds_of(names, job.bodies),
        _LOADER.replace("{nodes}", str(job.options["nodes"])),
        reach,
        reach / 4,
        spheres=int(job.options["nodes"]) // 10,
        level_set=True,
    )
    return Written(written.item_files, written.item_details, (SCRIPT_NAME,), {SCRIPT_NAME: cost})


def validate(folder: Path, manifest: Mapping[str, Any]) -> None:
    """Read grids and script back and compare them with the manifest."""
    for item in manifest["items"]:
        check_level_set_file(folder / item["files"][0], item, manifest["unit"])
    check_kinds(folder / SCRIPT_NAME, manifest)


TARGET = Target(
    name="yade-level-set",
    title="Yade level sets",
    geometry="grid",
    needs_density=True,
    default_unit="m",
    write=write,
    validate=validate,
    options=MappingProxyType(
        {
            **OPTIONS,
            "nodes": Option(402, "surface nodes by which each grain touches", 50, 20000),
            "poured": POURED,
            "hours": HOURS,
        }
    ),
    units=("m",),
)
