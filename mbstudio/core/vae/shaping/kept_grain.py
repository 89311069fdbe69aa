"""Grains kept in the latent studio: a recipe, and what was measured of the grain that it makes."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float, Float64

from mbstudio.core.errors import StyleError, UnitError
from mbstudio.core.units import parse_unit
from mbstudio.core.vae.shaping.latent_recipe import Operation, Recipe, carry_out, read_recipe, style_digest

if TYPE_CHECKING:
    from mbstudio.core.metaball.avatar import Avatar
    from mbstudio.core.vae.models.style_learner import StyleLearner
    from mbstudio.core.vae.shaping.meaning import Meanings

RECIPES = "recipes.json"
"""Beside exported kept grains: how each was made."""

_TRIALS = 4
"""Times as many variations are tried as are asked for, where some are no valid bodies."""
_NUMBERED = re.compile(r"kept (\d+)")
_NAME = re.compile(r"\w[\w .+-]*", re.UNICODE)


@dataclass(frozen=True)
class KeptGrain:
    """A grain that was kept, with what it takes to make it again.

    Attributes
    ----------
    recipe : Recipe
        Its name, latent vector, operations and the digest of its style-learner.
    factors : tuple of float
        Of `MEANINGS`, with D_n itself (not its logarithm) first, in `unit`.
    unit : str
        Canonical length unit of its style-learner.
    """

    recipe: Recipe
    factors: tuple[float, ...]
    unit: str

    @property
    def name(self) -> str:
        return self.recipe.name

    def as_record(self) -> dict[str, Any]:
        """Return the grain as JSON can hold it, numbers to the last digit."""
        return {**self.recipe.as_record(), "factors": list(self.factors), "unit": self.unit}


def read_kept_grain(record: Mapping[str, Any]) -> KeptGrain:
    """Return the grain of a record that :meth:`KeptGrain.as_record` made.

    Raises
    ------
    StyleError
        If something is missing from it.
    """
    try:
        factors = tuple(float(value) for value in record["factors"])
        return KeptGrain(read_recipe(record), factors, parse_unit(record["unit"]))
    except (KeyError, OverflowError, TypeError, UnitError, ValueError) as error:
        raise StyleError(f"{error} of a kept grain is missing or invalid.") from None


def measure_recipes(learner: StyleLearner, recipes: Sequence[Recipe]) -> tuple[KeptGrain, ...]:
    """Return recipes as kept grains, with their factors."""
    from mbstudio.core.vae.shaping.meaning_factors import meaning_factors

    if not recipes:
        return ()
    factors = meaning_factors(learner.decode(np.stack([recipe.vector for recipe in recipes])))
    factors[:, 0] = np.exp(factors[:, 0])
    return tuple(
        KeptGrain(recipe, tuple(map(float, row)), learner.unit)
        for recipe, row in zip(recipes, factors, strict=True)
    )


def is_sound(learner: StyleLearner, latent: Float[np.ndarray, " d"]) -> bool:
    """Return whether a latent vector makes one piece without void."""
    from mbstudio.core.metaball.topology import topology

    return topology(learner.decode(np.asarray(latent)[None]).avatar(0).control).is_sound


def find_variations(
    learner: StyleLearner,
    latent: Float[np.ndarray, " d"],
    given: Mapping[str, Any],
    count: int,
    seed: int,
    meanings: Meanings | None = None,
    progress: Callable[[float, str], object] | None = None,
) -> list[tuple[Float64[np.ndarray, " d"], Operation]]:
    """Return at most so many variations of a grain that are valid bodies, each with how it was made.

    Parameters
    ----------
    learner : StyleLearner
    latent : float array, shape (d,)
    given : mapping
        Of the operation noise: sigma, what is locked.
    count, seed : int
        Seeds are tried one after another from `seed` on.
    meanings : Meanings, optional
        Needed where meanings are locked.
    progress : callable, optional
        Told the share done and what is done; what it raises ends the work.
    """
    made: list[tuple[np.ndarray, Operation]] = []
    for number in range(seed, seed + _TRIALS * count):
        words = f"noise σ {given['sigma']:g} (seed {number})"
        operation = Operation("noise", {**given, "seed": number}, words)
        moved = carry_out(learner, latent, operation, meanings)[0]
        if is_sound(learner, moved):
            made.append((moved, operation))
        if progress is not None:
            progress(len(made) / count, f"{len(made)} of {count}")
        if len(made) == count:
            break
    return made


def select_style(kept: Sequence[KeptGrain], learner: StyleLearner | None) -> tuple[KeptGrain, ...]:
    """Return those of the grains that a style-learner can make."""
    if learner is None or not kept:
        return ()
    digest = style_digest(learner)
    return tuple(grain for grain in kept if grain.recipe.style == digest)


def next_number(kept: Sequence[KeptGrain]) -> int:
    """Return the first number above all those of grains called “kept N”."""
    found = [_NUMBERED.fullmatch(grain.name) for grain in kept]
    return 1 + max((int(match[1]) for match in found if match), default=0)


def rename_grain(
    kept: Sequence[KeptGrain], name: str, to: str, taken: Sequence[str] = ()
) -> tuple[KeptGrain, ...]:
    """Return the grains with one of them called otherwise.

    Raises
    ------
    StyleError
        If the name cannot be a file's, or another grain (or one of `taken`) has it.
    """
    wanted = to.strip()
    if not _NAME.fullmatch(wanted):
        raise StyleError(
            f"'{to}' cannot be the name of a grain: begin with a letter or digit and use only letters, "
            "digits, spaces, points, + and -."
        )
    others = {file_name(other) for other in (*(g.name for g in kept if g.name != name), *taken)}
    if file_name(wanted) in others:
        raise StyleError(f"A grain called '{wanted}' exists already: choose another name.")
    return tuple(
        replace(grain, recipe=replace(grain.recipe, name=wanted)) if grain.name == name else grain
        for grain in kept
    )


def file_name(name: str) -> str:
    """Return the name of a grain's files."""
    return name.replace(" ", "_")


def prepare_export(
    learner: StyleLearner, kept: Sequence[KeptGrain]
) -> tuple[list[Avatar], list[str], dict[str, str]]:
    """Return avatars, names of their files, and what lies beside them: the recipes as JSON."""
    names = [file_name(grain.name) for grain in kept]
    # One at a time, as they were made under the hand: many at once differ in the last bit.
    avatars = [
        learner.decode(grain.recipe.vector[None], names=(name,)).avatar(0)
        for grain, name in zip(kept, names, strict=True)
    ]
    return avatars, names, {RECIPES: json.dumps([grain.as_record() for grain in kept], indent=1)}
