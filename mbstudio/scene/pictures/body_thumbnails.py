"""Small pictures of bodies, avatars and meshes alike."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import UInt8

from mbstudio.core.metaball.avatar import Avatar
from mbstudio.scene.pictures.mesh_thumbnails import mesh_thumbnail
from mbstudio.scene.pictures.thumbnails import thumbnail, view_frame

if TYPE_CHECKING:
    import trimesh


def body_thumbnail(
    body: Avatar | trimesh.Trimesh, colour: str, size: int = 72
) -> UInt8[np.ndarray, "size size 4"]:
    """Return a picture of an avatar or a closed mesh seen from the isometric view; the body fills it.

    Parameters
    ----------
    body : Avatar or trimesh.Trimesh
    colour : str
        As ``#rrggbb``.
    size : int
        Pixels of a side.

    Returns
    -------
    uint8 array, shape (size, size, 4)
        Red, green, blue and opacity; row 0 is the upper one.
    """
    if isinstance(body, Avatar):
        return thumbnail(body, colour, size)
    points = np.asarray(body.vertices, dtype=float)
    right, up, _ = view_frame()
    seen = points @ np.stack([right, up], axis=1)
    low, high = seen.min(axis=0), seen.max(axis=0)
    middle = 0.5 * (low + high) @ np.stack([right, up])
    return mesh_thumbnail(
        points - middle, np.asarray(body.faces), colour, size, 0.5 * float((high - low).max())
    )
