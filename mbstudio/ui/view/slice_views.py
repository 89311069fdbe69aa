"""Keeps flat slices, those in the 3-D view and the sliders in step; tells what lies under the mouse."""

from __future__ import annotations

import numpy as np
from PySide6.QtCore import QEvent, QObject, QPoint
from PySide6.QtWidgets import QLabel

from mbstudio.scene.layers.annotations import readable_length
from mbstudio.scene.layers.picking import sight
from mbstudio.scene.layers.slices import AXES, Axis, sample_of_voxels
from mbstudio.scene.section_lines import section_lines
from mbstudio.scene.tools.slice_grip import SliceGrip
from mbstudio.ui.language import tr
from mbstudio.ui.studio import Studio
from mbstudio.ui.view.grain_focus import ROOM, GrainFocus
from mbstudio.ui.view.pane_box import Ends
from mbstudio.ui.view.scene_view import SceneView
from mbstudio.ui.view.slice_dock import PLANES, SliceDock, axes_of
from mbstudio.ui.view.slice_look import SliceLook
from mbstudio.ui.view.view_grid import ViewGrid
from mbstudio.ui.widgets.dock_frame import DockFrame

_MARK_DEPTH = 2  # slices to both sides in which a mark is seen
ROOMY = 1080  # pixels: wide enough for panel, view and panes


class SliceViews(QObject):
    """What the slices do.

    Parameters
    ----------
    studio : Studio
    view : SceneView
    focus : GrainFocus
        Takes clicks on grains.

    Attributes
    ----------
    panes : SliceDock
    frame : DockFrame
        That they stand in.
    grid : ViewGrid
        The middle of the window, with the 3-D view.
    look : SliceLook
        How grains and avatars are drawn over the grey values.
    wanted : bool
        Whether the person wants to see them.
    is_square : bool
        Whether they stand two by two with the 3-D view.
    is_linked : bool
        Whether they are magnified together.
    enlarged : str
        The axis of the pane that is as large as the view, "view" for the view itself, or nothing.
    readout : QLabel
        What lies under the mouse, for the status bar.
    """

    def __init__(self, studio: Studio, view: SceneView, focus: GrainFocus) -> None:
        super().__init__(studio)
        self._studio, self._view, self._focus = studio, view, focus
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
        self.is_square = studio.settings.value("slices_square", "false") == "true"
        self.is_linked = studio.settings.value("slices_linked", "true") != "false"
        self.enlarged = ""
        self.look = SliceLook(studio.settings, self)
        self.grid = ViewGrid(studio.viewport, self.panes)
        self._ends: tuple[object, tuple[float, float]] | None = None
        self.readout = QLabel()
        self.readout.setObjectName("key")
        self.grip = SliceGrip(view.scene.layers.slices, self._view.move_slice)
        studio.viewport.scaled.connect(self.grip.scale)
        studio.viewport.grips.append(self.grip)
        studio.viewport.hovered.connect(self._hovered)
        self._view.slices_changed.connect(self.refresh)
        self._view.part_changed.connect(self._show_part)
        focus.region_asked.connect(self._zoom_to)
        focus.isolation_changed.connect(lambda: self.look.set_isolated(focus.isolated))
        self._view.tinted.connect(self._show_tints)
        studio.workspace.scan_changed.connect(lambda: self.readout.clear())
        for plane, across in PLANES:
            pane, (first, second) = self._panes[across], axes_of(plane)
            pane.stepped.connect(lambda step, axis=across: self._step(axis, step))
            pane.crossed.connect(lambda c, r, a=first, b=second: self._cross(a, c, b, r))
            pane.pointed.connect(lambda c, r, a=first, b=second, own=across: self._pointed({a: c, b: r}, own))
            pane.left.connect(self.readout.clear)
            pane.windowed.connect(self._widen)
            pane.picked.connect(lambda c, r, a=first, b=second, own=across: self._pick({a: c, b: r}, own))
            pane.menu_asked.connect(
                lambda c, r, place, a=first, b=second, own=across: self._open_menu({a: c, b: r}, own, place)
            )
            pane.stroked.connect(
                lambda c, r, begun, a=first, b=second, own=across: self._stroke({a: c, b: r}, own, begun)
            )
            pane.stroke_ended.connect(self._end_stroke)
            pane.boxed.connect(lambda ends, a=first, b=second: self._box_dragged(a, b, ends))
            pane.zoomed.connect(lambda own=across: self._zoomed(own))
            pane.enlarged.connect(lambda own=across: self.enlarge(own))
            pane.freed.connect(lambda: self.enlarge(""))
        if self.frame.close_button is not None:
            self.frame.close_button.clicked.connect(lambda: self.show(False))
        self.panes.bar.fill_changed.connect(self.look.set_opacity)
        self.panes.bar.window_changed.connect(view.set_window)
        self.look.changed.connect(self._look_changed)
        view.fitted.connect(self._show_all)
        view.arranged.connect(self._follow_view)
        view.avatar_moved.connect(self._outline_avatar)
        studio.workspace.selection_changed.connect(self._look_changed)
        studio.viewport.canvas.installEventFilter(self)
        studio.host.installEventFilter(self)
        self.refresh()

    @property
    def is_offered(self) -> bool:
        """Whether the panes belong to this station and have something to show."""
        return self._view.display.shows_slices and self._view.scene.layers.slices.holds_something

    @property
    def is_shown(self) -> bool:
        """Whether the panes stand in their dock: they are wanted there, and leave room for the view."""
        roomy = self._studio.host.width() >= ROOMY
        return self.wanted and self.is_offered and roomy and not self.is_square

    @property
    def shows_grains(self) -> bool:
        """Whether there are grains in the slices."""
        planes = self._view.scene.layers.slices.planes
        return planes is not None and planes.colours is not None

    @property
    def shows_greys(self) -> bool:
        """Whether the slices show a scan, and not voxels of grains alone."""
        return self._studio.workspace.scan is not None and not self._studio.workspace.slices_voxels

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if watched is self._studio.viewport.canvas:
            doubled = event.type() == QEvent.Type.MouseButtonDblClick
            if doubled and self.is_offered and (self.is_square or self.enlarged):
                self.enlarge("view")
        elif event.type() == QEvent.Type.Resize and self.frame.isHidden() == self.is_shown:
            self._studio.arrange_docks()
        return super().eventFilter(watched, event)

    # ---- layout ----------------------------------------------------------------------------------

    def set_square(self, wanted: bool) -> None:
        """Let the slices stand two by two with the 3-D view, or in their dock; also at the next start."""
        self.is_square, self.enlarged = wanted, ""
        self._studio.settings.setValue("slices_square", "true" if wanted else "false")
        if wanted and not self.wanted:
            self.wanted = True
            self._studio.settings.setValue("slice_views", "true")
        self._arrange()

    def enlarge(self, which: str) -> None:
        """Make a pane (by its axis) or the view as large as it can be; the same again makes it small."""
        if not which and not self.enlarged:
            return
        self.enlarged = "" if which == self.enlarged else which
        self._arrange()
        for axis, pane in self._panes.items():
            if axis == self.enlarged:
                pane.setFocus()

    def enlarge_next(self) -> None:
        """Enlarge the pane that has the focus; if one is enlarged, the next, and after the last none."""
        order = [across for _, across in PLANES]
        focused = next((axis for axis, pane in self._panes.items() if pane.hasFocus()), order[0])
        if not self.enlarged:
            self.enlarge(focused)
        elif self.enlarged in order[:-1]:
            self.enlarge(order[order.index(self.enlarged) + 1])
        else:
            self.enlarge("")

    def _arrange(self) -> None:
        self._place_panes()
        self._studio.arrange_docks()
        self._studio.refresh()
        self._view.draw()

    def _place_panes(self) -> None:
        offered = self.is_offered
        self.grid.arrange(self.is_square and offered, self.enlarged if offered else "")

    def _follow_view(self) -> None:
        """Keep in step with the station that is open."""
        self._place_panes()
        self._outline_avatar()

    def show(self, shown: bool) -> None:
        """Show or hide the panes, now and at the next start."""
        self.wanted = shown
        self._studio.settings.setValue("slice_views", "true" if shown else "false")
        self._studio.arrange_docks()
        self._studio.refresh()

    def refresh(self) -> None:
        """Show the slices as they are."""
        slices, scan = self._view.scene.layers.slices.planes, self._studio.workspace.sliced
        if slices is not None:
            slices.set_look(self.look.label_look(self._studio.workspace.chosen))
        for plane, across in PLANES:
            pane = self._panes[across]
            if slices is None or scan is None:
                pane.show_slice(None)
                pane.set_labels(None)
                continue
            first, second = axes_of(plane)
            index, spacing = slices.index[across], slices.spacing
            position = scan.origin[AXES.index(across)] + index * spacing(across)
            pane.show_slice(
                slices.greys[across],
                (spacing(first), spacing(second)),
                f"{across} = {readable_length(position, scan.unit) if position else '0'}",
            )
            pane.set_cross(slices.index[first], slices.index[second])
            pane.set_labels(slices.labels[across], slices.colours, slices.look)
            pane.is_taken = self._view.slice_tool is not None
            pane.set_brush(self._view.brush)
            places = [dict(zip("zyx", mark, strict=True)) for mark in self._view.marks]
            pane.set_marks([(p[first], p[second]) for p in places if abs(p[across] - index) <= _MARK_DEPTH])
        self._show_part()
        self._show_bar()
        self._outline_avatar()
        self._show_tints()

    def _show_bar(self) -> None:
        """Show fill and grey window in the bar."""
        slices = self._view.scene.layers.slices.planes
        self.panes.bar.show_fill(self.look.opacity, self.shows_grains)
        if slices is not None:
            self.panes.bar.show_window(*slices.window, self._grey_ends())

    def _grey_ends(self) -> tuple[float, float] | None:
        """Return the least and the greatest grey value, or None where there are none."""
        scan = self._studio.workspace.scan
        if scan is None or not self.shows_greys:
            return None
        if self._ends is None or self._ends[0] is not scan:
            sample = sample_of_voxels(scan)
            low, high = (float(sample.min()), float(sample.max())) if sample.size else (0.0, 1.0)
            self._ends = (scan, (low, high if high > low else low + 1.0))
        return self._ends[1]

    def use_auto_window(self) -> None:
        """Show the grey values black and white between which nearly all of them lie."""
        slices = self._view.scene.layers.slices.planes
        if slices is not None:
            self._view.set_window(*slices.auto_window)

    def _look_changed(self) -> None:
        slices = self._view.scene.layers.slices.planes
        if slices is not None:
            before = slices.look
            slices.set_look(self.look.label_look(self._studio.workspace.chosen))
            if slices.look != before:
                for _, across in PLANES:
                    self._panes[across].set_labels(slices.labels[across], slices.colours, slices.look)
                self._view.draw()
        self._show_bar()
        self._outline_avatar()
        self._studio.commands.outdate()

    def _outline_avatar(self, *_: object) -> None:
        """Draw where the slices cut the avatar of the grain that is looked at."""
        slices, scan = self._view.scene.layers.slices.planes, self._studio.workspace.sliced
        surface = self._view.scene.layers.avatar.content if self.look.avatar else None
        for plane, across in PLANES:
            pane, axes = self._panes[across], [AXES.index(axis) for axis in axes_of(plane)]
            if slices is None or scan is None or surface is None or not self.is_offered:
                pane.set_outlines(())
                continue
            number = AXES.index(across)
            origin, edges = np.array(scan.origin), np.array(scan.voxel_size.xyz)
            place = origin[number] + slices.index[across] * edges[number]
            voxels = (section_lines(surface, number, float(place)) - origin) / edges
            pane.set_outlines([(voxels[..., axes], self._studio.theme.scene.avatar)])

    def _show_tints(self) -> None:
        """Lay over the slices what previews and strokes show."""
        planes = self._view.scene.layers.slices.planes
        for _, across in PLANES:
            tint = self._view.tints.get(across)
            if planes is None or tint is None or tint.shape[:2] != planes.greys[across].shape:
                tint = None  # of another scan
            self._panes[across].set_tint(tint)

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

    def set_linked(self, wanted: bool) -> None:
        """Magnify all slices together, or each by itself; also at the next start."""
        self.is_linked = wanted
        self._studio.settings.setValue("slices_linked", "true" if wanted else "false")
        self._studio.refresh()

    def _zoomed(self, across: Axis) -> None:
        """Let the other panes follow one that shows another part of its slice."""
        slices, pane = self._view.scene.layers.slices.planes, self._panes[across]
        if slices is None or not self.is_linked:
            return
        middle: dict[Axis, float] = {axis: float(index) for axis, index in slices.index.items()}
        planes = {own: plane for plane, own in PLANES}
        middle |= dict(zip(axes_of(planes[across]), pane.middle, strict=True))
        for plane, other in PLANES:
            if other != across and pane.is_magnified:
                first, second = axes_of(plane)
                self._panes[other].zoom_to(pane.scale, middle[first], middle[second])
            elif other != across:
                self._panes[other].show_all()

    def _show_all(self) -> None:
        for pane in self._panes.values():
            pane.show_all()

    # ---- a tool that takes the left button -------------------------------------------------------

    def _stroke(self, places: dict[Axis, float], across: Axis, begun: bool) -> None:
        slices, tool = self._view.scene.layers.slices.planes, self._view.slice_tool
        if slices is not None and tool is not None:
            voxel = {axis: round(place) for axis, place in places.items()} | {across: slices.index[across]}
            tool.stroke((voxel["z"], voxel["y"], voxel["x"]), "zyx".index(across), begun)

    def _label_at(self, places: dict[Axis, float], across: Axis) -> int | None:
        slices = self._view.scene.layers.slices.planes
        if slices is None:
            return None
        voxel = {axis: round(place) for axis, place in places.items()} | {across: slices.index[across]}
        return self._focus.label_at((voxel["z"], voxel["y"], voxel["x"]))

    def _pick(self, places: dict[Axis, float], across: Axis) -> None:
        """Choose the grain that was clicked; a click in the void moves the lines alone."""
        label = self._label_at(places, across)
        if label is not None:
            self._focus.take(label)

    def _open_menu(self, places: dict[Axis, float], across: Axis, place: QPoint) -> None:
        self._studio.grain_menu.open(self._label_at(places, across), place)

    def _zoom_to(self, region: dict[Axis, tuple[int, int]]) -> None:
        """Show a part of the scan large in all panes, at one scale."""
        slices = self._view.scene.layers.slices.planes
        if slices is None:
            return
        size = {axis: ROOM * (high - low) * slices.spacing(axis) for axis, (low, high) in region.items()}
        sides = [(self._panes[own], *axes_of(plane)) for plane, own in PLANES]
        scale = min(min(p.width() / size[a], p.height() / size[b]) for p, a, b in sides)
        for pane, first, second in sides:
            column, row = (0.5 * (sum(region[axis]) - 1) for axis in (first, second))
            pane.zoom_to(scale, column, row)

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
        words = [*places, tr("voxel {x}, {y}, {z}", x=x, y=y, z=z)]
        if not self._studio.workspace.slices_voxels:
            words.append(tr("grey {value:.6g}", value=scan.voxels[z, y, x]))
        if grains is not None and grains.label_volume.shape == scan.shape:
            label = int(grains.label_volume[z, y, x])
            words.append(tr("grain {label}", label=label) if label else tr("no grain"))
            if label and grains.is_of_meshes:
                words.append(grains.name_of(label))
        self.readout.setText("   ".join(words))
