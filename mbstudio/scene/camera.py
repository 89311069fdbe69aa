"""Where the camera stands: preset views, and fitting what is shown into the picture."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from jaxtyping import Float

View = Literal["isometric", "front", "back", "left", "right", "top", "bottom"]
MARGIN = 1.14  # of free space around what is fitted

DIRECTIONS: dict[View, tuple[tuple[float, float, float], tuple[float, float, float]]] = {
    "isometric": ((1.0, -1.35, 0.9), (0, 0, 1)),
    "front": ((0, -1, 0), (0, 0, 1)),
    "back": ((0, 1, 0), (0, 0, 1)),
    "left": ((-1, 0, 0), (0, 0, 1)),
    "right": ((1, 0, 0), (0, 0, 1)),
    "top": ((0, 0, 1), (0, 1, 0)),
    "bottom": ((0, 0, -1), (0, 1, 0)),
}
"""Of each view: from the focal point to the camera, and what is up."""
VIEWS: tuple[View, ...] = tuple(DIRECTIONS)


def turn(renderer: Any, view: View) -> None:
    """Turn the camera to a preset direction."""
    away, up = DIRECTIONS[view]
    camera = renderer.GetActiveCamera()
    camera.SetPosition(*(np.array(camera.GetFocalPoint()) + np.array(away)))
    camera.SetViewUp(*up)


def pose(renderer: Any) -> tuple[Any, ...]:
    """Return where the camera stands and looks, for :func:`set_pose`."""
    camera = renderer.GetActiveCamera()
    return (
        camera.GetPosition(), camera.GetFocalPoint(), camera.GetViewUp(), camera.GetParallelScale(),
    )  # fmt: skip


def set_pose(renderer: Any, pose: tuple[Any, ...]) -> None:
    """Put the camera to where it stood before."""
    camera = renderer.GetActiveCamera()
    position, focal_point, up, scale = pose
    camera.SetPosition(*position)
    camera.SetFocalPoint(*focal_point)
    camera.SetViewUp(*up)
    camera.SetParallelScale(scale)
    renderer.ResetCameraClippingRange()


def shows(renderer: Any, points: Float[np.ndarray, "m 3"]) -> bool:
    """Return whether all points are in the picture."""
    camera = renderer.GetActiveCamera()
    axes = _axes(camera)
    seen = np.abs((points - camera.GetFocalPoint()) @ axes[:2].T)
    width, height = renderer.GetSize()
    half = camera.GetParallelScale()
    return bool((seen.max(axis=0) <= [half * width / max(height, 1), half]).all())


def fit(renderer: Any, points: Float[np.ndarray, "m 3"]) -> None:
    """Bring points into the picture without turning.

    What is seen from here decides, not the ball around it: a long grain fills the picture.
    """
    camera = renderer.GetActiveCamera()
    axes = _axes(camera)
    seen = points @ axes.T
    low, high = seen.min(axis=0), seen.max(axis=0)
    centre = (low + high) / 2 @ axes
    width, height = renderer.GetSize()
    aspect = width / height if width and height else 1.0
    half = max((high[1] - low[1]) / 2, (high[0] - low[0]) / 2 / aspect, 1e-12)
    camera.SetFocalPoint(*centre)
    camera.SetPosition(*(centre + axes[2] * 4 * max(half, float(high[2] - low[2]))))
    camera.SetParallelScale(half * MARGIN)
    renderer.ResetCameraClippingRange()


def centre(renderer: Any, point: Float[np.ndarray, "3"]) -> None:
    """Move a point into the middle of the picture without turning or zooming."""
    camera = renderer.GetActiveCamera()
    shift = np.asarray(point, float) - camera.GetFocalPoint()
    camera.SetPosition(*(np.asarray(camera.GetPosition()) + shift))
    camera.SetFocalPoint(*point)
    renderer.ResetCameraClippingRange()


def _axes(camera: Any) -> Float[np.ndarray, "3 3"]:
    """Return as rows the picture's right, its upward direction and the way to the camera."""
    away = np.subtract(camera.GetPosition(), camera.GetFocalPoint())
    away = away / (np.linalg.norm(away) or 1.0)
    right = np.cross(camera.GetViewUp(), away)
    right /= np.linalg.norm(right) or 1.0
    return np.array([right, np.cross(away, right), away])
