"""The paper's own method, its loss converged, beside the fast one."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
from grain_kinds import KnownGrain
from imaging_scores import score, timed_fit

from mbstudio.core.grains import Grain
from mbstudio.core.imaging import FitResult
from mbstudio.core.imaging.paper.gradient_search import PaperFit, PaperOptions


def converged_paper_fit(
    grain: Grain, n: int, most: int = 30_000, **options: object
) -> tuple[FitResult, float, int]:
    """Fit by the paper's method until its loss has converged; return also CPU seconds and generations.

    Adam at the paper's learning rate of 0.001 until the median loss of 500 generations is less
    than 2 % below that of the 500 before, then 500 generations of SGD.
    """
    begin = time.process_time()
    run = PaperFit(grain, n, 0, PaperOptions(generations=most, adam_share=1.0, **options))  # type: ignore[arg-type]
    losses: list[float] = []
    for step in run:
        if step.phase == "search":
            losses.append(step.loss)
            done = len(losses)
            if (
                done >= 1000
                and done % 500 == 0
                and np.median(losses[-500:]) > 0.98 * np.median(losses[-1000:-500])
            ):
                break
    run.options = replace(run.options, adam_share=0.0)
    run.more_generations(500)
    losses += [step.loss for step in run]
    return run.result(), time.process_time() - begin, len(losses)


def against_paper(
    title: str, grains: list[KnownGrain], n: int = 40, most: int = 30_000, **options: object
) -> None:
    """Print the paper's method, its loss converged, beside the fast one on the same grains."""
    print(
        f"\n### {title} and the fast method on the same grains, n = {n}\n\n"
        "| grain | generations | mean loss, paper / fast | abs dV %, paper / fast | dA %, paper / fast "
        "| Chamfer, paper / fast | Hausdorff, paper / fast | not sound, paper / fast "
        "| CPU s, paper / fast | CPU ratio |\n|---|---|---|---|---|---|---|---|---|---|"
    )
    for known in grains:
        theirs, slow, generations = converged_paper_fit(known.grain, n, most, **options)
        ours, quick = timed_fit(known.grain, n)
        a, b = score(known, theirs, slow), score(known, ours, quick)
        unsound = [int(x["pieces"] > 1 or x["voids"] > 0 or x["outside"] > 0) for x in (a, b)]
        print(
            f"| {known.name} | {generations} | {theirs.history[-1]:.5f} / {ours.history[-1]:.5f} "
            f"| {abs(a['dV']):.3f} / {abs(b['dV']):.3f} | {a['dA']:+.2f} / {b['dA']:+.2f} "
            f"| {a['chamfer']:.3f} / {b['chamfer']:.3f} | {a['hausdorff']:.2f} / {b['hausdorff']:.2f} "
            f"| {unsound[0]} / {unsound[1]} | {slow:.1f} / {quick:.2f} | {slow / quick:.0f} |",
            flush=True,
        )
