"""What a generation is: clones, how they came about, and what became of the candidates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from jaxtyping import Float, Int

from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.populations.population import Population
from mbstudio.core.vae.generate.conditions import Reached
from mbstudio.core.vae.serialize.serialization import Serialization


class Learner(Protocol):
    """What the generator needs of a style-learner."""

    @property
    def parents(self) -> Serialization: ...

    def sample(self, count: int, seed: int = 0) -> Any: ...


@dataclass(frozen=True)
class Counts:
    """What became of the candidates.

    Attributes
    ----------
    candidates : int
        How many the style-learner drew.
    valid : int
        Of these: one body without void as drawn.
    repaired : int
        Made one by the guard.
    refused : mapping of str to int
        Given up, by reason.
    clones_repaired : int
        Of the clones: mended ones.
    replaced : int
        Clones that gave way to others once they were measured exactly: outside a range that was asked for, or
        not measurable.
    """

    candidates: int
    valid: int
    repaired: int
    refused: Mapping[str, int]
    clones_repaired: int
    replaced: int

    @property
    def valid_share(self) -> float:
        """Share of the candidates that were valid as drawn."""
        return self.valid / self.candidates


@dataclass(frozen=True, eq=False)
class Generation:
    """Clones, and how they came about.

    Attributes
    ----------
    clones : Serialization
        Every one a valid body.
    latents : float array, shape (clones, d)
        What each was decoded from; a repaired clone differs a little from that.
    parents : int array, shape (clones,)
        Row of the parent that each was drawn from, -1 for none.
    factors : Population or None
        Of kind 'clones', measured as grains and avatars are; None where that was not asked for.
    counts : Counts
    how : str
        What of the parents' distribution they share.
    effective : float
        Number of candidates that were really chosen among: near the number of clones, chance had little say.
    reached : tuple of Reached
        What was asked for and what came of it; empty without targets.
    seed : int
    parent_factors : Population or None
        The parents measured as the clones are; None where that was not needed.
    """

    clones: Serialization
    latents: Float[np.ndarray, "clones d"]
    parents: Int[np.ndarray, " clones"]
    factors: Population | None
    counts: Counts
    how: str
    effective: float
    reached: tuple[Reached, ...]
    seed: int
    parent_factors: Population | None = None

    def __len__(self) -> int:
        return len(self.clones)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the clones."""
        return self.clones.names

    @property
    def unit(self) -> str:
        """Canonical length unit of the clones."""
        return self.clones.unit

    def body(self, row: int) -> Avatar:
        """Return what one clone is, in its principal frame."""
        return self.clones.avatar(row)

    def avatars(self) -> list[Avatar]:
        """Return the clones in their principal frames."""
        return self.clones.avatars()
