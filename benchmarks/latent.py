"""What hand work in the latent space does: noise, morphs, meanings, arithmetic, inverse design; Markdown.

Usage: python benchmarks/latent.py --cache FOLDER [--population sand290] [--preset pca] [--seed 0]

FOLDER holds the populations of benchmarks/parents.py. Factors are those of `meaning_factors`: by rays,
axes of the ellipsoid of equal inertia.
"""

from __future__ import annotations

import argparse
import os

os.environ.setdefault("NUMBA_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from parents import load_parents

from mbstudio.core.metaball.topology import topology
from mbstudio.core.vae import StyleLearner, learn
from mbstudio.core.vae.latent import added, morphed, noisy
from mbstudio.core.vae.meaning import HELD, Meanings
from mbstudio.core.vae.meaning_factors import MEANINGS
from mbstudio.core.vae.radii import log_radii

BASES, SUMS, DESIGNS = 20, 60, 60
SIGMAS = (0.1, 0.3, 0.5, 0.7, 0.9, 1.2)
STEPS = np.linspace(-1.5, 1.5, 7)


def distances(learner: StyleLearner, latents: np.ndarray) -> np.ndarray:
    """Return the rms of ln r between each grain and the next."""
    return np.sqrt(np.square(np.diff(log_radii(learner.decode(latents)), axis=0)).mean(axis=1))


def print_noise_and_morphs(learner: StyleLearner, rows: np.ndarray, rng: np.random.Generator) -> None:
    """Print whether noise grows with sigma, and how even and valid morphs are."""
    growing, ratios, valid = [], [], []
    for row in rows:
        here = learner.latents[row]
        away = [
            distances(learner, np.stack([here, noisy(learner, here, sigma, seed=5)[0]]))[0]
            for sigma in SIGMAS
        ]
        growing.append(bool((np.diff(away) > 0).all()))
        way = morphed(learner, here, learner.latents[rng.integers(len(learner.parents))], 11)
        steps = distances(learner, way)
        ratios.append(steps.max() / steps.mean())
        valid += [topology(avatar.control).is_sound for avatar in learner.decode(way).avatars()]
    print(f"| noise grows with sigma | {sum(growing)} of {len(growing)} grains |")
    print(f"| largest step of a morph over its mean | {max(ratios):.3f} at most |")
    print(f"| grains of morphs that are valid | {sum(valid)} of {len(valid)} |")


def print_meanings(meanings: Meanings, rows: np.ndarray, corrections: int = 3) -> None:
    """Print how steps along a meaning follow its factor, and what they move beside it."""
    learner = meanings.learner
    for place, name in enumerate(MEANINGS):
        follows, gains, drifts = [], [], []
        for row in rows:
            here = learner.latents[row]
            ways = np.stack([meanings.moved(here, {name: step}, corrections=corrections) for step in STEPS])
            units = meanings.units(meanings.factors(ways))
            follows.append(np.corrcoef(STEPS, units[:, place])[0, 1])
            slopes = np.polyfit(STEPS, units, 1)[0]
            gains.append(slopes[place])
            drifts.append(np.abs(slopes))
        mean = np.mean(drifts, axis=0)
        held = ", ".join(f"{other} {mean[MEANINGS.index(other)]:.2f}" for other in HELD[name])
        free = [other for other in MEANINGS if other != name and other not in HELD[name]]
        loose = "".join(f"; not held: {other} {mean[MEANINGS.index(other)]:.2f}" for other in free)
        print(
            f"| steps along {name} | correlation {np.mean(follows):.3f} (least {np.min(follows):.2f}), "
            f"gain {np.mean(gains):.2f}; drift {held}{loose} |"
        )


def print_sums(meanings: Meanings, rng: np.random.Generator) -> None:
    """Print how often z3 + z1 - z2 changes a factor the way in which z1 differs from z2."""
    learner = meanings.learner
    triples = [rng.choice(len(learner.parents), 3, replace=False) for _ in range(SUMS)]
    for words, told in (("plain sums", None), ("sums as the factors tell", meanings)):
        right = np.zeros(len(MEANINGS))
        for first, second, base in triples:
            plus, minus, third = learner.latents[[first, second, base]]
            moved = added(learner, third, plus, minus, 1.0, meanings=told)
            units = meanings.units(meanings.factors(np.stack([plus, minus, third, moved])))
            right += np.sign(units[0] - units[1]) == np.sign(units[3] - units[2])
        shares = ", ".join(f"{name} {share / SUMS:.2f}" for name, share in zip(MEANINGS, right, strict=True))
        print(f"| {words}: right sign | {shares} |")


def print_designs(meanings: Meanings, rng: np.random.Generator) -> None:
    """Print how often CSF and sphericity are met: those of parents, and pairs drawn apart from each other."""
    known = meanings.factors(meanings.learner.latents)[:, 2:4]
    low, high = np.percentile(known, [5, 95], axis=0)
    for words, wanted in (
        ("of parents", known[rng.choice(len(known), DESIGNS)]),
        ("drawn apart, each from 5 to 95 %", rng.uniform(low, high, (DESIGNS, 2))),
    ):
        found = [meanings.designed({"csf": csf, "sphericity": round_}).residual for csf, round_ in wanted]
        met = np.mean(np.array(found) < 0.02)
        print(
            f"| design for CSF and sphericity {words} | {100 * met:.0f} % in 2 % (worst {max(found):.3f}) |"
        )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cache", required=True)
    parser.add_argument("--population", default="sand290")
    parser.add_argument("--preset", default="pca")
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    parents = load_parents(chosen.cache, chosen.population).serialization
    assert parents is not None
    learner = learn(parents, preset=chosen.preset, seed=chosen.seed)
    rng = np.random.default_rng([chosen.seed, 1])
    rows = rng.choice(len(parents), BASES, replace=False)
    print("| what | found |\n|---|---|")
    print_noise_and_morphs(learner, rows, rng)
    meanings = Meanings.of(learner, chosen.seed)
    print_meanings(meanings, rows)
    print_sums(meanings, rng)
    print_designs(meanings, rng)


if __name__ == "__main__":
    main()
