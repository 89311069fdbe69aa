"""The deviation of an avatar from its grain as colours on its surface, with their scale."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pyvista as pv

from mbstudio.core.imaging.goals.deviation import Deviation, deviation
from mbstudio.scene.layers.colour_scale import ColourScale, diverging_colours, readable_unit, round_range
from mbstudio.scene.surfaces import Surface, avatar_surface

if TYPE_CHECKING:
    from mbstudio.core.grains import Grain
    from mbstudio.core.metaball import Avatar

_SHOWN = 99.5  # percentile of the distances that the colours reach to


@dataclass(frozen=True, eq=False)
class DeviationSurface:
    """An avatar's surface and how far each of its points lies from the grain."""

    surface: Surface
    deviation: Deviation


def deviation_surface(avatar: Avatar, grain: Grain, cells: int = 72) -> DeviationSurface:
    """Return the avatar's surface with its distances to the grain's; may run in a worker thread.

    Parameters
    ----------
    avatar : Avatar
        In the grain's frame and unit.
    grain : Grain
    cells : int
        Along the avatar's longest side.
    """
    surface, mesh = avatar_surface(avatar, cells), grain.surface_mesh()
    reference = np.asarray(mesh.vertices, dtype=float), np.asarray(mesh.faces)
    return DeviationSurface(surface, deviation((surface.points, surface.triangles), reference, grain.unit))


class DeviationMap:
    """The coloured surface on a plotter.

    Parameters
    ----------
    plotter : pyvista.BasePlotter
    ink : str
        Colour of the scale's text.
    """

    def __init__(self, plotter: Any, ink: str) -> None:
        self._plotter = plotter
        self.scale = ColourScale(plotter.renderer, ink)
        self.reach = 0.0

    def add(self, shown: DeviationSurface) -> pv.Actor:
        """Put the surface into the plotter and tell what its colours mean.

        The colours reach to where 99.5 % of the distances lie, rounded up: one spike would bleach all else.
        """
        found = shown.deviation
        self.reach = round_range(float(np.percentile(np.abs(found.distances), _SHOWN)))
        mesh = shown.surface.poly_data()
        mesh.point_data["deviation"] = found.distances.astype(np.float32)
        colours = np.column_stack([diverging_colours(255), np.full(255, 255, np.uint8)])
        table = pv.LookupTable(values=colours, scalar_range=(-self.reach, self.reach))
        actor = self._plotter.add_mesh(
            mesh, scalars="deviation", cmap=table, smooth_shading=False, specular=0.0, ambient=0.25,
            diffuse=0.8, name="deviation", reset_camera=False, render=False, show_scalar_bar=False,
        )  # fmt: skip
        actor.mapper.interpolate_before_map = True
        actor.prop.interpolation = "Phong"
        actor.prop.culling = "back"
        factor, label = readable_unit(self.reach, found.unit)
        sign = "+" if found.largest >= 0 else "\N{MINUS SIGN}"
        self.scale.show(
            "Deviation",
            self.reach,
            found.unit,
            f"rms {found.rms * factor:.3g} {label}\nlargest {sign}{abs(found.largest) * factor:.3g} {label}",
        )
        return actor
