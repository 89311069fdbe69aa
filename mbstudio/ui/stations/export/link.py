"""Keeps station Export in step: one avatar of the export in the view with its numbers, and the specimen."""

from __future__ import annotations

from typing import TYPE_CHECKING

from PySide6.QtCore import QObject, QTimer

from mbstudio.core.dem.preview import ExportPreview
from mbstudio.core.errors import ExportError
from mbstudio.core.populations.sieving import SizeDistribution
from mbstudio.core.units import conversion_factor, unit_label
from mbstudio.scene.export_preview import PreviewSurfaces
from mbstudio.ui.language import tr
from mbstudio.ui.soon import Soon
from mbstudio.ui.stations.export.preview_work import PreviewWork, SpecimenSketch
from mbstudio.ui.stations.station_layers import STATION_LAYERS
from mbstudio.ui.widgets.numbers import readable_power_unit

if TYPE_CHECKING:
    from mbstudio.ui.shell.main_window import MainWindow

_PAUSE = 200  # milliseconds without another change before anything is made


class ExportLink(QObject):
    """What is to be seen at station Export.

    Parameters
    ----------
    window : MainWindow
    """

    def __init__(self, window: MainWindow) -> None:
        super().__init__(window)
        self._window, self._panel, self._view = window, window.panels_export, window.link
        self._card, self._form = self._panel.preview, self._panel.specimen
        self.work = PreviewWork(window.queue, self)
        self._soon = Soon(self)
        self._place = 0
        self._shown: tuple[object, ...] | None = None
        self._sketched: tuple[object, ...] | None = None
        self._edges = self._has_envelope = False
        self._pause = QTimer(self)
        self._pause.setSingleShot(True)
        self._pause.setInterval(_PAUSE)
        self._pause.timeout.connect(self.update)
        self._panel.shape_changed.connect(self._wait)
        self._form.changed.connect(self._wait)
        self._form.sizes_asked.connect(self._ask_curve)
        self._card.switched.connect(lambda _: self.update())
        self._card.step_asked.connect(self.step)
        window.workspace.selection_changed.connect(self._follow_selection)
        window.gallery.kept.currentRowChanged.connect(lambda _: self._follow_kept())
        self.work.made.connect(self._show)
        self.work.refused.connect(self._refuse)
        self.work.specimen_made.connect(self._show_specimen)
        self.work.specimen_refused.connect(self._form.refuse)
        self.work.curve_made.connect(self._take_curve)
        self.work.progressed.connect(self._tell)
        window.theme.changed.connect(self._repaint)

    @property
    def is_waiting(self) -> bool:
        """Whether a change waits for the ones that may follow it."""
        return self._pause.isActive()

    def entered(self) -> None:
        """Look at what would be exported as things stand."""
        self._follow_kept()
        self._follow_selection()
        self.update()
        # The window offers the station's layers first.
        self._soon.call(self._offer_layers)

    def left(self) -> None:
        """Make nothing any more; the scene gets the unit of the grains back."""
        self._pause.stop()
        self.work.drop("preview")
        self.work.drop("specimen")
        self._forget()
        grains, scan = self._window.workspace.state.grains, self._window.workspace.scan
        if grains is not None or scan is not None:
            self._view.scene.set_unit(grains.unit if grains is not None else scan.unit)  # type: ignore[union-attr]

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
        if self._window.station == "export":
            self._pause.start()

    def _follow_selection(self) -> None:
        """Look at the grain that is chosen, where its avatar is exported."""
        label = self._window.workspace.selected
        labels = self._panel.labels()
        if self._window.station == "export" and label in labels:
            self._place = labels.index(label)
            self._wait()

    def _follow_kept(self) -> None:
        self._panel.choose_kept(self._window.gallery.kept.chosen)

    def update(self) -> None:
        """Bring preview and specimen up to date."""
        if self._window.station != "export":
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
        if self._view.preview is not None:
            self._view.preview = None
            self._view.scene.layers.shape.set(None)
            self._view.scene.layers.envelope.set(None)
            self._view.arrange()
            self._offer_layers()

    def _show(self, preview: ExportPreview, surfaces: PreviewSurfaces) -> None:
        if self._window.station != "export":
            return
        self._card.show_preview(preview)
        layers = self._view.scene.layers
        layers.shape.set(surfaces.shape, surfaces.unit)
        layers.envelope.set(surfaces.envelope)
        self._edges, self._has_envelope = surfaces.edges, surfaces.envelope is not None
        layers.shape.set_edges(surfaces.edges)
        self._view.preview = preview.body.name
        self._view.arrange()
        self._offer_layers()

    def _offer_layers(self) -> None:
        """Offer to switch what there is to be seen: the preview's layers, or the avatars in place of it."""
        if self._window.station != "export":
            return
        previewing = self._view.preview is not None
        for layer in STATION_LAYERS["export"]:
            if layer == "envelope":
                offered = previewing and self._has_envelope
            else:
                offered = previewing == (layer == "shape")
            self._window.commands.action(f"layer.{layer}").setVisible(offered)

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
                    "Drawn with {measured} of the {count} avatars; the export takes all.",
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
