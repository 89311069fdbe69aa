"""How a grain was shaped by hand: its operations one by one, so that it can be made again.

Every operation is a pure function of the style-learner, the latent vector before it and what it was
given; its randomness is a seed. What it leads to is kept within the parents' range unless it is given
`BEYOND`.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Float, Float64

from mbstudio.core.errors import StyleError
from mbstudio.core.vae.models.style_learner import StyleLearner
from mbstudio.core.vae.shaping import latent as by_hand
from mbstudio.core.vae.shaping.meaning import Meanings, add_difference
from mbstudio.core.vae.shaping.meaning_factors import MEANINGS

BEYOND = "beyond"
"""What an operation is given with True where it may lead far outside the parents."""
_ON_THE_WAY = 2
"""How often the grain is measured on the way to a value: a slider must not wait for more."""
_CORRECTIONS = 4
"""How often a locked meaning is led back to where it was."""


@dataclass(frozen=True)
class Operation:
    """One step of shaping a grain.

    Attributes
    ----------
    kind : str
        A key of `OPERATIONS`.
    given : mapping of str to value
        What it needs: numbers, words and lists of them, so that JSON can hold it.
    words : str
        What people read.
    """

    kind: str
    given: Mapping[str, Any]
    words: str = ""


@dataclass(frozen=True)
class Recipe:
    """A grain shaped by hand.

    Attributes
    ----------
    name : str
    latent : tuple of float
        Its latent vector: decoding it gives the grain, bit by bit.
    operations : tuple of Operation
        How it came to be.
    style : str
        :func:`style_digest` of the style-learner that it belongs to.
    """

    name: str
    latent: tuple[float, ...]
    operations: tuple[Operation, ...] = field(default=())
    style: str = ""

    @property
    def vector(self) -> Float64[np.ndarray, " d"]:
        """The latent vector as an array."""
        return np.array(self.latent)

    @property
    def words(self) -> str:
        """The operations in one line."""
        return ", ".join(operation.words or operation.kind for operation in self.operations)

    def retrace(self, learner: StyleLearner, meanings: Meanings | None = None) -> Float64[np.ndarray, " d"]:
        """Return the latent vector found by carrying out all operations again.

        Raises
        ------
        StyleError
            If the recipe belongs to another style-learner, or needs meanings that are not given.
        """
        if self.style and self.style != style_digest(learner):
            raise StyleError(
                f"{self.name} was made with another style-learner: open the one it was made with."
            )
        found = by_hand.mean_latent(learner)
        for operation in self.operations:
            found = carry_out(learner, found, operation, meanings)[0]
        return found

    def as_record(self) -> dict[str, Any]:
        """Return the recipe as JSON can hold it."""
        steps = [{"kind": o.kind, "given": dict(o.given), "words": o.words} for o in self.operations]
        return {"name": self.name, "style": self.style, "z": list(self.latent), "operations": steps}


def read_recipe(record: Mapping[str, Any]) -> Recipe:
    """Return the recipe of a record that :meth:`Recipe.as_record` made.

    Raises
    ------
    StyleError
        If something is missing from it, or cannot be.
    """
    if not isinstance(record, Mapping):
        raise StyleError("A recipe is no record of names and values.")
    try:
        steps = tuple(
            Operation(str(step["kind"]), dict(step["given"]), str(step["words"]))
            for step in record["operations"]
        )
        latent = tuple(finite_number(value) for value in record["z"])
        if not latent or not isinstance(record["name"], str) or not isinstance(record["style"], str):
            raise StyleError("A recipe has no latent vector, or a name or style that is no text.")
        return Recipe(record["name"], latent, steps, record["style"])
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise StyleError(f"{error} of a recipe is missing or invalid.") from None


def finite_number(value: Any) -> float:
    """Return a number as it came from JSON; ValueError unless it is one, and finite."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= sys.float_info.max:
        raise ValueError(f"The number {str(value)[:40]!r}")
    return float(value)


def style_digest(learner: StyleLearner) -> str:
    """Return what tells a style-learner from any other: a digest of its parents' latent vectors."""
    return hashlib.sha256(np.round(learner.latents, 9).tobytes()).hexdigest()[:16]


def carry_out(
    learner: StyleLearner,
    latent: Float[np.ndarray, " d"],
    operation: Operation,
    meanings: Meanings | None = None,
) -> tuple[Float64[np.ndarray, " d"], bool]:
    """Return the latent vector after an operation, and whether that led beyond the parents' range.

    There it is held at the edge of the range, unless the operation is given `BEYOND`.

    Raises
    ------
    StyleError
        If the operation is not known, lacks something, or needs meanings that are not there yet.
    """
    if operation.kind not in OPERATIONS:
        raise StyleError(
            f"'{operation.kind}' is not an operation on latent vectors: use {', '.join(OPERATIONS)}."
        )
    here = by_hand.check_latent(learner, latent)
    try:
        moved = OPERATIONS[operation.kind](learner, here, operation.given, meanings)
    except KeyError as error:
        raise StyleError(f"Operation '{operation.kind}' lacks {error}.") from None
    except (IndexError, OverflowError, TypeError, ValueError) as error:
        told = " ".join(str(error).split())[:200]
        raise StyleError(f"Operation '{operation.kind}' was given something impossible: {told}.") from error
    outside = by_hand.is_far_outside(learner, moved)
    held = outside and not operation.given.get(BEYOND)
    return (by_hand.clamp(learner, moved) if held else moved), outside


# ---- the operations --------------------------------------------------------------------------------


def _begin_at_parent(
    learner: StyleLearner, here: np.ndarray, given: Mapping[str, Any], _: object
) -> np.ndarray:
    names = learner.parents.names
    if given["parent"] not in names:
        raise StyleError(f"The style-learner has no parent '{given['parent']}'.")
    return np.array(learner.latents[names.index(given["parent"])])


def _go_to_average(
    learner: StyleLearner, here: np.ndarray, given: Mapping[str, Any], _: object
) -> np.ndarray:
    return np.array(by_hand.mean_latent(learner))


def _take_latent(learner: StyleLearner, here: np.ndarray, given: Mapping[str, Any], _: object) -> np.ndarray:
    return by_hand.check_latent(learner, given["latent"])


def _reach_meaning(
    learner: StyleLearner, here: np.ndarray, given: Mapping[str, Any], meanings: Meanings | None
) -> np.ndarray:
    """Bring one meaning to a value, given in standard deviations about the parents' mean."""
    known = _require_meanings(meanings)
    name = given["meaning"]
    moved = known.bring_to(here, {name: float(given["to"])}, corrections=_ON_THE_WAY)
    return _restore_locked(learner, here, moved, given, None)


def _set_component(
    learner: StyleLearner, here: np.ndarray, given: Mapping[str, Any], _: object
) -> np.ndarray:
    moved = here.copy()
    moved[int(given["component"])] = float(given["to"])
    return moved


def _make_noisy(
    learner: StyleLearner, here: np.ndarray, given: Mapping[str, Any], meanings: Meanings | None
) -> np.ndarray:
    moved = by_hand.add_noise(learner, here, float(given["sigma"]), int(given["seed"]))[0]
    return _restore_locked(learner, here, moved, given, meanings)


def _draw_random(
    learner: StyleLearner, here: np.ndarray, given: Mapping[str, Any], meanings: Meanings | None
) -> np.ndarray:
    return _restore_locked(learner, here, learner.sample(1, int(given["seed"])).latents[0], given, meanings)


def _go_between(learner: StyleLearner, here: np.ndarray, given: Mapping[str, Any], _: object) -> np.ndarray:
    first, second = (np.asarray(given[key], dtype=np.float64) for key in ("a", "b"))
    latent: np.ndarray = by_hand.interpolate(learner, first, second, [float(given["share"])])[0]
    return latent


def _add_grains(
    learner: StyleLearner, here: np.ndarray, given: Mapping[str, Any], meanings: Meanings | None
) -> np.ndarray:
    plus, minus, base = (np.asarray(given[key], dtype=np.float64) for key in ("a", "b", "c"))
    told = _require_meanings(meanings) if given["told"] else None
    return add_difference(learner, base, plus, minus, float(given["strength"]), meanings=told)


def _go_to_place(learner: StyleLearner, here: np.ndarray, given: Mapping[str, Any], _: object) -> np.ndarray:
    return by_hand.latent_map(learner).latent_at(np.asarray(given["place"], dtype=np.float64), here)


def _restore_locked(
    learner: StyleLearner,
    before: np.ndarray,
    after: np.ndarray,
    given: Mapping[str, Any],
    meanings: Meanings | None,
) -> np.ndarray:
    """Lead locked meanings and components back to where they were."""
    names, components = list(given.get("meanings", ())), list(given.get("components", ()))
    moved = np.array(after)
    moved[components] = before[components]
    if names and meanings is not None:
        units = meanings.units(meanings.factors(before[None]))[0]
        back = {name: float(units[MEANINGS.index(name)]) for name in names}
        moved = meanings.bring_to(moved, back, corrections=_CORRECTIONS)
        moved[components] = before[components]
    return moved


def _require_meanings(meanings: Meanings | None) -> Meanings:
    if meanings is None:
        raise StyleError(
            "The meanings of this style-learner are still being learned: wait a moment and try again."
        )
    return meanings


OPERATIONS: Mapping[
    str, Callable[[StyleLearner, np.ndarray, Mapping[str, Any], Meanings | None], np.ndarray]
] = {
    "begin": _begin_at_parent,
    "average": _go_to_average,
    "take": _take_latent,
    "reach": _reach_meaning,
    "component": _set_component,
    "noise": _make_noisy,
    "random": _draw_random,
    "between": _go_between,
    "sum": _add_grains,
    "place": _go_to_place,
}
"""Every kind of operation: (learner, latent, given, meanings) to the latent vector after it."""
