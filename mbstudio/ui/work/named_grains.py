"""The grains that station Latent knows by name: kept ones, parents, clones."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float64

if TYPE_CHECKING:
    from mbstudio.core.project import ProjectState
    from mbstudio.core.vae.generation import Generation
    from mbstudio.core.vae.latent_recipe import Recipe
    from mbstudio.core.vae.style_learner import StyleLearner


def clones_of(state: ProjectState, learner: StyleLearner | None) -> Generation | None:
    """Return the clones of a project where they are those of a style-learner."""
    made = state.clones
    if made is None or learner is None or state.style is not learner:
        return None
    return made if made.latents.shape[1] == learner.dimension else None


def named_latent(
    name: str, kept: Sequence[Recipe], learner: StyleLearner | None, clones: Generation | None
) -> Float64[np.ndarray, " d"] | None:
    """Return the latent vector of a grain by its name: a kept one's before a parent's before a clone's."""
    for recipe in kept:
        if recipe.name == name:
            return recipe.vector
    if learner is not None and name in learner.parents.names:
        return np.array(learner.latents[learner.parents.names.index(name)], dtype=np.float64)
    if clones is not None and name in clones.clones.names:
        return np.array(clones.latents[clones.clones.names.index(name)], dtype=np.float64)
    return None
