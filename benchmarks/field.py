"""How fast an avatar's field, distances and ray hits are; prints Markdown tables.

Usage: python benchmarks/field.py [--device cuda]

One evaluation is one pair of a point and a control point. The baseline is plain numpy, points by
control points, in chunks that fit into the cache, on the same points in the same run.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable
from functools import partial

os.environ.setdefault("NUMBA_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import torch

from mbstudio.core.metaball import Avatar, torch_field
from mbstudio.core.metaball.field import field_and_gradient_at, field_at
from mbstudio.core.metaball.rays import first_hits
from mbstudio.core.metaball.signed_distance import closest_points, first_order_distance, safe_radius

POINTS = 200_000


def blob(n: int) -> Avatar:
    """Return an avatar of n control points spread in a ball, about as large as the ball."""
    rng = np.random.default_rng(n)
    centers = rng.normal(size=(n, 3))
    centers *= 0.8 * np.cbrt(rng.random((n, 1))) / np.linalg.norm(centers, axis=1, keepdims=True)
    return Avatar(centers, np.full(n, 0.8 / n), "mm")


def plain_field(points: np.ndarray, control: np.ndarray, chunk: int = 2000) -> np.ndarray:
    out = np.empty(len(points))
    for start in range(0, len(points), chunk):
        away = points[start : start + chunk, None] - control[:3].T
        out[start : start + chunk] = (control[3] / np.einsum("mnd,mnd->mn", away, away)).sum(axis=1)
    return out


def plain_gradient(points: np.ndarray, control: np.ndarray, chunk: int = 2000) -> np.ndarray:
    out = np.empty((len(points), 3))
    for start in range(0, len(points), chunk):
        away = points[start : start + chunk, None] - control[:3].T
        square = np.einsum("mnd,mnd->mn", away, away)
        out[start : start + chunk] = np.einsum("mn,mnd->md", -2 * control[3] / square**2, away)
    return out


def seconds(work: Callable[[], object], repeats: int = 3) -> float:
    """Return the shortest of some runs, after one that compiles."""
    work()
    found = []
    for _ in range(repeats):
        begin = time.perf_counter()
        work()
        found.append(time.perf_counter() - begin)
    return min(found)


def compare_with_numpy() -> None:
    print(
        f"\n### Field and gradient at {POINTS:,} points, one core\n\n"
        "| n | what | evaluations a second | plain numpy | ratio |\n|---|---|---|---|---|"
    )
    points = np.random.default_rng(0).normal(size=(POINTS, 3))
    for n in (10, 40, 120):
        control = blob(n).control
        for name, ours, plain in (
            ("f", field_at, plain_field),
            ("f and gradient", field_and_gradient_at, plain_gradient),
        ):
            fast = POINTS * n / seconds(partial(ours, points, control))
            slow = POINTS * n / seconds(partial(plain, points, control), 1)
            print(f"| {n} | {name} | {fast:.2e} | {slow:.2e} | {fast / slow:.1f} |", flush=True)


def geometry() -> None:
    print("\n### Distances and rays, one core\n\n| n | what | points or rays a second |\n|---|---|---|")
    rng = np.random.default_rng(1)
    points = rng.uniform(-1.3, 1.3, (20_000, 3))
    origins = 4 * points / np.linalg.norm(points, axis=1, keepdims=True)
    directions = rng.uniform(-1, 1, (20_000, 3)) - origins
    for n in (10, 40, 120):
        control = blob(n).control
        for name, work in (
            ("first-order distance", partial(first_order_distance, points, control)),
            ("radius without surface", partial(safe_radius, points, control)),
            ("nearest surface point", partial(closest_points, points, control)),
            ("ray hit", partial(first_hits, origins, directions, control)),
        ):
            print(f"| {n} | {name} | {len(points) / seconds(work):,.0f} |", flush=True)


def backward(points: torch.Tensor, centers: torch.Tensor, weights: torch.Tensor) -> None:
    torch_field.field(points, centers, weights).sum().backward()


def on_torch(device: str) -> None:
    torch.set_num_threads(1)
    print(f"\n### torch on {device}, single precision\n\n| n | what | evaluations a second |\n|---|---|---|")
    count = POINTS if device == "cpu" else 20 * POINTS
    points = torch.randn(count, 3, device=device)

    def timed(work: Callable[[], object]) -> float:
        def wait() -> None:
            work()
            if device != "cpu":
                torch.cuda.synchronize()

        return seconds(wait)

    for n in (10, 40, 120):
        centers, weights = torch_field.avatar_tensors(blob(n), device=device)
        learned = centers.clone().requires_grad_()
        for name, work in (
            ("f", partial(torch_field.field, points, centers, weights)),
            ("f and gradient", partial(torch_field.field_and_gradient, points, centers, weights)),
            (
                "f, backward to the control points",
                partial(backward, points[: count // 4], learned, weights),
            ),
        ):
            share = 4 if "backward" in name else 1
            print(f"| {n} | {name} | {count // share * n / timed(work):.2e} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--device", default="cpu", help="of the torch table: cpu or cuda")
    chosen = parser.parse_args()
    compare_with_numpy()
    geometry()
    on_torch(chosen.device)


if __name__ == "__main__":
    main()
