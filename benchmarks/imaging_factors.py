"""How true the shape factors of avatars are: the factors of the avatar against those of the true mesh."""

from __future__ import annotations

import numpy as np
from grain_kinds import KnownGrain
from imaging_scores import surface_distances

from mbstudio.core.errors import MbstudioError
from mbstudio.core.imaging import FitResult
from mbstudio.core.metrics import bounding_box, measure

FACTORS = ("volume", "area", "sphericity", "circularity", "csf", "dn", "ds", "dns")
TITLES = (
    "V", "A", "sphericity", "circularity", "CSF", "D_n", "D_s", "D_ns",
    "CSF along the grain's box", "Chamfer", "Hausdorff",
)  # fmt: skip


def errors_of(known: KnownGrain, result: FitResult) -> list[float] | None:
    """Return relative errors of the factors, Chamfer and Hausdorff distance over D_n, all in percent.

    None where one of the two surfaces cannot be measured: not one closed body.
    """
    try:
        true = measure(known.truth, unit=known.grain.unit)
        ours = measure(result.avatar)
        along = measure(result.avatar, along=bounding_box(known.truth).directions)
    except MbstudioError as error:
        print(f"\n{known.name} is not measured: {error}\n")
        return None
    errors = [100 * abs(getattr(ours, name) / getattr(true, name) - 1) for name in FACTORS]
    errors.append(100 * abs(along.csf / true.csf - 1))
    distances = surface_distances(result.avatar.mesh(cells=128), known.truth)
    return errors + [100 * distance / true.dn for distance in distances]


def print_other_boxes(
    fits: list[tuple[KnownGrain, int, FitResult]], errors: list[list[float] | None]
) -> None:
    """Name the grains whose avatar has quite another CSF, with the CSF of the voxels that were fitted."""
    for (known, n, result), one in zip(fits, errors, strict=True):
        if one is None or one[FACTORS.index("csf")] <= 5:
            continue
        true = measure(known.truth, unit=known.grain.unit).csf
        others = {"voxels": measure(known.grain).csf, "avatar": measure(result.avatar).csf}
        found = ", ".join(
            f"{name} {csf:.3f} ({100 * (csf / true - 1):+.1f} %)" for name, csf in others.items()
        )
        print(f"CSF of {known.name}, n = {n}: mesh {true:.3f}, {found}")


def factor_table(title: str, fits: list[tuple[KnownGrain, int, FitResult]]) -> None:
    """Print medians and 95th percentiles over the grains, one row an n."""
    rows, measured = [], [errors_of(known, result) for known, _, result in fits]
    for n in dict.fromkeys(asked for _, asked, _ in fits):
        found = [one for (_, asked, _), one in zip(fits, measured, strict=True) if asked == n]
        errors = np.array([one for one in found if one is not None])
        if not len(errors):
            continue
        middle, high = np.percentile(errors, (50, 95), axis=0)
        cells = " | ".join(f"{a:.2f} / {b:.2f}" for a, b in zip(middle, high, strict=True))
        rows.append(f"| {n} | {len(errors)} of {len(found)} | {cells} |")
    print(
        f"\n### {title}: errors of the factors in %, median / 95th percentile\n\n"
        f"| n | grains measured | {' | '.join(TITLES)} |\n|{'---|' * (len(TITLES) + 2)}\n" + "\n".join(rows),
        flush=True,
    )
    print()
    print_other_boxes(fits, measured)
