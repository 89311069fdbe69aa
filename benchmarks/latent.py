"""What hand work in the latent space does: noise, morphs, meanings, arithmetic, inverse design; Markdown.

Usage: python benchmarks/latent.py --cache FOLDER [--population sand290] [--presets aligned pca] [--seeds 3]

FOLDER holds the populations of benchmarks/parents.py. Factors are those of `meaning_factors`: by rays,
axes of the ellipsoid of equal inertia. Figures are means over the seeds and the standard deviation between
them; a verdict is of the mean, and of the worst seed where something is asked of every grain.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable

os.environ.setdefault("NUMBA_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from parents import load_parents

from mbstudio.core.metaball.topology import topology
from mbstudio.core.metrics.star_factors import STAR_FACTORS, star_factors
from mbstudio.core.vae.models.radii import log_radii
from mbstudio.core.vae.models.style_learner import StyleLearner
from mbstudio.core.vae.models.training import learn
from mbstudio.core.vae.shaping.latent import add_noise, morph
from mbstudio.core.vae.shaping.meaning import Meanings, add_difference
from mbstudio.core.vae.shaping.meaning_factors import MEANINGS

BASES, SUMS, DESIGNS = 20, 60, 60
SIGMAS = (0.1, 0.3, 0.5, 0.7, 0.9, 1.2)
STEPS = np.linspace(-1.5, 1.5, 7)
LEAST = {"size": 0.95, "elongation": 0.95, "csf": 0.95, "sphericity": 0.9, "roughness": 0.9}
DRIFT, WITHIN = 0.35, 0.02

Figures = dict[str, float]


def distances(learner: StyleLearner, latents: np.ndarray) -> np.ndarray:
    """Return the rms of ln r between each grain and the next."""
    return np.sqrt(np.square(np.diff(log_radii(learner.decode(latents)), axis=0)).mean(axis=1))


def share_valid(learner: StyleLearner, latents: np.ndarray) -> float:
    """Return the percentage of latent vectors whose bodies are one piece without void."""
    return 100.0 * float(
        np.mean([topology(avatar.control).is_sound for avatar in learner.decode(latents).avatars()])
    )


def noise_and_morphs(learner: StyleLearner, rows: np.ndarray, rng: np.random.Generator) -> Figures:
    """Return whether noise grows with sigma, and how even and valid morphs are."""
    growing, ratios, ways = [], [], []
    for row in rows:
        here = learner.latents[row]
        away = [
            distances(learner, np.stack([here, add_noise(learner, here, sigma, seed=5)[0]]))[0]
            for sigma in SIGMAS
        ]
        growing.append(bool((np.diff(away) > 0).all()))
        way = morph(learner, here, learner.latents[rng.integers(len(learner.parents))], 11)
        steps = distances(learner, way)
        ratios.append(steps.max() / max(float(steps.mean()), 1e-12))
        ways.append(way)
    return {
        "noise grows": 100.0 * float(np.mean(growing)),
        "morph step": float(max(ratios)),
        "morph valid": share_valid(learner, np.concatenate(ways)),
    }


def meanings_found(meanings: Meanings, rows: np.ndarray, corrections: int = 8) -> Figures:
    """Return how steps along a meaning follow its factor, and what they move beside it."""
    learner, found = meanings.learner, {}
    ours, boxed = [], []
    for place, name in enumerate(MEANINGS):
        follows, slopes, ends = [], [], []
        for row in rows:
            here = learner.latents[row]
            ways = np.stack(
                [meanings.move_along(here, {name: step}, corrections=corrections) for step in STEPS]
            )
            units = meanings.units(meanings.factors(ways))
            follows.append(np.corrcoef(STEPS, units[:, place])[0, 1])
            slopes.append(np.polyfit(STEPS, units, 1)[0])
            ends.append(ways)
            if name == "csf":
                ours.append(units[:, place] * meanings.deviation[place])
                boxed.append(box_csf(learner, ways))
        gains, drifts = np.array(slopes)[:, place], np.delete(np.abs(slopes), place, axis=1)
        found |= {
            f"{name} correlation": float(np.mean(follows)),
            f"{name} least": float(np.min(follows)),
            f"{name} gain": float(gains.mean()),
            f"{name} drift": float(drifts.mean(axis=0).max()),
            f"{name} drift worst": float(drifts.max()),
            f"{name} valid": share_valid(learner, np.concatenate(ends)),
        }
    found["box correlation"] = float(np.mean([np.corrcoef(STEPS, way)[0, 1] for way in boxed]))
    # About each grain's own mean: how steps change it, not how grains differ.
    within, across = (np.concatenate([way - way.mean() for way in ways]) for ways in (ours, boxed))
    found["box slope"] = float(np.polyfit(within, across, 1)[0])
    return found


def box_csf(learner: StyleLearner, latents: np.ndarray) -> np.ndarray:
    """Return the Corey shape factors of the smallest boxes: those of the program's tables."""
    place = STAR_FACTORS.index("csf")
    return np.array([star_factors(avatar.control)[place] for avatar in learner.decode(latents).avatars()])


def boxes_of_parents(meanings: Meanings) -> Figures:
    """Return how the two Corey shape factors go together among the parents."""
    boxed = box_csf(meanings.learner, meanings.learner.latents)
    return {"box parents": float(np.corrcoef(meanings.known[:, MEANINGS.index("csf")], boxed)[0, 1])}


def sums(meanings: Meanings, rng: np.random.Generator) -> Figures:
    """Return how often z3 + z1 - z2 changes a factor the way in which z1 differs from z2."""
    learner, found = meanings.learner, {}
    triples = [rng.choice(len(learner.parents), 3, replace=False) for _ in range(SUMS)]
    for words, told in (("plain", None), ("told", meanings)):
        right, ends = np.zeros(len(MEANINGS)), []
        for first, second, base in triples:
            plus, minus, third = learner.latents[[first, second, base]]
            moved = add_difference(learner, third, plus, minus, 1.0, meanings=told)
            units = meanings.units(meanings.factors(np.stack([plus, minus, third, moved])))
            right += np.sign(units[0] - units[1]) == np.sign(units[3] - units[2])
            ends.append(moved)
        shares = zip(MEANINGS, 100.0 * right / SUMS, strict=True)
        found |= {f"{words} {name}": float(share) for name, share in shares}
        found[f"{words} valid"] = share_valid(learner, np.stack(ends))
    return found


def designs(meanings: Meanings, rng: np.random.Generator) -> Figures:
    """Return how often CSF and sphericity are met: those of parents, and pairs drawn apart from each other.

    Targets lie between the 5 and 95 % of the parents' factors.
    """
    known = meanings.known[:, 2:4]
    low, high = np.percentile(known, [5, 95], axis=0)
    inside = known[((known >= low) & (known <= high)).all(axis=1)]
    found: Figures = {}
    for words, wanted in (
        ("parents", inside[rng.choice(len(inside), DESIGNS)]),
        ("apart", rng.uniform(low, high, (DESIGNS, 2))),
    ):
        made = [meanings.design({"csf": csf, "sphericity": round_}) for csf, round_ in wanted]
        met = np.array([design.residual < WITHIN for design in made])
        possible = np.array([design.is_possible(WITHIN) for design in made])
        found |= {
            f"{words} met": 100.0 * float(met.mean()),
            f"{words} possible": 100.0 * float(possible.mean()),
            f"{words} met possible": 100.0 * float(met[possible].mean()),
            f"{words} worst possible": 100.0 * max(made[i].residual for i in np.flatnonzero(possible)),
            f"{words} valid": share_valid(meanings.learner, np.stack([design.latent for design in made])),
        }
    return found


def run(population: str, cache: str, preset: str, seed: int) -> Figures:
    """Return all figures of one training."""
    parents = load_parents(cache, population).serialization
    assert parents is not None
    begun = time.process_time()
    learner = learn(parents, preset=preset, seed=seed)  # type: ignore[arg-type]
    rng = np.random.default_rng([seed, 1])
    rows = rng.choice(len(parents), BASES, replace=False)
    found = noise_and_morphs(learner, rows, rng)
    meanings = Meanings.measure(learner)
    found |= meanings_found(meanings, rows) | boxes_of_parents(meanings)
    found |= sums(meanings, rng) | designs(meanings, rng)
    return found | {"seconds": time.process_time() - begun}


def told(values: list[float], digits: int) -> str:
    """Return mean and standard deviation over the seeds."""
    spread = f" ± {np.std(values, ddof=1):.{digits}f}" if len(values) > 1 else ""
    return f"{np.mean(values):.{digits}f}{spread}"


def tabulate(preset: str, runs: list[Figures]) -> None:
    """Print the table of one preset."""
    print(f"\n#### {preset}, {len(runs)} seed(s)\n\n| what | required | found | met |\n|---|---|---|---|")

    def line(
        what: str, asked: str, key: str, digits: int = 0, meets: Callable[[float], bool] | None = None,
        *, worst: bool = False, after: str = "",
    ) -> None:  # fmt: skip
        values = [figures[key] for figures in runs]
        verdict = ""
        if meets is not None:
            judged = values if worst else [float(np.mean(values))]
            verdict = "yes" if all(meets(value) for value in judged) else "**NO**"
        print(f"| {what} | {asked} | {told(values, digits)}{after} | {verdict} |")

    def beside(key: str, digits: int) -> str:
        return told([figures[key] for figures in runs], digits)

    line(
        "grains whose deviation grows with sigma (%)", "all", "noise grows", 0, lambda v: v == 100, worst=True
    )
    line("largest step of a morph over its mean step", "1.5", "morph step", 3, lambda v: v <= 1.5, worst=True)
    line("valid grains in morphs (%)", "all", "morph valid", 1, lambda v: v == 100, worst=True)
    for name in MEANINGS:
        after = f" (least {beside(f'{name} least', 2)}), gain {beside(f'{name} gain', 2)}"
        line(f"steps along {name}: correlation", f"{LEAST[name]}", f"{name} correlation", 3,
             lambda v, name=name: v >= LEAST[name], after=after)  # fmt: skip
        after = f" (in any grain {beside(f'{name} drift worst', 2)}); valid {beside(f'{name} valid', 1)} %"
        line(f"steps along {name}: largest drift of another factor", f"{DRIFT}", f"{name} drift", 2,
             lambda v: v <= DRIFT, worst=True, after=after)  # fmt: skip
    line("CSF of the smallest box: correlation with steps along csf", "", "box correlation", 3)
    line("CSF of the smallest box: change per unit change of the CSF by inertia", "", "box slope", 2)
    line("both CSF among the parents: correlation", "", "box parents", 3)
    for name in MEANINGS[:-1]:
        after = f" (plain sum {beside(f'plain {name}', 0)})"
        line(
            f"arithmetic: correct sign of the change in {name} (%)",
            "90",
            f"told {name}",
            1,
            lambda v: v >= 90,
            after=after,
        )
    line("arithmetic: valid grains (%)", "", "told valid", 1)
    line("design for CSF and sphericity of a parent: within 2 % (%)", "95", "parents met", 1,
         lambda v: v >= 95, after=f"; valid {beside('parents valid', 1)} %")  # fmt: skip
    line("the same, drawn independently: of all tries (%)", "95", "apart met", 1, lambda v: v >= 95,
         after=f"; {beside('apart possible', 1)} % are possible")  # fmt: skip
    line("the same, drawn independently: of the possible tries (%)", "95", "apart met possible", 1,
         lambda v: v >= 95,
         after=f"; largest miss {beside('apart worst possible', 1)} %; valid {beside('apart valid', 1)} %",
    )  # fmt: skip
    line("CPU time, training and all of the above (s)", "", "seconds", 0)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cache", required=True)
    parser.add_argument("--population", default="sand290")
    parser.add_argument("--presets", nargs="+", default=["aligned", "pca"])
    parser.add_argument("--seeds", type=int, default=3)
    chosen = parser.parse_args()
    for preset in chosen.presets:
        runs = [run(chosen.population, chosen.cache, preset, seed) for seed in range(chosen.seeds)]
        tabulate(preset, runs)


if __name__ == "__main__":
    main()
