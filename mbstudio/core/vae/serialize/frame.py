"""The common frame of serialized bodies: centroid, principal axes, nominal diameter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from mbstudio.core.errors import MeasureError, MeshError, SerializationError, UnitError
from mbstudio.core.formulas import nominal_diameters
from mbstudio.core.grains.grain import Grain
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.metrics.mass import mass_properties

if TYPE_CHECKING:
    import trimesh

    Body = Grain | Avatar | trimesh.Trimesh


@dataclass(frozen=True, eq=False)
class PrincipalFrame:
    """Where a body is, how it lies and how large it is.

    Attributes
    ----------
    center : float array, shape (3,)
        Centre of volume (x, y, z) in `unit`, in the body's own frame.
    axes : float array, shape (3, 3)
        Long, middle and short principal axis of inertia as columns, right-handed.
    diameter : float
        Nominal diameter D_n in `unit`.
    unit : str
    """

    center: Float[np.ndarray, " 3"]
    axes: Float[np.ndarray, "3 3"]
    diameter: float
    unit: str

    def shape_points(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
        """Return points of the body's own frame in the principal frame, in D_n."""
        local: np.ndarray = (np.asarray(points) - self.center) @ self.axes / self.diameter
        return local

    def body_points(self, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
        """Return points of the principal frame (in D_n) in the body's own frame and unit."""
        world: np.ndarray = np.asarray(points) @ self.axes.T * self.diameter + self.center
        return world


def body_name(body: Body, place: int) -> str:
    """Return what a body is called, with its place in the sequence where it carries no name of its own."""
    name = getattr(body, "name", None)
    if not name and hasattr(body, "metadata"):
        name = body.metadata.get("file_name") or body.metadata.get("name")
    if isinstance(body, Grain) and body.name == "grain":
        name = f"grain {body.label}" if body.label is not None else None
    if isinstance(body, Avatar) and body.name == "avatar":
        name = f"avatar {body.label}" if body.label is not None else None
    return str(name) if name else f"body {place}"


def principal_frame(body: Body, *, unit: str | None = None, name: str = "The body") -> PrincipalFrame:
    """Return centroid, principal axes and nominal diameter of a grain, a closed mesh or an avatar.

    Parameters
    ----------
    body : Grain, Avatar or trimesh.Trimesh
    unit : str, optional
        Length unit of a mesh that carries none.
    name : str
        What to call the body in messages.

    Raises
    ------
    SerializationError
        If the body has no volume, is flat or a row of voxels, is not closed, or carries no unit.
    """
    try:
        mass = mass_properties(body, 1.0, unit=unit)
    except (MeasureError, MeshError, UnitError) as error:
        raise SerializationError(f"{name} has no principal frame: {error}") from error
    # Principal moments ascend, and the least belongs to the longest axis.
    return PrincipalFrame(mass.com, mass.rotation, float(nominal_diameters(mass.volume)), mass.unit)
