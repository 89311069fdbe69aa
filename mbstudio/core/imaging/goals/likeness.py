"""How like a grain its avatars are: overlap, farthest distance, errors of the shape factors."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from mbstudio.core.grains.grain import Grain
from mbstudio.core.imaging.preprocess import Cavities
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.metaball.field import field_on_grid
from mbstudio.core.metrics.surface_distance import VerticesFaces, hausdorff_distance

if TYPE_CHECKING:
    from mbstudio.core.metrics import ShapeFactors
    from mbstudio.core.metrics.bodies import MeasuredBody

_MOST_NODES = 30_000_000
_MESH_CELLS = 96


class Likeness:
    """A grain as that which avatars are compared with; what is known of it alone is found once.

    Parameters
    ----------
    grain : Grain
    cavities : {'fill', 'keep'}
        As in the fit: a solid avatar is to be compared with the grain whose cavities were filled.
    """

    def __init__(self, grain: Grain, cavities: Cavities = "fill") -> None:
        self.grain = _filled(grain) if cavities == "fill" else grain

    @cached_property
    def _measured(self) -> MeasuredBody:
        from mbstudio.core.metrics.bodies import prepare_measured_body

        return prepare_measured_body(self.grain)

    @cached_property
    def factors(self) -> ShapeFactors:
        """Shape factors of the grain; MeasureError where they are not defined."""
        from mbstudio.core.metrics.measuring import core_factors

        return core_factors(self._measured)

    @cached_property
    def box_directions(self) -> Float[np.ndarray, "3 3"]:
        """Directions of the edges of the grain's smallest box, as rows; MeasureError where it has none."""
        from mbstudio.core.metrics.measuring import smallest_box

        return smallest_box(self._measured).directions

    @cached_property
    def surface(self) -> VerticesFaces:
        """The grain's lightly smoothed surface, in its unit."""
        mesh = self.grain.surface_mesh()
        return np.asarray(mesh.vertices), np.asarray(mesh.faces)

    def factor_errors(self, avatar: Avatar) -> dict[str, float]:
        """Return the relative error of every factor, avatar over grain minus one, by name.

        The avatar's axes are measured along the edges of the grain's smallest box: where another box has
        nearly the same volume, the two bodies' own smallest ones could be different boxes, and their edges
        would not tell how like the bodies are. NaN where the grain's own value is zero.

        Raises
        ------
        MeasureError
            If the factors of the grain or of the avatar are not defined.
        """
        from mbstudio.core.metrics import FACTORS, measure

        true = self.factors
        ours = measure(avatar, unit=self.grain.unit, along=self.box_directions)
        pairs = {name: (getattr(ours, name), getattr(true, name)) for name in FACTORS.core}
        return {name: float(a / b - 1.0) if b else float("nan") for name, (a, b) in pairs.items()}

    def iou(self, avatar: Avatar) -> float:
        """Return the intersection over the union with the grain; see :func:`voxel_iou`."""
        return voxel_iou(avatar, self.grain)

    def hausdorff(self, avatar: Avatar) -> float:
        """Return the Hausdorff distance of the two surfaces over the grain's D_n.

        The grain's surface is its lightly smoothed one: that of the voxels has steps, which would count
        as an error of half a voxel and more. It lies up to half a voxel off a smooth body itself: less than
        that cannot be told from the voxels.
        """
        mesh = avatar.to(self.grain.unit).mesh(_MESH_CELLS)
        ours = np.asarray(mesh.vertices), np.asarray(mesh.faces)
        return hausdorff_distance(ours, self.surface) / self.grain.nominal_diameter


def _filled(grain: Grain) -> Grain:
    from mbstudio.core.grains.pieces import without_cavities

    mask = without_cavities(grain.mask)
    added = int(np.count_nonzero(mask)) - grain.voxel_count
    return replace(grain, mask=mask, filled_voxels=grain.filled_voxels + added) if added else grain


def voxel_iou(avatar: Avatar, grain: Grain, most_nodes: int = _MOST_NODES) -> float:
    """Return the volume that avatar and grain share over that of their union, 0 to 1.

    Both are asked at the centres of the grain's voxels, and of the same lattice beyond them where the avatar
    sticks out. A body that is voxelised and compared with its own voxels has 1; shares of voxels would
    count the steps as errors.

    Parameters
    ----------
    avatar : Avatar
    grain : Grain
    most_nodes : int
        On larger lattices only every second, third ... voxel along each axis is asked.
    """
    avatar = avatar.to(grain.unit)
    shape, edges = np.array(grain.mask.shape), np.array(grain.voxel_size.xyz)
    low, high = (avatar.bounds() - np.asarray(grain.origin)) / edges
    before = np.maximum(0, np.ceil(-low)).astype(int)[::-1]
    after = np.maximum(0, np.ceil(high)[::-1].astype(int) - shape + 1)
    whole = shape + before + after
    stride = 1
    while np.prod(-(-whole // stride).astype(float)) > most_nodes:
        stride += 1
    # The nodes taken are those of the grain's own voxels, from the first on.
    skipped = (-before) % -stride
    counts = -(-(whole + skipped) // stride)
    first = np.asarray(grain.origin) + (skipped - before)[::-1] * edges
    nodes = (int(counts[0]), int(counts[1]), int(counts[2]))
    inside = field_on_grid(first, stride * edges, nodes, avatar.control) >= 1.0
    places = [
        np.arange(count) * stride + skip - less
        for count, skip, less in zip(nodes, skipped, before, strict=True)
    ]
    within = [
        np.flatnonzero((place >= 0) & (place < side)) for place, side in zip(places, shape, strict=True)
    ]
    mask = np.zeros(nodes, dtype=bool)
    taken = np.ix_(*(place[chosen] for place, chosen in zip(places, within, strict=True)))
    mask[np.ix_(*within)] = np.asarray(grain.mask)[taken] > 0
    union = int(np.count_nonzero(inside | mask))
    return int(np.count_nonzero(inside & mask)) / union if union else 0.0
