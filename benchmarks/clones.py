"""Clones made from surfaces against true grains that they were not made of, by the judge of the program.

Parents are one half of a kind of grains, the judge's true grains the other half, and then the other way
about, for each seed. Every figure has its error beside it, and the same figure for true against true grains.
What the clones were tuned on is said in docs/benchmarks.md; kinds that nothing was tuned on are fair ones.

Run: ``OMP_NUM_THREADS=1 python benchmarks/clones.py [KIND ...] [--seeds 3] [--clones 2] [--n 120]
[--parents 20] [--stretch 1.2] [--warping 0.3] [--detail-stretch 1] [--surfaces-only]
[--preset surfaces|aligned] [--processes 2]``.
"""

from __future__ import annotations

import argparse
import os
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

os.environ.setdefault("NUMBA_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import trimesh
from grain_kinds import Implicit, angular, concave
from parents import implicit_mesh, sand_ct

from mbstudio.core.cloning.clone_maker import CloneOptions
from mbstudio.core.cloning.parent_avatars import fit_parents
from mbstudio.core.cloning.surface_generation import generate_surfaces
from mbstudio.core.cloning.surface_style import learn_surfaces
from mbstudio.core.grains.grain import Grain
from mbstudio.core.judging.features import Features
from mbstudio.core.judging.judgement import Drift, Judgement
from mbstudio.core.judging.judging import judge
from mbstudio.core.judging.measuring import measure_features
from mbstudio.core.meshes.bodies import bodies_of
from mbstudio.core.meshes.listing import find_meshes
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.vae.generate.generator import generate
from mbstudio.core.vae.models.training import learn
from mbstudio.core.vae.serialize.serializer import serialize

DATA = Path(__file__).resolve().parent.parent / ".." / "shared" / "data"


def shared(folder: str, unit: str) -> list[trimesh.Trimesh]:
    """Return the bodies of a folder of the shared data."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return bodies_of(find_meshes(DATA / folder), unit)


def synthetic(
    make: Callable[[np.random.Generator], Implicit], count: int, seed: int
) -> list[trimesh.Trimesh]:
    """Return grains of a recipe of grain_kinds.py."""
    rng = np.random.default_rng(seed)
    return [implicit_mesh(make(rng), 1.25, side=48) for _ in range(count)]


KINDS: dict[str, Callable[[], Sequence[Any]]] = {
    "aggregates": lambda: shared("aggregates", "mm"),
    "cement": lambda: shared("cement", "um"),
    "sand": lambda: sand_ct(slice(0, 96)),
    "angular": lambda: synthetic(angular, 48, 71),
    "concave": lambda: synthetic(concave, 48, 72),
}


def features_of(bodies: Sequence[trimesh.Trimesh | Grain | Avatar], processes: int) -> list[Features]:
    """Return the features of bodies, every one of which must have some."""
    found = measure_features(bodies, workers=processes if processes > 1 else 0)
    for entry in found:
        if isinstance(entry, str):
            raise SystemExit(f"A body has no features: {entry}")
    return [entry for entry in found if not isinstance(entry, str)]


class Clones:
    """Clones of some parents: surfaces and avatars, and the row of the parent of each."""

    def __init__(self, parents: Sequence[Any], asked: argparse.Namespace, seed: int) -> None:
        begun = time.process_time()
        count = asked.clones * len(parents)
        self.surfaces: list[trimesh.Trimesh] = []
        if asked.preset == "surfaces":
            options = CloneOptions(
                stretch=asked.stretch, warping=asked.warping, detail_stretch=asked.detail_stretch
            )
            style = learn_surfaces(parents, seed=seed)
            if not asked.surfaces_only:
                style = fit_parents(style, asked.n, processes=asked.processes)
            found = generate_surfaces(
                style, count, seed, options=options, avatars=bool(style.avatars), processes=asked.processes
            )
            self.surfaces = found.meshes()
            self.avatars = found.avatars() if style.avatars else []
            self.parents = [clone.recipe.parent for clone in found.clones]
            self.fits_of_parents = [entry.avatar for entry in style.avatars]
            errors = [clone.fitted.rms for clone in found.clones if clone.fitted]
            self.rms = float(np.mean(errors)) if errors else float("nan")
        else:
            shapes = serialize(
                parents,
                asked.n,
                unit=getattr(parents[0], "units", None),
                seed=seed,
                processes=asked.processes,
            )
            made = generate(learn(shapes, asked.preset, seed=seed), count, seed, processes=asked.processes)
            self.avatars, self.parents = made.avatars(), made.parents.tolist()
            self.fits_of_parents = shapes.avatars()
            self.rms = float(np.nanmean(shapes.rms))
        self.seconds = time.process_time() - begun


def print_judgement(title: str, found: Sequence[tuple[Judgement, str]]) -> None:
    """Print the areas under the curve of a comparison, averaged over judgements."""
    names = [result.features for result in found[0][0][found[0][1]].results]
    cells = []
    for name in names:
        results = [judgement[key][name] for judgement, key in found]
        for area in ("logistic", "forest"):
            values = [getattr(result, area).value for result in results]
            errors = [getattr(result, area).error for result in results]
            # The two halves are independent; seeds share their grains.
            cells.append(f"{np.mean(values):.2f} ± {np.mean(errors) / np.sqrt(2):.2f}")
    print(f"| {title} | " + " | ".join(cells) + " |", flush=True)


def run_kind(kind: str, asked: argparse.Namespace) -> None:
    """Judge the clones of one kind of grains and print the tables."""
    grains = KINDS[kind]()
    known = features_of(grains, asked.processes)
    judged: list[Judgement] = []
    by_avatars: list[Judgement] = []
    rms, cpu = [], []
    for seed in range(asked.seeds):
        order = np.random.default_rng([seed, 5]).permutation(len(grains))
        halves = np.array_split(order, 2)
        for rows, others in (halves, halves[::-1]):
            chosen = rows[: asked.parents] if asked.parents else rows
            clones = Clones([grains[row] for row in chosen], asked, seed)
            rms.append(clones.rms)
            cpu.append(clones.seconds)
            true, parents = [known[row] for row in others], [known[row] for row in chosen]
            kin = [f"parent {row}" for row in clones.parents]
            parent_groups = [f"parent {row}" for row in range(len(chosen))]
            if not clones.avatars:
                made = features_of(clones.surfaces, asked.processes)
                judged.append(
                    judge(true, made, clone_parents=kin, parents=parents, parent_groups=parent_groups,
                          seed=seed)
                )  # fmt: skip
                continue
            fits = features_of(clones.avatars, asked.processes)
            fits_of_parents = features_of(clones.fits_of_parents, asked.processes)
            # Fits of parents against parents: paired and unpaired floor of the representation.
            floor = judge(parents, fits, fits_of_true=fits_of_parents, clone_parents=kin,
                          true_groups=parent_groups, seed=seed)  # fmt: skip
            by_avatars.append(
                judge(true, fits, clone_parents=kin, parents=parents, parent_groups=parent_groups, seed=seed)
            )
            by_avatars[-1] = replace(
                by_avatars[-1], comparisons=(*by_avatars[-1].comparisons, *floor.comparisons[2:])
            )
            if clones.surfaces:
                made = features_of(clones.surfaces, asked.processes)
                judged.append(
                    judge(true, made, clone_parents=kin, parents=parents, parent_groups=parent_groups,
                          fits_of_clones=fits, seed=seed)
                )  # fmt: skip
    main = judged or by_avatars
    names = [result.features for result in main[0].comparisons[0].results]
    print(
        f"\n### {kind}: {len(grains)} grains, preset {asked.preset}, n = {asked.n}, parents {len(chosen)}\n"
    )
    print("| | " + " | ".join(f"{name}, logistic | {name}, forest" for name in names) + " |")
    print("|---" * (2 * len(names) + 1) + "|")
    for key in [comparison.name for comparison in main[0].comparisons]:
        print_judgement(key, [(entry, key) for entry in main])
    if judged and by_avatars:
        print_judgement("true against avatars of clones", [(e, e.comparisons[0].name) for e in by_avatars])
    for comparison in by_avatars[0].comparisons[2:] if by_avatars else ():
        print_judgement(comparison.name, [(entry, comparison.name) for entry in by_avatars])
    print_drifts(main)
    likeness = [entry.likeness for entry in main]
    for words, name in (("nearest parent, rms of ln r", "distance"), ("correlation with it", "correlation")):
        pairs = np.array([getattr(entry, name) for entry in likeness]).mean(axis=0)
        print(f"- {words}: {pairs[0]:.3f} among true grains, {pairs[1]:.3f} of clones")
    print(f"- correlation with the parent made of: {np.mean([e.source_correlation for e in likeness]):.3f}")
    if by_avatars:
        print(f"- avatars' rms {100 * np.mean(rms):.2f} % of D_n; {np.mean(cpu):.0f} CPU s here a half")


def print_drifts(found: Sequence[Judgement]) -> None:
    """Print how far the means of clones are from those of true grains."""
    print(
        "\n| Feature | drift of the mean, sd of true grains | its error | K-S | K-S of true halves, median |"
    )
    print("|---|---|---|---|---|")
    for row in found[0].drifts:
        drifts = [next(d for d in entry.drifts if d.feature == row.feature) for entry in found]
        error = np.mean([drift.error for drift in drifts]) / np.sqrt(2)
        mean = np.mean([drift.drift for drift in drifts])
        ks, floor = (np.mean(column) for column in _ks_of(drifts))
        print(f"| {row.feature} | {mean:+.2f} | {error:.2f} | {ks:.2f} | {floor:.2f} |")


def _ks_of(drifts: Sequence[Drift]) -> tuple[list[float], list[float]]:
    return [drift.ks for drift in drifts], [drift.ks_floor[0] for drift in drifts]


def main() -> None:
    """Run what the command line asks for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=", ".join(KINDS))
    parser.add_argument("--preset", default="surfaces")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--clones", type=int, default=2, help="for each parent")
    parser.add_argument("--n", type=int, default=120, help="control points")
    parser.add_argument("--parents", type=int, default=0, help="parents in a half at most; 0: all")
    parser.add_argument("--stretch", type=float, default=CloneOptions().stretch)
    parser.add_argument("--warping", type=float, default=CloneOptions().warping)
    parser.add_argument("--detail-stretch", type=float, default=CloneOptions().detail_stretch)
    parser.add_argument("--surfaces-only", action="store_true", help="fit no metaballs")
    parser.add_argument("--processes", type=int, default=1)
    asked = parser.parse_args()
    for kind in asked.kinds or KINDS:
        run_kind(kind, asked)


if __name__ == "__main__":
    main()
