"""The closed surface on which a voxel grain's projections, axes and curvature are measured."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy import ndimage

from mbstudio.core.errors import MeasureError
from mbstudio.core.grains.grain import Grain
from mbstudio.core.metrics.crofton import block_shares
from mbstudio.core.metrics.surfaces import VerticesFaces, outer_pieces, signed_volumes, surface_area

_LARGE = 160
"""Voxels along the longest side from which on the mask is averaged in blocks before it is meshed."""
_WORKING_SIDE = 200
_SMOOTHING = {1: 0.9}
"""Standard deviation in blocks, by voxels along a block; shares of larger blocks are smooth already."""
_SMOOTHING_OF_BLOCKS = 0.6
_THIN = 3
_LONG = 1.25
"""Longest over shortest edge of voxels from which on they are long."""
_FEW_EDGES = 6.0
"""Longest voxel edges through the thickest place below which axes and area are hardly known."""
_EXCESS = 0.4
"""By what the CSF of such a body comes out too large, over its thickness in longest voxel edges."""
_SMOOTHING_OF_DISTANCES = 0.9
"""Standard deviation in shortest voxel edges."""


def has_long_voxels(grain: Grain) -> bool:
    """Return whether the voxels of a grain are far from cubes."""
    edges = grain.voxel_size.zyx
    return max(edges) > _LONG * min(edges)


def is_coarsely_sampled(grain: Grain) -> bool:
    """Return whether a grain is so thin, or its voxels so long, that axes and area are hardly known."""
    return has_long_voxels(grain) or thickness_in_edges(grain) < _FEW_EDGES


def thickness_in_edges(grain: Grain) -> float:
    """Return how often the longest voxel edge goes into the diameter of the largest ball of voxels inside."""
    import edt

    edges = grain.voxel_size.zyx
    # Masks that hold a large box cannot be thin, and the distances of all their voxels take time.
    side = int(np.ceil(_FEW_EDGES))
    if _holds_cube(grain.mask, side * round(max(edges) / min(edges))):
        return float("inf")
    depth = edt.edt(np.pad(grain.mask, 1), anisotropy=edges)
    # From the middle of a voxel to that of the first one outside: half an edge less on both sides.
    return max(1.0, 2.0 * float(depth.max()) / max(edges) - 1.0)


def check_grain(grain: Grain) -> str:
    """Return what to mind about a grain's factors (empty if nothing).

    Raises
    ------
    MeasureError
        If the grain has no voxels, is in several pieces, or holds no cube of 2 x 2 x 2 voxels (a single
        voxel, a plate or a rod one voxel thick): its surface would be that of the grid.
    """
    from mbstudio.core.grains.pieces import label_pieces

    mask = grain.mask
    if mask.ndim != 3 or not mask.any():
        raise MeasureError(f"'{grain.name}' has no voxels: there is nothing to measure.")
    pieces = len(label_pieces(mask)[1])
    if pieces > 1:
        raise MeasureError(
            f"'{grain.name}' is in {pieces} pieces: shape factors are defined for one body. Make each piece "
            "a grain, or keep the largest with Grain.from_mask(..., keep='largest')."
        )
    if not _holds_cube(mask, 2):
        raise MeasureError(
            f"'{grain.name}' ({grain.voxel_count} voxels) is one voxel thick: its area and axes would follow "
            "the voxel grid. Scan it with smaller voxels."
        )
    if not _holds_cube(mask, _THIN):
        return (
            f"Less than {_THIN} voxels thick everywhere: area and axis lengths depend on the orientation in "
            "the voxel grid."
        )
    thickness = thickness_in_edges(grain)
    if thickness < _FEW_EDGES:
        return (
            f"Only {thickness:.1f} of the longest voxel edges thick: the Corey factor comes out about "
            f"{100 * _EXCESS / thickness:.0f} % too large, and the axes and the area are off likewise. "
            "Ask for intervals, or scan with smaller voxels."
        )
    return ""


def _holds_cube(mask: np.ndarray, side: int) -> bool:
    """Return whether a cube of so many voxels a side fits in the mask."""
    for axis in range(3):
        if mask.shape[axis] < side:
            return False
        span = mask.shape[axis] - side + 1
        parts = [mask[(slice(None),) * axis + (slice(k, k + span),)] for k in range(side)]
        mask = np.logical_and.reduce(parts)
    return bool(mask.any())


def voxel_outline(grain: Grain) -> VerticesFaces:
    """Return a closed, outward surface of the grain with the volume of its voxels.

    Up to 160 voxels along the longest side it is the grain's own surface (`Grain.surface_mesh`); larger
    masks are averaged in blocks first, which keeps volume and place of the surface. Between voxels that
    are longer along one axis the signed distances to the mask are interpolated, so that the surface is no
    staircase.

    Returns
    -------
    tuple of vertices, shape (v, 3), and faces, shape (f, 3)
        In the frame and unit of the grain.
    """
    if max(grain.mask.shape) > _LARGE:
        outline = _mesh_blocks(grain)
        if outline is not None:
            return outline
    elif has_long_voxels(grain):
        outline = _mesh_distances(grain)
        if outline is not None:
            return outline
    mesh = grain.surface_mesh()
    return np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces)


_MOST_FINER = 16.0
"""Cells to a voxel at most where distances are interpolated: voxels of 16:1, or of 4:4:1."""


def _mesh_distances(grain: Grain) -> VerticesFaces | None:
    """Return the surface of the signed distances to the mask.

    None where they tear the grain apart, or where voxels are so long that cells as short as their shortest
    edge would be too many: there is nothing between them to be found.

    Raya & Udupa (1990), Shape-based interpolation of multidimensional objects, IEEE Trans. Medical Imaging 9,
    32-42, in three dimensions.
    """
    import edt
    from skimage.measure import marching_cubes

    edges = np.array(grain.voxel_size.zyx)
    shortest, margin = float(edges.min()), 4
    if np.prod(edges / shortest) > _MOST_FINER:
        return None
    mask = np.pad(grain.mask, margin)
    field = edt.edt(mask, anisotropy=tuple(edges)) - edt.edt(~mask, anisotropy=tuple(edges))
    for axis in range(3):
        if edges[axis] > _LONG * shortest:
            field = _interpolate(field, axis, shortest / float(edges[axis]))
            edges[axis] = shortest
    field = ndimage.gaussian_filter(field, list(_SMOOTHING_OF_DISTANCES * shortest / edges), truncate=4.0)
    corner = np.asarray(grain.origin) - margin * np.asarray(grain.voxel_size.xyz)
    level, reach = 0.0, 2.0 * max(grain.voxel_size.zyx)
    for _ in range(20):
        if not field.min() < level < field.max():
            return None
        corners, faces, _, _ = marching_cubes(field, level, allow_degenerate=False)
        points = corners[:, ::-1].astype(np.float64) * edges[::-1] + corner
        volume = float(signed_volumes(points - corner, faces).sum())
        if volume < 0:
            faces, volume = faces[:, ::-1], -volume
        error = (volume - grain.volume) / surface_area(points, faces)
        if abs(error) < 1e-4 * shortest:
            break
        level = float(np.clip(level + error, -reach, reach))
    faces = np.ascontiguousarray(faces)
    return (points, faces) if outer_pieces(points, faces) == 1 else None


def _interpolate(field: Float[np.ndarray, "Z Y X"], axis: int, step: float) -> Float[np.ndarray, "Z2 Y2 X2"]:
    """Return a field read linearly every `step` voxels along one axis, from its first voxel on."""
    field = np.moveaxis(field, axis, 0)
    places = np.arange(int((len(field) - 1) / step + 1e-9) + 1) * step
    low = np.minimum(places.astype(int), len(field) - 2)
    part = (places - low)[:, None, None]
    return np.moveaxis(field[low] * (1.0 - part) + field[low + 1] * part, 0, axis)


def _mesh_blocks(grain: Grain) -> VerticesFaces | None:
    """Return the surface of the block averages; None where they tear the grain apart."""
    from skimage.measure import marching_cubes

    share, edges = block_shares(grain.mask, grain.voxel_size.zyx, _WORKING_SIDE)
    margin = 4
    field = np.pad(share, margin)
    block = round(edges[0] / grain.voxel_size.z)
    smoothing = _SMOOTHING.get(block, _SMOOTHING_OF_BLOCKS)
    field = ndimage.gaussian_filter(field, [smoothing * min(edges) / edge for edge in edges], truncate=4.0)
    spacing = np.array(edges[::-1])
    # The first block's centre lies half a block, less half a voxel, from the first voxel's.
    corner = np.asarray(grain.origin) + (spacing - grain.voxel_size.xyz) / 2
    level = 0.5
    for _ in range(3):
        corners, faces, _, _ = marching_cubes(field, level, allow_degenerate=False)
        points = (corners[:, ::-1].astype(np.float64) - margin) * spacing + corner
        volume = float(signed_volumes(points, faces).sum())
        if volume < 0:
            faces, volume = faces[:, ::-1], -volume
        error = (volume - grain.volume) / surface_area(points, faces)
        if abs(error) < 1e-4 * float(spacing.min()):
            break
        # The smoothed step rises by about 0.55 a block at its middle.
        level = float(np.clip(level + 0.55 * error / float(spacing.min()), 0.2, 0.8))
    faces = np.ascontiguousarray(faces)
    return (points, faces) if outer_pieces(points, faces) == 1 else None
