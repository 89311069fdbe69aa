"""The mean shape of a population and of all its flips, and the template fitted to it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from mbstudio.core.imaging.preprocess import PreparedGrain
from mbstudio.core.vae.serialize.fit_target import prepare_mesh
from mbstudio.core.vae.serialize.frame import PrincipalFrame
from mbstudio.core.vae.serialize.serialization import Template
from mbstudio.core.vae.serialize.template import spread_template, symmetric_mean
from mbstudio.core.vae.serialize.template_fit import TemplateFitSettings, fit_body

_DIRECTIONS = 642  # of the sphere whose corners carry the mean radius
_NEIGHBOURS = 12
_FREE = TemplateFitSettings(ridges=(1e-6, 1e-7), steps=(15, 25), area_steps=0)


def mean_radii(
    bodies: Sequence[tuple[PreparedGrain, PrincipalFrame]],
    directions: Float[np.ndarray, "d 3"],
) -> Float[np.ndarray, " d"]:
    """Return the mean radius, in D_n, of bodies and all their flips along directions.

    Parameters
    ----------
    bodies : sequence of PreparedGrain and PrincipalFrame
    directions : float array, shape (d, 3)
        Unit vectors; what their signs are does not matter.
    """
    from scipy.spatial import cKDTree

    total = np.zeros(len(directions))
    for prepared, frame in bodies:
        points = frame.shape_points(prepared.hull * prepared.scale + prepared.center)
        radii = np.linalg.norm(points, axis=1)
        # All eight flips of a body together are its hull folded into one octant.
        folded = np.abs(points) / np.maximum(radii, 1e-12)[:, None]
        _, nearest = cKDTree(folded).query(np.abs(directions), k=min(_NEIGHBOURS, len(points)))
        total += radii[nearest].reshape(len(directions), -1).mean(axis=1)
    return total / len(bodies)


def make_template(bodies: Sequence[tuple[PreparedGrain, PrincipalFrame]], n: int) -> Template:
    """Return a symmetric template of `n` control points for bodies: fitted to their mean, then their mean.

    Parameters
    ----------
    bodies : sequence of PreparedGrain and PrincipalFrame
    n : int
    """
    import trimesh

    sphere = trimesh.creation.icosphere(subdivisions=3)
    directions = np.asarray(sphere.vertices)
    radii = mean_radii(bodies, directions)
    octant = (directions >= -1e-9).all(axis=1)
    template = spread_template(n, radii[octant], np.maximum(directions[octant], 0.0))
    mean = trimesh.Trimesh(directions * radii[:, None], sphere.faces, process=False)
    mean.apply_scale(float(np.cbrt(np.pi / 6 / mean.volume)))
    # Its own axes are those of the template, whatever its moments of inertia.
    frame = PrincipalFrame(np.zeros(3), np.eye(3), 1.0, "mm")
    target = prepare_mesh(mean, frame, 0)
    for _ in range(3):
        fitted = fit_body(target, frame, template, _FREE)
        template = symmetric_mean(fitted.centers[None], fitted.log_weights[None])
    return template
