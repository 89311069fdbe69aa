"""What lies under a pixel, and where a point of space stands in the picture."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from jaxtyping import Float
from vtkmodules.vtkRenderingCore import vtkCellPicker

from mbstudio.scene.surfaces import LABEL_ARRAY


def surface_under(
    renderer: Any, actors: Iterable[Any], x: float, y: float
) -> tuple[Float[np.ndarray, "3"], int | None] | None:
    """Return what lies foremost of these surfaces under a pixel.

    Parameters
    ----------
    renderer : vtkRenderer
    actors : iterable of vtkActor
    x, y : float
        Pixels from the lower left.

    Returns
    -------
    point : float array, shape (3,)
    label : int or None
        Of the triangle; None where it has none. Nothing at all is returned where no surface is hit.
    """
    picker = vtkCellPicker()
    picker.SetTolerance(0.0005)
    picker.PickFromListOn()
    for actor in actors:
        picker.AddPickList(actor)
    if not picker.Pick(x, y, 0, renderer) or picker.GetCellId() < 0:
        return None
    labels = picker.GetDataSet().GetCellData().GetArray(LABEL_ARRAY)
    label = None if labels is None else int(labels.GetTuple1(picker.GetCellId())) or None
    return np.array(picker.GetPickPosition()), label


def sight(renderer: Any, x: float, y: float) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Return a point and the unit direction of the line of sight through a pixel."""
    ends = []
    for depth in (0.0, 1.0):
        renderer.SetDisplayPoint(x, y, depth)
        renderer.DisplayToWorld()
        point = np.array(renderer.GetWorldPoint())
        ends.append(point[:3] / point[3])
    along = ends[1] - ends[0]
    return ends[0], along / (np.linalg.norm(along) or 1.0)


def to_display(renderer: Any, points: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 2"]:
    """Return where points stand in the picture, in pixels from its lower left corner."""
    width, height = renderer.GetSize()
    left, bottom = renderer.GetOrigin()
    matrix = renderer.GetActiveCamera().GetCompositeProjectionTransformMatrix(
        width / max(height, 1), -1.0, 1.0
    )
    rows = np.array([[matrix.GetElement(i, j) for j in range(4)] for i in range(4)])
    given = np.atleast_2d(np.asarray(points, dtype=float))
    seen = np.column_stack([given, np.ones(len(given))]) @ rows.T
    share = (seen[:, :2] / seen[:, 3:] + 1) / 2
    return np.asarray(share * [width, height] + [left, bottom])


def pixels_per_length(
    renderer: Any, place: Float[np.ndarray, "3"], direction: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "2"]:
    """Return by how many pixels a point moves in the picture for one length along a direction."""
    camera = renderer.GetActiveCamera()
    step = camera.GetParallelScale() or 1.0
    here, there = to_display(renderer, np.array([place, np.asarray(place) + step * direction]))
    return np.asarray((there - here) / step)


def length_of_drag(
    renderer: Any,
    place: Float[np.ndarray, "3"],
    direction: Float[np.ndarray, "3"],
    moved: Float[np.ndarray, "2"],
) -> float:
    """Return how far a drag of so many pixels moves a thing that can only go along one direction.

    Seen end on, the direction has no length in the picture: a drag upwards then pulls it nearer.
    """
    pixels = pixels_per_length(renderer, place, direction)
    camera, (_, height) = renderer.GetActiveCamera(), renderer.GetSize()
    whole = height / (2 * camera.GetParallelScale())  # pixels of one length across the line of sight
    if np.linalg.norm(pixels) < 0.12 * whole:
        towards = -np.sign(np.dot(direction, camera.GetDirectionOfProjection())) or 1.0
        return float(towards * moved[1] / whole)
    return float(moved @ pixels / (pixels @ pixels))


def distance_to_segments(
    point: Float[np.ndarray, "2"], starts: Float[np.ndarray, "m 2"], ends: Float[np.ndarray, "m 2"]
) -> Float[np.ndarray, " m"]:
    """Return how far a point of the picture lies from lines in it, in pixels."""
    along = ends - starts
    squares = np.maximum((along**2).sum(axis=1), 1e-12)
    share = np.clip(((point - starts) * along).sum(axis=1) / squares, 0, 1)
    return np.asarray(np.linalg.norm(starts + share[:, None] * along - point, axis=1))
