"""Keeps station Style in step with the view, the other stations and the files."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import QEvent, QObject
from PySide6.QtWidgets import QFileDialog

from mbstudio.core.units import conversion_factor
from mbstudio.scene.layers.tray import tray_surface
from mbstudio.ui.deferred_calls import DeferredCalls
from mbstudio.ui.language import mark, tr
from mbstudio.ui.stations.style.clone_work import CloneWork
from mbstudio.ui.stations.style.dock import StyleDock
from mbstudio.ui.stations.style.judge_work import JudgeWork
from mbstudio.ui.stations.style.panel import StylePanel
from mbstudio.ui.stations.style.surface_samples import SurfaceSamples, surface_samples
from mbstudio.ui.stations.style.work import StyleWork
from mbstudio.ui.studio import Studio
from mbstudio.ui.view.scene_view import SceneView
from mbstudio.ui.workers import Task

PAGE = 100  # clones that are laid out at a time


_OF_SURFACES = mark(
    "Clones of surfaces are not selected by these factors: a table of them would say little. "
    "Page Judge says whether they can be told from true grains."
)


class StyleLink(QObject):
    """What happens at station Style.

    Parameters
    ----------
    studio : Studio
    view : SceneView
    work : StyleWork
    clone_work : CloneWork
    judge_work : JudgeWork
    panel : StylePanel
    dock : StyleDock
    """

    def __init__(
        self,
        studio: Studio,
        view: SceneView,
        work: StyleWork,
        clone_work: CloneWork,
        judge_work: JudgeWork,
        panel: StylePanel,
        dock: StyleDock,
    ) -> None:
        super().__init__(studio)
        self._studio, self._view, self._deferred = studio, view, DeferredCalls(self)
        self._space, self._work, self._clone_work = studio.workspace, work, clone_work
        self._panel, self._dock, self._judge_work = panel, dock, judge_work
        self._laid_out: tuple[object, int, str] | None = None
        self._assessed: object = None
        self._panel.learn.folder_asked.connect(self.ask_meshes)
        self._work.began.connect(self._began)
        self._work.recorded.connect(self._dock.training.add_records)
        self._dock.clones.chosen.connect(self._space.select_clone)
        self._space.clone_changed.connect(self._selected)
        self._clone_work.changed.connect(self._show_quality)
        self._judge_work.changed.connect(self._show_judgement)
        self._space.clones_changed.connect(self._clones_changed)
        self._space.style_changed.connect(self._show_quality)
        self._space.style_changed.connect(self._show_style)
        studio.theme.changed.connect(self._show_style)
        for signal in (self._space.grains_changed, self._space.scan_changed):
            signal.connect(self._share)
            signal.connect(self.lay_out)
        studio.viewport.clicked.connect(self._clicked)
        studio.viewport.installEventFilter(self)
        self._clones_changed()
        self._show_judgement()
        self._show_style()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Resize:
            # Once the view has taken its new size.
            self._deferred.call(self._view.refit_tray)
        return super().eventFilter(watched, event)

    # ---- in step ---------------------------------------------------------------------------------

    def _began(self) -> None:
        self._dock.training.set_records(self._work.records)
        if self._work.run.is_running:
            self._dock.open_page("training")

    def _show_style(self) -> None:
        """Show some parents and clones of a style of surfaces where else curves of a training are."""
        style = self._space.surfaces
        self._dock.show_surfaces(style is not None)
        if style is None:
            return
        colours = (self._studio.theme.scene.grain, self._studio.theme.scene.points)
        task = Task(tr("Drawing parents and clones"), lambda control: surface_samples(style, colours))

        def done(found: SurfaceSamples) -> None:
            if style is self._space.surfaces:
                self._dock.samples.show_samples(found)

        task.succeeded.connect(done)
        self._studio.queue.submit(task, lane="pictures of parents", key="surface style")

    def _clones_changed(self) -> None:
        self._dock.clones.show_clones(self._clone_work.factors)
        if self._space.clones is not None:
            self._dock.open_page("clones")
            self._panel.open_page("generate")
        self._show_quality()
        self.lay_out()
        self._share()

    def _share(self) -> None:
        """Show the clones as a population beside grains and avatars."""
        self._studio.offers.compare(self._clone_work.shown_populations())

    def _show_quality(self) -> None:
        assessed, clones = self._clone_work.assessed, self._space.clones
        if assessed is not None and clones is not None:
            if assessed is not self._assessed:
                assert clones.factors is not None
                if assessed.quality is None:
                    self._dock.quality.say(tr(_OF_SURFACES))
                else:
                    self._dock.quality.show_quality(assessed.quality, [assessed.parents, clones.factors])
                if self._space.state.grains is None:
                    self._share()
        elif clones is None:
            self._dock.quality.say(
                tr("Generate clones to see here how similar to their parents and how new they are.")
            )
        elif self._clone_work.assessing.is_running:
            self._dock.quality.say(tr("The clones are being compared with their parents …"))
        else:
            self._dock.quality.say(tr("The clones have not been compared with their parents yet."))
        self._assessed = assessed

    def judge_clones(self) -> None:
        """Judge the clones, and show what is found."""
        self._studio.enter("style")
        self._dock.open_page("judge")
        self._judge_work.judge()

    def _show_judgement(self) -> None:
        work, table = self._judge_work, self._dock.judge
        if work.judgement is not None:
            table.show_judgement(work.judgement)
        elif work.run.is_running:
            table.say(tr("The clones are being judged against the true grains …"), is_running=True)
        elif work.refusal:
            table.say(work.refusal)
        elif self._space.clones is None:
            table.say(tr("Generate clones to see here whether they can be told from true grains."))
        elif self._space.state.grains is None:
            table.say(tr("Clones are judged against true grains. The project has none: use mbstudio judge."))
        else:
            table.say(
                tr("Can the clones be told from the true grains, by features that no generator selects on?")
            )

    def _selected(self) -> None:
        chosen = self._space.clone
        self._dock.clones.select(chosen)
        self._view.scene.layers.tray.select(chosen)
        self.lay_out()
        self._studio.viewport.request_render()

    def _clicked(self, x: float, y: float) -> None:
        tray = self._view.scene.layers.tray
        if tray.is_visible:
            hit = tray.pick(x, y)
            self._space.select_clone(None if hit is None else hit.label)

    def export_clones(self) -> None:
        """Go to station Export with the clones chosen there."""
        self._studio.offers.choose_export("clones")
        self._studio.enter("export")

    # ---- the tray --------------------------------------------------------------------------------

    def lay_out(self) -> None:
        """Build the page of the tray that holds the chosen clone, if it does not lie there."""
        clones, tray = self._space.clones, self._view.scene.layers.tray
        if clones is None:
            self._laid_out = None
            if tray.holds_something:
                tray.set(None)
                self._view.arrange()
            return
        if not self._view.shows_tray:
            return
        grains, scan = self._space.state.grains, self._space.scan
        unit = grains.unit if grains is not None else scan.unit if scan is not None else clones.unit
        first = ((self._space.clone or 1) - 1) // PAGE * PAGE
        wanted = (clones, first, unit)
        if self._laid_out == wanted:
            return
        self._laid_out = wanted
        rows = range(first, min(first + PAGE, len(clones)))
        # Not of the view itself, which may not have been shown yet.
        room = self._view.room
        aspect = max(0.4, room.width() / max(1, room.height()))
        scale = conversion_factor(clones.unit, unit)
        # Software draws every triangle on the processor, in the main thread.
        cells = (36 if len(rows) <= 30 else 24) if self._studio.viewport.kind == "OpenGL" else 20
        task = Task(
            tr("Drawing the clones"),
            lambda control: tray_surface(
                [clones.body(i) for i in rows], first + 1, aspect=aspect, scale=scale,
                cells=cells,
            ),
        )  # fmt: skip

        def done(surface: object) -> None:
            if self._laid_out == wanted:
                tray.set(surface, unit)  # type: ignore[arg-type]
                tray.select(self._space.clone)
                self._view.arrange()

        task.succeeded.connect(done)
        self._studio.queue.submit(task, lane="view", key="clones")

    # ---- files -----------------------------------------------------------------------------------

    def ask_meshes(self) -> None:
        """Let the person choose a folder of meshes to learn from."""
        name = QFileDialog.getExistingDirectory(
            self._studio.host, tr("Folder of meshes"), self._studio.path_for()
        )
        if name:
            self._panel.learn.folder.setText(name)

    def ask_style(self) -> None:
        """Let the person choose the folder of a style."""
        name = QFileDialog.getExistingDirectory(self._studio.host, tr("Open style"), self._studio.path_for())
        if name:
            self._work.open(Path(name))

    def ask_folder(self) -> None:
        """Let the person choose where the style is saved."""
        name = QFileDialog.getExistingDirectory(
            self._studio.host, tr("Empty folder for the style"), self._studio.path_for()
        )
        if name:
            self._work.save(Path(name))

    def ask_report(self) -> None:
        """Ask for a file and write the report on the clones to it."""
        name, _ = QFileDialog.getSaveFileName(
            self._studio.host,
            tr("Write report"),
            self._studio.path_for("clones.html"),
            tr("HTML page (*.html)"),
        )
        if name:
            path = Path(name)
            self.write_report(path if path.suffix else path.with_suffix(".html"))

    def write_report(self, path: Path) -> None:
        """Write the report on the clones."""
        studio, task = self._studio, self._clone_work.write_report(path)
        if task is not None:
            task.succeeded.connect(lambda _: studio.say("success", tr("Wrote the report {path}.", path=path)))
