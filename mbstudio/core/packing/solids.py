"""How much of a packing is solid, counted at points on the avatars themselves and not on their clumps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, UInt8

from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.packing.grain_kinds import GrainKinds
from mbstudio.core.packing.mould import Mould
from mbstudio.core.packing.poses import Poses


@dataclass(frozen=True, eq=False)
class SolidGrid:
    """Points of a regular grid over a mould, each with the number of grains that hold it.

    Attributes
    ----------
    counts : uint8 array, shape (z, y, x)
    origin : float array, shape (3,)
        The first point (x, y, z).
    spacing : float
    mould : Mould
    """

    counts: UInt8[np.ndarray, "z y x"]
    origin: Float[np.ndarray, " 3"]
    spacing: float
    mould: Mould

    @property
    def heights(self) -> Float[np.ndarray, " z"]:
        """Heights of the layers of points."""
        heights: np.ndarray = self.origin[2] + self.spacing * np.arange(self.counts.shape[0])
        return heights

    @property
    def wall_distances(self) -> Float[np.ndarray, "y x"]:
        """How far each column of points is from the nearest side wall."""
        y = self.origin[1] + self.spacing * np.arange(self.counts.shape[1])
        x = self.origin[0] + self.spacing * np.arange(self.counts.shape[2])
        columns = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        return self.mould.wall_distance(columns).reshape(self.counts.shape[1:])

    def surface_heights(self) -> Float[np.ndarray, "y x"]:
        """Return the height of the highest solid point of each column; zero where there is none."""
        solid = self.counts > 0
        highest = solid.shape[0] - 1 - solid[::-1].argmax(axis=0)
        tops: np.ndarray = np.where(solid.any(axis=0), self.heights[highest] + self.spacing / 2, 0.0)
        return tops

    def porosity(self, columns: Bool[np.ndarray, "y x"], low: float, high: float) -> float:
        """Return the share of void among the points of some columns between two heights."""
        layers = (self.heights > low) & (self.heights < high)
        return 1.0 - float((self.counts[layers][:, columns] > 0).mean())

    def counted_twice(self, columns: Bool[np.ndarray, "y x"], low: float, high: float) -> float:
        """Return the share of the solid that two or more avatars hold."""
        layers = (self.heights > low) & (self.heights < high)
        chosen = self.counts[layers][:, columns]
        return float((chosen > 1).sum() / max(int((chosen > 0).sum()), 1))

    def porosity_by_height(self, columns: Bool[np.ndarray, "y x"]) -> Float[np.ndarray, " z"]:
        """Return the share of void of each layer."""
        shares: np.ndarray = 1.0 - (self.counts[:, columns] > 0).mean(axis=1)
        return shares

    def porosity_by_wall_distance(
        self, low: float, high: float, step: float
    ) -> tuple[Float[np.ndarray, " rings"], Float[np.ndarray, " rings"]]:
        """Return distances from the side walls, rising in steps, and the share of void around each."""
        layers = (self.heights > low) & (self.heights < high)
        solid = (self.counts[layers] > 0).mean(axis=0)
        distances = self.wall_distances
        within = np.isfinite(distances) & (distances > 0)
        rings = (distances[within] / step).astype(int)
        sums, numbers = np.bincount(rings, solid[within]), np.bincount(rings)
        there = numbers > 0
        middles = (np.arange(len(numbers)) + 0.5) * step
        return middles[there], 1.0 - sums[there] / numbers[there]


def count_solids(kinds: GrainKinds, poses: Poses, mould: Mould, spacing: float) -> SolidGrid:
    """Count for each point of a grid over the mould how many avatars hold it.

    Parameters
    ----------
    kinds : GrainKinds
    poses : Poses
        In the unit of the kinds.
    mould : Mould
    spacing : float
        Of the points.
    """
    across = int(np.ceil(2 * mould.half / spacing))
    step = 2 * mould.half / across
    reaches = kinds.reaches[poses.kinds] * poses.scales * 1.05
    top = float((poses.positions[:, 2] + reaches).max())
    counts = np.zeros((int(np.ceil(top / step)) + 1, across, across), dtype=np.uint8)
    origin = np.array([-mould.half + step / 2, -mould.half + step / 2, step / 2])
    boxes = [avatar.bounds() for avatar in kinds.avatars]
    for kind, scale, place, turn in zip(
        poses.kinds, poses.scales, poses.positions, poses.rotations, strict=True
    ):
        for shift in _images(place, float(reaches.max()), mould):
            _add(counts, origin, step, kinds.avatars[kind], boxes[kind], scale, place + shift, turn)
    return SolidGrid(counts, origin, step, mould)


def _images(place: Float[np.ndarray, " 3"], reach: float, mould: Mould) -> list[Float[np.ndarray, " 3"]]:
    """Return the shifts by which a grain is seen again across periodic sides; always its own, zero."""
    if not mould.periodic:
        return [np.zeros(3)]
    width = 2 * mould.half
    steps = [
        [step for step in (-1, 0, 1) if abs(place[axis] + step * width) < mould.half + reach]
        for axis in range(2)
    ]
    return [np.array([x * width, y * width, 0.0]) for x in steps[0] for y in steps[1]]


def _add(
    counts: UInt8[np.ndarray, "z y x"],
    origin: Float[np.ndarray, " 3"],
    step: float,
    avatar: Avatar,
    box: Float[np.ndarray, "2 3"],
    scale: float,
    place: Float[np.ndarray, " 3"],
    turn: Float[np.ndarray, "3 3"],
) -> None:
    """Count one grain at the points of its own box."""
    middle, extent = scale * box.mean(axis=0), scale * (box[1] - box[0]) / 2
    center, reach = place + turn @ middle, np.abs(turn) @ extent
    shape = np.array(counts.shape)[::-1]
    first = np.maximum(np.ceil((center - reach - origin) / step).astype(int), 0)
    last = np.minimum(np.floor((center + reach - origin) / step).astype(int), shape - 1)
    if (last < first).any():
        return
    x, y, z = (origin[axis] + step * np.arange(first[axis], last[axis] + 1) for axis in range(3))
    points = np.stack(np.meshgrid(z, y, x, indexing="ij"), axis=-1).reshape(-1, 3)[:, ::-1]
    local = (points - place) @ turn / scale
    near = ((local >= box[0]) & (local <= box[1])).all(axis=1)
    inside = np.zeros(len(points), dtype=bool)
    inside[near] = avatar.contains(local[near])
    block = counts[first[2] : last[2] + 1, first[1] : last[1] + 1, first[0] : last[0] + 1]
    block += inside.reshape(block.shape)
