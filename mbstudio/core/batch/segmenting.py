"""Segmentation in a process of its own, so that a window stays alive beside it.

The distance map and the component labelling hold Python's interpreter lock for seconds; in the
window's own process they would stop it from drawing. Voxels and labels go through ``.npy``
files in a temporary folder, progress as lines of JSON.
"""

from __future__ import annotations

import json
import queue
import subprocess
import sys
import tempfile
import threading
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from mbstudio.core import errors
from mbstudio.core.batch.messages import child_command, child_environment
from mbstudio.core.grains.grain_set import GrainSet
from mbstudio.core.grains.segmentation import Progress, SegmentationSettings, segment
from mbstudio.core.scan.scan import Scan
from mbstudio.core.units import VoxelSize

_ASK_EVERY = 0.1  # seconds between two looks at whether the caller has cancelled


def segment_in_process(
    scan: Scan, settings: SegmentationSettings | None = None, *, progress: Progress | None = None
) -> GrainSet:
    """Find the grains of a scan as :func:`mbstudio.core.grains.segment` does, in another process.

    Parameters
    ----------
    scan : Scan
    settings : SegmentationSettings, optional
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
    with tempfile.TemporaryDirectory(prefix="mbstudio-segment-") as name:
        folder = Path(name)
        _write_request(scan, settings or SegmentationSettings(), folder)
        with (folder / "complaints.txt").open("wb") as complaints:
            process = subprocess.Popen(
                [*child_command("mbstudio.core.batch.segmenting"), str(folder)],
                env=child_environment(),
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=complaints,
            )
        try:
            _follow(process, progress or (lambda fraction, message: None))
            process.wait()
        finally:
            process.kill()
            process.wait()
        if process.returncode != 0 or not (folder / "table.npz").is_file():
            raise _why_it_ended(process.returncode, folder, scan)
        return _read_grains(folder, scan)


def _write_request(scan: Scan, settings: SegmentationSettings, folder: Path) -> None:
    request: dict[str, Any] = {
        "settings": asdict(settings),
        "voxel_size": asdict(scan.voxel_size),
        "origin": list(scan.origin),
        "path": str(scan.path) if scan.path else None,
    }
    voxels = scan.voxels
    if isinstance(voxels, np.memmap) and voxels.flags.c_contiguous and voxels.filename is not None:
        request["map"] = {
            "file": str(voxels.filename),
            "offset": int(voxels.offset),
            "dtype": voxels.dtype.str,
            "shape": list(voxels.shape),
        }
    else:
        np.save(folder / "voxels.npy", scan.load(), allow_pickle=False)
    (folder / "request.json").write_text(json.dumps(request), encoding="utf-8")


def _follow(process: subprocess.Popen[bytes], progress: Progress) -> None:
    """Hand on the progress of the process until it closes its output."""
    lines: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()

    def read() -> None:
        assert process.stdout is not None
        with process.stdout as stream:
            for line in stream:
                lines.put(line)
        lines.put(None)

    threading.Thread(target=read, name="segmentation progress", daemon=True).start()
    fraction, message = 0.0, "Starting"
    while True:
        try:
            line = lines.get(timeout=_ASK_EVERY)
        except queue.Empty:
            pass
        else:
            if line is None:
                return
            fraction, message = json.loads(line)
        progress(fraction, message)


def _why_it_ended(code: int, folder: Path, scan: Scan) -> errors.MbstudioError:
    failure = folder / "failure.json"
    if failure.is_file():
        kind, message = json.loads(failure.read_text(encoding="utf-8"))
        return getattr(errors, kind)(message)
    complaints = (folder / "complaints.txt").read_text(encoding="utf-8", errors="replace").strip()
    last = complaints.splitlines()[-1] if complaints else f"exit code {code}"
    return errors.SegmentationError(
        f"The segmentation of {scan.path or 'the scan'} ended early ({last}). If the machine ran out of "
        "memory, close other programs or crop the scan, then try again."
    )


def _read_grains(folder: Path, scan: Scan) -> GrainSet:
    import pandas as pd

    labels = np.load(folder / "labels.npy", allow_pickle=False)
    with np.load(folder / "table.npz", allow_pickle=False) as columns:
        table = pd.DataFrame({name: columns[name] for name in columns.files})
    return GrainSet(labels, table, scan.voxel_size, scan.origin)


def serve() -> None:
    """Segment what the folder named by the first argument holds; the process's whole work."""
    folder = Path(sys.argv[1])
    request = json.loads((folder / "request.json").read_text(encoding="utf-8"))
    try:
        if "map" in request:
            place = request["map"]
            voxels: np.ndarray = np.memmap(
                place["file"], np.dtype(place["dtype"]), "r", place["offset"], tuple(place["shape"])
            )
        else:
            voxels = np.load(folder / "voxels.npy", mmap_mode="r", allow_pickle=False)
        scan = Scan(
            voxels,
            VoxelSize(**request["voxel_size"]),
            tuple(request["origin"]),
            Path(request["path"]) if request["path"] else None,
        )
        grains = segment(scan, SegmentationSettings(**request["settings"]), progress=_tell)
    except errors.MbstudioError as error:
        answer = json.dumps([type(error).__name__, str(error)])
        (folder / "failure.json").write_text(answer, encoding="utf-8")
        sys.exit(1)
    np.save(folder / "labels.npy", grains.labels, allow_pickle=False)
    columns = {str(name): grains.table[name].to_numpy() for name in grains.table.columns}
    np.savez(folder / "table.npz", **columns)


def _tell(fraction: float, message: str) -> None:
    print(json.dumps([fraction, message]), flush=True)
