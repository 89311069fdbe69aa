"""Chooses files of meshes, asks for what they do not say, and tells in one summary what came of them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PySide6.QtCore import QObject, Qt, Signal
from PySide6.QtWidgets import QFileDialog

from mbstudio.core.errors import MeshError
from mbstudio.core.grains import GrainSet
from mbstudio.core.meshes.endings import MESH_ENDINGS
from mbstudio.core.meshes.listing import meshes_of
from mbstudio.core.meshes.reading import is_mesh_file
from mbstudio.scene.layers.annotations import readable_length
from mbstudio.ui.language import mark, plural, tr
from mbstudio.ui.stations.grains.mesh_dialog import MeshDialog
from mbstudio.ui.stations.grains.mesh_summary import MeshSummary, short_note
from mbstudio.ui.stations.grains.mesh_work import FirstStone, LeftOut, MeshWork, OpenedMeshes
from mbstudio.ui.studio import Level, Studio

NAMED = 3  # files whose names the message bar has room for


class MeshLink(QObject):
    """What happens between choosing meshes and seeing their grains.

    Parameters
    ----------
    studio : Studio
    work : MeshWork

    Attributes
    ----------
    arrived : signal
        The grains of meshes are in the project.
    """

    arrived = Signal()

    def __init__(self, studio: Studio, work: MeshWork) -> None:
        super().__init__(studio)
        self._studio, self._work = studio, work
        work.asked.connect(self.ask)
        work.opened.connect(self._tell)

    # ---- choosing ------------------------------------------------------------------------------

    def ask_files(self) -> None:
        """Let the person choose mesh files."""
        kinds = " ".join(f"*{ending}" for ending in MESH_ENDINGS)
        names, _ = QFileDialog.getOpenFileNames(
            self._studio.host,
            tr("Open meshes"),
            self._studio.path_for(),
            tr("Meshes ({endings});;All files (*)", endings=kinds),
        )
        if names:
            self.open([Path(name) for name in names])

    def ask_folder(self) -> None:
        """Let the person choose a folder of meshes."""
        name = QFileDialog.getExistingDirectory(
            self._studio.host, tr("Open folder of meshes"), self._studio.path_for()
        )
        if name:
            self.open([Path(name)])

    def open(self, paths: Sequence[Path]) -> None:
        """Open files and folders of meshes; what else is among them is left out and named."""
        meshes, left_out = sort_out(paths)
        if meshes:
            self._work.open(meshes, left_out)
        elif left_out:
            self._tell(OpenedMeshes(None, tuple(left_out), ()))

    def ask(self, paths: Sequence[Path], first: FirstStone | None, left_out: LeftOut) -> None:
        """Ask for what files of meshes do not say."""
        dialog = MeshDialog(paths, first, len(left_out), self._studio.settings, self._studio.host)
        dialog.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        dialog.answered.connect(lambda answer: self._work.open_answered(answer, left_out))
        dialog.open()

    # ---- telling -------------------------------------------------------------------------------

    def _tell(self, opened: OpenedMeshes) -> None:
        """Tell in one message what came of all files; the details are a click away."""
        grains = opened.grains
        if grains is None and len(opened.left_out) == 1:
            self._studio.say("error", opened.left_out[0][1])
            return
        words = [
            plural(
                len(opened.left_out),
                mark("The file could not be read."),
                mark("None of the {count} files could be read."),
            )
            if grains is None
            else _words_of(grains)
        ]
        if grains is not None and opened.left_out:
            names = [path.name for path, _ in opened.left_out]
            shown = ", ".join(names[:NAMED]) + (" …" if len(names) > NAMED else "")
            words.append(tr("{count} left out: {names}.", count=len(names), names=shown))
        if len(opened.notes) == 1:
            words.append(short_note(opened.notes[0], opened))
        elif opened.notes:
            words.append(
                plural(
                    len(opened.notes),
                    mark("{count} remark on the files."),
                    mark("{count} remarks on the files."),
                )
            )
        level: Level = "success"
        if grains is None:
            level = "error"
        elif opened.left_out or opened.notes:
            level = "warning"
        if opened.left_out or len(opened.notes) > 1:
            self._studio.say(level, " ".join(words), tr("Details…"), lambda: self.show_summary(opened))
        else:
            self._studio.say(level, " ".join(words))
        if grains is not None:
            self.arrived.emit()

    def show_summary(self, opened: OpenedMeshes) -> None:
        """Show which files were left out and why, and what was mended in the others."""
        dialog = MeshSummary(opened, self._studio.host)
        dialog.setAttribute(Qt.WidgetAttribute.WA_DeleteOnClose)
        dialog.open()


def sort_out(paths: Sequence[Path]) -> tuple[list[Path], list[tuple[Path, str]]]:
    """Return the meshes among files and folders, and what is none with the reason."""
    meshes: list[Path] = []
    left_out: list[tuple[Path, str]] = []
    for path in paths:
        if path.is_dir():
            try:
                meshes += meshes_of(path)
            except (MeshError, OSError) as error:
                left_out.append((path, str(error)))
        elif is_mesh_file(path):
            meshes.append(path)
        elif path.suffix.lower() == ".mbs":
            left_out.append((path, tr("{name} is a project: open it by itself.", name=path.name)))
        else:
            kinds = ", ".join(MESH_ENDINGS)
            told = tr("{name} is no mesh ({endings}).", name=path.name, endings=kinds)
            left_out.append((path, told))
    return list(dict.fromkeys(meshes)), left_out


def _words_of(grains: GrainSet) -> str:
    """Return how many grains there are, of how many files, and how long they are."""
    longest = _longest_sides(grains)
    files = grains.table["file"].unique()
    if len(grains) == 1:
        name, length = Path(str(files[0])).name, readable_length(longest[0], grains.unit)
        return tr("{name}: one grain, {length} long. Select it, then fit it.", name=name, length=length)
    return tr(
        "{count} grains of {files} meshes, {least} to {most} long. Click one in the view or the table, then "
        "fit it.",
        count=len(grains),
        files=len(files),
        least=readable_length(min(longest), grains.unit),
        most=readable_length(max(longest), grains.unit),
    )


def _longest_sides(grains: GrainSet) -> list[float]:
    """Return the longest side of each grain's box, of its mesh where that was kept."""
    if grains.meshes:
        return [float(np.ptp(mesh.vertices, axis=0).max()) for mesh in grains.meshes.values()]
    sides = [
        (grains.table[f"{axis}1"] - grains.table[f"{axis}0"]).to_numpy(float) * edge
        for axis, edge in zip("xyz", grains.voxel_size.xyz, strict=True)
    ]
    return [max(of_one) for of_one in zip(*sides, strict=True)]
