"""Lengths in voxels: the frame in which a twin is fitted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float64

from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.metaball.field import control_rows
from mbstudio.core.scan.scan import Scan
from mbstudio.core.units import conversion_factor


@dataclass(frozen=True, eq=False)
class Frame:
    """The frame of a scan: the edge of a cube of a voxel's volume is 1, and voxel [0, 0, 0] lies at 0.

    Attributes
    ----------
    edge : float
        Length of 1 in the scan's unit.
    spacing : float array, shape (3,)
        Edges of a voxel (x, y, z) in this frame: ones where voxels are cubes.
    origin : float array, shape (3,)
        Of the scan, (x, y, z) in its unit.
    unit : str
    """

    edge: float
    spacing: Float64[np.ndarray, "3"]
    origin: Float64[np.ndarray, "3"]
    unit: str

    @classmethod
    def of(cls, scan: Scan) -> Frame:
        """Return the frame of a scan."""
        edges = np.array(scan.voxel_size.xyz, dtype=np.float64)
        edge = float(np.cbrt(edges.prod()))
        return cls(edge, edges / edge, np.array(scan.origin, dtype=np.float64), scan.unit)

    def control_of(self, avatar: Avatar) -> Float64[np.ndarray, "4 n"]:
        """Return the control points of an avatar as rows x, y, z, k in this frame."""
        factor = conversion_factor(avatar.unit, self.unit) / self.edge
        return control_rows(avatar.centers * factor - self.origin / self.edge, avatar.weights * factor**2)

    def avatar_of(self, control: Float64[np.ndarray, "4 n"], label: int, name: str) -> Avatar:
        """Return an avatar over the scan from control points in this frame."""
        return Avatar(
            control[:3].T * self.edge + self.origin,
            control[3] * self.edge**2,
            self.unit,
            label=label,
            name=name,
        )

    def points_of(self, places: Float64[np.ndarray, "m 3"]) -> Float64[np.ndarray, "m 3"]:
        """Return points (x, y, z) of this frame in the scan's unit."""
        points: np.ndarray = places * self.edge + self.origin
        return points
