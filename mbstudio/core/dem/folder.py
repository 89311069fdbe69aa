"""Write a folder whole or not at all.

Everything is written into a hidden temporary folder, flushed to the disk, and swapped in by
renaming. A new folder appears by one rename of a sibling. Into a folder that exists (it may be the
working folder of a shell, or the root of a drive) the files are renamed one by one, the manifest
last, after the earlier ones were renamed aside; a failure renames everything back.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from mbstudio.core.dem.manifest import FILE_NAME
from mbstudio.core.errors import ExportError
from mbstudio.core.own_files import NO_MARK, mark_of
from mbstudio.core.replacement import (
    find_aside,
    flush_folder,
    name_aside,
    name_beside,
    remove_leftovers,
    replacing,
)
from mbstudio.core.sealing import check_json, seal_json

_ASIDE = "mbstudio"
_OLDER = ".mbstudio-*.old"  # as versions before plans named it
_EARLIER, _PLAN = "earlier", "plan.json"


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
        roll_back(folder)
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
    aside = name_aside(folder / _ASIDE)
    kept = aside / _EARLIER
    kept.mkdir(0o700, parents=True)
    _write_plan(aside, earlier, new)
    done: list[tuple[Path, Path]] = []
    made: list[Path] = []
    moves = [(folder / name, kept / name) for name in reversed(earlier)]
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
        shutil.rmtree(aside, ignore_errors=True)
        raise
    shutil.rmtree(aside, ignore_errors=True)
    _remove_emptied(folder, earlier)


def _write_plan(aside: Path, earlier: list[str], new: list[str]) -> None:
    """Write what is about to be moved, so that it can be taken back after a kill."""
    names = {"earlier": earlier, "new": new}
    plan = seal_json({**names, "mark": _mark_of(names)})
    with replacing(aside / _PLAN) as temporary:
        temporary.write_bytes(plan)


def _mark_of(names: dict[str, list[str]]) -> str:
    return mark_of(hashlib.sha256(json.dumps(names, sort_keys=True).encode("ascii")).hexdigest())


def roll_back(folder: Path) -> None:
    """Take back what an export had moved that was killed between its first move and its last.

    The manifest goes first and comes last: where it is there, either nothing was moved or everything.

    Raises
    ------
    OSError
        If something cannot be moved.
    """
    for aside in find_aside(folder / _ASIDE):
        plan = _read_plan(aside)
        if plan is None:  # of somebody else: what it says is not done
            continue
        if not (folder / FILE_NAME).exists():
            earlier, new = plan
            for name in new:
                if name not in earlier:
                    (folder / name).unlink(missing_ok=True)
            _remove_emptied(folder, new)
            for name in sorted(earlier, key=_manifest_last):
                if (aside / _EARLIER / name).exists():
                    _make_parents((folder / name).parent)
                    (aside / _EARLIER / name).replace(folder / name)
            flush_folder(folder)
        shutil.rmtree(aside, ignore_errors=True)
    if (folder / FILE_NAME).exists():
        for aside in folder.glob(_OLDER):
            shutil.rmtree(aside, ignore_errors=True)


def _read_plan(aside: Path) -> tuple[list[str], list[str]] | None:
    """Return the names that were to be moved, if this person's mbstudio has written them."""
    place = aside / _PLAN
    if not place.exists():  # killed before the first move
        return [], []
    try:
        content = place.read_bytes()
        sealed = check_json(content)
        told = json.loads(content)
        names = {key: [str(name) for name in told[key]] for key in ("earlier", "new")}
        if not sealed or told["mark"] == NO_MARK or told["mark"] != _mark_of(names):
            return None
    except (LookupError, RecursionError, TypeError, ValueError):
        return None
    return names["earlier"], names["new"]


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
