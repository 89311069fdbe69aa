"""Write a folder whole or not at all.

Everything is written into a hidden temporary folder, flushed to the disk, and swapped in by
renaming. A new folder appears by one rename of a sibling. Into a folder that exists (it may be the
working folder of a shell, or the root of a drive) the files are renamed one by one, the manifest
last, after the earlier ones were renamed aside; a failure renames everything back.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from mbstudio.core.dem.manifest import FILE_NAME
from mbstudio.core.errors import ExportError
from mbstudio.core.replacement import name_beside, remove_leftovers


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
            f"{folder} contains other files ({entries[0].name}, ...) and no earlier export: "
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
    folder = folder.resolve()
    made_parents: list[Path] = []
    temporary: Path | None = None
    try:
        try:
            made_parents = _make_parents(folder.parent)
            place = folder if folder.exists() else folder.parent
            remove_leftovers(place)
            temporary = name_beside(place / "mbstudio")
            temporary.mkdir(0o700)
            yield temporary
            _refuse_collisions(temporary, folder, set(replaced), overwrite)
            _flush(temporary)
            if folder.exists():
                _swap_files(temporary, folder, set(replaced))
                shutil.rmtree(temporary)
            else:
                _give_usual_rights(temporary)
                temporary.rename(folder)
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


def _files_in(folder: Path) -> list[str]:
    """Return the files of a folder and those in it, named from the folder, with slashes."""
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file())


def _refuse_collisions(temporary: Path, folder: Path, replaced: set[str], overwrite: bool) -> None:
    if overwrite or not folder.is_dir():
        return
    new = [name for name in _files_in(temporary) if name not in replaced]
    in_the_way = [name for name in new if (folder / name).exists()]
    if in_the_way:
        raise ExportError(
            f"{folder / in_the_way[0]} is not from an earlier export and would be overwritten: "
            "move it, choose another name, or allow it to be overwritten."
        )


def _give_usual_rights(temporary: Path) -> None:
    """A temporary folder is readable by its owner only."""
    mask = os.umask(0)
    os.umask(mask)
    temporary.chmod(0o777 & ~mask)


def _flush(folder: Path) -> None:
    for path in [*folder.rglob("*"), folder]:
        if path.is_dir() and os.name == "nt":
            continue  # a folder cannot be opened there; renaming writes its metadata through
        descriptor = os.open(path, os.O_RDONLY if path.is_dir() or os.name != "nt" else os.O_RDWR)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _swap_files(temporary: Path, folder: Path, replaced: set[str]) -> None:
    """Rename the earlier files aside and the new ones in; if one rename fails, rename all back."""
    new = sorted(_files_in(temporary), key=_manifest_last)
    earlier = sorted({name for name in replaced | set(new) if (folder / name).exists()}, key=_manifest_last)
    aside = Path(tempfile.mkdtemp(prefix=".mbstudio-", suffix=".old", dir=folder))
    done: list[tuple[Path, Path]] = []
    made: list[Path] = []
    moves = [(folder / name, aside / name) for name in reversed(earlier)]
    moves += [(temporary / name, folder / name) for name in new]
    try:
        for source, destination in moves:
            made += _make_parents(destination.parent)
            source.rename(destination)
            done.append((source, destination))
    except BaseException:
        for source, destination in reversed(done):
            destination.rename(source)
        for parent in reversed(made):
            parent.rmdir()
        aside.rmdir()
        raise
    shutil.rmtree(aside, ignore_errors=True)
    _remove_emptied(folder, earlier)


def _remove_emptied(folder: Path, names: Iterable[str]) -> None:
    """Remove the folders within a folder that held earlier files and now hold nothing."""
    parents = {parent for name in names for parent in Path(name).parents if parent != Path()}
    for parent in sorted(parents, key=lambda path: -len(path.parts)):
        place = folder / parent
        if place.is_dir() and not any(place.iterdir()):
            place.rmdir()


def _manifest_last(name: str) -> tuple[bool, str]:
    """A folder without a manifest is no export, so the manifest goes first and comes last."""
    return name == FILE_NAME, name
