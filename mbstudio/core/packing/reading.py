"""Results of other engines come back: poses or dumped spheres become a packing of the avatars."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from mbstudio.core.dem.manifest import FILE_NAME, read_manifest
from mbstudio.core.errors import PackingError
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.packing.dumps import Frame, find_grains, find_poses, is_dump, read_last_frame
from mbstudio.core.packing.grain_kinds import GrainKinds, Progress, prepare_kinds
from mbstudio.core.packing.mould import Mould
from mbstudio.core.packing.packing import Packing
from mbstudio.core.packing.poses import Poses, read_poses
from mbstudio.core.units import METRES_PER_UNIT

_TOLERANCE = 1e-3  # of a sphere's place in its clump: dumps have six digits
_ROUNDED = 1e-5  # diameters: how far apart spheres may be and still touch, where places were rounded


def read_packing(
    path: str | Path,
    avatars: Sequence[Avatar],
    *,
    specimen: str | Path | None = None,
    names: Sequence[str] | None = None,
    mould: str = "box",
    width: float | None = None,
    spheres: int = 20,
    gap: float = _ROUNDED,
    progress: Progress | None = None,
) -> Packing:
    """Read what an engine has made of grains.

    Parameters
    ----------
    path : path
        A dump of LAMMPS or LIGGGHTS of grains that mbstudio exported (``id mol x y z radius`` of every
        sphere, as its decks write it; ``id x y z`` is enough for a specimen in LAMMPS), or a CSV table of
        poses: ``avatar, x, y, z, qw, qx, qy, qz`` and maybe ``scale``; ``settled.csv`` of Kratos, Yade and
        peclet-dem is one, in metres (``x_m``).
    avatars : sequence of Avatar
        Those that were exported, in the same order.
    specimen : path, optional
        ``specimen.csv`` of the export, with its manifest beside it; needed for a dump that does not lie
        beside its manifest or does not tell ``mol`` and ``radius``.
    names : sequence of str, optional
        Of the avatars in the table; by default as the export names them.
    mould : str
        Of a table without a specimen: ``box`` or ``cylinder``.
    width : float, optional
        Of that mould, in the unit of the first avatar; by default as far as the grains reach.
    spheres : int
        Of the clumps by which contacts are found; an export knows its own.
    gap : float
        How far apart spheres may be and count as touching, over the mean diameter: files are rounded.
    progress : callable(share, message), optional

    Raises
    ------
    PackingError
        If a file cannot be read, is cut off or of other grains, or has poses that are no rotations.
    """
    path = Path(path)
    table = Path(specimen) if specimen is not None else None
    manifest = _manifest_beside(table) if table is not None else None
    if manifest is None and is_dump(path) and (path.parent / FILE_NAME).is_file():
        manifest = read_manifest(path.parent)
    unit = avatars[0].unit if manifest is None else str(manifest["unit"])
    if manifest is not None:
        kinds = prepare_kinds(
            avatars, names, spheres=_spheres_of(manifest, len(avatars)), unit=unit, progress=progress
        )
    else:
        kinds = prepare_kinds(avatars, names, spheres=spheres, unit=unit, progress=progress)
    if is_dump(path):
        if manifest is None:
            raise PackingError(
                f"{path} is a dump of spheres: name the specimen.csv of its export (specimen)."
            )
        frame = read_last_frame(path)
        poses = _poses_of_dump(path, frame, kinds, table)
        engine = {"lammps": "LAMMPS", "liggghts": "LIGGGHTS"}.get(str(manifest["target"]), "")
        history: dict[str, Any] = {"read_from": str(path), "engine": engine, "steps": frame.step}
        if "specimen" not in manifest or path.name.startswith("settled."):
            width = 2 * frame.half / METRES_PER_UNIT[kinds.unit] if width is None else width
            manifest = None
    else:
        poses = read_poses(path, kinds.names, METRES_PER_UNIT[kinds.unit])
        history = {"read_from": str(path)}
    made = Packing(kinds, poses, _mould_of(kinds, poses, manifest, mould, width), history=history)
    return replace(made, gap=gap * made.mean_diameter)


def _manifest_beside(table: Path) -> Mapping[str, Any]:
    manifest = read_manifest(table.parent)
    if "specimen" not in manifest:
        raise PackingError(f"{table.parent / FILE_NAME} is of an export without a specimen.")
    return manifest


def _spheres_of(manifest: Mapping[str, Any], count: int) -> list[int]:
    items = manifest["items"]
    if len(items) != count:
        raise PackingError(f"The export is of other grains: it has {len(items)} avatars, here are {count}.")
    return [int(item["details"].get("spheres", 20)) for item in items]


def _poses_of_dump(path: Path, frame: Frame, kinds: GrainKinds, table: Path | None) -> Poses:
    """Return the poses of a dump by what it tells of every sphere, or by the specimen that it began with."""
    metres = METRES_PER_UNIT[kinds.unit]  # decks are in SI units
    if frame.owners is not None or table is None:
        clumps = [np.column_stack([clump.centers, clump.radii]) * metres for clump in kinds.clumps]
        found = find_grains(frame, clumps, _TOLERANCE, str(path))
        if table is not None and len(found.kinds) != len(start := read_poses(table, kinds.names)):
            raise PackingError(f"{path} has {len(found.kinds)} grains, the specimen {len(start)}.")
        return Poses(found.kinds, found.scales, found.positions / metres, _quaternions(found.rotations))
    start = read_poses(table, kinds.names)
    centers = [clump.centers * metres for clump in kinds.clumps]
    places, turns = find_poses(frame, centers, start.kinds, start.scales, _TOLERANCE, str(path))
    return Poses(start.kinds, start.scales, places / metres, _quaternions(turns))


def _quaternions(turns: Float[np.ndarray, "count 3 3"]) -> Float[np.ndarray, "count 4"]:
    from scipy.spatial.transform import Rotation

    quaternions: np.ndarray = Rotation.from_matrix(turns).as_quat()[:, [3, 0, 1, 2]]
    return quaternions


def _mould_of(
    kinds: GrainKinds, poses: Poses, manifest: Mapping[str, Any] | None, shape: str, width: float | None
) -> Mould:
    if manifest is not None:
        box = manifest["specimen"]["box"]
        return Mould("box", float(box["half_width"]), bool(box.get("periodic", False)))
    if width is not None:
        return Mould(shape, width / 2)
    unit = Mould(shape, 0.0)
    reach = 0.0
    for kind, scale, place, turn in zip(
        poses.kinds, poses.scales, poses.positions, poses.rotations, strict=True
    ):
        clump = kinds.clumps[kind]
        centers = scale * clump.centers @ turn.T + place
        outward = (-unit.wall_distance(centers[:, :2]) + scale * clump.radii).max()
        reach = max(reach, float(outward))
    if not np.isfinite(reach) or reach <= 0:
        raise PackingError("The grains have no extent: give the width of the mould.")
    return Mould(shape, reach)
