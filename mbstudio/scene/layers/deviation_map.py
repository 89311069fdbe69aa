"""The deviation of an avatar from its grain as colours on its surface, with their scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pyvista as pv

from mbstudio.core.grains.grain import Grain
from mbstudio.core.imaging.goals.deviation import Deviation, deviation
from mbstudio.core.meshes.edges import weld_equal
from mbstudio.core.metrics.surface_distance import VerticesFaces
from mbstudio.core.translation import mark
from mbstudio.scene.layers.colour_scale import ColourScale, diverging_colours, readable_unit, round_range
from mbstudio.scene.layers.layer import Layer, Stage
from mbstudio.scene.layers.surface_layer import add_surface
from mbstudio.scene.surfaces import Surface, avatar_surface
from mbstudio.scene.theme import SceneTheme

if TYPE_CHECKING:
    import trimesh

    from mbstudio.core.metaball import Avatar

_SHOWN = 99.5  # percentile of the distances that the colours reach to
_EDGES = 40  # of the triangles of a mesh along its longest side, at least


@dataclass(frozen=True, eq=False)
class DeviationSurface:
    """An avatar's surface and how far each of its points lies from the grain."""

    surface: Surface
    deviation: Deviation


def deviation_surface(avatar: Avatar, grain: Grain | trimesh.Trimesh, cells: int = 72) -> DeviationSurface:
    """Return the avatar's surface with its distances to the grain's; may run in a worker thread.

    Parameters
    ----------
    avatar : Avatar
        In the grain's frame and unit.
    grain : Grain or trimesh.Trimesh
    cells : int
        Along the avatar's longest side.
    """
    surface = avatar_surface(avatar, cells)
    if isinstance(grain, Grain):
        mesh = grain.surface_mesh()
        reference = np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces)
    else:
        reference = _in_small_triangles(grain)
    return DeviationSurface(surface, deviation((surface.points, surface.triangles), reference, avatar.unit))


def _in_small_triangles(mesh: trimesh.Trimesh) -> VerticesFaces:
    """Return the same surface in triangles small against the body, as distances to it are asked of."""
    from trimesh.remesh import subdivide_to_size

    longest = float(np.ptp(np.asarray(mesh.bounds), axis=0).max()) / _EDGES
    points, faces = subdivide_to_size(np.asarray(mesh.vertices), np.asarray(mesh.faces), longest, max_iter=30)
    return weld_equal(np.asarray(points, dtype=float), np.asarray(faces))


class DeviationMap(Layer[DeviationSurface]):
    """How far the avatar lies from its grain, as colours on its surface.

    Attributes
    ----------
    scale : ColourScale
    reach : float
        Distance at the ends of the scale.
    """

    title = mark("Deviation")
    icon = "ph.thermometer"
    tip = mark("Distance of the avatar's surface from the grain's, as colours")
    is_within_scan = True
    shows_one_grain = True

    def __init__(self, name: str, stage: Stage) -> None:
        super().__init__(name, stage)
        self.scale = ColourScale(stage.renderer, stage.theme)
        self.reach = 0.0
        self._actor: pv.Actor | None = None

    @property
    def actors(self) -> Sequence[Any]:
        return [] if self._actor is None else [self._actor]

    def set(self, content: DeviationSurface | None, unit: str | None = None) -> None:
        """Show an avatar's surface with its distances (:func:`deviation_surface`), or nothing.

        The colours reach to where 99.5 % of the distances lie, rounded up: one spike would bleach all else.
        """
        if self._actor is not None:
            self.stage.remove(self._actor)
            self._actor = None
        if content is not None:
            found = content.deviation
            self.stage.set_unit(found.unit)
            self.reach = round_range(float(np.percentile(np.abs(found.distances), _SHOWN)))
            self._actor = self._add(content)
            self._explain(found)
        self.stage.update()

    def refresh(self) -> None:
        super().refresh()
        self.scale.set_visible(self.holds_something and self.is_visible)

    def recolour(self, theme: SceneTheme) -> None:
        self.scale.recolour(theme)

    def set_pixel_ratio(self, ratio: float) -> None:
        self.scale.pixel_ratio = ratio

    def close(self) -> None:
        super().close()
        self.scale.remove()

    def _add(self, shown: DeviationSurface) -> pv.Actor:
        mesh = shown.surface.poly_data()
        mesh.point_data["deviation"] = shown.deviation.distances.astype(np.float32)
        colours = np.column_stack([diverging_colours(255), np.full(255, 255, np.uint8)])
        table = pv.LookupTable(values=colours, scalar_range=(-self.reach, self.reach))
        actor = add_surface(
            self.stage, self.name, mesh, scalars="deviation", cmap=table, specular=0.0, specular_power=1.0,
            ambient=0.25, diffuse=0.8,
        )  # fmt: skip
        actor.mapper.interpolate_before_map = True
        actor.prop.opacity = self.opacity
        return actor

    def _explain(self, found: Deviation) -> None:
        """Tell what the colours mean."""
        factor, label = readable_unit(self.reach, found.unit)
        sign = "+" if found.largest >= 0 else "\N{MINUS SIGN}"
        self.scale.show(
            "Deviation",
            self.reach,
            found.unit,
            f"rms {found.rms * factor:.3g} {label}\nlargest {sign}{abs(found.largest) * factor:.3g} {label}",
        )
