"""Pictures and animations of the 3-D view: to the clipboard and to files."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import UInt8
from PySide6.QtCore import QObject, Qt, Signal
from PySide6.QtGui import QGuiApplication, QImage
from PySide6.QtWidgets import QFileDialog

from mbstudio.core.errors import MbstudioError
from mbstudio.scene import camera
from mbstudio.scene.pictures.animation import animation_file, require_writer
from mbstudio.scene.pictures.picture_file import write_picture
from mbstudio.ui.language import tr
from mbstudio.ui.studio import Studio
from mbstudio.ui.workers import Control, Task

FRAMES = 72
"""Of a turntable: steps of five degrees."""


class _Frames(QObject):
    """Hands frames, which only the main thread can draw, to the thread that writes them."""

    asked = Signal(int)

    def __init__(self, draw: Any, parent: QObject) -> None:
        super().__init__(parent)
        self._draw, self._there = draw, threading.Event()
        self._frame: UInt8[np.ndarray, "h w 3"] | None = None
        self.asked.connect(self._deliver, Qt.ConnectionType.QueuedConnection)

    def frame(self, number: int, control: Control) -> UInt8[np.ndarray, "h w 3"]:
        """Return a frame; called in the thread, which may be cancelled while it waits."""
        self._there.clear()
        self.asked.emit(number)
        while not self._there.wait(0.05):
            control.checkpoint()
        assert self._frame is not None
        return self._frame

    def _deliver(self, number: int) -> None:
        self._frame = self._draw(number)
        self._there.set()


class Pictures(QObject):
    """What becomes of the view as a picture.

    Parameters
    ----------
    studio : Studio

    Attributes
    ----------
    scale : int
        Pixels of a picture for each pixel of the view, along a side; kept from start to start.
    """

    def __init__(self, studio: Studio) -> None:
        super().__init__(studio)
        self._studio = studio
        kept = str(studio.settings.value("picture_scale", "1"))
        self.scale = int(kept) if kept in ("1", "2", "4") else 1
        self._turning: Task | None = None

    def use_scale(self, scale: int, _checked: bool = True) -> None:
        """Make pictures so many times as fine as the screen."""
        self.scale = scale
        self._studio.settings.setValue("picture_scale", str(scale))
        self._studio.commands.refresh()

    def has_scale(self, scale: int) -> bool:
        """Return whether pictures are so many times as fine as the screen."""
        return self.scale == scale

    def ask_file(self) -> None:
        """Ask for a file and save the view to it."""
        name, _ = QFileDialog.getSaveFileName(
            self._studio.host,
            tr("Save picture"),
            self._studio.path_for("view.png"),
            tr("PNG picture (*.png)"),
        )
        if name:
            self.save(Path(name))

    def save(self, path: Path) -> None:
        """Save the 3-D view as a picture."""
        path = path if path.suffix else path.with_suffix(".png")
        try:
            write_picture(path, self._studio.viewport.picture(self.scale))
        except OSError as error:
            self._studio.say(
                "error",
                tr("{path} cannot be written ({error}). Choose another folder.", path=path, error=error),
            )
        else:
            self._studio.say("success", tr("Saved the view as {path}.", path=path))

    def copy(self) -> None:
        """Put the view into the clipboard."""
        pixels = np.ascontiguousarray(self._studio.viewport.picture(self.scale))
        height, width, _ = pixels.shape
        image = QImage(pixels.tobytes(), width, height, 3 * width, QImage.Format.Format_RGB888)
        QGuiApplication.clipboard().setImage(image.copy())
        self._studio.say(
            "success",
            tr("Copied the view to the clipboard, {width} × {height} pixels.", width=width, height=height),
        )

    # ---- turntable -------------------------------------------------------------------------------

    @property
    def is_turning(self) -> bool:
        """Whether a turntable is being written."""
        return self._turning is not None and not self._turning.is_over

    def ask_turntable(self) -> None:
        """Ask for a file and write the view turning once around to it."""
        name, kind = QFileDialog.getSaveFileName(
            self._studio.host,
            tr("Save turntable"),
            self._studio.path_for("turntable.gif"),
            tr("GIF animation (*.gif);;MP4 video (*.mp4);;PNG pictures, one per frame (*.png)"),
        )
        if name:
            path = Path(name)
            ending = next((end for end in (".mp4", ".png") if end in kind), ".gif")
            self.write_turntable(path if path.suffix else path.with_suffix(ending))

    def write_turntable(self, path: Path, frames: int = FRAMES) -> Task | None:
        """Turn the view once around and write it as an animation.

        Parameters
        ----------
        path : Path
            Ending in .gif, .mp4 or .png (one file a frame).
        frames : int
            Steps of the whole turn.
        """
        try:
            require_writer(path)
        except MbstudioError as error:
            self._studio.say("error", str(error))
            return None
        viewport, scale = self._studio.viewport, self.scale
        renderer = viewport.plotter.renderer
        begun = camera.pose(renderer)
        size: list[tuple[int, ...]] = []

        def draw(number: int) -> UInt8[np.ndarray, "h w 3"]:
            camera.set_pose(renderer, begun)
            renderer.GetActiveCamera().Azimuth(360.0 * number / frames)
            picture = viewport.picture(scale)
            size.append(picture.shape[:2])
            return _fit_to_size(picture, size[0])

        source = _Frames(draw, self)

        def work(control: Control) -> Path:
            with animation_file(path) as add:
                for number in range(frames):
                    told = tr("frame {frame} of {frames}", frame=number + 1, frames=frames)
                    control.progress(number / frames, told)
                    add(source.frame(number, control))
            return path

        def over() -> None:
            source.deleteLater()
            camera.set_pose(renderer, begun)
            viewport.request_render()
            self._studio.refresh()

        task = Task(tr("Writing the turntable"), work)
        task.succeeded.connect(lambda written: self._studio.say("success", _told(written, frames)))
        task.ended.connect(over)
        self._turning = task
        self._studio.queue.submit(task)
        return task


def _fit_to_size(picture: UInt8[np.ndarray, "h w 3"], size: tuple[int, ...]) -> UInt8[np.ndarray, "h2 w2 3"]:
    """Return the middle of a picture, widened by its edges: all frames have the first one's size."""
    for axis, wanted in enumerate(size):
        there = picture.shape[axis]
        places = np.clip(np.arange(wanted) + (there - wanted) // 2, 0, there - 1)
        picture = np.take(picture, places, axis=axis)
    return picture


def _told(path: Path, frames: int) -> str:
    if path.suffix.lower() == ".png":
        return tr(
            "Saved the turntable as {frames} pictures, {name}_000.png and so on, in {folder}.",
            frames=frames,
            name=path.stem,
            folder=path.parent,
        )
    return tr("Saved the turntable as {path}.", path=path)
