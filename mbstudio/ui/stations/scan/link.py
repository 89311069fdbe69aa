"""Keeps station Scan in step with the view, and asks for what a scan file does not say."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import QObject, Qt
from PySide6.QtWidgets import QFileDialog

from mbstudio.core.errors import ProjectError
from mbstudio.core.scan.readers import SUFFIXES, names_folder
from mbstudio.core.units import VoxelSize
from mbstudio.ui.language import tr
from mbstudio.ui.stations.scan.dialog import ScanDialog
from mbstudio.ui.stations.scan.panel import ScanPanel
from mbstudio.ui.stations.scan.voxel_size_dialog import VoxelSizeDialog
from mbstudio.ui.stations.scan.work import ScanWork
from mbstudio.ui.studio import Studio
from mbstudio.ui.view.scene_view import SceneView
from mbstudio.ui.widgets.array_dialog import ask_which_array


class ScanLink(QObject):
    """What happens at station Scan.

    Parameters
    ----------
    studio : Studio
    view : SceneView
    work : ScanWork
    panel : ScanPanel
    """

    def __init__(self, studio: Studio, view: SceneView, work: ScanWork, panel: ScanPanel) -> None:
        super().__init__(studio)
        self._studio, self._view, self._work, self._panel = studio, view, work, panel
        panel.slice_moved.connect(view.move_slice)
        panel.slice_switched.connect(view.switch_slice)
        panel.window_changed.connect(view.set_window)
        view.slices_changed.connect(self._show_slices)
        studio.workspace.scan_changed.connect(self._show_slices_of_scan)
        work.asked.connect(self.ask_about_scan)
        work.several.connect(lambda error, then: ask_which_array(error, then, studio.host))
        work.missing.connect(self.tell_missing_scan)

    def _show_slices(self) -> None:
        slices = self._view.scene.layers.slices.planes
        if slices is not None and self._studio.workspace.sliced is not None:
            for axis, slider in self._panel.sliders.items():
                slider.set_index(slices.index[axis])
            self._panel.show_window(*slices.window)

    def _show_slices_of_scan(self) -> None:
        slices = self._view.scene.layers.slices.planes
        if slices is not None:
            self._panel.show_window(*slices.window)

    # ---- voxel size ------------------------------------------------------------------------------

    def can_correct_voxel_size(self) -> bool:
        """Whether there is something whose voxel size can be corrected, and nothing that runs with it."""
        state = self._studio.workspace.state
        of_meshes = state.grains is not None and state.grains.is_of_meshes
        there = (state.scan is not None or state.grains is not None) and not of_meshes
        return there and self._studio.queue.running() is None

    def ask_voxel_size(self) -> None:
        """Ask for the right voxel size, showing typical lengths before and after."""
        dialog = VoxelSizeDialog(self._studio.workspace.state, self._studio.host)
        dialog.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        dialog.answered.connect(self.correct_voxel_size)
        dialog.open()

    def correct_voxel_size(self, size: VoxelSize) -> None:
        """Correct the voxel size, and say what has not followed."""
        try:
            correction = self._studio.workspace.correct_voxel_size(size)
        except ProjectError as error:
            self._studio.say("error", str(error))
            return
        told = tr("The voxel size is {size} now, and all lengths with it.", size=str(size))
        self._studio.say("warning" if correction.notes else "success", " ".join((told, *correction.notes)))

    # ---- files -----------------------------------------------------------------------------------

    def ask_scan(self) -> None:
        """Let the person choose a scan file."""
        kinds = " ".join(f"*{suffix}" for suffix in SUFFIXES)
        name, _ = QFileDialog.getOpenFileName(
            self._studio.host,
            tr("Open scan"),
            self._studio.path_for(),
            tr("CT scans ({endings});;All files (*)", endings=kinds),
        )
        if name:
            self._work.open(Path(name))

    def ask_folder(self) -> None:
        """Let the person choose a folder of slices, of DICOM or of OME-Zarr."""
        name = QFileDialog.getExistingDirectory(
            self._studio.host, tr("Open folder (slices, DICOM, OME-Zarr)"), self._studio.path_for()
        )
        if name:
            self._work.open(Path(name))

    def ask_about_scan(self, path: Path, why: str, raw: bool) -> None:
        """Ask for what a scan file does not say."""
        dialog = ScanDialog(path, why, raw, self._studio.host)
        dialog.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        dialog.answered.connect(self._work.open_answered)
        dialog.open()

    def tell_missing_scan(self, why: str) -> None:
        """Say that the project's scan is missing, and offer to tell where it is; work goes on without."""
        self._studio.say(
            "warning",
            tr("{why} The grains and avatars are still available.", why=why),
            tr("Locate…"),
            self.ask_missing_scan,
        )

    def ask_missing_scan(self) -> None:
        """Let the person say where the project's scan lies now."""
        reference = self._studio.workspace.state.scan
        if reference is None:
            return
        host, folder = self._studio.host, self._studio.path_for()
        if reference.path is not None and names_folder(reference.path):
            name = QFileDialog.getExistingDirectory(
                host, tr("Where is the folder of the project's scan?"), folder
            )
        else:
            title = tr("Where is the project's scan?")
            if reference.path is not None:
                title = tr("Where is the project's scan ({name})?", name=reference.path.name)
            name, _ = QFileDialog.getOpenFileName(host, title, folder, tr("All files (*)"))
        if name:
            self._work.relocate(Path(name))
