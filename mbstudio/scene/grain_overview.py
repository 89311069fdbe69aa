"""The overview of all grains, in which only what was corrected is built anew."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Int

from mbstudio.scene.grain_surfaces import overview_of_grains
from mbstudio.scene.label_net import ROUNDS, LabelNet, label_net, vertex_normals
from mbstudio.scene.surfaces import Surface

if TYPE_CHECKING:
    from mbstudio.core.grains import GrainSet

_REACH = ROUNDS + 2  # cells to which smoothing carries a change


@dataclass(frozen=True, eq=False)
class GrainOverview:
    """All grains as one surface, and what it takes to correct it.

    Attributes
    ----------
    grains : GrainSet
        That it shows.
    surface : Surface
    step : int
        Every so many voxels are drawn.
    labels : int array, shape (z, y, x)
        The labels of those voxels; empty for grains of meshes.
    homes : int array, shape (t, 3)
        Of each triangle the voxel (z, y, x), among those that are drawn, whose side it is.
    """

    grains: GrainSet
    surface: Surface
    step: int
    labels: Int[np.ndarray, "z y x"]
    homes: Int[np.ndarray, "t 3"]

    @classmethod
    def of(cls, grains: GrainSet, longest: int, most: int) -> GrainOverview:
        """Return the overview of grains.

        Parameters
        ----------
        longest, most : int
            As for :func:`~mbstudio.scene.grain_surfaces.overview_of_grains`.
        """
        if grains.meshes:
            nothing = np.zeros((0, 0, 0), dtype=np.int32)
            surface = overview_of_grains(grains, longest, most)
            return cls(grains, surface, 1, nothing, np.zeros((0, 3), dtype=np.int32))
        step = max(1, math.ceil(max(grains.label_volume.shape) / longest))
        labels = np.ascontiguousarray(grains.labels[::step, ::step, ::step])
        net = label_net(labels)
        return cls(grains, _surface(grains, net, step), step, labels, net.homes)

    def follows(self, grains: GrainSet) -> bool:
        """Return whether other grains came from these by corrections of few, which `updated` can put in."""
        changed = grains.changed_since(self.grains)
        return (
            not self.grains.meshes and changed is not None and len(changed) <= max(8, len(self.grains) // 4)
        )

    def updated(self, grains: GrainSet) -> GrainOverview:
        """Return the overview of grains that came from these by corrections."""
        changed = grains.changed_since(self.grains)
        if not changed:
            return GrainOverview(grains, self.surface, self.step, self.labels, self.homes)
        low, high = self._cells(grains, changed)
        labels = self.labels.copy()
        box = tuple(slice(a, b) for a, b in zip(low, high, strict=True))
        z, y, x = (slice(self.step * a, self.step * (b - 1) + 1) for a, b in zip(low, high, strict=True))
        labels[box] = grains.label_volume.read((z, y, x))[:: self.step, :: self.step, :: self.step]
        # What smoothing carries the change to is drawn anew, from as much again that stays where it was.
        around = [
            (max(a - 2 * _REACH, 0), min(b + 2 * _REACH, n))
            for a, b, n in zip(low, high, labels.shape, strict=True)
        ]
        corner = np.array([a for a, _ in around])
        net = label_net(labels[tuple(slice(a, b) for a, b in around)])
        homes = net.homes + corner.astype(net.homes.dtype)
        ends = low - _REACH, high + _REACH
        renewed, kept = _lies_within(homes, *ends), ~_lies_within(self.homes, *ends)
        local = _surface(grains, net, self.step, corner)
        assert local.labels is not None
        assert self.surface.labels is not None
        surface = _joined(_part(self.surface, self.surface.labels, kept), _part(local, local.labels, renewed))
        return GrainOverview(
            grains, surface, self.step, labels, np.concatenate([self.homes[kept], homes[renewed]])
        )

    def _cells(
        self, grains: GrainSet, changed: frozenset[int]
    ) -> tuple[Int[np.ndarray, "3"], Int[np.ndarray, "3"]]:
        """Return the drawn voxels (z, y, x), half open, among which labels may have changed."""
        lows, highs = [], []
        for table in (self.grains.table, grains.table):
            rows = table[table["label"].isin(changed)]
            if len(rows):
                lows.append(rows[["z0", "y0", "x0"]].to_numpy().min(axis=0))
                highs.append(rows[["z1", "y1", "x1"]].to_numpy().max(axis=0))
        low, high = np.min(lows, axis=0) // self.step, -(-np.max(highs, axis=0) // self.step)
        return low.astype(int), np.minimum(high, self.labels.shape).astype(int)


def _surface(
    grains: GrainSet, net: LabelNet, step: int, corner: Int[np.ndarray, "3"] | None = None
) -> Surface:
    places = net.points if corner is None else net.points + corner[::-1]
    points = places * (np.array(grains.voxel_size.xyz) * step) + np.asarray(grains.origin)
    normals = vertex_normals(points, net.triangles)
    return Surface(points.astype(np.float32), net.triangles, normals, net.labels)


def _lies_within(
    homes: Int[np.ndarray, "t 3"], low: Int[np.ndarray, "3"], high: Int[np.ndarray, "3"]
) -> Bool[np.ndarray, " t"]:
    return np.asarray(((homes >= low) & (homes < high)).all(axis=1))


def _part(surface: Surface, labels: Int[np.ndarray, " t"], kept: Bool[np.ndarray, " t"]) -> Surface:
    """Return some triangles of a surface with the vertices that they use."""
    triangles = surface.triangles[kept]
    used = np.zeros(len(surface.points), dtype=bool)
    used[triangles] = True
    number = np.cumsum(used) - 1
    return Surface(
        surface.points[used], number[triangles], surface.normals[used], labels[kept].astype(np.int32)
    )


def _joined(one: Surface, other: Surface) -> Surface:
    assert one.labels is not None
    assert other.labels is not None
    return Surface(
        np.concatenate([one.points, other.points]),
        np.concatenate([one.triangles, other.triangles + len(one.points)]),
        np.concatenate([one.normals, other.normals]),
        np.concatenate([one.labels, other.labels]),
    )
