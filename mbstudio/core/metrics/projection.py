"""The maximum projected area of a body and the perimeter of that projection.

A silhouette is the union of the projected triangles, found exactly (polygon clipping), so
concave bodies and bodies with holes are measured as they are. The direction is found in
three steps: the convex hull's projected area bounds the body's from above and costs almost
nothing, so it sorts evenly spread directions; exact silhouettes of those that can still win
pick the starts; a local quadratic search ends at the maximum to better than 0.1 %.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import ConvexHull

from mbstudio.core.metrics.sphere_directions import frame_along, half_sphere
from mbstudio.core.metrics.surfaces import signed_volumes

if TYPE_CHECKING:
    import manifold3d

_DIRECTIONS = 500
_EXACT_AT_MOST = 24
"""Of a convex body; the more its hull tells too much, the more directions are looked at."""
_EXACT_OF_CONCAVE = 250
_MANY_FACES = 12000
_LIGHT_TOLERANCE = 1e-3
_APART = np.cos(np.radians(9.0))


@dataclass(frozen=True, eq=False)
class Silhouette:
    """The projection of a body along one direction.

    Attributes
    ----------
    area : float
        Area of the union of the projected triangles, in unit**2.
    perimeter : float
        Length of its outline in unit, with the outlines of holes that one can see through.
    direction : float array, shape (3,)
        Unit vector along which it is seen.
    """

    area: float
    perimeter: float
    direction: Float[np.ndarray, " 3"]


class SilhouetteCaster:
    """Casts exact silhouettes of one closed triangle mesh.

    Parameters
    ----------
    vertices : float array, shape (v, 3)
    faces : int array, shape (f, 3)
    """

    def __init__(self, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> None:
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        # Clipping rounds to an absolute grid, so the body is brought to a size of order one.
        self._scale = float((high - low).max()) or 1.0
        self._vertices = np.ascontiguousarray((vertices - (low + high) / 2) / self._scale)
        self._faces = np.ascontiguousarray(faces)
        self._solid = self._make_solid()
        self._light: manifold3d.Manifold | None = None

    def cast(self, direction: Float[np.ndarray, " 3"]) -> Silhouette:
        """Return the silhouette along a direction (any length but zero)."""
        frame = frame_along(direction)
        if self._solid is None:
            outlines = self._outlines_by_union(frame)
        else:
            outlines = [np.asarray(outline) for outline in _project(self._solid, frame).to_polygons()]
        area = perimeter = 0.0
        for outline in outlines:
            after = np.roll(outline, -1, axis=0)
            area += 0.5 * float(np.sum(outline[:, 0] * after[:, 1] - after[:, 0] * outline[:, 1]))
            perimeter += float(np.linalg.norm(after - outline, axis=1).sum())
        return Silhouette(area * self._scale**2, perimeter * self._scale, frame[2])

    def area(self, direction: Float[np.ndarray, " 3"]) -> float:
        """Return the projected area along a direction; of a large mesh to 0.1 %, to compare directions by."""
        if self._solid is None:
            return self.cast(direction).area
        if self._light is None:
            many = len(self._faces) > _MANY_FACES
            self._light = self._solid.simplify(_LIGHT_TOLERANCE) if many else self._solid
        return float(_project(self._light, frame_along(direction)).area()) * self._scale**2

    def _make_solid(self) -> manifold3d.Manifold | None:
        import manifold3d

        mesh = manifold3d.Mesh64(
            vert_properties=self._vertices.astype(np.float64), tri_verts=self._faces.astype(np.uint64)
        )
        solid = manifold3d.Manifold(mesh)
        return solid if solid.status() == manifold3d.Error.NoError and not solid.is_empty() else None

    def _outlines_by_union(self, frame: Float[np.ndarray, "3 3"]) -> list[np.ndarray]:
        """Union of the projected triangles, for surfaces that touch themselves at an edge."""
        import shapely

        flat = (self._vertices @ frame[:2].T)[self._faces]
        a, b = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
        facing = flat[(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) > 1e-14]
        union = shapely.union_all(shapely.polygons(facing))
        outlines = []
        for polygon in shapely.get_parts(union):
            for ring, sign in [(polygon.exterior, True), *((hole, False) for hole in polygon.interiors)]:
                points = shapely.get_coordinates(ring)[:-1]
                outlines.append(points if ring.is_ccw == sign else points[::-1])
        return outlines


def _project(solid: manifold3d.Manifold, frame: Float[np.ndarray, "3 3"]) -> manifold3d.CrossSection:
    """Return the cross section that a solid projects to along the third row of the frame."""
    return solid.transform(np.column_stack([frame, np.zeros(3)])).project()


def maximum_projection(
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    hull: ConvexHull,
    coarse: tuple[Float[np.ndarray, "w 3"], Int[np.ndarray, "g 3"]] | None = None,
) -> Silhouette:
    """Return the projection of largest area, its direction found to better than 0.1 % of the area.

    Parameters
    ----------
    vertices, faces
        The closed surface that is measured.
    hull : scipy.spatial.ConvexHull
        Its convex hull.
    coarse : tuple of vertices and faces, optional
        The mesh that the measured one halves the edges of, both inscribed in a smooth body: the search
        then runs on it, and area and perimeter are extrapolated from both (Richardson, ratio 4).
    """
    caster = SilhouetteCaster(*(coarse or (vertices, faces)))
    bounds = _hull_areas(hull)
    directions = half_sphere(_DIRECTIONS)
    order = np.argsort(-bounds, kind="stable")
    tried: list[tuple[float, np.ndarray]] = []
    best = 0.0
    filled = float(np.clip(signed_volumes(vertices, faces).sum() / hull.volume, 0.1, 1.0))
    most = min(_EXACT_OF_CONCAVE, int(_EXACT_AT_MOST / filled**2))
    for index in order:
        if bounds[index] <= best or len(tried) >= most:
            break
        direction = directions[index]
        if any(abs(direction @ other) > _APART for _, other in tried):
            continue
        area = caster.area(direction)
        tried.append((area, direction))
        best = max(best, area)
    tried.sort(key=lambda entry: -entry[0])
    # The peak of a cell 9 degrees wide lies at most 1.3 % above the value found in it.
    starts = [entry for entry in tried[:3] if entry[0] > 0.985 * best]
    ends = [_climb(caster, direction, area) for area, direction in starts]
    direction = max(ends, key=lambda entry: entry[0])[1]
    found = caster.cast(direction)
    if coarse is None:
        return found
    fine = SilhouetteCaster(vertices, faces).cast(direction)
    return Silhouette(
        (4.0 * fine.area - found.area) / 3.0, (4.0 * fine.perimeter - found.perimeter) / 3.0, found.direction
    )


def _climb(caster: SilhouetteCaster, direction: np.ndarray, area: float) -> tuple[float, np.ndarray]:
    """Climb to the nearest peak of the projected area by quadratic models on shrinking hexagons."""
    ring = np.radians(60.0 * np.arange(6))
    hexagon = np.stack([np.cos(ring), np.sin(ring)], axis=1)
    step = np.radians(5.0)
    for _ in range(6):
        frame = frame_along(direction)
        offsets = hexagon * np.tan(step)
        trials = direction + offsets @ frame[:2]
        areas = np.array([caster.area(trial) for trial in trials])
        vertex = _peak_of_quadratic(offsets, areas - area)
        limit = 2.0 * np.tan(step)
        vertex *= min(1.0, limit / max(float(np.linalg.norm(vertex)), 1e-300))
        candidates = [*trials, direction + vertex @ frame[:2]]
        values = [*areas, caster.area(candidates[-1])]
        winner = int(np.argmax(values))
        gain = values[winner] - area
        if gain > 0:
            area, direction = values[winner], candidates[winner] / np.linalg.norm(candidates[winner])
        if gain < 1e-4 * area and step < np.radians(2.0):
            break
        step *= 0.5 if winner < 6 and gain > 0 else 0.35
    return area, direction


def _peak_of_quadratic(
    offsets: Float[np.ndarray, "6 2"], rises: Float[np.ndarray, " 6"]
) -> Float[np.ndarray, " 2"]:
    """Return where the quadratic with value 0 at 0 and `rises` at the offsets peaks; 0 if it does not."""
    u, v = offsets.T
    terms = np.stack([u, v, 0.5 * u * u, u * v, 0.5 * v * v], axis=1)
    gu, gv, huu, huv, hvv = np.linalg.lstsq(terms, rises, rcond=None)[0]
    determinant = huu * hvv - huv * huv
    if huu >= 0 or determinant <= 0:
        return np.zeros(2)
    peak: np.ndarray = np.array([huv * gv - hvv * gu, huv * gu - huu * gv]) / determinant
    return peak


def _hull_areas(hull: ConvexHull) -> Float[np.ndarray, " d"]:
    """Projected areas of the convex hull over all directions: half the sum of |a . n|."""
    triangles = hull.points[hull.simplices]
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    areas = np.zeros(len(half_sphere(_DIRECTIONS)))
    for part in np.array_split(normals, max(1, len(normals) // 4000)):
        heights = half_sphere(_DIRECTIONS).astype(np.float32) @ part.T.astype(np.float32)
        areas += 0.25 * np.abs(heights, out=heights).sum(axis=1)
    return areas * (1 + 1e-5)
