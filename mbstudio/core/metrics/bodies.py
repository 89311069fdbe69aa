"""What factors are computed from: any body as a closed surface with its volume, area and second moments."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from jaxtyping import Float

from mbstudio.core.errors import MeasureError
from mbstudio.core.grains.grain import Grain
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.metrics.crofton import corrected_crofton_area
from mbstudio.core.metrics.mass import volume_integrals, voxel_integrals
from mbstudio.core.metrics.surfaces import VerticesFaces, avatar_surface, check_mesh, surface_area
from mbstudio.core.metrics.voxel_surface import check_grain, voxel_outline
from mbstudio.core.threads import one_thread
from mbstudio.core.units import parse_unit

if TYPE_CHECKING:
    import trimesh

UNITLESS = "unitless"

VoxelSurface = Literal["crofton", "smoothed"]


@dataclass(frozen=True, eq=False)
class MeasuredBody:
    """A body ready to be measured.

    Attributes
    ----------
    volume : float
        In unit**3.
    area : float
        In unit**2.
    outline : tuple of vertices and faces
        Its closed surface, outward.
    coarse : tuple of vertices and faces, or None
        The mesh that the outline halves the edges of, both inscribed in a smooth body.
    second : float array, shape (3, 3)
        Second moments of the volume about its centre, over the volume, in unit**2.
    centre : float array, shape (3,)
        Centre of volume.
    unit : str
    surface : str
        As in `ShapeFactors`.
    warning : str
        What to mind; empty if nothing.
    voxel_edge : float
        Smallest edge of the voxels that the outline follows; 0 for an exact surface.
    """

    volume: float
    area: float
    outline: VerticesFaces
    coarse: VerticesFaces | None
    second: Float[np.ndarray, "3 3"]
    centre: Float[np.ndarray, " 3"]
    unit: str
    surface: str
    warning: str = ""
    voxel_edge: float = 0.0

    @property
    def own_length(self) -> float:
        """The power of two next below its longest side: scaling by it changes no digit."""
        return float(2.0 ** np.floor(np.log2(float(np.ptp(self.outline[0], axis=0).max()))))

    def scaled(self, factor: float) -> MeasuredBody:
        """Return the body with all lengths times `factor`."""
        (vertices, faces), coarse = self.outline, self.coarse
        return replace(
            self,
            volume=self.volume * factor**3,
            area=self.area * factor**2,
            outline=(vertices * factor, faces),
            coarse=None if coarse is None else (coarse[0] * factor, coarse[1]),
            second=self.second * factor**2,
            centre=self.centre * factor,
            voxel_edge=self.voxel_edge * factor,
        )


@one_thread()
def prepare_measured_body(
    body: Grain | Avatar | trimesh.Trimesh, unit: str | None = None, surface: VoxelSurface | None = None
) -> MeasuredBody:
    """Return a grain, avatar or mesh as what factors are computed from.

    Parameters
    ----------
    body : Grain, Avatar or trimesh.Trimesh
    unit : str, optional
        Unit of a mesh that carries none.
    surface : {"crofton", "smoothed"}, optional
        How the area of a grain is found; by default as :func:`default_surface` says.

    Raises
    ------
    MeshError
        If a mesh is not one closed body.
    MeasureError
        If the body is empty, flat, in several pieces, or a grain of less than 2 x 2 x 2 voxels.
    """
    if surface is not None and surface not in get_args(VoxelSurface):
        raise MeasureError(f"surface='{surface}' is not known: use 'crofton' or 'smoothed'.")
    if isinstance(body, Grain):
        return _prepare_grain(body, surface or default_surface(body))
    if isinstance(body, Avatar):
        return _prepare_avatar(body)
    return _prepare_mesh(body, unit)


def default_surface(grain: Grain) -> VoxelSurface:
    """Return how the area of a grain is found by default.

    Crofton's formula counts the roughness that noise leaves on a segmented outline as area; where there is
    none, it alone is right at edges (docs/shape-factors.md).
    """
    return "smoothed" if grain.segmented else "crofton"


def _prepare_avatar(avatar: Avatar) -> MeasuredBody:
    nested = avatar_surface(avatar)
    origin = nested.fine[0].mean(axis=0)
    coarse, fine = (
        volume_integrals(points - origin, faces) for points, faces in (nested.coarse, nested.fine)
    )
    areas = [surface_area(*mesh) for mesh in (nested.coarse, nested.fine)]
    volume, centre, second = _moments((4.0 * fine - coarse) / 3.0, origin)
    return MeasuredBody(
        volume, nested.extrapolate(*areas), nested.fine, nested.coarse, second, centre, avatar.unit, "avatar"
    )


def _prepare_grain(grain: Grain, surface: VoxelSurface) -> MeasuredBody:
    warning = check_grain(grain)
    outline = voxel_outline(grain)
    if surface == "crofton":
        area, stated = corrected_crofton_area(grain.mask, grain.voxel_size), "crofton voxels"
    else:
        area, stated = surface_area(*outline), "smoothed voxels"
    integrals, origin = voxel_integrals(grain)
    _, centre, second = _moments(integrals, origin)
    edge = float(min(grain.voxel_size.zyx))
    return MeasuredBody(grain.volume, area, outline, None, second, centre, grain.unit, stated, warning, edge)


def _prepare_mesh(mesh: trimesh.Trimesh, unit: str | None) -> MeasuredBody:
    mesh = check_mesh(mesh)
    vertices, faces = np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces)
    carried = parse_unit(mesh.units) if mesh.units else None
    stated = carried or (parse_unit(unit) if unit else UNITLESS)
    origin = vertices.mean(axis=0)
    volume, centre, second = _moments(volume_integrals(vertices - origin, faces), origin)
    area = surface_area(vertices, faces)
    return MeasuredBody(volume, area, (vertices, faces), None, second, centre, stated, "mesh")


def _moments(
    integrals: Float[np.ndarray, " 10"], origin: Float[np.ndarray, " 3"]
) -> tuple[float, Float[np.ndarray, " 3"], Float[np.ndarray, "3 3"]]:
    """Return volume, centre, and second moments about the centre over the volume."""
    volume = float(integrals[0])
    if not volume > 0:
        raise MeasureError("The body has no volume, so its shape factors are undefined.")
    offset = integrals[1:4] / volume
    xx, yy, zz, xy, yz, zx = integrals[4:] / volume
    second = np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]]) - np.outer(offset, offset)
    return volume, origin + offset, second
