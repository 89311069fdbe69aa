"""Write a folder whole or not at all.

Everything is written into a hidden sibling of the folder, flushed to the disk, and swapped in
by renaming. Until the swap nothing that was there is touched; a failure removes the sibling.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from mbstudio.core.errors import ExportError


def check_replaceable(folder: Path, ours: Callable[[Path], list[str] | None], overwrite: bool) -> list[str]:
    """Return the names in an existing folder that a new export replaces.

    Parameters
    ----------
    folder : Path
    ours : callable(Path) -> list of str or None
        The files of an earlier export there, or None if there was none.
    overwrite : bool
        Whether a folder with other files, and no earlier export, may be written into.

    Raises
    ------
    ExportError
        If the path is a file, or holds other files and `overwrite` is False.
    """
    if not folder.exists():
        if folder.is_symlink():
            raise ExportError(f"{folder} is a link that leads nowhere: choose another folder.")
        return []
    if not folder.is_dir():
        raise ExportError(f"{folder} is a file, not a folder: choose another place for the export.")
    try:
        entries = list(folder.iterdir())
        earlier = ours(folder)
    except OSError as error:
        raise ExportError(f"{folder} cannot be read ({error.strerror}): choose another folder.") from error
    if earlier is None and entries and not overwrite:
        raise ExportError(
            f"{folder} holds other files ({entries[0].name}, ...) and no earlier export: "
            "choose an empty folder, or allow it to be overwritten."
        )
    return earlier or []


@contextmanager
def replaced_folder(folder: Path, replaced: Iterable[str], overwrite: bool) -> Iterator[Path]:
    """Give a temporary folder to write into; swap it in when the block ends without an error.

    Parameters
    ----------
    folder : Path
    replaced : iterable of str
        Files of the earlier export; every other file that is there is kept.
    overwrite : bool
        Whether a kept file may give way to a new file of the same name.

    Raises
    ------
    ExportError
        If the folder cannot be written (rights, full disk) or a kept file is in the way. Nothing
        has changed then.
    """
    folder = Path(os.path.abspath(folder))
    if folder.is_symlink():
        folder = folder.resolve()
    made_parents: list[Path] = []
    temporary: Path | None = None
    try:
        try:
            made_parents = _make_parents(folder.parent)
            temporary = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", suffix=".part", dir=folder.parent))
            yield temporary
            _refuse_collisions(temporary, folder, set(replaced), overwrite)
            _give_rights(temporary, folder)
            _flush(temporary)
            _swap(temporary, folder, set(replaced))
        except OSError as error:
            reason = error.strerror or str(error)
            raise ExportError(
                f"{folder} cannot be written ({reason}): choose another folder or make room. "
                "Nothing was changed."
            ) from error
    except BaseException:
        if temporary is not None:
            shutil.rmtree(temporary, ignore_errors=True)
        for parent in reversed(made_parents):
            if parent.is_dir() and not any(parent.iterdir()):
                parent.rmdir()
        raise


def _make_parents(parent: Path) -> list[Path]:
    missing = []
    while not parent.exists():
        missing.append(parent)
        parent = parent.parent
    missing.reverse()
    made: list[Path] = []
    for path in missing:
        path.mkdir()
        made.append(path)
    return made


def _refuse_collisions(temporary: Path, folder: Path, replaced: set[str], overwrite: bool) -> None:
    if overwrite or not folder.is_dir():
        return
    there = {entry.name for entry in folder.iterdir()} - replaced
    in_the_way = sorted(there & {entry.name for entry in temporary.iterdir()})
    if in_the_way:
        raise ExportError(
            f"{folder / in_the_way[0]} is not from an earlier export and would be lost: "
            "move it away, choose another name, or allow it to be overwritten."
        )


def _give_rights(temporary: Path, folder: Path) -> None:
    """A temporary folder is readable by its owner only; the result gets the usual rights."""
    if folder.exists():
        temporary.chmod(folder.stat().st_mode & 0o7777)
    else:
        mask = os.umask(0)
        os.umask(mask)
        temporary.chmod(0o777 & ~mask)


def _flush(folder: Path) -> None:
    for path in [*folder.iterdir(), folder]:
        if path.is_dir() and os.name == "nt":
            continue  # a folder cannot be opened there; renaming writes its metadata through
        descriptor = os.open(path, os.O_RDONLY if path.is_dir() or os.name != "nt" else os.O_RDWR)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _swap(temporary: Path, folder: Path, replaced: set[str]) -> None:
    if not folder.exists():
        temporary.rename(folder)
        return
    aside = Path(tempfile.mkdtemp(prefix=f".{folder.name}.", suffix=".old", dir=folder.parent))
    before = aside / folder.name
    moved: list[str] = []
    folder.rename(before)
    try:
        new = {entry.name for entry in temporary.iterdir()}
        for entry in list(before.iterdir()):
            if entry.name not in replaced and entry.name not in new:
                entry.rename(temporary / entry.name)
                moved.append(entry.name)
        temporary.rename(folder)
    except BaseException:
        for name in moved:
            (temporary / name).rename(before / name)
        before.rename(folder)
        aside.rmdir()
        raise
    shutil.rmtree(aside, ignore_errors=True)
