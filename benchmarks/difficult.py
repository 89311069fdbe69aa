"""Thin, hollow, tiny, large and stretched grains at many numbers of control points; prints Markdown tables.

Usage: python benchmarks/difficult.py [all] [tiny] [advice] [--tuning] [--only WORD ...] [--n N ...]

Lengths in the names are voxels: "disc 80 x 3" is 80 across and 3 thick. All shapes are turned out
of the voxels' directions unless they are called straight. CPU times are of one core.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable

os.environ.setdefault("NUMBA_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from grain_kinds import (
    Implicit,
    KnownGrain,
    angular,
    box_distance,
    cobble,
    concave,
    known_grain,
    smooth_least,
    turned,
)

from mbstudio.core.errors import FitError
from mbstudio.core.grains import Grain
from mbstudio.core.imaging import FitResult, fit
from mbstudio.core.metaball.surface import volume_and_area

Make = Callable[[], KnownGrain]


def disc(radius: float, half: float) -> Implicit:
    """Return a flat cylinder."""
    return lambda p: np.maximum(np.hypot(p[:, 0], p[:, 1]) - radius, np.abs(p[:, 2]) - half)


def plate(a: float, b: float, half: float) -> Implicit:
    """Return a plate with slightly rounded rims."""
    edge = 0.4 * half
    return lambda p: box_distance(p, np.array([a, b, half]) - edge) - edge


def wave(a: float, half: float) -> Implicit:
    """Return a bent and buckled round sheet."""
    return lambda p: np.maximum(
        np.hypot(p[:, 0], p[:, 1]) - a,
        np.abs(p[:, 2] - 0.15 * np.sin(4 * p[:, 0]) * np.cos(3 * p[:, 1])) / 1.15 - half,
    )


def bowl(radius: float, half: float) -> Implicit:
    """Return a little more than half of a spherical shell."""
    return lambda p: np.maximum(np.abs(np.linalg.norm(p, axis=1) - radius) - half, p[:, 2] - 0.1)


def ring(radius: float, tube: float) -> Implicit:
    """Return a torus."""
    return lambda p: np.hypot(np.hypot(p[:, 0], p[:, 1]) - radius, p[:, 2]) - tube


def horseshoe(radius: float, tube: float) -> Implicit:
    """Return a torus with a gap."""
    return lambda p: np.maximum(
        np.hypot(np.hypot(p[:, 0], p[:, 1]) - radius, p[:, 2]) - tube,
        np.minimum(p[:, 0] - 0.2, 0.3 - np.abs(p[:, 1])),
    )


def pipe(radius: float, half: float, length: float) -> Implicit:
    """Return a tube that is open at both ends."""
    return lambda p: np.maximum(np.abs(np.hypot(p[:, 0], p[:, 1]) - radius) - half, np.abs(p[:, 2]) - length)


def cross(length: float, half: float) -> Implicit:
    """Return three rods through one point."""

    def value(p: np.ndarray) -> np.ndarray:
        rods = [box_distance(p, np.roll([length, half, half], axis)) for axis in range(3)]
        return np.minimum.reduce(rods)

    return value


def dumb_bell(p: np.ndarray) -> np.ndarray:
    return smooth_least(
        np.linalg.norm(np.abs(p) * [1, 1, 1] - [0.55, 0, 0], axis=1) - 0.32,
        box_distance(p, np.array([0.5, 0.04, 0.04])) - 0.04, 0.05,
    )  # fmt: skip


def _made(
    name: str, body: Implicit, side: int, turn: int = 1, ratio: tuple[float, float, float] = (1, 1, 1)
) -> tuple[str, Make]:
    matrix = turned(np.random.default_rng(turn))
    return name, lambda: known_grain("difficult", name, lambda p: body(p @ matrix), side, ratio=ratio)


def _sheet(kind: str, across: int, thick: float, turn: int = 1) -> tuple[str, Make]:
    """A thin body `across` voxels wide and `thick` voxels thick."""
    side = round(across / 0.85)
    wide, half = across / side, thick / side
    body = {
        "disc": lambda: disc(wide, half), "plate": lambda: plate(wide, 0.7 * wide, half),
        "wavy sheet": lambda: wave(wide, half), "bowl": lambda: bowl(wide - half, half),
        "needle": lambda: _needle(wide, half), "ring": lambda: ring(wide - half, half),
        "horseshoe": lambda: horseshoe(wide - half, half), "pipe": lambda: pipe(0.5 * wide, half, 0.8 * wide),
        "cross": lambda: cross(wide, half),
    }[kind]()  # fmt: skip
    return _made(f"{kind} {across} x {thick:g}", body, side, turn)


def _needle(length: float, half: float) -> Implicit:
    return lambda p: box_distance(p, np.array([length, half, half]) * [1, 0.6, 0.6]) - 0.4 * half


def _straight_box(shape: tuple[int, int, int]) -> tuple[str, Make]:
    """A mask that fills its array to the faces."""
    import trimesh

    name = f"straight box {shape[0]} x {shape[1]} x {shape[2]}"

    def make() -> KnownGrain:
        box = trimesh.creation.box(extents=10.0 * np.array(shape[::-1]))
        box.apply_translation(10.0 * (np.array(shape[::-1]) - 1) / 2)
        return KnownGrain("difficult", name, Grain.from_mask(np.ones(shape, bool), "10 um", name=name), box)

    return name, make


def reported() -> dict[str, Make]:
    """Return the shapes of the published tables, by name."""
    rng = np.random.default_rng
    return dict([
        _sheet("disc", 60, 3), _sheet("disc", 80, 4), _sheet("disc", 100, 5), _sheet("disc", 80, 12),
        _sheet("plate", 60, 3), _sheet("plate", 80, 4), _sheet("plate", 100, 5), _sheet("plate", 80, 10),
        _sheet("wavy sheet", 80, 5), _sheet("bowl", 70, 4), _sheet("bowl", 80, 12), _sheet("bowl", 100, 24),
        _sheet("pipe", 80, 6), _sheet("needle", 80, 4), _sheet("needle", 100, 10), _sheet("cross", 80, 8),
        _sheet("ring", 80, 8), _sheet("ring", 80, 24), _sheet("horseshoe", 80, 8),
        _sheet("horseshoe", 80, 24),
        _made("dumb-bell 100", dumb_bell, 110),
        _made("cobble 8", cobble(rng(51)), 9), _made("cobble 12", cobble(rng(52)), 13),
        _made("angular 15", angular(rng(53)), 16), _made("concave 20", concave(rng(54)), 24),
        _made("cobble 25", cobble(rng(55)), 28),
        _made("cobble 60, voxels 3:1:1", cobble(rng(56)), 66, ratio=(3, 1, 1)),
        _made("angular 80, voxels 5:2:1", angular(rng(57)), 90, ratio=(5, 2, 1)),
        _made("disc 80 x 12, voxels 3:1:1", disc(0.8, 0.12), 100, ratio=(3, 1, 1)),
        _straight_box((40, 50, 60)), _straight_box((4, 60, 80)),
        _made("cobble 400", cobble(rng(58)), 400), _made("concave 400", concave(rng(59)), 400),
    ])  # fmt: skip


def tuning() -> dict[str, Make]:
    """Return the shapes on which constants were chosen: none of those reported."""
    return dict([
        _sheet("disc", 70, 3, 2), _sheet("disc", 70, 7, 3), _sheet("disc", 110, 15, 4),
        _sheet("plate", 70, 3, 2), _sheet("plate", 90, 7, 3), _sheet("wavy sheet", 70, 8, 3),
        _sheet("bowl", 60, 6, 2), _sheet("bowl", 90, 16, 3), _sheet("pipe", 70, 9, 2),
        _sheet("needle", 70, 5, 2), _sheet("cross", 60, 5, 2), _sheet("ring", 70, 6, 2),
        _sheet("ring", 90, 16, 3), _sheet("horseshoe", 70, 12, 2),
    ])  # fmt: skip


HEADER = (
    "| grain | n | valid | dV % | rms, voxels | pieces | voids | outside | genus (true) | CPU s | advised "
    "n |\n"
    "|---|---|---|---|---|---|---|---|---|---|---|"
)


def advised(result: FitResult) -> str:
    """Return the number of control points that a verdict advises, or what else it says."""
    text = " ".join(result.verdict.reasons)
    if "try " in text:
        return text.split("try ")[1].split(".")[0].split(":")[0].split(",")[0]
    return "voxels" if "too few" in text else ("" if result.verdict.valid else "other")


def row(known: KnownGrain, n: int, **options: object) -> tuple[str, FitResult | None]:
    """Fit and return a table row: dV is against the true surface."""
    begin = time.process_time()
    try:
        result = fit(known.grain, n, **options)  # type: ignore[arg-type]
    except FitError as error:
        return f"| {known.name} | {n} | refused: {error} | | | | | | | | |", None
    seconds = time.process_time() - begin
    verdict, grain = result.verdict, known.grain
    volume, _ = volume_and_area(result.avatar.control, cells=128)
    genus = round(1 - known.truth.euler_number / 2)
    off = 100 * (volume / known.truth.volume - 1)
    shown = f"{verdict.genus} ({genus})" + ("" if verdict.genus == genus else " wrong")
    return (
        f"| {known.name} | {n} | {'yes' if verdict.valid else 'NO'} | {off:+.2f} "
        f"| {verdict.rms / np.cbrt(grain.voxel_size.volume):.2f} | {verdict.pieces} | {verdict.voids} "
        f"| {verdict.points_outside} | {shown} | {seconds:.2f} | {advised(result)} |"
    ), result


def table(shapes: dict[str, Make], numbers: tuple[int, ...], **options: object) -> None:
    """Print one row a shape and number of control points."""
    print(f"\n### Difficult grains\n\n{HEADER}")
    for make in shapes.values():
        known = make()
        for n in numbers:
            print(row(known, n, **options)[0], flush=True)


def advice(shapes: dict[str, Make], numbers: tuple[int, ...], **options: object) -> None:
    """Follow the advice of every verdict that is not valid, once, and print whether that cured it."""
    print(
        "\n### Following the verdict's advice\n\n"
        "| grain | n, not valid | advised n | then |\n|---|---|---|---|"
    )
    followed = cured = 0
    for make in shapes.values():
        known, done = make(), {}
        for n in numbers:
            result = row(known, n, **options)[1]
            if result is None or result.verdict.valid:
                continue
            said = advised(result)
            if not said.isdigit():
                print(f"| {known.name} | {n} | {said} | {' '.join(result.verdict.reasons)} |", flush=True)
                continue
            if said not in done:
                done[said] = row(known, int(said), **options)
            line, then = done[said]
            fine = then is not None and then.verdict.valid
            followed, cured = followed + 1, cured + fine
            outcome = "cured" if fine else line if then is None else " ".join(then.verdict.reasons)
            handles = f", genus {line.split('|')[9].strip()}" if then is not None else ""
            print(f"| {known.name} | {n} | {said} | {outcome}{handles} |", flush=True)
    print(f"\nThe advice cured {cured} of {followed}.")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("tables", nargs="*", default=["all"])
    parser.add_argument("--tuning", action="store_true", help="the shapes on which constants were chosen")
    parser.add_argument("--only", nargs="*", help="shapes whose name holds one of these words")
    parser.add_argument("--n", type=int, nargs="*", default=[10, 20, 40, 80, 120])
    chosen = parser.parse_args()
    shapes = tuning() if chosen.tuning else reported()
    if chosen.only:
        shapes = {name: make for name, make in shapes.items() if any(word in name for word in chosen.only)}
    if "advice" in chosen.tables:
        advice(shapes, tuple(chosen.n))
    if "all" in chosen.tables:
        table(shapes, tuple(chosen.n))


if __name__ == "__main__":
    main()
