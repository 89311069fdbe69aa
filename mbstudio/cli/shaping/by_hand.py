"""The operations of ``mbstudio latent``, on grains as people name them."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from mbstudio.cli import console, inputs
from mbstudio.core.errors import StyleError

if TYPE_CHECKING:
    import numpy as np

    from mbstudio.core.vae.models.style_learner import StyleLearner
    from mbstudio.core.vae.serialize.frame import Body
    from mbstudio.core.vae.shaping.meaning import Design, Meanings

TABLE = "latents.csv"
_TOLERANCE = 0.02
_MISSED = 0.1
"""Standard deviations that a step may fall short before a message says so."""


class ByHand:
    """The operations on latent vectors; meanings are measured when they are needed.

    Grains are named in one of these ways: a parent by its name or its number from 1; a file with a mesh
    or an avatar, which is projected into the latent space; ``latents.csv:NAME`` and ``recipes.json:NAME``,
    a grain that was made by hand before.
    """

    def __init__(self, learner: StyleLearner, seed: int, unit: str | None) -> None:
        self.learner, self._seed, self._unit = learner, seed, unit

    @cached_property
    def meanings(self) -> Meanings:
        """The meaning directions of the learner."""
        from mbstudio.core.vae.shaping.meaning import Meanings

        return Meanings.measure(self.learner)

    def latent(self, name: str) -> np.ndarray:
        """Return the latent vector of a grain."""
        names = list(self.learner.parents.names)
        if name in names:
            return self._parent(names.index(name))
        if name.isdigit() and 1 <= int(name) <= len(names):
            return self._parent(int(name) - 1)
        file, _, grain = name.rpartition(":")
        if grain and Path(file).name == TABLE:
            return self._read_table_latent(Path(file), grain)
        if grain and Path(file).suffix.lower() == ".json":
            return self._read_recipe_latent(Path(file), grain)
        if Path(name).is_file():
            return self._read_body_latent(Path(name))
        raise StyleError(
            f"The style-learner has no parent '{name}', and there is no such file: give a number from 1 to "
            f"{len(names)}, a name such as '{names[0]}', or a mesh or avatar."
        )

    def _parent(self, row: int) -> np.ndarray:
        latent: np.ndarray = self.learner.latents[row]
        return latent

    def _read_body_latent(self, path: Path) -> np.ndarray:
        from mbstudio.core.dem.formats.metaball import read_metaball
        from mbstudio.core.vae.serialize.mesh_folder import read_one_body
        from mbstudio.core.vae.shaping.latent import project_bodies

        body: Body
        if inputs.is_mesh(path):
            body = mesh = read_one_body(path, self._unit)
            mesh.units = mesh.units or self.learner.unit
        else:
            body = read_metaball(path)
        latent: np.ndarray = project_bodies(self.learner, [body])[0]
        return latent

    def _read_table_latent(self, path: Path, name: str) -> np.ndarray:
        from mbstudio.core.vae.shaping.latent_files import read_latents

        vectors = read_latents(path)
        if name not in vectors:
            raise StyleError(
                f"{path} has no latent vector named '{name}': give a name from its column 'name'."
            )
        return self._require_dimension(path, vectors[name])

    def _read_recipe_latent(self, path: Path, name: str) -> np.ndarray:
        from mbstudio.core.vae.shaping.latent_files import read_recipes
        from mbstudio.core.vae.shaping.latent_recipe import style_digest

        recipes = read_recipes(path)
        found = next((recipe for recipe in recipes if recipe.name == name), None)
        if found is None:
            known = ", ".join(recipe.name for recipe in recipes) or "none"
            raise StyleError(f"{path} contains no recipe '{name}': it contains {known}.")
        vector = self._require_dimension(path, found.vector)
        if found.style and found.style != style_digest(self.learner):
            raise StyleError(f"{name} in {path} was made with another style-learner: use that style-learner.")
        return vector

    def _require_dimension(self, path: Path, vector: np.ndarray) -> np.ndarray:
        if vector.shape != (self.learner.dimension,):
            raise StyleError(
                f"{path} contains latent vectors of {vector.size} numbers, but this style-learner has "
                f"{self.learner.dimension}: use the style-learner that they were made with."
            )
        return vector

    # ---- the operations ----------------------------------------------------------------------------

    def taken(self, names: list[str]) -> np.ndarray:
        """Return grains as they are."""
        import numpy as np

        return np.stack([self.latent(name) for name in names])

    def interpolated(self, first: str, second: str, steps: int) -> np.ndarray:
        """Return a morph."""
        from mbstudio.core.vae.shaping.latent import morph

        return morph(self.learner, self.latent(first), self.latent(second), steps)

    def added(self, base: str, plus: str, minus: str, strength: float) -> np.ndarray:
        """Return a grain with what makes one differ from another."""
        from mbstudio.core.vae.shaping.meaning import add_difference

        third, first, second = (self.latent(name) for name in (base, plus, minus))
        return add_difference(self.learner, third, first, second, strength, meanings=self.meanings)[None]

    def blended(self, parts: list[str]) -> np.ndarray:
        """Return a weighted sum of grains, each as NAME=WEIGHT."""
        from mbstudio.core.vae.shaping.latent import blend

        weights = [_number(part, "a grain with a weight: write for example 12=0.5") for part in parts]
        return blend(self.learner, self.taken([name for name, _ in weights]), [w for _, w in weights])[None]

    def varied(self, name: str, sigma: float, count: int) -> np.ndarray:
        """Return variations of a grain."""
        from mbstudio.core.vae.shaping.latent import add_noise

        return add_noise(self.learner, self.latent(name), sigma, self._seed, count)

    def moved(self, name: str, by: list[str]) -> np.ndarray:
        """Return a grain moved along meanings; tell where it could not follow."""
        import numpy as np

        from mbstudio.core.vae.shaping.meaning_factors import MEANINGS

        if not by:
            raise StyleError(
                "--move needs a distance: give for example --by csf=-1 (standard deviations of the parents)."
            )
        here, steps = self.latent(name), numbers(by)
        moved = self.meanings.move_along(here, steps)
        before, after = self.meanings.units(self.meanings.factors(np.stack([here, moved])))
        for meaning, step in steps.items():
            went = float((after - before)[MEANINGS.index(meaning)])
            if abs(went - step) > _MISSED * max(1.0, abs(step)):
                console.tell(
                    f"mbstudio: {meaning} moves by {went:+.2f} instead of {step:+g} s.d.: the parents' "
                    "range ends there, or the other factors cannot be held any farther."
                )
        return moved[None]

    def design(self, targets: list[str]) -> np.ndarray:
        """Return a grain of given factors."""
        found = self.meanings.design(numbers(targets), tolerance=_TOLERANCE)
        if found.residual > _TOLERANCE:
            raise StyleError(_refusal(found, " ".join(targets)))
        return found.latent[None]


def _refusal(found: Design, targets: str) -> str:
    from mbstudio.core.metrics.form_bound import FLATTEST, highest_sphericity

    reached = ", ".join(f"{name} {value:.4g}" for name, value in found.reached.items())
    if not found.is_possible(_TOLERANCE):
        csf = found.targets.get("csf", 1.0)
        why = "ratios are at most 1"
        if FLATTEST <= csf <= 1.0:
            why = f"the most spherical body of csf {csf:g} has {highest_sphericity(csf):.3f}"
        return f"No body can have {targets}: {why}. The closest grain of these parents has {reached}."
    return f"These parents cannot give {targets}: the closest grain has {reached}."


def numbers(words: list[str]) -> dict[str, float]:
    """Return NAME=NUMBER as a mapping."""
    return dict(_number(word, "a meaning with a number: write for example csf=0.6") for word in words)


def _number(word: str, wanted: str) -> tuple[str, float]:
    name, sign, value = word.rpartition("=")
    try:
        number = float(value)
    except ValueError:
        sign = ""
    if not sign:
        raise StyleError(f"'{word}' is not {wanted}.")
    return name.strip(), number
