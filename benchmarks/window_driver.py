"""A hand that does random things in the real window, off screen: what goes wrong, what is left, what grows.

Usage: python benchmarks/window_driver.py [--actions 5000] [--seed 1] [--folder FOLDER] [--notes FILE]

Every action of a person is among them, at every station: commands, buttons, sliders, numbers, tables, slices,
the view, plots, keys, files that are sound and broken, saving, cancelling, undo, other programs that change
the file, closing and opening windows. The same seed does the same things; when the work in the background
ends meanwhile is the machine's. Each action stands in FILE before it is done.

Every 60 actions all changes are undone and made again, and each state is compared with what it was when it
was made. Every 500 actions (`--cycle`) the window is closed and a cycle that is always the same is gone
through: memory after the first two of them is the warm-up, and what comes later is compared with it.
"""

from __future__ import annotations

import argparse
import faulthandler
import os
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
os.environ.setdefault("MBSTUDIO_VIEWPORT", "software")
os.environ.setdefault("PYVISTA_OFF_SCREEN", "true")
os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkOSOpenGLRenderWindow")
os.environ.setdefault("MPLBACKEND", "Agg")

HANG = 180
"""Seconds after which an action is called a hang, and the places of all threads are written."""


def main() -> int:
    """Print what came of it; the exit code tells whether anything went wrong."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--actions", type=int, default=5000)
    options.add_argument("--seed", type=int, default=1)
    options.add_argument("--cycle", type=int, default=500, help="actions between two looks at the memory")
    options.add_argument("--folder", type=Path)
    options.add_argument("--notes", type=Path)
    asked = options.parse_args()
    folder = asked.folder or Path(tempfile.mkdtemp(prefix="mbstudio-hand-"))
    for name in ("CONFIG", "DATA", "STATE"):
        os.environ[f"XDG_{name}_HOME"] = str(folder / name.lower())

    from mbstudio.ui.shell.app import make_application
    from tests.ui.random_hand.driver import RandomHand

    application = make_application()
    notes = (asked.notes or folder / "notes.txt").open("w", encoding="utf-8", buffering=1)

    faulthandler.enable(notes)

    def tell(words: str) -> None:
        faulthandler.dump_traceback_later(HANG, exit=True, file=notes)
        print(words, file=notes)

    begun = time.monotonic()
    hand = RandomHand(folder / "files", asked.seed, tell=tell)
    outcome = hand.run(asked.actions, cycle_every=asked.cycle)
    faulthandler.cancel_dump_traceback_later()
    spent = time.monotonic() - begun
    memory = [count / 2**20 for count in outcome.memory]
    grown = memory[-1] - memory[min(1, len(memory) - 1)] if memory else 0.0
    print(
        f"seed {asked.seed}: {outcome.actions} actions in {outcome.windows} windows, "
        f"{spent / 60:.0f} minutes; {outcome.undone} changes undone and made again; "
        f"{len(outcome.faults)} kinds of faults"
    )
    print("actions: " + ", ".join(f"{kind} {count}" for kind, count in sorted(outcome.counts.items())))
    print("MB after each cycle: " + ", ".join(f"{count:.0f}" for count in memory) + f" ({grown:+.0f})")
    print(f"longest in the main thread: {outcome.longest[0]:.2f} s ({outcome.longest[1]})")
    for fault in outcome.faults:
        print(f"- {fault}")
    del application
    return 1 if outcome.faults or grown > 100 else 0


if __name__ == "__main__":
    sys.exit(main())
