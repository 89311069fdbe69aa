"""Closed bodies of mesh files: what `fit`, `measure` and `learn` take from a file, with the same words."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from jaxtyping import Bool, Int

from mbstudio.core.counting import counted
from mbstudio.core.errors import GrainWarning, MeshError
from mbstudio.core.meshes.closing import Shell, closed_shells
from mbstudio.core.meshes.edges import weld_equal
from mbstudio.core.meshes.rays import inside, place_in
from mbstudio.core.meshes.reading import read_mesh_data
from mbstudio.core.units import METRES_PER_UNIT, parse_unit, unit_label

if TYPE_CHECKING:
    import trimesh

Cavities = Literal["fill", "keep"]
OnFailure = Callable[[Path, MeshError], None]

_SPECK = 1e-6
"""Share of the largest body's volume below which a piece is a speck and no grain."""
_SAMPLE = 61
_OVERLAP = 0.05
_BELOW = 1e-3
"""How far below a face, as a share of its width, it is asked whether another shell holds it."""
_SIZES = (1e-8, 10.0)
"""Lengths of bodies in metres, from 10 nm to 10 m, that are not asked about."""


def read_bodies(
    path: str | Path,
    unit: str | None = None,
    cavities: Cavities = "fill",
    *,
    assumed_unit: str | None = None,
) -> list[trimesh.Trimesh]:
    """Return the closed bodies of a mesh file, in the order of the file.

    Parameters
    ----------
    path : str or Path
        STL, PLY, OBJ, OFF, 3MF, GLB or glTF.
    unit : str, optional
        Length unit of the coordinates; 3MF and glTF know theirs.
    cavities : {"fill", "keep"}
        What to do with voids that a body encloses: no metaball has them unless asked.
    assumed_unit : str, optional
        Unit of the coordinates of a file that does not know its own, if no `unit` is given.

    Returns
    -------
    list of trimesh.Trimesh
        Each closed and wound outwards, with its name in ``metadata["name"]`` (``stone``, or ``stone#1``,
        ``stone#2`` where a file holds several), its file in ``metadata["path"]`` and its unit in ``units``,
        if one is known.

    Raises
    ------
    MeshError
        If the file cannot be read, or its surface is not closed: the message says where the hole is.
    UnitError
        If the unit is not known.

    Warns
    -----
    GrainWarning
        About everything that was mended, filled or left out, and sizes that are hard to believe.
    """
    path = Path(path)
    data = read_mesh_data(path)
    notes = list(data.notes)
    stated = parse_unit(unit) if unit else None
    if stated and data.unit and stated != data.unit:
        notes.append(
            f"is in {unit_label(data.unit)} by its format, but was read in {unit_label(stated)} as asked"
        )
    try:
        bodies = separate_bodies(
            data.vertices, data.faces, str(path), parts=data.parts, cavities=cavities, notes=notes
        )
    except MeshError as error:
        told = "".join(f" The file {note}." for note in data.notes)
        raise MeshError(f"{error}{told}") from error
    for note in notes:
        warnings.warn(f"{path} {note}.", GrainWarning, stacklevel=2)
    for number, body in enumerate(bodies, start=1):
        name = path.stem if len(bodies) == 1 else f"{path.stem}#{number}"
        body.metadata["name"] = name
        body.metadata["file_name"] = path.name if len(bodies) == 1 else f"{path.name}#{number}"
        body.metadata["path"] = str(path.absolute())
        carried = stated or data.unit or (parse_unit(assumed_unit) if assumed_unit else None)
        if carried:
            body.units = carried
            question_size(float(np.ptp(body.vertices, axis=0).max()), carried, str(path))
    return bodies


def bodies_of(
    paths: Sequence[str | Path],
    unit: str | None = None,
    cavities: Cavities = "fill",
    on_failure: OnFailure | None = None,
    *,
    assumed_unit: str | None = None,
    on_read: Callable[[int, Path], None] | None = None,
    most: int | None = None,
) -> list[trimesh.Trimesh]:
    """Return the closed bodies of mesh files; see `read_bodies`.

    Parameters
    ----------
    on_failure : callable, optional
        ``on_failure(path, error)`` takes the errors of single files, which are left out; without it, or if
        all files fail, the error is raised.
    assumed_unit : str, optional
        As for `read_bodies`.
    on_read : callable, optional
        ``on_read(done, path)`` before each file, with how many are done; what it raises ends the work.
    most : int, optional
        Of so many bodies the first are returned, and further files not read.
    """
    bodies: list[trimesh.Trimesh] = []
    last: MeshError | None = None
    for done, path in enumerate(paths):
        if most is not None and len(bodies) >= most:
            break
        if on_read is not None:
            on_read(done, Path(path))
        try:
            bodies += read_bodies(path, unit, cavities, assumed_unit=assumed_unit)
        except MeshError as error:
            if on_failure is None:
                raise
            on_failure(Path(path), error)
            last = error
    if not bodies and last is not None:
        raise MeshError(f"None of {counted(len(paths), 'file')} could be read; the last: {last}") from last
    return bodies[:most]


def question_size(length: float, unit: str, source: str) -> None:
    """Warn about a body that is smaller than 10 nm or larger than 10 m."""
    metres = length * METRES_PER_UNIT[unit]
    if not _SIZES[0] <= metres <= _SIZES[1]:
        warnings.warn(
            f"{source} is {length:.3g} {unit_label(unit)} long, too short or too long for a grain: check "
            "the unit of its coordinates.",
            GrainWarning,
            stacklevel=3,
        )


def closed_body(mesh: trimesh.Trimesh, source: str, cavities: Cavities = "keep") -> trimesh.Trimesh:
    """Return a mesh as one closed body wound outwards.

    Raises
    ------
    MeshError
        If it is not closed, or holds several bodies.
    """
    import trimesh

    if isinstance(mesh, trimesh.Scene):  # what trimesh makes of files with several objects
        mesh = mesh.to_mesh()
    if not isinstance(mesh, trimesh.Trimesh):
        raise MeshError(f"{source} is a {type(mesh).__name__}, not a triangle mesh: give a trimesh.Trimesh.")
    notes: list[str] = []
    bodies = separate_bodies(
        np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64), source,
        cavities=cavities, notes=notes,
    )  # fmt: skip
    if len(bodies) > 1:
        raise several_bodies(source, len(bodies))
    for note in notes:
        warnings.warn(f"{source} {note}.", GrainWarning, stacklevel=2)
    body = bodies[0]
    body.metadata.update(mesh.metadata)
    return body


def several_bodies(source: str, count: int) -> MeshError:
    """Return the refusal of a file where one body is wanted."""
    return MeshError(
        f"{source} contains {count} separate bodies: make each a grain with Grain.from_meshes or "
        "on the command line, or save each as its own file."
    )


def separate_bodies(
    vertices: np.ndarray, faces: np.ndarray, source: str, *, parts: np.ndarray | None = None,
    cavities: Cavities = "fill", notes: list[str] | None = None,
) -> list[trimesh.Trimesh]:  # fmt: skip
    """Return the closed bodies of triangles; see `read_bodies`. What was mended is added to `notes`."""
    if cavities not in ("fill", "keep"):
        raise ValueError(f"cavities='{cavities}' is not known: use 'fill' or 'keep'.")
    notes = [] if notes is None else notes
    if not len(faces):
        raise MeshError(f"{source} has no faces, so it is not a surface.")
    shells = closed_shells(vertices, faces, parts, source, notes)
    shells = _without_specks(shells, notes)
    holders = _nesting(shells, source, notes)
    depth = holders.sum(axis=1)
    if cavities == "fill":
        _tell_filled(shells, depth, notes)
    solid = np.flatnonzero(depth % 2 == 0 if cavities == "keep" else depth == 0)
    # Solids that touch, and lie equally deep, are one body.
    keys = dict.fromkeys((shells[place].group, int(depth[place])) for place in solid)
    bodies = []
    for key in keys:
        own = [int(place) for place in solid if (shells[place].group, int(depth[place])) == key]
        within = np.flatnonzero(holders[:, own].any(axis=1) & (depth == key[1] + 1))
        voids = [shells[place] for place in within]
        bodies.append(_joined([shells[place] for place in own], voids if cavities == "keep" else []))
        bodies[-1].metadata["filled_volume"] = 0.0 if cavities == "keep" else sum(v.volume for v in voids)
    return bodies


def _joined(solids: Sequence[Shell], voids: Sequence[Shell]) -> trimesh.Trimesh:
    """Return shells as one mesh, corners of solids that touch joined, voids wound inwards."""
    import trimesh

    points, rows, count = [], [], 0
    for shell in solids:
        points.append(shell.points)
        rows.append(shell.faces + count)
        count += len(shell.points)
    for void in voids:
        points.append(void.points)
        rows.append(void.faces[:, ::-1] + count)
        count += len(void.points)
    vertices, faces = np.concatenate(points), np.concatenate(rows)
    if len(solids) + len(voids) > 1:
        vertices, faces = weld_equal(vertices, faces)
    return trimesh.Trimesh(vertices, faces, process=False, validate=False)


def _without_specks(shells: list[Shell], notes: list[str]) -> list[Shell]:
    largest = max(shell.volume for shell in shells)
    kept = [shell for shell in shells if shell.volume > _SPECK * largest]
    if len(kept) < len(shells):
        notes.append(
            f"contains {len(shells) - len(kept)} specks of less than a millionth of its largest body's "
            "volume, which were left out"
        )
    return kept


def _tell_filled(shells: list[Shell], depth: Int[np.ndarray, " n"], notes: list[str]) -> None:
    voids = [shell.volume for shell, level in zip(shells, depth, strict=True) if level == 1]
    if not voids:
        return
    outer = [shell.volume for shell, level in zip(shells, depth, strict=True) if level == 0]
    inner = int(np.count_nonzero((depth > 0) & (depth % 2 == 0)))
    told = f", with {inner} bodies inside" if inner else ""
    several = len(voids) > 1
    notes.append(
        f"has {len(voids)} enclosed cavit{'ies' if several else 'y'} ({sum(voids) / sum(outer):.2%} of its "
        f"volume{told}), which {'were' if several else 'was'} filled; pass cavities='keep' (--cavities keep) "
        f"to keep {'them' if several else 'it'}"
    )


def _nesting(shells: list[Shell], source: str, notes: list[str]) -> Bool[np.ndarray, "n n"]:
    """Return which shell (row) lies within which (column); shells that cross are told or refused."""
    count = len(shells)
    holders = np.zeros((count, count), bool)
    low = np.array([shell.points.min(axis=0) for shell in shells])
    high = np.array([shell.points.max(axis=0) for shell in shells])
    meet = np.ones((count, count), bool)
    for axis in range(3):
        meet &= (low[:, None, axis] < high[None, :, axis]) & (high[:, None, axis] > low[None, :, axis])
    crossing = 0
    for one, other in np.argwhere(meet):
        if one == other or shells[one].volume > shells[other].volume:
            continue
        if one > other and shells[one].volume == shells[other].volume:
            continue
        within = _share_within(shells[one], shells[other])
        if within > 1 - _OVERLAP:
            holders[one, other] = True
            continue
        overlap = max(within, _share_within(shells[other], shells[one]))
        if overlap > _OVERLAP:
            raise MeshError(
                f"{source} contains bodies that overlap ({overlap:.0%} of one's surface lies within "
                "another), so that its volume is not that of its parts: unite them if they are one grain, "
                "in MeshLab with Filters > Remeshing > Mesh Boolean: Union, or move them apart."
            )
        crossing += overlap > 0
    if crossing:
        notes.append(f"contains {crossing} pairs of bodies that overlap slightly; each was taken as it is")
    return holders


def _share_within(shell: Shell, other: Shell) -> float:
    """Return the share of places just below the surface of a shell that lie within another."""
    rows = np.unique(np.linspace(0, len(shell.faces) - 1, _SAMPLE).astype(int))
    a, b, c = (shell.points[shell.faces[rows, corner]] for corner in range(3))
    normal = np.cross(b - a, c - a)  # its length is twice the area
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    below = _BELOW * normal / np.sqrt(np.where(length > 0, length, 1.0))
    return float(inside(place_in(shell.points, shell.faces[rows]) - below, other.points, other.faces).mean())
