"""The floor of the metaball: free fits to true grains, told from the same grains by the judge of the program.

Run: ``OMP_NUM_THREADS=1 python benchmarks/fit_floor.py [KIND ...] [--numbers 120 200 400]``, kinds as in
clones.py. Each half of the grains is judged by itself; areas are the means of both, with the error of that.
Paired: each fit against its own grain; .5 would mean that nobody can tell them apart.
"""

from __future__ import annotations

import argparse
import os
import time

os.environ.setdefault("NUMBA_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import trimesh
from clones import KINDS

from mbstudio.core.cloning.parent_surface import ParentSurface
from mbstudio.core.cloning.surface_avatars import fit_parent
from mbstudio.core.judging.judging import judge
from mbstudio.core.judging.measuring import measure_features

PAIRED = "true against their own fits"


def main() -> None:
    """Print one row a kind and number of control points."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("kinds", nargs="*", metavar="KIND")
    options.add_argument("--numbers", type=int, nargs="+", default=[120, 200, 400])
    asked = options.parse_args()
    is_first = True
    for kind in asked.kinds or ["aggregates"]:
        parents = [
            ParentSurface.from_mesh(mesh, f"{kind} {place}", str(mesh.units))
            for place, mesh in enumerate(KINDS[kind]())
        ]
        fit_parent(parents[0], max(asked.numbers))  # compiles
        halves = [parents[::2], parents[1::2]]
        known = [measure_features([_mesh(parent) for parent in half], workers=0) for half in halves]
        for n in asked.numbers:
            judged, rms, valid, begun = [], [], 0, time.process_time()
            fitted = [[fit_parent(parent, n) for parent in half] for half in halves]
            seconds = (time.process_time() - begun) / len(parents)
            for true, fits in zip(known, fitted, strict=True):
                rms += [100 * fit.rms for fit in fits]
                valid += sum(fit.valid for fit in fits)
                found = measure_features([fit.avatar for fit in fits], workers=0)
                judgement = judge(
                    true, true, clone_parents=[f"grain {place}" for place in range(len(true))],
                    fits_of_true=found,
                )  # fmt: skip
                judged.append(next(entry for entry in judgement.comparisons if entry.name == PAIRED))
            if is_first:
                names = [result.features for result in judged[0].results]
                print("| grains | n | " + " | ".join(names) + " | rms, % of D_n | valid | CPU s |")
                print("|---" * (len(names) + 5) + "|")
                is_first = False
            cells = []
            for place in range(len(judged[0].results)):
                results = [comparison.results[place] for comparison in judged]
                areas = [
                    (
                        np.mean([getattr(result, kind).value for result in results]),
                        np.mean([getattr(result, kind).error for result in results]) / np.sqrt(2),
                    )
                    for kind in ("logistic", "forest")
                ]
                cells.append(", ".join(f"{value:.2f} ± {error:.2f}" for value, error in areas))
            print(
                f"| {len(parents)} {kind} | {n} | " + " | ".join(cells)
                + f" | {np.mean(rms):.3f} | {valid} of {len(rms)} | {seconds:.2f} |",
                flush=True,
            )  # fmt: skip


def _mesh(parent: ParentSurface) -> trimesh.Trimesh:
    mesh = trimesh.Trimesh(parent.body_vertices(), parent.faces, process=False)
    mesh.units = parent.unit
    return mesh


if __name__ == "__main__":
    main()
