"""From triangles to closed surfaces: seams welded, copies dropped, winding mended, holes told.

No length is compared with a fixed number: what is close is close for the size of the body.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from mbstudio.core.errors import MeshError
from mbstudio.core.meshes.edges import (
    EdgeTable,
    Faces,
    Points,
    pieces_of,
    sheets_of,
    signed_volume,
    weld_equal,
    with_three_corners,
)
from mbstudio.core.meshes.rays import looks_outward

_ROUNDING = 4 * float(np.finfo(np.float32).eps)
"""Share of the largest coordinate by which single precision moves the two sides of a seam apart."""
_SEAMS = (1e-6, 1e-5)
"""Widths of seams that are sewn, as shares of the body's size."""
_PLANE = 1e-9
"""Thickness of what is a plane but for rounding, as a share of its length."""
_LARGEST = 1e50
"""Largest coordinate: the cubes of larger ones leave the range of numbers."""
_FLAT = 1e-12
"""Volume of what encloses nothing but rounding, as a share of its bounding cube."""


@dataclass(frozen=True, eq=False)
class Shell:
    """One closed sheet of surface, wound outwards.

    Attributes
    ----------
    points : float array, shape (v, 3)
    faces : int array, shape (f, 3)
    volume : float
        That it encloses, positive.
    group : int
        Shells of one number touch each other in edges or corners.
    """

    points: Points
    faces: Faces
    volume: float
    group: int


def closed_shells(
    points: Points, faces: Faces, parts: Int[np.ndarray, " f"] | None, source: str, notes: list[str]
) -> list[Shell]:
    """Return the closed sheets of a triangle soup.

    Parameters
    ----------
    parts : int array, shape (f,), optional
        Objects that the file tells apart: pieces of their own where each is closed in itself, patches of
        one surface otherwise.
    notes : list of str
        Takes what was mended, as phrases that continue "the file ...".

    Raises
    ------
    MeshError
        If a vertex that a face uses is not finite, the surface has holes, is one-sided, or encloses nothing.
    """
    corners = points[faces.ravel()]
    if not np.isfinite(corners).all():
        wrong = int(np.count_nonzero(~np.isfinite(corners).all(axis=1).reshape(-1, 3).all(axis=1)))
        raise MeshError(f"{source} has {wrong} triangles with vertices that are not finite: export it again.")
    if np.abs(corners).max() > _LARGEST:
        raise MeshError(
            f"{source} has coordinates of {np.abs(corners).max():.2g}, which are not lengths: export it "
            "again."
        )
    soups = [weld_equal(points, faces)]
    if parts is not None and len(np.unique(parts)) > 1:
        told_apart = [weld_equal(points, faces[parts == part]) for part in np.unique(parts)]
        if all(_is_closed(kept[with_three_corners(kept)]) for _, kept in told_apart):
            soups = told_apart
    shells: list[Shell] = []
    flat = 0
    for soup in soups:
        found, left_out = _shells_of(*soup, source, notes, len(shells))
        shells += found
        flat += left_out
    if not shells:
        raise MeshError(
            f"{source} encloses no volume: its triangles are degenerate or lie flat on each other; "
            "check that they form one closed body."
        )
    if flat:
        notes.append(f"contains {flat} flat pieces without volume, which were left out")
    return shells


def _is_closed(faces: Faces) -> bool:
    return not len(faces) or EdgeTable.from_faces(_without_copies(faces)).is_closed


def _shells_of(
    points: Points, faces: Faces, source: str, notes: list[str], first_group: int
) -> tuple[list[Shell], int]:
    """Return the closed sheets of welded faces, and how many flat pieces were left out."""
    faces = faces[with_three_corners(faces)]
    if not len(faces):
        return [], 0
    groups = _pieces(points, faces)
    if not all(EdgeTable.from_faces(group).is_closed for group in groups):
        points, faces = _sew(points, np.concatenate(groups), notes)
        groups = _pieces(points, faces)
        _require_closed(points, groups, source)
    found: list[Shell] = []
    flat = 0
    for number, group in enumerate(groups, start=first_group):
        sheets = _shells_of_piece(points, group, source, number)
        found += sheets
        flat += not sheets
    return found, flat


def _pieces(points: Points, faces: Faces) -> list[Faces]:
    """Return the pieces that common vertices join, each without copies of faces."""
    piece = pieces_of(faces, len(points))
    order = np.argsort(piece, kind="stable")
    return [_without_copies(group) for group in np.split(faces[order], np.cumsum(np.bincount(piece))[:-1])]


def _without_copies(faces: Faces) -> Faces:
    """Keep one of each set of equal faces; walls between closed cells, whose rims would stay odd, go."""
    count = int(faces.max()) + 1
    low, middle, high = np.sort(faces, axis=1).T
    _, pair = np.unique(low * count + middle, return_inverse=True)  # two numbers at a time fit in one
    _, first, uses = np.unique(pair.ravel() * count + high, return_index=True, return_counts=True)
    if len(first) == len(faces):
        return faces
    once: np.ndarray = faces[np.sort(first)]
    without_walls: np.ndarray = faces[np.sort(first[uses % 2 == 1])]
    if not len(without_walls) or len(EdgeTable.from_faces(once).open_edges) <= len(
        EdgeTable.from_faces(without_walls).open_edges
    ):
        return once
    return without_walls


def _sew(points: Points, faces: Faces, notes: list[str]) -> tuple[Points, Faces]:
    """Join corners on open edges that lie as close as rounding leaves them, if that closes all holes."""
    size = float(np.linalg.norm(np.ptp(points, axis=0)))
    for reach in (_ROUNDING * float(np.abs(points).max()), *(share * size for share in _SEAMS)):
        if not 0 < reach <= 1e-3 * size:
            continue
        rim = np.unique(EdgeTable.from_faces(faces).open_edges)
        pairs = cKDTree(points[rim]).query_pairs(reach, output_type="ndarray")
        graph = coo_array(
            (np.ones(len(pairs), np.int8), (rim[pairs[:, 0]], rim[pairs[:, 1]])),
            shape=(len(points), len(points)),
        )
        _, group = connected_components(graph, directed=False)
        _, first = np.unique(group, return_index=True)
        sewn = first[group][faces]
        sewn = sewn[with_three_corners(sewn)]
        if len(sewn) and EdgeTable.from_faces(_without_copies(sewn)).is_closed:
            moved, sewn = weld_equal(points, sewn)
            notes.append(
                f"has seams open by up to {reach:.2g} ({reach / size:.1g} of its size), which were closed"
            )
            return moved, sewn
    return points, faces


def _require_closed(points: Points, groups: list[Faces], source: str) -> None:
    tables = [EdgeTable.from_faces(group) for group in groups]
    broken = [(group, table) for group, table in zip(groups, tables, strict=True) if not table.is_closed]
    if not broken:
        return
    size = float(np.ptp(points, axis=0).max())
    rims = np.concatenate([table.open_edges for _, table in broken])
    crowded = sum(int(np.count_nonzero(table.uses[table.uses % 2 == 1] > 1)) for _, table in broken)
    holes, width, centre = _largest_hole(points, rims)
    if crowded == len(rims):
        raise MeshError(
            f"{source} is not the surface of one body: {crowded} edges are shared by three triangles, where "
            f"an inner wall meets the surface, near ({_point(centre)}); remove it, "
            "for example in MeshLab with Filters > Cleaning > Repair non Manifold Edges."
        )
    many = "s" if holes > 1 else ""
    pieces = f" in {len(broken)} of its {len(groups)} pieces" if len(groups) > 1 else ""
    loose = f", and {crowded} edges are shared by three triangles" if crowded else ""
    raise MeshError(
        f"{source} is not closed: {len(rims)} open edges bound {holes} hole{many}{pieces}, "
        f"the largest {width:.3g} wide ({100 * width / size:.2g} % of its length) "
        f"near ({_point(centre)}){loose}; "
        "close them first, for example in MeshLab with Filters > Remeshing > Close Holes, "
        "or use a grain whose whole surface was scanned."
    )


def _point(place: Float[np.ndarray, " 3"]) -> str:
    return ", ".join(f"{value:.4g}" for value in place)


def _largest_hole(points: Points, rims: Int[np.ndarray, "o 2"]) -> tuple[int, float, Float[np.ndarray, " 3"]]:
    """Return how many holes open edges bound, the width of the largest, and its middle."""
    used, ends = np.unique(rims, return_inverse=True)
    ends = ends.reshape(-1, 2)
    graph = coo_array((np.ones(len(ends), np.int8), (ends[:, 0], ends[:, 1])), shape=(len(used), len(used)))
    count, of = connected_components(graph, directed=False)
    low, high = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    np.minimum.at(low, of, points[used])
    np.maximum.at(high, of, points[used])
    widths = np.linalg.norm(high - low, axis=1)
    largest = int(widths.argmax())
    return count, float(widths[largest]), (low[largest] + high[largest]) / 2


def _shells_of_piece(points: Points, faces: Faces, source: str, group: int) -> list[Shell]:
    """Return the sheets of a closed piece, wound outwards; none if it is flat.

    Sheets that are closed in themselves are shells of their own. The others meet in edges of four triangles
    and more, and are one shell together.
    """
    used, faces = np.unique(faces, return_inverse=True)
    points, faces = points[used], faces.reshape(-1, 3)
    sheets = sheets_of(faces, EdgeTable.from_faces(faces))
    if sheets is None:
        raise MeshError(
            f"{source} is one-sided like a Moebius strip, so it has no inside: check how it was made."
        )
    sheet, turned = sheets
    order = np.argsort(sheet, kind="stable")
    found, rest = [], []
    for rows in np.split(order, np.cumsum(np.bincount(sheet))[:-1]):
        own = np.where(turned[rows, None], faces[rows][:, ::-1], faces[rows])
        if sheet.max() == 0 or EdgeTable.from_faces(own).is_consistent:
            found.append(own)
        else:
            rest.append((own, faces[rows]))
    rest = _without_inner_walls(points, rest)
    if rest:
        as_given = np.concatenate([given for _, given in rest])
        is_right = EdgeTable.from_faces(as_given).is_consistent
        found.append(as_given if is_right else _turned_outwards(points, [own for own, _ in rest], source))
    size = float(np.ptp(points, axis=0).max())
    shells = []
    for own in found:
        volume = signed_volume(points, own)
        if abs(volume) > _FLAT * size**3:
            shells.append(_shell(points, own if volume > 0 else own[:, ::-1], abs(volume), group))
    return shells


def _without_inner_walls(points: Points, sheets: list[tuple[Faces, Faces]]) -> list[tuple[Faces, Faces]]:
    """Drop pairs of flat sheets with one rim: walls between two closed cells, each with its own triangles."""
    walls: dict[bytes, list[int]] = {}
    for number, (sheet, _) in enumerate(sheets):
        corners = points[np.unique(sheet)]
        spread = np.linalg.svd(corners - corners.mean(axis=0), compute_uv=False)
        if len(spread) < 3 or spread[2] <= _PLANE * spread[0]:
            walls.setdefault(EdgeTable.from_faces(sheet).open_edges.tobytes(), []).append(number)
    gone = {number for pair in walls.values() if len(pair) == 2 for number in pair}
    return [sheet for number, sheet in enumerate(sheets) if number not in gone]


def _shell(points: Points, faces: Faces, volume: float, group: int) -> Shell:
    used, numbers = np.unique(faces, return_inverse=True)
    return Shell(points[used], numbers.reshape(-1, 3), volume, group)


def _turned_outwards(points: Points, sheets: list[Faces], source: str) -> Faces:
    """Turn sheets that are closed only together so that each looks outwards where a ray leaves it."""
    faces = np.concatenate(sheets)
    start = 0
    for sheet in sheets:
        a, b, c = (points[sheet[:, corner]] for corner in range(3))
        best = start + int(np.linalg.norm(np.cross(b - a, c - a), axis=1).argmax())
        if not looks_outward(best, points, faces):
            faces[start : start + len(sheet)] = sheet[:, ::-1]
        start += len(sheet)
    if not EdgeTable.from_faces(faces).is_consistent:
        raise MeshError(
            f"{source} intersects itself where more than two triangles meet in an edge, so that inside and "
            "outside cannot be distinguished: repair it, for example in MeshLab with Filters > Cleaning."
        )
    return faces
