"""Generating clones as surfaces, each with a metaball if asked for, spread as the parents or as asked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import trimesh
from jaxtyping import Int

from mbstudio.core.batch.messages import Arrays, Head, Message, Report
from mbstudio.core.batch.pool import Job, WorkerPool
from mbstudio.core.cloning.clone_maker import CloneMap, CloneOptions, CloneRecipe, Surface
from mbstudio.core.cloning.recipe_drawing import draw_recipes
from mbstudio.core.cloning.surface_avatar import SurfaceAvatar
from mbstudio.core.cloning.surface_avatars import carry_avatar, fit_surface
from mbstudio.core.cloning.surface_style import SurfaceStyle
from mbstudio.core.errors import CloningError
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.metrics.factor_table import FACTORS
from mbstudio.core.populations.measuring import measure_population
from mbstudio.core.populations.population import Population
from mbstudio.core.vae.generate.conditions import Condition, Reached, parse_conditions, reach_words
from mbstudio.core.vae.generate.selection import BALANCED_FACTORS, Moments, choose

Progress = Callable[[float, str], None]

_SPARE = 40
_ROUNDS = 5
_MOST_SHARE = 16.0


@dataclass(frozen=True, eq=False)
class SurfaceClone:
    """A new grain: its surface of record, and a metaball fitted to that.

    Attributes
    ----------
    name : str
    surface : Surface
        In its principal frame, in `unit`.
    recipe : CloneRecipe
    parent : str
        Name of the parent whose faces and edges it has.
    unit : str
    fitted : SurfaceAvatar or None
        The metaball, with how far it is from the surface; None where none was asked for.
    shaped : str
        What was done by hand beyond the recipe, in words; empty for a clone that was drawn.
    """

    name: str
    surface: Surface
    recipe: CloneRecipe
    parent: str
    unit: str
    fitted: SurfaceAvatar | None = None
    shaped: str = ""

    def mesh(self) -> trimesh.Trimesh:
        """Return the surface of record as a mesh with its unit."""
        mesh = trimesh.Trimesh(self.surface.vertices, self.surface.faces, process=False)
        mesh.units = self.unit
        mesh.metadata["name"] = self.name
        return mesh


@dataclass(frozen=True, eq=False)
class SurfaceGeneration:
    """Clones, and how they came about.

    Attributes
    ----------
    clones : tuple of SurfaceClone
    factors : Population
        Measured on the surfaces of record.
    candidates : int
        How many were drawn; without conditions as many as there are clones: nothing is chosen among.
    how : str
        By what they were chosen, in words.
    reached : tuple of Reached
        What was asked for, and what came of it.
    seed : int
    options : CloneOptions
    """

    clones: tuple[SurfaceClone, ...]
    factors: Population
    candidates: int
    how: str
    reached: tuple[Reached, ...]
    seed: int
    options: CloneOptions

    def __len__(self) -> int:
        return len(self.clones)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the clones."""
        return tuple(clone.name for clone in self.clones)

    @property
    def unit(self) -> str:
        """Canonical length unit of the clones."""
        return self.clones[0].unit

    def body(self, row: int) -> trimesh.Trimesh:
        """Return what one clone is: its surface of record, in its principal frame."""
        return self.clones[row].mesh()

    def scaled(self, factor: float) -> SurfaceGeneration:
        """Return the clones with all lengths multiplied; the table of factors stays as it is."""

        def scale(clone: SurfaceClone) -> SurfaceClone:
            fitted = clone.fitted
            if fitted is not None:
                ball = fitted.avatar
                grown = replace(ball, centers=ball.centers * factor, weights=ball.weights * factor**2)
                fitted = replace(fitted, avatar=grown)
            return replace(
                clone, surface=Surface(clone.surface.vertices * factor, clone.surface.faces), fitted=fitted,
                recipe=replace(clone.recipe, diameter=clone.recipe.diameter * factor),
            )  # fmt: skip

        # What was asked for was asked in other lengths.
        return replace(self, clones=tuple(map(scale, self.clones)), reached=())

    def meshes(self) -> list[trimesh.Trimesh]:
        """Return the surfaces of record."""
        return [clone.mesh() for clone in self.clones]

    def avatars(self) -> list[Avatar]:
        """Return the metaballs.

        Raises
        ------
        CloningError
            If none were asked for.
        """
        found = [clone.fitted.avatar for clone in self.clones if clone.fitted is not None]
        if len(found) != len(self.clones):
            raise CloningError("These clones have no metaballs: generate them with avatars.")
        return found


def generate_surfaces(
    style: SurfaceStyle,
    count: int,
    seed: int = 0,
    *,
    options: CloneOptions | None = None,
    avatars: bool = True,
    targets: Sequence[str] = (),
    processes: int = 1,
    progress: Progress | None = None,
) -> SurfaceGeneration:
    """Return new grains of a style.

    Without conditions nothing is chosen: form and size are drawn as the parents' are spread, and all that is
    drawn is kept. With conditions, more are drawn than are kept.

    Parameters
    ----------
    style : SurfaceStyle
    count : int
    seed : int
        The same seed gives the same clones, whatever the number of processes, and the first of many are those
        of few.
    options : CloneOptions, optional
    avatars : bool
        Also fit a metaball to each.
    targets : sequence of str, optional
        Conditions, as for :func:`~mbstudio.core.vae.generate.conditions.parse_conditions`.
    processes : int
    progress : callable, optional
        ``progress(share, message)``; what it raises ends the work at once.

    Raises
    ------
    CloningError
        If the count is not positive, the style has no avatars of its parents, or these parents cannot give
        what is asked.
    GenerationError
        If a condition cannot be read.
    """
    if count < 1:
        raise CloningError(f"The number of clones must be 1 or more, not {count}.")
    if avatars and not style.avatars:
        raise CloningError(
            "This style holds no avatars of its parents: learn it with avatars, or ask for none."
        )
    run = _Run(style, seed, options or CloneOptions(), processes, progress or (lambda _share, _words: None))
    wanted = parse_conditions(list(targets), style.unit)
    if wanted:
        rows, factors, reached = run.meet(wanted, count)
        how = f"{' and '.join(map(str, wanted))}, otherwise as similar to the parents as possible"
    else:
        run.draw(count)
        rows, reached, how = np.arange(count), (), "all that were drawn"
        factors = run.measure(0.0, 0.4 if avatars else 1.0)
    clones = run.name_clones(rows)
    if avatars:
        clones = run.fit(clones)
    factors = replace_labels(factors, rows)
    return SurfaceGeneration(tuple(clones), factors, len(run.recipes), how, reached, seed, run.options)


def replace_labels(factors: Population, rows: Int[np.ndarray, " clones"]) -> Population:
    """Return the rows of a population, labelled from 1."""
    return replace(
        factors,
        labels=np.arange(1, len(rows) + 1),
        factors={name: column[rows] for name, column in factors.factors.items()},
        reasons=tuple(factors.reasons[row] for row in rows),
        warnings=tuple(factors.warnings[row] for row in rows),
    )


class _Run:
    """One generation under way: what has been drawn, and measured of it."""

    def __init__(
        self, style: SurfaceStyle, seed: int, options: CloneOptions, processes: int, report: Progress
    ) -> None:
        self.style, self.options = style, options
        self._seed, self._processes, self._report = seed, processes, report
        self.recipes: list[CloneRecipe] = []

    def draw(self, count: int) -> None:
        """Draw until there are so many."""
        self.recipes = draw_recipes(self.style, count, self._seed, self.options)

    def _make(self, row: int) -> SurfaceClone:
        recipe = self.recipes[row]
        surface = CloneMap(self.style, recipe).surface
        return SurfaceClone(
            f"candidate {row + 1}", surface, recipe, self.style.parents[recipe.parent].name, self.style.unit
        )

    def measure(self, begun: float, ended: float, detail: bool = False) -> Population:
        """Return the factors of all that were drawn."""
        meshes = [self._make(row).mesh() for row in range(len(self.recipes))]
        return measure_population(
            meshes, range(1, len(meshes) + 1), name="clones", kind="clones", unit=self.style.unit,
            detail=detail, workers=0 if self._processes <= 1 else self._processes,
            progress=lambda share, words: self._report(begun + (ended - begun) * share, words),
        )  # fmt: skip

    def meet(
        self, wanted: tuple[Condition, ...], count: int
    ) -> tuple[Int[np.ndarray, " clones"], Population, tuple[Reached, ...]]:
        """Return rows of candidates that meet conditions, the factors of all, and what was reached."""
        parents = self._moments_of_parents()
        detail = any(condition.factor not in FACTORS.core for condition in wanted)
        asked = 3 * count + _SPARE
        for round_number in range(_ROUNDS):
            self.draw(asked)
            factors = self.measure(0.1 * round_number, 0.1 * (round_number + 1), detail)
            usable = np.flatnonzero(factors.measured)
            columns = [factors.column(condition.factor)[usable] for condition in wanted]
            admitted = np.logical_and.reduce(
                [condition.admits(column) for condition, column in zip(wanted, columns, strict=True)]
            )
            volumes = factors.column("volume")[usable]
            sums = np.concatenate(
                [condition.rows(column, volumes) for condition, column in zip(wanted, columns, strict=True)],
                axis=1,
            )
            values = np.stack([factors.column(name)[usable] for name in BALANCED_FACTORS], axis=1)
            rng = np.random.default_rng([self._seed, 0xC40, round_number])
            found = choose(values, count, parents, rng, admitted=admitted, asked=sums)
            if found is not None:
                rows = usable[found.rows]
                reached = self._reached(wanted, factors, rows)
                if all(figure.is_met for figure in reached):
                    return rows, factors, reached
            if asked >= _MOST_SHARE * count + _SPARE:
                break
            asked = min(2 * asked, int(_MOST_SHARE * count) + _SPARE)
        raise self._refusal(wanted, count, factors)

    def _moments_of_parents(self) -> Moments:
        meshes = [parent.mesh() for parent in self.style.parents]
        known = measure_population(meshes, unit=self.style.unit, workers=0)
        values = np.stack([known.column(name) for name in BALANCED_FACTORS], axis=1)
        return Moments.from_values(values[np.isfinite(values).all(axis=1)])

    def _reached(
        self, wanted: tuple[Condition, ...], factors: Population, rows: Int[np.ndarray, " clones"]
    ) -> tuple[Reached, ...]:
        volumes = factors.column("volume")[rows]
        found: list[Reached] = []
        for condition in wanted:
            found.extend(condition.reached(factors.column(condition.factor)[rows], volumes))
        return tuple(found)

    def _refusal(self, wanted: tuple[Condition, ...], count: int, factors: Population) -> CloningError:
        usable = factors.measured
        names = dict.fromkeys(condition.factor for condition in wanted)
        reach = ", ".join(reach_words(name, factors.column(name)[usable], self.style.unit) for name in names)
        return CloningError(
            f"These parents cannot give {count} clones with {' and '.join(map(str, wanted))}: their clones "
            f"have {reach}. Ask for values in that range."
        )

    def name_clones(self, rows: Int[np.ndarray, " clones"]) -> list[SurfaceClone]:
        """Return the clones of these rows under their names."""
        digits = len(str(len(rows)))
        return [
            replace(self._make(int(row)), name=f"clone_{place:0{digits}d}")
            for place, row in enumerate(rows, start=1)
        ]

    def fit(self, clones: Sequence[SurfaceClone]) -> list[SurfaceClone]:
        """Return the clones with a metaball each."""
        done = 0

        def count(_task: SurfaceClone, _result: SurfaceAvatar) -> None:
            nonlocal done
            done += 1
            self._report(0.4 + 0.6 * done / len(clones), f"fitting avatars: {done} of {len(clones)}")

        pool = WorkerPool(_AvatarJob(self.style), 0 if self._processes <= 1 else self._processes)
        fitted = pool.map(clones, count)
        return [replace(clone, fitted=entry) for clone, entry in zip(clones, fitted, strict=True)]


class _AvatarJob(Job[SurfaceClone, SurfaceAvatar]):
    """In goes a surface with control points near it, out comes the avatar."""

    def __init__(self, style: SurfaceStyle) -> None:
        self._style = style

    def pack(self, clone: SurfaceClone) -> Message:
        row = clone.recipe.parent
        parent, of_parent = self._style.parents[row], self._style.avatars[row].avatar
        start = carry_avatar(parent, of_parent, CloneMap(self._style, clone.recipe), clone.unit)
        head = {"unit": clone.unit, "name": clone.name}
        return head, {
            "vertices": clone.surface.vertices, "faces": clone.surface.faces, "centers": start.centers,
            "weights": start.weights,
        }  # fmt: skip

    @staticmethod
    def work(head: Head, arrays: Arrays, report: Report) -> Message:
        start = Avatar(arrays["centers"], arrays["weights"], head["unit"], name=head["name"])
        found = fit_surface(
            np.array(arrays["vertices"]),
            np.array(arrays["faces"]),
            head["unit"],
            start=start,
            name=head["name"],
        )
        return (
            {"rms": found.rms, "volume_error": found.volume_error, "valid": found.valid},
            {"centers": found.avatar.centers, "weights": found.avatar.weights},
        )

    def unpack(self, clone: SurfaceClone, head: Head, arrays: Arrays) -> SurfaceAvatar:
        avatar = Avatar(np.array(arrays["centers"]), np.array(arrays["weights"]), clone.unit, name=clone.name)
        return SurfaceAvatar(avatar, head["rms"], head["volume_error"], head["valid"])

    def lose(self, clone: SurfaceClone, code: int) -> SurfaceAvatar:
        raise CloningError(
            f"The process that fitted {clone.name} ended with code {code}: try fewer processes."
        )
