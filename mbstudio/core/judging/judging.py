"""Judge clones against true grains: what one calls with the features of both."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mbstudio.core.errors import GenerationError
from mbstudio.core.judging.comparing import FEWEST, MOST, Nulls, Sample, compare_samples, sample_of
from mbstudio.core.judging.drifts import find_drifts
from mbstudio.core.judging.features import FEATURE_SETS, FEATURES, SCALES, Features
from mbstudio.core.judging.folds import FOLDS
from mbstudio.core.judging.judgement import Area, Comparison, Judgement, SetResult
from mbstudio.core.judging.likeness import find_likeness, nearest_rows
from mbstudio.core.judging.smoothed_surface import FINE
from mbstudio.core.threads import one_thread

Progress = Callable[[float, str], None]
Groups = Sequence[Hashable]

CLONES = "true against clones"
HALVES = "true against true"
FITS_PAIRED = "true against their own fits"
FITS_UNPAIRED = "true against fits of others"
AVATARS = "true against fits of clones"
FITS_OF_BOTH = "fits of true against fits of clones"

_HALVINGS = 6


@dataclass(frozen=True, eq=False)
class _Bodies:
    """Bodies with the groups of relatives that they are of."""

    features: list[Features]
    groups: list[Hashable]

    def sample(self) -> Sample:
        return sample_of(self.features, self.groups)


@one_thread()
def judge(
    true: Sequence[Features],
    clones: Sequence[Features],
    *,
    clone_parents: Groups | None = None,
    true_groups: Groups | None = None,
    parents: Sequence[Features] | None = None,
    parent_groups: Groups | None = None,
    fits_of_true: Sequence[Features | None] | None = None,
    fits_of_clones: Sequence[Features | None] | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> Judgement:
    """Return whether clones can be told from true grains, and by what.

    A logistic regression and a forest learn to tell them, from each set of features; bodies that they have
    not seen are then scored. All relatives lie in one fold: clones of one parent, and the parent with them,
    or classifiers would know them again.

    Parameters
    ----------
    true, clones : sequence of Features
        Of true grains and of clones, ten each at least.
    clone_parents : sequence of hashable, optional
        What each clone was made of: equal ones are siblings, and relatives of true grains (and parents) of
        the same group. Without it each clone counts as a relative of the grain that it is nearest to.
    true_groups : sequence of hashable, optional
        The group of each true grain; by default each is of its own, 0, 1, 2 and so on.
    parents : sequence of Features, optional
        The grains that clones were made of, where they are not the true ones: novelty is found from them.
    parent_groups : sequence of hashable, optional
        The group of each parent; by default 0, 1, 2 and so on.
    fits_of_true, fits_of_clones : sequence of Features or None, optional
        Of an avatar fitted to each true grain or clone, in their order; None where there is none.
    seed : int
        Of folds, forests, permutations and what is drawn.
    progress : callable, optional
        ``progress(share, message)``; what it raises ends the work.

    Returns
    -------
    Judgement

    Raises
    ------
    GenerationError
        If there are fewer than ten of either, groups or fits do not match them in number, or the clones or
        the true grains are of fewer than five groups, so that no folds can hold relatives together.
    """
    step = _Steps(progress, fits_of_true is not None, fits_of_clones is not None)
    own_groups: list[Hashable] = list(range(len(true))) if true_groups is None else list(true_groups)
    sources = list(true) if parents is None else list(parents)
    source_groups = own_groups if parents is None else list(parent_groups or range(len(sources)))
    _require_as_many(
        ("true grains", true, own_groups), ("clones", clones, clone_parents),
        ("parents", sources, source_groups), ("true grains", true, fits_of_true),
        ("clones", clones, fits_of_clones),
    )  # fmt: skip
    _require_many(len(true), len(clones))
    notes = [f"Scales: {SCALES}."]
    relatives = _relatives_of(clones, clone_parents, [*true, *sources], [*own_groups, *source_groups], notes)
    _require_groups("true grains", own_groups)
    _require_groups("clones", relatives)
    grains, made = _Bodies(list(true), own_groups), _Bodies(list(clones), relatives)
    for words, bodies in (("true grains", true), ("clones", clones)):
        _note_bodies(words, bodies, notes)
    _note_triangles(true, clones, notes)
    comparisons = _compare_all(grains, made, fits_of_true, fits_of_clones, seed, step, notes)
    return Judgement(
        numbers=(len(true), len(clones)),
        comparisons=tuple(comparisons),
        drifts=find_drifts(true, own_groups, clones, relatives, seed),
        likeness=find_likeness(true, own_groups, clones, clone_parents, sources, source_groups),
        notes=tuple(notes),
        seed=seed,
    )


class _Steps:
    """Counts sets of features compared."""

    def __init__(self, progress: Progress | None, fits: bool, made_fits: bool) -> None:
        self._progress = progress
        # The first comparison permutes, which takes about as long as ten without.
        self._weights = 10 * len(FEATURE_SETS)
        self._total = self._weights + len(FEATURE_SETS) * (
            _HALVINGS + 2 * fits + made_fits + (fits and made_fits)
        )
        self._done = 0

    def __call__(self) -> None:
        self._done += 10 if self._done < self._weights else 1
        if self._progress is not None:
            self._progress(min(1.0, self._done / self._total), "Judging")


def _require_as_many(*given: tuple[str, Sequence[Features], Sequence[object] | None]) -> None:
    for words, bodies, groups in given:
        if groups is not None and len(groups) != len(bodies):
            raise GenerationError(
                f"{len(bodies)} {words} come with {len(groups)} groups or fits: give one for each."
            )


def _require_many(true: int, clones: int) -> None:
    if min(true, clones) < FEWEST:
        raise GenerationError(
            f"Judging needs at least {FEWEST} true grains and {FEWEST} clones, not {true} and {clones}: "
            "with fewer nothing can be told."
        )


def _require_groups(words: str, groups: Groups) -> None:
    count = len(set(groups))
    if count < FOLDS:
        kin = "all of one parent" if count == 1 else f"of {count} parents only"
        raise GenerationError(
            f"The {words} are {kin}: relatives must be held out together, which needs {FOLDS} groups at "
            "least. Judge clones of more parents."
        )


def _relatives_of(
    clones: Sequence[Features], clone_parents: Groups | None, grains: Sequence[Features], groups: Groups,
    notes: list[str],
) -> list[Hashable]:  # fmt: skip
    if clone_parents is not None:
        return list(clone_parents)
    relatives = [groups[row] for row in nearest_rows(clones, grains)]
    if len(set(relatives)) < FOLDS:
        notes.append(
            "The parents of the clones are not known, and nearly all clones are nearest to the same few "
            "grains: each clone counts as unrelated, which flatters the classifiers where it is not."
        )
        return [("clone", number) for number in range(len(clones))]
    notes.append(
        "The parents of the clones are not known: each clone is held out together with the grain that it is "
        "nearest to."
    )
    return relatives


def _note_bodies(words: str, bodies: Sequence[Features], notes: list[str]) -> None:
    """Tell which features are missing, of how many bodies, and how many are not star-shaped."""
    missing = np.sum([~np.isfinite(body.values) for body in bodies], axis=0)
    if missing.any():
        named = ", ".join(kind.name for kind, count in zip(FEATURES, missing, strict=True) if count)
        notes.append(
            f"Of {len(bodies)} {words} {int(missing.max())} lack some of these features, and are left out "
            f"where they are needed: {named}."
        )
    overhanging = sum(not body.is_star_shaped for body in bodies)
    if overhanging:
        notes.append(
            f"{overhanging} of {len(bodies)} {words} are not star-shaped about their centre of volume: their "
            "bands are those of the outermost radii."
        )
    if len(bodies) > MOST:
        notes.append(f"Of {len(bodies)} {words} {MOST}, drawn at random, are shown to the classifiers.")


def _note_triangles(true: Sequence[Features], clones: Sequence[Features], notes: list[str]) -> None:
    edges = [float(np.median([body.triangle_edge for body in bodies])) for bodies in (true, clones)]
    if max(edges) > 2.5 * FINE and max(edges) > 1.5 * min(edges):
        notes.append(
            f"Triangles have edges of {edges[0]:.3f} (true) and {edges[1]:.3f} D_n (clones). Facets longer "
            f"than {2.5 * FINE:g} D_n are seen as flat faces with edges between: judge surfaces meshed alike."
        )


def _compare_all(
    grains: _Bodies, made: _Bodies, fits_of_true: Sequence[Features | None] | None,
    fits_of_clones: Sequence[Features | None] | None, seed: int, step: _Steps, notes: list[str],
) -> list[Comparison]:  # fmt: skip
    found, nulls, told = compare_samples(
        CLONES, "True grains against clones", grains.sample(), made.sample(), seed, on_step=step
    )
    notes += told
    halves = _halves_of(grains, seed, nulls, step, notes)
    fits = _fit_comparisons(grains, made, fits_of_true, fits_of_clones, seed, nulls, step, notes)
    return [found, *([] if halves is None else [halves]), *fits]


def _halves_of(grains: _Bodies, seed: int, nulls: Nulls, step: _Steps, notes: list[str]) -> Comparison | None:
    """Return what random halves of the true grains score: mean, and spread over several halvings."""
    every = grains.sample()
    kinds = list(dict.fromkeys(every.groups))
    found: list[Comparison] = []
    for number in range(_HALVINGS):
        rng = np.random.default_rng([seed, 0x4A, number])
        first = {kinds[place] for place in rng.permutation(len(kinds))[: len(kinds) // 2]}
        side = np.array([group in first for group in every.groups])
        if min(side.sum(), (~side).sum()) < FEWEST or len(kinds) < 2 * FOLDS:
            notes.append(
                "There are too few true grains to compare halves of them: twenty at least are needed."
            )
            return None
        halves = compare_samples(HALVES, "", every.take(side), every.take(~side), seed + number, nulls, step)[
            0
        ]
        found.append(halves)
    size = found[0].numbers
    results = [
        SetResult(
            name, size,
            *(_spread([getattr(half[name], word) for half in found]) for word in ("logistic", "forest")),
        )
        for name in [result.features for result in found[0].results]
        if all(name in [result.features for result in half.results] for half in found)
    ]  # fmt: skip
    title = f"True grains against true grains: {_HALVINGS} random halvings, {size[0]} against {size[1]}"
    return replace(found[0], title=title, results=tuple(results))


def _spread(areas: Sequence[Area]) -> Area:
    """Return the mean of several areas, with what one of them fluctuates by as its error."""
    values = [area.value for area in areas]
    error = max(float(np.std(values, ddof=1)), float(np.mean([area.error for area in areas])))
    return Area(float(np.mean(values)), error, float("nan"))


def _fit_comparisons(
    grains: _Bodies, made: _Bodies, fits_of_true: Sequence[Features | None] | None,
    fits_of_clones: Sequence[Features | None] | None, seed: int, nulls: Nulls, step: _Steps,
    notes: list[str],
) -> list[Comparison]:  # fmt: skip
    asked: list[tuple[str, str, Sample, Sample]] = []
    every = grains.sample()
    fitted = None if fits_of_true is None else _those(fits_of_true, grains.groups)
    remade = None if fits_of_clones is None else _those(fits_of_clones, made.groups)
    if fitted is not None:
        fits = fitted.sample()
        asked.append((FITS_PAIRED, "True grains against their own fits", every, fits))
        kinds = list(dict.fromkeys(every.groups))
        rng = np.random.default_rng([seed, 0x0F])
        first = {kinds[place] for place in rng.permutation(len(kinds))[: len(kinds) // 2]}
        asked.append((
            FITS_UNPAIRED, "Half of the true grains against fits of the other half",
            every.take(np.array([group in first for group in every.groups])),
            fits.take(np.array([group not in first for group in fits.groups], dtype=bool)),
        ))  # fmt: skip
    if remade is not None:
        asked.append((AVATARS, "True grains against fits of clones", every, remade.sample()))
        if fitted is not None:
            asked.append(
                (FITS_OF_BOTH, "Fits of true grains against fits of clones", fitted.sample(), remade.sample())
            )
    found = []
    for name, title, first_sample, second_sample in asked:
        if min(len(first_sample), len(second_sample)) < FEWEST:
            notes.append(f"{title}: fewer than {FEWEST} of either, so nothing is told.")
            continue
        comparison, _, told = compare_samples(name, title, first_sample, second_sample, seed, nulls, step)
        found.append(comparison)
        notes += told
    return found


def _those(fits: Sequence[Features | None], groups: Groups) -> _Bodies:
    kept = [(fit, group) for fit, group in zip(fits, groups, strict=True) if fit is not None]
    return _Bodies([fit for fit, _ in kept], [group for _, group in kept])
