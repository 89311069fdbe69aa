"""What is known of how suspicious grains are, and their order."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from mbstudio.core.grains.suspicion.scoring import BORDERLINE


@dataclass(frozen=True)
class Suspect:
    """How suspicious one grain is.

    Attributes
    ----------
    label : int
    score : float
        Probability 0 to 1 that it is several grains, or a part of one.
    kind : {'merged', 'split'}
        Which of them is likelier.
    neighbour : int
        The grain that it would be a part of together with; 0 for none.
    reasons : str
        In words.
    """

    label: int
    score: float
    kind: str
    neighbour: int
    reasons: str

    @classmethod
    def from_row(cls, row: Mapping[str, Any]) -> Suspect:
        """Return what a row of :func:`~mbstudio.core.grains.suspicion.scoring.rank_grains` says."""
        return cls(
            int(row["label"]), float(row["score"]), str(row["kind"]), int(row["neighbour"]),
            str(row["reasons"]),
        )  # fmt: skip

    @property
    def is_suspicious(self) -> bool:
        """Whether a person should look at it."""
        return self.score >= BORDERLINE


def ranked(suspects: Iterable[Suspect], accepted: frozenset[int] = frozenset()) -> list[Suspect]:
    """Return the suspicious grains that were not accepted, the most suspicious first."""
    found = (one for one in suspects if one.is_suspicious and one.label not in accepted)
    return sorted(found, key=lambda one: (-one.score, one.label))
