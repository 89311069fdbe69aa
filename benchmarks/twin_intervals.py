"""How far factors and gaps of a twin are off on packings that are known, and how often intervals hold.

Usage: python benchmarks/twin_intervals.py collect FILE [--rows ...] [--seeds 301,302] [--count 14]
       python benchmarks/twin_intervals.py coverage FILE [FILE ...]

`collect` writes a row a grain and a row a pair of grains, errors beside what the twin knows of itself.
"""

from __future__ import annotations

import argparse
import warnings
from pathlib import Path

import numpy as np
import pandas as pd
import trimesh
from skimage.measure import marching_cubes
from twin import _EDGE, ANGULAR, SMOOTH, matched, true_pairs
from twin_phantoms import Body, pack, scan_of

import mbstudio as mb
from mbstudio.core.metrics import FACTORS
from mbstudio.core.units import VoxelSize

_CELLS = 72
ROWS: dict[str, tuple[tuple[str, ...], float, int, dict[str, float]]] = {
    "smooth 13": (SMOOTH, 12.6, 40, {"noise": 0.035}),
    "smooth 18": (SMOOTH, 18.0, 40, {"noise": 0.05}),
    "smooth 28": (SMOOTH, 28.0, 40, {"noise": 0.035}),
    "smooth 22 noise .1": (SMOOTH, 22.0, 40, {"noise": 0.1}),
    "smooth 22 blur 1.1": (SMOOTH, 22.0, 40, {"noise": 0.05, "blur": 1.1}),
    "angular 18": (ANGULAR, 18.0, 40, {"noise": 0.05}),
    "angular 28": (ANGULAR, 28.0, 40, {"noise": 0.035}),
    "cupped 22": (SMOOTH, 22.0, 40, {"cupping": 0.08, "rings": 0.05}),
}


def surface_of(body: Body) -> trimesh.Trimesh:
    """Return the surface of a body in um, its vertices exactly on it."""
    points = body.surface()
    low, high = points.min(axis=0) - 1.0, points.max(axis=0) + 1.0
    step = float((high - low).max()) / _CELLS
    counts = np.ceil((high - low) / step).astype(int) + 1
    z, y, x = np.meshgrid(*(low[a] + step * np.arange(counts[a]) for a in (2, 1, 0)), indexing="ij")
    places = np.column_stack((x.ravel(), y.ravel(), z.ravel()))
    # A sum of k / r^2 has no value where a control point lies: the grid never meets one but by chance.
    values = body.value(places).reshape(z.shape)
    vertices, faces, _, _ = marching_cubes(values, 0.0)
    found = vertices[:, ::-1] * step + low
    for _ in range(3):
        slope = body.gradient(found)
        found = found - (body.value(found) / (slope**2).sum(axis=1))[:, None] * slope
    mesh = trimesh.Trimesh(found * _EDGE, faces[:, ::-1], process=False)
    if mesh.volume < 0:
        mesh.invert()
    return mesh


def factors_of(thing: object) -> dict[str, float]:
    """Return the core factors by name."""
    measured = mb.measure(thing, unit="um")
    return {name: float(FACTORS.value(name, vars(measured))) for name in FACTORS.core}


def collect(rows: list[str], seeds: list[int], count: int, file: Path) -> None:
    """Write a row a grain and a row a pair, after each packing."""
    from mbstudio.core.twin.body import render
    from mbstudio.core.twin.contacts import _pairs, _variances
    from mbstudio.core.twin.unexplained import unexplained_displacement

    grains_found, pairs_found = [], []
    for name in rows:
        kinds, across, n, how = ROWS[name]
        for seed in seeds:
            truth = scan_of(pack(kinds, across, count, seed), seed, **how)
            scan = mb.Scan(truth.voxels, VoxelSize.parse(f"{_EDGE} um"))
            grains = mb.segment(scan)
            of, known = matched(truth, grains), true_pairs(truth.bodies)
            found = mb.twin(scan, grains, n=n, workers=0)
            run = found._run
            shares = [render(body, run.frame.spacing, run.blur) for body in run.bodies]
            arounds = [run.surroundings(b, s) for b, s in zip(run.bodies, shares, strict=True)]
            noise = found.levels.grain_noise / abs(found.levels.contrast)
            for i, body in enumerate(run.bodies):
                if body.label not in of:
                    continue
                exact = truth.bodies[of[body.label]]
                true, got = factors_of(surface_of(exact)), factors_of(found.avatars[body.label])
                excess = unexplained_displacement(body, shares[i], arounds[i], run.blur)
                row = {
                    "row": name, "seed": seed, "label": body.label, "n": body.control.shape[1],
                    "noise": noise, "blur": run.blur, "excess": excess, "moved": body.moved,
                    "exact_volume": exact.volume * _EDGE**3,
                    "volume_of_labels": float(grains.grain(body.label).volume),
                }  # fmt: skip
                row |= {f"true_{key}": value for key, value in true.items()}
                row |= {f"got_{key}": value for key, value in got.items()}
                grains_found.append(row)
            pairs = _pairs(run)
            wanted: dict[int, list] = {}
            for i, j, meeting in pairs:
                wanted.setdefault(i, []).append(meeting.point)
                wanted.setdefault(j, []).append(meeting.point)
            variances = {i: iter(v.tolist()) for i, v in _variances(run, wanted).items()}
            for i, j, meeting in pairs:
                one, other = next(variances[i]), next(variances[j])
                a, b = run.bodies[i], run.bodies[j]
                if a.label not in of or b.label not in of:
                    continue
                key = tuple(sorted((of[a.label], of[b.label])))
                if key not in known:
                    continue
                local, whole = [], []
                for k in (i, j):
                    known_of = (run.bodies[k], shares[k], arounds[k], run.blur)
                    local.append(unexplained_displacement(*known_of, meeting.point, 4.0))
                    whole.append(unexplained_displacement(*known_of))
                pairs_found.append(
                    {
                        "row": name, "seed": seed, "true": known[key][0], "got": meeting.gap,
                        "variance": one + other, "local_a": local[0], "local_b": local[1],
                        "whole_a": whole[0], "whole_b": whole[1], "area": meeting.area,
                        "facet": meeting.is_facet, "blur": run.blur, "noise": noise,
                    }
                )  # fmt: skip
            pd.DataFrame(grains_found).to_csv(file.with_suffix(".grains.csv"), index=False)
            pd.DataFrame(pairs_found).to_csv(file.with_suffix(".pairs.csv"), index=False)
            print(name, seed, len(grains_found), len(pairs_found), flush=True)


def main() -> None:
    """Collect errors, or print how often intervals hold."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    options.add_argument("what", choices=("collect",))
    options.add_argument("file", type=Path)
    options.add_argument("--rows", default=",".join(ROWS))
    options.add_argument("--seeds", default="301,302")
    options.add_argument("--count", type=int, default=14)
    asked = options.parse_args()
    warnings.simplefilter("ignore")
    seeds = [int(seed) for seed in asked.seeds.split(",")]
    collect(asked.rows.split(","), seeds, asked.count, asked.file)


if __name__ == "__main__":
    main()
