"""Small pictures of triangle meshes by a depth buffer: no VTK, the light and view of other thumbnails."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int, UInt8

from mbstudio.core.compiled import compiled
from mbstudio.scene.pictures.thumbnails import MARGIN, lit, shaded_picture, view_frame

_SAMPLES = 2


def mesh_thumbnail(
    vertices: Float[np.ndarray, "v 3"],
    triangles: Int[np.ndarray, "t 3"],
    colour: str,
    size: int,
    reach: float,
) -> UInt8[np.ndarray, "size size 4"]:
    """Return a picture of a closed mesh about the origin, seen from the isometric view, on nothing.

    Parameters
    ----------
    vertices : float array, shape (v, 3)
    triangles : int array, shape (t, 3)
        Outward.
    colour : str
        As ``#rrggbb``.
    size : int
        Pixels of a side.
    reach : float
        Half of what the picture shows, less a margin, in the unit of the vertices.

    Returns
    -------
    uint8 array, shape (size, size, 4)
        Red, green, blue and opacity; row 0 is the upper one.

    Notes
    -----
    Light falls on normals that are mixed within each triangle from those of its corners (Phong).
    """
    frame = np.stack(view_frame())
    rays = size * _SAMPLES
    seen = np.asarray(vertices, dtype=np.float64) @ frame.T
    places = np.stack([
        (1.0 + seen[:, 0] / (MARGIN * reach)) * rays / 2 - 0.5,
        (1.0 - seen[:, 1] / (MARGIN * reach)) * rays / 2 - 0.5,
        seen[:, 2],
    ], axis=1)  # fmt: skip
    depth = np.full((rays, rays), -np.inf)
    normals = np.zeros((rays, rays, 3))
    _draw(
        places,
        np.ascontiguousarray(triangles, dtype=np.int64),
        _corner_normals(vertices, triangles),
        depth,
        normals,
    )
    met = np.isfinite(depth).ravel()
    shade = np.zeros(rays * rays)
    found = normals.reshape(-1, 3)[met]
    shade[met] = lit(found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-300))
    return shaded_picture(met, shade, colour, size)


def _corner_normals(
    vertices: Float[np.ndarray, "v 3"], triangles: Int[np.ndarray, "t 3"]
) -> Float[np.ndarray, "v 3"]:
    a, b, c = (vertices[triangles[:, corner]] for corner in range(3))
    across = np.cross(b - a, c - a)
    normals = np.zeros((len(vertices), 3))
    for corner in range(3):
        np.add.at(normals, triangles[:, corner], across)
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)


@compiled()
def _draw(
    places: np.ndarray,
    triangles: np.ndarray,
    corner_normals: np.ndarray,
    depth: np.ndarray,
    normals: np.ndarray,
) -> None:
    rows, columns = depth.shape
    for triangle in range(triangles.shape[0]):
        i, j, k = triangles[triangle, 0], triangles[triangle, 1], triangles[triangle, 2]
        ax, ay = places[i, 0], places[i, 1]
        bx, by = places[j, 0], places[j, 1]
        cx, cy = places[k, 0], places[k, 1]
        double = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if double == 0.0:
            continue
        for y in range(
            max(int(np.ceil(min(ay, by, cy))), 0), min(int(np.floor(max(ay, by, cy))), rows - 1) + 1
        ):
            for x in range(
                max(int(np.ceil(min(ax, bx, cx))), 0), min(int(np.floor(max(ax, bx, cx))), columns - 1) + 1
            ):
                u = ((bx - x) * (cy - y) - (by - y) * (cx - x)) / double
                v = ((cx - x) * (ay - y) - (cy - y) * (ax - x)) / double
                w = 1.0 - u - v
                if u < 0.0 or v < 0.0 or w < 0.0:
                    continue
                height = u * places[i, 2] + v * places[j, 2] + w * places[k, 2]
                if height > depth[y, x]:
                    depth[y, x] = height
                    for axis in range(3):
                        normals[y, x, axis] = (
                            u * corner_normals[i, axis]
                            + v * corner_normals[j, axis]
                            + w * corner_normals[k, axis]
                        )
