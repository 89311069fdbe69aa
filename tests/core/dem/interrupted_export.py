"""A program that replaces the files of an export, and is killed at any one of its steps.

Run as ``python -m tests.core.dem.interrupted_export FOLDER``. What is found at the next export must be the
earlier one or the new one, whole. Prints one line of JSON: how many steps were tried, and what was not so.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
from pathlib import Path

from mbstudio.core.dem.folder import check_replaceable, replaced_folder
from mbstudio.core.dem.manifest import FILE_NAME
from tests.core.project.interrupted_program import KILLED, in_copy

EARLIER = {"a.txt": "a", "b.txt": "b", "meshes/one.stl": "one", FILE_NAME: "earlier"}
NEW = {"b.txt": "new b", "c.txt": "c", "clumps/two.txt": "two", FILE_NAME: "new"}
KEPT = {"notes.txt": "mine"}
_STEPS = ("rename", "replace", "mkdir", "rmdir", "unlink", "fsync")


def write(folder: Path, files: dict[str, str]) -> None:
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)


def ours(folder: Path) -> list[str] | None:
    manifest = folder / FILE_NAME
    if not manifest.exists():
        return None
    return list(EARLIER if manifest.read_text() == "earlier" else NEW)


def export(folder: Path) -> None:
    names = check_replaceable(folder, ours, overwrite=False)
    with replaced_folder(folder, names, overwrite=False) as temporary:
        write(temporary, NEW)


def export_and_end(folder: Path, at: int) -> None:
    count = 0

    def counted(call):
        def step(*arguments, **named):
            nonlocal count
            count += 1
            if count == at:
                os._exit(KILLED)
            return call(*arguments, **named)

        return step

    for name in _STEPS:
        setattr(os, name, counted(getattr(os, name)))
    export(folder)


def found_in(folder: Path) -> dict[str, str]:
    return {
        path.relative_to(folder).as_posix(): path.read_text() for path in folder.rglob("*") if path.is_file()
    }


def main(folder: Path) -> None:
    wrong, steps = [], 0
    while True:
        for entry in folder.iterdir():
            shutil.rmtree(entry)
        place = folder / "out"
        write(place, EARLIER | KEPT)
        ended = in_copy(lambda place=place, at=steps + 1: export_and_end(place, at))
        check_replaceable(place, ours, overwrite=False)
        seen = {name: text for name, text in found_in(place).items() if not name.endswith(".part")}
        seen = {name: text for name, text in seen.items() if ".part/" not in name}
        if seen not in (EARLIER | KEPT, NEW | KEPT):
            wrong.append(f"step {steps + 1}: {seen}")
        export(place)
        if found_in(place) != NEW | KEPT or list(folder.iterdir()) != [place]:
            wrong.append(f"step {steps + 1}: {found_in(place)} after the next export")
        if ended != KILLED:
            break
        steps += 1
    print(json.dumps({"steps": steps, "ended": ended, "wrong": wrong}))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
