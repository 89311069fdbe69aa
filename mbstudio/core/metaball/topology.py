"""Pieces, voids and handles of the solid f >= 1.

f is subharmonic away from the control points, so it has no maximum there and *every piece of the
solid holds a control point*: pieces are counted among the control points. Two of them belong
together if the grid joins them through shared faces, or if f stays above 1 on the straight line
between them, which finds necks thinner than the grid. Voids are sought on the grid with the
stricter connectivity, and looked at again on a finer one before they count.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int

from mbstudio.core.compiled import compiled
from mbstudio.core.metaball.apart import solid_boxes
from mbstudio.core.metaball.field import field_at, own_length, scale_control, solid_bounds
from mbstudio.core.metaball.lines import join_by_lines
from mbstudio.core.metaball.surface import sample_solid, volume_and_area

_FEW_NODES, _MOST_BOXES = 64, 64
_CELL_CORNERS = np.array([[c >> 2, c >> 1 & 1, c & 1] for c in range(8)])


@dataclass(frozen=True, eq=False)
class Topology:
    """What the solid is made of.

    Attributes
    ----------
    pieces, voids, genus : int
        Connected pieces, cavities, handles of all surfaces together.
    piece_of_point : int array, shape (n,)
        Number (0, 1, ...) of the piece that each control point lies in; 0 is the largest.
    volumes : float array, shape (pieces,)
        Volume of each piece in the cube of the control points' unit, by counting nodes; of pieces of few
        nodes that lie apart, on a grid of their own.
    cells : int
        Grid cells along the longest side that decided.
    """

    pieces: int
    voids: int
    genus: int
    piece_of_point: Int[np.ndarray, "n"]
    volumes: Float64[np.ndarray, "pieces"]
    cells: int

    @property
    def is_sound(self) -> bool:
        """One piece and no void."""
        return self.pieces == 1 and self.voids == 0


@compiled()
def _euler_characteristic(solid: np.ndarray) -> int:
    """Return V - E + F - C of the nodes of `solid` joined through faces (6-connectivity)."""
    nz, ny, nx = solid.shape
    total = 0
    for iz in range(nz - 1):
        for iy in range(ny - 1):
            for ix in range(nx - 1):
                if not solid[iz, iy, ix]:
                    continue
                z, y, x = solid[iz + 1, iy, ix], solid[iz, iy + 1, ix], solid[iz, iy, ix + 1]
                zy = z and y and solid[iz + 1, iy + 1, ix]
                zx = z and x and solid[iz + 1, iy, ix + 1]
                yx = y and x and solid[iz, iy + 1, ix + 1]
                zyx = zy and zx and yx and solid[iz + 1, iy + 1, ix + 1]
                total += 1 - (int(z) + int(y) + int(x)) + (int(zy) + int(zx) + int(yx)) - int(zyx)
    return total


def genus_of_voxels(solid: Bool[np.ndarray, "Z Y X"]) -> int:
    """Return the number of handles of one body without cavities, its voxels joined through corners too.

    By Alexander duality the Euler characteristic of the box around a body, the body taken out, is that
    of the body plus one; the nodes of three of its faces, which are not counted, take the one away.

    Parameters
    ----------
    solid : bool array, shape (Z, Y, X)
        With an empty layer all around.
    """
    return 1 - int(_euler_characteristic(~solid))


def _groups(
    field: Float32[np.ndarray, "Z Y X"],
    origin: np.ndarray,
    spacing: float,
    control: Float64[np.ndarray, "4 n"],
) -> tuple[np.ndarray, np.ndarray]:
    """Return the group of each control point (grid, then lines) and its volume in nodes."""
    import cc3d

    solid = field >= 1.0
    labels, pieces = cc3d.connected_components(solid, connectivity=6, return_N=True)
    # Counting nodes of one piece takes a twentieth of the time of telling several apart.
    sizes = np.bincount(labels.ravel()) if pieces > 1 else np.array([0, np.count_nonzero(solid)])
    n = control.shape[1]
    place = ((control[:3].T - origin) / spacing)[:, ::-1]
    low = np.clip(np.floor(place).astype(int), 0, np.array(field.shape) - 2)
    # The nearest node of the point's cell that is in the solid; a corner of the same cell belongs
    # to the same piece only if the line to it stays inside.
    corners = low[:, None] + _CELL_CORNERS
    found = labels[tuple(np.moveaxis(corners, -1, 0))]
    away = (origin + corners[..., ::-1] * spacing) - control[:3].T[:, None]
    lines = control[:3].T[:, None, None] + np.linspace(0.1, 1, 7)[:, None] * away[:, :, None]
    inside = field_at(lines.reshape(-1, 3), control).reshape(n, 8, 7).min(axis=2) >= 1.0
    distance = np.where((found > 0) & inside, ((corners - place[:, None]) ** 2).sum(axis=2), np.inf)
    nearest = distance.argmin(axis=1)[:, None]
    joined = np.isfinite(np.take_along_axis(distance, nearest, axis=1))
    label_of = np.where(joined, np.take_along_axis(found, nearest, axis=1), 0).ravel()
    parent = np.arange(n)
    first: dict[int, int] = {}
    for i in np.flatnonzero(label_of).tolist():
        parent[i] = first.setdefault(int(label_of[i]), i)
    if len(np.unique(parent)) > 1:
        join_by_lines(control, parent, 64)
    nodes = np.zeros(n)
    for label, i in first.items():
        nodes[parent[i]] += sizes[label]
    return parent, nodes


def _void_count(solid: np.ndarray) -> int:
    import cc3d

    return int(cc3d.connected_components(~solid, connectivity=6).max()) - 1


def _genera(solid: np.ndarray, voids: int) -> tuple[int, int, int]:
    """Return digital pieces, and handles with nodes joined through faces only and through corners too."""
    import cc3d

    pieces = int(cc3d.connected_components(solid, connectivity=6).max())
    by_faces = pieces + voids - int(_euler_characteristic(solid))
    together = int(cc3d.connected_components(solid, connectivity=26).max()) if pieces > 1 else 1
    return pieces, by_faces, together + voids - int(_euler_characteristic(~solid))


def _volumes_off_the_grid(
    volumes: np.ndarray, nodes: np.ndarray, parent: np.ndarray, control: Float64[np.ndarray, "4 n"]
) -> np.ndarray:
    """Return the volume of each piece, that of pieces of few nodes on a grid of their own."""
    volumes = volumes.copy()
    boxes = solid_boxes(control)
    for box in boxes if len(boxes) <= _MOST_BOXES else ():
        within = np.flatnonzero(((box[0] <= control[:3].T) & (box[1] >= control[:3].T)).all(axis=1))
        held = np.unique(parent[within])
        if len(held) == 1 and nodes[held[0]] < _FEW_NODES:
            volumes[held[0]] = max(volume_and_area(control, 32, box)[0], 0.0)
    for root in np.flatnonzero(nodes < _FEW_NODES):
        balls = control[3, parent == root]  # about each control point, its own is solid
        if len(balls):
            volumes[root] = max(volumes[root], 4.0 / 3.0 * np.pi * balls.max() ** 1.5)
    return volumes


def topology(control: Float64[np.ndarray, "4 n"], cells: int = 64, finest: int = 192) -> Topology:
    """Count pieces, voids and handles of f >= 1.

    Parameters
    ----------
    control : float array, shape (4, n)
        Rows x, y, z, k.
    cells : int
        Grid cells along the longest side to begin with.
    finest : int
        Cells up to which the grid is refined as long as it shows anything but one plain piece, and
        by a third beyond where handles are counted differently with nodes joined through faces only
        and through corners too.
    """
    # In lengths of its own: what keeps divisions by nothing apart from small numbers is absolute.
    length = own_length(control)
    control = scale_control(control, 1.0 / length)
    bounds = solid_bounds(control)
    while True:
        field, origin, spacing = sample_solid(control, cells, bounds)
        solid = field >= 1.0
        parent, nodes = _groups(field, origin, spacing, control)
        roots = np.unique(parent)
        voids = _void_count(solid)
        digital, by_faces, by_corners = _genera(solid, voids)
        plain = len(roots) == 1 and voids == 0 and by_faces == by_corners == 0 and digital == 1
        # Handles and holes about as wide as a cell: the ways of counting differ.
        limit = finest if by_faces == by_corners else 4 * finest // 3
        if plain or cells >= limit:
            break
        cells = min(limit, 2 * cells)
    volumes = nodes * spacing**3
    if len(roots) > 1:
        volumes = _volumes_off_the_grid(volumes, nodes, parent, control)
    order = roots[np.argsort(-volumes[roots], kind="stable")]
    number = {int(root): index for index, root in enumerate(order)}
    return Topology(
        pieces=len(roots), voids=voids, genus=by_corners,
        piece_of_point=np.array([number[int(root)] for root in parent]),
        volumes=volumes[order] * length**3, cells=cells,
    )  # fmt: skip


def pieces_of(control: Float64[np.ndarray, "4 n"]) -> int:
    """Return the number of pieces of f >= 1, at little cost where straight lines join all control points."""
    parent = np.arange(control.shape[1])
    join_by_lines(scale_control(control, 1.0 / own_length(control)), parent, 64)
    return topology(control).pieces if parent.any() else 1
