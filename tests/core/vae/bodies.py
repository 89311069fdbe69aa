"""Bodies known by formula, and a template of an ellipsoid."""

from __future__ import annotations

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.vae.serialize.serialization import Template
from mbstudio.core.vae.serialize.template import spread_template
from mbstudio.core.vae.serialize.template_fit import match_volume


def ellipsoid(
    semi_axes: tuple[float, float, float], turn: Rotation | None = None, place: tuple[float, ...] = (0, 0, 0)
) -> trimesh.Trimesh:
    """An ellipsoid of these semi-axes along x, y, z, turned and moved, in um."""
    mesh = trimesh.creation.icosphere(subdivisions=4)
    points = np.asarray(mesh.vertices) * semi_axes
    body = trimesh.Trimesh((turn or Rotation.identity()).apply(points) + place, mesh.faces, process=False)
    body.units = "um"
    return body


def some_ellipsoids(count: int) -> list[trimesh.Trimesh]:
    rng = np.random.default_rng(3)
    return [
        ellipsoid(
            (50 * rng.uniform(1.15, 1.35), 50.0, 50 * rng.uniform(0.65, 0.85)),
            Rotation.random(random_state=i), tuple(rng.uniform(-99, 99, 3)),
        )
        for i in range(count)
    ]  # fmt: skip


def ellipsoid_template(n: int) -> Template:
    """Control points spread through an ellipsoid, of the volume of a sphere of diameter 1."""
    sphere = trimesh.creation.icosphere(subdivisions=3)
    octant = np.maximum(np.asarray(sphere.vertices), 0)
    octant = octant[(np.asarray(sphere.vertices) > -1e-9).all(axis=1)]
    radii = 1 / np.linalg.norm(octant / np.array([0.62, 0.5, 0.4]), axis=1)
    start = spread_template(n, radii, octant)
    control = np.vstack([start.centers.T, np.exp(start.log_weights)])
    matched = match_volume(np.ascontiguousarray(control), np.pi / 6)
    return Template(start.centers, np.log(matched[3]), start.exchange)


def template_avatar(
    template: Template, size: float, turn: Rotation | None = None, place: tuple[float, ...] = (0, 0, 0)
) -> Avatar:
    """The template itself as an avatar of D_n = `size` um, turned and moved."""
    avatar = Avatar(template.centers * size, np.exp(template.log_weights) * size**2, "um", name="template")
    matrix = None if turn is None else turn.as_matrix()
    return avatar.transformed(matrix, np.array(place, dtype=float))
