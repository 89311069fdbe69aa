"""Distance to the surface f = 1: first order, iterated, and a radius that surely holds no surface.

Distances are negative inside and positive outside, in the unit of the control points. Like the
mesh, they rest on ``u = f**(-1/2)``, which for one control point is the distance over the radius.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float64

from mbstudio.core.compiled import SAFE_MATH, compiled
from mbstudio.core.metaball.field import as_points, field_and_gradient_at
from mbstudio.core.metaball.rays import crossing_along

_MOST_STEPS = 40
_ON_SURFACE = 1e-10  # of |u - 1|
_SETTLED = 1e-8  # tangential rest over the distance
# From inside, the way out is looked for along the axes and the diagonals of a cube.
_DIRECTIONS = (
    np.array(
        [row for row in np.ndindex(3, 3, 3) if sum(value != 1 for value in row) in (1, 3)], dtype=np.float64
    )
    - 1.0
)


@compiled(fastmath=SAFE_MATH, error_model="numpy")
def _shifted_sum(distances: np.ndarray, control: np.ndarray, shift: float) -> tuple[float, float]:
    """Return ``v = (sum k / (d + shift)**2)**(-1/2)`` and dv/dshift."""
    total = slope = 0.0
    for i in range(len(distances)):
        inverse = 1.0 / (distances[i] + shift)
        term = control[3, i] * inverse * inverse
        total += term
        slope += term * inverse
    v = 1.0 / np.sqrt(total)
    return v, slope * v / total


@compiled(error_model="numpy")
def _safe_radius(points: np.ndarray, control: np.ndarray, out: np.ndarray) -> None:
    """Solve ``sum k / (d -+ R)**2 = 1``, from the side on which R is too small.

    v is concave in R (a weighted power mean of the distances): a tangent lies above it, a chord below.
    """
    n = control.shape[1]
    distances = np.empty(n)
    for p in range(len(points)):
        nearest = np.inf
        for i in range(n):
            dx, dy, dz = (
                points[p, 0] - control[0, i],
                points[p, 1] - control[1, i],
                points[p, 2] - control[2, i],
            )
            distances[i] = np.sqrt(dx * dx + dy * dy + dz * dz)
            nearest = min(nearest, distances[i])
        if nearest == 0.0:
            # On a control point: its own sphere lies inside.
            nearest = 1e-12 * np.sqrt(control[3].max())
            for i in range(n):
                distances[i] = max(distances[i], nearest)
        v, slope = _shifted_sum(distances, control, 0.0)
        if v <= 1.0:
            radius = 0.0
            for _ in range(4):
                radius = max(radius, radius + (1.0 - v) / slope)
                v, slope = _shifted_sum(distances, control, radius)
            out[p] = radius
            continue
        low, v_low = 0.0, v
        high = min((v - 1.0) / slope, nearest * (1.0 - 1e-12))
        v_high, slope = _shifted_sum(distances, control, -high)
        for _ in range(3):
            if v_high >= 1.0 or high <= low:
                break
            low += (v_low - 1.0) / (v_low - v_high) * (high - low)
            v_low, _ = _shifted_sum(distances, control, -low)
            high = max(low, high - (1.0 - v_high) / slope)
            v_high, slope = _shifted_sum(distances, control, -high)
        out[p] = high if v_high >= 1.0 else low


def safe_radius(
    points: Float[np.ndarray, "m 3"], control: Float64[np.ndarray, "4 n"]
) -> Float64[np.ndarray, "m"]:
    """Return a radius about each point within which there surely is no surface.

    Parameters
    ----------
    points : float array, shape (m, 3)
    control : float array, shape (4, n)
        Rows x, y, z, k, in the unit of the points.

    Returns
    -------
    float array, shape (m,)
        Never more than the true distance; the same for one control point. The step of sphere
        tracing, and a broad phase for contact.

    Notes
    -----
    From outside, ``sum k_i / (d_i - R)**2`` bounds f from above over the ball of radius R, from
    inside ``sum k_i / (d_i + R)**2`` from below; R is where the bound meets 1.
    """
    array = as_points(points)
    out = np.empty(len(array))
    _safe_radius(array, control, out)
    return out


def first_order_distance(
    points: Float[np.ndarray, "m 3"], control: Float64[np.ndarray, "4 n"]
) -> Float64[np.ndarray, "m"]:
    """Return ``(u - 1) / |grad u|``, negative inside: exact for one control point.

    Parameters
    ----------
    points : float array, shape (m, 3)
    control : float array, shape (4, n)

    Notes
    -----
    The error grows with the square of the distance over the radius of curvature. Where the
    gradient vanishes, deep inside between control points, the value is far too large; on a
    control point it is NaN. Use :func:`closest_points` there.
    """
    field, gradient = field_and_gradient_at(points, control)
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        # (u - 1) / |grad u| with u = f**-1/2 and |grad u| = f**-3/2 |grad f| / 2.
        distances: np.ndarray = 2.0 * (field - field**1.5) / np.linalg.norm(gradient, axis=1)
        return distances


@compiled(fastmath=SAFE_MATH, error_model="numpy")
def u_gradient_hessian(x: float, y: float, z: float, control: np.ndarray, out: np.ndarray) -> None:
    """Write u, its gradient (x, y, z) and its Hessian (xx, yy, zz, xy, xz, yz)."""
    f = gx = gy = gz = trace = xx = yy = zz = xy = xz = yz = 0.0
    for i in range(control.shape[1]):
        dx, dy, dz = x - control[0, i], y - control[1, i], z - control[2, i]
        inverse = 1.0 / max(dx * dx + dy * dy + dz * dz, 1e-200)
        term = control[3, i] * inverse
        f += term
        term *= inverse
        trace += term
        gx += term * dx
        gy += term * dy
        gz += term * dz
        term *= inverse
        tx, ty = term * dx, term * dy
        xx += tx * dx
        xy += tx * dy
        xz += tx * dz
        yy += ty * dy
        yz += ty * dz
        zz += term * dz * dz
    u = 1.0 / np.sqrt(f)
    # grad f = -2 g, so grad u = u**3 g; Hess u = -u**3 / 2 Hess f + 3 u**5 g g^T.
    first, second = u * u * u, 3.0 * u * u * u * u * u
    out[0] = u
    out[1], out[2], out[3] = first * gx, first * gy, first * gz
    out[4] = first * (trace - 4.0 * xx) + second * gx * gx
    out[5] = first * (trace - 4.0 * yy) + second * gy * gy
    out[6] = first * (trace - 4.0 * zz) + second * gz * gz
    out[7] = -4.0 * first * xy + second * gx * gy
    out[8] = -4.0 * first * xz + second * gx * gz
    out[9] = -4.0 * first * yz + second * gy * gz


@compiled(error_model="numpy")
def _to_surface(place: np.ndarray, control: np.ndarray, out: np.ndarray) -> bool:
    """Move `place` onto u = 1 along the gradient; return whether that worked. `out` describes the end."""
    u_gradient_hessian(place[0], place[1], place[2], control, out)
    for _ in range(_MOST_STEPS):
        rest: float = out[0] - 1.0
        if abs(rest) <= _ON_SURFACE:
            return True
        square = out[1] ** 2 + out[2] ** 2 + out[3] ** 2
        if not square > 1e-300:
            return False
        share, found = -rest / square, False
        gx, gy, gz = out[1], out[2], out[3]
        for _ in range(12):
            x, y, z = place[0] + share * gx, place[1] + share * gy, place[2] + share * gz
            u_gradient_hessian(x, y, z, control, out)
            if abs(out[0] - 1.0) < 0.9 * abs(rest):
                found = True
                break
            share *= 0.5
        if not found:
            return abs(rest) < 1e-7
        place[0], place[1], place[2] = x, y, z
    rest = out[0] - 1.0
    return abs(rest) < 1e-7


@compiled(error_model="numpy")
def _nearest_crossing(
    point: np.ndarray,
    target: np.ndarray,
    outside: bool,
    control: np.ndarray,
    place: np.ndarray,
    room: np.ndarray,
) -> None:
    """Write the nearest first crossing of rays from `point`: from outside only that to `target`."""
    n = control.shape[1]
    direction, best, farthest = room[2, :3], np.inf, 0.0
    for i in range(n):
        away = 0.0
        for axis in range(3):
            away += (control[axis, i] - point[axis]) ** 2
        farthest = max(farthest, np.sqrt(away))
    end = 1.01 * (farthest + np.sqrt(control[3].sum()))
    for number in range(1 if outside else len(_DIRECTIONS)):
        for axis in range(3):
            direction[axis] = target[axis] - point[axis] if outside else _DIRECTIONS[number, axis]
        length = np.sqrt(direction[0] ** 2 + direction[1] ** 2 + direction[2] ** 2)
        for axis in range(3):
            direction[axis] /= length
        t = crossing_along(point, direction, min(end, best), 1e-4 * end, control, room[0, :n], room[1, :n])
        if t < best:
            best = t
            for axis in range(3):
                place[axis] = point[axis] + t * direction[axis]


@compiled(error_model="numpy")
def _tangential_step(
    rx: float, ry: float, rz: float, multiplier: float, state: np.ndarray, step: np.ndarray
) -> None:
    """Write the Newton step of the squared distance within the tangent plane.

    Its Hessian there is I + multiplier * Hess u; negative curvatures are taken by their size, so
    that the step always goes downhill.
    """
    length = np.sqrt(state[1] ** 2 + state[2] ** 2 + state[3] ** 2)
    nx, ny, nz = state[1] / length, state[2] / length, state[3] / length
    # Two directions across the normal (Duff et al. 2017).
    sign = 1.0 if nz >= 0.0 else -1.0
    a = -1.0 / (sign + nz)
    b = nx * ny * a
    ax, ay, az = 1.0 + sign * nx * nx * a, sign * b, -sign * nx
    bx, by, bz = b, sign + ny * ny * a, -ny
    hax = state[4] * ax + state[7] * ay + state[8] * az
    hay = state[7] * ax + state[5] * ay + state[9] * az
    haz = state[8] * ax + state[9] * ay + state[6] * az
    hbx = state[4] * bx + state[7] * by + state[8] * bz
    hby = state[7] * bx + state[5] * by + state[9] * bz
    hbz = state[8] * bx + state[9] * by + state[6] * bz
    aa = 1.0 + multiplier * (ax * hax + ay * hay + az * haz)
    ab = multiplier * (ax * hbx + ay * hby + az * hbz)
    bb = 1.0 + multiplier * (bx * hbx + by * hby + bz * hbz)
    ra, rb = rx * ax + ry * ay + rz * az, rx * bx + ry * by + rz * bz
    middle, half = 0.5 * (aa + bb), np.sqrt(0.25 * (aa - bb) ** 2 + ab * ab)
    # Principal direction of the larger curvature.
    px, py = (aa - bb) * 0.5 + half, ab
    if px * px + py * py < 1e-300:
        px, py = (1.0, 0.0) if aa >= bb else (0.0, 1.0)
    norm = np.sqrt(px * px + py * py)
    px, py = px / norm, py / norm
    along = (px * ra + py * rb) / max(abs(middle + half), 0.05)
    across = (-py * ra + px * rb) / max(abs(middle - half), 0.05)
    da, db = px * along - py * across, py * along + px * across
    step[0], step[1], step[2] = da * ax + db * bx, da * ay + db * by, da * az + db * bz


@compiled(error_model="numpy")
def _settle(
    point: np.ndarray,
    place: np.ndarray,
    control: np.ndarray,
    state: np.ndarray,
    trial: np.ndarray,
    step: np.ndarray,
) -> float:
    """Slide `place` along the surface to where it is nearest to `point`; return the squared distance."""
    dx, dy, dz = point[0] - place[0], point[1] - place[1], point[2] - place[2]
    best: float = dx * dx + dy * dy + dz * dz
    for _ in range(_MOST_STEPS):
        square = state[1] ** 2 + state[2] ** 2 + state[3] ** 2
        multiplier = (dx * state[1] + dy * state[2] + dz * state[3]) / square
        rx, ry, rz = dx - multiplier * state[1], dy - multiplier * state[2], dz - multiplier * state[3]
        if rx * rx + ry * ry + rz * rz <= _SETTLED**2 * best:
            break
        _tangential_step(rx, ry, rz, multiplier, state, step)
        share, found = 1.0, False
        for _ in range(10):
            for axis in range(3):
                trial[axis] = place[axis] + share * step[axis]
            if _to_surface(trial, control, state):
                tx, ty, tz = point[0] - trial[0], point[1] - trial[1], point[2] - trial[2]
                square = tx * tx + ty * ty + tz * tz
                if square < best * (1.0 - 1e-14):
                    found = True
                    break
            share *= 0.4
        if not found:
            break
        for axis in range(3):
            place[axis] = trial[axis]
        dx, dy, dz, best = tx, ty, tz, square
    return best


@compiled(error_model="numpy")
def _closest_points(
    points: np.ndarray, control: np.ndarray, closest: np.ndarray, distance: np.ndarray
) -> None:
    n = control.shape[1]
    state, trial, step = np.empty(10), np.empty(3), np.empty(3)
    place, target, room = np.empty(3), np.empty(3), np.empty((3, max(n, 3)))
    point = np.empty(3)
    for p in range(len(points)):
        # The control point whose own sphere, which lies in the solid, is nearest.
        nearest, at, depth = np.inf, 0, 0.0
        for i in range(n):
            away = 0.0
            for axis in range(3):
                away += (points[p, axis] - control[axis, i]) ** 2
            away = np.sqrt(away)
            if away - np.sqrt(control[3, i]) < nearest:
                nearest, at, depth = away - np.sqrt(control[3, i]), i, away
        for axis in range(3):
            point[axis], target[axis] = points[p, axis], control[axis, at]
        if depth < 1e-9 * np.sqrt(control[3, at]):  # f and its gradient are infinite on a control point
            point[0] += 1e-9 * np.sqrt(control[3, at])
        u_gradient_hessian(point[0], point[1], point[2], control, state)
        outside = state[0] > 1.0
        place[:] = point
        landed = _to_surface(place, control, state)
        best = np.inf
        for start in range(2):
            if start == 1 or not landed:
                _nearest_crossing(point, target, outside, control, place, room)
                u_gradient_hessian(place[0], place[1], place[2], control, state)
            square = _settle(point, place, control, state, trial, step)
            if square < best:
                best = square
                closest[p, :] = place
        distance[p] = np.sqrt(best) if outside else -np.sqrt(best)


def closest_points(
    points: Float[np.ndarray, "m 3"], control: Float64[np.ndarray, "4 n"]
) -> tuple[Float64[np.ndarray, "m 3"], Float64[np.ndarray, "m"]]:
    """Return the surface points nearest to points, and the signed distance to them.

    Parameters
    ----------
    points : float array, shape (m, 3)
    control : float array, shape (4, n)

    Returns
    -------
    closest : float array, shape (m, 3)
        On f = 1 to rounding; where the segment from the point meets the surface at a right angle.
    distance : float array, shape (m,)
        Negative inside.

    Notes
    -----
    Newton's method on the squared distance within the surface, with the Hessian of u, from two
    starts: along the gradient, and from where a ray to the nearest control sphere (from inside:
    the shortest of fourteen rays) crosses the surface. Each ends at a nearest point of its
    surroundings; over a hollow another part of the surface may be nearer.
    :func:`safe_radius` tells how much nearer at most.
    """
    array = as_points(points)
    closest, distance = np.empty(array.shape), np.empty(len(array))
    _closest_points(array, control, closest, distance)
    return closest, distance
