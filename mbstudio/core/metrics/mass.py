"""Mass properties of grains, meshes and avatars: voxel sums, or signed tetrahedra, exact for a mesh."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from mbstudio.core.errors import MeasureError
from mbstudio.core.grains.grain import Grain
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.metrics.surfaces import avatar_surface, check_mesh
from mbstudio.core.units import METRES_PER_UNIT, conversion_factor, parse_unit

if TYPE_CHECKING:
    import trimesh


@dataclass(frozen=True, eq=False)
class MassProperties:
    """Mass properties of a homogeneous body.

    Attributes
    ----------
    volume : float
        In unit**3.
    mass : float
        In kg.
    com : float array, shape (3,)
        Centre of mass (x, y, z) in unit, in the body's frame.
    inertia : float array, shape (3, 3)
        Inertia tensor about the centre of mass in the body's axes, in kg unit**2.
    principal : float array, shape (3,)
        Principal moments in ascending order, in kg unit**2.
    rotation : float array, shape (3, 3)
        Principal axes as columns, right-handed: ``x_body = com + rotation @ x_principal``.
    unit : str
    density : float
        In kg/m**3.
    """

    volume: float
    mass: float
    com: Float[np.ndarray, " 3"]
    inertia: Float[np.ndarray, "3 3"]
    principal: Float[np.ndarray, " 3"]
    rotation: Float[np.ndarray, "3 3"]
    unit: str
    density: float

    @property
    def quaternion(self) -> Float[np.ndarray, " 4"]:
        """The rotation as a unit quaternion (w, x, y, z), w >= 0."""
        from scipy.spatial.transform import Rotation

        x, y, z, w = Rotation.from_matrix(self.rotation).as_quat()
        return np.array([w, x, y, z]) * (1.0 if w >= 0 else -1.0)

    def to(self, unit: str) -> MassProperties:
        """Return the same body with lengths in another unit (mass stays in kg)."""
        f = conversion_factor(self.unit, unit)
        return MassProperties(
            self.volume * f**3, self.mass, self.com * f, self.inertia * f**2,
            self.principal * f**2, self.rotation, parse_unit(unit), self.density,
        )  # fmt: skip


def mass_properties(
    body: Grain | Avatar | trimesh.Trimesh, density: float, *, unit: str | None = None
) -> MassProperties:
    """Return volume, mass, centre of mass, inertia tensor and principal axes of a homogeneous body.

    An avatar is measured on two nested meshes whose vertices lie on its surface; their integrals
    are extrapolated (Richardson, error of order h**4), which is within 1e-4 of a fine quadrature. The
    voxels of a grain count as points of equal mass at their centres, which is unbiased for a body that was
    sampled at these centres (cubes would add h**2/12 to each second moment).

    Parameters
    ----------
    body : Grain, Avatar or trimesh.Trimesh
    density : float
        In kg/m**3.
    unit : str, optional
        Length unit of a mesh that carries none.

    Raises
    ------
    MeasureError
        If the density is not a positive finite number, or a grain is empty or a row of voxels.
    MeshError
        If the mesh is not closed.
    """
    if not (np.isfinite(density) and density > 0):
        raise MeasureError(
            f"A density of {density:g} kg/m3 is impossible: give a positive number such as 2650."
        )
    if isinstance(body, Avatar):
        surface = avatar_surface(body)
        origin = surface.fine[0].mean(axis=0)
        coarse = volume_integrals(surface.coarse[0] - origin, surface.coarse[1])
        fine = volume_integrals(surface.fine[0] - origin, surface.fine[1])
        integrals = (4.0 * fine - coarse) / 3.0
        length_unit = body.unit
    elif isinstance(body, Grain):
        integrals, origin = voxel_integrals(body)
        length_unit = body.unit
    else:
        mesh = check_mesh(body)
        vertices = np.asarray(mesh.vertices)
        origin = vertices.mean(axis=0)
        integrals = volume_integrals(vertices - origin, np.asarray(mesh.faces))
        length_unit = mesh_unit(body, unit)
    return properties_of_integrals(integrals, origin, density, length_unit)


def mesh_unit(mesh: trimesh.Trimesh, unit: str | None) -> str:
    """Return the length unit of a mesh: its own, else the stated one; MeasureError if neither is there."""
    if mesh.units:
        return parse_unit(mesh.units)
    if unit is None:
        raise MeasureError("The mesh has no length unit: state it, for example unit='mm'.")
    return parse_unit(unit)


def volume_integrals(vertices: Float[np.ndarray, "v 3"], faces: np.ndarray) -> Float[np.ndarray, " 10"]:
    """Return the integrals of 1, x, y, z, xx, yy, zz, xy, yz, zx over the body, exact for a closed mesh.

    Sum over the tetrahedra between the origin and each face (signed volume).
    """
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    volumes = np.einsum("fi,fi->f", a, np.cross(b, c)) / 6.0
    total = a + b + c
    first = volumes @ total / 4.0
    second = np.zeros((3, 3))
    for corner in (a, b, c, total):
        second += np.einsum("f,fi,fj->ij", volumes, corner, corner)
    second /= 20.0
    return np.array(
        [
            volumes.sum(),
            *first,
            second[0, 0],
            second[1, 1],
            second[2, 2],
            second[0, 1],
            second[1, 2],
            second[2, 0],
        ]
    )


def voxel_integrals(grain: Grain) -> tuple[Float[np.ndarray, " 10"], Float[np.ndarray, " 3"]]:
    """Return the integrals of :func:`volume_integrals` of a voxel grain, and the origin they are about.

    Raises
    ------
    MeasureError
        If the grain has no voxels.
    """
    mask = grain.mask
    if not mask.any():
        raise MeasureError(f"'{grain.name}' has no voxels: there is nothing to measure.")
    # Three projections hold all second moments, and are read faster than the voxels' coordinates.
    along_z, along_y, along_x = (mask.sum(axis=axis, dtype=np.float64) for axis in range(3))
    z, y, x = (
        (np.arange(size) - (size - 1) / 2) * edge
        for size, edge in zip(mask.shape, grain.voxel_size.zyx, strict=True)
    )
    by_x, by_y, by_z = along_z.sum(axis=0), along_z.sum(axis=1), along_y.sum(axis=1)
    integrals = np.array([
        by_x.sum(), by_x @ x, by_y @ y, by_z @ z, by_x @ x**2, by_y @ y**2, by_z @ z**2,
        y @ along_z @ x, z @ along_x @ y, z @ along_y @ x,
    ])  # fmt: skip
    middle = np.array([(size - 1) / 2 for size in mask.shape])
    return integrals * grain.voxel_size.volume, grain.voxel_size.positions(middle[None], grain.origin)[0]


def properties_of_integrals(
    integrals: Float[np.ndarray, " 10"], origin: Float[np.ndarray, " 3"], density: float, unit: str
) -> MassProperties:
    """Return the mass properties that volume integrals about `origin` stand for.

    Raises
    ------
    MeasureError
        If the volume or a moment is not positive.
    """
    volume = float(integrals[0])
    if not volume > 0:
        raise MeasureError(f"The body has a volume of {volume:g}, so its mass properties are undefined.")
    offset = integrals[1:4] / volume
    xx, yy, zz, xy, yz, zx = integrals[4:]
    second = np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]]) - volume * np.outer(offset, offset)
    density_per_unit = density * METRES_PER_UNIT[unit] ** 3
    inertia = density_per_unit * (np.trace(second) * np.eye(3) - second)
    principal, axes = np.linalg.eigh(inertia)
    if principal[0] <= 0:
        raise MeasureError(
            "The body has a principal moment that is not positive: its surface is not that of a solid."
        )
    return MassProperties(
        volume=volume,
        mass=density_per_unit * volume,
        com=origin + offset,
        inertia=inertia,
        principal=principal,
        rotation=_canonical_axes(axes),
        unit=unit,
        density=float(density),
    )


def _canonical_axes(axes: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3 3"]:
    """Make the columns right-handed, with a sign that does not depend on rounding in the solver."""
    axes = axes.copy()
    for column in range(2):
        largest = np.abs(axes[:, column]).argmax()
        if axes[largest, column] < 0:
            axes[:, column] *= -1
    axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    return axes
