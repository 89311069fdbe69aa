"""How like their parents clones are, and how new: MetaballVAE against principal components and the paper.

Prints Markdown tables. The parents are those of benchmarks/parents.py, made first if they are not in the
cache. Errors are those of exactly measured clones against the exactly measured avatars of their parents.

Run: ``OMP_NUM_THREADS=1 python benchmarks/generation.py --cache FOLDER [SET ...] [--presets aligned pca]
[--seeds 3] [--share 1.0] [--paper-steps 20000] [--processes 1] [--held-out | --learn-on]``.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

os.environ.setdefault("NUMBA_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from parents import Parents, load_parents, make_parents

from mbstudio.core.populations import PAPER_FACTORS, Population
from mbstudio.core.vae.generate.generation import Generation
from mbstudio.core.vae.generate.generator import generate
from mbstudio.core.vae.generate.quality import PAPER_ERRORS, FactorQuality, Quality, assess
from mbstudio.core.vae.models.learning_on import learn_on
from mbstudio.core.vae.models.radii import surface_rms
from mbstudio.core.vae.models.style_learner import StyleLearner
from mbstudio.core.vae.models.training import learn
from mbstudio.core.vae.serialize.serialization import Serialization


@dataclass(frozen=True)
class Aim:
    """What is asked of the clones of one population.

    Attributes
    ----------
    clones : int
    mean, deviation : float
        Largest errors, averaged over the six factors, in percent.
    valid : float
        Least share valid before the guard.
    novelty : tuple of float
    paper : str
        Whose figures in the paper they are compared with; empty for none.
    truth : str
        Population of true new grains, for the floor; empty for none.
    """

    clones: int
    mean: float
    deviation: float
    valid: float
    novelty: tuple[float, float]
    paper: str = ""
    truth: str = ""


AIMS = {
    "sand290": Aim(1000, 0.5, 4.0, 0.995, (0.9, 1.15), "Ottawa sand", "sand1000_true"),
    "cobble20": Aim(1000, 0.5, 5.0, 0.995, (0.75, np.inf), "cobblestone", "cobble1000_true"),
    "sandct250": Aim(1000, 1.5, 8.0, 0.99, (0.0, np.inf)),
    "aggregates48": Aim(500, 1.5, 8.0, 0.98, (0.0, np.inf)),
    "sand290_tuning": Aim(1000, 0.5, 4.0, 0.995, (0.9, 1.15), "Ottawa sand"),
    "cobble20_tuning": Aim(1000, 0.5, 5.0, 0.995, (0.75, np.inf), "cobblestone"),
    "sandct250_tuning": Aim(1000, 1.5, 8.0, 0.99, (0.0, np.inf)),
    "cement24_tuning": Aim(500, 1.5, 8.0, 0.98, (0.0, np.inf)),
}
REPORTED = tuple(name for name in AIMS if not name.endswith("_tuning"))
MOST_COPIES = 0.005
ADDED = 50
MOST_SECONDS = 60.0
LENGTH_UNITS = (1.0, 100.0, 10000.0)


def population(name: str, factors: dict[str, np.ndarray], unit: str) -> Population:
    """Return measured factors as a population."""
    count = len(next(iter(factors.values())))
    return Population(
        name, "avatars", np.arange(1, count + 1), factors, unit, "obb", "avatar",
        tuple("" if np.isfinite(volume) else "not measured" for volume in factors["volume"]), ("",) * count,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Run:
    """One training and one generation.

    Attributes
    ----------
    learner : StyleLearner
    quality : Quality
    generation : Generation
    trained, generated : float
        CPU seconds.
    """

    learner: StyleLearner
    quality: Quality
    generation: Generation
    trained: float
    generated: float


def run(
    parents: Serialization, factors: Population, preset: str, clones: int, seed: int,
    truth: Population | None, processes: int, options: dict[str, Any],
) -> Run:  # fmt: skip
    """Train on parents, generate clones, measure them and compare."""
    start = time.process_time()
    learner = learn(parents, preset, seed=seed, **options)  # type: ignore[arg-type]
    trained = time.process_time() - start
    start = time.process_time()
    found = generate(learner, clones, seed, processes=processes)
    generated = time.process_time() - start
    assert found.factors is not None
    quality = assess(
        parents, factors, found.clones, found.factors, counts=found.counts, true_factors=truth, seed=seed
    )
    return Run(learner, quality, found, trained, generated)


def valid_parents(held: Parents) -> tuple[Serialization, Population]:
    """Return the parents that are valid and measured; the learner sees the same."""
    whole = held.serialization
    assert whole is not None
    good = np.flatnonzero(whole.valid & np.isfinite(held.avatars["volume"]))
    kept = {name: column[good] for name, column in held.avatars.items()}
    return whole.take(good), population("parents", kept, whole.unit)


def cells(values: Sequence[float], digits: int = 2) -> str:
    """Return the mean over seeds, and the spread where there are several."""
    spread = f" ± {np.std(values, ddof=1):.{digits}f}" if len(values) > 1 else ""
    return f"{np.mean(values):.{digits}f}{spread}"


def summary_row(name: str, preset: str, runs: Sequence[Run]) -> str:
    """Return the row of one population and preset: means over seeds."""
    q = [one.quality for one in runs]
    told = [one.discrimination.auc for one in q if one.discrimination is not None]
    before = cells([100 * (one.valid_before or 0) for one in q])
    return (
        f"| {name} | {preset} | {len(runs)} | {cells([one.mean_error for one in q])} "
        f"| {cells([one.deviation_error for one in q])} | {before} "
        f"| {cells([100 * one.valid_after for one in q], 1)} | {cells([one.novelty.novelty for one in q])} "
        f"| {cells([100 * one.novelty.copies for one in q])} | {cells([one.novelty.diversity for one in q])} "
        f"| {cells(told) if told else '–'} | {cells([one.correlation_error for one in q], 3)} "
        f"({q[0].correlation_floor[0]:.3f}) | {cells([one.trained for one in runs], 0)} "
        f"| {cells([one.generated for one in runs], 0)} |"
    )


SUMMARY = (
    "| parents | preset | seeds | error of means % | of s.d. % | valid before % | after % | novelty | copies "
    "% | diversity | told apart (AUC) | correlations (true) | training CPU s | generation CPU s |\n"
    + "|---" * 14
    + "|"
)


def ahead_of_paper(factors: Sequence[FactorQuality], kind: str) -> dict[str, tuple[bool, bool]]:
    """Return whether each factor's errors of mean and deviation are below the paper's, or at the floor.

    Parameters
    ----------
    factors : sequence of FactorQuality
    kind : {'Ottawa sand', 'cobblestone'}
    """
    return {
        row.factor: (
            row.mean_error <= max(PAPER_ERRORS[kind][row.factor][0], row.floor.mean_error[0]),
            row.deviation_error <= max(PAPER_ERRORS[kind][row.factor][1], row.floor.deviation_error[0]),
        )
        for row in factors
    }


def factor_rows(name: str, preset: str, runs: Sequence[Run]) -> list[str]:
    """Return one row a factor: errors, the floor, the paper, distances."""
    rows = []
    paper = AIMS[name].paper
    for place, factor in enumerate(PAPER_FACTORS):
        found = [one.quality.factors[place] for one in runs]
        theirs = "{:.2f} / {:.2f}".format(*PAPER_ERRORS[paper][factor]) if paper else "–"
        floor = found[0].floor
        ahead = "–"
        if paper:
            told = [ahead_of_paper(one.quality.factors, paper)[factor] for one in runs]
            ahead = "yes" if all(all(pair) for pair in told) else "no"
        rows.append(
            f"| {name} {preset} | {factor} | {cells([f.mean_error for f in found])} "
            f"| {floor.mean_error[0]:.2f} | {cells([f.deviation_error for f in found])} "
            f"| {floor.deviation_error[0]:.2f} | {theirs} | {ahead} | {cells([f.ks for f in found], 3)} "
            f"| {floor.ks[0]:.3f} | {cells([f.wasserstein for f in found], 3)} | {floor.wasserstein[0]:.3f} |"
        )
    return rows


FACTORS = (
    "| parents | factor | error of mean % | true new | of s.d. % | true new | paper | ahead or at floor | "
    "K-S D | true new | Wasserstein / s.d. | true new |\n" + "|---" * 12 + "|"
)


def verdict(name: str, runs: Sequence[Run]) -> str:
    """Return which aims are met, on the average over the seeds."""
    aim, q = AIMS[name], [one.quality for one in runs]
    low, high = aim.novelty

    def mean(values: Sequence[float]) -> float:
        return float(np.mean(values))

    checks = {
        f"means <= {aim.mean} %": mean([one.mean_error for one in q]) <= aim.mean,
        f"s.d. <= {aim.deviation} %": mean([one.deviation_error for one in q]) <= aim.deviation,
        f"valid before >= {100 * aim.valid:g} %": mean([one.valid_before or 0 for one in q]) >= aim.valid,
        "valid after 100 %": all(one.valid_after == 1 for one in q),
        f"novelty {low:g} to {high:g}": low <= mean([one.novelty.novelty for one in q]) <= high,
        f"copies < {100 * MOST_COPIES:g} %": mean([one.novelty.copies for one in q]) < MOST_COPIES,
        f"training <= {MOST_SECONDS:g} s": mean([one.trained for one in runs]) <= MOST_SECONDS,
    }
    return "; ".join(f"{words}: {'yes' if met else 'NO'}" for words, met in checks.items())


def print_set(name: str, chosen: argparse.Namespace) -> None:
    """Print the tables of one population."""
    held = load_parents(chosen.cache, name)
    parents, factors = valid_parents(held)
    aim = AIMS[name]
    clones = max(20, round(chosen.share * aim.clones))
    truth = None
    if aim.truth and (chosen.cache / f"{aim.truth}.npz").exists():
        true = load_parents(chosen.cache, aim.truth).truth
        truth = population("true", {key: true[key][:clones] for key in PAPER_FACTORS}, parents.unit)
    for preset, options, words in _kinds(chosen):
        if preset == "paper" and not aim.paper:
            continue
        runs = [
            run(parents, factors, preset, clones, seed, truth, chosen.processes, options)
            for seed in range(chosen.first_seed, chosen.first_seed + chosen.seeds)
        ]
        print(f"\n{SUMMARY}\n{summary_row(name, words, runs)}\n\n{FACTORS}")
        print("\n".join(factor_rows(name, words, runs)))
        print(f"\n{name} {words}: {verdict(name, runs)}. Chosen: {runs[0].generation.how}.", flush=True)


def _kinds(chosen: argparse.Namespace) -> list[tuple[str, dict[str, Any], str]]:
    kinds: list[tuple[str, dict[str, Any], str]] = []
    for preset in chosen.presets:
        if preset != "paper":
            kinds.append((preset, {}, preset))
            continue
        for unit in chosen.length_units:
            options = {"length_unit": unit, "steps": chosen.paper_steps}
            kinds.append((preset, options, f"paper, D_n = {unit:g}, {chosen.paper_steps} steps"))
    return kinds


def print_held_out(names: Sequence[str], chosen: argparse.Namespace) -> None:
    """Print how well parents that were not learned from are encoded and decoded: a fifth, three splits."""
    print("\n| parents | preset | seen, rms % of D_n | held out, rms % of D_n |\n|---|---|---|---|")
    for name in names:
        parents, _ = valid_parents(load_parents(chosen.cache, name))
        for preset, options, words in _kinds(chosen):
            if preset == "paper":
                continue
            cards = [
                learn(parents, preset, seed=seed, held_out=0.2, **options).card  # type: ignore[arg-type]
                for seed in range(chosen.first_seed, chosen.first_seed + chosen.seeds)
            ]
            print(
                f"| {name} | {words} | {cells([100 * card.trained_rms for card in cards])} "
                f"| {cells([100 * card.held_out_rms for card in cards])} |",
                flush=True,
            )


def print_learning_on(names: Sequence[str], chosen: argparse.Namespace) -> None:
    """Print what learning on gives: fifty parents added to those learned, the old ones not forgotten."""
    print(
        f"\n| parents | preset | learned on | CPU s | old ones, rms % of D_n: before | after "
        f"| new ones: before | after |\n{'|---' * 8}|"
    )
    for name in names:
        parents, _ = valid_parents(load_parents(chosen.cache, name))
        added = min(ADDED, len(parents) // 5)
        for preset, options, words in _kinds(chosen):
            found = [
                learning_on(parents, preset, added, seed, options)
                for seed in range(chosen.first_seed, chosen.first_seed + chosen.seeds)
            ]
            print(
                f"| {name} | {words} | {len(parents) - added} + {added} | "
                + " | ".join(
                    cells(column, 0 if place == 0 else 2)
                    for place, column in enumerate(zip(*found, strict=True))
                )
                + " |",
                flush=True,
            )


def learning_on(
    parents: Serialization, preset: str, added: int, seed: int, options: dict[str, Any]
) -> tuple[float, float, float, float, float]:
    """Learn on by some parents; return CPU seconds and errors: old before and after, new before and after."""
    order = np.random.default_rng([seed, 77]).permutation(len(parents))
    old, new = parents.take(order[added:]), parents.take(order[:added])
    learner = learn(old, preset, seed=seed, **options)  # type: ignore[arg-type]

    def error(one: StyleLearner, some: Serialization) -> float:
        return 100 * float(surface_rms(some, one.decode(one.encode(some)[:, : one.core])).mean())

    start = time.process_time()
    training = learn_on(learner, new, seed=seed)
    for _ in training:
        pass
    after = training.result()
    spent = time.process_time() - start
    return spent, error(learner, old), error(after, old), error(learner, new), error(after, new)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("sets", nargs="*", default=list(REPORTED))
    parser.add_argument("--cache", type=Path, required=True)
    parser.add_argument(
        "--presets", nargs="+", default=["aligned", "pca"], choices=("aligned", "pca", "paper")
    )
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--share", type=float, default=1.0, help="Of the clones that the table asks for.")
    parser.add_argument("--paper-steps", type=int, default=20000)
    parser.add_argument("--length-units", type=float, nargs="+", default=list(LENGTH_UNITS))
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--held-out", action="store_true", help="Only the errors of parents held out.")
    parser.add_argument("--learn-on", action="store_true", help="Only what learning on gives.")
    chosen = parser.parse_args()
    for name in chosen.sets:
        if name not in AIMS:
            parser.error(f"'{name}' is not known: use {', '.join(AIMS)}.")
        make_parents(name, chosen.cache, 40)
    if chosen.held_out or chosen.learn_on:
        (print_held_out if chosen.held_out else print_learning_on)(chosen.sets, chosen)
        return
    for name in chosen.sets:
        print_set(name, chosen)


if __name__ == "__main__":
    main()
