"""Keeps station Style in step with the view, the other stations and the files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QEvent, QObject
from PySide6.QtWidgets import QFileDialog

from mbstudio.core.units import conversion_factor
from mbstudio.scene.layers.tray import tray_surface
from mbstudio.ui.language import tr
from mbstudio.ui.soon import Soon
from mbstudio.ui.workers import Task

if TYPE_CHECKING:
    from mbstudio.ui.shell.main_window import MainWindow

PAGE = 100  # clones that are laid out at a time


class StyleLink(QObject):
    """What happens at station Style.

    Parameters
    ----------
    window : MainWindow
    """

    def __init__(self, window: MainWindow) -> None:
        super().__init__(window)
        self._window, self._soon = window, Soon(self)
        self._space, self._styles, self._clones = window.workspace, window.styles, window.clones
        self._panel, self._dock = window.panels_style, window.style_page
        self._laid_out: tuple[object, int, str] | None = None
        self._assessed: object = None
        learn, generate = self._panel.learn, self._panel.generate
        learn.folder_asked.connect(self.ask_meshes)
        learn.open_asked.connect(self.ask_style)
        learn.save_asked.connect(self.ask_folder)
        generate.report_asked.connect(self.ask_report)
        generate.populations_asked.connect(lambda: window.enter("populations"))
        generate.export_asked.connect(self._export)
        self._styles.began.connect(self._began)
        self._styles.recorded.connect(self._dock.training.add_records)
        self._dock.clones.chosen.connect(self._clones.select)
        self._clones.selection_changed.connect(self._selected)
        self._clones.changed.connect(self._show_quality)
        self._space.clones_changed.connect(self._clones_changed)
        self._space.style_changed.connect(self._show_quality)
        for signal in (self._space.grains_changed, self._space.scan_changed):
            signal.connect(self._share)
            signal.connect(self._lay_out)
        window.viewport.clicked.connect(self._clicked)
        window.viewport.installEventFilter(self)
        for work in (self._styles, self._clones):
            work.said.connect(window.messages.say)
            work.changed.connect(window.refresh)
        self._clones_changed()

    def entered(self) -> None:
        """Lay the clones out and compare them, when the station is entered."""
        self._lay_out()
        if self._window.queue.running() is None:
            self._clones.assess()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Resize:
            # Once the view has taken its new size.
            self._soon.call(self._window.link.refit_tray)
        return super().eventFilter(watched, event)

    # ---- in step ---------------------------------------------------------------------------------

    def _began(self) -> None:
        self._dock.training.set_records(self._styles.records)
        if self._styles.is_running:
            self._dock.open_page("training")

    def _clones_changed(self) -> None:
        self._dock.clones.show_clones(self._clones.factors)
        if self._space.clones is not None:
            self._dock.open_page("clones")
            self._panel.open_page("generate")
        self._show_quality()
        self._lay_out()
        self._share()
        self._window.panels_export.offer_clones(self._space.clones)

    def _share(self) -> None:
        """Show the clones as a population beside grains and avatars."""
        self._window.populations.show_others(self._clones.shown_populations())

    def _show_quality(self) -> None:
        assessed, clones = self._clones.assessed, self._space.clones
        if assessed is not None and clones is not None:
            if assessed is not self._assessed:
                assert clones.factors is not None
                self._dock.quality.show_quality(assessed.quality, [assessed.parents, clones.factors])
                if self._space.state.grains is None:
                    self._share()
        elif clones is None:
            self._dock.quality.say(
                tr("Generate clones: how like their parents they are, and how new, appears here.")
            )
        elif self._clones.is_assessing:
            self._dock.quality.say(tr("The clones are being compared with their parents …"))
        else:
            self._dock.quality.say(tr("The clones have not been compared with their parents yet."))
        self._assessed = assessed

    def _selected(self) -> None:
        chosen = self._clones.selected
        self._dock.clones.select(chosen)
        self._window.link.scene.layers.tray.select(chosen)
        self._lay_out()
        self._window.viewport.request_render()

    def _clicked(self, x: float, y: float) -> None:
        tray = self._window.link.scene.layers.tray
        if tray.is_visible:
            hit = tray.pick(x, y)
            self._clones.select(None if hit is None else hit.label)

    def _export(self) -> None:
        self._window.panels_export.choose("clones")
        self._window.enter("export")

    # ---- the tray --------------------------------------------------------------------------------

    def _lay_out(self) -> None:
        """Build the page of the tray that holds the chosen clone, if it does not lie there."""
        clones, tray = self._space.clones, self._window.link.scene.layers.tray
        if clones is None:
            self._laid_out = None
            if tray.holds_something:
                tray.set(None)
                self._window.link.arrange()
            return
        if not self._window.link.shows_tray:
            return
        grains, scan = self._space.state.grains, self._space.scan
        unit = grains.unit if grains is not None else scan.unit if scan is not None else clones.clones.unit
        first = ((self._clones.selected or 1) - 1) // PAGE * PAGE
        wanted = (clones, first, unit)
        if self._laid_out == wanted:
            return
        self._laid_out = wanted
        rows = range(first, min(first + PAGE, len(clones)))
        # Not of the view itself, which may not have been shown yet.
        room = self._window.view_room
        aspect = max(0.4, room.width() / max(1, room.height()))
        scale = conversion_factor(clones.clones.unit, unit)
        # Software draws every triangle on the processor, in the main thread.
        cells = (36 if len(rows) <= 30 else 24) if self._window.viewport.kind == "OpenGL" else 20
        task = Task(
            tr("Drawing the clones"),
            lambda control: tray_surface(
                [clones.clones.avatar(i) for i in rows], first + 1, aspect=aspect, scale=scale,
                cells=cells,
            ),
        )  # fmt: skip

        def done(surface: object) -> None:
            if self._laid_out == wanted:
                tray.set(surface, unit)  # type: ignore[arg-type]
                tray.select(self._clones.selected)
                self._window.link.arrange()

        task.succeeded.connect(done)
        self._window.queue.submit(task, lane="view", key="clones")

    # ---- files -----------------------------------------------------------------------------------

    def ask_meshes(self) -> None:
        """Let the person choose a folder of meshes to learn from."""
        name = QFileDialog.getExistingDirectory(
            self._window, tr("Folder of meshes"), self._window.files.folder()
        )
        if name:
            self._panel.learn.folder.setText(name)

    def ask_style(self) -> None:
        """Let the person choose the folder of a style-learner."""
        name = QFileDialog.getExistingDirectory(
            self._window, tr("Open style-learner"), self._window.files.folder()
        )
        if name:
            self._styles.open(Path(name))

    def ask_folder(self) -> None:
        """Let the person choose where the style-learner is saved."""
        name = QFileDialog.getExistingDirectory(
            self._window, tr("Empty folder for the style-learner"), self._window.files.folder()
        )
        if name:
            self._styles.save(Path(name))

    def ask_report(self) -> None:
        """Ask for a file and write the report on the clones to it."""
        name, _ = QFileDialog.getSaveFileName(
            self._window,
            tr("Write report"),
            self._window.files.folder("clones.html"),
            tr("HTML page (*.html)"),
        )
        if name:
            path = Path(name)
            self.write_report(path if path.suffix else path.with_suffix(".html"))

    def write_report(self, path: Path) -> None:
        """Write the report on the clones."""
        messages, task = self._window.messages, self._clones.write_report(path)
        if task is not None:
            task.succeeded.connect(
                lambda _: messages.say("success", tr("Wrote the report {path}.", path=path))
            )
