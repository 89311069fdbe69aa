"""The figures that a segmentation is judged by."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped
from scipy import ndimage

from mbstudio.core.compiled import compiled
from mbstudio.core.grains.agreement import agreement
from mbstudio.core.grains.flooding import map_distances, split_by_necks
from mbstudio.core.grains.interfaces import Interfaces, count_unexplained, find_interfaces
from mbstudio.core.grains.labelling import statistics, widened_box
from mbstudio.core.grains.phases import Phases, find_phases
from mbstudio.core.grains.verdict import SegmentationVerdict, likely_agreement
from mbstudio.core.scan.field_of_view import FieldOfView

_SAMPLED_VOXELS = 60_000  # of the grains' surface
_SAMPLED_GRAINS = 150
_FEW, _MANY = 5, 20  # grains
_BLURRED = 3  # voxels from a surface: what is not void alone
_AROUND = 6.0  # voxels: standard deviation of the weights for the level of the void around a place
_FEWEST_OF_VOID = 500
_REACH, _NEAR = 2.0, 1.0  # voxels between a surface and where the grey values of its sides are taken
_AVERAGED = 27  # voxels at each of these places
_UNCONVEX = 0.85  # solidity below which a grain may be two
_MISSING = 0.3  # share of a grain's own contrast below which its surface is not borne out
_STRONG = 0.4  # share of the usual contrast from which an edge must be explained
_OTHER_SPLITTING = 0.15
_SPLIT_EDGE = 160  # voxels: edge of the box in which touching grains are parted anew


def judge_labels(
    grey: Shaped[np.ndarray, "Z Y X"],
    labels: Int[np.ndarray, "Z Y X"],
    view: FieldOfView,
    interfaces: Interfaces | None = None,
    *,
    phases: Phases | None = None,
    agreements: Mapping[str, float] | None = None,
) -> SegmentationVerdict:
    """Judge grains by the scan that they were found in.

    Parameters
    ----------
    grey : array, shape (Z, Y, X)
        The scan's voxels, finite.
    labels : int array, shape (Z, Y, X)
        Grains 1..N, those that the border cuts among them; 0 between them.
    view : FieldOfView
    interfaces : Interfaces, optional
        Those of the scan; found anew by default.
    phases : Phases, optional
        Those of the scan; found anew by default.
    agreements : mapping of str to float, optional
        What :func:`compare_splittings` gave, if the grains were parted here.
    """
    if interfaces is None:
        interfaces = find_interfaces(grey.astype(np.float32), view.mask)
    phases = phases or find_phases(interfaces)
    voxels, boxes, _, cut = statistics(labels, view.rim_cutting(labels))
    box = _middle_box(boxes, labels.shape)
    figures = _surfaces(grey, labels, interfaces, view.mask)
    if phases is not None and phases.liquid is not None:
        figures.pop("edges_outside", None)  # the outer surface of a liquid is an edge with no grain at it
        figures |= _wet_levels(grey, labels, view.mask, box, phases)
    elif figures.get("contrast_to_noise", 0.0) > 0.0:
        contrast = figures["contrast_to_noise"] * interfaces.noise
        figures["texture_of_void"] = _void_texture(grey, labels, view.mask, box, interfaces.noise) / contrast
    solidities, rows = _solidities(labels, np.arange(len(boxes)), boxes, cut, _SAMPLED_GRAINS)
    if len(rows):
        figures["solidity"] = float(np.median(solidities))
        figures["unconvex_share"] = float(voxels[rows][solidities < _UNCONVEX].sum() / voxels[rows].sum())
    if agreements:
        figures |= agreements
        figures["likely_agreement"] = likely_agreement(figures)
    figures["median_diameter"] = float(np.median(np.cbrt(6 * voxels / np.pi)))
    figures["solid_share"] = float(voxels.sum() / max(np.count_nonzero(view.mask), 1))
    if len(voxels) >= _MANY:
        figures["cut_by_border"] = float(cut.mean())
    found = {name: figure for name, figure in figures.items() if np.isfinite(figure)}
    return SegmentationVerdict(found, phases.count if phases else 0, view.described)


def _surfaces(
    grey: Shaped[np.ndarray, "Z Y X"],
    labels: Int[np.ndarray, "Z Y X"],
    interfaces: Interfaces,
    seen: Bool[np.ndarray, "Z Y X"],
) -> dict[str, float]:
    """Compare grains' surfaces with the edges of the scan."""
    places = _surface_voxels(labels, seen)
    if not len(places):
        return {"surface_compared": 0.0}
    steps = _steps(grey, labels, places, _REACH)
    near = float(np.median(_steps(grey, labels, places, _NEAR)))
    if np.median(steps) < 0:
        steps, near = -steps, -near
    contrast = float(np.median(steps))
    figures = {
        "surface_compared": float(len(places)),
        "contrast_to_noise": contrast / max(interfaces.noise, 1e-300),
    }
    if contrast > 0:
        figures["edge_sharpness"] = near / contrast
    owners = labels[tuple(places.T)]
    usual = np.nan_to_num(ndimage.median(steps, owners, np.arange(int(owners.max()) + 1)))
    # A grain whose own contrast is no more than noise leaves in a step is not borne out as a whole.
    least = np.maximum(_MISSING * usual[owners], interfaces.noise / np.sqrt(_AVERAGED))
    figures["surface_borne_out"] = float((steps > least).mean())
    strong = interfaces.contrasts > _STRONG * contrast
    if strong.any():
        inside, outside = count_unexplained(labels, interfaces.places[strong].astype(np.int64))
        figures["edges_inside"] = inside / float(strong.sum())
        figures["edges_outside"] = outside / float(strong.sum())
    return figures


def _wet_levels(
    grey: Shaped[np.ndarray, "Z Y X"],
    labels: Int[np.ndarray, "Z Y X"],
    seen: Bool[np.ndarray, "Z Y X"],
    box: tuple[slice, ...],
    phases: Phases,
) -> dict[str, float]:
    """Return how much of what lies between grains is void or liquid, and how many surfaces meet one tone.

    Drifts and streaks are taken for a liquid at times: then grey values lie at all levels.
    """
    assert phases.liquid is not None
    between = ~ndimage.binary_dilation(labels[box] > 0)
    between &= ndimage.binary_erosion(seen[box], iterations=_BLURRED, border_value=1)
    figures = {}
    span = phases.tones[0] - phases.void
    if np.count_nonzero(between) >= _FEWEST_OF_VOID:
        means = ndimage.uniform_filter(grey[box].astype(np.float32), 3)[between]
        means *= -1.0 if phases.dark else 1.0
        away = np.minimum(np.abs(means - phases.void), np.abs(means - phases.liquid))
        figures["void_or_liquid"] = float((away < 0.1 * span).mean())
    figures["one_tone"] = float((np.abs(phases.interfaces.highs - phases.tones[0]) < 0.15 * span).mean())
    return figures


def _void_texture(
    grey: Shaped[np.ndarray, "Z Y X"],
    labels: Int[np.ndarray, "Z Y X"],
    seen: Bool[np.ndarray, "Z Y X"],
    box: tuple[slice, ...],
    noise: float,
) -> float:
    """Return how much the void varies from place to place, beyond noise and slow drifts; else NaN.

    It is the deviation of means over 27 voxels from the void's level around them, less what independent noise
    leaves in such means, in a box in the middle of the grains.
    """
    void = ~ndimage.binary_dilation(labels[box] > 0, iterations=_BLURRED)
    void &= ndimage.binary_erosion(seen[box], iterations=_BLURRED, border_value=1)
    if np.count_nonzero(void) < _FEWEST_OF_VOID:
        return float("nan")
    means = ndimage.uniform_filter(grey[box].astype(np.float32), 3)
    weights = void.astype(np.float32)
    around = ndimage.gaussian_filter(means * weights, _AROUND)
    around /= np.maximum(ndimage.gaussian_filter(weights, _AROUND), 1e-6)
    low, high = np.quantile((means - around)[void], (0.05, 0.95))
    # Of a normal distribution these quantiles are 3.29 deviations apart.
    return float(np.sqrt(max(((high - low) / 3.29) ** 2 - noise**2 / _AVERAGED, 0.0)))


def median_solidity(labels: Int[np.ndarray, "Z Y X"], least_voxels: int, most: int) -> float:
    """Return the median solidity of some grains of at least so many voxels; NaN where there are none."""
    voxels, boxes, _, cut = statistics(labels)
    found, _ = _solidities(labels, np.flatnonzero(voxels >= least_voxels), boxes, cut, most)
    return float(np.median(found)) if len(found) else float("nan")


def _solidities(
    labels: Int[np.ndarray, "Z Y X"],
    rows: Int[np.ndarray, " k"],
    boxes: Int[np.ndarray, "n 6"],
    cut: Bool[np.ndarray, " n"],
    most: int,
) -> tuple[Float[np.ndarray, " m"], Int[np.ndarray, " m"]]:
    """Return the shares of their convex hulls that grains fill, once smoothed over a voxel, and their rows.

    Grains that the border cuts are left out where enough others are left; of many, some are taken.
    """
    whole = rows[~cut[rows]]
    rows = whole if len(whole) >= _FEW else rows
    rows = rows[:: -(-len(rows) // most)] if len(rows) else rows
    found = [_solidity(labels[widened_box(boxes[row])] == row + 1) for row in rows]
    kept = [(value, row) for value, row in zip(found, rows, strict=True) if value is not None]
    return np.array([value for value, _ in kept]), np.array([row for _, row in kept], np.int64)


def _solidity(mask: Bool[np.ndarray, "z y x"]) -> float | None:
    """Return the share of its convex hull that a smoothed mask fills; None where nothing of it is left."""
    import trimesh
    from skimage.measure import marching_cubes

    field = ndimage.gaussian_filter(np.pad(mask, 4).astype(np.float32), 1.0)
    if field.max() <= 0.5:
        return None
    corners, faces, _, _ = marching_cubes(field, 0.5, allow_degenerate=False, gradient_direction="ascent")
    surface = trimesh.Trimesh(corners, faces, process=False)
    return abs(float(surface.volume)) / float(surface.convex_hull.volume)


def compare_splittings(
    landscape: Float[np.ndarray, "Z Y X"],
    labels: Int[np.ndarray, "Z Y X"],
    splitting: float,
    least_depth: float,
    smallest_voxels: int,
    anisotropy: tuple[float, float, float] = (1.0, 1.0, 1.0),
) -> dict[str, float]:
    """Return how well grains agree (F1) with those that come of finding them a little differently.

    Parameters
    ----------
    landscape : float array, shape (Z, Y, X)
        The distance map that touching grains were parted by.
    labels : int array, shape (Z, Y, X)
        What came of it.
    splitting, least_depth : float
        As they were parted; see :func:`~mbstudio.core.grains.flooding.split_by_necks`.
    smallest_voxels : int
        Pieces of fewer voxels do not count.
    anisotropy : tuple of float
        Edges (z, y, x) of a voxel over its shortest.

    Returns
    -------
    dict
        ``splitting_agreement`` is the lesser one of a little more and a little less splitting,
        ``smooth_agreement`` that of grains smoothed over a voxel before they are parted, and
        ``thin_agreement`` that of grains half a voxel thinner.

    Notes
    -----
    In large scans this looks at a box about the grain that is nearest to the middle of all.
    """
    part = np.ascontiguousarray(landscape[_middle_box(statistics(labels)[1], labels.shape)])

    def parted(distances: Float[np.ndarray, "z y x"], share: float) -> Int[np.ndarray, "z y x"]:
        found, _ = split_by_necks(distances, float(np.clip(share, 0.0, 1.0)), least_depth)
        large = np.bincount(found.ravel()) >= smallest_voxels
        large[0] = False
        return np.where(large[found], found, 0)

    reference = parted(part, splitting)

    def agreeing(distances: Float[np.ndarray, "z y x"], share: float) -> float:
        return agreement(parted(distances, share), reference).f1

    smooth = ndimage.gaussian_filter((part > 0).astype(np.float32), 1.0, mode="nearest") > 0.5
    return {
        "splitting_agreement": min(
            agreeing(part, splitting - _OTHER_SPLITTING), agreeing(part, splitting + _OTHER_SPLITTING)
        ),
        "smooth_agreement": agreeing(map_distances(smooth, anisotropy), splitting),
        "thin_agreement": agreeing(np.maximum(part - 0.5, 0.0), splitting),
    }


def _middle_box(boxes: Int[np.ndarray, "n 6"], shape: tuple[int, ...]) -> tuple[slice, ...]:
    """Return a box about the grain that is nearest to the middle of all."""
    middles = 0.5 * (boxes[:, ::2] + boxes[:, 1::2])
    chosen = middles[np.square(middles - np.median(middles, axis=0)).sum(axis=1).argmin()]
    box = []
    for middle, count in zip(chosen, shape, strict=True):
        start = int(np.clip(middle - _SPLIT_EDGE / 2, 0, max(count - _SPLIT_EDGE, 0)))
        box.append(slice(start, start + _SPLIT_EDGE))
    return tuple(box)


def _surface_voxels(
    labels: Int[np.ndarray, "Z Y X"], seen: Bool[np.ndarray, "Z Y X"]
) -> Int[np.ndarray, "m 3"]:
    """Return some of the grains' voxels that border on void, evenly spread in the order of the scan."""
    count = _walk_surface(labels, seen, 1, np.empty((0, 3), np.int64))
    step = max(1, -(-count // _SAMPLED_VOXELS))
    places = np.empty((-(-count // step), 3), np.int64)
    _walk_surface(labels, seen, step, places)
    return places


@compiled()
def _walk_surface(  # pragma: no cover - compiled
    labels: np.ndarray, seen: np.ndarray, step: int, places: np.ndarray
) -> int:
    nz, ny, nx = labels.shape
    margin = 4
    count = 0
    for z in range(margin, nz - margin):
        for y in range(margin, ny - margin):
            for x in range(margin, nx - margin):
                if labels[z, y, x] == 0:
                    continue
                if (
                    labels[z - 1, y, x] and labels[z + 1, y, x]
                    and labels[z, y - 1, x] and labels[z, y + 1, x]
                    and labels[z, y, x - 1] and labels[z, y, x + 1]
                ):  # fmt: skip
                    continue
                # Grains are cut off at the rim of the field of view.
                if not (
                    seen[z - margin, y, x] and seen[z + margin, y, x]
                    and seen[z, y - margin, x] and seen[z, y + margin, x]
                    and seen[z, y, x - margin] and seen[z, y, x + margin]
                ):  # fmt: skip
                    continue
                if count % step == 0 and count // step < len(places):
                    places[count // step, 0], places[count // step, 1], places[count // step, 2] = z, y, x
                count += 1
    return count


def _steps(
    grey: Shaped[np.ndarray, "Z Y X"],
    labels: Int[np.ndarray, "Z Y X"],
    places: Int[np.ndarray, "m 3"],
    reach: float,
) -> Float[np.ndarray, " m"]:
    """Return the grey value inside less that outside, this many voxels from places on surfaces."""
    middles = np.empty((2, len(places), 3), np.int64)
    _place_sides(labels, places, reach, middles)
    sides = np.zeros((2, len(places)))
    for offset in np.ndindex(3, 3, 3):
        at = np.moveaxis(middles + (np.array(offset) - 1), -1, 0)
        sides += grey[at[0], at[1], at[2]]
    return np.asarray((sides[0] - sides[1]) / _AVERAGED)


@compiled()
def _place_sides(  # pragma: no cover - compiled
    labels: np.ndarray, places: np.ndarray, reach: float, middles: np.ndarray
) -> None:
    """Find the voxels that lie inside and outside of a surface, along its normal."""
    for row in range(len(places)):
        z, y, x = places[row, 0], places[row, 1], places[row, 2]
        # From void to solid: the mean direction of the solid in a cube of five voxels.
        a, b, c = 0.0, 0.0, 0.0
        for i in range(-2, 3):
            for j in range(-2, 3):
                for k in range(-2, 3):
                    if labels[z + i, y + j, x + k]:
                        a += i
                        b += j
                        c += k
        length = np.sqrt(a * a + b * b + c * c)
        if length == 0.0:
            a, length = 1.0, 1.0
        for side in range(2):
            # The surface lies half a voxel beyond the middle of the last voxel of the solid.
            far = (reach - 0.5 if side == 0 else -(reach + 0.5)) / length
            middles[side, row, 0] = round(z + far * a)
            middles[side, row, 1] = round(y + far * b)
            middles[side, row, 2] = round(x + far * c)
