"""Parents kept as surfaces: closed, in the isotropic frame, with form and size beside them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int

from mbstudio.core.cloning.solid_moments import Faces, Points, make_isotropic, principal_form, solid_moments
from mbstudio.core.cloning.surface_bands import Smoothing
from mbstudio.core.errors import CloningError, GrainError, MeasureError, MeshError
from mbstudio.core.formulas import nominal_diameters
from mbstudio.core.grains.grain import Grain
from mbstudio.core.metrics.surfaces import check_mesh, pieces_and_voids
from mbstudio.core.metrics.voxel_surface import check_grain, voxel_outline
from mbstudio.core.units import parse_unit

if TYPE_CHECKING:
    import trimesh

MOST_FACES = 40_000
_LARGEST_ASPECT = 20.0
_MOST_SIMPLIFIED = 3e-3


@dataclass(frozen=True, eq=False)
class ParentSurface:
    """The surface of one true grain.

    Attributes
    ----------
    name : str
    vertices : float array, shape (v, 3)
        In the isotropic frame: the centre of volume at the origin, principal axes along x, y, z (the longest
        first), second moments those of the unit ball. Read-only.
    faces : int array, shape (f, 3)
        Wound outwards. Read-only.
    semi_axes : float array, shape (3,)
        Of the ellipsoid with the body's second moments, longest first, in D_n.
    diameter : float
        Nominal diameter D_n in `unit`.
    unit : str
    """

    name: str
    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    semi_axes: Float[np.ndarray, " 3"]
    diameter: float
    unit: str

    def __post_init__(self) -> None:
        for name, kind in (("vertices", np.float64), ("faces", np.int64), ("semi_axes", np.float64)):
            array = np.array(getattr(self, name), dtype=kind, order="C")
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @classmethod
    def from_mesh(cls, mesh: trimesh.Trimesh, name: str, unit: str | None = None) -> ParentSurface:
        """Return the surface of a closed mesh.

        Parameters
        ----------
        mesh : trimesh.Trimesh
        name : str
        unit : str, optional
            Length unit of a mesh that carries none.

        Raises
        ------
        CloningError
            If it is not closed, has no unit, is of several pieces, nearly flat, or of too many triangles that
            no simplification takes away.
        """
        stated = parse_unit(unit) if unit else mesh.units
        if not stated:
            raise CloningError(f"{name} carries no length unit: state one, such as unit='mm'.")
        try:
            mesh = check_mesh(mesh)
        except MeshError as error:
            raise CloningError(f"{name} cannot be a parent: {error}") from error
        vertices = np.asarray(mesh.vertices, dtype=np.float64)
        faces = np.asarray(mesh.faces, dtype=np.int64)
        pieces, voids = pieces_and_voids(vertices, faces)
        if pieces != 1 or voids:
            raise CloningError(
                f"{name} is of {pieces} pieces with {voids} voids, but a parent is one body without voids: "
                "separate or fill it."
            )
        return cls.from_surface(vertices, faces, name, stated)

    @classmethod
    def from_grain(cls, grain: Grain, name: str) -> ParentSurface:
        """Return the lightly smoothed surface of a grain's voxels, on which its factors are measured too.

        Raises
        ------
        CloningError
            If the grain is nearly flat, or has too few voxels to have a surface.
        """
        try:
            check_grain(grain)
            vertices, faces = voxel_outline(grain)
        except (GrainError, MeasureError) as error:
            raise CloningError(f"{name} cannot be a parent: {error}") from error
        return cls.from_surface(vertices, np.asarray(faces, dtype=np.int64), name, grain.voxel_size.unit)

    @classmethod
    def from_surface(
        cls, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], name: str, unit: str
    ) -> ParentSurface:
        """Return a surface that is known to be closed, in `unit`.

        Raises
        ------
        CloningError
            If it encloses no volume or is nearly flat.
        """
        moments = solid_moments(vertices, faces)
        if not moments.volume > 0:
            raise CloningError(f"{name} encloses no volume: its triangles are wound inwards or lie flat.")
        semi_axes, axes = principal_form(moments)
        if not semi_axes[0] < _LARGEST_ASPECT * semi_axes[2]:
            raise CloningError(
                f"{name} is more than {_LARGEST_ASPECT:.0f} times as long as thick: no warp keeps it whole."
            )
        diameter = float(nominal_diameters(moments.volume))
        if len(faces) > MOST_FACES:
            vertices, faces = _simplified(vertices, faces, diameter, name)
        turned = (vertices - moments.centre) @ axes / semi_axes
        # Once more, for what rounding left.
        isotropic, _ = make_isotropic(turned, faces)
        return cls(name, isotropic, faces, semi_axes / diameter, diameter, unit)

    @property
    def log_form(self) -> Float[np.ndarray, " 3"]:
        """Logarithms of the semi-axes over their geometric mean."""
        logs = np.log(self.semi_axes)
        form: np.ndarray = logs - logs.mean()
        return form

    @cached_property
    def details(self) -> Float[np.ndarray, "v 3"]:
        """What edges and roughness add to the body without them, in the isotropic frame; read-only."""
        layers = Smoothing(self.vertices, self.faces).layers(self.vertices)
        found: np.ndarray = layers[0] - layers[2]
        found.flags.writeable = False
        return found

    def body_vertices(self) -> Float[np.ndarray, "v 3"]:
        """Return the corners in the principal frame, in D_n."""
        vertices: np.ndarray = self.vertices * self.semi_axes
        return vertices

    def mesh(self) -> trimesh.Trimesh:
        """Return the body in its principal frame, in its unit."""
        import trimesh

        mesh = trimesh.Trimesh(self.body_vertices() * self.diameter, self.faces, process=False)
        mesh.units = self.unit
        mesh.metadata["name"] = self.name
        return mesh


def coarser(parent: ParentSurface, most: int | None) -> ParentSurface:
    """Return a stand-in of about so many triangles at most, or the parent where it has no more than that."""
    if most is None or len(parent.faces) <= most:
        return parent
    found = _with_fewer(parent.vertices, parent.faces, most, np.geomspace(1e-3, 5e-2, 8))
    if found is None:
        return parent
    isotropic, _ = make_isotropic(*found)
    return ParentSurface(parent.name, isotropic, found[1], parent.semi_axes, parent.diameter, parent.unit)


def _simplified(vertices: Points, faces: Faces, diameter: float, name: str) -> tuple[Points, Faces]:
    """Return a surface of fewer triangles, within 0.3 % of D_n of the old one."""
    found = _with_fewer(vertices, faces, MOST_FACES, np.geomspace(1e-4, _MOST_SIMPLIFIED, 6) * diameter)
    if found is not None:
        return found
    raise CloningError(
        f"{name} has {len(faces):,} triangles, more than {MOST_FACES:,}, and too rough a surface to do with "
        "fewer: simplify the mesh first."
    )


def _with_fewer(
    vertices: Points, faces: Faces, most: int, tolerances: Float[np.ndarray, " t"]
) -> tuple[Points, Faces] | None:
    """Return the surface with few enough triangles at the least tolerance, None where none is enough."""
    import manifold3d

    mesh = manifold3d.Mesh64(vertices.astype(np.float64), faces.astype(np.uint64))
    solid = manifold3d.Manifold(mesh)
    if solid.status() != manifold3d.Error.NoError:
        return None
    for tolerance in tolerances:
        simple = solid.simplify(float(tolerance))
        if simple.num_tri() <= most:
            found = simple.to_mesh64()
            return np.array(found.vert_properties)[:, :3], np.array(found.tri_verts).astype(np.int64)
    return None
