"""The whole job in the window, by keys alone and with a stop watch: a sand scan to clones and a LAMMPS deck.

Usage: python benchmarks/whole_job.py [--data FOLDER] [--clones 500] [--images FOLDER] [--out FILE]

The window is driven as docs/tutorial.md says, with what is set at first: the scan is opened, its grains are
found, two suspicious ones are looked at, all are fitted, the style is learned, clones are made and written
for LAMMPS. Only the dialog in which a file is chosen is not typed into. The scan is the foundry sand of the
main job. Each step is timed from the first key until nothing runs any more; its CPU time is that of the
window and of all processes that it started, whatever else the machine does. With --images a picture of it is
saved after each step.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
os.environ.setdefault("MBSTUDIO_VIEWPORT", "software")
os.environ.setdefault("PYVISTA_OFF_SCREEN", "true")
os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkOSOpenGLRenderWindow")

from PySide6.QtCore import QSettings
from PySide6.QtGui import QKeySequence
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication

from mbstudio.core.dem.manifest import read_manifest
from mbstudio.ui.shell.app import make_application
from mbstudio.ui.shell.main_window import MainWindow
from mbstudio.ui.theme import Theme

LONGEST = 3600.0  # seconds that a step may take
CALM = 0.6  # seconds without work after which a step is over


def cpu_seconds() -> float:
    """Return the CPU time of this process and of all that it started and that ended."""
    spent = os.times()
    return spent.user + spent.system + spent.children_user + spent.children_system


class Watch:
    """Presses keys, waits until nothing runs, and notes what each step took."""

    def __init__(self, window: MainWindow, images: Path | None) -> None:
        self._window, self._images = window, images
        self.lines = [
            "| step | keys | wall time (s) | CPU time (s) | what came of it |",
            "|---|---|---|---|---|",
        ]
        self.total = [0.0, 0.0]

    def press(self, keys: str) -> None:
        """Press keys where the focus is."""
        QTest.keySequence(QApplication.focusWidget() or self._window, QKeySequence(keys))
        QApplication.processEvents()

    def type_in(self, words: str) -> None:
        """Type into the field that has the focus."""
        QTest.keyClicks(QApplication.focusWidget(), words)
        QApplication.processEvents()

    def go_to(self, name: str) -> None:
        """Press Tab until a field has the focus."""
        for _ in range(80):
            if QApplication.focusWidget().accessibleName() == name:
                return
            self.press("Tab")
        sys.exit(f"Tab never reaches “{name}”.")

    def wait_for(self, name: str) -> None:
        """Wait until a field has the focus."""
        begun = time.monotonic()
        while time.monotonic() - begun < 60:
            QApplication.processEvents()
            field = QApplication.focusWidget()
            if field is not None and field.accessibleName() == name:
                return
            time.sleep(0.01)
        sys.exit(f"Nobody asks for “{name}”.")

    def settle(self) -> None:
        """Wait until nothing runs any more."""
        begun = calm = time.monotonic()
        while time.monotonic() - begun < LONGEST:
            QApplication.processEvents()
            time.sleep(0.005)
            if not self._window.queue.is_idle:
                calm = time.monotonic()
            elif time.monotonic() - calm > CALM:
                return
        sys.exit("A step does not end.")

    def step(self, title: str, keys: str, do: Callable[[], object], outcome: Callable[[], str]) -> None:
        """Do a step and note what it took."""
        begun, used = time.monotonic(), cpu_seconds()
        do()
        self.settle()
        wall, cpu = time.monotonic() - begun - CALM, cpu_seconds() - used
        self.total[0] += wall
        self.total[1] += cpu
        self.lines.append(f"| {title} | {keys} | {wall:.0f} | {cpu:.0f} | {outcome()} |")
        print(self.lines[-1], flush=True)
        if self._images is not None:
            number = len(self.lines) - 2
            self._window.grab().save(str(self._images / f"{number:02}.png"))


def do_the_job(window: MainWindow, watch: Watch, scan: Path, clones: int, folder: Path) -> None:
    """Do all of it."""
    state = lambda: window.workspace.state  # noqa: E731

    def open_scan() -> None:
        window.project_files.open_path(scan)
        watch.wait_for("Voxel size")
        watch.type_in("14")
        watch.press("Return")
        window.activateWindow()  # as the system does once a dialog is gone

    watch.step(
        "open the scan", "Ctrl+O, the file, 14, Enter", open_scan,
        lambda: " x ".join(str(n) for n in window.workspace.scan.shape) + " voxels",
    )  # fmt: skip
    watch.step(
        "find the grains", "Ctrl+2, Ctrl+G", lambda: (watch.press("Ctrl+2"), watch.press("Ctrl+G")),
        lambda: f"{len(state().grains)} grains, {len(state().grains.interior_labels)} inside",
    )  # fmt: skip
    watch.step(
        "look at the suspicious ones", "N", lambda: watch.press("N"),
        lambda: f"grain {window.workspace.selected} is the first",
    )  # fmt: skip
    watch.step(
        "exclude one, accept the next", "X, N, Enter",
        lambda: [watch.press(key) for key in ("X", "N", "Return")],
        lambda: f"{len(state().grains.excluded_labels)} and {len(state().grains.accepted_labels)}",
    )  # fmt: skip
    watch.step(
        "fit all grains", "Ctrl+3, Ctrl+Shift+F",
        lambda: (watch.press("Ctrl+3"), watch.press("Ctrl+Shift+F")),
        lambda: f"{len(state().fits)} avatars, {sum(f.verdict.valid for f in state().fits.values())} valid",
    )  # fmt: skip
    watch.step(
        "learn the style", "Ctrl+5, Ctrl+L", lambda: (watch.press("Ctrl+5"), watch.press("Ctrl+L")),
        lambda: f"surfaces of {len(window.workspace.surfaces.parents)} parents",
    )  # fmt: skip

    def generate() -> None:
        watch.go_to("Learn or generate")
        watch.press("Right")
        watch.press("Tab")
        watch.go_to("Clones")
        watch.type_in(str(clones))
        watch.press("Ctrl+Shift+G")

    watch.step(
        f"make {clones} clones", f"the page Generate, {clones}, Ctrl+Shift+G", generate,
        lambda: f"{len(window.workspace.clones)} clones",
    )  # fmt: skip

    def export() -> None:
        watch.press("Ctrl+K")
        watch.type_in("export clones")
        watch.press("Return")
        watch.settle()
        watch.go_to("Target")
        watch.type_in("LAMMPS")
        watch.go_to("Folder")
        watch.type_in(str(folder / "deck"))
        watch.press("Tab")
        watch.press("Ctrl+E")

    watch.step(
        "export for LAMMPS", "Ctrl+K, export clones, Enter; LAMMPS; the folder; Ctrl+E", export,
        lambda: f"{len(read_manifest(folder / 'deck')['items'])} clumps",
    )  # fmt: skip


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=__doc__)
    root = Path(__file__).resolve().parent.parent
    options.add_argument("--data", type=Path, default=root.parent / "shared" / "data" / "sand_ct")
    options.add_argument("--clones", type=int, default=500)
    options.add_argument("--images", type=Path)
    options.add_argument("--out", type=Path)
    given = options.parse_args()
    scan = given.data / "sand_ct_14um.tif"
    if not scan.is_file():
        sys.exit(f"{scan} is not there: say with --data where the sand scan lies.")
    if given.images:
        given.images.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for kind in ("CONFIG", "DATA", "STATE"):
            os.environ[f"XDG_{kind}_HOME"] = str(folder / kind.lower())
        application = make_application()
        settings = QSettings(str(folder / "settings.ini"), QSettings.Format.IniFormat)
        settings.setValue("tour/seen", 1)
        theme = Theme(settings)
        theme.apply()
        window = MainWindow(settings, theme)
        window.project_files.asks = False
        window.resize(1400, 900)
        window.show()
        window.activateWindow()
        watch = Watch(window, given.images)
        watch.settle()
        do_the_job(window, watch, scan, given.clones, folder)
        load = os.getloadavg()[0]
        watch.lines.append(
            f"| all | | {watch.total[0]:.0f} | {watch.total[1]:.0f} | load of the machine: {load:.1f} |"
        )
        window.close()
        application.processEvents()
    print("\n".join(watch.lines))
    if given.out:
        given.out.write_text("\n".join(watch.lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
