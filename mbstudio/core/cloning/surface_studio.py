"""Grains shaped by hand from the surfaces of a style: form, roughness, edges, blends of two parents, warps.

Size and form follow from one linear map, and are what was asked for to the last digits. Sphericity, convexity
and roughness each have one band of the surface that moves them (:mod:`mbstudio.core.cloning.surface_bands`);
how far is found by trying, and held where triangles would begin to fold over.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
from jaxtyping import Float, Float64, Int

from mbstudio.core.cloning.clone_maker import CloneRecipe, Surface, impose_form, unstretched
from mbstudio.core.cloning.kernel_warp import weights_at
from mbstudio.core.cloning.parent_surface import ParentSurface, coarser
from mbstudio.core.cloning.recipe_drawing import draw_recipes, gentle_share
from mbstudio.core.cloning.solid_moments import make_isotropic, solid_moments
from mbstudio.core.cloning.surface_avatar import SurfaceAvatar
from mbstudio.core.cloning.surface_avatars import CONTROL_POINTS, fit_surface
from mbstudio.core.cloning.surface_bands import Gains, Smoothing, combine
from mbstudio.core.cloning.surface_morph import lay_onto
from mbstudio.core.cloning.surface_style import SurfaceStyle
from mbstudio.core.errors import CloningError
from mbstudio.core.metaball.avatar import Avatar

SHAPE_FACTORS = ("size", "elongation", "flatness", "csf", "sphericity", "convexity", "roughness")
"""What a hand can ask for: D_n; I/L, S/I and S/sqrt(LI) of the ellipsoid of equal inertia; sphericity; volume
over that of the convex hull; height of what is finer than a twelfth of the way round (rms, over D_n)."""
_BANDS: Mapping[str, str] = MappingProxyType(
    {"sphericity": "coarse", "convexity": "edges", "roughness": "fine"}
)
BANDED_FACTORS = tuple(_BANDS)
"""Factors that are reached by the gain of a band of the surface; the others are exact."""
_GAINS: Mapping[str, tuple[float, float]] = MappingProxyType(
    {"coarse": (0.0, 1.8), "edges": (0.0, 1.8), "fine": (0.0, 2.5)}
)
FOLDED = 0.002
"""Share of the area whose triangles may turn over beyond that of the parent."""
_AT_REST, _MOVING = (9, 1e-4), (5, 1e-3)
"""Most steps to a value, and how near is near enough."""
_FLATTEST = 0.12
MOVING_FACES = 6000
"""Triangles of the stand-in that follows the hand."""


@dataclass(frozen=True, eq=False)
class GrainShape:
    """All that a shaped grain follows from.

    Attributes
    ----------
    parent : int
        Row of the parent.
    form : float array, shape (3,)
        Logarithms of the semi-axes over their geometric mean, the longest first.
    diameter : float
        D_n in the unit of the style.
    other : int or None
        Row of the parent that it is blended with.
    share : float
        Of the other one.
    gains : Gains
    warp : float array, shape (modes,)
        Shares of the modes of the style.
    turn : float array, shape (3, 3)
        How the parent lies in the form; of negative determinant for a mirrored one.
    detail_stretch : float
        Share of the stretch that edges and roughness take on.
    """

    parent: int
    form: Float[np.ndarray, " 3"]
    diameter: float
    other: int | None = None
    share: float = 0.0
    gains: Gains = field(default_factory=Gains)
    warp: Float[np.ndarray, " modes"] = field(default_factory=lambda: np.zeros(0))
    turn: Float[np.ndarray, "3 3"] = field(default_factory=lambda: np.eye(3))
    detail_stretch: float = 0.0

    @property
    def axis_ratios(self) -> tuple[float, float]:
        """Elongation I/L and flatness S/I."""
        return float(np.exp(self.form[1] - self.form[0])), float(np.exp(self.form[2] - self.form[1]))


@dataclass(frozen=True, eq=False)
class ShapedGrain:
    """The surface of a shape, and what was measured of it.

    Attributes
    ----------
    shape : GrainShape
    surface : Surface
        In the frame of the form, in the unit of the style.
    values : mapping of str to float
        Of `SHAPE_FACTORS`; convexity is left out where it was not asked for.
    folded : float
        Share of the area whose triangles have turned over, beyond that of the parent.
    """

    shape: GrainShape
    surface: Surface
    values: Mapping[str, float]
    folded: float

    @property
    def is_sound(self) -> bool:
        """Whether no more than rounding of the surface folds over."""
        return self.folded <= FOLDED


def with_axis_ratios(shape: GrainShape, elongation: float, flatness: float) -> GrainShape:
    """Return a shape in another form, of the same volume.

    Raises
    ------
    CloningError
        If a ratio is not above 0.12 and at most 1.
    """
    for what, value in (("elongation", elongation), ("flatness", flatness)):
        if not _FLATTEST <= value <= 1.0:
            raise CloningError(f"No grain has {what} {value:.3g}: ask for {_FLATTEST:g} to 1.")
    u, v = np.log([elongation, flatness])
    longest = -(2 * u + v) / 3
    return replace(shape, form=np.array([longest, longest + u, longest + u + v]))


def with_csf(shape: GrainShape, csf: float) -> GrainShape:
    """Return a shape with another Corey factor: logarithms of both ratios of axes change in proportion."""
    u, v = np.log(shape.axis_ratios)
    wanted, now = float(np.log(csf)), 0.5 * u + v
    if now < -1e-9:
        u, v = u * wanted / now, v * wanted / now
    else:
        u = v = wanted / 1.5
    low = np.log(_FLATTEST)
    return with_axis_ratios(shape, float(np.exp(np.clip(u, low, 0.0))), float(np.exp(np.clip(v, low, 0.0))))


class SurfaceStudio:
    """Makes grains of shapes, and shapes of what is asked for; what it works out it remembers.

    Parameters
    ----------
    style : SurfaceStyle
    most_faces : int, optional
        Triangles above which coarser stand-ins of the parents are shaped: fast enough to follow a hand.
    """

    def __init__(self, style: SurfaceStyle, most_faces: int | None = None) -> None:
        self.style = style
        self._most = most_faces
        self._effort = _AT_REST if most_faces is None else _MOVING
        self._bases: dict[int, _Base] = {}
        self._others: dict[tuple[int, int], Float64[np.ndarray, "3 v 3"]] = {}

    # ---- shapes --------------------------------------------------------------------------------

    def begin(self, parent: int) -> GrainShape:
        """Return the shape that is a parent itself."""
        body = self.style.parents[parent]
        return GrainShape(parent, body.log_form, body.diameter, warp=np.zeros(len(self.style.modes)))

    def of_recipe(self, recipe: CloneRecipe) -> GrainShape:
        """Return the shape that is a clone."""
        return GrainShape(
            recipe.parent, recipe.form, recipe.diameter, warp=recipe.warp, turn=recipe.turn,
            detail_stretch=recipe.detail_stretch,
        )  # fmt: skip

    def draw(self, seed: int) -> GrainShape:
        """Return the shape of a clone drawn at random."""
        return self.of_recipe(draw_recipes(self.style, 1, seed)[0])

    def warped(self, shape: GrainShape, strength: float, seed: int) -> tuple[GrainShape, bool]:
        """Return a shape with another warp, and whether it is weaker than asked for, lest the body folds.

        A strength of 1 is as grains of this kind differ.
        """
        drawn = strength * self.style.draw_warp(np.random.default_rng(seed))
        share = gentle_share(self.style.parents[shape.parent].vertices, self.style, drawn)
        return replace(shape, warp=share * drawn), share < 1.0

    def blended(self, shape: GrainShape, other: int | None, share: float) -> tuple[GrainShape, bool]:
        """Return a shape with a share of another parent, and False: it can always be had.

        Form and size go from one parent to the other as surfaces do.
        """
        if other is None or other == shape.parent:
            return replace(shape, other=None, share=0.0), False
        ends = [self.style.parents[row] for row in (shape.parent, other)]
        form = (1 - share) * ends[0].log_form + share * ends[1].log_form
        diameter = ends[0].diameter ** (1 - share) * ends[1].diameter ** share
        return replace(shape, other=other, share=share, form=form, diameter=diameter), False

    def reach(self, shape: GrainShape, factor: str, wanted: float) -> tuple[GrainShape, bool]:
        """Return a shape in which one factor has another value, and whether it could not be reached.

        Size and form are reached exactly; the others within a thousandth, or as near as the surface allows.
        Size and form stay, whatever else is asked for.

        Raises
        ------
        CloningError
            If there is no such factor, or no grain has such a size or form.
        """
        if factor == "size":
            if not (np.isfinite(wanted) and wanted > 0):
                raise CloningError(f"A grain of size {wanted:g} cannot be: ask for a positive number.")
            return replace(shape, diameter=float(wanted)), False
        elongation, flatness = shape.axis_ratios
        if factor == "elongation":
            return with_axis_ratios(shape, wanted, flatness), False
        if factor == "flatness":
            return with_axis_ratios(shape, elongation, wanted), False
        if factor == "csf":
            found = with_csf(shape, wanted)
            ratios = found.axis_ratios
            return found, abs(np.sqrt(ratios[0]) * ratios[1] / wanted - 1) > 1e-6
        if factor not in _BANDS:
            raise CloningError(f"'{factor}' is no factor of shape: use one of {', '.join(SHAPE_FACTORS)}.")
        return self._search(shape, factor, wanted)

    # ---- surfaces ------------------------------------------------------------------------------

    def make(self, shape: GrainShape, *, hull: bool = True) -> ShapedGrain:
        """Return the surface of a shape, measured; without `hull` convexity is left out."""
        base, isotropic, matrix = self._isotropic(shape)
        surface, values = self._finished(shape, base, isotropic, matrix)
        if hull:
            values["convexity"] = convexity_of(surface)
        return ShapedGrain(shape, surface, MappingProxyType(values), base.folded(isotropic) - base.own_folds)

    def fit(self, grain: ShapedGrain, n: int | None = None) -> SurfaceAvatar:
        """Return a metaball fitted to a shaped grain, from that of its parent where there is one.

        Raises
        ------
        CloningError
            If none can be fitted.
        """
        start = self._carried(grain) if self.style.avatars and n is None else None
        points = n or CONTROL_POINTS
        return fit_surface(*grain.surface, self.style.unit, points, start=start, name="shaped grain")

    def misfit(self, shape: GrainShape) -> float:
        """Return the share of the area whose triangles have turned over, beyond that of the parent."""
        base, isotropic, _ = self._isotropic(shape)
        return base.folded(isotropic) - base.own_folds

    def _base(self, row: int) -> _Base:
        if row not in self._bases:
            self._bases[row] = _Base(coarser(self.style.parents[row], self._most))
        return self._bases[row]

    def _layers(self, shape: GrainShape, base: _Base) -> Float64[np.ndarray, "3 v 3"]:
        if shape.other is None or shape.share == 0.0:
            return base.layers
        key = (shape.parent, shape.other)
        if key not in self._others:
            target = coarser(self.style.parents[shape.other], self._most)
            self._others[key] = base.smoothing.layers(lay_onto(base.parent, target).vertices)
        return (1 - shape.share) * base.layers + shape.share * self._others[key]

    def _isotropic(
        self, shape: GrainShape
    ) -> tuple[_Base, Float64[np.ndarray, "v 3"], Float64[np.ndarray, "3 3"]]:
        """Return the surface before it gets its form, and what made it isotropic."""
        base = self._base(shape.parent)
        moved = combine(self._layers(shape, base), shape.gains)
        if len(shape.warp) and np.any(shape.warp):
            moved = moved + base.weights @ self.style.warp(shape.warp)
        return base, *make_isotropic(moved, base.parent.faces)

    def _own_form(self, shape: GrainShape) -> Float64[np.ndarray, " 3"]:
        """Return the logarithms of semi-axes at which details are as they came."""
        own = self.style.parents[shape.parent].log_form
        if shape.other is None:
            return own
        return (1 - shape.share) * own + shape.share * self.style.parents[shape.other].log_form

    def _finished(
        self, shape: GrainShape, base: _Base, isotropic: Float64[np.ndarray, "v 3"],
        matrix: Float64[np.ndarray, "3 3"],
    ) -> tuple[Surface, dict[str, float]]:  # fmt: skip
        faces = base.parent.faces if np.linalg.det(shape.turn) > 0 else base.parent.faces[:, ::-1]
        mapping = shape.turn.T * np.exp(shape.form)
        more = (1 - shape.detail_stretch) * unstretched(np.exp(self._own_form(shape)), matrix, mapping)
        raw, light, heavy = self._layers(shape, base)
        edges, fine = shape.gains.edges * (light - heavy), shape.gains.fine * (raw - light)
        shaped = isotropic @ mapping + (edges + fine) @ more
        finish = impose_form(shaped, faces, shape.form, shape.diameter)
        surface = Surface((shaped - finish.centre) @ finish.matrix, np.ascontiguousarray(faces))
        elongation, flatness = shape.axis_ratios
        heights = fine @ (matrix @ mapping + more) @ finish.matrix
        return surface, {
            "size": shape.diameter,
            "elongation": elongation,
            "flatness": flatness,
            "csf": float(np.sqrt(elongation) * flatness),
            "sphericity": float(np.pi * shape.diameter**2 / area_of(surface)),
            "roughness": _rms_height(surface, heights) / shape.diameter,
        }

    # ---- what reaches a value ------------------------------------------------------------------

    def _search(self, shape: GrainShape, factor: str, wanted: float) -> tuple[GrainShape, bool]:
        """Return the shape whose band has the gain at which a factor is as wanted, or nearest to it."""
        band = _BANDS[factor]
        low, high = _GAINS[band]

        def at(gain: float) -> GrainShape:
            return replace(shape, gains=replace(shape.gains, **{band: gain}))

        def value(gain: float) -> float:
            return self.make(at(gain), hull=factor == "convexity").values[factor]

        high = self._unfolded(at, high)
        return _bisect(value, at, low, high, wanted, self._effort)

    def _unfolded(self, at: Callable[[float], GrainShape], high: float) -> float:
        """Return the largest gain up to `high` at which the surface does not fold."""
        if self.misfit(at(high)) <= FOLDED:
            return high
        low = 0.0
        for _ in range(5):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if self.misfit(at(middle)) <= FOLDED else (low, middle)
        return low

    def _carried(self, grain: ShapedGrain) -> Avatar:
        """Return the parent's control points carried along with the corners near them."""
        from scipy.spatial import cKDTree

        shape, parent = grain.shape, self.style.parents[grain.shape.parent]
        base = self._base(shape.parent)
        own = self.style.avatars[shape.parent].avatar
        places = own.centers / parent.semi_axes
        distance, near = cKDTree(base.parent.vertices).query(places, k=12)
        weight = 1.0 / (distance**2 + 1e-3)
        mapping = shape.diameter / np.cbrt(np.prod(np.exp(shape.form))) * (shape.turn.T * np.exp(shape.form))
        mapping = mapping * np.cbrt(np.prod(parent.semi_axes))
        moved = grain.surface.vertices[near] - base.parent.vertices[near] @ mapping
        placed = places @ mapping + (weight[:, :, None] * moved).sum(axis=1) / weight.sum(axis=1)[:, None]
        return Avatar(placed, own.weights * shape.diameter**2, self.style.unit, name=own.name)


class _Base:
    """A parent made ready: its bands, and what a warp does at its corners."""

    def __init__(self, parent: ParentSurface) -> None:
        self.parent = parent
        self.smoothing = Smoothing(parent.vertices, parent.faces)
        self.layers = self.smoothing.layers(parent.vertices)
        self.weights = weights_at(parent.vertices)
        self._normals = _face_normals(self.layers[1], parent.faces)
        self.own_folds = self.folded(parent.vertices)

    def folded(self, vertices: Float[np.ndarray, "v 3"]) -> float:
        """Return the share of the area whose triangles look the other way than the smooth parent's."""
        across = _face_normals(vertices, self.parent.faces)
        turned = np.einsum("fi,fi->f", across, self._normals) < 0
        areas = np.linalg.norm(across, axis=1)
        return float(areas[turned].sum() / areas.sum())


def _bisect(
    value: Callable[[float], float], at: Callable[[float], GrainShape], low: float, high: float,
    wanted: float, effort: tuple[int, float],
) -> tuple[GrainShape, bool]:  # fmt: skip
    """Return where a function that goes one way meets a value (regula falsi, Illinois; Dowell 1971)."""
    steps, near = effort
    near *= max(abs(wanted), 1e-3)
    ends = [(low, value(low) - wanted), (high, value(high) - wanted)]
    nearest = min(ends, key=lambda end: abs(end[1]))
    if ends[0][1] * ends[1][1] > 0:
        return at(nearest[0]), abs(nearest[1]) > near
    (a, fa), (b, fb) = ends
    for _ in range(steps):
        if abs(nearest[1]) <= near or fa == fb:
            break
        middle = (a * fb - b * fa) / (fb - fa)
        found = value(middle) - wanted
        nearest = min((nearest, (middle, found)), key=lambda end: abs(end[1]))
        if found * fb < 0:
            a, fa = b, fb
        else:
            fa *= 0.5
        b, fb = middle, found
    return at(nearest[0]), abs(nearest[1]) > 10 * near


def _face_normals(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> np.ndarray:
    a, b, c = (vertices[faces[:, corner]] for corner in range(3))
    across: np.ndarray = np.cross(b - a, c - a)
    return across


def area_of(surface: Surface) -> float:
    """Return the area of a surface."""
    return 0.5 * float(np.linalg.norm(_face_normals(*surface), axis=1).sum())


def _rms_height(surface: Surface, heights: Float[np.ndarray, "v 3"]) -> float:
    """Return the root mean square of displacements along the normals, over the area."""
    across = _face_normals(*surface)
    doubled = np.maximum(np.linalg.norm(across, axis=1), 1e-300)
    middle = heights[surface.faces].mean(axis=1)
    along = np.einsum("fi,fi->f", middle, across / doubled[:, None])
    return float(np.sqrt((doubled * along**2).sum() / doubled.sum()))


def convexity_of(surface: Surface) -> float:
    """Return the volume of a closed surface over that of its convex hull."""
    from scipy.spatial import ConvexHull

    return float(solid_moments(*surface).volume / ConvexHull(surface.vertices).volume)
