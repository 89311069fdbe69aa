"""How near n control points can come to a grain at all: long searches from many random starts."""

from __future__ import annotations

import numpy as np
from grain_kinds import KnownGrain
from imaging_scores import score, surface_distances, timed_fit

from mbstudio.core.imaging.fast import descent
from mbstudio.core.imaging.fast.refine import Refinement, RefineSettings
from mbstudio.core.imaging.fast.relocation import relocate
from mbstudio.core.imaging.preprocess import PreparedGrain, prepare


def long_search(prepared: PreparedGrain, n: int, rng: np.random.Generator) -> Refinement:
    """Search from n random places inside: 150 steps, control points relocated every ten of the first 80."""
    deep = np.argwhere(prepared.distance > 0.06)
    chosen = deep[rng.choice(len(deep), n, replace=False)]
    places = chosen[:, ::-1] * prepared.spacing + prepared.origin
    radii = 0.5 * prepared.distance[tuple(chosen.T)].astype(np.float64)
    # The surface alone, at many points: neither tips nor area, which cost nearness.
    settings = RefineSettings(tip_weight=0.0, fewest_points=4000)
    search = Refinement(prepared, np.vstack([places.T, radii**2]), settings)
    search.control[3] /= float(search.field_on_hull().mean())
    for step in range(1, 151):
        search.advance()
        if step % 10 == 0 and step <= 80:
            relocate(search, max(1, n // 10), rng)
    return search


def floor(grains: list[KnownGrain], n: int = 40, starts: int = 30) -> None:
    """Print the distances of the fast method beside those of long searches from random starts."""
    print(
        f"\n### Chamfer and Hausdorff distance in % of D_n, n = {n}: the fast method, and {starts} long "
        "searches from random starts\n\n"
        "| grain | fast | best | median | worst | Hausdorff: fast | best | median | worst |\n"
        f"|{'---|' * 9}"
    )
    for known in grains:
        dn = (6 * known.truth.volume / np.pi) ** (1 / 3)
        prepared, rng = prepare(known.grain), np.random.default_rng(0)
        ours, _ = timed_fit(known.grain, n)
        avatars = [ours.avatar] + [
            prepared.avatar(long_search(prepared, n, rng).control) for _ in range(starts)
        ]
        distances = [surface_distances(avatar.mesh(cells=128), known.truth) for avatar in avatars]
        found = 100 * np.array(distances) / dn
        cells = []
        for column, digits in zip(found.T, (3, 2), strict=True):
            shown = (column[0], *np.percentile(column[1:], (0, 50, 100)))
            cells += [f"{value:.{digits}f}" for value in shown]
        print(f"| {known.name} | {' | '.join(cells)} |", flush=True)


def against_plain(grains: list[KnownGrain], n: int = 120) -> None:
    """Print what the fast method and a plain search leave at corners, median and largest over the grains."""
    plain = RefineSettings(tip_weight=0.0, area_weight=0.0)
    print(
        f"\n### Edges and corners, {len(grains)} {grains[0].kind} grains, n = {n}: the fast method, and a "
        "plain search (no weight for tips and area, no control point relocated)\n\n"
        "| search | dA % | Chamfer | Hausdorff (max) |\n|---|---|---|---|"
    )
    fewest = descent._FEWEST_TO_RELOCATE
    for name, settings, relocated_from in (("plain", plain, n + 1), ("fast", RefineSettings(), fewest)):
        descent._FEWEST_TO_RELOCATE = relocated_from
        found = [score(known, *timed_fit(known.grain, n, refine=settings)) for known in grains]
        area, near, far = (np.array([one[key] for one in found]) for key in ("dA", "chamfer", "hausdorff"))
        cells = f"{np.median(area):+.2f} | {np.median(near):.3f} | {np.median(far):.2f} ({far.max():.2f})"
        print(f"| {name} | {cells} |")
    descent._FEWEST_TO_RELOCATE = fewest
