"""How much memory a segmentation takes at most, beside what is estimated before it begins.

Run ``python benchmarks/memory.py``; ``--voxels 2e6,8e6`` chooses the sizes (about so many voxels each). Each
row is a process of its own that opens a scan from its file and finds the grains; the peak is what the system
has counted (``VmHWM``; ``ru_maxrss`` would count what the parent held when it started the child), less what
the process held before, with everything imported. The file is mapped, and its pages count.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from mbstudio.core.batch.memory_estimate import segmentation_bytes
from mbstudio.core.grains import segment
from mbstudio.core.scan import Scan, open_scan

SIDE = 80  # voxels along an edge of the piece that is repeated
KINDS = {"packed": (60, 3.0), "dilute": (3, 34.0), "many small": (1200, 2.0)}
"""Grains in a piece, and the width of the gaps between them in voxels."""
DTYPES = ("uint8", "uint16", "float32")


def piece(kind: str) -> np.ndarray:
    """A cube of grey values from 0 to 255 that fits itself at all sides: cells with gaps between them."""
    count, gap = KINDS[kind]
    rng = np.random.default_rng(5)
    seeds = cKDTree(rng.uniform(0, SIDE, (count, 3)), boxsize=SIDE)
    places = np.indices((SIDE,) * 3).reshape(3, -1).T
    away, _ = seeds.query(places, k=2)
    solid = (away[:, 1] - away[:, 0] > gap).reshape((SIDE,) * 3)
    return np.where(solid, 180.0, 60.0) + rng.normal(0, 12, solid.shape)


def write_scan(path: Path, kind: str, dtype: str, voxels: float, circle: bool) -> tuple[int, int, int]:
    """Write a scan of about so many voxels, in the circle that a scanner sees if asked for."""
    side = round(voxels ** (1 / 3))
    one = piece(kind)
    times = -(-side // SIDE)
    grey = np.tile(one, (times,) * 3)[:side, :side, :side]
    scale = 200 if dtype == "uint16" else 1
    result = (grey * scale).clip(1, 255 * scale).astype(dtype)
    if circle:
        y, x = np.indices((side, side))
        result[:, np.hypot(y - side / 2, x - side / 2) > side / 2] = 0 if dtype != "float32" else np.nan
    np.save(path, result)
    return side, side, side


def memory_of_process(name: str) -> int:
    """Bytes that this process holds now (VmRSS), or held at most (VmHWM)."""
    for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
        if line.startswith(f"{name}:"):
            return int(line.split()[1]) * 1024
    raise RuntimeError(f"/proc/self/status does not tell {name}.")


def child(path: Path) -> None:
    """Find the grains of a scan; tell the bytes taken beyond what was held before."""
    scan = open_scan(path, "10 um")
    segment(Scan(piece("packed")[:48, :48, :48], scan.voxel_size), smallest_voxels=20)  # imports, compiles
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")  # the peak begins anew
    before, begun = memory_of_process("VmRSS"), time.perf_counter()
    grains = segment(scan, smallest_voxels=20)
    seconds = time.perf_counter() - begun
    peak = memory_of_process("VmHWM")
    print(json.dumps({"bytes": peak - before, "seconds": seconds, "grains": len(grains)}))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--voxels", default="4e6,16e6,32e6")
    parser.add_argument("--child", type=Path)
    given = parser.parse_args()
    if given.child is not None:
        child(given.child)
        return
    print("| Scan | Type | Voxels | Grains | Peak | Bytes per voxel | Estimated | Seconds |")
    print("|---|---|---|---|---|---|---|---|")
    cases = [("packed", dtype, False) for dtype in DTYPES]
    cases += [("packed", "uint8", True), ("packed", "float32", True)]
    cases += [("dilute", "uint8", False), ("many small", "uint8", False)]
    for voxels in map(float, given.voxels.split(",")):
        for kind, dtype, circle in cases:
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "scan.npy"
                shape = write_scan(path, kind, dtype, voxels, circle)
                told = subprocess.run(
                    [sys.executable, __file__, "--child", path], check=True, capture_output=True, text=True
                )
            found = json.loads(told.stdout.splitlines()[-1])
            count = int(np.prod(shape))
            estimate = segmentation_bytes(shape, np.dtype(dtype))
            name = f"{kind}, in a circle" if circle else kind
            print(
                f"| {name} | {dtype} | {shape[0]}³ | {found['grains']:,} | "
                f"{found['bytes'] / 1e6:,.0f} MB | {found['bytes'] / count:.1f} | {estimate / 1e6:,.0f} MB | "
                f"{found['seconds']:.1f} |",
                flush=True,
            )


if __name__ == "__main__":
    main()
