"""Drawing recipes: every parent and every form has its turn, and who gets which form is chance.

Recipes come in rounds. In a round each parent is used once, and the form and size of each parent, a little
blurred, are given once: so clones are spread as their parents are from the first round on, not only in the
long run. Which parent takes which form is an assignment at random costs (Kuhn 1955) among the pairs for which
a turn was found that stretches neither too much, nor so little that the clone would be a copy.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float64, Int
from scipy.optimize import linear_sum_assignment

from mbstudio.core.cloning.clone_maker import CloneOptions, CloneRecipe
from mbstudio.core.cloning.kernel_warp import FLIPS, gradient
from mbstudio.core.cloning.surface_style import SurfaceStyle
from mbstudio.core.errors import CloningError

_TOGETHER = 48
"""Parents among which forms are exchanged: their pairs are all tried."""
_FREE_TURNS = 300
_SMALL_TURNS = (0.1, 0.2, 0.4)
"""Spreads, in radians, of turns that leave the axes about where they are: others suit long grains rarely."""
_LEAST_STRETCH = 1.08
_NEAR, _COPY, _TOO_FAR = 2.0, 10.0, 100.0
"""Costs of a small turn, of changing a parent too little, of stretching it too much; others cost 0 to 1."""
_WARP_TRIES = 40
_HALVINGS = 5
_SHELLS = (1.0, 0.6, 0.3)


def draw_recipes(
    style: SurfaceStyle, count: int, seed: int = 0, options: CloneOptions | None = None
) -> list[CloneRecipe]:
    """Return recipes of new grains; the first of many are those of few.

    Parameters
    ----------
    style : SurfaceStyle
    count : int
    seed : int
    options : CloneOptions, optional

    Raises
    ------
    CloningError
        If no warp of the strength asked for leaves a parent unfolded.
    """
    options = options or CloneOptions()
    parents = len(style.parents)
    recipes: list[CloneRecipe] = []
    for round_number in range(-(-count // parents)):
        rng = np.random.default_rng([seed, round_number])
        recipes += _draw_round(style, options, rng, min(parents, count - len(recipes)))
    return recipes


def _draw_round(
    style: SurfaceStyle, options: CloneOptions, rng: np.random.Generator, wanted: int
) -> list[CloneRecipe]:
    count = len(style.parents)
    order, givers = rng.permutation(count), rng.permutation(count)
    drawn = [style.draw_form_and_size(rng, int(giver)) for giver in givers]
    forms = np.stack([form for form, _ in drawn])
    recipes: list[CloneRecipe] = []
    for block in np.array_split(np.arange(count), -(-count // _TOGETHER)):
        if len(recipes) >= wanted:
            break
        rows, turns = _assign(style, order[block], forms[block], options.stretch, rng)
        seeds = rng.integers(2**32, size=len(block))
        for place, (row, turn, own) in enumerate(zip(rows, turns, seeds, strict=True)):
            if len(recipes) < wanted:
                shares = _draw_warp(style, int(row), options, np.random.default_rng(int(own)))
                form, diameter = drawn[block[place]]
                recipes.append(CloneRecipe(int(row), form, turn, shares, diameter, options.detail_stretch))
    return recipes


def _assign(
    style: SurfaceStyle, parents: Int[np.ndarray, " n"], forms: Float[np.ndarray, "n 3"], stretch: float,
    rng: np.random.Generator,
) -> tuple[Int[np.ndarray, " n"], Float64[np.ndarray, "n 3 3"]]:  # fmt: skip
    """Return, for each form, the parent that takes it and how it is turned."""
    turns = _propose_turns(rng)
    given, own = np.exp(forms), np.exp(-style.forms[parents])
    # Singular values of diag(form) T diag(1 / form of the parent): roots of the eigenvalues of M^T M.
    matrices = np.einsum("ka,tab,ib->kitab", given, turns, own)
    squares = np.linalg.eigvalsh(np.einsum("kitab,kitac->kitbc", matrices, matrices))
    needed = np.sqrt(np.maximum(squares[..., 2], 1.0 / squares[..., 0]))
    least = min(_LEAST_STRETCH, 1.0 + 0.5 * (stretch - 1.0))
    excess = np.maximum(needed - stretch, 0.0)
    costs = rng.random(needed.shape) + np.where(needed < least, _COPY, 0.0)
    costs[:, : len(turns) - _FREE_TURNS] += _NEAR
    costs += np.where(excess > 0, _TOO_FAR * (1.0 + excess), 0.0)
    chosen = costs.argmin(axis=2)
    # The cheapest of many turns would favour pairs with many: the turn is chosen first, then costs anew.
    pairs = np.take_along_axis(costs, chosen[:, :, None], axis=2)[:, :, 0]
    pairs = np.floor(pairs) + rng.random(pairs.shape)
    places, takers = linear_sum_assignment(pairs)
    assert (places == np.arange(len(forms))).all()
    return parents[takers], turns[chosen[places, takers]]


def _propose_turns(rng: np.random.Generator) -> Float64[np.ndarray, "turns 3 3"]:
    """Return turns: the flips, some near those, others any; half of them mirrored."""
    from scipy.spatial.transform import Rotation

    # The flips and what is near them come first.
    flips = np.eye(3) * FLIPS[:, None, :]
    near = [
        Rotation.from_rotvec(spread * rng.standard_normal((len(flips), 3))).as_matrix() @ flips
        for spread in _SMALL_TURNS
    ]
    free = Rotation.from_quat(rng.standard_normal((_FREE_TURNS, 4))).as_matrix()
    free = free * rng.choice([-1.0, 1.0], size=len(free))[:, None, None]
    turns: np.ndarray = np.concatenate([flips, *near, free])
    return turns


def _draw_warp(
    style: SurfaceStyle, row: int, options: CloneOptions, rng: np.random.Generator
) -> Float64[np.ndarray, " modes"]:
    vertices = style.parents[row].vertices
    for _ in range(_WARP_TRIES):
        shares: np.ndarray = options.warping * style.draw_warp(rng)
        if _is_gentle(vertices, style.warp(shares), options.local_stretch):
            return shares
    raise CloningError(
        f"Warps of strength {options.warping:g} fold {style.parents[row].name}: ask for less warping."
    )


def gentle_share(vertices: np.ndarray, style: SurfaceStyle, shares: Float[np.ndarray, " modes"]) -> float:
    """Return how much of a warp a body takes, one at most, before it folds or is stretched too much."""
    most = CloneOptions().local_stretch
    if _is_gentle(vertices, style.warp(shares), most):
        return 1.0
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        fits = _is_gentle(vertices, style.warp(middle * shares), most)
        low, high = (middle, high) if fits else (low, middle)
    return low


def _is_gentle(vertices: np.ndarray, coefficients: np.ndarray, most: float) -> bool:
    """Return whether a warp folds nothing within a body and stretches nowhere by more than `most`."""
    sampled = np.concatenate([shell * vertices[:: max(1, len(vertices) // 800)] for shell in _SHELLS])
    slopes = gradient(sampled, coefficients)
    if np.linalg.det(slopes).min() <= 0:
        return False
    values = np.linalg.svd(slopes, compute_uv=False)
    return bool(values[:, 0].max() <= most and values[:, 2].min() >= 1.0 / most)
