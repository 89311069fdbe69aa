"""Segmentation in a process of its own, so that a window stays alive beside it.

The distance map and the component labelling hold Python's interpreter lock for seconds; in the
window's own process they would stop it from drawing. Voxels and labels go through ``.npy``
files in a temporary folder, not through the pipes: a scan may be as large as the memory.
"""

from __future__ import annotations

import tempfile
import warnings
from dataclasses import asdict
from pathlib import Path

import numpy as np

from mbstudio.core.batch.messages import Arrays, Head, Message, Report
from mbstudio.core.batch.pool import Job, WorkerPool
from mbstudio.core.errors import SegmentationError, SegmentationWarning
from mbstudio.core.grains.classifying import VoxelClassifier, load_classifier
from mbstudio.core.grains.editing.label_volume import LabelVolume
from mbstudio.core.grains.grain_set import GrainSet
from mbstudio.core.grains.segmentation import Progress, SegmentationSettings, segment
from mbstudio.core.grains.verdict import SegmentationVerdict
from mbstudio.core.scan.field_of_view import FieldOfView
from mbstudio.core.scan.scan import Scan
from mbstudio.core.units import VoxelSize

_CLASSIFIER = "classifier.mbclf"


def segment_in_process(
    scan: Scan,
    settings: SegmentationSettings | None = None,
    *,
    classifier: VoxelClassifier | None = None,
    progress: Progress | None = None,
) -> GrainSet:
    """Find the grains of a scan as :func:`mbstudio.core.grains.segment` does, in another process.

    Parameters
    ----------
    scan : Scan
    settings : SegmentationSettings, optional
    classifier : VoxelClassifier, optional
    progress : callable, optional
        ``progress(fraction, message)``, called at least ten times a second; what it raises ends
        the process.

    Returns
    -------
    GrainSet

    Raises
    ------
    MbstudioError
        As :func:`segment` raises it.
    SegmentationError
        If the process ends without a result, for example for want of memory.
    """
    with tempfile.TemporaryDirectory(prefix="mbstudio-segment-") as folder:
        pool = WorkerPool(_Segmentation(settings or SegmentationSettings(), Path(folder), classifier), 1)
        (grains,) = pool.map([scan], on_report=progress or (lambda _share, _message: None))
    return grains


class _Segmentation(Job[Scan, GrainSet]):
    """In goes a scan, out come its grains; voxels and labels go through files in a folder."""

    one_thread = False
    tries = 1  # it takes minutes, and would need as much memory again
    keeps_answers = False  # the labels go through a file
    complaints: Path

    def __init__(
        self, settings: SegmentationSettings, folder: Path, classifier: VoxelClassifier | None = None
    ) -> None:
        self._settings, self._folder, self._classifier = settings, folder, classifier
        self.complaints = folder / "complaints.txt"

    def pack(self, scan: Scan) -> Message:
        head: Head = {
            "folder": str(self._folder),
            "settings": asdict(self._settings),
            "voxel_size": asdict(scan.voxel_size),
            "origin": list(scan.origin),
            "path": str(scan.path) if scan.path else None,
            "has_classifier": self._classifier is not None,
        }
        if self._classifier is not None:
            self._classifier.save(self._folder / _CLASSIFIER)
        voxels = scan.voxels
        if isinstance(voxels, np.memmap) and voxels.flags.c_contiguous and voxels.filename is not None:
            head["map"] = {
                "file": str(voxels.filename),
                "offset": int(voxels.offset),
                "dtype": voxels.dtype.str,
                "shape": list(voxels.shape),
            }
        else:
            np.save(self._folder / "voxels.npy", scan.load(), allow_pickle=False)
        return head, {}

    @staticmethod
    def work(head: Head, arrays: Arrays, report: Report) -> Message:
        folder = Path(head["folder"])
        if "map" in head:
            place = head["map"]
            voxels: np.ndarray = np.memmap(
                place["file"], np.dtype(place["dtype"]), "r", place["offset"], tuple(place["shape"])
            )
        else:
            voxels = np.load(folder / "voxels.npy", mmap_mode="r", allow_pickle=False)
        path = Path(head["path"]) if head["path"] else None
        scan = Scan(voxels, VoxelSize(**head["voxel_size"]), tuple(head["origin"]), path)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", SegmentationWarning)
            classifier = load_classifier(folder / _CLASSIFIER) if head["has_classifier"] else None
            settings = SegmentationSettings(**head["settings"])
            grains = segment(scan, settings, classifier=classifier, progress=report)
        np.save(folder / "labels.npy", grains.labels, allow_pickle=False)
        texts = [str(one.message) for one in caught if issubclass(one.category, SegmentationWarning)]
        verdict = grains.verdict.to_record() if grains.verdict is not None else None
        if grains.view is not None:
            np.save(folder / "footprint.npy", grains.view.footprint, allow_pickle=False)
        view = None if grains.view is None else [grains.view.axis, grains.view.is_marked]
        return {"warnings": texts, "verdict": verdict, "view": view}, {
            str(name): grains.table[name].to_numpy() for name in grains.table.columns
        }

    def unpack(self, scan: Scan, head: Head, arrays: Arrays) -> GrainSet:
        import pandas as pd

        labels = np.load(self._folder / "labels.npy", allow_pickle=False)
        for text in head["warnings"]:
            warnings.warn(text, SegmentationWarning, stacklevel=4)
        verdict = SegmentationVerdict.from_record(head["verdict"]) if head["verdict"] is not None else None
        view = None
        if head["view"] is not None:
            axis, is_marked = head["view"]
            footprint = np.load(self._folder / "footprint.npy", allow_pickle=False)
            view = FieldOfView(axis, footprint, scan.shape, is_marked)
        return GrainSet(
            LabelVolume(labels),
            pd.DataFrame(arrays),
            scan.voxel_size,
            scan.origin,
            verdict=verdict,
            view=view,
        )

    def lose(self, scan: Scan, code: int) -> GrainSet:
        complaints = self.complaints.read_text(encoding="utf-8", errors="replace").strip()
        last = complaints.splitlines()[-1] if complaints else f"exit code {code}"
        raise SegmentationError(
            f"The segmentation of {scan.path or 'the scan'} ended early ({last}). If the machine ran out of "
            "memory, close other programs or crop the scan, then try again."
        )
