"""What a fit costs: CPU time and memory by size, and a whole scan of real sand."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault("NUMBA_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from imaging_scores import timed_fit

from mbstudio.core.grains import Grain
from mbstudio.core.imaging import FitResult, fit
from mbstudio.core.units import VoxelSize

MANY_VOXELS = 8_000_000


def cost_of(grain: Grain, n: int, repeats: int = 3) -> tuple[float, float, float]:
    """Return CPU seconds of a fit in a process of its own (median), and MiB at rest and at its peak.

    The mask is in memory before, the kernels are compiled; both count as at rest.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "mask.npy"
        np.save(path, grain.mask, allow_pickle=False)
        done = subprocess.run(
            [sys.executable, __file__, str(path), str(n), str(repeats)],
            check=True, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
    seconds, rest, peak = json.loads(done.stdout)
    return seconds, rest, peak


def _memory(name: str) -> float:
    """Return a figure of this process's memory in MiB.

    Not by getrusage: its peak begins with that of the process that started this one.
    """
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(name):
            return int(line.split()[1]) / 1024
    raise RuntimeError(f"/proc/self/status tells no {name}: the memory is measured on Linux only.")


def _cost_in_this_process(path: str, n: int, repeats: int) -> None:
    compiling = np.ones((24, 24, 24), dtype=bool)
    fit(Grain(compiling, VoxelSize(1, 1, 1, "um")), n)
    grain = Grain(np.load(path, allow_pickle=False), VoxelSize(10, 10, 10, "um"))
    grain.voxel_count  # noqa: B018 - counted once, before the clock starts
    rest = _memory("VmRSS")
    times = [timed_fit(grain, n, seed=seed)[1] for seed in range(repeats)]
    print(json.dumps([float(np.median(times)), rest, _memory("VmHWM")]))


def speed(quick: bool = False) -> None:
    """Print CPU time and memory by shape, size and n."""
    from grain_kinds import angular, cobble, known_grain

    print(
        "\n### Cost of a fit, preparation included, one core\n\n"
        "| grain | voxels | box | n | CPU s | MiB at rest | MiB at peak |\n|---|---|---|---|---|---|---|"
    )
    makers = {"cobble": cobble, "angular": angular}
    small = known_grain("cobble", "cobble", cobble(np.random.default_rng(7)), 64).grain.voxel_count
    # The side at which this cobble has that many voxels.
    many = round(64 * (MANY_VOXELS / small) ** (1 / 3))
    asked = [("cobble", 32, (40, 120)), ("cobble", 48, (40, 120)), ("cobble", 200, (40, 120)),
             ("angular", 200, (40, 120)), ("cobble", 300, (40, 120)), ("cobble", many, (40,))]  # fmt: skip
    for kind, side, numbers in asked[:1] + asked[-1:] if quick else asked:
        grain = known_grain(kind, kind, makers[kind](np.random.default_rng(7)), side).grain
        box = " x ".join(str(length) for length in grain.mask.shape)
        for n in numbers:
            seconds, rest, peak = cost_of(grain, n, 1 if quick else 3)
            print(
                f"| {kind} | {grain.voxel_count:,} | {box} | {n} | {seconds:.3f} | {rest:.0f} | {peak:.0f} |",
                flush=True,
            )


def sand(data: Path, workers: int = 2, count: int | None = None, seed: int = 0, n: int = 40) -> None:
    """Segment the real sand scan, fit its interior grains, print what came out.

    Parameters
    ----------
    data : Path
        Folder of the data.
    workers : int
        Processes for all grains.
    count : int, optional
        So many grains, chosen by `seed`, in this process: their CPU time is that of the fits
        alone, grains cut out of the labels and prepared. All grains on `workers` processes if
        not given: their CPU time holds the start of the processes too.
    """
    import mbstudio as mb
    from mbstudio.core.batch.many_fits import fit_many

    grains = mb.segment(mb.open_scan(data / "sand_ct" / "sand_ct_14um.tif", voxel_size="14 um"))
    labels = grains.interior_labels
    if count is not None:
        chosen = np.random.default_rng(seed).choice(labels, min(count, len(labels)), replace=False)
        labels, workers = sorted(int(label) for label in chosen), 0
    who = resource.RUSAGE_SELF if workers == 0 else resource.RUSAGE_CHILDREN
    before, begin = resource.getrusage(who), time.perf_counter()
    items = list(fit_many(grains, labels, n=n, workers=workers))
    wall, used = time.perf_counter() - begin, resource.getrusage(who)
    cpu = used.ru_utime + used.ru_stime - before.ru_utime - before.ru_stime
    results: list[FitResult] = [item.result for item in items if item.result is not None]
    verdicts = [result.verdict for result in results]
    errors = np.abs([verdict.volume_error for verdict in verdicts])
    diameters = {label: grains.grain(label).nominal_diameter for label in labels}
    rms = [item.result.verdict.rms / diameters[item.label] for item in items if item.result is not None]
    which = f"{len(labels)} interior grains chosen by seed {seed}" if count else "every interior grain"
    print(
        f"\n### Real sand scan, {which}, n = {n}\n\n"
        "| grains | fitted | pieces > 1 | voids | points outside | not valid "
        "| abs dV % median, 95th percentile "
        "| rms % of D_n median, 95th | wall s | CPU s | grains per CPU s of one core "
        "| MiB a process, caller |\n"
        "|---|---|---|---|---|---|---|---|---|---|---|---|\n"
        f"| {len(items)} | {len(verdicts)} | {sum(v.pieces > 1 for v in verdicts)} "
        f"| {sum(v.voids > 0 for v in verdicts)} | {sum(v.points_outside > 0 for v in verdicts)} "
        f"| {sum(not v.valid for v in verdicts)} "
        f"| {100 * np.median(errors):.3f}, {100 * np.percentile(errors, 95):.3f} "
        f"| {100 * np.median(rms):.2f}, {100 * np.percentile(rms, 95):.2f} | {wall:.0f} | {cpu:.1f} "
        f"| {len(items) / cpu:.1f} | {used.ru_maxrss / 1024:.0f}, "
        f"{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} |",
        flush=True,
    )


if __name__ == "__main__":
    _cost_in_this_process(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]))
