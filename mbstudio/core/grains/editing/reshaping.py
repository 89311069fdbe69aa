"""Changing the outline of a grain: growing, shrinking, smoothing, filling its holes."""

from __future__ import annotations

import edt
import numpy as np
from scipy import ndimage

from mbstudio.core.errors import EditError
from mbstudio.core.grains.editing.boxes import widened
from mbstudio.core.grains.editing.workbench import Workbench
from mbstudio.core.grains.pieces import without_cavities

_MOST_VOXELS = 32


def grow(bench: Workbench, label: int, by: float) -> None:
    """Add to a grain the void within a distance of it.

    Parameters
    ----------
    by : float
        In voxels of the smallest edge, above 0.

    Raises
    ------
    EditError
        If nothing is added: other grains or the border of the scan lie all around.
    """
    bench.require((label,))
    _require_distance(by)
    box = bench.box_with_margin(label, int(np.ceil(by)))
    values = bench.read(box).copy()
    near = _distance(bench, values != label) <= by
    gained = near & (values == 0) & bench.seen(box)
    if not gained.any():
        raise EditError(f"Grain {label} cannot grow: grains or the border of the scan lie all around it.")
    values[gained] = label
    bench.write(box, values)


def shrink(bench: Workbench, label: int, by: float) -> None:
    """Take from a grain what lies within a distance of its surface; see `grow`.

    Where the scan cuts it off, there is no surface.

    Raises
    ------
    EditError
        If nothing would be left.
    """
    bench.require((label,))
    _require_distance(by)
    box = bench.box_with_margin(label, 1)
    values = bench.read(box).copy()
    inside = values == label
    lost = inside & (_distance(bench, inside | ~bench.seen(box)) <= by)
    if (lost == inside).all():
        raise EditError(f"Grain {label} is too thin to lose {by:g} voxels all around: nothing would be left.")
    values[lost] = 0
    bench.write(box, values)


def smooth(bench: Workbench, label: int, sigma: float) -> None:
    """Smooth the outline of a grain: what sticks out goes, dents are filled, other grains stay.

    Parameters
    ----------
    sigma : float
        Standard deviation of the Gaussian by which it is smoothed, in voxels of the smallest edge.

    Raises
    ------
    EditError
        If nothing would be left.
    """
    bench.require((label,))
    if not 0 < sigma <= _MOST_VOXELS:
        raise EditError(f"sigma={sigma} is impossible: give 0 to {_MOST_VOXELS} voxels.")
    box = bench.box_with_margin(label, int(np.ceil(3 * sigma)) + 1)
    values = bench.read(box).copy()
    inside = values == label
    shortest = min(bench.voxel_size.zyx)
    share = ndimage.gaussian_filter(
        inside.astype(np.float32), [sigma * shortest / edge for edge in bench.voxel_size.zyx], mode="nearest"
    )
    wanted = share > 0.5
    if not (wanted & (inside | (values == 0))).any():
        raise EditError(
            f"Grain {label} is too small to be smoothed by {sigma:g} voxels: nothing would be left."
        )
    # Where it touches others its border stays: what it lost there would be a gap that the scan does not show.
    others = ndimage.binary_dilation((values != 0) & ~inside, np.ones((3, 3, 3)))
    values[inside & ~wanted & ~others] = 0
    values[wanted & (values == 0) & bench.seen(box)] = label
    bench.write(box, values)


def fill_holes(bench: Workbench, label: int) -> None:
    """Give the void that a grain encloses to it; grains inside it stay.

    Raises
    ------
    EditError
        If it encloses none.
    """
    bench.require((label,))
    box = widened(bench.box(label), 0, bench.shape)
    values = bench.read(box).copy()
    gained = without_cavities(values == label) & (values == 0)
    if not gained.any():
        raise EditError(f"Grain {label} has no holes to fill.")
    values[gained] = label
    bench.write(box, values)


def _require_distance(by: float) -> None:
    if not 0 < by <= _MOST_VOXELS:
        raise EditError(f"by={by} is impossible: give 0 to {_MOST_VOXELS} voxels.")


def _distance(bench: Workbench, mask: np.ndarray) -> np.ndarray:
    """Return the distance of the voxels of a mask to those outside it, in the smallest edge."""
    shortest = min(bench.voxel_size.zyx)
    distance: np.ndarray = edt.edt(
        np.ascontiguousarray(mask),
        anisotropy=tuple(edge / shortest for edge in bench.voxel_size.zyx),
        black_border=False,
    )
    return distance
