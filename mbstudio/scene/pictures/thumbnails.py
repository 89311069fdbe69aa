"""Small pictures of avatars by rays: no VTK, so that any thread can make them by the hundred."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64, UInt8

from mbstudio.core.metaball.avatar import Avatar
from mbstudio.scene.camera import DIRECTIONS
from mbstudio.scene.theme import rgb

_LIGHT = np.array([-0.35, 0.55, 0.76])
MARGIN = 1.12
_SAMPLES = 2  # a pixel's side is so many rays, for smooth outlines


def thumbnail(
    avatar: Avatar, colour: str, size: int = 72, reach: float | None = None
) -> UInt8[np.ndarray, "size size 4"]:
    """Return a picture of an avatar seen from the isometric view, on nothing.

    Parameters
    ----------
    avatar : Avatar
    colour : str
        As ``#rrggbb``.
    size : int
        Pixels of a side.
    reach : float, optional
        Half of what the picture shows, in the avatar's unit; by default the avatar fills it.

    Returns
    -------
    uint8 array, shape (size, size, 4)
        Red, green, blue and opacity; row 0 is the upper one.
    """
    low, high = avatar.bounds()
    centre, half = 0.5 * (low + high), 0.5 * float(np.linalg.norm(high - low))
    right, up, away = view_frame()
    shown = MARGIN * (pictured_reach(avatar) if reach is None else reach)
    rays = size * _SAMPLES
    place = shown * (2 * (np.arange(rays) + 0.5) / rays - 1)
    across, upward = np.meshgrid(place, -place)
    plane = centre + across[..., None] * right + upward[..., None] * up
    origins = (plane + 1.01 * half * away).reshape(-1, 3)
    hits = avatar.first_hits(origins, np.broadcast_to(-away, origins.shape).copy())
    met = np.isfinite(hits)
    shade = np.zeros(len(hits))
    gradient = avatar.gradient(origins[met] - hits[met][:, None] * away)
    normal = -gradient / np.maximum(np.linalg.norm(gradient, axis=1, keepdims=True), 1e-300)
    shade[met] = lit(normal)
    return shaded_picture(met, shade, colour, size)


def pictured_reach(avatar: Avatar) -> float:
    """Return about how far the picture of an avatar reaches from its middle, in its unit."""
    low, high = avatar.bounds()
    right, up, _ = view_frame()
    # Of the ellipsoid in the bounding box: its corners are empty.
    return float(max(np.linalg.norm(0.5 * (high - low) * way) for way in (right, up)))


def lit(normals: Float64[np.ndarray, "m 3"]) -> Float64[np.ndarray, " m"]:
    """Return how bright surfaces with these unit normals (x, y, z) are, 0.3 in the shade to 1.05."""
    light = _LIGHT @ np.stack(view_frame())
    return 0.3 + 0.75 * np.clip(normals @ (light / np.linalg.norm(light)), 0.0, 1.0)


def shaded_picture(
    met: np.ndarray, shade: np.ndarray, colour: str, size: int
) -> UInt8[np.ndarray, "size size 4"]:
    """Return rays that met something, with their brightness, as a picture with smooth outlines."""

    def pixels(values: np.ndarray) -> np.ndarray:
        return values.reshape(size, _SAMPLES, size, _SAMPLES).mean(axis=(1, 3))

    cover, light = pixels(met.astype(float)), pixels(shade)
    light = np.divide(light, cover, out=np.zeros_like(light), where=cover > 0)
    picture = np.empty((size, size, 4), dtype=np.uint8)
    picture[..., :3] = np.clip(light[..., None] * np.array(rgb(colour)), 0, 255).astype(np.uint8)
    picture[..., 3] = np.round(255 * cover).astype(np.uint8)
    return picture


def view_frame() -> tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3"], Float64[np.ndarray, "3"]]:
    """Return the picture's right, its upward direction and the way to the camera."""
    away, upright = (np.array(vector, dtype=float) for vector in DIRECTIONS["isometric"])
    away /= np.linalg.norm(away)
    right = np.cross(upright, away)
    right /= np.linalg.norm(right)
    return right, np.cross(away, right), away
