"""Keeps station Export in step: one avatar of the export in the view with its numbers, and the specimen."""

from __future__ import annotations

from PySide6.QtCore import QObject, QTimer
from PySide6.QtWidgets import QFileDialog

from mbstudio.core.dem.preview import ExportPreview
from mbstudio.core.errors import ExportError
from mbstudio.core.populations.sieving import SizeDistribution
from mbstudio.core.units import conversion_factor, unit_label
from mbstudio.scene.export_preview import PreviewSurfaces
from mbstudio.ui.language import tr
from mbstudio.ui.stations.export.display import ExportDisplay
from mbstudio.ui.stations.export.panel import ExportPanel
from mbstudio.ui.stations.export.preview_work import PreviewWork, SpecimenSketch
from mbstudio.ui.stations.station import Station
from mbstudio.ui.studio import Studio
from mbstudio.ui.view.scene_view import SceneView
from mbstudio.ui.widgets.numbers import readable_power_unit

_PAUSE = 200  # milliseconds without another change before anything is made


class ExportLink(QObject):
    """What is to be seen at station Export.

    Parameters
    ----------
    station : Station
    studio : Studio
    view : SceneView
    display : ExportDisplay
    panel : ExportPanel
    """

    def __init__(
        self, station: Station, studio: Studio, view: SceneView, display: ExportDisplay, panel: ExportPanel
    ) -> None:
        super().__init__(studio)
        self._station, self._studio, self._view = station, studio, view
        self._display, self._panel = display, panel
        self._card, self._form = self._panel.preview, self._panel.specimen
        self.work = PreviewWork(studio.queue, self)
        self._place = 0
        self._shown: tuple[object, ...] | None = None
        self._sketched: tuple[object, ...] | None = None
        self._edges = False
        self._pause = QTimer(self)
        self._pause.setSingleShot(True)
        self._pause.setInterval(_PAUSE)
        self._pause.timeout.connect(self.update)
        self._panel.shape_changed.connect(self._wait)
        self._form.changed.connect(self._wait)
        self._form.sizes_asked.connect(self._ask_curve)
        self._card.switched.connect(lambda _: self.update())
        self._card.step_asked.connect(self.step)
        studio.workspace.selection_changed.connect(self._follow_selection)
        panel.folder_asked.connect(self.ask_folder)
        self.work.made.connect(self._show)
        self.work.refused.connect(self._refuse)
        self.work.specimen_made.connect(self._show_specimen)
        self.work.specimen_refused.connect(self._form.refuse)
        self.work.curve_made.connect(self._take_curve)
        self.work.progressed.connect(self._tell)
        studio.theme.changed.connect(self._repaint)

    @property
    def is_waiting(self) -> bool:
        """Whether a change waits for the ones that may follow it."""
        return self._pause.isActive()

    def entered(self) -> None:
        """Look at what would be exported as things stand."""
        self._follow_selection()
        self.update()

    def left(self) -> None:
        """Make nothing any more; the scene gets the unit of the grains back."""
        self._pause.stop()
        self.work.drop("preview")
        self.work.drop("specimen")
        self._forget()
        self._view.take_unit()

    def ask_folder(self) -> None:
        """Let the person choose where DEM files go."""
        name = QFileDialog.getExistingDirectory(
            self._studio.host, tr("Folder for the DEM files"), self._studio.path_for()
        )
        if name:
            self._panel.folder.setText(name)

    def step(self, by: int) -> None:
        """Look at the next avatar of the export, or the one before."""
        named = self._panel.chosen().named
        if named:
            self._place = (self._place + by) % len(named)
            self.update()

    def _repaint(self) -> None:
        self._view.scene.layers.shape.set_edges(self._edges)

    # ---- what is looked at -----------------------------------------------------------------------

    def _wait(self) -> None:
        if self._station.is_open:
            self._pause.start()

    def _follow_selection(self) -> None:
        """Look at the grain that is chosen, where its avatar is exported."""
        label = self._studio.workspace.selected
        labels = self._panel.labels()
        if self._station.is_open and label in labels:
            self._place = labels.index(label)
            self._wait()

    def update(self) -> None:
        """Bring preview and specimen up to date."""
        if not self._station.is_open:
            return
        named = self._panel.chosen().named
        self._update_preview(named)
        self._update_specimen(named)

    def _update_preview(self, named: tuple) -> None:
        self._place = min(self._place, max(0, len(named) - 1))
        self._card.setVisible(bool(named))
        if not named or not self._card.switch.isChecked():
            self.work.drop("preview")
            self._card.clear()
            self._card.say("")
            self._card.show_name("", 0)
            self._forget()
            return
        name, avatar = named[self._place]
        target, options = self._panel.target_name, self._panel.options.values
        wanted = (avatar, target, tuple(sorted(options.items())))
        self._card.show_name(name, len(named))
        if wanted != self._shown:
            self._shown = wanted
            self._card.say(tr("Being made …"))
            self.work.show((name, avatar), target, options)

    def _forget(self) -> None:
        self._shown = None
        if self._display.preview is not None:
            self._display.preview = None
            self._view.scene.layers.shape.set(None)
            self._view.scene.layers.envelope.set(None)
            self._view.arrange()
            self._studio.commands.refresh()

    def _show(self, preview: ExportPreview, surfaces: PreviewSurfaces) -> None:
        if not self._station.is_open:
            return
        self._card.show_preview(preview)
        layers = self._view.scene.layers
        layers.shape.set(surfaces.shape, surfaces.unit)
        layers.envelope.set(surfaces.envelope)
        self._edges, self._display.has_envelope = surfaces.edges, surfaces.envelope is not None
        layers.shape.set_edges(surfaces.edges)
        self._display.preview = preview.body.name
        self._view.arrange()
        self._studio.commands.refresh()

    def _refuse(self, words: str) -> None:
        self._card.clear()
        shown = self._shown
        self._forget()
        self._shown = shown
        self._card.say(words)

    def _tell(self, what: str, words: str) -> None:
        if words and what == "preview":
            self._card.say(f"{words} …")
        elif words and self._form.is_wanted:
            self._form.summary.setText(f"{words} …")
            self._form.summary.show()

    # ---- the specimen ------------------------------------------------------------------------------

    def _update_specimen(self, named: tuple) -> None:
        try:
            plan = self._form.plan()
        except ExportError as error:
            self.work.drop("specimen")
            self._sketched = None
            self._form.refuse(str(error))
            return
        self._form.refuse("")
        if plan is None or not named:
            self.work.drop("specimen")
            self._sketched = None
            if plan is not None:
                self._form.show_result(plan.curve, None, "")
            return
        wanted = (
            tuple(avatar for _, avatar in named), plan.count, plan.seed, plan.width, plan.curve.unit,
            tuple(plan.curve.sizes), tuple(plan.curve.finer),
        )  # fmt: skip
        if wanted != self._sketched:
            self._sketched = wanted
            self._form.show_result(plan.curve, None, tr("Being made …"))
            self.work.sketch(named, plan)

    def _show_specimen(self, sketch: SpecimenSketch) -> None:
        specimen, plan = sketch.specimen, sketch.plan
        found = specimen.curve()
        unit = readable_power_unit(2 * specimen.half, specimen.unit, 1)
        f, name = conversion_factor(specimen.unit, unit), unit_label(unit)
        grain = plan.curve.unit
        sizes = conversion_factor(found.unit, grain)
        words = [
            tr(
                "D10 {d10:.3g}, D50 {d50:.3g}, D60 {d60:.3g} {grain_unit}; "
                "box {width:.4g} × {width:.4g} × {height:.4g} {box_unit}.",
                d10=found.d10 * sizes,
                d50=found.d50 * sizes,
                d60=found.d60 * sizes,
                grain_unit=unit_label(grain),
                width=2 * specimen.half * f,
                height=specimen.top * f,
                box_unit=name,
            )
        ]
        if sketch.kinds < sketch.of:
            words.append(
                tr(
                    "Drawn with {measured} of the {count} avatars; the export uses all of them.",
                    measured=sketch.kinds,
                    count=sketch.of,
                )
            )
        self._form.show_result(plan.curve, found, " ".join(words))

    def _ask_curve(self) -> None:
        named = self._panel.chosen().named
        if named:
            self.work.find_curve(named)

    def _take_curve(self, curve: SizeDistribution) -> None:
        unit = readable_power_unit(float(curve.sizes[-1]), curve.unit, 1)
        f = conversion_factor(curve.unit, unit)
        self._form.set_points([float(f"{size * f:.4g}") for size in curve.sizes], list(curve.finer), unit)
