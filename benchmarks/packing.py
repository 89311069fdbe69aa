"""Packings: equal spheres against published ones, clones against their parents, MuJoCo against LAMMPS, time.

Run: ``OMP_NUM_THREADS=1 python benchmarks/packing.py [spheres|clones|engines|time ...] [--seeds 4]
[--count 200] [--friction 0.5] [--spheres 20] [--processes 1]``.
"""

from __future__ import annotations

import argparse
import os
import re
import resource
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("NUMBA_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from clones import shared

from mbstudio.core.batch.pool import WorkerPool
from mbstudio.core.cloning.parent_avatars import fit_parents
from mbstudio.core.cloning.surface_generation import generate_surfaces
from mbstudio.core.cloning.surface_style import learn_surfaces
from mbstudio.core.dem import SpecimenPlan, export, make_specimen
from mbstudio.core.dem.body import prepare_bodies
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.packing import packer
from mbstudio.core.packing.comparing import Mean, PackingComparison, compare_packings
from mbstudio.core.packing.grain_kinds import GrainKinds, prepare_kinds, sphere_avatars
from mbstudio.core.packing.mujoco_engine import SettlingJob
from mbstudio.core.packing.packer import pack
from mbstudio.core.packing.packing import Packing
from mbstudio.core.packing.packing_files import write_packing
from mbstudio.core.packing.plan import PackingPlan
from mbstudio.core.packing.poses import Poses
from mbstudio.core.packing.reading import read_packing


def print_table(title: str, head: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """Print a table in Markdown."""
    print(f"\n{title}\n")
    for row in (head, ["---"] * len(head), *rows):
        print("| " + " | ".join(str(cell) for cell in row) + " |", flush=True)


FRICTIONS = (0.0, 0.1, 0.5, 1.0)


def packings(kinds: GrainKinds, count: int, friction: float, seeds: int, **options: object) -> list[Packing]:
    """Return packings of the seeds 0, 1 and so on."""
    return [pack(kinds, count, friction=friction, seed=seed, **options) for seed in range(seeds)]


def told(mean: Mean, digits: int = 4) -> str:
    return f"{mean.value:.{digits}f} ± {mean.error:.{digits}f}"


def row_of(name: str, made: Sequence[Packing]) -> list[str]:
    """Return porosity, coordination, overlap and seconds of packings of several seeds."""
    found = [one.measures() for one in made]
    return [
        name,
        told(Mean.of([one.porosity for one in found])),
        told(Mean.of([one.coordination for one in found]), 2),
        f"{100 * max(one.overlap for one in made):.3f} %",
        f"{np.mean([one.history.get('seconds', np.nan) for one in made]):.1f}",
    ]


HEAD = ("", "porosity", "coordination", "largest overlap", "seconds")


def spheres(options: argparse.Namespace) -> None:
    ball = prepare_kinds([Avatar(np.zeros((1, 3)), np.array([0.25]), "mm")])
    rows = []
    for friction in FRICTIONS:
        made = packings(ball, options.count, friction, options.seeds)
        rows.append(row_of(f"friction {friction:g}", made))
        print(rows[-1], flush=True)
    print_table(f"{options.count} equal spheres, {options.seeds} seeds", HEAD, rows)


def parents_and_clones(options: argparse.Namespace) -> tuple[list[Avatar], list[Avatar]]:
    """Return metaballs freely fitted to 48 aggregates, and to as many clones of them, in the same way."""
    style = learn_surfaces(shared("aggregates", "mm"), seed=0)
    style = fit_parents(style, options.n, processes=options.processes)
    clones = generate_surfaces(style, 48, options.clones_seed, processes=options.processes)
    return [entry.avatar for entry in style.avatars], clones.avatars()


def clones(options: argparse.Namespace) -> None:
    parents, made = parents_and_clones(options)
    kinds = {
        "parents": prepare_kinds(parents, spheres=options.spheres, processes=options.processes),
        "clones": prepare_kinds(made, spheres=options.spheres, processes=options.processes),
    }
    kinds["spheres"] = prepare_kinds(sphere_avatars(kinds["parents"].diameters, "mm"))
    groups: dict[str, list[Packing]] = {}
    for name, kind in kinds.items():
        groups[name] = packings(kind, options.count, options.friction, options.seeds)
        print(row_of(name, groups[name]), flush=True)
    title = f"{options.count} grains, friction {options.friction}, {options.seeds} seeds"
    print_table(title, HEAD, [row_of(name, group) for name, group in groups.items()])
    tell_differences(compare_packings(groups))


def tell_differences(found: PackingComparison) -> None:
    print_table(
        "Differences to the first",
        ("", "of", "difference", "standard errors", "by chance", "differs"),
        [
            (d.measure, d.second, f"{d.value:+.4f} ± {d.error:.4f}", f"{abs(d.value) / d.error:.1f}",
             f"{d.chance:.2g}", "yes" if d.differs else "no")
            for d in found.differences
        ],
    )  # fmt: skip


def made_grain(seed: int) -> Avatar:
    """Return an irregular metaball of eight control points: what it costs to settle is up to its spheres."""
    rng = np.random.default_rng(seed)
    centers = rng.normal(size=(8, 3)) * [0.35, 0.25, 0.2]
    return Avatar(centers, rng.uniform(0.3, 0.6, 8) ** 2 * 6 / 8, "mm", name=f"made_{seed}")


def settled_by_lammps(
    avatars: Sequence[Avatar], program: str, count: int, seed: int, width: float, spheres_each: int
) -> Packing:
    """Return the specimen of an export as its own deck settles it; only the dump is added."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "lammps"
        plan = SpecimenPlan(count, seed=seed, width=width, width_unit="mm")
        export(avatars, "lammps", folder, density=2650.0, specimen=plan, spheres=spheres_each)
        deck = folder / "in.specimen"
        text = deck.read_text()
        # The last frame alone: written when the run has ended.
        last = "write_dump all custom last.lammpstrj id x y z modify sort id format float %.12g"
        deck.write_text(re.sub(r"(?m)^run (\d+)$", rf"run \1\n{last}", text))
        begun = time.monotonic()
        subprocess.run([program, "-in", deck.name], cwd=folder, check=True, capture_output=True)
        seconds = time.monotonic() - begun
        made = read_packing(folder / "last.lammpstrj", avatars, specimen=folder / "specimen.csv")
        return replace(made, history={**made.history, "seconds": seconds})


def from_the_same_start(avatars: Sequence[Avatar], kinds: GrainKinds, plan: PackingPlan) -> Packing:
    """Return what MuJoCo makes of the specimen of an export: the same grains in the same places."""
    _, mould, _ = packer.place_grains(kinds, plan)
    bodies = prepare_bodies(avatars, kinds.names, "mm", 1.0)
    specimen = SpecimenPlan(plan.count, seed=plan.seed, width=2 * mould.half, width_unit="mm")
    made = make_specimen(bodies, specimen, "mm")
    start = Poses(made.kinds, made.scales, made.positions, made.quaternions)
    scale = float(kinds.diameters[start.kinds].mean())
    task = packer.settling_task(kinds, start, mould, plan, scale, made.top)
    settled = WorkerPool(SettlingJob(), 1).map([task])[0]
    return packer._accepted(kinds, start, mould, plan, settled, scale, float("nan"))


def engines(options: argparse.Namespace) -> None:
    program = shutil.which("lmp")
    if program is None:
        raise SystemExit("LAMMPS (lmp) is not installed.")
    parents = [made_grain(seed) for seed in range(12)]
    kinds = prepare_kinds(parents, spheres=options.spheres, processes=options.processes)
    ours = packings(kinds, options.count, 0.5, options.seeds)
    width = 2 * ours[0].mould.half
    theirs = [
        settled_by_lammps(parents, program, options.count, seed, width, options.spheres)
        for seed in range(options.seeds)
    ]
    same = [
        from_the_same_start(parents, kinds, PackingPlan(options.count, seed=seed, spheres=options.spheres))
        for seed in range(options.seeds)
    ]
    rows = [
        row_of("MuJoCo", ours),
        row_of("MuJoCo, same start", same),
        row_of("LAMMPS, deck of the export", theirs),
    ]
    print_table(f"{options.count} made grains, friction 0.5, {options.seeds} seeds", HEAD, rows)
    tell_differences(compare_packings({"LAMMPS": theirs, "MuJoCo": ours, "same start": same}))


def seconds(options: argparse.Namespace) -> None:
    kinds = prepare_kinds([made_grain(seed) for seed in range(12)], spheres=options.spheres, processes=1)
    rows = []
    for count in options.counts:
        before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
        made = pack(kinds, count, friction=options.friction, seed=0)
        settled = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before
        begun = time.process_time()
        found = made.measures(1.0 if count > 100 else 0.8)
        rows.append(
            [count, f"{settled:.1f}", f"{time.process_time() - begun:.1f}", made.history["steps"],
             f"{found.porosity:.3f}", f"{100 * made.overlap:.3f} %"]
        )  # fmt: skip
        print(rows[-1], flush=True)
        if options.keep is not None:
            write_packing(made, options.keep / str(count), inset=0.8)
    head = ("grains", "CPU s to settle", "CPU s to measure", "steps", "porosity", "overlap")
    print_table(f"Clumps of {options.spheres} spheres, friction {options.friction}", head, rows)


PARTS: dict[str, Callable[[argparse.Namespace], None]] = {
    "spheres": spheres,
    "clones": clones,
    "engines": engines,
    "time": seconds,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("parts", nargs="*", choices=[*PARTS, []], default=[])
    parser.add_argument("--seeds", type=int, default=4)
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--counts", type=int, nargs="+", default=[60, 200, 500], help="of the part time")
    parser.add_argument("--keep", type=Path, help="folder for the packings of the part time")
    parser.add_argument("--friction", type=float, default=0.5)
    parser.add_argument("--spheres", type=int, default=20)
    parser.add_argument("--clones-seed", type=int, default=0)
    parser.add_argument("--n", type=int, default=120)
    parser.add_argument("--processes", type=int, default=1)
    options = parser.parse_args()
    for part in options.parts or PARTS:
        PARTS[part](options)


if __name__ == "__main__":
    main()
