"""Where a scan's phases meet: the grey values on both sides of every sharp change.

Each voxel where the gradient is largest along its own direction lies on an interface. From there the grey
value is followed to both sides until the gradient has faded: what it comes to is the level of the darker and
of the brighter phase (the LH histogram of Sereda et al. 2006, IEEE TVCG 12, 208). Levels found in this way do
not depend on how much of the scan each phase fills, and where they drift with the place, so do they.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Int32
from scipy import ndimage

from mbstudio.core.compiled import compiled

SMOOTHING = 1.0
"""Standard deviation of the blur before the gradient is taken, in voxels."""
FARTHEST = 4
"""How many voxels a level is looked for on either side."""
_BY_CHANCE = 3.0
"""How many interfaces may be noise in a whole scan."""
_FADED = 0.35
"""Share of an interface's gradient at which a phase's level is reached."""
_SAMPLED = 2_000_000
_FLATTEST = 0.5  # deviation in the flattest of 200 cubes over that in all; .56 in white, .42 in coarse noise
_FLAT_SLACK = 1.25


@dataclass(frozen=True, eq=False)
class Interfaces:
    """Voxels on interfaces, and what meets there.

    Attributes
    ----------
    places : int32 array, shape (m, 3)
        Voxel indices (z, y, x), in the order of the scan.
    lows, highs : float32 array, shape (m,)
        Grey values of the darker and the brighter side.
    curvatures : float32 array, shape (m,)
        Sum of the principal curvatures in 1 / voxel; positive where the bright side is convex.
    noise : float
        Standard deviation of the grey values' noise, supposing that it is independent from voxel to voxel.
    """

    places: Int32[np.ndarray, "m 3"]
    lows: Float32[np.ndarray, " m"]
    highs: Float32[np.ndarray, " m"]
    curvatures: Float32[np.ndarray, " m"]
    noise: float

    def __len__(self) -> int:
        return len(self.places)

    @property
    def contrasts(self) -> Float32[np.ndarray, " m"]:
        return np.asarray(self.highs - self.lows, np.float32)

    @property
    def middles(self) -> Float32[np.ndarray, " m"]:
        """Half-way between both sides: where the surface lies, whatever the blur of the scan."""
        return np.asarray(0.5 * (self.lows + self.highs), np.float32)


def find_interfaces(grey: Float[np.ndarray, "Z Y X"], seen: Bool[np.ndarray, "Z Y X"]) -> Interfaces:
    """Find the interfaces of a scan.

    Parameters
    ----------
    grey : float array, shape (Z, Y, X)
    seen : bool array, shape (Z, Y, X)
        The field of view; interfaces near its rim are left out.
    """
    smooth = ndimage.gaussian_filter(grey, SMOOTHING, mode="nearest", output=np.float32)
    inner = _inner(seen)
    gradient = _noise_of_gradient(smooth, inner, float(grey.max() - grey.min()))
    least = _standing_out(int(np.count_nonzero(inner))) * gradient
    places, values = _trace(smooth, inner, least, _FADED, FARTHEST)
    # Of white noise the blurred gradient along an axis has the deviation 1 / (4 pi**(3/4)) sigma**(-5/2).
    noise = gradient * 4.0 * np.pi**0.75 * SMOOTHING**2.5
    return Interfaces(places, values[:, 0], values[:, 1], values[:, 2], float(noise))


def _standing_out(voxels: int) -> float:
    """Return the least gradient of an interface, over the deviation of the noise's along an axis.

    A normal vector in space is longer than x deviations in a share of some sqrt(2 / pi) x exp(-x**2 / 2)
    places. Summits are about as often as neighbouring places differ.
    """
    found = 5.0
    for _ in range(8):
        expected = 1.3 * voxels * math.sqrt(2.0 / math.pi) * found
        found = math.sqrt(2.0 * math.log(max(expected / _BY_CHANCE, math.e)))
    return found


def _inner(seen: Bool[np.ndarray, "Z Y X"]) -> Bool[np.ndarray, "Z Y X"]:
    """Return the voxels whose neighbourhood is seen whole."""
    margin = FARTHEST
    if seen.all():
        inner = np.zeros(seen.shape, np.bool_)
        inner[tuple(slice(min(2, (n - 1) // 2), n - min(2, (n - 1) // 2)) for n in seen.shape)] = True
        return inner
    inner = np.asarray(ndimage.binary_erosion(seen, iterations=margin), np.bool_)
    for axis in range(3):
        for end in (slice(0, 2), slice(-2, None)):
            inner[(slice(None),) * axis + (end,)] = False
    return inner


def _noise_of_gradient(
    smooth: Float32[np.ndarray, "Z Y X"], inner: Bool[np.ndarray, "Z Y X"], span: float
) -> float:
    """Return the deviation of the noise's gradient along an axis.

    A fifth of the lengths of normal vectors in space is shorter than one deviation. Where most voxels lie on
    interfaces, the flattest fifth of them tells too much: there the flattest cubes of three voxels tell
    more truly.
    """
    step = max(1, round((inner.size / _SAMPLED) ** (1 / 3)))
    square = _squared_gradient(smooth, step)
    part = inner[1:-1:step, 1:-1:step, 1:-1:step]
    lengths = np.sqrt(square[part]) if part.any() else np.sqrt(square.ravel())
    found = float(np.quantile(lengths, 0.2)) if lengths.size else 0.0
    found = min(found, _FLAT_SLACK * _noise_of_flat_cubes(smooth, inner))
    # Images without noise: rounding of grey values to whole numbers is no interface.
    return max(found, min(0.05, 1e-3 * span), 1e-7 * span)


def _squared_gradient(smooth: Float32[np.ndarray, "Z Y X"], step: int) -> Float32[np.ndarray, "z y x"]:
    """Return the squared length of the gradient at every so manieth voxel that is not on a face."""
    square = np.zeros([len(range(1, count - 1, step)) for count in smooth.shape], np.float32)
    for axis, count in enumerate(smooth.shape):
        ahead: list[slice] = [slice(1, n - 1, step) for n in smooth.shape]
        behind = list(ahead)
        ahead[axis], behind[axis] = slice(2, count, step), slice(0, count - 2, step)
        square += np.square(0.5 * (smooth[tuple(ahead)] - smooth[tuple(behind)]))
    return square


def _noise_of_flat_cubes(smooth: Float32[np.ndarray, "Z Y X"], inner: Bool[np.ndarray, "Z Y X"]) -> float:
    """Return the deviation of the noise's gradient by the flattest of cubes of three voxels.

    Cubes as small as this fit into grains of a few voxels. In large scans this looks at slices in the middle.
    """
    depth = len(smooth)
    rows = max(9, min(depth, int(_SAMPLED // smooth[0].size)))
    start = max(0, (depth - rows) // 2)
    part, seen = smooth[start : start + rows], inner[start : start + rows]
    means = ndimage.uniform_filter(_squared_gradient(part, 1), 3)[1:-1, 1:-1, 1:-1]
    whole = ndimage.minimum_filter(seen, 5)[2:-2, 2:-2, 2:-2]
    chosen = means[whole] if means.size else means.ravel()
    if not len(chosen):
        return math.inf
    # Running means of zeros can come out below zero by rounding.
    return float(np.sqrt(max(np.quantile(chosen, 0.005), 0.0) / 3.0) / _FLATTEST)


@compiled()
def _at(volume: np.ndarray, z: float, y: float, x: float) -> float:  # pragma: no cover - compiled
    """Return a volume's value between voxels, linearly; beyond its faces that of the face."""
    nz, ny, nx = volume.shape
    z = min(max(z, 0.0), nz - 1.0)
    y = min(max(y, 0.0), ny - 1.0)
    x = min(max(x, 0.0), nx - 1.0)
    i, j, k = min(int(z), nz - 2), min(int(y), ny - 2), min(int(x), nx - 2)
    a, b, c = z - i, y - j, x - k
    low = (volume[i, j, k] * (1 - c) + volume[i, j, k + 1] * c) * (1 - b) + (
        volume[i, j + 1, k] * (1 - c) + volume[i, j + 1, k + 1] * c
    ) * b
    high = (volume[i + 1, j, k] * (1 - c) + volume[i + 1, j, k + 1] * c) * (1 - b) + (
        volume[i + 1, j + 1, k] * (1 - c) + volume[i + 1, j + 1, k + 1] * c
    ) * b
    return float(low * (1 - a) + high * a)


@compiled()
def _steepness(volume: np.ndarray, z: float, y: float, x: float) -> float:  # pragma: no cover - compiled
    """Return the length of the gradient between voxels."""
    dz = _at(volume, z + 1.0, y, x) - _at(volume, z - 1.0, y, x)
    dy = _at(volume, z, y + 1.0, x) - _at(volume, z, y - 1.0, x)
    dx = _at(volume, z, y, x + 1.0) - _at(volume, z, y, x - 1.0)
    return 0.5 * float(np.sqrt(dz * dz + dy * dy + dx * dx))


@compiled()
def _level(  # pragma: no cover - compiled
    volume: np.ndarray,
    start: np.ndarray,
    along: np.ndarray,
    sign: float,
    steep: float,
    faded: float,
    farthest: int,
) -> float:
    """Return the grey value that is come to on one side of an interface."""
    best = _at(volume, start[0], start[1], start[2])
    last = steep
    for t in range(1, farthest + 1):
        z, y, x = (
            start[0] + sign * t * along[0],
            start[1] + sign * t * along[1],
            start[2] + sign * t * along[2],
        )
        value, here = _at(volume, z, y, x), _steepness(volume, z, y, x)
        # Another interface begins where the gradient rises again.
        if sign * (value - best) <= 0.0 or here > 1.02 * last:
            break
        best, last = value, here
        if t > 1 and here < faded * steep:
            break
    return best


@compiled()
def _trace(  # pragma: no cover - compiled
    volume: np.ndarray, inner: np.ndarray, least: float, faded: float, farthest: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return places of interfaces, and their low, high and curvature."""
    nz, ny, nx = volume.shape
    room = 4096
    places, values = np.empty((room, 3), np.int32), np.empty((room, 3), np.float32)
    count = 0
    start, along = np.empty(3), np.empty(3)
    for z in range(1, nz - 1):
        for y in range(1, ny - 1):
            for x in range(1, nx - 1):
                if not inner[z, y, x]:
                    continue
                along[0] = 0.5 * (volume[z + 1, y, x] - volume[z - 1, y, x])
                along[1] = 0.5 * (volume[z, y + 1, x] - volume[z, y - 1, x])
                along[2] = 0.5 * (volume[z, y, x + 1] - volume[z, y, x - 1])
                steep = np.sqrt(along[0] ** 2 + along[1] ** 2 + along[2] ** 2)
                if steep <= least:
                    continue
                start[0], start[1], start[2] = z, y, x
                along /= steep
                if _steepness(volume, z + along[0], y + along[1], x + along[2]) > steep:
                    continue
                if _steepness(volume, z - along[0], y - along[1], x - along[2]) > steep:
                    continue
                if count == room:
                    room *= 2
                    more_places, more_values = np.empty((room, 3), np.int32), np.empty((room, 3), np.float32)
                    more_places[:count], more_values[:count] = places, values
                    places, values = more_places, more_values
                around = volume[z - 1, y, x] + volume[z + 1, y, x] + volume[z, y - 1, x]
                around += volume[z, y + 1, x] + volume[z, y, x - 1] + volume[z, y, x + 1]
                places[count, 0], places[count, 1], places[count, 2] = z, y, x
                values[count, 0] = _level(volume, start, along, -1.0, steep, faded, farthest)
                values[count, 1] = _level(volume, start, along, 1.0, steep, faded, farthest)
                # The Laplacian less what bends along the normal is what bends within the surface.
                ahead = _at(volume, z + along[0], y + along[1], x + along[2])
                behind = _at(volume, z - along[0], y - along[1], x - along[2])
                bent = around - 6.0 * volume[z, y, x] - (ahead - 2.0 * volume[z, y, x] + behind)
                values[count, 2] = -bent / steep
                count += 1
    return places[:count].copy(), values[:count].copy()


@compiled()
def count_unexplained(labels: np.ndarray, places: np.ndarray) -> tuple[int, int]:  # pragma: no cover
    """Count edges about which all is one grain, and those about which there is no grain."""
    nz, ny, nx = labels.shape
    inside, outside = 0, 0
    for row in range(len(places)):
        z, y, x = places[row, 0], places[row, 1], places[row, 2]
        label = labels[z, y, x]
        alone = True
        for i in range(max(z - 2, 0), min(z + 3, nz)):
            for j in range(max(y - 2, 0), min(y + 3, ny)):
                for k in range(max(x - 2, 0), min(x + 3, nx)):
                    near = (i - z) ** 2 + (j - y) ** 2 + (k - x) ** 2 <= 5
                    alone = alone and (labels[i, j, k] == label or not near)
        if alone:
            if label:
                inside += 1
            else:
                outside += 1
    return inside, outside
