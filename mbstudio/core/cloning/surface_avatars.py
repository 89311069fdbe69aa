"""Metaballs freely fitted to surfaces: to parents from clustered spheres, to clones from their parents'."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import trimesh
from jaxtyping import Float

from mbstudio.core.cloning.clone_maker import CloneMap
from mbstudio.core.cloning.parent_surface import ParentSurface
from mbstudio.core.cloning.solid_moments import Faces, Points, solid_moments
from mbstudio.core.cloning.surface_avatar import SurfaceAvatar
from mbstudio.core.errors import CloningError, MbstudioError
from mbstudio.core.formulas import nominal_diameters
from mbstudio.core.imaging.fast.fast import FastFit, FastOptions
from mbstudio.core.imaging.fast.refine import RefineSettings
from mbstudio.core.imaging.preprocess import PreparedGrain
from mbstudio.core.imaging.steps import SearchStep
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.vae.serialize.fit_target import prepare_mesh
from mbstudio.core.vae.serialize.frame import PrincipalFrame

CONTROL_POINTS = 120
_STEPS_OF_CLONES, _STEPS_OF_MANY = 12, 30
# Many control points lie less deep, and follow the surface where fewer points would not tell them to.
_OF_MANY = {"side": 90, "hull_points": 32_000}
# An area row would grow bumps until the area fits: what faces and edges lack is not to be made up for.
_SETTINGS = RefineSettings(area_weight=0.0)


class _FitToSurface(FastFit):
    """A fast fit to a surface that is prepared already, from control points if there are any."""

    def __init__(
        self, prepared: PreparedGrain, n: int, seed: int, generations: int,
        start: Float[np.ndarray, "4 n"] | None,
    ) -> None:  # fmt: skip
        super().__init__(prepared.grain, n, seed, FastOptions(generations=generations, refine=_SETTINGS))
        self._prepared, self._start = prepared, start

    def _all_steps(self) -> Iterator[SearchStep]:
        if self._start is None:
            yield from super()._all_steps()
            return
        self._begin_at(self._start)
        yield from self._search(self.options.generations)


def fit_surface(
    vertices: Points,
    faces: Faces,
    unit: str,
    n: int = CONTROL_POINTS,
    *,
    start: Avatar | None = None,
    steps: int | None = None,
    seed: int = 0,
    name: str = "avatar",
) -> SurfaceAvatar:
    """Fit an avatar to a closed surface.

    Parameters
    ----------
    vertices : float array, shape (v, 3)
        In `unit`.
    faces : int array, shape (f, 3)
        Wound outwards.
    unit : str
    n : int
        Control points; those of `start`, if it is given.
    start : Avatar, optional
        To begin from, near the surface already: a dozen steps are enough then.
    steps : int, optional
        Of the search at most; 60, or from a start 12, and 30 of more than 120 control points.
    seed : int
    name : str

    Raises
    ------
    CloningError
        If no metaball can be fitted.
    """
    moments = solid_moments(vertices, faces)
    diameter = float(nominal_diameters(moments.volume))
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    mesh.units = unit
    frame = PrincipalFrame(moments.centre, np.eye(3), diameter, unit)
    try:
        count = n if start is None else len(start.weights)
        fine = _OF_MANY if count > CONTROL_POINTS else {}
        prepared = prepare_mesh(mesh, frame, seed, **fine)
        control = None if start is None else _in_working_frame(start, prepared)
        usual = _STEPS_OF_MANY if count > CONTROL_POINTS else _STEPS_OF_CLONES
        generations = steps or (FastOptions().generations if control is None else usual)
        fit = _FitToSurface(prepared, count, seed, generations, control)
        for _ in fit:
            pass
        result = fit.result()
    except MbstudioError as error:
        raise CloningError(f"No metaball can be fitted to {name}: {error}") from error
    verdict = result.verdict
    avatar = Avatar(result.avatar.centers, result.avatar.weights, unit, name=name)
    return SurfaceAvatar(avatar, verdict.rms / diameter, verdict.volume_error, verdict.valid)


def fit_parent(parent: ParentSurface, n: int = CONTROL_POINTS, *, seed: int = 0) -> SurfaceAvatar:
    """Fit an avatar to a parent in its principal frame, in D_n.

    Raises
    ------
    CloningError
        If no metaball can be fitted.
    """
    return fit_surface(parent.body_vertices(), parent.faces, parent.unit, n, seed=seed, name=parent.name)


def carry_avatar(parent: ParentSurface, of_parent: Avatar, clone_map: CloneMap, unit: str) -> Avatar:
    """Return a parent's control points carried along to a clone: near its surface, but not yet fitted.

    Parameters
    ----------
    parent : ParentSurface
    of_parent : Avatar
        Of :func:`fit_parent`: in the principal frame, in D_n.
    clone_map : CloneMap
    unit : str
        Of the clone.
    """
    places = of_parent.centers / parent.semi_axes
    # k is a squared length; the isotropic frame is larger than D_n by the semi-axes.
    scales = clone_map.scale_at(places) / np.cbrt(np.prod(parent.semi_axes))
    return Avatar(clone_map(places), of_parent.weights * scales**2, unit, name=of_parent.name)


def _in_working_frame(avatar: Avatar, prepared: PreparedGrain) -> Float[np.ndarray, "4 n"]:
    places = (avatar.centers - prepared.center) / prepared.scale
    control: np.ndarray = np.ascontiguousarray(np.vstack([places.T, avatar.weights / prepared.scale**2]))
    return control
