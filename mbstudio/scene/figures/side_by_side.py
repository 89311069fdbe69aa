"""True grains beside clones, drawn alike: what eyes say to what classifiers found."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int
from matplotlib.figure import Figure

from mbstudio.core import formulas
from mbstudio.core.metrics.mass import volume_integrals
from mbstudio.scene.pictures.mesh_thumbnails import mesh_thumbnail

SHOWN = 16
_COLOUR = "#c9b79a"
_PIXELS = 150

Surface = tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "t 3"]]


def side_by_side_figure(true: Sequence[Surface], clones: Sequence[Surface], seed: int = 0) -> Figure:
    """Return sixteen true grains beside sixteen clones: drawn at random, turned at random, of one size.

    Parameters
    ----------
    true, clones : sequence of (vertices, triangles)
        Closed, outward.
    seed : int
        Of what is drawn and how it is turned.
    """
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng([seed, 0x16])
    sides: list[list[Surface]] = []
    for bodies in (true, clones):
        rows = rng.choice(len(bodies), min(SHOWN, len(bodies)), replace=False)
        turns = Rotation.random(len(rows), random_state=rng).as_matrix()
        sides.append([
            (_unit_sized(*bodies[row]) @ turn.T, bodies[row][1])
            for row, turn in zip(rows, turns, strict=True)
        ])  # fmt: skip
    reach = max(float(np.linalg.norm(points, axis=1).max()) for side in sides for points, _ in side)
    figure = Figure(figsize=(12.0, 6.4))
    for left, title, side in zip((0.0, 0.51), ("True grains", "Clones"), sides, strict=True):
        figure.text(left + 0.245, 0.965, title, ha="center", va="center", fontsize=12)
        for place, (points, triangles) in enumerate(side):
            row, column = divmod(place, 4)
            axes = figure.add_axes((left + 0.1225 * column, 0.94 - 0.235 * (row + 1), 0.1225, 0.235))
            axes.set_axis_off()
            axes.imshow(mesh_thumbnail(points, triangles, _COLOUR, _PIXELS, 0.85 * reach))
    return figure


def _unit_sized(
    vertices: Float[np.ndarray, "v 3"], triangles: Int[np.ndarray, "t 3"]
) -> Float[np.ndarray, "v 3"]:
    """Return vertices in D_n about the centre of volume."""
    start = vertices.mean(axis=0)
    integrals = volume_integrals(vertices - start, triangles)
    centre = start + integrals[1:4] / integrals[0]
    return (vertices - centre) / formulas.nominal_diameter(float(integrals[0]))
