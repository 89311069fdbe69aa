"""How suspicious each grain is, with the reasons in words."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from mbstudio.core.errors import GrainError
from mbstudio.core.grains.editing.boxes import box_of_row
from mbstudio.core.grains.editing.label_volume import LabelVolume
from mbstudio.core.grains.suspicion.measures import GrainMeasures, GrainMeasuring, PairMeasures
from mbstudio.core.scan.scan import Scan
from mbstudio.core.units import VoxelSize

if TYPE_CHECKING:
    import pandas as pd

Progress = Callable[[float, str], None]


@dataclass(frozen=True)
class _Weights:
    """A logistic model: log odds = constant + sum of weight * (measure - usual)."""

    constant: float
    usual: Mapping[str, float]
    weights: Mapping[str, float]

    def contributions(self, measures: GrainMeasures | PairMeasures) -> dict[str, float]:
        """Return what each measure adds to the log odds."""
        return {
            name: weight * (getattr(measures, name) - self.usual[name])
            for name, weight in self.weights.items()
        }


# Found by logistic regression on phantoms of other seeds than those that benchmarks/suspicion.py reports on;
# parts of grains also, as segmentations leave few, on grains that were cut in two. How dark a border is, and
# how thin a part, told nothing more there, and are not weighed.
MERGED = _Weights(
    -5.425,
    {"solidity": 0.913, "neck": 1.0, "inner_contrast": 0.0},
    {"solidity": -53.128, "neck": -17.784, "inner_contrast": 22.77},
)
SPLIT = _Weights(
    -7.381,
    {"shared": 0.079, "waist": 0.575, "joint_solidity": 0.836, "groove": 0.152},
    {"shared": 15.814, "waist": 2.74, "joint_solidity": 10.307, "groove": -31.263},
)

# A fit that leaves this many times the median residual speaks for a grain that is several. It was chosen by
# hand: fits of thousands of phantoms take hours.
_LARGE_RESIDUAL, _RESIDUAL_WEIGHT = 2.5, 1.5
# From which contribution to the log odds on a measure is named as a reason.
_WORTH_NAMING = 0.7

BORDERLINE = 0.3
"""Score from which a grain counts as suspicious."""


_OF_PAIR = tuple(PairMeasures.__dataclass_fields__)
COLUMNS = (
    "label", "score", "kind", "solidity", "neck", "inner_contrast", *_OF_PAIR, "residual", "reasons",
)  # fmt: skip


def rank_grains(
    volume: LabelVolume,
    table: pd.DataFrame,
    voxel_size: VoxelSize,
    scan: Scan | None = None,
    residuals: Mapping[int, float] | None = None,
    progress: Progress | None = None,
) -> pd.DataFrame:
    """Return how suspicious each grain is, the most suspicious first.

    Parameters
    ----------
    volume : LabelVolume
    table : DataFrame
        That of the grain set.
    voxel_size : VoxelSize
    scan : Scan, optional
        Look at grey values across borders too.
    residuals : mapping of int to float, optional
        Root mean square distances of avatars over the nominal diameters of their grains, by label.
    progress : callable, optional
        ``progress(fraction, message)``; what it raises ends the work.

    Returns
    -------
    DataFrame
        Columns ``label``, ``score`` (probability 0 to 1 that it is several grains or a part of one, among
        grains as frequent as in the phantoms), ``kind`` (``merged`` or ``split``), the measures of
        :class:`GrainMeasures` and of :class:`PairMeasures` with the ``neighbour`` that speaks most for a
        part, ``residual``, and ``reasons`` in words.

    Raises
    ------
    GrainError
        If the scan is not of the labels' shape.
    """
    import pandas as pd  # imported late: it takes a third of a second

    rows: list[dict[str, Any]] = []
    for row in score_grains(volume, table, voxel_size, scan, residuals):
        if progress is not None:
            progress(len(rows) / len(table), f"{len(rows)} of {len(table)} grains")
        rows.append(row)
    ranked = pd.DataFrame(rows, columns=list(COLUMNS))
    return ranked.sort_values("score", ascending=False, kind="stable").reset_index(drop=True)


def score_grains(
    volume: LabelVolume,
    table: pd.DataFrame,
    voxel_size: VoxelSize,
    scan: Scan | None = None,
    residuals: Mapping[int, float] | None = None,
    labels: Iterable[int] | None = None,
) -> Iterator[dict[str, Any]]:
    """Yield how suspicious grains are one by one, as rows of :func:`rank_grains`.

    Parameters
    ----------
    labels : iterable of int, optional
        Of the grains that are looked at; all, in the order of the table, by default.
    """
    if scan is not None and scan.shape != volume.shape:
        raise GrainError(
            f"The scan has {scan.shape} voxels and the labels {volume.shape}: give the scan that the grains "
            "were found in."
        )
    every = [int(label) for label in table["label"]]
    ends = table[["z0", "z1", "y0", "y1", "x0", "x1"]].to_numpy()
    boxes = {label: box_of_row(row) for label, row in zip(every, ends, strict=True)}
    measuring = GrainMeasuring(volume, boxes, voxel_size, scan.voxels if scan is not None else None)
    given = dict(residuals or {})
    usual = float(np.median(list(given.values()))) if given else 0.0
    for label in every if labels is None else labels:
        yield _row(label, measuring.measure(label), given.get(label), usual)


def _row(label: int, measures: GrainMeasures, residual: float | None, usual: float) -> dict[str, Any]:
    merged = MERGED.contributions(measures)
    if residual is not None and usual > 0 and residual > _LARGE_RESIDUAL * usual:
        merged["residual"] = _RESIDUAL_WEIGHT
    odds = {"merged": MERGED.constant + sum(merged.values()), "split": -np.inf}
    pair, split = PairMeasures(), dict[str, float]()
    for beside in measures.pairs:
        found = SPLIT.contributions(beside)
        if SPLIT.constant + sum(found.values()) > odds["split"]:
            odds["split"], pair, split = SPLIT.constant + sum(found.values()), beside, found
    kind = max(odds, key=lambda name: odds[name])
    named = sorted(({"merged": merged, "split": split}[kind]).items(), key=lambda item: -item[1])
    reasons = [_words(name, measures, pair, residual) for name, weight in named if weight >= _WORTH_NAMING]
    return {
        "label": label,
        "score": float(1 / (1 + np.exp(-odds[kind]))),
        "kind": kind,
        "solidity": measures.solidity,
        "neck": measures.neck,
        "inner_contrast": measures.inner_contrast,
        **{name: getattr(pair, name) for name in _OF_PAIR},
        "residual": np.nan if residual is None else residual,
        "reasons": "; ".join(reasons),
    }


def _words(name: str, measures: GrainMeasures, pair: PairMeasures, residual: float | None) -> str:
    """Return what a measure says, in words."""
    other = pair.neighbour
    return {
        "solidity": f"fills {measures.solidity:.0%} of its convex hull",
        "neck": f"a neck {measures.neck:.0%} as wide as the smaller of its parts",
        "inner_contrast": f"darker by {measures.inner_contrast:.0%} of the contrast at its neck",
        "shared": f"{pair.shared:.0%} of its border lies at grain {other}",
        "waist": f"{min(pair.waist, 1.0):.0%} as thick at the border to grain {other} as the smaller of both",
        "joint_solidity": f"convex together with grain {other} ({pair.joint_solidity:.0%} of alone)",
        "groove": f"no groove along the border to grain {other}",
        "residual": f"its avatar is off by {0.0 if residual is None else residual:.1%} of its diameter",
    }[name]
