"""New surfaces from a style: one parent, warped a little, re-formed along other axes than its own.

What makes a grain look like its kind are faces, edges and roughness, and the way they hang together. A
linear map keeps planes plane and edges straight; so a parent is first freed of its form, turned, and given
the form of another, drawn as forms are spread among the parents. Only turns that stretch nothing by more than
a bound are taken. Edges and roughness are turned with the body but not stretched: squeezed edges would be
sharper than any of the parents'. A smooth warp, as registrations between parents have shown them to be, does
the rest.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float64, Int

from mbstudio.core.cloning.kernel_warp import displacement, gradient
from mbstudio.core.cloning.solid_moments import make_isotropic, solid_moments
from mbstudio.core.cloning.surface_style import SurfaceStyle
from mbstudio.core.errors import CloningError
from mbstudio.core.options import OptionRecord, option

_BALL_VOLUME = np.pi / 6.0


@dataclass(frozen=True)
class CloneOptions(OptionRecord, owner="clones", error=CloningError):
    """How far clones go from their parents."""

    stretch: float = option(
        1.4,
        "By how much a parent may be stretched or squeezed along an axis to take on another form.",
        minimum=1.0,
        maximum=3.0,
    )
    detail_stretch: float = option(
        0.0,
        "How much of the stretch edges and roughness take on; 0 only turns them, 1 keeps planes plane.",
        minimum=0.0,
        maximum=1.0,
    )
    warping: float = option(
        0.2, "Strength of the smooth warp; 1 is as grains of this kind differ.", minimum=0.0, maximum=1.5
    )
    local_stretch: float = option(
        1.5,
        "By how much the warp may stretch or squeeze the neighbourhood of a point.",
        above=1.0,
        maximum=3.0,
    )


@dataclass(frozen=True, eq=False)
class CloneRecipe:
    """All that one clone follows from; its latent variables, in numbers that mean something.

    Attributes
    ----------
    parent : int
        Row of the parent.
    form : float array, shape (3,)
        Logarithms of its semi-axes over their geometric mean, the longest first.
    turn : float array, shape (3, 3)
        Orthogonal, with determinant -1 for a mirrored parent: how the parent lies in the new form.
    warp : float array, shape (modes,)
        Shares of the modes of the style.
    diameter : float
        D_n in the unit of the style.
    detail_stretch : float
        Share of the stretch that edges and roughness take on.
    """

    parent: int
    form: Float[np.ndarray, " 3"]
    turn: Float[np.ndarray, "3 3"]
    warp: Float[np.ndarray, " modes"]
    diameter: float
    detail_stretch: float = 0.0


class Surface(NamedTuple):
    """A closed surface, wound outwards."""

    vertices: Float64[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]


class Finish(NamedTuple):
    """The last small linear map of a clone: rows of places less `centre`, times `matrix`."""

    centre: Float64[np.ndarray, " 3"]
    matrix: Float64[np.ndarray, "3 3"]


def unstretched(
    semi_axes: Float[np.ndarray, " 3"], matrix: Float[np.ndarray, "3 3"], shaping: Float[np.ndarray, "3 3"]
) -> Float64[np.ndarray, "3 3"]:
    """Return what is added to a clone for each detail of its parent, so that details are not stretched.

    Details are rows in the parent's isotropic frame. The map from the parent's body to the clone is a turn
    after a stretch (polar decomposition); details take the turn, and the mean stretch.

    Parameters
    ----------
    semi_axes : float array, shape (3,)
        Of the parent's body.
    matrix : float array, shape (3, 3)
        What makes the changed parent isotropic again.
    shaping : float array, shape (3, 3)
        From the isotropic frame to the clone.
    """
    axes = np.exp(np.log(semi_axes) - np.log(semi_axes).mean())
    left, stretch, right = np.linalg.svd(shaping / axes[:, None])
    mean = np.exp(np.log(stretch).mean()) * np.cbrt(abs(np.linalg.det(matrix)))
    found: np.ndarray = mean * axes[:, None] * (left @ right) - matrix @ shaping
    return found


def impose_form(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], form: Float[np.ndarray, " 3"],
    diameter: float,
) -> Finish:  # fmt: skip
    """Return the linear map that gives a body form and size to the last digits, its axes where they are."""
    moments = solid_moments(vertices, faces)
    isotropic, matrix = make_isotropic(vertices, faces)
    shaping = matrix * np.exp(form)
    volume = solid_moments(isotropic * np.exp(form), faces).volume
    return Finish(moments.centre, diameter * np.cbrt(_BALL_VOLUME / volume) * shaping)


class CloneMap:
    """The map from a parent to a clone, for corners of the surface and control points within it alike.

    Parameters
    ----------
    style : SurfaceStyle
    recipe : CloneRecipe

    Notes
    -----
    Places of the parent are given in its isotropic frame; those of the clone come in its principal frame, in
    the unit of the style. Form and volume are imposed after the warp, so that they are those of the recipe to
    the last digits.
    """

    def __init__(self, style: SurfaceStyle, recipe: CloneRecipe) -> None:
        parent = style.parents[recipe.parent]
        self._warp = style.warp(recipe.warp)
        moved = parent.vertices + displacement(parent.vertices, self._warp)
        moments = solid_moments(moved, parent.faces)
        isotropic, matrix = make_isotropic(moved, parent.faces)
        shaping = recipe.turn.T * np.exp(recipe.form)
        faces = parent.faces if np.linalg.det(recipe.turn) > 0 else parent.faces[:, ::-1]
        shaped = isotropic @ shaping
        if recipe.detail_stretch < 1.0:
            more = (1.0 - recipe.detail_stretch) * unstretched(parent.semi_axes, matrix, shaping)
            shaped = shaped + parent.details @ more
        finish = impose_form(shaped, faces, recipe.form, recipe.diameter)
        self._centre, self._offset = moments.centre, finish.centre
        self._first, self._second = matrix @ shaping, finish.matrix
        self._matrix = self._first @ self._second
        self.surface = Surface((shaped - finish.centre) @ finish.matrix, np.ascontiguousarray(faces))

    def __call__(self, points: Float[np.ndarray, "p 3"]) -> Float64[np.ndarray, "p 3"]:
        """Return where points of the parent come to lie."""
        moved = (points + displacement(points, self._warp) - self._centre) @ self._first
        placed: np.ndarray = (moved - self._offset) @ self._second
        return placed

    def scale_at(self, points: Float[np.ndarray, "p 3"]) -> Float64[np.ndarray, " p"]:
        """Return by how much lengths about points grow, on the average over directions."""
        volumes = np.linalg.det(gradient(points, self._warp)) * abs(np.linalg.det(self._matrix))
        scales: np.ndarray = np.cbrt(volumes)
        return scales


def make_surface(style: SurfaceStyle, recipe: CloneRecipe) -> Surface:
    """Return the surface of a recipe in its principal frame, in the unit of the style."""
    return CloneMap(style, recipe).surface


def stretches(style: SurfaceStyle, recipe: CloneRecipe) -> Float64[np.ndarray, " 3"]:
    """Return by how much a recipe stretches its parent along three axes, before the warp."""
    forms = style.parents[recipe.parent].log_form
    matrix = np.exp(recipe.form)[:, None] * recipe.turn / np.exp(forms)
    values: np.ndarray = np.linalg.svd(matrix, compute_uv=False)
    return values
