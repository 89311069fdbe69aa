"""Ways of the mouse in a slice: fewer corners, and the grain that they lie in."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from mbstudio.core.grains.editing.label_volume import LabelVolume

Voxel = tuple[int, int, int]

_TOLERANCE = 1.0  # voxels between a drawn line and its corners


def simplified(places: Sequence[Voxel]) -> list[Voxel]:
    """Return corners from which a drawn line is nowhere further than a voxel (Douglas and Peucker)."""
    points = np.array(places, dtype=float)
    if len(points) < 3:
        return list(places)
    away = _distances(points)
    far = int(away.argmax())
    if away[far] <= _TOLERANCE:
        return [places[0], places[-1]]
    return simplified(places[: far + 1])[:-1] + simplified(places[far:])


def grain_under(labels: LabelVolume, places: Sequence[Voxel], preferred: int | None) -> int | None:
    """Return the grain that a line lies in: a preferred one if it does, else the one it lies in most."""
    found: list[int] = []
    for start, stop in zip(places, places[1:] or places, strict=False):
        steps = max(1, int(np.abs(np.subtract(stop, start)).max()))
        for share in np.linspace(0.0, 1.0, steps + 1):
            z, y, x = (round(a + share * (b - a)) for a, b in zip(start, stop, strict=True))
            found.append(int(labels[z, y, x]))
    inside = [label for label in found if label]
    if preferred in inside:
        return preferred
    return max(sorted(set(inside)), key=inside.count) if inside else None


def _distances(points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, " m"]:
    """Return the distance of points to the straight line from the first to the last."""
    along = points[-1] - points[0]
    length = float(along @ along)
    offsets = points - points[0]
    share = np.clip(offsets @ along / length, 0.0, 1.0) if length > 0 else np.zeros(len(points))
    distances: np.ndarray = np.linalg.norm(offsets - share[:, None] * along, axis=1)
    return distances
