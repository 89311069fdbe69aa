"""Grains made from a mask or from a surface mesh, checked."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from jaxtyping import Bool

from mbstudio.core.errors import GrainError, GrainWarning, MeshError, UnitError
from mbstudio.core.grains.grain import Grain
from mbstudio.core.grains.pieces import bounding_box, pieces_of, without_cavities
from mbstudio.core.grains.voxelisation import voxelise
from mbstudio.core.units import VoxelSize, parse_unit

if TYPE_CHECKING:
    import trimesh


def grain_from_mask(
    mask: np.ndarray,
    voxel_size: str | float | Sequence[float] | VoxelSize,
    *,
    unit: str | None = None,
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
    keep: Literal["error", "largest"] = "error",
    fill_cavities: bool = True,
    label: int | None = None,
    touches_border: bool = False,
    name: str = "grain",
) -> Grain:
    """Make a grain of a mask; see `Grain.from_mask`."""
    if keep not in ("error", "largest"):
        raise ValueError(f"keep='{keep}' is not known: use 'error' or 'largest'.")
    size = VoxelSize.parse(voxel_size, unit)
    inside = _boolean(np.asarray(mask), name)
    pieces, counts = pieces_of(inside)
    if len(counts) > 1:
        if keep == "error":
            raise GrainError(
                f"The mask of '{name}' holds {len(counts)} separate pieces "
                f"({', '.join(str(count) for count in sorted(counts, reverse=True)[:4])} voxels, ...): "
                "a grain is one piece; pass keep='largest' to take the largest."
            )
        inside = pieces == 1 + int(counts.argmax())
    box = bounding_box(inside)
    inside = inside[box].copy()
    cavity = 0
    if fill_cavities:
        filled = without_cavities(inside)
        cavity = int(np.count_nonzero(filled)) - int(np.count_nonzero(inside))
        if cavity:
            warnings.warn(
                f"The mask of '{name}' had enclosed cavities of {cavity} voxels, which were filled; "
                "pass fill_cavities=False here and cavities='keep' to the fit to keep them.",
                GrainWarning,
                stacklevel=3,
            )
            inside = filled
    inside.flags.writeable = False
    corner = size.positions(np.array([[part.start for part in box]]), origin)[0]
    place = (float(corner[0]), float(corner[1]), float(corner[2]))
    return Grain(inside, size, place, label, touches_border, name, filled_voxels=cavity)


def _boolean(mask: np.ndarray, name: str) -> Bool[np.ndarray, "Z Y X"]:
    """Return the mask as booleans; GrainError unless it is 3-D, two-valued and not empty."""
    if mask.ndim != 3 or 0 in mask.shape:
        raise GrainError(
            f"The mask of '{name}' has shape {mask.shape}: it needs three axes (z, y, x), none empty."
        )
    if mask.dtype.kind not in "buif":
        raise GrainError(f"The mask of '{name}' holds {mask.dtype}: use booleans.")
    if mask.dtype != bool:
        if mask.dtype.kind == "f" and not np.isfinite(mask).all():
            raise GrainError(f"The mask of '{name}' holds values that are not finite: use booleans.")
        high = mask.max()
        if not ((mask == 0) | (mask == high)).all():
            raise GrainError(
                f"The mask of '{name}' holds more than 0 and one other value: pass booleans, "
                "for example labels == 7 or grey > threshold."
            )
        mask = mask != 0
    if not mask.any():
        raise GrainError(f"The mask of '{name}' is empty: no voxel belongs to the grain.")
    return mask


def grain_from_mesh(
    mesh: str | Path | trimesh.Trimesh,
    resolution: int = 120,
    unit: str | None = None,
    name: str | None = None,
) -> Grain:
    """Make a grain of a closed surface mesh; see `Grain.from_mesh`."""
    if int(resolution) != resolution or not 4 <= resolution <= 2000:
        raise GrainError(
            f"resolution={resolution} is impossible: give a whole number of voxels from 4 to 2000."
        )
    body, source = _loaded(mesh)
    unit = unit or body.units
    if not unit:
        raise UnitError(f"{source} does not say its unit: give unit, for example unit='mm'.")
    unit = parse_unit(unit)
    body = _closed(body, source)
    low, high = body.bounds
    edge = float((high - low).max()) / int(resolution)
    counts = np.maximum(np.ceil((high - low) / edge - 1e-9).astype(int), 1)
    first = (low + high) / 2 - edge * (counts - 1) / 2
    inside = voxelise(
        body.vertices, body.faces, first, edge, (int(counts[2]), int(counts[1]), int(counts[0]))
    )
    if not inside.any():
        raise GrainError(
            f"{source} is too thin for a resolution of {resolution} voxels: raise the resolution."
        )
    _, sizes = pieces_of(inside)
    if len(sizes) > 1:
        lost = 1 - sizes.max() / sizes.sum()
        warnings.warn(
            f"{source} falls into {len(sizes)} pieces at a resolution of {resolution} voxels; "
            f"the largest was kept and {lost:.2%} of the volume dropped: raise the resolution.",
            GrainWarning,
            stacklevel=3,
        )
    title = name or (Path(mesh).stem if isinstance(mesh, str | Path) else "grain")
    origin = (float(first[0]), float(first[1]), float(first[2]))
    size = VoxelSize(edge, edge, edge, unit)
    # A cavity here would be a tunnel narrower than a voxel, closed by the sampling: fill it.
    return grain_from_mask(without_cavities(inside), size, origin=origin, keep="largest", name=title)


def _loaded(mesh: str | Path | trimesh.Trimesh) -> tuple[trimesh.Trimesh, str]:
    """Return the mesh, its equal corners merged, and what to call it in messages."""
    import trimesh

    if isinstance(mesh, trimesh.Trimesh):
        return trimesh.Trimesh(
            mesh.vertices, mesh.faces, process=True, metadata=dict(mesh.metadata)
        ), "The mesh"
    path = Path(mesh)
    if not path.is_file():
        raise MeshError(f"{path} does not exist: check the name and the folder.")
    try:
        body = trimesh.load(path, force="mesh", process=True)
    except Exception as error:  # the parsers of the formats raise errors of many unrelated types
        raise MeshError(f"{path} cannot be read as a surface mesh ({error}): use STL, OBJ or PLY.") from error
    if not isinstance(body, trimesh.Trimesh) or not len(body.faces):
        raise MeshError(f"{path} holds no triangles: export the grain's surface as STL, OBJ or PLY.")
    return body, str(path)


def _closed(mesh: trimesh.Trimesh, source: str) -> trimesh.Trimesh:
    """Return the mesh with outward normals; MeshError unless it is one closed body."""
    if not np.isfinite(mesh.vertices).all():
        raise MeshError(f"{source} has corners that are not finite numbers: export it again.")
    mesh.merge_vertices()
    mesh.update_faces(mesh.nondegenerate_faces())
    mesh.update_faces(mesh.unique_faces())
    _, uses = np.unique(mesh.edges_sorted, axis=0, return_counts=True)
    open_edges, crowded = int(np.count_nonzero(uses == 1)), int(np.count_nonzero(uses > 2))
    if not len(uses) or open_edges:
        raise MeshError(
            f"{source} is not closed: {open_edges} open edges bound its holes; "
            "close them first, for example in MeshLab with Filters > Remeshing > Close Holes, "
            "or take a grain whose whole surface was scanned."
        )
    if crowded:
        raise MeshError(
            f"{source} is not the surface of one body: {crowded} edges are shared by more than two "
            "triangles; remove inner faces first, "
            "for example in MeshLab with Filters > Cleaning > Repair non Manifold Edges."
        )
    if mesh.body_count > 1:
        raise MeshError(f"{source} holds {mesh.body_count} separate bodies: save each grain as its own file.")
    if not mesh.is_winding_consistent:
        import trimesh.repair

        trimesh.repair.fix_winding(mesh)
    if mesh.volume < 0:
        mesh.invert()
    if not mesh.is_winding_consistent or mesh.volume <= 0:
        raise MeshError(f"{source} encloses no volume: check that its triangles form one closed body.")
    return mesh
