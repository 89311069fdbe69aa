"""The surface f = 1 of an avatar: closed mesh, volume and area.

All work is done on ``u = f**(-1/2)``: for one control point it is the distance divided by the
radius, hence linear, and with many it stays close to linear near the surface.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float64

from mbstudio.core.compiled import SAFE_MATH, compiled
from mbstudio.core.errors import AvatarError
from mbstudio.core.metaball.apart import solid_boxes
from mbstudio.core.metaball.field import (
    field_and_gradient_at,
    field_on_grid,
    own_length,
    scale_control,
    solid_bounds,
)

if TYPE_CHECKING:
    import trimesh


_CHUNK = 128  # places whose sums stay in the nearest cache


@compiled(fastmath=SAFE_MATH, error_model="numpy")
def _signed_distances(
    places: np.ndarray, count: int, control: np.ndarray, sums: np.ndarray, out: np.ndarray
) -> None:
    """Write first-order distances to f = 1, positive inside, at the first `count` places (rows x, y, z)."""
    px, py, pz = places[0], places[1], places[2]
    total, gx, gy, gz = sums[0], sums[1], sums[2], sums[3]
    for p in range(count):
        total[p] = gx[p] = gy[p] = gz[p] = 0.0
    for i in range(control.shape[1]):
        cx, cy, cz, k = control[0, i], control[1, i], control[2, i], control[3, i]
        for p in range(count):
            dx, dy, dz = px[p] - cx, py[p] - cy, pz[p] - cz
            inverse = 1.0 / max(dx * dx + dy * dy + dz * dz, 1e-30)
            term = k * inverse
            slope = term * inverse
            total[p] += term
            gx[p] += slope * dx
            gy[p] += slope * dy
            gz[p] += slope * dz
    for p in range(count):
        u = 1.0 / np.sqrt(total[p])
        # grad u = -1/2 f**(-3/2) grad f, and grad f is -2 times the sums.
        steepness = u / total[p] * np.sqrt(gx[p] * gx[p] + gy[p] * gy[p] + gz[p] * gz[p])
        out[p] = (1.0 - u) / max(steepness, 1e-30)


@compiled(error_model="numpy")
def _sort_layer(u: np.ndarray, iz: int, near: np.ndarray) -> tuple[int, int]:
    """Return how many nodes of a layer lie well inside, and how many `near` the surface (rows iy, ix)."""
    _, ny, nx = u.shape
    inside = found = 0
    for iy in range(1, ny - 1):
        for ix in range(1, nx - 1):
            here = u[iz, iy, ix]
            # Differences of neighbours tell how far the surface is, within a factor of 2 where
            # it is near: they only decide where the exact distance is worth computing.
            by_x = u[iz, iy, ix + 1] - u[iz, iy, ix - 1]
            by_y = u[iz, iy + 1, ix] - u[iz, iy - 1, ix]
            by_z = u[iz + 1, iy, ix] - u[iz - 1, iy, ix]
            # (1 - u) / |grad u| > 3 cells, both sides squared; |grad u| is half the difference.
            if (1.0 - here) ** 2 > 2.25 * (by_x * by_x + by_y * by_y + by_z * by_z):
                if here < 1.0:
                    inside += 1
            else:
                near[0, found], near[1, found] = iy, ix
                found += 1
    return inside, found


@compiled(error_model="numpy")
def _quadrature(
    u: np.ndarray, origin: np.ndarray, spacing: float, control: np.ndarray
) -> tuple[float, float]:
    """Return volume and area of u <= 1 from samples of u on a grid of cubes of edge `spacing`.

    The step across the surface is smeared over 3 cells by a kernel without second moment, so that
    neither curvature nor the bend of u across the surface biases the volume.
    """
    nz, ny, nx = u.shape
    reach = 1.5 * spacing
    near = np.empty((2, ny * nx), np.int32)
    places, sums, distances = np.empty((3, _CHUNK)), np.empty((4, _CHUNK)), np.empty(_CHUNK)
    volume = area = 0.0
    for iz in range(1, nz - 1):
        inside, found = _sort_layer(u, iz, near)
        volume += inside
        for start in range(0, found, _CHUNK):
            count = min(_CHUNK, found - start)
            for p in range(count):
                places[0, p] = origin[0] + near[1, start + p] * spacing
                places[1, p] = origin[1] + near[0, start + p] * spacing
                places[2, p] = origin[2] + iz * spacing
            _signed_distances(places, count, control, sums, distances)
            for p in range(count):
                t = distances[p] / reach
                if t >= 1.0:
                    volume += 1.0
                elif t > -1.0:
                    square = t * t
                    step = 3.0 - 10.0 / 3.0 * square + 7.0 / 5.0 * square * square
                    volume += 0.5 + 15.0 / 32.0 * t * step
                    area += 15.0 / 32.0 * (1.0 - square) * (3.0 - 7.0 * square) / reach
    return volume * spacing**3, area * spacing**3


@compiled()
def _triangle_area(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Return the area of all triangles together, in double precision and in their order."""
    total = 0.0
    for face in range(len(faces)):
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        ux, uy, uz = (
            np.float64(vertices[b, 0]) - vertices[a, 0],
            np.float64(vertices[b, 1]) - vertices[a, 1],
            np.float64(vertices[b, 2]) - vertices[a, 2],
        )
        vx, vy, vz = (
            np.float64(vertices[c, 0]) - vertices[a, 0],
            np.float64(vertices[c, 1]) - vertices[a, 1],
            np.float64(vertices[c, 2]) - vertices[a, 2],
        )
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        total += 0.5 * np.sqrt(nx * nx + ny * ny + nz * nz)
    return total


def sample_solid(
    control: Float64[np.ndarray, "4 n"], cells: int, bounds: Float64[np.ndarray, "2 3"] | None = None
) -> tuple[np.ndarray, Float64[np.ndarray, "3"], float]:
    """Return f on a grid of cubes about the solid, two cells wider: field [z, y, x], first node, spacing."""
    low, high = solid_bounds(control) if bounds is None else bounds
    spacing = float((high - low).max()) / cells
    counts = np.ceil((high - low) / spacing).astype(int) + 5
    origin = 0.5 * (low + high) - 0.5 * (counts - 1) * spacing
    field = field_on_grid(
        origin, np.full(3, spacing), (int(counts[2]), int(counts[1]), int(counts[0])), control
    )
    return field, origin, spacing


def volume_and_area(
    control: Float64[np.ndarray, "4 n"], cells: int = 64, bounds: Float64[np.ndarray, "2 3"] | None = None
) -> tuple[float, float]:
    """Return volume and surface area of f >= 1 by quadrature, `cells` on the longest side.

    On one grid, within `bounds` where these are known; without them on one for each part that lies apart.
    """
    boxes = solid_boxes(control) if bounds is None else [bounds]
    cells = cells_of_each(cells, len(boxes))
    found = [volume_and_area_on_grid(*sample_solid(control, cells, box), control) for box in boxes]
    return sum(volume for volume, _ in found), sum(area for _, area in found)


def cells_of_each(cells: int, boxes: int) -> int:
    """Return the cells along each of so many boxes which together are no more work than one with `cells`."""
    return max(min(cells, 12), int(cells / np.cbrt(boxes)))


def volume_and_area_on_grid(
    field: np.ndarray, origin: Float64[np.ndarray, "3"], spacing: float, control: Float64[np.ndarray, "4 n"]
) -> tuple[float, float]:
    """Return volume and surface area by quadrature on a grid that :func:`sample_solid` made of f."""
    # In lengths of the body: what keeps divisions by nothing apart from small numbers is absolute.
    length = float(2.0 ** np.floor(np.log2(spacing * max(field.shape))))
    volume, area = _quadrature(
        _u_of(field), origin / length, spacing / length, scale_control(control, 1.0 / length)
    )
    return float(volume) * length**3, float(area) * length**2


def volume_and_area_of_thin(
    control: Float64[np.ndarray, "4 n"],
    cells: int = 64,
    bounds: Float64[np.ndarray, "2 3"] | None = None,
    *,
    finest: int = 192,
) -> tuple[float, float]:
    """Return volume and area as :func:`volume_and_area`, on a finer grid where the solid is thin.

    A sheet thinner than six cells would have its two faces smeared into each other, and its volume
    be wrong by up to ten percent; 2 V / A is the thickness of a sheet.
    """
    boxes = solid_boxes(control) if bounds is None else [bounds]
    most, cells = cells_of_each(finest, len(boxes)), cells_of_each(cells, len(boxes))
    found = []
    for box in boxes:
        volume, area = volume_and_area(control, cells, box)
        # Where the grid misses the solid, it is not volume that tells.
        across = 3 * area * float((box[1] - box[0]).max())
        wanted = int(np.ceil(across / volume)) if across < most * volume else most
        found.append((volume, area) if wanted <= cells else volume_and_area(control, wanted, box))
    return sum(volume for volume, _ in found), sum(area for _, area in found)


def _u_of(field: np.ndarray) -> np.ndarray:
    """Return u of f; f beyond all reach is 0 in single precision, and u is then merely large."""
    u: np.ndarray = 1.0 / np.sqrt(np.maximum(field, np.float32(1e-12)))
    return u


def mesh_area(control: Float64[np.ndarray, "4 n"], cells: int = 64) -> float:
    """Return the surface area of f >= 1 by triangles alone.

    On a coarse grid it loses a little at sharp edges, where :func:`volume_and_area` gains several
    percent: the first-order distance there tells of far more surface than there is.
    """
    from skimage.measure import marching_cubes

    field, _, spacing = sample_solid(control, cells)
    if field.max() < 1.0:  # parts so far apart that the grid sees none of them
        return volume_and_area(control, cells)[1]
    vertices, faces, _, _ = marching_cubes(_u_of(field), 1.0, gradient_direction="ascent")
    # Single-precision corners tell no more than seven digits.
    return float(f"{spacing**2 * _triangle_area(vertices, faces):.7g}")


def project_to_surface(
    points: Float64[np.ndarray, "m 3"],
    control: Float64[np.ndarray, "4 n"],
    steps: int = 3,
    longest: float = np.inf,
) -> Float64[np.ndarray, "m 3"]:
    """Move points along the gradient onto f = 1 by Newton steps on u, none longer than `longest`."""
    moved = np.array(points, dtype=np.float64)
    for _ in range(steps):
        field, gradient = field_and_gradient_at(moved, control)
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            # u - 1 = f**-1/2 - 1 and grad u = -1/2 f**-3/2 grad f.
            slope = -0.5 * field**-1.5
            grad_u = gradient * slope[:, None]
            step = -((field**-0.5 - 1.0) / np.maximum((grad_u**2).sum(axis=1), 1e-300))[:, None] * grad_u
        length = np.linalg.norm(step, axis=1)
        good = np.isfinite(length)
        factor = np.minimum(1.0, longest / np.maximum(length, 1e-300))
        moved[good] += (step * factor[:, None])[good]
    return moved


def surface_mesh(control: Float64[np.ndarray, "4 n"], cells: int = 64) -> trimesh.Trimesh:
    """Return the closed, outward surface f = 1 as a triangle mesh.

    Parameters
    ----------
    control : float array, shape (4, n)
    cells : int
        Grid cells along the longest side of the solid.

    Raises
    ------
    AvatarError
        If `cells` is below 4.
    """
    import trimesh

    if cells < 4:
        raise AvatarError(f"A mesh needs at least 4 cells, not {cells}.")
    length = own_length(control)
    control = scale_control(control, 1.0 / length)
    boxes = solid_boxes(control)
    parts = [_mesh_in(box, control, cells_of_each(cells, len(boxes))) for box in boxes]
    first = np.cumsum([0, *(len(points) for points, _ in parts)])
    points = np.concatenate([points for points, _ in parts])
    faces = np.concatenate([faces + start for (_, faces), start in zip(parts, first[:-1], strict=True)])
    return trimesh.Trimesh(length * points, faces, process=False)


def _mesh_in(
    box: Float64[np.ndarray, "2 3"], control: Float64[np.ndarray, "4 n"], cells: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return corners and faces of the surface within a box; none where its parts are below the grid."""
    from skimage.measure import marching_cubes

    field, origin, spacing = sample_solid(control, cells, box)
    if field.max() < 1.0:
        return np.empty((0, 3)), np.empty((0, 3), dtype=np.int32)
    distance = _u_of(field)
    # A node exactly on the surface would collapse the triangles around it.
    distance[np.abs(distance - 1.0) < 1e-4] = np.float32(1.0 - 1e-4)
    vertices, faces, _, _ = marching_cubes(distance, 1.0, gradient_direction="ascent")
    points = origin + vertices[:, ::-1].astype(np.float64) * spacing
    points = project_to_surface(points, control, longest=0.4 * spacing)
    a, b, c = ((points - origin)[faces[:, corner]] for corner in range(3))
    outward = np.einsum("fi,fi->f", a, np.cross(b, c)).sum() >= 0
    return points, faces if outward else faces[:, ::-1]
