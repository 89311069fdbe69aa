"""Sphere clustering (Algorithm 1): the largest inscribed spheres that do not overlap.

Both ways are generators of :class:`Sphere`, one a step. They end early when every voxel of the
grain lies in a sphere, as in a ball: :func:`cluster_overlapping` then goes on.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float32, Float64

from mbstudio.core.compiled import compiled

# Shares of its radius with which a sphere counts where spheres may overlap.
_SHARES = (0.5, 0.25)


class Sphere(NamedTuple):
    """One inscribed sphere: its centre's voxel [z, y, x] and its radius, in the unit of the spacing."""

    voxel: tuple[int, int, int]
    radius: float


def cluster_to_the_letter(
    mask: Bool[np.ndarray, "Z Y X"],
    spacing: Float64[np.ndarray, "3"],
    n: int,
    *,
    found: Sequence[Sphere] = (),
    closed: bool = False,
) -> Iterator[Sphere]:
    """Yield spheres by Algorithm 1: a distance transform of what is left for every sphere.

    Parameters
    ----------
    mask : bool array, shape (Z, Y, X)
        With a margin of at least one empty voxel.
    spacing : float array, shape (3,)
        Voxel edges (x, y, z).
    n : int
        Spheres in all, those found before included.
    found : sequence of Sphere
        The first ones, where the algorithm goes on after a change of n.
    closed : bool
        Whether voxels at the radius are zeroed too, or only those nearer.

    Notes
    -----
    The radius is the value of the distance transform: the distance from the centre to the centre
    of the nearest voxel that is outside or already taken. Of several voxels with the largest
    value the first in the order z, y, x is the centre.
    """
    import edt

    left = np.array(mask, dtype=bool)
    anisotropy = tuple(float(edge) for edge in spacing[::-1])
    # A shade below or above the radius, so that rounding treats all voxels at the radius alike.
    share = 1.0 + 1e-6 if closed else 1.0 - 1e-6
    for sphere in found:
        _zero_ball(left, *sphere.voxel, share * sphere.radius**2, spacing)
    for _ in range(n - len(found)):
        transform = edt.edt(left, anisotropy=anisotropy, parallel=1)
        index = int(transform.argmax())
        radius = float(transform.flat[index])
        if radius <= 0:
            return
        iz, iy, ix = (int(i) for i in np.unravel_index(index, transform.shape))
        _zero_ball(left, iz, iy, ix, share * radius**2, spacing)
        yield Sphere((iz, iy, ix), radius)


@compiled()
def _zero_ball(left: np.ndarray, iz: int, iy: int, ix: int, square: float, spacing: np.ndarray) -> None:
    nz, ny, nx = left.shape
    radius = np.sqrt(square)
    rz, ry, rx = int(radius / spacing[2]) + 1, int(radius / spacing[1]) + 1, int(radius / spacing[0]) + 1
    for jz in range(max(0, iz - rz), min(nz, iz + rz + 1)):
        for jy in range(max(0, iy - ry), min(ny, iy + ry + 1)):
            for jx in range(max(0, ix - rx), min(nx, ix + rx + 1)):
                dz, dy, dx = (jz - iz) * spacing[2], (jy - iy) * spacing[1], (jx - ix) * spacing[0]
                if dz * dz + dy * dy + dx * dx < square:
                    left[jz, jy, jx] = False


@compiled()
def _row_maxima(distance: np.ndarray, best: np.ndarray, place: np.ndarray) -> None:
    nz, ny, nx = distance.shape
    for iz in range(nz):
        for iy in range(ny):
            best[iz, iy], place[iz, iy] = -np.inf, 0
            for ix in range(nx):
                if distance[iz, iy, ix] > best[iz, iy]:
                    best[iz, iy], place[iz, iy] = distance[iz, iy, ix], ix


@compiled()
def _take_ball(
    distance: np.ndarray,
    best: np.ndarray,
    place: np.ndarray,
    iz: int,
    iy: int,
    ix: int,
    radius: float,
    spacing: np.ndarray,
    least: float,
) -> None:
    """Lower the distance of every voxel to its distance from the new sphere's surface."""
    nz, ny, nx = distance.shape
    # Beyond twice the largest free radius the new sphere cannot be the nearest surface.
    reach = radius + best.max()
    rz, ry, rx = int(reach / spacing[2]) + 1, int(reach / spacing[1]) + 1, int(reach / spacing[0]) + 1
    for jz in range(max(0, iz - rz), min(nz, iz + rz + 1)):
        for jy in range(max(0, iy - ry), min(ny, iy + ry + 1)):
            if best[jz, jy] <= least:
                continue
            dz, dy = (jz - iz) * spacing[2], (jy - iy) * spacing[1]
            square = dz * dz + dy * dy
            if square > reach * reach:
                continue
            changed = False
            for jx in range(max(0, ix - rx), min(nx, ix + rx + 1)):
                old = distance[jz, jy, jx]
                if old > least:
                    dx = (jx - ix) * spacing[0]
                    new = np.float32(np.sqrt(square + dx * dx) - radius)
                    if new < old:
                        distance[jz, jy, jx] = new
                        changed = True
            if changed:
                top, at = np.float32(-np.inf), 0
                for jx in range(nx):
                    if distance[jz, jy, jx] > top:
                        top, at = distance[jz, jy, jx], jx
                best[jz, jy], place[jz, jy] = top, at


def cluster_incrementally(
    distance: Float32[np.ndarray, "Z Y X"], spacing: Float64[np.ndarray, "3"], n: int, smallest: float
) -> Iterator[Sphere]:
    """Yield up to `n` spheres from one distance transform, lowered locally for every sphere found.

    Parameters
    ----------
    distance : float array, shape (Z, Y, X)
        Distance transform of the grain (zero or negative outside), in the unit of `spacing`.
    spacing : float array, shape (3,)
        Voxel edges (x, y, z).
    n : int
    smallest : float
        Radius that a sphere has at least: that of one voxel.

    Notes
    -----
    The distance to the taken *spheres* replaces that to the taken *voxels* of Algorithm 1; radii
    agree within the rounding of a sphere to voxels.
    """
    # A voxel exactly on a sphere is still free, as in Algorithm 1; one outside the grain never is.
    least = -1e-3 * float(np.min(spacing))
    yield from _largest_free(distance, spacing, (), n, smallest, 1.0, least)


def cluster_overlapping(
    distance: Float32[np.ndarray, "Z Y X"],
    spacing: Float64[np.ndarray, "3"],
    found: Sequence[Sphere],
    n: int,
    smallest: float,
) -> Iterator[Sphere]:
    """Yield further spheres, up to `n` with those found: they may reach into the others' outer parts.

    A rounded body is used up by a few spheres that do not overlap (a ball by one), though it can
    hold more control points. Every sphere now counts with a half, then a quarter of its radius.

    Parameters
    ----------
    distance, spacing, smallest : as in :func:`cluster_incrementally`
    found : sequence of Sphere
        The spheres that do not overlap.
    n : int
    """
    spheres = list(found)
    for share in _SHARES:
        more = _largest_free(
            distance, spacing, spheres, n - len(spheres), smallest, share, 0.9 * float(np.min(spacing))
        )
        added = []
        for sphere in more:
            added.append(sphere)
            yield sphere
        spheres += added
        if len(spheres) >= n:
            return


def _largest_free(
    distance: np.ndarray, spacing: np.ndarray, taken: Sequence[Sphere], n: int, smallest: float, share: float,
    least: float,
) -> Iterator[Sphere]:  # fmt: skip
    """Yield the largest spheres that keep clear of `share` of the radius of every other.

    They end where no voxel is farther than `least` from the others.
    """
    left = np.where(distance > 0, distance, -np.inf).astype(np.float32)
    best = np.empty(left.shape[:2], dtype=np.float32)
    place = np.empty(left.shape[:2], dtype=np.int64)
    _row_maxima(left, best, place)
    for sphere in taken:
        _take_ball(left, best, place, *sphere.voxel, share * sphere.radius, spacing, least)
    for _ in range(n):
        row = int(best.argmax())
        iz, iy = divmod(row, left.shape[1])
        if best[iz, iy] <= least:
            return
        ix = int(place[iz, iy])
        radius = max(float(best[iz, iy]), smallest)
        _take_ball(left, best, place, iz, iy, ix, share * radius, spacing, least)
        yield Sphere((iz, iy, ix), radius)
