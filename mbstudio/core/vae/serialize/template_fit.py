"""The fit of one body from the template: a guarded Levenberg-Marquardt search held to its start."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Float64

from mbstudio.core.imaging.depths import count_outside
from mbstudio.core.imaging.fast.guard import hold_empty_places
from mbstudio.core.imaging.fast.refine import Refinement, RefineSettings
from mbstudio.core.imaging.fast.rows import Residuals
from mbstudio.core.imaging.fast.volume import VolumeScaling
from mbstudio.core.imaging.preprocess import PreparedGrain
from mbstudio.core.metaball.topology import Topology, topology
from mbstudio.core.vae.serialize.fit_target import prepare_body
from mbstudio.core.vae.serialize.frame import PrincipalFrame
from mbstudio.core.vae.serialize.serialization import Template
from mbstudio.core.vae.serialize.template import PLACE_SCALE, WEIGHT_SCALE

if TYPE_CHECKING:
    from mbstudio.core.vae.serialize.frame import Body


@dataclass(frozen=True)
class TemplateFitSettings:
    """Constants of the template fit.

    Attributes
    ----------
    ridges : tuple of float
        How strongly control points are held to the template, from stage to stage: the sum of
        squares of changes, weighted by the template's stiffness, counts so much against the mean
        squared distance of the surface in D_n**2.
    steps : tuple of int
        Steps of each stage.
    area_steps : int
        Steps that also push edges out until the area is right.
    guard_rounds, guard_steps : int
        Rounds at most that make an avatar one piece without a void, and steps of each.
    """

    ridges: tuple[float, ...] = (3e-5, 4e-6, 7e-7)
    steps: tuple[int, ...] = (6, 6, 16)
    area_steps: int = 8
    guard_rounds: int = 6
    guard_steps: int = 8


@dataclass(frozen=True, eq=False)
class FittedBody:
    """One body as an avatar in its principal frame.

    Attributes
    ----------
    centers : float array, shape (n, 3)
        In D_n.
    log_weights : float array, shape (n,)
        ln k, k in D_n**2.
    diameter : float
        D_n in `unit`.
    unit : str
    rms : float
        Of the surface, in D_n.
    valid : bool
        One piece, no void, no control point outside the body.
    """

    centers: Float[np.ndarray, "n 3"]
    log_weights: Float[np.ndarray, " n"]
    diameter: float
    unit: str
    rms: float
    valid: bool


# No tips: they would draw control points that all bodies share to what is one body's own.
_SEARCH = RefineSettings(
    steepness_roof_of_few=10.0,
    tip_weight=0.0,
    area_slack=0.0035,
    area_slack_of_many=0.0035,
    area_stays=False,
    points_per_many=25,
    renew_many_every=5,
)


class TemplateFit(Refinement):
    """A fast search whose control points are held near where the template has them."""

    def __init__(
        self, prepared: PreparedGrain, frame: PrincipalFrame, template: Template, settings: RefineSettings
    ) -> None:
        start = place_template(template, prepared, frame)
        self._held = np.concatenate([np.log(start[3]), start[:3].ravel()])
        self._stiffness = _stiffness_in(template, frame.axes, frame.diameter / prepared.scale)
        self.ridge = 0.0
        super().__init__(prepared, start, settings)

    def _drift(self, control: np.ndarray) -> np.ndarray:
        moved: np.ndarray = np.concatenate([np.log(control[3]), control[:3].ravel()]) - self._held
        return moved

    def _cost(self, control: np.ndarray) -> tuple[float, Residuals]:
        cost, rows = super()._cost(control)
        drift = self._drift(control)
        return cost + 0.5 * self.ridge * float(drift @ self._stiffness @ drift), rows

    def _normal_equations(self, at: Residuals) -> tuple[np.ndarray, np.ndarray]:
        matrix, gradient = super()._normal_equations(at)
        matrix += self.ridge * self._stiffness
        gradient += self.ridge * (self._stiffness @ self._drift(self.control))
        return matrix, gradient

    def descend(self, steps: int) -> None:
        """Advance so many steps, or until two in a row find nothing lower."""
        stuck = 0
        for _ in range(steps):
            stuck = 0 if self.advance() else stuck + 1
            if stuck == 2:
                return


def _stiffness_in(
    template: Template, axes: Float[np.ndarray, "3 3"], unit_length: float
) -> Float64[np.ndarray, "m m"]:
    """Return the template's stiffness against changes of ln k and of x, y, z in a body's working frame."""
    n = template.n
    stiffness = np.eye(4 * n) if template.stiffness is None else template.stiffness
    blocks = stiffness.reshape(4, n, 4, n)
    # From working lengths along the body's own axes to 0.1 D_n along the principal ones; the sum of
    # squares itself is in working lengths, so all is counted in D_n**2.
    turn = np.zeros((4, 4))
    turn[0, 0] = unit_length / WEIGHT_SCALE
    turn[1:, 1:] = axes.T / PLACE_SCALE
    turned: np.ndarray = np.einsum("ai,anbm,bj->injm", turn, blocks, turn, optimize=True).reshape(
        4 * n, 4 * n
    )
    return turned


def place_template(
    template: Template, prepared: PreparedGrain, frame: PrincipalFrame
) -> Float64[np.ndarray, "4 n"]:
    """Return the template laid into a body: rows x, y, z, k in the body's working frame."""
    places = (frame.body_points(template.centers) - prepared.center) / prepared.scale
    weights = np.exp(template.log_weights) * (frame.diameter / prepared.scale) ** 2
    return np.ascontiguousarray(np.vstack([places.T, weights]))


def fit_body(
    prepared: PreparedGrain,
    frame: PrincipalFrame,
    template: Template,
    settings: TemplateFitSettings | None = None,
) -> FittedBody:
    """Fit one body from the template.

    Parameters
    ----------
    prepared, frame
        From `prepare_body`.
    template : Template
    settings : TemplateFitSettings, optional
    """
    settings = settings or TemplateFitSettings()
    unit_length = frame.diameter / prepared.scale
    search = TemplateFit(prepared, frame, template, _SEARCH)
    search.settle()
    for ridge, steps in zip(settings.ridges, settings.steps, strict=True):
        search.ridge = ridge
        search.descend(steps)
    if settings.area_steps and search.strive_for_area():
        search.descend(settings.area_steps)
    found = _make_sound(search, settings)
    matched = match_volume(search.control, prepared.volume)
    if found.is_sound and np.abs(np.log(matched[3] / search.control[3])).max() > 1e-3:
        found = topology(matched)
    search.control = matched
    valid = found.is_sound and count_outside(matched, prepared) == 0
    return FittedBody(
        frame.shape_points(matched[:3].T * prepared.scale + prepared.center),
        np.log(matched[3] / unit_length**2),
        frame.diameter,
        frame.unit,
        search.rms() / unit_length,
        valid,
    )


def fit_from_template(
    body: Body, template: Template, *, unit: str | None = None, seed: int = 0, name: str = "The body"
) -> FittedBody:
    """Return a grain, mesh or avatar as an avatar of the template, in its principal frame.

    Parameters
    ----------
    body : Grain, Avatar or trimesh.Trimesh
    template : Template
    unit : str, optional
        Length unit of a mesh that carries none.
    seed : int
        Of the places of surface points.
    name : str
        What to call the body in messages.

    Raises
    ------
    SerializationError
        If the body cannot be prepared for a fit.
    """
    return fit_body(*prepare_body(body, unit=unit, seed=seed, name=name), template)


def _make_sound(search: TemplateFit, settings: TemplateFitSettings) -> Topology:
    """Go on until the avatar is one piece without a void, as far as that succeeds; return what it is then."""
    rng = np.random.default_rng(0)
    found = topology(search.control)
    for number in range(settings.guard_rounds):
        if found.is_sound:
            break
        if found.pieces > 1:
            _pull_in(search, found)
        hold_empty_places(search, number, rng)
        search.descend(settings.guard_steps)
        found = topology(search.control)
    return found


def _pull_in(search: TemplateFit, found: Topology) -> None:
    """Move control points of islands deeper, and toward the nearest point of the body's largest piece."""
    control = search.control.copy()
    main = control[:3, found.piece_of_point == 0]
    for i in np.flatnonzero(found.piece_of_point > 0):
        way = main - control[:3, i : i + 1]
        nearest = int((way**2).sum(axis=0).argmin())
        control[:3, i] += 0.35 * way[:, nearest]
    search.keep_deep(control)
    search.set_control(control)


def match_volume(control: Float64[np.ndarray, "4 n"], volume: float) -> Float64[np.ndarray, "4 n"]:
    """Return control points with all k times one factor, so that the solid has this volume."""
    matched, scaling = control.copy(), VolumeScaling(volume)
    for _ in range(4):
        excess = scaling.excess(matched)
        if abs(excess) < 2e-5:
            break
        scaling.scale(matched, excess)
    return matched
