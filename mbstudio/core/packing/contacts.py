"""Contacts of a packing, found on the clumps at their poses and not taken from an engine."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from mbstudio.core.packing.grain_kinds import GrainKinds
from mbstudio.core.packing.mould import Mould
from mbstudio.core.packing.poses import Poses

FLOOR, SIDE = -1, -2
"""What stands in the place of the second grain where a grain touches the mould."""


@dataclass(frozen=True, eq=False)
class Contacts:
    """Pairs of grains that touch, each once, however many of their spheres do; and grains on the mould.

    Attributes
    ----------
    pairs : int array, shape (contacts, 2)
        Grains, the lower number first; for the mould `FLOOR` or `SIDE` in the second place.
    points : float array, shape (contacts, 3)
        Where, the mean over the spheres that touch, weighted by overlap.
    normals : float array, shape (contacts, 3)
        Unit vectors from the first grain to the second.
    overlaps : float array, shape (contacts,)
        The largest overlap of two spheres, or of a sphere and a wall.
    forces : float array, shape (contacts,)
        Magnitudes over the mean weight of a grain, where an engine has told them; else NaN.
    """

    pairs: Int[np.ndarray, "contacts 2"]
    points: Float[np.ndarray, "contacts 3"]
    normals: Float[np.ndarray, "contacts 3"]
    overlaps: Float[np.ndarray, " contacts"]
    forces: Float[np.ndarray, " contacts"]

    @property
    def among_grains(self) -> Bool[np.ndarray, " contacts"]:
        """Which contacts are between two grains."""
        among: np.ndarray = self.pairs[:, 1] >= 0
        return among

    def neighbours(self, count: int) -> Int[np.ndarray, " count"]:
        """Return how many others each of `count` grains touches."""
        return np.bincount(self.pairs[self.among_grains].ravel(), minlength=count)

    def with_forces(self, pairs: Int[np.ndarray, "m 2"], forces: Float[np.ndarray, " m"]) -> Contacts:
        """Return the contacts with forces by pairs of grains; those that are not named carry none."""
        told = {(int(a), int(b)): float(force) for (a, b), force in zip(pairs, forces, strict=True)}
        found = np.array([told.get((int(a), int(b)), 0.0) for a, b in self.pairs])
        return Contacts(self.pairs, self.points, self.normals, self.overlaps, found)


def find_contacts(kinds: GrainKinds, poses: Poses, mould: Mould, gap: float = 0.0) -> Contacts:
    """Return the contacts of grains with each other and with the mould.

    Parameters
    ----------
    kinds : GrainKinds
    poses : Poses
        In the unit of the kinds.
    mould : Mould
    gap : float
        How far apart spheres may be and still count as touching: for poses that were rounded.
    """
    spheres = [_placed(kinds, poses, index) for index in range(len(poses))]
    rows: list[tuple[int, int, np.ndarray, np.ndarray, float]] = []
    for first, second, shift in _candidates(kinds, poses, mould, gap):
        found = _touching(spheres[first], spheres[second] + np.append(shift, 0.0), gap)
        if found is not None:
            rows.append((first, second, *found))
    rows += _on_mould(spheres, mould, gap)
    if not rows:
        empty = np.zeros((0, 3))
        return Contacts(np.zeros((0, 2), dtype=int), empty, empty, np.zeros(0), np.zeros(0))
    pairs, points, normals, overlaps = (
        np.array([row[:2] for row in rows]),
        np.array([row[2] for row in rows]),
        np.array([row[3] for row in rows]),
        np.array([row[4] for row in rows]),
    )
    return Contacts(pairs, points, normals, overlaps, np.full(len(rows), np.nan))


def _placed(kinds: GrainKinds, poses: Poses, index: int) -> Float[np.ndarray, "n 4"]:
    """Return the spheres of one grain in the mould, x, y, z, r."""
    clump, scale = kinds.clumps[poses.kinds[index]], poses.scales[index]
    centers = scale * clump.centers @ poses.rotations[index].T + poses.positions[index]
    return np.column_stack([centers, scale * clump.radii])


def _candidates(
    kinds: GrainKinds, poses: Poses, mould: Mould, gap: float
) -> Iterator[tuple[int, int, Float[np.ndarray, " 3"]]]:
    """Yield pairs of grains whose bounding spheres meet, and what brings the second beside the first."""
    reaches = kinds.reaches[poses.kinds] * poses.scales
    width = 2 * mould.half
    places, size = poses.positions, None
    if mould.periodic:
        places = places.copy()
        places[:, :2] %= width
        size = [width, width, 0.0]
    near = cKDTree(places, boxsize=size).query_pairs(2 * float(reaches.max()) + gap, output_type="ndarray")
    near = near[np.lexsort((near[:, 1], near[:, 0]))]
    shifts = np.zeros((len(near), 3))
    apart = poses.positions[near[:, 1]] - poses.positions[near[:, 0]]
    if mould.periodic:
        shifts[:, :2] = -width * np.round(apart[:, :2] / width)
    meet = np.linalg.norm(apart + shifts, axis=1) < reaches[near].sum(axis=1) + gap
    for (first, second), shift in zip(near[meet].tolist(), shifts[meet], strict=True):
        yield first, second, shift


def _touching(
    a: Float[np.ndarray, "n 4"], b: Float[np.ndarray, "m 4"], gap: float
) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, " 3"], float] | None:
    """Return point, normal from a to b and largest overlap of two clumps; None if they do not touch."""
    apart = b[None, :, :3] - a[:, None, :3]
    distances = np.sqrt((apart**2).sum(axis=-1))
    overlaps = a[:, None, 3] + b[None, :, 3] - distances
    i, j = np.nonzero(overlaps > -gap)
    if not len(i):
        return None
    normals = apart[i, j] / np.maximum(distances[i, j], 1e-300)[:, None]
    depths = overlaps[i, j]
    points = a[i, :3] + normals * (a[i, 3] - depths / 2)[:, None]
    weights = np.maximum(depths + gap, 1e-12 * a[i, 3])
    normal = weights @ normals
    length = float(np.linalg.norm(normal))
    if length == 0.0:  # clumps that wrap around each other: take the deepest
        normal, length = normals[depths.argmax()], 1.0
    return weights @ points / weights.sum(), normal / length, float(depths.max())


def _on_mould(
    spheres: Sequence[Float[np.ndarray, "n 4"]], mould: Mould, gap: float
) -> list[tuple[int, int, np.ndarray, np.ndarray, float]]:
    """Return the contacts with floor and side walls, one for each grain and wall that touch."""
    rows: list[tuple[int, int, np.ndarray, np.ndarray, float]] = []
    sides = [] if mould.periodic else [np.append(normal, 0.0) for normal in mould.normals]
    walls = [(FLOOR, np.array([0.0, 0.0, 1.0]), 0.0), *((SIDE, normal, mould.half) for normal in sides)]
    for index, balls in enumerate(spheres):
        for name, inward, offset in walls:
            depths = balls[:, 3] - (balls[:, :3] @ inward + offset)
            deepest = int(depths.argmax())
            if depths[deepest] > -gap:
                ball, depth = balls[deepest], float(depths[deepest])
                rows.append((index, name, ball[:3] - inward * (ball[3] - depth / 2), -inward, depth))
    return rows
