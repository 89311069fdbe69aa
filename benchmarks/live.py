"""How fast a grain follows a slider: decode, field on a grid, surface, volume and area; a Markdown table.

Usage: python benchmarks/live.py --cache FOLDER [--population sand290] [--preset pca]

Medians over parents and points half-way between them, one thread, after a run that compiles. FOLDER holds
the populations of benchmarks/parents.py.
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

from mbstudio.core.metaball.surface import sample_solid, volume_and_area
from mbstudio.core.metaball.topology import topology
from mbstudio.core.vae.models.style_learner import StyleLearner
from mbstudio.core.vae.models.training import learn
from mbstudio.core.vae.shaping.latent import interpolate
from mbstudio.core.vae.shaping.latent_recipe import Operation, carry_out
from mbstudio.core.vae.shaping.live_grain import live_grain, surface_on_grid
from mbstudio.core.vae.shaping.meaning import Meanings
from mbstudio.core.vae.shaping.meaning_factors import meaning_factors


def milliseconds(work: Callable[[np.ndarray], object], vectors: np.ndarray) -> tuple[float, float]:
    """Return median and 95th percentile over the vectors, after one that compiles."""
    work(vectors[0])
    spent = []
    for vector in vectors:
        begin = time.process_time()
        work(vector)
        spent.append(1e3 * (time.process_time() - begin))
    return float(np.median(spent)), float(np.percentile(spent, 95))


def tabulate(learner: StyleLearner, count: int) -> None:
    """Print the table of one learner."""
    rng = np.random.default_rng(11)
    pairs = learner.latents[rng.choice(len(learner.latents), (count, 2))]
    vectors = np.stack([interpolate(learner, a, b, [0.5])[0] for a, b in pairs])
    meanings = Meanings.measure(learner)
    slid = Operation("reach", {"meaning": "csf", "to": -1.0})

    def control(z: np.ndarray) -> np.ndarray:
        return learner.decode(z[None]).avatar(0).control

    def drawn(z: np.ndarray, cells: int) -> None:
        rows = control(z)
        surface_on_grid(*sample_solid(rows, cells), rows)
        volume_and_area(rows, cells)

    for title, work in (
        ("decode", control),
        ("field, 48 cells", lambda z: sample_solid(control(z), 48)),
        ("surface, 48 cells", lambda z: surface_on_grid(*sample_solid(control(z), 48), control(z))),
        ("decode, surface, V and A, 48 cells", lambda z: drawn(z, 48)),
        ("decode, surface, V and A, 80 cells", lambda z: drawn(z, 80)),
        ("five factors", lambda z: meaning_factors(learner.decode(z[None]))),
        ("pieces and voids", lambda z: topology(control(z))),
        ("all that a live grain shows, 48 cells", lambda z: live_grain(learner, z, 48)),
        ("all that a live grain shows, 80 cells", lambda z: live_grain(learner, z, 80)),
        ("all that a live grain shows, 96 cells", lambda z: live_grain(learner, z, 96)),
        ("step along a meaning", lambda z: carry_out(learner, z, slid, meanings)),
    ):
        median, slow = milliseconds(work, vectors)
        print(f"| {title} | {median:.1f} | {slow:.1f} |")


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--cache", required=True)
    options.add_argument("--population", default="sand290")
    options.add_argument("--preset", default="pca")
    options.add_argument("--count", type=int, default=60)
    asked = options.parse_args()
    parents = load_parents(asked.cache, asked.population).serialization
    learner = learn(parents, preset=asked.preset)
    print(
        f"### {asked.population}, preset {asked.preset}, n = {parents.template.n}, "
        f"{learner.dimension} latents\n\n| what | median (ms) | 95 % (ms) |\n|---|---|---|"
    )
    tabulate(learner, asked.count)


if __name__ == "__main__":
    main()
