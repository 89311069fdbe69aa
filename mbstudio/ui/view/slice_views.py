"""Keeps flat slices, those in the 3-D view and the sliders in step; tells what lies under the mouse."""

from __future__ import annotations

import numpy as np
from PySide6.QtCore import QEvent, QObject
from PySide6.QtWidgets import QLabel

from mbstudio.scene.layers.annotations import readable_length
from mbstudio.scene.layers.picking import sight
from mbstudio.scene.layers.slices import AXES, Axis
from mbstudio.scene.tools.slice_grip import SliceGrip
from mbstudio.ui.language import tr
from mbstudio.ui.studio import Studio
from mbstudio.ui.view.pane_box import Ends
from mbstudio.ui.view.scene_view import SceneView
from mbstudio.ui.view.slice_dock import PLANES, SliceDock, axes_of
from mbstudio.ui.widgets.dock_frame import DockFrame

_MARK_DEPTH = 2  # slices to both sides in which a mark is seen
ROOMY = 1080  # pixels: wide enough for panel, view and panes


class SliceViews(QObject):
    """What the slices do.

    Parameters
    ----------
    studio : Studio
    view : SceneView

    Attributes
    ----------
    panes : SliceDock
    frame : DockFrame
        That they stand in.
    wanted : bool
        Whether the person wants to see them.
    readout : QLabel
        What lies under the mouse, for the status bar.
    """

    def __init__(self, studio: Studio, view: SceneView) -> None:
        super().__init__(studio)
        self._studio, self._view = studio, view
        self.panes = SliceDock(studio.theme)
        self._panes = self.panes.panes
        self.frame = DockFrame(
            "slices",
            tr("Slices"),
            self.panes,
            "right",
            studio.icons,
            is_wanted=lambda: self.is_shown,
            first_width=lambda width: max(240, width // 5),
        )
        self.wanted = studio.settings.value("slice_views", "true") != "false"
        self.readout = QLabel()
        self.readout.setObjectName("key")
        self.grip = SliceGrip(view.scene.layers.slices, self._view.move_slice)
        studio.viewport.scaled.connect(self.grip.scale)
        studio.viewport.grips.append(self.grip)
        studio.viewport.hovered.connect(self._hovered)
        self._view.slices_changed.connect(self.refresh)
        self._view.part_changed.connect(self._show_part)
        studio.workspace.scan_changed.connect(lambda: self.readout.clear())
        for plane, across in PLANES:
            pane, (first, second) = self._panes[across], axes_of(plane)
            pane.stepped.connect(lambda step, axis=across: self._step(axis, step))
            pane.crossed.connect(lambda c, r, a=first, b=second: self._cross(a, c, b, r))
            pane.pointed.connect(lambda c, r, a=first, b=second, own=across: self._pointed({a: c, b: r}, own))
            pane.left.connect(self.readout.clear)
            pane.windowed.connect(self._widen)
            pane.stroked.connect(
                lambda c, r, begun, a=first, b=second, own=across: self._stroke({a: c, b: r}, own, begun)
            )
            pane.stroke_ended.connect(self._end_stroke)
            pane.boxed.connect(lambda ends, a=first, b=second: self._box_dragged(a, b, ends))
        if self.frame.close_button is not None:
            self.frame.close_button.clicked.connect(lambda: self.show(False))
        studio.host.installEventFilter(self)
        self.refresh()

    @property
    def is_offered(self) -> bool:
        """Whether the panes belong to this station and have something to show."""
        return self._view.display.shows_slices and self._view.scene.layers.slices.holds_something

    @property
    def is_shown(self) -> bool:
        """Whether the panes are wanted, have something to show, and leave room for the view."""
        return self.wanted and self.is_offered and self._studio.host.width() >= ROOMY

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Resize and self.frame.isHidden() == self.is_shown:
            self._studio.arrange_docks()
        return super().eventFilter(watched, event)

    def show(self, shown: bool) -> None:
        """Show or hide the panes, now and at the next start."""
        self.wanted = shown
        self._studio.settings.setValue("slice_views", "true" if shown else "false")
        self._studio.arrange_docks()
        self._studio.refresh()

    def refresh(self) -> None:
        """Show the slices as they are."""
        slices, scan = self._view.scene.layers.slices.planes, self._studio.workspace.sliced
        for plane, across in PLANES:
            pane = self._panes[across]
            if slices is None or scan is None:
                pane.show_slice(None)
                continue
            first, second = axes_of(plane)
            index, spacing = slices.index[across], slices.spacing
            position = scan.origin[AXES.index(across)] + index * spacing(across)
            pane.show_slice(
                slices.images[across],
                (spacing(first), spacing(second)),
                f"{across} = {readable_length(position, scan.unit) if position else '0'}",
            )
            pane.set_cross(slices.index[first], slices.index[second])
            pane.is_taken = self._view.slice_tool is not None
            places = [dict(zip("zyx", mark, strict=True)) for mark in self._view.marks]
            pane.set_marks([(p[first], p[second]) for p in places if abs(p[across] - index) <= _MARK_DEPTH])
        self._show_part()

    def _show_part(self) -> None:
        """Show the part of the scan that is chosen in each pane."""
        slices, part = self._view.scene.layers.slices.planes, self._view.part
        for plane, across in PLANES:
            first, second = axes_of(plane)
            if part is None or slices is None:
                self._panes[across].set_box(None)
            else:
                start, stop = part[across]
                within = start <= slices.index[across] < stop
                self._panes[across].set_box((part[first], part[second]), within)

    # ---- by hand ---------------------------------------------------------------------------------

    def _step(self, axis: Axis, step: int) -> None:
        slices = self._view.scene.layers.slices.planes
        if slices is not None:
            self._view.move_slice(axis, int(np.clip(slices.index[axis] + step, 0, slices.counts[axis] - 1)))

    def _cross(self, first: Axis, column: float, second: Axis, row: float) -> None:
        self._view.move_slice(first, round(column))
        self._view.move_slice(second, round(row))

    def _box_dragged(self, first: Axis, second: Axis, ends: Ends) -> None:
        self._view.part_dragged.emit({first: ends[0], second: ends[1]})

    def _widen(self, wider: float, brighter: float) -> None:
        slices = self._view.scene.layers.slices.planes
        if slices is not None:
            low, high = slices.window
            middle, width = (low + high) / 2 - brighter * (high - low), (high - low) * max(0.2, 1 + wider)
            self._view.set_window(middle - width / 2, middle + width / 2)

    # ---- a tool that takes the left button -------------------------------------------------------

    def _stroke(self, places: dict[Axis, float], across: Axis, begun: bool) -> None:
        slices, tool = self._view.scene.layers.slices.planes, self._view.slice_tool
        if slices is not None and tool is not None:
            voxel = {axis: round(place) for axis, place in places.items()} | {across: slices.index[across]}
            tool.stroke((voxel["z"], voxel["y"], voxel["x"]), "zyx".index(across), begun)

    def _end_stroke(self) -> None:
        if self._view.slice_tool is not None:
            self._view.slice_tool.end_stroke()

    # ---- what lies under the mouse ---------------------------------------------------------------

    def _pointed(self, places: dict[Axis, float], across: Axis) -> None:
        slices = self._view.scene.layers.slices.planes
        if slices is not None:
            voxel = {axis: round(place) for axis, place in places.items()} | {across: slices.index[across]}
            self._tell((voxel["x"], voxel["y"], voxel["z"]))

    def _hovered(self, x: float, y: float) -> None:
        slices = self._view.scene.layers.slices.planes
        point = None
        if slices is not None and any(slices.is_seen(axis) for axis in AXES):
            point = slices.point_on(*sight(self._studio.viewport.plotter.renderer, x, y))
        if point is None or slices is None:
            self.readout.clear()
        else:
            self._tell(slices.voxel_at(point))

    def _tell(self, voxel: tuple[int, int, int]) -> None:
        scan, grains = self._studio.workspace.sliced, self._studio.workspace.state.grains
        if scan is None:
            return
        x, y, z = (int(np.clip(v, 0, n - 1)) for v, n in zip(voxel, scan.shape[::-1], strict=True))
        places = (
            f"{axis} {readable_length(place, scan.unit) if place else '0'}"
            for axis, place in zip(
                AXES, np.array(scan.origin) + np.array(scan.voxel_size.xyz) * (x, y, z), strict=True
            )
        )
        words = [*places]
        if not self._studio.workspace.slices_voxels:
            words.append(tr("grey {value:.6g}", value=scan.voxels[z, y, x]))
        if grains is not None and grains.label_volume.shape == scan.shape:
            label = int(grains.label_volume[z, y, x])
            words.append(tr("grain {label}", label=label) if label else tr("no grain"))
            if label and grains.is_of_meshes:
                words.append(grains.name_of(label))
        self.readout.setText("   ".join(words))
