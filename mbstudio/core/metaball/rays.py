"""Where rays meet the surface f = 1.

Along a ray f is a sum of bells ``k / ((t - t_i)**2 + h_i**2)``. Each rises up to t_i and falls
beyond, so that over an interval the sum of each bell's largest value bounds f from above, that of
the smallest from below. A ray advances by steps over which the bound proves that it does not
cross, whatever the shape in between.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float64

from mbstudio.core.compiled import SAFE_MATH, compiled
from mbstudio.core.errors import AvatarError
from mbstudio.core.metaball.field import as_points, solid_bounds

SHORTEST_CHORD = 1e-5
"""Chords of the solid longer than this share of its diagonal are never missed."""


@compiled(fastmath=SAFE_MATH, error_model="numpy")
def _value_and_slope(
    t: float, places: np.ndarray, squares: np.ndarray, weights: np.ndarray
) -> tuple[float, float]:
    """Return f and df/dt on the ray."""
    total = slope = 0.0
    for i in range(len(places)):
        away = t - places[i]
        inverse = 1.0 / (away * away + squares[i])
        term = weights[i] * inverse
        total += term
        slope -= 2.0 * term * inverse * away
    return total, slope


@compiled(fastmath=SAFE_MATH, error_model="numpy")
def _rising_part(
    t: float, places: np.ndarray, squares: np.ndarray, weights: np.ndarray, sign: float
) -> tuple[float, float]:
    """Return f and the slope of the bells that still rise (sign 1) or already fall (sign -1)."""
    total = slope = 0.0
    for i in range(len(places)):
        away = t - places[i]
        inverse = 1.0 / (away * away + squares[i])
        term = weights[i] * inverse
        total += term
        slope += 2.0 * term * inverse * max(-sign * away, 0.0)
    return total, sign * slope


@compiled(fastmath=SAFE_MATH, error_model="numpy")
def _highest_bound(a: float, b: float, places: np.ndarray, squares: np.ndarray, weights: np.ndarray) -> float:
    """Return an upper bound of f over [a, b]."""
    total = 0.0
    for i in range(len(places)):
        away = max(max(a - places[i], places[i] - b), 0.0)
        total += weights[i] / (away * away + squares[i])
    return total


@compiled(fastmath=SAFE_MATH, error_model="numpy")
def _lowest_bound(a: float, b: float, places: np.ndarray, squares: np.ndarray, weights: np.ndarray) -> float:
    """Return a lower bound of f over [a, b]."""
    total = 0.0
    for i in range(len(places)):
        away = max(abs(a - places[i]), abs(b - places[i]))
        total += weights[i] / (away * away + squares[i])
    return total


@compiled(error_model="numpy")
def _crossing(
    low: float, high: float, places: np.ndarray, squares: np.ndarray, weights: np.ndarray, inside: bool
) -> float:
    """Return the place in [low, high], whose ends differ, where f = 1: Newton on u, bisection as guard."""
    t = 0.5 * (low + high)
    for _ in range(80):
        value, slope = _value_and_slope(t, places, squares, weights)
        if (value >= 1.0) == inside:
            low = t
        else:
            high = t
        # u - 1 over du/dt, with u = f**-1/2.
        step = 2.0 * (value - value * np.sqrt(value)) / slope if slope != 0.0 else np.inf
        following = t + step
        if not low < following < high:
            following = 0.5 * (low + high)
        if abs(following - t) <= 1e-15 * abs(t) or high - low <= 1e-15 * abs(high):
            return following
        t = following
    return t


@compiled(error_model="numpy")
def _march(
    start: float, end: float, shortest: float, places: np.ndarray, squares: np.ndarray, weights: np.ndarray
) -> float:
    """Return the first t in [start, end] where the ray enters or leaves the solid, or infinity."""
    t = start
    value, _ = _value_and_slope(t, places, squares, weights)
    inside = value >= 1.0
    sign = -1.0 if inside else 1.0
    while t < end:
        value, slope = _rising_part(t, places, squares, weights, sign)
        # Where the bound's u, nearly linear, would reach 1; a little less, so that it mostly holds.
        if value == np.inf or slope == 0.0:
            step = shortest if value == np.inf else end - t
        else:
            step = 1.96 * (value - value * np.sqrt(value)) / slope
        if not step < end - t:
            step = end - t
        while True:
            step = max(step, min(shortest, end - t))
            if inside:
                proven = _lowest_bound(t, t + step, places, squares, weights) >= 1.0
            else:
                proven = _highest_bound(t, t + step, places, squares, weights) < 1.0
            if proven or step <= shortest:
                break
            step *= 0.5
        if not proven:
            there, _ = _value_and_slope(t + step, places, squares, weights)
            if (there >= 1.0) != inside:
                return _crossing(t, t + step, places, squares, weights, inside)
        if t + step == t:
            break
        t += step
    return np.inf


@compiled(error_model="numpy")
def crossing_along(
    origin: np.ndarray,
    direction: np.ndarray,
    end: float,
    shortest: float,
    control: np.ndarray,
    places: np.ndarray,
    squares: np.ndarray,
) -> float:
    """Return the first crossing within `end` on the ray; `places` and `squares` are room for n numbers."""
    for i in range(control.shape[1]):
        x, y, z = control[0, i] - origin[0], control[1, i] - origin[1], control[2, i] - origin[2]
        place = x * direction[0] + y * direction[1] + z * direction[2]
        x, y, z = x - place * direction[0], y - place * direction[1], z - place * direction[2]
        places[i], squares[i] = place, max(x * x + y * y + z * z, 1e-200)
    return _march(0.0, end, shortest, places, squares, control[3])


@compiled(error_model="numpy")
def _box_span(
    origin: np.ndarray, direction: np.ndarray, low: np.ndarray, high: np.ndarray
) -> tuple[float, float]:
    """Return where a ray enters and leaves a box; start after end if it misses."""
    start, end = 0.0, np.inf
    for axis in range(3):
        if direction[axis] == 0.0:
            if origin[axis] < low[axis] or origin[axis] > high[axis]:
                return 1.0, 0.0
            continue
        a, b = (low[axis] - origin[axis]) / direction[axis], (high[axis] - origin[axis]) / direction[axis]
        start, end = max(start, min(a, b)), min(end, max(a, b))
    return start, end


@compiled(error_model="numpy")
def _first_hits(
    origins: np.ndarray,
    directions: np.ndarray,
    control: np.ndarray,
    low: np.ndarray,
    high: np.ndarray,
    shortest: float,
    out: np.ndarray,
) -> None:
    n = control.shape[1]
    places, squares = np.empty(n), np.empty(n)
    direction, origin = np.empty(3), np.empty(3)
    for r in range(len(origins)):
        length = np.sqrt(directions[r, 0] ** 2 + directions[r, 1] ** 2 + directions[r, 2] ** 2)
        for axis in range(3):
            direction[axis] = directions[r, axis] / length
        start, end = _box_span(origins[r], direction, low, high)
        if not start <= end:
            out[r] = np.inf
            continue
        # About the place of entry, so that a far away origin costs no digits.
        for axis in range(3):
            origin[axis] = origins[r, axis] + start * direction[axis]
        out[r] = start + crossing_along(
            origin, direction, end - start, shortest, control, places, squares
        )  # fmt: skip


def unit_directions(directions: Float[np.ndarray, "m 3"]) -> Float64[np.ndarray, "m 3"]:
    """Return directions of length 1; AvatarError if one has no length."""
    array = as_points(directions)
    lengths = np.linalg.norm(array, axis=1)
    wrong = ~((lengths > 0) & np.isfinite(lengths))
    if wrong.any():
        raise AvatarError(
            f"The direction {array[wrong][0]} of a ray has no length: give finite vectors other than zero."
        )
    units: np.ndarray = array / lengths[:, None]
    return units


def first_hits(
    origins: Float[np.ndarray, "m 3"],
    directions: Float[np.ndarray, "m 3"],
    control: Float64[np.ndarray, "4 n"],
    *,
    shortest_chord: float = SHORTEST_CHORD,
) -> Float64[np.ndarray, "m"]:
    """Return how far along each ray the surface f = 1 is first crossed; infinity for a miss.

    Parameters
    ----------
    origins, directions : float array, shape (m, 3)
        In the unit of the control points; directions need not have length 1.
    control : float array, shape (4, n)
        Rows x, y, z, k.
    shortest_chord : float
        Share of the solid's diagonal. The first crossing is found wherever the ray then stays in
        the solid (or, starting inside, outside of it) over a longer way: no thin neck and no thin
        wall above it is stepped over. A ray that only grazes costs about 1/sqrt(shortest_chord)
        steps.

    Returns
    -------
    float array, shape (m,)
        Distances (lengths, whatever the length of the direction). From inside: to the way out.

    Raises
    ------
    AvatarError
        If a direction has no length or the arrays do not match.
    """
    starts, along = as_points(origins), unit_directions(directions)
    if starts.shape != along.shape:
        raise AvatarError(
            f"There are {len(starts)} origins but {len(along)} directions: give the same number of each."
        )
    if not 0 < shortest_chord < 1:
        raise AvatarError(
            f"shortest_chord = {shortest_chord} is impossible: give a fraction of the diagonal, such as 1e-5."
        )
    low, high = solid_bounds(control)
    diagonal = float(np.linalg.norm(high - low))
    # A hair wider, so that a face of the box that touches the surface is not its start.
    low, high = low - 1e-6 * diagonal, high + 1e-6 * diagonal
    out = np.empty(len(starts))
    _first_hits(starts, along, control, low, high, shortest_chord * diagonal, out)
    return out
