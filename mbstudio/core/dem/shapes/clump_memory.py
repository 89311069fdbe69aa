"""Clumps that were fitted before, so that several engines, and previews, do not fit the same ones again."""

from __future__ import annotations

import hashlib
import threading
from collections import OrderedDict
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from mbstudio.core.metaball.avatar import Avatar

_DIGITS = 11
"""Of the control points: what differs less, by a unit that was converted, is one avatar."""
_MOST_BYTES = 64 * 2**20


@dataclass(frozen=True, eq=False)
class NormalForm:
    """An avatar without its size and name.

    Attributes
    ----------
    avatar : Avatar
        With weights that add up to one.
    size : float
        What lengths were divided by, in the unit of the avatar that was given.
    digest : str
    """

    avatar: Avatar
    size: float
    digest: str


def normal_form(avatar: Avatar) -> NormalForm:
    """Return an avatar as it is in whatever unit it was given, rounded to 11 digits."""
    size = float(np.sqrt(avatar.weights.sum()))
    centers = np.round(avatar.centers / size, _DIGITS) + 0.0  # no negative zeros
    weights = _significant(avatar.weights / size**2)
    told = hashlib.sha256(centers.tobytes() + weights.tobytes()).hexdigest()
    return NormalForm(replace(avatar, centers=centers, weights=weights), size, told)


def _significant(values: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Return positive numbers rounded to so many digits each."""
    steps = 10.0 ** (np.floor(np.log10(values)) - (_DIGITS - 1))
    rounded: np.ndarray = np.round(values / steps) * steps
    return rounded


class ClumpMemory:
    """Rows x, y, z, r and figures of clumps in normal form; the oldest go where there are too many.

    What is found is what was kept, bit by bit. It may be asked from any thread.
    """

    def __init__(self, most_bytes: int = _MOST_BYTES) -> None:
        self._kept: OrderedDict[tuple[str, int, int], tuple[np.ndarray, tuple[float, ...]]] = OrderedDict()
        self._most, self._bytes = most_bytes, 0
        self._lock = threading.Lock()

    def find(
        self, digest: str, spheres: int, seed: int
    ) -> tuple[Float[np.ndarray, "n 4"], tuple[float, ...]] | None:
        """Return what was kept of an avatar, a number of spheres and a seed, or None."""
        with self._lock:
            found = self._kept.get((digest, spheres, seed))
            if found is not None:
                self._kept.move_to_end((digest, spheres, seed))
            return found

    def keep(
        self,
        digest: str,
        spheres: int,
        seed: int,
        rows: Float[np.ndarray, "n 4"],
        figures: tuple[float, ...],
    ) -> None:
        """Keep a clump in normal form."""
        rows = np.array(rows)
        rows.flags.writeable = False
        key = (digest, spheres, seed)
        with self._lock:
            if key in self._kept:
                return
            self._kept[key] = (rows, figures)
            self._bytes += rows.nbytes
            while self._bytes > self._most and len(self._kept) > 1:
                _, (old, _figures) = self._kept.popitem(last=False)
                self._bytes -= old.nbytes

    def forget(self) -> None:
        """Keep nothing any more."""
        with self._lock:
            self._kept.clear()
            self._bytes = 0


MEMORY = ClumpMemory()
"""That of this program."""
