"""Laying a label image on its scan: the same voxels, in whichever order the two files hold them."""

from __future__ import annotations

import itertools

import numpy as np
from jaxtyping import Float, Int, Shaped

from mbstudio.core.errors import SegmentationError
from mbstudio.core.scan.excerpt import Excerpt, describe_bin, times
from mbstudio.core.scan.grid import Grid
from mbstudio.core.scan.scan import Scan
from mbstudio.core.units import METRES_PER_UNIT, VoxelSize

# Voxels a side of the thinned volumes in which labels and grey values are compared.
_SAMPLES = 64
# Grey values are said to follow labels laid the other way if they do so much more clearly.
_CLEAR_CORRELATION = 0.35
_CLEARER_BY = 0.1

Order = tuple[tuple[int, int, int], tuple[bool, bool, bool]]


def lay_on_scan(
    stored: Int[np.ndarray, "z y x"], grid: Grid | None, scan: Scan, name: str
) -> tuple[Int[np.ndarray, "Z Y X"], tuple[str, ...]]:
    """Return labels for exactly the voxels of the scan, and what the user should know about it.

    Parameters
    ----------
    stored : int array, shape (z, y, x)
        The labels in the order of their file.
    grid : Grid or None
        How their file places them in space, if it does.
    scan : Scan
    name : str
        What to call the label image in messages.

    Notes
    -----
    Labels of the whole file that the scan is a region of are cropped as it is. Labels of voxels that
    the scan has binned are refused: a mean of numbers of grains is the number of another.

    Where both files say how their voxels lie in space, that decides: labels whose axes run in
    another order or direction are turned, those of a cropped region land where their origin says.
    Where one of them says nothing, both are taken to be stored in the same order, as they are
    where one program made the labels on the scan; if the scan's grey values follow the labels
    clearly better in another order, they are refused.

    Raises
    ------
    SegmentationError
        If the labels cannot be brought onto the scan's voxels.
    """
    _require_same_blocks(stored, scan, name)
    if (
        scan.grid is not None
        and grid is not None
        and not grid.is_placeholder
        and not scan.grid.is_placeholder
    ):
        return _by_space(stored, grid, scan, scan.grid, name)
    if scan.excerpt is not None and stored.shape == scan.excerpt.whole:
        return _region_of_whole(stored, grid, scan, scan.excerpt, name)
    target = scan.shape
    notes: tuple[str, ...] = ()
    if grid is not None and _tells_place_in_file(grid, scan):
        labels, notes = _by_origin(stored, grid, scan, name)
    elif stored.shape == target:
        # Either file may have been turned round: the scan when it was read, the labels by their axes.
        turns = [one for one in (scan.grid, grid) if one is not None and any(one.flipped)]
        labels = _stored_or_turned(stored, turns[0].as_read(stored), scan, name) if turns else stored
    elif grid is not None and not grid.is_placeholder and scan.grid is None:
        labels, notes = _by_origin(stored, grid, scan, name)
    else:
        raise SegmentationError(_shape_message(stored.shape, target, name))
    require_no_better_order(labels, scan, name)
    return labels, notes


def _require_same_blocks(stored: Int[np.ndarray, "z y x"], scan: Scan, name: str) -> None:
    """Refuse labels of the file's voxels on a scan in blocks of them."""
    part = scan.excerpt
    if part is None or not part.is_binned:
        return
    unbinned = tuple(stop - start for start, stop in zip(part.start, part.stop, strict=True))
    if stored.shape != scan.shape and stored.shape in (part.whole, unbinned):
        raise SegmentationError(
            f"{name} has the {times(stored.shape)} voxels of the scan before it was binned "
            f"({describe_bin(part.bin)}), and numbers of grains have no mean: open the scan without a bin, "
            "or make labels of the binned scan."
        )


def _region_of_whole(
    stored: Int[np.ndarray, "z y x"], grid: Grid | None, scan: Scan, part: Excerpt, name: str
) -> tuple[Int[np.ndarray, "Z Y X"], tuple[str, ...]]:
    """Crop labels of the whole file as the scan is cropped, in the order in which both are stored."""
    before, behind = part.left_out
    turns = [one for one in (scan.grid, grid) if one is not None and any(one.flipped)]
    flipped = turns[0].flipped if turns else (False, False, False)

    def cut(flips: tuple[bool, bool, bool]) -> np.ndarray:
        ends = zip(before, behind, flips, stored.shape, strict=True)
        return stored[
            tuple(
                slice(last, count - first) if back else slice(first, count - last)
                for first, last, back, count in ends
            )
        ]

    if turns:
        labels = _stored_or_turned(cut((False, False, False)), turns[0].as_read(cut(flipped)), scan, name)
    else:
        labels = cut(flipped)
    require_no_better_order(labels, scan, name)
    return labels, ("covers the whole file, of which the scan is a region: the labels were cropped to it.",)


def _shape_message(shape: tuple[int, ...], target: tuple[int, int, int], name: str) -> str:
    message = (
        f"{name} has shape {shape}, but the scan has {target} (z, y, x): labels must cover the same voxels"
    )
    if sorted(shape) == sorted(target):
        return f"{message}. Its axes seem to be in another order, such as x, y, z: export it as z, y, x."
    if len(shape) == 3 and all(mine < its for mine, its in zip(shape, target, strict=True)):
        return (
            f"{message}. It seems to be cropped: export the whole volume, or use a format with an origin "
            "(NRRD, MHA)."
        )
    return f"{message}."


# By what both files say -------------------------------------------------------------------------------


def _by_space(
    stored: Int[np.ndarray, "z y x"], grid: Grid, scan: Scan, scan_grid: Grid, name: str
) -> tuple[Int[np.ndarray, "Z Y X"], tuple[str, ...]]:
    """Turn, flip and shift labels to where their file places them on the scan's voxels."""
    mine = grid.in_unit_of(scan_grid)
    to_scan = np.linalg.inv(scan_grid.steps)
    turn = mine.steps @ to_scan
    shift = (mine.origin - scan_grid.origin) @ to_scan
    notes: tuple[str, ...] = ()
    signs = np.rint(turn)
    whole = np.abs(turn - signs).max() < 0.01 and np.array_equal(np.abs(signs) @ np.abs(signs).T, np.eye(3))
    if not whole:
        binned = scan.excerpt is not None and scan.excerpt.is_binned
        if stored.shape == scan.shape and _is_scaled(turn) and not binned:
            ratio = float(np.cbrt(abs(np.linalg.det(turn))))
            note = f"states voxels {ratio:g} times as large as the scan's, for as many: the scan's are taken."
            labels = scan_grid.as_read(stored)
            require_no_better_order(labels, scan, name)
            return labels, (note,)
        raise SegmentationError(
            f"{name} has voxels that differ from the scan's ({_edges(mine)} against {_edges(scan_grid)}, x, "
            "y, z): resample the labels onto the scan, with nearest neighbours."
        )
    corner = np.rint(shift)
    if np.abs(shift - corner).max() > 0.1:
        off = ", ".join(f"{part:.2f}" for part in shift)
        raise SegmentationError(
            f"{name} lies between the scan's voxels (its first voxel at {off}, in voxels x, y, z): "
            "resample the labels onto the scan, with nearest neighbours."
        )
    # Row i of signs: where the labels' axis i (x, y, z) points on the scan. Arrays are [z, y, x].
    axes = [int(np.flatnonzero(signs[:, axis])[0]) for axis in range(3)]
    turned = stored.transpose([2 - axes[axis] for axis in (2, 1, 0)])
    back = [signs[axes[axis], axis] < 0 for axis in (2, 1, 0)]
    turned = turned[tuple(slice(None, None, -1 if one else 1) for one in back)]
    start = [int(corner[axis]) - (turned.shape[2 - axis] - 1 if back[2 - axis] else 0) for axis in (2, 1, 0)]
    around = _left_out_as_stored(scan, scan_grid)
    placed = _placed(turned, start, scan.shape, name, around)
    if turned.shape != scan.shape or any(start):
        notes = (_part_note(turned.shape, start, scan.shape),)
    labels = scan_grid.as_read(placed)
    require_no_better_order(labels, scan, name)
    return labels, notes


def _is_scaled(turn: np.ndarray) -> bool:
    """Whether the axes run alike and only the size of a voxel differs, alike in all directions."""
    size = float(np.cbrt(abs(np.linalg.det(turn))))
    return size > 0 and bool(np.abs(turn / size - np.eye(3)).max() < 0.01)


def _edges(grid: Grid) -> str:
    edges = " x ".join(f"{edge:g}" for edge in np.linalg.norm(grid.steps, axis=1))
    return f"{edges} {grid.unit or ''}".strip()


_Around = tuple[tuple[int, ...], tuple[int, ...]]
_NOTHING_AROUND: _Around = ((0, 0, 0), (0, 0, 0))


def _left_out_as_stored(scan: Scan, grid: Grid) -> _Around:
    """Return how many of the scan's voxels its file holds before and behind it along the stored axes."""
    if scan.excerpt is None:
        return _NOTHING_AROUND
    before, behind = (
        [count // factor for count, factor in zip(counts, scan.excerpt.bin, strict=True)]
        for counts in scan.excerpt.left_out
    )
    pairs = [
        (last, first) if back else (first, last)
        for first, last, back in zip(before, behind, grid.flipped, strict=True)
    ]
    return tuple(first for first, _ in pairs), tuple(last for _, last in pairs)


def _part_note(labels: tuple[int, ...], start: list[int], shape: tuple[int, int, int]) -> str:
    """Return the note on labels that do not lie on the scan voxel for voxel."""
    covers_all = all(
        first <= 0 and first + count >= whole
        for first, count, whole in zip(start, labels, shape, strict=True)
    )
    if covers_all:
        return "covers more than the scan, which is a region of its file: the labels were cropped to it."
    return f"covers a part of the scan, from voxel {tuple(start)} (z, y, x), according to its origin."


def _placed(
    labels: Int[np.ndarray, "z y x"],
    start: list[int],
    shape: tuple[int, int, int],
    name: str,
    around: _Around = _NOTHING_AROUND,
) -> Int[np.ndarray, "Z Y X"]:
    """Return labels of a region in a volume of the scan's shape.

    `around` is how many voxels the scan's file has before and behind it: grains there are left out;
    SegmentationError if they lie farther outside.
    """
    if labels.shape == shape and not any(start):
        return labels
    inside, known = (
        tuple(
            slice(max(0, -more - first), max(0, min(count, whole + most - first)))
            for first, count, whole, more, most in zip(start, labels.shape, shape, *margins, strict=True)
        )
        for margins in (_NOTHING_AROUND, around)
    )
    region = tuple(
        slice(first + part.start, first + part.stop) for first, part in zip(start, inside, strict=True)
    )
    kept = labels[inside]
    if np.count_nonzero(labels[known]) != np.count_nonzero(labels):
        raise SegmentationError(
            f"{name} reaches beyond the scan: by its origin its first voxel lies at {tuple(start)} (z, "
            "y, x) of a "
            f"scan of {shape}. Check that they belong together."
        )
    placed = np.zeros(shape, labels.dtype)
    placed[region] = kept
    return placed


# By what one file says --------------------------------------------------------------------------------


def _by_origin(
    stored: Int[np.ndarray, "z y x"], grid: Grid, scan: Scan, name: str
) -> tuple[Int[np.ndarray, "Z Y X"], tuple[str, ...]]:
    """Lay labels of a cropped region on a scan that begins at zero and runs as they do."""
    steps = np.diag(grid.steps)
    if not np.allclose(np.diag(steps), grid.steps, atol=1e-3 * np.abs(steps).max()):
        raise SegmentationError(_shape_message(stored.shape, scan.shape, name))
    if not _fits(grid, scan.voxel_size):
        raise SegmentationError(
            f"{name} has other voxels ({_edges(grid)}, x, y, z) and another shape {stored.shape} than "
            "the scan "
            f"({scan.voxel_size}, {scan.shape}): resample the labels onto the scan, with nearest neighbours."
        )
    part = scan.excerpt
    around = _NOTHING_AROUND if part is None else _left_out_as_stored(scan, grid)
    shift = (grid.origin - _begin_in_file(scan, grid)) / steps
    corner = np.rint(shift)
    if np.abs(shift - corner).max() > 0.1:
        raise SegmentationError(_shape_message(stored.shape, scan.shape, name))
    start = [int(corner[axis]) for axis in (2, 1, 0)]
    placed = _placed(stored, start, scan.shape, name, around)
    if stored.shape == scan.shape and not any(start):
        return placed, ()
    note = f"{_part_note(stored.shape, start, scan.shape)[:-1]} where the scan's file begins at zero."
    return placed, (note,)


def _tells_place_in_file(grid: Grid, scan: Scan) -> bool:
    """Whether labels say where they lie in the file that the scan is a region of, which says nothing."""
    if scan.excerpt is None or scan.grid is not None or grid.is_placeholder:
        return False
    steps = np.diag(grid.steps)
    along_axes = np.allclose(np.diag(steps), grid.steps, atol=1e-3 * np.abs(steps).max())
    return bool(along_axes and steps.min() > 0) and _fits(grid, scan.voxel_size)


def _begin_in_file(scan: Scan, grid: Grid) -> Float[np.ndarray, "3"]:
    """Return where a region of a file that begins at zero begins, in the unit of a grid."""
    part = scan.excerpt
    if part is None:
        return np.zeros(3)
    middle = [first + (factor - 1) / 2 for first, factor in zip(part.start, part.bin, strict=True)]
    place = part.voxel_size_of_file(scan.voxel_size).positions(np.array([middle]))[0]
    factor = 1.0 if grid.unit is None else METRES_PER_UNIT[scan.unit] / METRES_PER_UNIT[grid.unit]
    return np.asarray(place * factor)


def _fits(grid: Grid, size: VoxelSize) -> bool:
    """Whether a grid's steps are as long as a scan's voxels."""
    edges = np.abs(np.diag(grid.steps))
    if grid.unit is not None:
        edges = edges * METRES_PER_UNIT[grid.unit] / METRES_PER_UNIT[size.unit]
    return bool(np.allclose(edges, size.xyz, rtol=0.01))


def differs_in_size(grid_size: VoxelSize, size: VoxelSize) -> bool:
    """Whether two voxel sizes differ by more than rounding."""
    return not np.allclose(grid_size.to(size.unit).zyx, size.zyx, rtol=0.01)


def _stored_or_turned(
    stored: Int[np.ndarray, "Z Y X"], turned: Int[np.ndarray, "Z Y X"], scan: Scan, name: str
) -> Int[np.ndarray, "Z Y X"]:
    """Choose by the grey values whether labels are taken as stored, or turned as their axes say."""
    grey, _ = _thinned(scan.voxels)
    as_stored = abs(_correlation(_thinned(stored)[0] > 0, grey))
    as_turned = abs(_correlation(_thinned(turned)[0] > 0, grey))
    if max(as_stored, as_turned) >= 1.2 * min(as_stored, as_turned) and max(as_stored, as_turned) > 0.02:
        return stored if as_stored > as_turned else turned
    raise SegmentationError(
        f"{name} or the scan has axes that run backwards, the other does not say how its own run, and the "
        "grey values "
        "do not tell: export scan and labels in one format, both with their orientation or both without."
    )


# By the grey values -----------------------------------------------------------------------------------


def require_no_better_order(labels: Int[np.ndarray, "Z Y X"], scan: Scan, name: str) -> None:
    """Refuse labels that the scan's grey values clearly follow in another order of the axes."""
    grey, _ = _thinned(scan.voxels)
    solid, _ = _thinned(labels)
    inside = solid > 0
    here = abs(_correlation(inside, grey))
    best = here
    order: Order | None = None
    for axes in itertools.permutations(range(3)):
        if tuple(labels.shape[axis] for axis in axes) != labels.shape:
            continue
        for back in itertools.product((False, True), repeat=3):
            if axes == (0, 1, 2) and not any(back):
                continue
            other = inside.transpose(axes)[tuple(slice(None, None, -1 if one else 1) for one in back)]
            there = abs(_correlation(other, grey))
            if there > best:
                best, order = there, (axes, back)  # type: ignore[assignment]
    if order is not None and best > _CLEAR_CORRELATION and best > here + _CLEARER_BY:
        raise SegmentationError(
            f"{name} does not lie on the grains of the scan, but would {_described(order)}: "
            "export the labels with their axes as in the scan."
        )


def _described(order: Order) -> str:
    axes, back = order
    words = []
    if axes != (0, 1, 2):
        words.append("with its axes in the order " + ", ".join("zyx"[axis] for axis in axes))
    if any(back):
        words.append(
            "with " + " and ".join(axis for axis, one in zip("zyx", back, strict=True) if one) + " reversed"
        )
    return " and ".join(words)


def _thinned(voxels: object) -> tuple[Shaped[np.ndarray, "a b c"], tuple[int, ...]]:
    """Return some voxels, evenly spaced and the same from both ends of each axis."""
    shape: tuple[int, ...] = voxels.shape  # type: ignore[attr-defined]
    places = [_evenly(count) for count in shape]
    slices = [np.asarray(voxels[int(z)])[np.ix_(places[1], places[2])] for z in places[0]]  # type: ignore[index]
    return np.stack(slices), shape


def _evenly(count: int) -> np.ndarray:
    first_half = np.floor(np.linspace(0, count - 1, min(count, _SAMPLES))[: (min(count, _SAMPLES) + 1) // 2])
    half = first_half.astype(int)
    return np.unique(np.concatenate([half, count - 1 - half]))


def _correlation(inside: np.ndarray, grey: np.ndarray) -> float:
    """Return how well grey values tell inside from outside, -1 to 1; 0 where one of both is constant."""
    values = grey.astype(np.float64)
    known = np.isfinite(values)
    if not known.any():
        return 0.0
    values = np.where(known, values, values[known].mean())
    mask = inside.astype(np.float64)
    spread = values.std() * mask.std()
    if spread == 0:
        return 0.0
    return float(((values - values.mean()) * (mask - mask.mean())).mean() / spread)
