"""A classifier of voxels: learned from strokes, asked block by block."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float32, Int64, UInt8

from mbstudio.core.errors import ClassifierError, MbstudioError, SegmentationWarning
from mbstudio.core.grains.classifying import features
from mbstudio.core.grains.classifying.classifier_file import (
    ENDING,
    read_classifier_file,
    write_classifier_file,
)
from mbstudio.core.grains.classifying.features import NAMES, features_in
from mbstudio.core.grains.classifying.forest import Forest
from mbstudio.core.grains.classifying.grey_levels import GreyLevels
from mbstudio.core.grains.classifying.stroke import KINDS, Stroke, voxels_of
from mbstudio.core.grains.editing.label_volume import Box
from mbstudio.core.grains.interfaces import find_interfaces
from mbstudio.core.grains.phases import find_phases
from mbstudio.core.scan.scan import Scan
from mbstudio.core.units import VoxelSize
from mbstudio.core.version import __version__

FORMAT = 1
"""Of a classifier's entries and arrays."""
_KIND = "mbstudio classifier of voxels"
BLOCK = 64
"""Voxels to an edge of the blocks in which a volume is classified."""
VOID, GRAIN, MINERAL, BORDER = range(4)
"""Numbers of the kinds."""
TREES = 40
_TILE = 32  # voxels to an edge of the boxes in which features of strokes are computed
_LEAST, _MOST = 10, 20_000  # painted voxels of one kind
_PROBED, _PROBE_EDGE = 4, 8  # boxes along each axis in which another scan is compared, and their edge
_ENDS = (0.002, 0.998)  # quantiles between which features count as seen before
_WIDENED, _MOST_STRANGE = 0.5, 0.1  # of the width between them; share of voxels beyond in one feature
_TOLD_SIZE = 0.05  # relative difference of voxel sizes from which it is told
_CLEAR, _TURNED_EDGE = 0.03, 128  # 1 / voxel; voxels: edge of the box in which dark grains are told

Progress = Callable[[float, str], None]


@dataclass(frozen=True, eq=False)
class VoxelClassifier:
    """Tells void, grains, grains of a second mineral and borders between grains apart.

    Attributes
    ----------
    forest : Forest
    kinds : tuple of str
        What its classes mean: some of `KINDS`, in that order.
    voxels : tuple of int
        How many voxels of each kind were painted.
    voxel_size : VoxelSize
        Of the scan that it was learned in.
    is_dark : bool
        Whether grains were darker than the void there.
    ranges : float32 array, shape (2, features)
        Between which values the features of that scan lay.
    accuracy : float
        Share of the painted voxels that trees tell rightly which did not learn them. Neighbouring voxels are
        alike, so it flatters.
    seed : int

    Examples
    --------
    >>> classifier = VoxelClassifier.learned(scan, strokes)  # doctest: +SKIP
    >>> grains = mbstudio.segment(scan, classifier=classifier)  # doctest: +SKIP
    >>> classifier.save("sand.mbclf")  # doctest: +SKIP
    """

    forest: Forest
    kinds: tuple[str, ...]
    voxels: tuple[int, ...]
    voxel_size: VoxelSize
    is_dark: bool
    ranges: Float32[np.ndarray, "2 f"]
    accuracy: float
    seed: int = 0

    @classmethod
    def learned(
        cls,
        scan: Scan,
        strokes: Sequence[Stroke],
        *,
        seed: int = 0,
        trees: int = TREES,
        levels: GreyLevels | None = None,
    ) -> VoxelClassifier:
        """Learn from strokes of a brush.

        Parameters
        ----------
        scan : Scan
        strokes : sequence of Stroke
            Of void, and of grain or second mineral, at least 10 voxels each; of borders where wanted.
        seed : int
            The same strokes and seed give the same classifier, whatever the number of threads.
        trees : int
        levels : GreyLevels, optional
            Of the scan, where they are known.

        Raises
        ------
        ClassifierError
            If a stroke lies outside the scan or its field of view, or a kind is missing.
        ScanError
            If the scan is constant.
        """
        if not 1 <= trees <= 1000:
            raise ClassifierError(f"trees={trees} is impossible: give 1 to 1000.")
        levels = levels or GreyLevels.of(scan)
        indices, kinds = voxels_of(strokes, scan.shape, scan.voxel_size)
        seen = levels.view.mask[np.unravel_index(indices, scan.shape)] if len(indices) else np.zeros(0, bool)
        if len(indices) and not seen.any():
            raise ClassifierError("All strokes lie outside the field of view: paint where the scan has seen.")
        indices, kinds = indices[seen], kinds[seen]
        counts = np.bincount(kinds, minlength=len(KINDS))
        _require_kinds(counts)
        used = [kind for kind in range(len(KINDS)) if counts[kind] >= _LEAST]
        chosen = np.concatenate([_evenly(np.flatnonzero(kinds == kind)) for kind in used])
        chosen.sort()
        rows = _features_at(levels, indices[chosen])
        numbers = np.searchsorted(used, kinds[chosen])
        forest, accuracy = Forest.grown(rows, numbers, trees=trees, seed=seed)
        grey = rows[:, NAMES.index("grey 1.4")]
        solid = np.isin(kinds[chosen], (GRAIN, MINERAL))
        probe = _probe(levels)
        ranges = np.quantile(np.concatenate([probe, rows]), _ENDS, axis=0).astype(np.float32)
        return cls(
            forest, tuple(KINDS[kind] for kind in used), tuple(int(counts[kind]) for kind in used),
            scan.voxel_size, bool(grey[solid].mean() < grey[kinds[chosen] == VOID].mean()), ranges, accuracy,
            seed,
        )  # fmt: skip

    def probabilities(self, levels: GreyLevels, box: Box) -> Float32[np.ndarray, "z y x k"]:
        """Return how probable each of `KINDS` is in a box of a scan; 0 for those that were not painted.

        Parameters
        ----------
        levels : GreyLevels
            Of the scan.
        box : tuple of slice
            Within the scan, both ends given.
        """
        shape = tuple(part.stop - part.start for part in box)
        shares = self.forest.shares_of(features_in(levels, box))
        every = np.zeros((*shape, len(KINDS)), np.float32)
        every[..., [KINDS.index(kind) for kind in self.kinds]] = shares.reshape(*shape, -1)
        return every

    def classified(
        self, levels: GreyLevels, *, progress: Progress | None = None, block: int = BLOCK
    ) -> UInt8[np.ndarray, "Z Y X"]:
        """Return the number of its kind for each voxel of a scan; void outside the field of view.

        Parameters
        ----------
        levels : GreyLevels
        progress : callable, optional
            ``progress(fraction, message)``, called after each block; what it raises ends the work.
        block : int
            Edge of the blocks, which the result does not depend on.
        """
        found = np.zeros(levels.shape, np.uint8)
        boxes = _boxes(levels.shape, block)
        tell = progress or (lambda _fraction, _message: None)
        workers = max(1, min(os.cpu_count() or 1, 8))

        def work(box: Box) -> None:
            seen = levels.view.mask[box]
            if seen.any():
                found[box] = kinds_of(self.probabilities(levels, box)) * seen

        with ThreadPoolExecutor(workers, "classify") as pool:
            waiting: list[Future[None]] = []
            rest = iter(boxes)
            done = 0
            try:
                waiting += [pool.submit(work, box) for box in islice(rest, 2 * workers)]
                while waiting:
                    waiting.pop(0).result()
                    waiting += [pool.submit(work, box) for box in islice(rest, 1)]
                    done += 1
                    tell(done / len(boxes), "Classifying voxels")
            except BaseException:
                for one in waiting:
                    one.cancel()
                raise
        return found

    def require_fits(self, levels: GreyLevels, scan: Scan) -> None:
        """Refuse a scan that is unlike the one that was learned in.

        Raises
        ------
        ClassifierError
            If grains are dark where they were bright, or grey values are distributed otherwise.

        Warns
        -----
        SegmentationWarning
            If its voxels are of another size.
        """
        name = scan.path or "the scan"
        mine, its = self.voxel_size, scan.voxel_size
        ratios = [b / a for a, b in zip(mine.zyx, its.to(mine.unit).zyx, strict=True)]
        if max(abs(ratio - 1) for ratio in ratios) > _TOLD_SIZE:
            warnings.warn(
                f"The classifier was learned at voxels of {mine}, and those of {name} are {its}: it looks at "
                "as many voxels here as there. Look at the result, or paint strokes in this scan.",
                SegmentationWarning,
                stacklevel=4,
            )
        probe = _probe(levels)
        low, high = self.ranges
        reach = _WIDENED * np.maximum(high - low, 0.05)
        strange = ((probe < low - reach) | (probe > high + reach)).mean(axis=0)
        if strange.max(initial=0.0) > _MOST_STRANGE:
            worst = NAMES[int(strange.argmax())]
            raise ClassifierError(
                f"The grey values of {name} are distributed otherwise than those that the classifier was "
                f"learned from ({100 * strange.max():.0f} % of its voxels lie beyond them in '{worst}'): "
                "paint strokes in this scan and learn anew."
            )
        if _is_dark(levels) is (not self.is_dark):
            told = ("dark", "bright") if self.is_dark else ("bright", "dark")
            raise ClassifierError(
                f"The classifier was learned from {told[0]} grains, and those of {name} are {told[1]}: paint "
                "strokes in this scan and learn anew."
            )

    def save(self, path: str | Path) -> Path:
        """Write the classifier to a file, conventionally ``*.mbclf``, and return its path.

        Raises
        ------
        ClassifierError
            If it cannot be written; an older file stays as it was.
        """
        path = Path(path)
        write_classifier_file(path, self.entries, self.arrays)
        return path

    @property
    def entries(self) -> dict[str, Any]:
        """All of the classifier that is no array, for JSON."""
        return {
            "kind": _KIND,
            "format": FORMAT,
            "written_by": f"mbstudio {__version__}",
            "features": features.VERSION,
            "feature_names": list(features.NAMES),
            "kinds": list(self.kinds),
            "voxels": list(self.voxels),
            "voxel_size_zyx": list(self.voxel_size.zyx),
            "unit": self.voxel_size.unit,
            "is_dark": self.is_dark,
            "accuracy": self.accuracy,
            "seed": self.seed,
        }

    @property
    def arrays(self) -> dict[str, np.ndarray]:
        """The arrays of the classifier by name."""
        return {**self.forest.to_arrays(), "ranges": self.ranges}


def load_classifier(path: str | Path) -> VoxelClassifier:
    """Return the classifier that was saved in a file.

    Raises
    ------
    ClassifierError
        If there is none, or it is damaged, foreign, of other features, or of a newer mbstudio.
    """
    path = Path(path)
    entries, arrays = read_classifier_file(path)
    return build_classifier(entries, arrays, path)


def build_classifier(
    entries: Mapping[str, Any], arrays: Mapping[str, np.ndarray], source: object
) -> VoxelClassifier:
    """Return the classifier of entries and arrays.

    Parameters
    ----------
    entries, arrays
        As `VoxelClassifier.entries` and `VoxelClassifier.arrays` give them.
    source : object
        What to call it in messages.

    Raises
    ------
    ClassifierError
        If it is damaged, of other features, or of a newer mbstudio.
    """
    if not isinstance(entries, Mapping) or entries.get("kind") != _KIND:
        raise ClassifierError(f"{source} is no classifier of mbstudio: give a file *{ENDING}.")
    writer = entries.get("written_by", "another mbstudio")
    if type(entries.get("format")) is not int or entries["format"] > FORMAT:
        raise ClassifierError(
            f"{source} was written by {writer} in format {entries.get('format')}; mbstudio {__version__} "
            f"reads up to format {FORMAT}: update mbstudio, or learn the strokes anew."
        )
    if entries.get("features") != features.VERSION or entries.get("feature_names") != list(features.NAMES):
        raise ClassifierError(
            f"{source} was learned on other features (version {entries.get('features')} by {writer}; "
            f"mbstudio {__version__} has version {features.VERSION}): learn the strokes anew."
        )
    try:
        return _built(entries, arrays)
    except (KeyError, TypeError, ValueError, OverflowError, MbstudioError) as error:
        raise ClassifierError(f"{source} is damaged ({error}): copy it here again.") from error


def _built(entries: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> VoxelClassifier:
    kinds = tuple(entries["kinds"])
    if not set(kinds) <= set(KINDS) or list(kinds) != [kind for kind in KINDS if kind in kinds]:
        raise ValueError("it tells kinds of voxels that are not known")
    if "void" not in kinds or not {"grain", "mineral"} & set(kinds):
        raise ValueError("it does not tell grains from void")
    voxels = tuple(entries["voxels"])
    if len(voxels) != len(kinds) or not all(type(count) is int and count > 0 for count in voxels):
        raise ValueError("its counts of voxels are none")
    accuracy, seed, is_dark = entries["accuracy"], entries["seed"], entries["is_dark"]
    if type(seed) is not int or not isinstance(is_dark, bool) or not 0 <= float(accuracy) <= 1:
        raise ValueError("its entries are of another kind")
    z, y, x = (float(edge) for edge in entries["voxel_size_zyx"])
    ranges = arrays["ranges"]
    if (
        ranges.dtype != np.float32
        or ranges.shape != (2, len(features.NAMES))
        or not np.isfinite(ranges).all()
    ):
        raise ValueError("its ranges of features are none")
    forest = Forest.from_arrays(arrays, len(features.NAMES), len(kinds))
    return VoxelClassifier(
        forest,
        kinds,
        voxels,
        VoxelSize(z, y, x, str(entries["unit"])),
        is_dark,
        ranges,
        float(accuracy),
        seed,
    )


def kinds_of(probabilities: Float32[np.ndarray, "*shape k"]) -> UInt8[np.ndarray, "*shape"]:
    """Return the number of the kind of each voxel: void or not first, then of what kind.

    A border is one only where it is more probable than all else together.
    """
    solid = probabilities[..., VOID] < 0.5
    kinds = np.where(probabilities[..., MINERAL] > probabilities[..., GRAIN], MINERAL, GRAIN)
    kinds = np.where(probabilities[..., BORDER] > 0.5, BORDER, kinds)
    return (kinds * solid).astype(np.uint8)


def _require_kinds(counts: Int64[np.ndarray, " k"]) -> None:
    """Refuse strokes that nothing can be learned from."""
    if not counts.any():
        raise ClassifierError("There are no strokes: paint some of grain and some of void in the slices.")
    painted = [KINDS[kind] for kind in np.flatnonzero(counts)]
    if counts[VOID] and (counts[GRAIN] or counts[MINERAL]):
        enough = counts[VOID] >= _LEAST and max(counts[GRAIN], counts[MINERAL]) >= _LEAST
        if not enough:
            raise ClassifierError(f"Too few voxels are painted: paint {_LEAST} or more of grain and of void.")
        return
    missing = "void" if not counts[VOID] else "grain"
    raise ClassifierError(
        f"Only {' and '.join(painted)} {'is' if len(painted) == 1 else 'are'} painted: "
        f"paint some {missing} too."
    )


def _evenly(rows: Int64[np.ndarray, " n"]) -> Int64[np.ndarray, " m"]:
    """Return rows, some of them evenly spread where they are too many."""
    if len(rows) <= _MOST:
        return rows
    return rows[np.linspace(0, len(rows) - 1, _MOST).astype(np.int64)]


def _features_at(levels: GreyLevels, indices: Int64[np.ndarray, " n"]) -> Float32[np.ndarray, "n f"]:
    """Return the features of voxels by their flat indices, computed in boxes about neighbours."""
    places = np.stack(np.unravel_index(indices, levels.shape), axis=1)
    rows = np.empty((len(indices), len(NAMES)), np.float32)
    _, tile = np.unique(places // _TILE, axis=0, return_inverse=True)
    order = np.argsort(tile.ravel(), kind="stable")
    bounds = np.flatnonzero(np.diff(tile.ravel()[order])) + 1
    for own in np.split(order, bounds):
        low, high = places[own].min(axis=0), places[own].max(axis=0) + 1
        z, y, x = (slice(int(a), int(b)) for a, b in zip(low, high, strict=True))
        found = features_in(levels, (z, y, x))
        rows[own] = found[np.ravel_multi_index(tuple((places[own] - low).T), tuple(high - low))]
    return rows


def _probe(levels: GreyLevels) -> Float32[np.ndarray, "n f"]:
    """Return the features of some voxels, evenly spread over what the scan has seen."""
    axes = []
    for count in levels.shape:
        last = max(0, count - _PROBE_EDGE)
        axes.append(sorted({round((place + 0.5) / _PROBED * last) for place in range(_PROBED)}))
    kept = []
    for z in axes[0]:
        for y in axes[1]:
            for x in axes[2]:
                box = tuple(
                    slice(start, min(start + _PROBE_EDGE, count))
                    for start, count in zip((z, y, x), levels.shape, strict=True)
                )
                cut = (box[0], box[1], box[2])
                kept.append(features_in(levels, cut)[levels.view.mask[cut].ravel()])
    return np.concatenate(kept)


def _is_dark(levels: GreyLevels) -> bool | None:
    """Return whether grains are darker than the void, by the convex side of surfaces; None if unclear."""
    box = tuple(
        slice(max(0, (count - _TURNED_EDGE) // 2), min(count, (count + _TURNED_EDGE) // 2))
        for count in levels.shape
    )
    cut = (box[0], box[1], box[2])
    phases = find_phases(
        find_interfaces(levels.read(cut, (0, 0, 0)), np.ascontiguousarray(levels.view.mask[cut]))
    )
    if phases is None or abs(phases.curvature) < _CLEAR:
        return None
    return phases.dark


def _boxes(shape: tuple[int, int, int], edge: int) -> list[Box]:
    if edge < 1:
        raise ClassifierError(f"block={edge} is impossible: give 1 or more voxels.")

    def parts(count: int) -> Iterator[slice]:
        return (slice(start, min(start + edge, count)) for start in range(0, count, edge))

    return [(z, y, x) for z in parts(shape[0]) for y in parts(shape[1]) for x in parts(shape[2])]
