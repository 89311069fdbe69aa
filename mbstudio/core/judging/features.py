"""What a body is judged by: features that no generator selects on, free of size and triangles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float64, Int
from scipy.spatial import cKDTree

from mbstudio.core import formulas
from mbstudio.core.errors import MeasureError, MeshError
from mbstudio.core.judging.outer_radii import HIGHEST, band_amplitudes, outer_radii, quadrature
from mbstudio.core.judging.smoothed_surface import COARSE, FINE, SmoothedSurface, smoothed_surface
from mbstudio.core.meshes.edges import EdgeTable, signed_volume, with_three_corners
from mbstudio.core.metrics.axes import convex_hull, inertia_lengths
from mbstudio.core.metrics.harmonics import solid_angles
from mbstudio.core.metrics.mass import volume_integrals
from mbstudio.core.metrics.surfaces import outer_pieces
from mbstudio.core.threads import one_thread
from mbstudio.core.vae.models.radii import SMALLEST_RADIUS, directions

REACH = 0.1
"""Distance, in D_n, of the places between whose normals edge angles are taken."""
_REACH_SPREAD = 0.2
_PLACES = 6000
_TURNED_AWAY = 2e-3
"""Of the sphere that may be covered by triangles turned towards the centre: ripples of a rough surface."""


@dataclass(frozen=True)
class FeatureKind:
    """One feature.

    Attributes
    ----------
    name : str
        As in tables.
    title : str
        In words, with its unit.
    group : str
        The feature set that it is of, but for the bands, which are in two.
    by_logarithm : bool
        Whether its logarithm is compared, as it is positive and spread over decades.
    """

    name: str
    title: str
    group: str
    by_logarithm: bool = False


def _kinds() -> tuple[FeatureKind, ...]:
    bands = [
        FeatureKind(f"band_{degree}", f"Harmonics of degree {degree}, % of D_n", "bands 2-20", True)
        for degree in range(2, HIGHEST + 1)
    ]
    curved, edges = "curvature", "edge angles"
    return (
        *bands,
        FeatureKind("convexity", "Convexity V / V_hull", "convexity and roughness"),
        FeatureKind("roughness", "Roughness, % of D_n", "convexity and roughness", True),
        FeatureKind("roughness_skewness", "Skewness of the roughness", "convexity and roughness"),
        FeatureKind("roughness_kurtosis", "Kurtosis of the roughness", "convexity and roughness"),
        FeatureKind("curvature_mean", "Mean curvature x D_n, mean", curved),
        FeatureKind("curvature_deviation", "Mean curvature x D_n, standard deviation", curved),
        *(
            FeatureKind(f"curvature_{rank}", f"Mean curvature x D_n, {rank} % quantile", curved)
            for rank in (5, 25, 50, 75, 95)
        ),
        FeatureKind("curvature_concave", "Share of the surface with a concave direction", curved),
        FeatureKind("bend_50", "Larger principal curvature x D_n, median", curved, True),
        FeatureKind("bend_90", "Larger principal curvature x D_n, 90 % quantile", curved, True),
        *(
            FeatureKind(f"edge_angle_{rank}", f"Angle of normals {REACH:g} D_n apart, {rank} % rank", edges)
            for rank in (5, 25, 50, 75, 95)
        ),
        *(
            FeatureKind(f"ridge_angle_{rank}", f"Largest such angle at a place, {rank} % rank", edges)
            for rank in (25, 50, 75, 95)
        ),
        FeatureKind("il", "I / L by inertia", "form"),
        FeatureKind("si", "S / I by inertia", "form"),
    )  # fmt: skip


FEATURES = _kinds()
"""All features, in the order of `Features.values`."""
_PLACE = {kind.name: place for place, kind in enumerate(FEATURES)}


def _sets() -> dict[str, tuple[int, ...]]:
    groups = ("curvature", "edge angles", "convexity and roughness", "form")
    return {
        "all": tuple(range(len(FEATURES))),
        "bands 2-12": tuple(_PLACE[f"band_{degree}"] for degree in range(2, 13)),
        "bands 2-20": tuple(_PLACE[f"band_{degree}"] for degree in range(2, HIGHEST + 1)),
        **{
            group: tuple(place for place, kind in enumerate(FEATURES) if kind.group == group)
            for group in groups
        },
    }


FEATURE_SETS = _sets()
"""Name of each set of features to their places in `Features.values`."""


@dataclass(frozen=True, eq=False)
class Features:
    """What one body is judged by.

    Attributes
    ----------
    values : float array, shape (features,)
        Of `FEATURES`. NaN where one is not defined; `notes` says why.
    log_radii : float array, shape (144,)
        ln r, r in D_n, in the directions of :func:`mbstudio.core.vae.models.radii.directions`, in the
        principal frame.
    overhang : float
        Share of the sphere that is covered by parts of the surface turned towards the centre of volume; above
        0.002 the body is not star-shaped, and its bands are those of its outermost radii.
    triangle_edge : float
        Median length of the triangles' edges in D_n.
    notes : tuple of str
        What is to be known about single features.
    """

    values: Float64[np.ndarray, " features"]
    log_radii: Float64[np.ndarray, " 144"]
    overhang: float
    triangle_edge: float
    notes: tuple[str, ...]

    @property
    def is_star_shaped(self) -> bool:
        """Whether each ray from the centre of volume leaves the body once."""
        return self.overhang <= _TURNED_AWAY

    def __getitem__(self, name: str) -> float:
        return float(self.values[_PLACE[name]])


@one_thread()
def body_features(vertices: Float[np.ndarray, "v 3"], triangles: Int[np.ndarray, "t 3"]) -> Features:
    """Return the features of a closed surface.

    Lengths are in D_n, the diameter of the ball of equal volume, from the centre of volume.

    Parameters
    ----------
    vertices : float array, shape (v, 3)
    triangles : int array, shape (t, 3)
        Closed and wound outwards.

    Returns
    -------
    Features

    Raises
    ------
    MeshError
        If the surface is empty, open, wound inwards or inconsistently, in several pieces, or has vertices
        that are not finite.
    MeasureError
        If the body is so thin that nothing of it is left at the stated scale, or too long for the grid.

    Notes
    -----
    Bands are the root mean square over directions of the part of each degree of the outermost radius.
    Roughness is the height of the surface smoothed by 0.02 D_n above the body smoothed by 0.06 D_n, its mean
    taken off; curvatures and angles are those of the surface smoothed by 0.02 D_n. Only convexity and form
    are of the surface as it is.

    Examples
    --------
    >>> import trimesh
    >>> ball = trimesh.creation.icosphere(subdivisions=3)
    >>> found = body_features(ball.vertices, ball.faces)
    >>> round(found["convexity"], 3), round(found["il"], 3)
    (1.0, 1.0)
    """
    vertices = np.asarray(vertices, dtype=np.float64)
    triangles = np.ascontiguousarray(triangles, dtype=np.int64)
    require_closed_body(vertices, triangles)
    vertices, lengths = _in_principal_frame(vertices, triangles)
    surface = smoothed_surface(vertices, triangles)
    notes: list[str] = []
    overhang = max(0.0, -float(np.minimum(solid_angles(vertices[triangles]), 0.0).sum()) / (4 * np.pi))
    if overhang > _TURNED_AWAY:
        notes.append(
            "is not star-shaped about its centre of volume: its bands are those of its outermost radii"
        )
    grid = quadrature()[0]
    along = np.concatenate([grid, directions()])
    radii = outer_radii(vertices, triangles, along)
    if (radii <= 0).any():
        notes.append("does not hold its centre of volume, so that it has no bands")
        bands = np.full(HIGHEST - 1, np.nan)
    else:
        bands = 100.0 * band_amplitudes(radii[: len(grid)])[2:]
    hull = convex_hull(vertices)
    s, i, length = lengths
    values = np.concatenate([
        bands, [signed_volume(vertices, triangles) / float(hull.volume)], _roughness(surface),
        _curvature(surface), _edge_angles(surface), [i / length, s / i],
    ])  # fmt: skip
    assert len(values) == len(FEATURES)
    return Features(
        values=values,
        log_radii=np.log(np.maximum(radii[len(grid) :], SMALLEST_RADIUS)),
        overhang=overhang,
        triangle_edge=_median_edge(vertices, triangles),
        notes=tuple(notes),
    )


def require_closed_body(vertices: Float[np.ndarray, "v 3"], triangles: Int[np.ndarray, "t 3"]) -> None:
    """Refuse a surface that is not one closed body seen from outside.

    Raises
    ------
    MeshError
        Says what is wrong.
    """
    if vertices.ndim != 2 or vertices.shape[1:] != (3,) or triangles.ndim != 2 or triangles.shape[1:] != (3,):
        raise MeshError(
            f"Vertices of shape {vertices.shape} and triangles of shape {triangles.shape} are no surface: "
            "both need three columns."
        )
    if not len(triangles):
        raise MeshError("The surface has no triangles.")
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        raise MeshError(f"Triangles name vertices that are not there: there are {len(vertices)}.")
    if not np.isfinite(vertices).all():
        raise MeshError("The surface has vertices that are not finite.")
    if not with_three_corners(triangles).all():
        raise MeshError("The surface has triangles with fewer than three corners: clean it first.")
    edges = EdgeTable.from_faces(triangles)
    if not edges.is_closed:
        raise MeshError(
            f"The surface is not closed: it has {len(edges.open_edges)} open edges. Join corners at equal "
            "places and close holes before it is judged."
        )
    if not edges.is_consistent:
        raise MeshError("Neighbouring triangles disagree on what is outside: make their winding consistent.")
    if not signed_volume(vertices, triangles) > 0:
        raise MeshError(
            "The surface is wound inwards, so that its volume is not positive: turn its triangles."
        )
    pieces = outer_pieces(vertices, triangles)
    if pieces != 1:
        raise MeshError(f"The surface is in {pieces} pieces: one body at a time is judged.")


def _in_principal_frame(
    vertices: Float[np.ndarray, "v 3"], triangles: Int[np.ndarray, "t 3"]
) -> tuple[Float64[np.ndarray, "v 3"], Float64[np.ndarray, " 3"]]:
    """Return vertices in D_n about the centre of volume, long axis first, and the ellipsoid's axes."""
    start = vertices.mean(axis=0)
    size = float(np.abs(vertices - start).max())
    scaled = (vertices - start) / size
    integrals = volume_integrals(scaled, triangles)
    volume = float(integrals[0])
    centre = integrals[1:4] / volume
    xx, yy, zz, xy, yz, zx = integrals[4:] / volume
    second = np.array([[xx, xy, zx], [xy, yy, yz], [zx, yz, zz]]) - np.outer(centre, centre)
    moments, axes = np.linalg.eigh(second)
    if not moments[0] > 0:
        raise MeasureError("The body is flat, so that it has no form.")
    axes = axes[:, ::-1] * np.array([1.0, 1.0, np.sign(np.linalg.det(axes[:, ::-1]))])
    return (scaled - centre) @ axes / formulas.nominal_diameter(volume), inertia_lengths(second)


def _roughness(surface: SmoothedSurface) -> Float64[np.ndarray, " 3"]:
    height = surface.height - surface.height.mean()
    deviation = float(np.sqrt(np.mean(height**2)))
    if deviation < 1e-5:  # a ball: what is left is the grid's
        return np.array([100 * deviation, 0.0, 3.0])
    return np.array([100 * deviation, np.mean(height**3) / deviation**3, np.mean(height**4) / deviation**4])


def _curvature(surface: SmoothedSurface) -> Float64[np.ndarray, " 10"]:
    mean = surface.mean_curvature
    bend = np.maximum(np.abs(surface.low_curvature), np.abs(surface.high_curvature))
    return np.array([
        mean.mean(), mean.std(), *np.percentile(mean, (5, 25, 50, 75, 95)),
        np.mean(surface.low_curvature < 0), *np.percentile(bend, (50, 90)),
    ])  # fmt: skip


def _edge_angles(surface: SmoothedSurface) -> Float64[np.ndarray, " 9"]:
    """Return quantiles of the angles in degrees between normals REACH apart, concave ones negative."""
    rng = np.random.default_rng(0)  # which places are taken is no chance of the body
    count = min(_PLACES, len(surface.points))
    rows = rng.choice(len(surface.points), count, replace=False)
    points, normals = surface.points[rows], surface.normals[rows]
    pairs = cKDTree(points).query_pairs(REACH * (1 + _REACH_SPREAD), output_type="ndarray")
    one, other = pairs.T
    way = points[other] - points[one]
    kept = np.einsum("ij,ij->i", way, way) > (REACH * (1 - _REACH_SPREAD)) ** 2
    one, other, way = one[kept], other[kept], way[kept]
    if len(one) < 50:
        return np.full(9, np.nan)
    turn = normals[other] - normals[one]
    angle = 2.0 * np.degrees(np.arcsin(np.minimum(0.5 * np.linalg.norm(turn, axis=1), 1.0)))
    signed = np.where(np.einsum("ij,ij->i", turn, way) >= 0, angle, -angle)
    largest = np.zeros(count)
    for ends in (one, other):
        np.maximum.at(largest, ends, angle)
    return np.concatenate([
        np.percentile(signed, (5, 25, 50, 75, 95)), np.percentile(largest, (25, 50, 75, 95))
    ])  # fmt: skip


def _median_edge(vertices: Float[np.ndarray, "v 3"], triangles: Int[np.ndarray, "t 3"]) -> float:
    corners = vertices[triangles]
    return float(np.median(np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)))


SCALES = f"surfaces smoothed by {FINE:g} D_n, roughness against {COARSE:g} D_n, angles over {REACH:g} D_n"
"""In words, at which scales surfaces are judged."""
