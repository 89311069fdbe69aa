"""Where a surface is cut by a plane: the outline of an avatar in a slice."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from mbstudio.scene.surfaces import Surface


def section_lines(surface: Surface, axis: int, place: float) -> Float[np.ndarray, "m 2 3"]:
    """Return the lines in which a plane across an axis cuts a surface.

    Parameters
    ----------
    surface : Surface
    axis : int
        0, 1 or 2 for x, y or z.
    place : float
        Where the plane lies on the axis, in the unit of the surface.

    Returns
    -------
    float array, shape (m, 2, 3)
        Start and end (x, y, z) of each line, one a triangle that is cut; they are in no order.
    """
    heights = surface.points[:, axis].astype(np.float64) - place
    # A corner exactly in the plane counts as above it, so that no triangle is cut in a point.
    above = heights >= 0
    corners = surface.triangles
    count = above[corners].sum(axis=1)
    corners = corners[(count == 1) | (count == 2)]
    if not len(corners):
        return np.zeros((0, 2, 3))
    # The corner that is alone on its side comes first.
    side = above[corners]
    lone = np.where(side.sum(axis=1) == 1, side.argmax(axis=1), (~side).argmax(axis=1))
    rows = np.arange(len(corners))
    first = corners[rows, lone]
    ends = []
    for step in (1, 2):
        other = corners[rows, (lone + step) % 3]
        share = heights[first] / (heights[first] - heights[other])
        start, stop = surface.points[first].astype(np.float64), surface.points[other].astype(np.float64)
        ends.append(start + share[:, None] * (stop - start))
    return np.stack(ends, axis=1)
