"""Does random things in the real window, window after window, and says what went wrong."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from random import Random
from typing import Any
from unittest import mock

from PySide6.QtCore import QCoreApplication, QSettings, QTimer, QTranslator
from PySide6.QtGui import QDesktopServices, QDrag
from PySide6.QtWidgets import QApplication, QDialog, QFileDialog

from mbstudio.core.errors import MbstudioError
from mbstudio.core.project import ProjectState
from mbstudio.ui.shell.main_window import MainWindow
from mbstudio.ui.shell.memory import give_back_unused, memory_used
from mbstudio.ui.theme import Theme
from tests.ui.random_hand import acts
from tests.ui.random_hand.files import Files
from tests.ui.random_hand.records import digest
from tests.ui.random_hand.watch import Remains, Watch, places_of_threads

SMALLEST, LARGEST = (900, 600), (2560, 1440)
PATIENCE = 120.0
"""Seconds that what was cancelled may take to end."""
_LONG = ("window.quit", "view.turntable")
_WORK = (
    "grains.find", "fit.grain", "fit.grain", "fit.all", "fit.more", "fit.stop", "fit.start_sweep",
    "style.learn", "style.generate", "latent.keep", "latent.randomise", "latent.another",
    "populations.measure", "export.run", "scan.take_part", "fit.use_n",
)  # fmt: skip


class Brackets(QTranslator):
    """A language in which every text stands in brackets, longer than in English."""

    def isEmpty(self) -> bool:
        return False

    def translate(self, context: str, text: str, disambiguation: str = "", n: int = -1) -> str | None:
        return f"⟦{text} ···⟧" if context == "" else None


@dataclass
class Outcome:
    """What came of a run.

    Attributes
    ----------
    actions : int
    faults : list of str
        Each once, with how often it came and what was done when it came first.
    counts : dict of str to int
        How often each kind of action was done.
    windows, undone : int
        Windows that were opened, and changes that were undone to the start and made again.
    memory : list of int
        Bytes after each cycle of opening and closing, the first after the warm-up.
    longest : tuple of (float, str)
        The action that took the main thread longest.
    """

    actions: int = 0
    faults: list[str] = field(default_factory=list)
    counts: dict[str, int] = field(default_factory=dict)
    windows: int = 0
    undone: int = 0
    memory: list[int] = field(default_factory=list)
    longest: tuple[float, str] = (0.0, "")


class RandomHand:
    """A hand with a seed.

    Parameters
    ----------
    folder : Path
        For files and settings.
    seed : int
    theme : Theme, optional
        The application's, where there is one.
    tell : callable, optional
        Given each action in words as it begins.
    """

    def __init__(
        self, folder: Path, seed: int, theme: Theme | None = None, tell: Callable[[str], object] | None = None
    ) -> None:
        self._random = Random(seed)
        self._tell = tell or (lambda _: None)
        self._settings = QSettings(str(folder / "settings.ini"), QSettings.Format.IniFormat)
        self._settings.setValue("tour/seen", 1)
        self.files = Files(folder, seed)
        self._theme = theme or Theme(self._settings)
        self._brackets = Brackets()
        self._is_bracketed = False
        self.watch = Watch()
        self.outcome = Outcome()
        # A menu of a button has an event loop of its own: the button's press ends when somebody chooses.
        self._menus = QTimer()
        self._menus.setInterval(150)
        self._menus.timeout.connect(self._answer_menu)
        self._seen: dict[int, tuple[ProjectState, str]] = {}
        self._history: object = None
        self._acts: list[tuple[float, str, Callable[[], str]]] = [
            (16, "command", self._run_command),
            (12, "button", partial(acts.press_button, self._random)),
            (5, "slider", partial(acts.move_slider, self._random)),
            (6, "number", partial(acts.turn_number, self._random)),
            (5, "entry", partial(acts.choose_entry, self._random)),
            (3, "text", partial(acts.type_text, self._random)),
            (8, "table", partial(acts.use_table, self._random)),
            (3, "tab", partial(acts.turn_tab, self._random)),
            (6, "slices", self._use_slices),
            (8, "view", self._use_view),
            (4, "plot", partial(acts.use_plot, self._random)),
            (4, "key", partial(acts.press_key, self._random)),
            (4, "open", self._open),
            (10, "work", self._work),
            (3, "save", self._save),
            (4, "cancel", self._cancel),
            (5, "undo", self._undo),
            (6, "station", self._enter),
            (2, "theme", self._change_theme),
            (2, "resize", self._resize),
            (1, "other program", self._disturb),
            (3, "wait", self._wait),
            (0.5, "quit", self._quit),
        ]

    # ---- the whole run ---------------------------------------------------------------------------

    def run(self, actions: int, cycle_every: int = 0) -> Outcome:
        """Do so many things; every so many, close the window and note the memory after a cycle."""
        with self._no_real_dialogs(), self.watch:
            self._menus.start()
            remains = Remains()
            self._open_window()
            for number in range(actions):
                ((_, kind, act),) = self._random.choices(self._acts, [weight for weight, _, _ in self._acts])
                self.outcome.counts[kind] = self.outcome.counts.get(kind, 0) + 1
                self._do(f"{number} {kind}", act)
                if self.window._closing:
                    self._close_window(remains)
                    self._open_window()
                if number % 60 == 59:
                    self._check_undo()
                if cycle_every and number % cycle_every == cycle_every - 1:
                    self._close_window(remains)
                    self._cycle(remains)
                    self._open_window()
            self.outcome.actions = actions
            self._check_undo()
            self._close_window(remains)
            self._menus.stop()
        watch = self.watch
        self.outcome.faults += [
            f"{fault} (× {count}, first at: {watch.first[fault]})" for fault, count in watch.faults.items()
        ]
        return self.outcome

    def _do(self, title: str, act: Callable[[], str]) -> None:
        self._tell(title)
        self.watch.doing = title
        begun = time.monotonic()
        told = act()
        QApplication.processEvents()
        self._answer_what_asks()
        spent = time.monotonic() - begun
        self.watch.doing = f"{title}: {told}"
        self._tell(f"    {told} ({spent:.2f} s)")
        if spent > self.outcome.longest[0] and " wait" not in title:
            self.outcome.longest = spent, f"{title}: {told}"

    def _answer_menu(self) -> None:
        acts.answer_menu(self._random)

    def _answer_what_asks(self) -> None:
        """Leave no menu and no dialog open; those that hold nothing back may stay for a while."""
        for _ in range(8):
            if QApplication.activePopupWidget() is not None:
                acts.answer_menu(self._random)
            dialog = QApplication.activeModalWidget()
            if not isinstance(dialog, QDialog):
                loose = [d for d in self.window.findChildren(QDialog) if d.isVisible()]
                if not loose or self._random.random() < 0.5:
                    return
                dialog = self._random.choice(loose)
            inside: list[Callable[[Random], str]] = [
                acts.turn_number, acts.choose_entry, acts.type_text, acts.use_table, acts.press_button,
            ]  # fmt: skip
            acts.answer_dialog(self._random, dialog, inside)
            QApplication.processEvents()
        self.watch.note("a dialog came back eight times")

    # ---- windows ---------------------------------------------------------------------------------

    def _open_window(self, plain: bool = False) -> None:
        if self._is_bracketed:
            QCoreApplication.removeTranslator(self._brackets)
        self._is_bracketed = not plain and self._random.random() < 0.3
        if self._is_bracketed:
            QCoreApplication.installTranslator(self._brackets)
        self.window = MainWindow(self._settings, self._theme)
        self.window.stations.fit.work.shows_spheres = False
        self.window.resize(1280, 800)
        self.window.show()
        self.window.shell.begin()
        self._ids = {command.id for command in self.window.commands}
        self.window.queue.failed.connect(self._failed)
        self.window.workspace.state_changed.connect(self._note_state)
        self.outcome.windows += 1
        if not plain:
            self.window.project_files.open_path(self.files.restore())
            self._settle(20)

    def _failed(self, task: Any, error: Exception) -> None:
        if not isinstance(error, MbstudioError | OSError):
            self.watch.note(f"{task.title} failed: {type(error).__name__}: {error}")

    def _close_window(self, remains: Remains) -> None:
        self.watch.doing = "closing the window"
        window = self.window
        window.project_files.asks = False
        begun = time.monotonic()
        window.close()
        if time.monotonic() - begun > 15:
            self.watch.note("closing the window took longer than 15 s")
        window.deleteLater()
        self._seen.clear()
        self._history = None
        del self.window, window
        for left in remains.wait():
            self.watch.note(f"left alive by a closed window: {left}")
        if self._is_bracketed:
            QCoreApplication.removeTranslator(self._brackets)
            self._is_bracketed = False

    def _cycle(self, remains: Remains) -> None:
        """Open the project, go through the stations, close; then note the memory."""
        self._theme.choose("light")
        self._open_window(plain=True)
        window = self.window
        window.project_files.open_path(self.files.restore())
        self._settle(PATIENCE)
        window.workspace.select(1)
        for station in [station.id for station in window.stations]:
            window.enter(station)
            self._settle(PATIENCE)
        del window
        self._close_window(remains)
        gc.collect()
        give_back_unused()
        self.outcome.memory.append(memory_used())

    def _settle(self, seconds: float) -> bool:
        """Let the event loop run until nothing is done any more; return whether that came in time."""
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            QApplication.processEvents()
            if self.window.queue.is_idle:
                QApplication.processEvents()
                if self.window.queue.is_idle:
                    return True
            time.sleep(0.002)
        return False

    @contextmanager
    def _no_real_dialogs(self) -> Iterator[None]:
        """Let the system's dialogs answer at random, and nothing be opened in other programs."""
        random, files = self._random, self.files

        def one(*_: object) -> tuple[str, str]:
            return ("", "") if random.random() < 0.15 else (str(files.some(random)[0]), "")

        def several(*_: object) -> tuple[list[str], str]:
            return ([], "") if random.random() < 0.15 else ([str(path) for path in files.some(random)], "")

        def target(
            _host: object, _title: str, suggested: str = "", kinds: str = "", *_: object
        ) -> tuple[str, str]:
            return files.some_target(random, suggested), random.choice(kinds.split(";;"))

        def a_folder(*_: object) -> str:
            return files.some_folder(random)

        def nothing(*_: object) -> bool:
            return True

        with (
            mock.patch.object(QFileDialog, "getOpenFileName", one),
            mock.patch.object(QFileDialog, "getOpenFileNames", several),
            mock.patch.object(QFileDialog, "getSaveFileName", target),
            mock.patch.object(QFileDialog, "getExistingDirectory", a_folder),
            mock.patch.object(QDesktopServices, "openUrl", nothing),
            mock.patch.object(QDrag, "exec", nothing),
        ):
            yield

    # ---- undo ------------------------------------------------------------------------------------

    def _note_state(self) -> None:
        """Note the digest of a state when it is first seen."""
        space = self.window.workspace
        if space.project.history is not self._history:
            self._seen.clear()
            self._history = space.project.history
        state = space.state
        if id(state) not in self._seen:
            self._seen[id(state)] = state, digest(state)

    def _check_undo(self) -> None:
        """Undo all, make it all again; each state must be what it was when it was first seen."""
        window = self.window
        self.watch.doing = "undoing all"
        window.queue.cancel_all()
        if not self._settle(PATIENCE):
            running = ", ".join(task.title for task in window.queue._running.values())
            where = places_of_threads()
            self.watch.note(f"cancelled, and still running after {PATIENCE:.0f} s: {running} ({where})")
            return
        self._answer_what_asks()
        window.enter(window.stations.home.id)
        # A settled window may make one more change, as a spin box that loses the keyboard does.
        self._settle(PATIENCE)
        self._note_state()
        end, history = window.workspace.state, window.workspace.project.history
        position = history.position
        self._compare("the end")
        steps = 0
        while window.commands.run("edit.undo"):
            steps += 1
            if steps > 200:
                self.watch.note("undo came to no end")
                break
            QApplication.processEvents()
            self._compare(f"{steps} changes undone")
        if history.position != 0:
            self.watch.note("undo did not reach the start")
        while history.position < position and window.commands.run("edit.redo"):
            QApplication.processEvents()
            self._compare("redone")
        if window.workspace.state is not end:
            self.watch.note("redo did not reach the end")
        self.outcome.undone += steps
        self._tell(f"    undone and made again: {steps} changes")
        self._settle(PATIENCE)

    def _compare(self, where: str) -> None:
        state = self.window.workspace.state
        seen = self._seen.get(id(state))
        now = digest(state)
        if seen is None:
            self._seen[id(state)] = state, now
        elif seen[1] != now:
            self.watch.note(f"a state of the project is not what it was ({where})")

    # ---- actions of the whole window ---------------------------------------------------------------

    def _run_command(self) -> str:
        commands = [command.id for command in self.window.commands if command.id not in _LONG]
        chosen = self._random.choice(commands)
        self._tell(f"    command {chosen}")
        return f"{chosen}: {'done' if self.window.commands.run(chosen) else 'not possible'}"

    def _work(self) -> str:
        """Begin what changes the project: a person does it more often than chance would."""
        window, random = self.window, self._random
        if random.random() < 0.3:
            window.workspace.change_fit_settings(n=random.randrange(4, 12))
            return "another n"
        grains = window.workspace.state.grains
        if grains is None and random.random() < 0.5:
            window.project_files.open_path(self.files.restore())
            return "open the project again"
        if grains is not None and random.random() < 0.7:
            window.workspace.choose(random.sample(grains.table["label"].tolist(), min(2, len(grains))))
        chosen = random.choice([name for name in _WORK if name in self._ids])
        return f"{chosen}: {'done' if window.commands.run(chosen) else 'not possible'}"

    def _use_slices(self) -> str:
        panes = [pane for pane in self.window.slice_views.panes.panes.values() if pane.isVisible()]
        return acts.wander(self._random.choice(panes), self._random) if panes else ""

    def _use_view(self) -> str:
        viewport = self.window.viewport
        return acts.wander(viewport, self._random) if viewport.isVisible() else ""

    def _open(self) -> str:
        paths = self.files.some(self._random)
        self.window.project_files.open_paths(paths)
        return f"open {', '.join(path.name for path in paths)}"

    def _save(self) -> str:
        chosen = self._random.choice(("project.save", "project.save", "project.save_as"))
        self.window.commands.run(chosen)
        return chosen

    def _cancel(self) -> str:
        queue = self.window.queue
        kind = self._random.choice(("running", "running", "waiting", "all", "pause"))
        task = queue.running()
        if kind == "all":
            queue.cancel_all()
        elif kind == "waiting":
            for one in queue.waiting_tasks():
                one.cancel()
        elif kind == "pause" and task is not None:
            task.pause_or_resume()
            QApplication.processEvents()
            task.pause_or_resume()
        elif task is not None:
            task.cancel()
        return f"{kind}: {task.title if task else 'nothing'}"

    def _undo(self) -> str:
        chosen = self._random.choice(("edit.undo", "edit.undo", "edit.redo"))
        times = self._random.randrange(1, 4)
        for _ in range(times):
            self.window.commands.run(chosen)
        return f"{chosen} × {times}"

    def _enter(self) -> str:
        station = self._random.choice([station.id for station in self.window.stations])
        self.window.enter(station)
        return station

    def _change_theme(self) -> str:
        choice = self._random.choice(("light", "dark", "system"))
        self._theme.choose(choice)
        return choice

    def _resize(self) -> str:
        width, height = (self._random.randint(*ends) for ends in zip(SMALLEST, LARGEST, strict=True))
        self.window.resize(width, height)
        return f"{width} × {height}"

    def _disturb(self) -> str:
        """Do what another program may do to the project's file, if it is one that was saved here."""
        path = self.window.workspace.project.path
        if path is None or self.files.out not in path.parents or not path.is_file():
            return ""
        kind = self._random.choice(("remove", "copy over", "cut"))
        if kind == "remove":
            path.unlink()
        elif kind == "copy over":
            path.write_bytes(self.files.project.read_bytes())
        else:
            path.write_bytes(path.read_bytes()[:1000])
        return f"{kind} {path.name}"

    def _wait(self) -> str:
        seconds = self._random.choice((0.05, 0.3, 1.0, 3.0))
        return f"{seconds} s, {'idle' if self._settle(seconds) else 'busy'}"

    def _quit(self) -> str:
        self.window.project_files.asks = self._random.random() < 0.5
        self.window.commands.run("window.quit")
        if not self.window._closing:
            self.window.project_files.asks = True
        return "closed" if self.window._closing else "asked"
