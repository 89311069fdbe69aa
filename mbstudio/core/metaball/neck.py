"""The smallest neck: how thin the solid f >= 1 is where it joins two thicker parts.

Shrinking the solid from its surface takes it apart at its necks. On a grid, the nodes are added
by falling depth; where two groups meet that are both deeper than their meeting place, there is a
neck. Its place is then moved to the saddle of f nearby and its depth measured anew, free of the grid.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64

from mbstudio.core.compiled import compiled
from mbstudio.core.metaball.field import field_at, own_length, scale_control
from mbstudio.core.metaball.lines import group_root, nearest_link
from mbstudio.core.metaball.signed_distance import closest_points, u_gradient_hessian
from mbstudio.core.metaball.surface import sample_solid

_MARKED = 0.85
"""A waist counts as a neck if it is below this share of the thickness of the thinner part beside it."""
_MOST_MEASURED = 4


@compiled()
def _meetings(
    depth: np.ndarray, order: np.ndarray, least: np.float32, share: np.float32
) -> tuple[list[np.int64], list[np.float32], np.ndarray]:
    """Return nodes where two groups meet that are deeper than there, and the lesser of their depths.

    Also the group of every node in the end. `order` holds flat indices by falling depth; the
    outermost layer of nodes must not be in it.
    """
    _, ny, nx = depth.shape
    flat = depth.ravel()
    parent = np.full(flat.size, -1, dtype=np.int64)
    peak = np.zeros(flat.size, dtype=np.float32)
    nodes, peaks = [np.int64(0) for _ in range(0)], [np.float32(0) for _ in range(0)]
    for node in order:
        parent[node], peak[node] = node, flat[node]
        for dz in range(-1, 2):
            for dy in range(-1, 2):
                for dx in range(-1, 2):
                    other = node + (dz * ny + dy) * nx + dx
                    if other == node or parent[other] < 0:
                        continue
                    a, b = group_root(parent, node), group_root(parent, other)
                    if a == b:
                        continue
                    if peak[a] < peak[b]:
                        a, b = b, a
                    if flat[node] < share * peak[b] and peak[b] - flat[node] > least:
                        nodes.append(node)
                        peaks.append(peak[b])
                    parent[b] = a
    for node in order:
        parent[node] = group_root(parent, node)
    return nodes, peaks, parent


def _saddle(place: np.ndarray, control: Float64[np.ndarray, "4 n"], reach: float) -> np.ndarray:
    """Return the saddle of f within `reach` of a place, or the place itself if none is found."""
    state, here = np.empty(10), place.copy()
    for _ in range(20):
        u_gradient_hessian(here[0], here[1], here[2], control, state)
        xx, yy, zz, xy, xz, yz = state[4:]
        hessian = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        if abs(np.linalg.det(hessian)) < 1e-12 * np.abs(hessian).max() ** 3:
            return place
        step = np.linalg.solve(hessian, state[1:4])
        length = float(np.linalg.norm(step))
        here = here - step * min(1.0, 0.5 * reach / max(length, 1e-300))
        if np.linalg.norm(here - place) > reach:
            return place
        if length < 1e-9 * reach:
            return here
    return place


def _measured(places: list[np.ndarray], control: Float64[np.ndarray, "4 n"], reach: float) -> np.ndarray:
    """Return depths at the saddles of f near some places; 0 outside the solid."""
    settled = np.array([_saddle(place, control, reach) for place in places])
    depths: np.ndarray = np.maximum(-closest_points(settled, control)[1], 0.0)
    return depths


def smallest_neck(control: Float64[np.ndarray, "4 n"], cells: int = 48) -> float:
    """Return the diameter of the thinnest neck of a solid of one piece, in the unit of the control points.

    Parameters
    ----------
    control : float array, shape (4, n)
    cells : int
        Grid cells along the longest side on which necks are looked for.

    Returns
    -------
    float
        Diameter of the largest sphere that fits into the narrowest place between two thicker
        parts. Without such a place, as in convex bodies: diameter of the largest inscribed
        sphere. 0 if a part hangs on by nothing that could be found.
    """
    import edt

    # In lengths of its own: single precision squares them.
    length = own_length(control)
    control = scale_control(control, 1.0 / length)
    field, origin, spacing = sample_solid(control, cells)
    solid = field >= 1.0
    solid[[0, -1]] = solid[:, [0, -1]] = solid[:, :, [0, -1]] = False
    depth = edt.edt(solid.view(np.uint8), anisotropy=(spacing,) * 3, parallel=1)
    depth -= np.float32(0.5 * spacing)
    inside = np.flatnonzero(solid.ravel())
    if not len(inside):
        return 0.0
    flat = depth.ravel()
    order = inside[np.argsort(-flat[inside], kind="stable")]
    nodes, peaks, group = _meetings(depth, order, np.float32(0.75 * spacing), np.float32(_MARKED))

    def at(node: int) -> np.ndarray:
        z, y, x = np.unravel_index(node, depth.shape)
        return np.array(origin + np.array([x, y, z]) * spacing)

    necks = sorted(zip(nodes, peaks, strict=True), key=lambda found: flat[found[0]])[:_MOST_MEASURED]
    thickest = float(np.maximum(-closest_points(at(int(order[0]))[None], control)[1][0], 0.0))
    found = [thickest]
    if necks:
        radii = _measured([at(int(node)) for node, _ in necks], control, 3.0 * spacing)
        found += [float(r) for r, (_, peak) in zip(radii, necks, strict=True) if r < peak]
    found += [float(r) for r in _below_the_grid(group, depth.shape, origin, spacing, control)]
    # Vector sums round differently, once in a long while, for the same numbers elsewhere in memory.
    return float(f"{2.0 * min(found) * length:.10g}")


def _below_the_grid(
    group: np.ndarray,
    shape: tuple[int, ...],
    origin: np.ndarray,
    spacing: float,
    control: Float64[np.ndarray, "4 n"],
) -> np.ndarray:
    """Return radii of necks too thin for the grid: where lines join control points of its several groups."""
    index = np.rint((control[:3].T - origin) / spacing).astype(int)[:, ::-1]
    index = np.clip(index, 0, np.array(shape) - 1)
    piece = group[np.ravel_multi_index(tuple(index.T), shape)]
    # A control point whose nearest node is not in the solid is a group of its own.
    piece = np.where(piece < 0, -1 - np.arange(len(piece)), piece)
    radii = []
    while len(np.unique(piece)) > 1:
        a, b, _ = nearest_link(control, piece, 64)
        line = control[:3, a] + np.linspace(0, 1, 129)[1:-1, None] * (control[:3, b] - control[:3, a])
        lowest = line[field_at(line, control).argmin()]
        beside = min(_thickness(control, piece == piece[a]), _thickness(control, piece == piece[b]))
        radius = float(_measured([lowest], control, 3.0 * spacing)[0])
        if radius < _MARKED * beside:
            radii.append(radius)
        piece = np.where(piece == piece[b], piece[a], piece)
    return np.array(radii)


def _thickness(control: Float64[np.ndarray, "4 n"], chosen: np.ndarray) -> float:
    """Return the depth of the deepest of some control points."""
    return float(-closest_points(control[:3, chosen].T, control)[1].min())
