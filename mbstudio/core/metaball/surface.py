"""The surface f = 1 of an avatar: closed mesh, volume and area.

All work is done on ``u = f**(-1/2)``: for one control point it is the distance divided by the
radius, hence linear, and with many it stays close to linear near the surface.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float64
from numba import njit

from mbstudio.core.errors import AvatarError
from mbstudio.core.metaball.field import field_and_gradient_at, field_on_grid, solid_bounds

if TYPE_CHECKING:
    import trimesh


@njit(cache=True, nogil=True, error_model="numpy")
def _quadrature(field, origin, spacing, control):  # pragma: no cover - compiled
    """Return volume and area of f >= 1 from samples on a grid of cubes of edge `spacing`.

    The step across the surface is smeared over 3 cells by a kernel without second moment, so that
    neither curvature nor the bend of u across the surface biases the volume.
    """
    nz, ny, nx = field.shape
    n = control.shape[1]
    reach = 1.5 * spacing
    volume = area = 0.0
    for iz in range(nz):
        for iy in range(ny):
            for ix in range(nx):
                # Along an axis the surface crosses at most sqrt(3) times its distance away: the cheap
                # test below only decides where the exact distance is worth computing.
                near = False
                inside = field[iz, iy, ix] >= 1.0
                for step in range(-3, 4):
                    for axis in range(3):
                        jz = min(max(iz + (step if axis == 0 else 0), 0), nz - 1)
                        jy = min(max(iy + (step if axis == 1 else 0), 0), ny - 1)
                        jx = min(max(ix + (step if axis == 2 else 0), 0), nx - 1)
                        if (field[jz, jy, jx] >= 1.0) != inside:
                            near = True
                if not near:
                    if inside:
                        volume += 1.0
                    continue
                x, y, z = origin[0] + ix * spacing, origin[1] + iy * spacing, origin[2] + iz * spacing
                total = gx = gy = gz = 0.0
                for i in range(n):
                    dx, dy, dz = x - control[0, i], y - control[1, i], z - control[2, i]
                    inverse = 1.0 / max(dx * dx + dy * dy + dz * dz, 1e-30)
                    term = control[3, i] * inverse
                    total += term
                    slope = -2.0 * term * inverse
                    gx += slope * dx
                    gy += slope * dy
                    gz += slope * dz
                u = 1.0 / np.sqrt(total)
                steepness = 0.5 * u / total * np.sqrt(gx * gx + gy * gy + gz * gz)
                t = (1.0 - u) / max(steepness, 1e-30) / reach
                if t >= 1.0:
                    volume += 1.0
                elif t > -1.0:
                    square = t * t
                    kernel = 15.0 / 32.0 * (1.0 - square) * (3.0 - 7.0 * square)
                    volume += 0.5 + 15.0 / 32.0 * t * (3.0 - 10.0 / 3.0 * square + 7.0 / 5.0 * square * square)
                    area += kernel / reach
    return volume * spacing**3, area * spacing**3


def sample_solid(
    control: Float64[np.ndarray, "4 n"], cells: int, bounds: Float64[np.ndarray, "2 3"] | None = None
) -> tuple[np.ndarray, Float64[np.ndarray, "3"], float]:
    """Return f on a grid of cubes that encloses the solid by two cells: field [z, y, x], first node, spacing."""
    low, high = solid_bounds(control) if bounds is None else bounds
    spacing = float((high - low).max()) / cells
    counts = np.ceil((high - low) / spacing).astype(int) + 5
    origin = 0.5 * (low + high) - 0.5 * (counts - 1) * spacing
    field = field_on_grid(origin, np.full(3, spacing), (int(counts[2]), int(counts[1]), int(counts[0])), control)
    return field, origin, spacing


def volume_and_area(
    control: Float64[np.ndarray, "4 n"], cells: int = 64, bounds: Float64[np.ndarray, "2 3"] | None = None
) -> tuple[float, float]:
    """Return volume and surface area of f >= 1 by quadrature on a grid, `cells` on the longest side."""
    field, origin, spacing = sample_solid(control, cells, bounds)
    volume, area = _quadrature(field, origin, spacing, control)
    return float(volume), float(area)


def project_to_surface(
    points: Float64[np.ndarray, "m 3"], control: Float64[np.ndarray, "4 n"], steps: int = 3, longest: float = np.inf
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
    from skimage.measure import marching_cubes

    if cells < 4:
        raise AvatarError(f"A mesh of {cells} cells cannot show a surface: ask for at least 4.")
    field, origin, spacing = sample_solid(control, cells)
    with np.errstate(divide="ignore"):
        distance = 1.0 / np.sqrt(field)
    # A node exactly on the surface would collapse the triangles around it.
    distance[np.abs(distance - 1.0) < 1e-4] = np.float32(1.0 - 1e-4)
    vertices, faces, _, _ = marching_cubes(distance, 1.0, gradient_direction="ascent")
    points = origin + vertices[:, ::-1].astype(np.float64) * spacing
    points = project_to_surface(points, control, longest=0.4 * spacing)
    mesh = trimesh.Trimesh(points, faces, process=False)
    if mesh.volume < 0:
        mesh.invert()
    return mesh
