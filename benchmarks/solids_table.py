"""Twenty solids with exact answers as voxels: errors of mbstudio, and of other packages where they are
installed.

Each solid is voxelised at several sizes on three shapes of voxels in six poses. Prints markdown tables: mean
and standard deviation of the relative error over poses, in percent.

Run: ``python benchmarks/solids_table.py [--sizes 10 20 50 100] [--poses 6] [--processes N]``.
"""

from __future__ import annotations

import argparse
import importlib.util
import warnings
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
from known_solids import ALL_KINDS, Solid, solid

from mbstudio.core.grains import Grain
from mbstudio.core.metrics import measure

VOXELS = {"1 : 1 : 1": (1.0, 1.0, 1.0), "2 : 1 : 1": (2.0, 1.0, 1.0), "3 : 2 : 1": (3.0, 2.0, 1.0)}
FACTORS = ("volume", "area", "sphericity", "ds", "circularity", "csf")


def errors_of(task: tuple[str, int, str, int]) -> dict[str, float]:
    """Return the relative errors of one solid of a size, in a pose, on a shape of voxels; in percent."""
    kind, size, shape, pose = task
    edges = np.array(VOXELS[shape])
    edges /= float(np.cbrt(edges.prod()))  # as many voxels of either shape
    rng = np.random.default_rng([pose, size])
    body = solid(kind, size / 2)
    mask = body.voxels(rng, (float(edges[0]), float(edges[1]), float(edges[2])))
    grain = Grain.from_mask(mask, tuple(float(edge) for edge in edges), unit="um", keep="largest")
    found: dict[str, float] = {}
    try:
        ours = measure(grain)
        smooth = measure(grain, surface="smoothed")
    except Exception as error:  # told in the table as refused
        return {"refused": 1.0, "error": float(bool(str(error)))}
    for name in FACTORS:
        found[name] = 100 * (getattr(ours, name) / getattr(body, name) - 1)
    found["area, smoothed"] = 100 * (smooth.area / body.area - 1)
    found.update(_others(mask, edges, body))
    return found


def _others(mask: np.ndarray, edges: np.ndarray, body: Solid) -> dict[str, float]:
    """Return the errors of the area by other packages."""
    from skimage.measure import marching_cubes, mesh_surface_area

    corners, faces, _, _ = marching_cubes(np.pad(mask, 1).astype(float), 0.5, spacing=tuple(edges))
    found = {"area, scikit-image": 100 * (mesh_surface_area(corners, faces) / body.area - 1)}
    if importlib.util.find_spec("porespy") is not None and np.ptp(edges) < 1e-9:
        import porespy

        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            mesh = porespy.tools.mesh_region(np.pad(mask, 3).astype(int))
        found["area, porespy"] = 100 * (porespy.metrics.mesh_surface_area(mesh) / body.area - 1)
    return found


def print_tables(sizes: list[int], poses: int, processes: int) -> None:
    """Print one table a shape of voxels."""
    tasks = [(k, n, v, p) for v in VOXELS for n in sizes for k in ALL_KINDS for p in range(poses)]
    if processes > 1:
        with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
            found = dict(zip(tasks, pool.map(errors_of, tasks, chunksize=4), strict=True))
    else:
        found = {task: errors_of(task) for task in tasks}
    columns = [*FACTORS, "area, smoothed", "area, scikit-image"]
    if importlib.util.find_spec("porespy") is not None:
        columns.append("area, porespy")
    for shape in VOXELS:
        print(f"\n### Voxels {shape}: mean error ± standard deviation over {poses} poses, percent\n")
        print("| solid | voxels across | " + " | ".join(columns) + " |")
        print("|---" * (len(columns) + 2) + "|")
        for kind in ALL_KINDS:
            for size in sizes:
                rows = [found[kind, size, shape, pose] for pose in range(poses)]
                cells = [_cell(rows, name) for name in columns]
                print(f"| {kind} | {size} | " + " | ".join(cells) + " |")
        for size in sizes:
            rows = [found[kind, size, shape, pose] for kind in ALL_KINDS for pose in range(poses)]
            worst = [_root_mean_square(rows, name) for name in columns]
            print(f"| all, root mean square | {size} | " + " | ".join(worst) + " |")


def _values(rows: list[dict[str, float]], name: str) -> np.ndarray:
    values = np.array([row.get(name, np.nan) for row in rows])
    return values[np.isfinite(values)]


def _cell(rows: list[dict[str, float]], name: str) -> str:
    values = _values(rows, name)
    return f"{values.mean():+.2f} ± {values.std():.2f}".replace("-", "−") if len(values) else "–"


def _root_mean_square(rows: list[dict[str, float]], name: str) -> str:
    values = _values(rows, name)
    return f"{np.sqrt(np.mean(values**2)):.2f}" if len(values) else "–"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--sizes", type=int, nargs="+", default=[10, 20, 50, 100])
    parser.add_argument("--poses", type=int, default=6)
    parser.add_argument("--processes", type=int, default=1)
    asked = parser.parse_args()
    print_tables(asked.sizes, asked.poses, asked.processes)
