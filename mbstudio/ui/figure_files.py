"""Figures drawn in the background, into files or as pixels."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mbstudio.core.replacement import replacing
from mbstudio.scene.pictures.figures import drawn
from mbstudio.ui.language import mark, tr
from mbstudio.ui.workers import Control, Task, TaskQueue

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIGURES = (".svg", ".png", ".pdf")
FIGURE_FILTER = mark("SVG drawing (*.svg);;PNG picture (*.png);;PDF (*.pdf)")


def figure_path(name: str | Path, kind: str = "") -> Path:
    """Return the file of a figure; without an ending it gets that of the kind chosen in the dialog."""
    path = Path(name)
    return path if path.suffix else path.with_suffix(next((end for end in FIGURES if end in kind), ".svg"))


def fault_of_figure(path: Path) -> str:
    """Return why a file cannot hold a figure, nothing if it can."""
    if path.suffix.lower() in FIGURES:
        return ""
    return tr(
        "{path} does not have the ending of a figure. Use {endings}.", path=path, endings=", ".join(FIGURES)
    )


def draw_figure(queue: TaskQueue, make: Callable[[], Figure], path: Path | None = None) -> Task:
    """Draw a figure in the background: into a file by its ending, or as the task's result in pixels."""

    def work(control: Control) -> Any:
        figure = make()
        control.checkpoint()
        if path is None:
            return drawn(figure)
        with replacing(path) as temporary:
            figure.savefig(temporary, format=path.suffix.lower()[1:], facecolor="white", dpi=200)
        return path

    return queue.submit(Task(tr("Drawing the figure"), work))
