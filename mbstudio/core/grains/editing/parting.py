"""Making several grains of one: by seeds, or along a line."""

from __future__ import annotations

import math
from collections.abc import Sequence

import edt
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage

from mbstudio.core.errors import EditError
from mbstudio.core.grains.editing.boxes import Voxel
from mbstudio.core.grains.editing.label_volume import Box
from mbstudio.core.grains.editing.workbench import CRUMB_VOXELS, Workbench
from mbstudio.core.grains.flooding import split_by_necks

Point = tuple[float, float, float]
"""A place (z, y, x) in voxels."""

_MARGIN = 3  # voxels about the grain, from which the grey value of the void is taken
# Peaks that stand out less (in voxels) come from the voxel grid; see segmentation.
_LEAST_DEPTH = 0.5
# How much a boundary that only the grey values show lowers the landscape there.
_GREY_SHARE = 0.5


def split_by_seeds(bench: Workbench, label: int, seeds: Sequence[Voxel], by_grey: bool) -> None:
    """Part a grain by watershed from seeds; the largest part keeps its number.

    Voxels are flooded from the middle of the grain's parts outwards, by their distance to its surface and, if
    asked for, by grey value: the parts meet in the necks between the seeds, and where the scan shows a
    boundary.

    Raises
    ------
    EditError
        If there are fewer than two seeds, one lies outside the grain, or two lie in one basin.
    """
    bench.require((label,))
    if len(seeds) < 2:
        raise EditError(f"Grain {label} needs two seeds or more to be split, not {len(seeds)}.")
    for number, seed in enumerate(seeds, start=1):
        found = bench.label_at(seed, f"Seed {number} at")
        if found != label:
            where = f"in grain {found}" if found else "outside all grains"
            raise EditError(
                f"Seed {number} at (z, y, x) = {tuple(seed)} lies {where}, not in grain {label}: move "
                "it inside."
            )
    box = bench.box_with_margin(label, _MARGIN)
    inside = bench.read(box) == label
    landscape = _landscape(bench, box, inside, by_grey)
    places = [tuple(at - part.start for at, part in zip(seed, box, strict=True)) for seed in seeds]
    _require_own_basins(landscape, places, seeds)
    _write_parts(bench, label, box, _flood_from(landscape, inside, places), CRUMB_VOXELS)


def split_along_line(bench: Workbench, label: int, points: Sequence[Point], axis: int) -> None:
    """Part a grain along a line drawn across it, which goes on straight beyond its ends.

    Parameters
    ----------
    points : sequence of (z, y, x)
        Corners of the line; it extends along `axis` as a sheet, so that their places along it do not matter.
    axis : int
        The axis along which the line was looked at: 0, 1 or 2 for z, y, x.

    Raises
    ------
    EditError
        If the line has no two different corners, crosses itself, or leaves the grain in one part.
    """
    from skimage.measure import points_in_poly  # imported late: it takes a moment, and editing starts without

    bench.require((label,))
    if axis not in (0, 1, 2):
        raise EditError(f"axis={axis} is none: give 0, 1 or 2 for z, y or x.")
    across = [other for other in range(3) if other != axis]
    line = np.array([[point[other] for other in across] for point in points], dtype=float).reshape(-1, 2)
    line = line[np.r_[True, np.abs(np.diff(line, axis=0)).max(axis=1) > 1e-9]] if len(line) else line
    if len(line) < 2:
        raise EditError("A line to split along needs two different points or more.")
    box = bench.box(label)
    inside = bench.read(box) == label
    corner = np.array([[box[other].start for other in across]], dtype=float)
    shape = tuple(inside.shape[other] for other in across)
    outline = _half_plane(line - corner, shape)
    if _crosses_itself(outline):
        raise EditError("The line crosses itself: draw it across the grain once, without loops.")
    places = np.argwhere(np.ones(shape, dtype=bool)).astype(float)
    side = points_in_poly(places, outline).reshape(shape)
    parts = np.where(np.expand_dims(side, axis), 2, 1) * inside
    _write_parts(bench, label, box, parts, 0)


def _landscape(
    bench: Workbench, box: Box, inside: Bool[np.ndarray, "z y x"], by_grey: bool
) -> Float[np.ndarray, "z y x"]:
    """Return the height of voxels for the watershed: the distance to the surface, less at grey boundaries."""
    shortest = min(bench.voxel_size.zyx)
    # Beyond the scan and its field of view a grain goes on.
    solid = inside | ~bench.seen(box)
    distance: np.ndarray = edt.edt(
        np.ascontiguousarray(solid),
        anisotropy=tuple(edge / shortest for edge in bench.voxel_size.zyx),
        black_border=False,
    )
    np.nan_to_num(distance, copy=False, posinf=float(max(inside.shape)))
    distance = np.maximum(distance - 0.5, 0.25).astype(np.float32) * inside
    if not by_grey:
        return distance
    grey = ndimage.gaussian_filter(bench.grey(box).astype(np.float32), 1.0)
    void = (bench.read(box) == 0) & bench.seen(box)
    core = distance > 0.5 * distance.max()
    if not void.any():
        return distance
    solid_level, void_level = float(np.median(grey[core])), float(np.median(grey[void]))
    if not (math.isfinite(solid_level) and math.isfinite(void_level)) or solid_level == void_level:
        return distance
    share = np.clip((grey - void_level) / (solid_level - void_level), 0.0, 1.0)
    lowered: np.ndarray = (distance * ((1 - _GREY_SHARE) + _GREY_SHARE * share)).astype(np.float32)
    return lowered


def _require_own_basins(
    landscape: Float[np.ndarray, "z y x"], places: Sequence[tuple[int, ...]], seeds: Sequence[Voxel]
) -> None:
    """Refuse seeds between which the grain has no neck."""
    basins, _ = split_by_necks(np.ascontiguousarray(landscape), 1.0, _LEAST_DEPTH)
    first: dict[int, int] = {}
    for number, place in enumerate(places):
        basin = int(basins[place])
        if basin in first:
            other = first[basin]
            raise EditError(
                f"Seeds {other + 1} at {tuple(seeds[other])} and {number + 1} at {tuple(seeds[number])} lie "
                "in one basin, with no neck between them: move them apart, or split along a line drawn "
                "across the grain."
            )
        first[basin] = number


def _flood_from(
    landscape: Float[np.ndarray, "z y x"],
    inside: Bool[np.ndarray, "z y x"],
    places: Sequence[tuple[int, ...]],
) -> Int[np.ndarray, "z y x"]:
    from skimage.segmentation import watershed  # imported late, as above

    markers = np.zeros(inside.shape, np.int32)
    for number, place in enumerate(places, start=1):
        markers[place] = number
    parts: np.ndarray = watershed(-landscape, markers, mask=inside, connectivity=np.ones((3, 3, 3)))
    return parts


def _write_parts(
    bench: Workbench, label: int, box: Box, parts: Int[np.ndarray, "z y x"], smallest: int
) -> None:
    """Give the parts of a grain, numbered from 1, labels: the largest keeps that of the grain.

    Raises
    ------
    EditError
        If there is only one part, or one of no more than `smallest` voxels.
    """
    counts = np.bincount(parts.ravel())[1:]
    present = np.flatnonzero(counts) + 1
    if len(present) < 2:
        raise EditError(f"The line does not part grain {label}: draw it across the grain.")
    small = [int(number) for number in present if counts[number - 1] <= smallest]
    if small:
        raise EditError(
            f"The part of grain {label} about seed {small[0]} would have {int(counts[small[0] - 1])} voxels, "
            "too few for a grain: move the seed towards the middle of its part."
        )
    values = bench.read(box).copy()
    for number in present[np.argsort(-counts[present - 1], kind="stable")][1:]:
        values[parts == number] = bench.new_label()
    bench.write(box, values)


def _half_plane(line: Float[np.ndarray, "n 2"], shape: Sequence[int]) -> Float[np.ndarray, "m 2"]:
    """Return a polygon that holds one side of a line within an image: the line, and back far around."""
    middle = 0.5 * (np.array(shape, dtype=float) - 1)
    radius = 4.0 * (math.hypot(*shape) + float(np.abs(line - middle).max()) + 1.0)
    start = _far(line[0], line[0] - line[1], middle, radius)
    end = _far(line[-1], line[-1] - line[-2], middle, radius)
    first, last = (math.atan2(*(point - middle)) for point in (end, start))
    while last <= first:
        last += 2 * math.pi
    angles = np.linspace(first, last, 66)[1:-1]
    arc = middle + radius * np.column_stack((np.sin(angles), np.cos(angles)))
    return np.vstack((start, line, end, arc))


def _far(
    point: Float[np.ndarray, "2"],
    direction: Float[np.ndarray, "2"],
    middle: Float[np.ndarray, "2"],
    radius: float,
) -> Float[np.ndarray, "2"]:
    """Return where a ray from a point meets a circle about it."""
    unit = direction / np.hypot(*direction)
    offset = point - middle
    along = float(offset @ unit)
    reach = -along + math.sqrt(along * along - float(offset @ offset) + radius * radius)
    far: np.ndarray = point + reach * unit
    return far


def _crosses_itself(polygon: Float[np.ndarray, "n 2"]) -> bool:
    """Whether two sides of a closed polygon that are not neighbours cross."""
    a, b = polygon, np.roll(polygon, -1, axis=0)

    def turns(p: np.ndarray, q: np.ndarray, r: np.ndarray) -> Float[np.ndarray, "n n"]:
        ahead, aside = q - p, r - p
        turn: np.ndarray = np.sign(ahead[..., 0] * aside[..., 1] - ahead[..., 1] * aside[..., 0])
        return turn

    p, q, r, s = a[:, None], b[:, None], a[None], b[None]
    crossing = (turns(p, q, r) * turns(p, q, s) < 0) & (turns(r, s, p) * turns(r, s, q) < 0)
    return bool(crossing.any())
