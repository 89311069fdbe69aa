"""What a grain looks like that is several, or a part of one."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import edt
import numpy as np
from jaxtyping import Bool, Float, Int, Shaped
from scipy import ndimage
from scipy.spatial import ConvexHull, QhullError

from mbstudio.core.grains.editing.boxes import widened
from mbstudio.core.grains.editing.label_volume import Box, LabelVolume
from mbstudio.core.grains.flooding import split_by_necks
from mbstudio.core.scan.voxel_array import VoxelArray
from mbstudio.core.units import VoxelSize

_MARGIN = 3  # voxels about a grain, where the grey value of the void is taken
_LEAST_DEPTH = 0.5  # voxels; see segmentation
_LEAST_PART = 0.1  # of the volume: smaller parts are bumps
_NECKS = np.linspace(0.4, 0.99, 60)
_LEAST_SHARED = 0.05
_MOST_NEIGHBOURS = 3
_USUAL_GROOVE = 0.16  # of grains that touch; taken where too little of the surface is seen
_LONGEST = 48  # voxels along an edge at which hulls are made; larger grains are thinned


@dataclass(frozen=True)
class PairMeasures:
    """What a grain looks like beside a neighbour; shares and ratios.

    Attributes
    ----------
    neighbour : int
        The other grain; 0 for none.
    shared : float
        Share of the grain's border at the neighbour.
    waist : float
        Radius of the largest ball of both together about their border, over that of the largest ball in the
        smaller one: where two grains touch it is small.
    joint_solidity : float
        Solidity of both together over the mean of theirs.
    groove : float
        How much more solid lies about the rim of their border than about other places of their surface:
        grains that touch have a groove there, parts of one grain have none.
    border_contrast : float
        How much darker the border is than both grains, over the contrast to void; 0 without a scan.
    """

    neighbour: int = 0
    shared: float = 0.0
    waist: float = 0.0
    joint_solidity: float = 0.0
    groove: float = 0.0
    border_contrast: float = 0.0


@dataclass(frozen=True)
class GrainMeasures:
    """What is looked at; shares and ratios.

    Attributes
    ----------
    solidity : float
        Share of its convex hull that the grain fills.
    neck : float
        Width of the narrowest neck against the smaller of the parts that it joins; 1 where there is none.
    inner_contrast : float
        How much darker the neck is than the parts, over the contrast to void; 0 without a scan.
    pairs : tuple of PairMeasures
        With the neighbours that share most of its border.
    """

    solidity: float
    neck: float
    inner_contrast: float
    pairs: tuple[PairMeasures, ...] = ()


class GrainMeasuring:
    """Measures grains one by one, in boxes about them.

    Parameters
    ----------
    volume : LabelVolume
    boxes : mapping of int to Box
        By label.
    voxel_size : VoxelSize
    grey : VoxelArray, shape (Z, Y, X), optional
        The scan's voxels.
    """

    def __init__(
        self, volume: LabelVolume, boxes: dict[int, Box], voxel_size: VoxelSize, grey: VoxelArray | None
    ) -> None:
        self._volume, self._boxes, self._grey = volume, boxes, grey
        shortest = min(voxel_size.zyx)
        self._size = tuple(edge / shortest for edge in voxel_size.zyx)
        self._alone: dict[int, tuple[float, float]] = {}
        self._together: dict[tuple[int, int], PairMeasures] = {}

    def measure(self, label: int) -> GrainMeasures:
        """Return what a grain looks like."""
        box = widened(self._boxes[label], _MARGIN, self._volume.shape)
        labels = self._volume.read(box)
        inside = labels == label
        distance = self._distance(inside)
        neck, halves = _narrowest_neck(distance)
        grey = self._smoothed_grey(box)
        inner = self._contrast(grey, labels, inside, _between(halves)) if halves is not None else 0.0
        solidity = self._solidity_of(label, inside, distance)[0]
        pairs = [
            replace(self._pair(label, neighbour), neighbour=neighbour, shared=share)
            for neighbour, share in _neighbours(labels, inside)
        ]
        return GrainMeasures(solidity, neck, inner, tuple(pairs))

    def _pair(self, label: int, neighbour: int) -> PairMeasures:
        """Return what holds of two grains alike, looked at once."""
        key = (min(label, neighbour), max(label, neighbour))
        if key not in self._together:
            self._together[key] = self._compare(*key)
        return self._together[key]

    def _compare(self, label: int, neighbour: int) -> PairMeasures:
        """Return what holds of two grains alike."""
        one, other = self._boxes[label], self._boxes[neighbour]
        z, y, x = (slice(min(a.start, b.start), max(a.stop, b.stop)) for a, b in zip(one, other, strict=True))
        box = widened((z, y, x), _MARGIN, self._volume.shape)
        labels = self._volume.read(box)
        first, second = labels == label, labels == neighbour
        both = first | second
        solidity, radius = self._solidity_of(label, first)
        other_solidity, other_radius = self._solidity_of(neighbour, second)
        least = max(min(radius, other_radius), 1.0)
        meeting = (ndimage.binary_dilation(first) & second) | (ndimage.binary_dilation(second) & first)
        return PairMeasures(
            waist=float(self._distance(both)[meeting].max(initial=0.0)) / least,
            joint_solidity=2.0 * _solidity(both) / max(solidity + other_solidity, 1e-6),
            groove=_groove(both, labels == 0, meeting, least),
            border_contrast=self._contrast(self._smoothed_grey(box), labels, both, meeting),
        )

    def _solidity_of(
        self,
        label: int,
        inside: Bool[np.ndarray, "z y x"],
        distance: Float[np.ndarray, "z y x"] | None = None,
    ) -> tuple[float, float]:
        """Return solidity and radius of the largest ball of a grain, measured once."""
        if label not in self._alone:
            reach = self._distance(inside) if distance is None else distance
            self._alone[label] = _solidity(inside), float(reach.max())
        return self._alone[label]

    def _distance(self, inside: Bool[np.ndarray, "z y x"]) -> Float[np.ndarray, "z y x"]:
        distance: np.ndarray = edt.edt(
            np.ascontiguousarray(inside), anisotropy=self._size, black_border=False
        )
        np.nan_to_num(distance, copy=False, posinf=float(max(inside.shape)))
        reach: np.ndarray = np.maximum(distance - 0.5, 0.25).astype(np.float32) * inside
        return reach

    def _smoothed_grey(self, box: Box) -> Float[np.ndarray, "z y x"] | None:
        if self._grey is None:
            return None
        grey: np.ndarray = ndimage.gaussian_filter(np.asarray(self._grey[box]).astype(np.float32), 0.7)
        return grey

    def _contrast(
        self,
        grey: Shaped[np.ndarray, "z y x"] | None,
        labels: Int[np.ndarray, "z y x"],
        solid: Bool[np.ndarray, "z y x"],
        where: Bool[np.ndarray, "z y x"],
    ) -> float:
        """Return how much darker some voxels of solids are than their middles, over the contrast to void."""
        void = ndimage.binary_erosion(labels == 0, iterations=1)
        core = ndimage.binary_erosion(solid, iterations=2) & ~ndimage.binary_dilation(where, iterations=2)
        # At the outline every voxel is darker: only those deeper inside tell of a boundary.
        deep = where & ndimage.binary_erosion(labels > 0, iterations=2)
        if grey is None or min(np.count_nonzero(part) for part in (void, core, deep)) < 5:
            return 0.0
        middle, outside = float(np.median(grey[core])), float(np.median(grey[void]))
        if not (math.isfinite(middle) and math.isfinite(outside)) or middle == outside:
            return 0.0
        return float(np.clip((middle - float(grey[deep].mean())) / (middle - outside), -1.0, 1.0))


def _narrowest_neck(
    distance: Float[np.ndarray, "z y x"],
) -> tuple[float, Int[np.ndarray, "z y x"] | None]:
    """Return the least splitting that parts a grain in two of size, and the parts; else 1 and None."""
    landscape = np.ascontiguousarray(distance)
    found = _parted(landscape, float(_NECKS[-1]))
    if found is None:
        return 1.0, None
    low, high = 0, len(_NECKS) - 1
    while low < high:
        middle = (low + high) // 2
        parts = _parted(landscape, float(_NECKS[middle]))
        if parts is None:
            low = middle + 1
        else:
            high, found = middle, parts
    return float(_NECKS[high]), found


def _parted(landscape: Float[np.ndarray, "z y x"], splitting: float) -> Int[np.ndarray, "z y x"] | None:
    parts, count = split_by_necks(landscape, splitting, _LEAST_DEPTH)
    if count < 2:
        return None
    counts = np.sort(np.bincount(parts.ravel(), minlength=count + 1)[1:])
    return parts if counts[-2] >= _LEAST_PART * counts.sum() else None


def _between(parts: Int[np.ndarray, "z y x"]) -> Bool[np.ndarray, "z y x"]:
    """Return the voxels at which parts meet."""
    between = np.zeros(parts.shape, dtype=bool)
    for axis in range(3):
        low = [slice(None)] * 3
        high = [slice(None)] * 3
        low[axis], high[axis] = slice(None, -1), slice(1, None)
        one, other = parts[tuple(low)], parts[tuple(high)]
        meets = (one != other) & (one > 0) & (other > 0)
        between[tuple(low)] |= meets
        between[tuple(high)] |= meets
    return between


def _neighbours(
    labels: Int[np.ndarray, "z y x"], inside: Bool[np.ndarray, "z y x"]
) -> list[tuple[int, float]]:
    """Return the grains that share most faces with one, and their shares of all its faces."""
    met = []
    for axis in range(3):
        for step in (1, -1):
            beside = np.roll(labels, step, axis)
            from_edge = [slice(None)] * 3
            from_edge[axis] = slice(0, 1) if step == 1 else slice(-1, None)
            exposed = inside & (beside != labels)
            exposed[tuple(from_edge)] = False
            met.append(beside[exposed])
    faces = np.concatenate(met)
    others, counts = np.unique(faces[faces > 0], return_counts=True)
    most = np.argsort(-counts, kind="stable")[:_MOST_NEIGHBOURS]
    shares = counts / max(len(faces), 1)
    return [(int(others[k]), float(shares[k])) for k in most if shares[k] >= _LEAST_SHARED]


def _groove(
    both: Bool[np.ndarray, "z y x"],
    void: Bool[np.ndarray, "z y x"],
    meeting: Bool[np.ndarray, "z y x"],
    radius: float,
) -> float:
    """Return how much more solid lies about the rim of a border than about other places of the surface."""
    surface = ndimage.binary_dilation(void) & both
    rim = surface & meeting
    elsewhere = surface & ~ndimage.binary_dilation(meeting, iterations=3)
    if np.count_nonzero(rim) < 5 or np.count_nonzero(elsewhere) < 20:
        return _USUAL_GROOVE
    width = max(1.0, 0.35 * radius)
    solid = ndimage.gaussian_filter(both.astype(np.float32), width)
    known = ndimage.gaussian_filter((both | void).astype(np.float32), width)
    share = solid / np.maximum(known, 1e-3)
    return float(share[rim].mean() - np.median(share[elsewhere]))


def _solidity(mask: Bool[np.ndarray, "z y x"]) -> float:
    """Return the share of its convex hull that a mask fills, smoothed over a voxel."""
    step = max(1, -(-max(mask.shape) // _LONGEST))
    field = np.pad(mask[::step, ::step, ::step], 2).astype(np.float32)
    solid = ndimage.gaussian_filter(field, 1.0) > 0.5
    count = int(np.count_nonzero(solid))
    if count < 30:
        return 1.0
    # The ends of each row of voxels span the hull.
    any_row = solid.any(axis=2)
    z, y = np.nonzero(any_row)
    first = solid.argmax(axis=2)[any_row]
    last = solid.shape[2] - 1 - solid[:, :, ::-1].argmax(axis=2)[any_row]
    places = np.concatenate((np.column_stack((z, y, first)), np.column_stack((z, y, last))))
    try:
        hull = ConvexHull(places)
    except QhullError:
        return 1.0
    return min(1.0, count / float(hull.volume + 0.5 * hull.area))
