"""Opening and saving: which file, and whether unsaved work may go."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from PySide6.QtCore import QObject, Qt
from PySide6.QtWidgets import QFileDialog

from mbstudio.ui.language import mark, tr
from mbstudio.ui.shell.dialogs.leave_card import LeaveCard
from mbstudio.ui.stations.scan.dialog import ScanDialog
from mbstudio.ui.stations.scan.work import SCAN_SUFFIXES

if TYPE_CHECKING:
    from mbstudio.ui.shell.main_window import MainWindow

PROJECT_FILTER = mark("MetaBall Studio project (*.mbs)")
FIGURES = (".svg", ".png", ".pdf")
_FIGURE_FILTER = mark("SVG drawing (*.svg);;PNG picture (*.png);;PDF (*.pdf)")


class FileActions(QObject):
    """Asks the person for files and hands them to the work.

    Parameters
    ----------
    window : MainWindow
    """

    def __init__(self, window: MainWindow) -> None:
        super().__init__(window)
        self._window = window
        self._then: Callable[[], object] | None = None
        self.leaving = LeaveCard()
        self.leaving.answered.connect(self._leave)
        window.workspace.project_replaced.connect(self.leaving.take_away)

    def ask_scan(self) -> None:
        """Let the person choose a scan file."""
        kinds = " ".join(f"*{suffix}" for suffix in SCAN_SUFFIXES)
        name, _ = QFileDialog.getOpenFileName(
            self._window,
            tr("Open scan"),
            self.folder(),
            tr("CT scans ({endings});;All files (*)", endings=kinds),
        )
        if name:
            self.open_path(Path(name))

    def ask_scan_folder(self) -> None:
        """Let the person choose a folder of slices."""
        name = QFileDialog.getExistingDirectory(self._window, tr("Open folder of slices"), self.folder())
        if name:
            self.open_path(Path(name))

    def ask_project(self) -> None:
        """Let the person choose a project file."""
        name, _ = QFileDialog.getOpenFileName(
            self._window, tr("Open project"), self.folder(), tr(PROJECT_FILTER)
        )
        if name:
            self.open_path(Path(name))

    def open_path(self, path: Path, voxel_size: str | None = None) -> None:
        """Open a project, a scan or a folder of slices, whichever it is."""
        if path.suffix.lower() == ".mbs":
            self.leave_project(lambda: self._window.projects.open(path))
        else:
            self._window.scans.open(path, voxel_size)

    def tell_missing_scan(self, why: str) -> None:
        """Say that the project's scan is missing, and offer to tell where it is; work goes on without."""
        self._window.messages.say(
            "warning",
            tr("{why} Grains and avatars are there all the same.", why=why),
            tr("Locate…"),
            self.ask_missing_scan,
        )

    def ask_missing_scan(self) -> None:
        """Let the person say where the project's scan lies now."""
        reference = self._window.workspace.state.scan
        if reference is None:
            return
        name = ""
        if reference.path is not None and not reference.path.suffix:
            name = QFileDialog.getExistingDirectory(self._window, tr("Where are the slices?"), self.folder())
        else:
            title = tr("Where is the project's scan?")
            if reference.path is not None:
                title = tr("Where is the project's scan ({name})?", name=reference.path.name)
            name, _ = QFileDialog.getOpenFileName(self._window, title, self.folder(), tr("All files (*)"))
        if name:
            self._window.scans.relocate(Path(name))

    def open_sample(self) -> None:
        """Make the sample scan."""
        self._window.scans.open_sample()

    def new_project(self) -> None:
        """Begin anew."""
        self.leave_project(self._window.projects.new)

    def save(self) -> None:
        """Save to the project's file, or ask for one."""
        path = self._window.workspace.project.path
        if path is None:
            self.save_as()
        else:
            self._window.projects.save(path)

    def save_as(self, after: Any = None) -> None:
        """Ask for a file and save to it."""
        name, _ = QFileDialog.getSaveFileName(
            self._window, tr("Save project"), self.folder("sand.mbs"), tr(PROJECT_FILTER)
        )
        if name:
            path = Path(name)
            self._window.projects.save(path if path.suffix else path.with_suffix(".mbs"), after)

    def ask_screenshot(self) -> None:
        """Ask for a file and save the view to it."""
        name, _ = QFileDialog.getSaveFileName(
            self._window, tr("Save picture"), self.folder("view.png"), tr("PNG picture (*.png)")
        )
        if name:
            self.save_screenshot(Path(name))

    def save_screenshot(self, path: Path) -> None:
        """Save the 3-D view as a picture."""
        from imageio.v3 import imwrite

        path = path if path.suffix else path.with_suffix(".png")
        try:
            imwrite(path, self._window.viewport.picture(self._window.pictures.scale))
        except OSError as error:
            self._window.messages.say(
                "error",
                tr("{path} cannot be written ({error}): choose another folder.", path=path, error=error),
            )
        else:
            self._window.messages.say("success", tr("Saved the view as {path}.", path=path))

    def ask_turntable(self) -> None:
        """Ask for a file and write the view turning once around to it."""
        name, kind = QFileDialog.getSaveFileName(
            self._window,
            tr("Save turntable"),
            self.folder("turntable.gif"),
            tr("GIF animation (*.gif);;MP4 film (*.mp4);;PNG pictures, one a frame (*.png)"),
        )
        if name:
            path = Path(name)
            ending = next((end for end in (".mp4", ".png") if end in kind), ".gif")
            self._window.pictures.write_turntable(path if path.suffix else path.with_suffix(ending))

    def ask_report(self) -> None:
        """Ask for a file and write the report on the populations to it."""
        path = self._window.workspace.project.path
        name, _ = QFileDialog.getSaveFileName(
            self._window,
            tr("Write report"),
            self.folder(f"{path.stem}.html" if path else "report.html"),
            tr("HTML page (*.html)"),
        )
        if name:
            chosen = Path(name)
            self._window.brushing.write_report(chosen if chosen.suffix else chosen.with_suffix(".html"))

    def ask_figure(self) -> None:
        """Ask for a file and save the plot that is looked at to it."""
        name, kind = QFileDialog.getSaveFileName(
            self._window,
            tr("Save figure"),
            self.folder(f"{self._window.plots.page_name}.svg"),
            tr(_FIGURE_FILTER),
        )
        if name:
            self.save_figure(Path(name), kind)

    def ask_curve(self) -> None:
        """Ask for a file and save the chosen grain's convergence curve to it."""
        label = self._window.workspace.selected
        name, kind = QFileDialog.getSaveFileName(
            self._window,
            tr("Save convergence curve"),
            self.folder(f"convergence_{label}.svg"),
            tr(_FIGURE_FILTER),
        )
        if name:
            path = Path(name)
            ending = next((end for end in FIGURES if end in kind), ".svg")
            self.save_curve(path if path.suffix else path.with_suffix(ending))

    def save_curve(self, path: Path) -> None:
        """Save the chosen grain's convergence curve: SVG, PNG or PDF by its ending."""
        from mbstudio.scene.pictures.figures import convergence_plot

        space, messages = self._window.workspace, self._window.messages
        fit = space.state.fits.get(space.selected) if space.selected is not None else None
        if path.suffix.lower() not in FIGURES:
            messages.say("error", _no_figure(path))
        elif fit is not None and space.selected is not None:
            fits = {space.selected: fit}
            task = self._window.populations.draw(lambda: convergence_plot(fits), path)
            task.succeeded.connect(
                lambda written: messages.say("success", tr("Saved the curve as {path}.", path=written))
            )

    def save_figure(self, path: Path, kind: str = "") -> None:
        """Save the plot that is looked at: SVG, PNG or PDF by its ending."""
        if not path.suffix:
            path = path.with_suffix(next((end for end in FIGURES if end in kind), ".svg"))
        if path.suffix.lower() not in FIGURES:
            self._window.messages.say("error", _no_figure(path))
        else:
            self._window.brushing.save_figure(path)

    def ask_labels(self) -> None:
        """Let the person choose a label image."""
        name, _ = QFileDialog.getOpenFileName(
            self._window,
            tr("Load labels"),
            self.folder(),
            tr("Label images (*.tif *.tiff *.npy *.nrrd *.mhd *.mha *.h5);;All files (*)"),
        )
        if name:
            self._window.grains.load(Path(name))

    def ask_export_folder(self) -> None:
        """Let the person choose where DEM files go."""
        name = QFileDialog.getExistingDirectory(self._window, tr("Folder for the DEM files"), self.folder())
        if name:
            self._window.panels_export.folder.setText(name)

    def ask_about_scan(self, path: Path, why: str, raw: bool) -> None:
        """Ask for what a scan file does not say."""
        dialog = ScanDialog(path, why, raw, self._window)
        dialog.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        dialog.answered.connect(self._window.scans.open_answered)
        dialog.open()

    @property
    def has_unsaved_work(self) -> bool:
        """Whether leaving the project now would lose something that is done or under way."""
        window = self._window
        return window.workspace.is_modified or bool(window.fits.arrived_fits) or window.fits.is_running

    def leave_project(self, then: Callable[[], object]) -> None:
        """Do `then` once unsaved work is saved or given up; a card above the view asks for which."""
        window = self._window
        if not (window.ask_before_closing and self.has_unsaved_work and window.workspace.can_be_saved):
            then()
            return
        running = window.queue.running()
        told = [tr("Otherwise the grains and avatars since the last save are lost.")]
        if running is not None:
            told.insert(0, tr("“{task}” is still running and will be stopped.", task=running.title))
        self._then = then
        question = tr("Save the changes to “{project}”?", project=window.workspace.title)
        self.leaving.ask(question, " ".join(told))

    def _leave(self, answer: str) -> None:
        """Do what was answered; work may have been done or saved since the question was asked."""
        window, then = self._window, self._then
        self._then = None
        if answer == "save":
            # What a fit has reached so far comes into the project, then into the file.
            if window.fits.running_label is not None:
                window.fits.stop()
            else:
                window.queue.cancel_all("work")
            path = window.workspace.project.path
            if path is None:
                self.save_as(after=then)
            else:
                window.projects.save(path, after=then)
        elif answer == "discard" and then is not None:
            then()

    def folder(self, name: str = "") -> str:
        """Return where a dialog begins: a file of this name in the project's folder."""
        project = self._window.workspace.project.path
        recent = self._window.workspace.recent
        folder = project.parent if project else (recent[0].parent if recent else Path.home())
        return str(folder / name)


def _no_figure(path: Path) -> str:
    return tr("{path} has no ending of a figure: use {endings}.", path=path, endings=", ".join(FIGURES))
