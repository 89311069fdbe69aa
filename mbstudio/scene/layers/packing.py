"""Grains in a mould: one surface that is posed anew while they settle, coloured by grain, and cut open."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyvista as pv
from jaxtyping import Float
from vtkmodules.vtkCommonDataModel import vtkPlane

from mbstudio.core.translation import mark
from mbstudio.scene.layers.layer import Hit, Layer, Stage, sample_points
from mbstudio.scene.layers.surface_layer import add_surface, remove_plane
from mbstudio.scene.packed_grains import PackedForms, PackedGrains, mould_lines, ramp_colours
from mbstudio.scene.theme import SceneTheme

_SECTION = """//VTK::Light::Impl
  if (gl_FrontFacing == false) { gl_FragData[0] = vec4(0.82 * diffuseColor + 0.06, opacity); }
"""
"""One looks at the inside of what is cut: without light it looks like a section that is filled."""


class PackedLayer(Layer[PackedGrains]):
    """The grains of a packing and the edges of their mould (:mod:`~mbstudio.scene.packed_grains`).

    Attributes
    ----------
    content : PackedGrains or None
    cut : float
        Which share of the mould's width is cut away from the front (from -y); 0 for none.
    """

    title = mark("Packing")
    icon = "ph.package"
    tip = mark("The grains of the packing in their mould")
    starts_shown = False

    def __init__(self, name: str, stage: Stage) -> None:
        super().__init__(name, stage)
        self.content: PackedGrains | None = None
        self.cut = 0.0
        self._plane = vtkPlane()
        self._mesh: pv.PolyData | None = None
        self._forms: PackedForms | None = None
        self._grains: Any = None
        self._mould: Any = None

    @property
    def actors(self) -> Sequence[Any]:
        return [actor for actor in (self._grains, self._mould) if actor is not None]

    def set(self, content: PackedGrains | None, unit: str | None = None) -> None:
        self.stage.set_unit(unit)
        same = content is not None and content.forms is self._forms and self._mesh is not None
        before, self.content = self.content, content
        if not same:
            self._remove()
        if content is not None and same:
            assert self._mesh is not None
            assert before is not None
            # Many times a second while grains fall: triangles and actors stay.
            np.asarray(self._mesh.points)[:] = content.surface.points
            np.asarray(self._mesh.point_data["Normals"])[:] = content.surface.normals
            self._mesh.GetPointData().GetArray("Normals").Modified()
            self._mesh.GetPoints().Modified()
            self._mesh.Modified()
            if (content.mould, content.top) != (before.mould, before.top):
                self._draw_mould()
        elif content is not None:
            self._draw(content)
        self._place_cut()
        self.recolour(self.stage.theme)
        self.stage.update()

    def set_cut(self, share: float) -> None:
        """Cut a share of the mould's width away from the front, or nothing."""
        before, self.cut = self.cut, float(np.clip(share, 0.0, 0.98))
        self._place_cut()
        if (before > 0) != (self.cut > 0):
            self._open()

    def recolour(self, theme: SceneTheme) -> None:
        if self._mesh is not None and self.content is not None:
            colours = ramp_colours(self.content.values, theme.muted)
            np.asarray(self._mesh.cell_data["colour"])[:] = colours[self.content.surface.labels]
            self._mesh.GetCellData().GetArray("colour").Modified()
            self._mesh.Modified()
        if self._mould is not None:
            self._mould.prop.color = theme.ink

    def points(self) -> Float[np.ndarray, "m 3"] | None:
        if self._mesh is None or self.content is None:
            return None
        return np.concatenate(
            [sample_points(self._mesh), mould_lines(self.content.mould, self.content.top)[0]]
        )

    def pick(self, x: float, y: float) -> Hit | None:
        """Return None: grains of a packing are no grains of the scan."""
        return None

    def _draw(self, content: PackedGrains) -> None:
        self._forms = content.forms
        self._mesh = content.surface.poly_data()
        self._mesh.cell_data["colour"] = np.zeros((self._mesh.n_cells, 3), dtype=np.uint8)
        self._grains = add_surface(
            self.stage, self.name, self._mesh, scalars="colour", rgb=True, pickable=False
        )
        self._grains.prop.opacity = self.opacity
        self._open()
        self._draw_mould()

    def _draw_mould(self) -> None:
        if self._mould is not None:
            self.stage.remove(self._mould)
            self._mould = None
        if self.content is not None:
            points, lines = mould_lines(self.content.mould, self.content.top)
            cells = np.column_stack([np.full(len(lines), 2), lines]).ravel()
            self._mould = self.stage.plotter.add_mesh(
                pv.PolyData(points.astype(np.float32), lines=cells), color=self.stage.theme.ink,
                line_width=1.5, opacity=0.6, lighting=False, pickable=False, reset_camera=False, render=False,
                name=f"{self.name} mould",
            )  # fmt: skip

    def _open(self) -> None:
        """Have the plane cut, or not; the inside of an opened grain is filled flat, as a section looks."""
        if self._grains is None:
            return
        mapper = self._grains.mapper
        remove_plane(mapper, self._plane)
        shader = self._grains.GetShaderProperty()
        shader.ClearAllFragmentShaderReplacements()
        if self.cut > 0:
            mapper.AddClippingPlane(self._plane)
            shader.AddFragmentShaderReplacement("//VTK::Light::Impl", True, _SECTION, False)
        self._grains.prop.culling = "none" if self.cut > 0 else "back"

    def _place_cut(self) -> None:
        if self.content is not None:
            half = self.content.mould.half
            self._plane.SetOrigin(0.0, -half + 2 * half * self.cut, 0.0)
            self._plane.SetNormal(0.0, 1.0, 0.0)

    def _remove(self) -> None:
        for actor in self.actors:
            self.stage.remove(actor)
        self._grains = self._mould = self._mesh = self._forms = None
