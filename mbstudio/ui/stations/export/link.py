"""Keeps station Export in step: one avatar of the export in the view with its numbers, and the specimen."""

from __future__ import annotations

from PySide6.QtCore import QObject, QTimer
from PySide6.QtWidgets import QFileDialog

from mbstudio.core.dem.preview import ExportPreview
from mbstudio.core.errors import ExportError
from mbstudio.core.populations.measuring import Known
from mbstudio.core.populations.sieving import SizeDistribution
from mbstudio.core.units import conversion_factor, unit_label
from mbstudio.scene.export_preview import PreviewSurfaces
from mbstudio.ui.language import mark, plural, tr
from mbstudio.ui.stations.export.display import ExportDisplay
from mbstudio.ui.stations.export.own_sizes import kinds_of, seconds_for, unmeasured
from mbstudio.ui.stations.export.panel import ExportPanel
from mbstudio.ui.stations.export.preview_work import PreviewWork, SpecimenSketch
from mbstudio.ui.stations.export.work import ChosenAvatars
from mbstudio.ui.stations.station import Station
from mbstudio.ui.studio import Studio
from mbstudio.ui.view.scene_view import SceneView
from mbstudio.ui.widgets.numbers import readable_power_unit, readable_time

AT_ONCE = 1.0
"""Seconds that measuring may take to begin without being asked for."""
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
        self.work = PreviewWork(studio.queue, studio.offers.known, self)
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
        self._fills_table = False
        self._form.sizes_asked.connect(self._ask_curve)
        self._form.measuring_asked.connect(lambda: self._measure(False))
        self._card.switched.connect(lambda _: self.update())
        self._card.step_asked.connect(self.step)
        studio.workspace.selection_changed.connect(self._follow_selection)
        panel.folder_asked.connect(self.ask_folder)
        self.work.made.connect(self._show)
        self.work.refused.connect(self._refuse)
        self.work.specimen_made.connect(self._show_specimen)
        self.work.specimen_refused.connect(self._form.refuse)
        self.work.sizes_known.connect(self._take_sizes)
        self.work.measuring_changed.connect(self._wait)
        studio.offers.populations_changed.connect(self._wait)
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
        chosen = self._panel.chosen()
        self._update_preview(chosen.named)
        self._update_specimen(chosen)

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

    def _update_specimen(self, chosen: ChosenAvatars) -> None:
        form = self._form
        try:
            plan = form.plan()
        except ExportError as error:
            self._give_up()
            form.offer_measuring("")
            form.refuse(str(error))
            return
        form.refuse("")
        form.offer_measuring("")
        if plan is None or not chosen.named:
            self._give_up()
            if plan is not None:
                form.show_result(plan.curve, None, "")
            return
        if plan.curve is None and (missing := unmeasured(chosen, self._known)):
            self._give_up()
            self._offer_measuring(len(missing), len(chosen))
            return
        curve = () if plan.curve is None else (tuple(plan.curve.sizes), tuple(plan.curve.finer))
        wanted = (
            tuple(avatar for _, avatar in chosen.named), plan.count, plan.seed, plan.width, plan.width_unit,
            curve, len(unmeasured(chosen, self._known)),
        )  # fmt: skip
        if wanted != self._sketched:
            self._sketched = wanted
            form.show_result(plan.curve, None, tr("Being made …"))
            self.work.sketch(chosen, plan)

    def _give_up(self) -> None:
        self.work.drop("specimen")
        self._sketched = None

    # ---- the avatars' own sizes --------------------------------------------------------------------

    @property
    def _known(self) -> Known:
        return self._studio.offers.known

    def _offer_measuring(self, missing: int, count: int) -> None:
        """Measure at once what takes less than a second; for more there is a button that says how long."""
        if self.work.is_measuring:
            self._form.show_result(None, None, tr("The avatars are being measured …"))
        elif seconds_for(missing) <= AT_ONCE:
            self._measure(False)
        else:
            time = readable_time(seconds_for(missing))
            told = tr(
                "{missing} of {count} avatars are not measured yet: about {time}. The export does not wait "
                "for it.",
                missing=missing,
                count=count,
                time=time,
            )
            self._form.offer_measuring(told)

    def _measure(self, fills_table: bool) -> None:
        self._fills_table = fills_table
        self.work.measure(unmeasured(self._panel.chosen(), self._known))

    def _ask_curve(self) -> None:
        """Fill the table with the curve of all avatars, once they are measured."""
        if unmeasured(self._panel.chosen(), self._known):
            self._measure(True)
        else:
            self._fill_table()

    def _take_sizes(self) -> None:
        if self._fills_table:
            self._fills_table = False
            self._fill_table()
        self._wait()

    def _fill_table(self) -> None:
        kinds = kinds_of(self._panel.chosen(), self._known)
        if kinds is not None:
            curve = kinds.curve()
            unit = readable_power_unit(float(curve.sizes[-1]), curve.unit, 1)
            f = conversion_factor(curve.unit, unit)
            # As the table writes them: of two sizes that become one the larger percentage holds.
            points = {
                float(f"{size * f:.5g}"): float(share)
                for size, share in zip(curve.sizes, curve.finer, strict=True)
            }
            self._form.set_points(list(points), list(points.values()), unit)

    # ---- what came of it ---------------------------------------------------------------------------

    def _show_specimen(self, sketch: SpecimenSketch) -> None:
        specimen, plan = sketch.specimen, sketch.plan
        found = specimen.curve()
        unit = readable_power_unit(2 * specimen.half, specimen.unit, 1)
        f, name = conversion_factor(specimen.unit, unit), unit_label(unit)
        grain = plan.width_unit
        sizes = conversion_factor(found.unit, grain)
        words = [
            tr(
                "D10 {d10:.3g}, D50 {d50:.3g}, D60 {d60:.3g}, D100 {d100:.3g} {grain_unit}; "
                "box {width:.4g} × {width:.4g} × {height:.4g} {box_unit}.",
                d10=found.d10 * sizes,
                d50=found.d50 * sizes,
                d60=found.d60 * sizes,
                d100=found.diameter(100) * sizes,
                grain_unit=unit_label(grain),
                width=2 * specimen.half * f,
                height=specimen.top * f,
                box_unit=name,
            ),
            self._words_on_scale(sketch),
        ]
        if sketch.kinds < sketch.of and plan.curve is not None:
            words.append(
                tr(
                    "Drawn with {measured} of the {count} avatars; the export uses all of them.",
                    measured=sketch.kinds,
                    count=sketch.of,
                )
            )
        elif sketch.kinds < sketch.of:
            words.append(
                plural(
                    sketch.of - sketch.kinds,
                    mark("{count} avatar could not be measured."),
                    mark("{count} avatars could not be measured."),
                )
            )
        self._form.show_result(plan.curve, self._in_unit(found, grain), " ".join(words))

    @staticmethod
    def _words_on_scale(sketch: SpecimenSketch) -> str:
        if sketch.plan.curve is None:
            return tr("No avatar is scaled.")
        scales = sketch.specimen.scales
        return tr(
            "The avatars are scaled by {least:.2g} to {most:.2g}.",
            least=float(scales.min()),
            most=float(scales.max()),
        )

    @staticmethod
    def _in_unit(curve: SizeDistribution, unit: str) -> SizeDistribution:
        f = conversion_factor(curve.unit, unit)
        return SizeDistribution(curve.sizes * f, curve.finer, unit, curve.sieves)
