"""The main job on real sand: one command from a CT stack to a project of avatars.

    python benchmarks/main_job.py [--data FOLDER] [-n 40] [--workers 2]

Runs ``mbstudio fit`` on the foundry sand as a person does, then looks at what it saved: the
number of grains, their agreement with the hand labels of slice 0, and every avatar anew, on a
grid of its own rather than by the verdict that was saved with it.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import cc3d
import numpy as np
import tifffile

from mbstudio.core.grains import GrainSet
from mbstudio.core.grains.agreement import agreement
from mbstudio.core.imaging import FitResult
from mbstudio.core.project import Project

CELLS = 72
MARGIN_VOXELS = 5


def looked_at_anew(result: FitResult, grains: GrainSet) -> tuple[int, int, float]:
    """Return pieces, voids and relative volume error of an avatar, counted on a plain grid."""
    grain = grains.grain(int(result.avatar.label or 0))
    edge = np.array(grain.voxel_size.xyz)
    low = np.array(grain.origin) - MARGIN_VOXELS * edge
    high = low + (np.array(grain.mask.shape[::-1]) - 1 + 2 * MARGIN_VOXELS) * edge
    axes = [np.linspace(low[i], high[i], CELLS) for i in (2, 1, 0)]
    z, y, x = np.meshgrid(*axes, indexing="ij")
    inside = result.avatar.field(np.column_stack([x.ravel(), y.ravel(), z.ravel()])).reshape(x.shape) >= 1
    pieces = int(cc3d.connected_components(inside, connectivity=6).max())
    gaps = int(cc3d.connected_components(~inside, connectivity=26).max())
    volume = inside.sum() * np.prod((high - low) / (CELLS - 1))
    return pieces, gaps - 1, float(volume / grain.volume - 1)


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    root = Path(__file__).resolve().parent.parent
    options.add_argument("--data", type=Path, default=root.parent / "shared" / "data" / "sand_ct")
    options.add_argument("-n", type=int, default=40)
    options.add_argument("--workers", type=int, default=2)
    chosen = options.parse_args()
    scan, hand = chosen.data / "sand_ct_14um.tif", chosen.data / "hand_labels_slice000.tif"
    if not scan.is_file():
        sys.exit(f"{scan} is not there: say with --data where the sand scan lies.")
    with tempfile.TemporaryDirectory() as folder:
        project_file = Path(folder) / "sand.mbs"
        command = [
            sys.executable, "-m", "mbstudio", "fit", scan, "--voxel-size", "14 um", "-n", chosen.n,
            "--workers", chosen.workers, "-o", project_file, "--json",
        ]  # fmt: skip
        begun = time.monotonic()
        ran = subprocess.run([str(part) for part in command], stdout=subprocess.PIPE, check=True)
        wall = time.monotonic() - begun
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        summary = json.loads(ran.stdout)
        size = project_file.stat().st_size
        with Project.open(project_file) as project:
            report(project, hand, summary)
    print(f"| wall time / CPU time | {wall:.0f} s / {used.ru_utime + used.ru_stime:.0f} s |")
    print(f"| largest process | {used.ru_maxrss / 2**20:.2f} GiB |")
    print(f"| project file | {size / 2**20:.1f} MiB |")


def report(project: Project, hand: Path, summary: dict[str, float]) -> None:
    grains, fits = project.grains, project.fits
    assert grains is not None
    found = np.array([looked_at_anew(result, grains) for result in fits.values()])
    score = agreement(np.asarray(grains.labels[0]), np.squeeze(tifffile.imread(hand)))
    rms = [result.verdict.rms / grains.grain(label).nominal_diameter for label, result in fits.items()]
    error = 100 * np.abs([result.verdict.volume_error for result in fits.values()])
    plain = 100 * np.abs(found[:, 2])
    print(f"| sand, n = {next(iter(fits.values())).n} | |\n|---|---|")
    print(f"| grains (interior) | {len(grains)} ({len(grains.interior_labels)}) |")
    print(f"| foreground IoU / instance F1, slice 0 | {score.foreground_iou:.3f} / {score.f1:.3f} |")
    print(f"| fitted / failed / valid | {len(fits)} / {summary['failed']} / {summary['valid']} |")
    print(
        "| in pieces / with voids, counted again on a plain grid "
        f"| {(found[:, 0] != 1).sum():.0f} / {(found[:, 1] > 0).sum():.0f} |"
    )
    print(f"| volume error, median / 95th / largest | {spread(error)} % |")
    print(f"| the same on the plain grid of {CELLS} cells | {spread(plain)} % |")
    print(f"| rms distance, median / 95th / largest | {spread(100 * np.array(rms))} % of D_n |")


def spread(values: np.ndarray) -> str:
    return f"{np.median(values):.4f} / {np.percentile(values, 95):.3f} / {values.max():.2f}"


if __name__ == "__main__":
    main()
