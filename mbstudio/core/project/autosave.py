"""Work that outlives a crash: what a running program writes beside the project, and the next one finds.

Every running window has a folder of its own with the parts of its project as small project files and a
note that names them; a lock file beside the folder is held as long as the program lives. The system lets
go of the lock however the program ends, so that a folder whose lock is free was left behind by a crash.
"""

from __future__ import annotations

import errno
import re
import secrets
import shutil
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, TYPE_CHECKING, NamedTuple

from mbstudio.core.errors import ProjectError
from mbstudio.core.locking import try_lock
from mbstudio.core.plain_files import parse_json
from mbstudio.core.project.file import read_embedded_scan, read_project, write_project
from mbstudio.core.project.project import Project
from mbstudio.core.project.sealed_file import identify
from mbstudio.core.project.state import ProjectState
from mbstudio.core.replacement import replacing
from mbstudio.core.sealing import check_json, seal_json

if TYPE_CHECKING:
    from mbstudio.core.scan.scan import VoxelArray

# Each part is written only when something in it changed: packing the labels of a large scan takes seconds.
PARTS: dict[str, tuple[str, ...]] = {
    "grains": ("scan", "segmentation", "grains"),
    "style": ("style", "clones", "surfaces", "surface_clones"),
    "work": ("fits", "outdated", "fit_settings"),
    "twin": ("twin",),
    "kept": ("kept",),
    "packing": ("packing",),
    "learning": ("strokes", "classifier"),
    "log": ("log",),
}
_NOTE = "note.json"
_JOURNAL = "avatars.journal"


@dataclass(frozen=True)
class AutosaveNote:
    """What an autosave holds.

    Attributes
    ----------
    path : Path or None
        The project file that the work belongs to; None if it was never saved.
    saved : datetime
        When it was written, in UTC.
    grains, fits, clones : int
        How many of each there are.
    """

    path: Path | None
    saved: datetime
    grains: int
    fits: int
    clones: int

    @property
    def title(self) -> str:
        """Name of the project file, or what an unsaved project is called."""
        return self.path.name if self.path is not None else "Untitled project"


class _Contents(NamedTuple):
    """What the note of autosaved work says: the file of each part, its digest, how the project was opened."""

    note: AutosaveNote
    parts: dict[str, str]
    digests: dict[str, str]
    opened_as: str | None


class Autosave:
    """The autosave of one window, locked against all others; make it with `begin` or `find_abandoned`.

    Attributes
    ----------
    folder : Path
    """

    def __init__(self, folder: Path, lock: IO[bytes]) -> None:
        self.folder = folder
        self._lock = lock
        self._written: ProjectState | None = None
        self._parts: dict[str, str] = {}
        self._count = 0

    @classmethod
    def begin(cls, root: Path) -> Autosave:
        """Return an empty autosave in a new folder below `root`.

        Raises
        ------
        OSError
            If nothing can be written there, or files cannot be locked.
        """
        root.mkdir(parents=True, exist_ok=True)
        folder = root / secrets.token_hex(6)
        # The lock comes first: a folder without one that is held was left behind.
        lock = _locked(folder)
        if lock is None:
            raise OSError(f"{folder} is used by another program")
        folder.mkdir()
        return cls(folder, lock)

    @classmethod
    def find_abandoned(cls, root: Path) -> Iterator[Autosave]:
        """Yield what crashed programs have left, newest first; each stays locked until it is let go.

        What is of no use (nothing was written yet) is removed on the way.
        """
        if not root.is_dir():
            return
        folders = [entry for entry in root.iterdir() if entry.is_dir()]
        for folder in sorted(folders, key=lambda entry: entry.stat().st_mtime, reverse=True):
            lock = _locked(folder)
            if lock is None:
                continue
            found = cls(folder, lock)
            if (folder / _NOTE).is_file():
                yield found
            else:
                found.discard()

    @property
    def journal(self) -> Path:
        """Where avatars are written as they are finished, of a project whose file cannot have a journal."""
        return self.folder / _JOURNAL

    # ---- writing -------------------------------------------------------------------------------

    def write(
        self,
        state: ProjectState,
        path: Path | None = None,
        voxels: VoxelArray | None = None,
        opened_as: str | None = None,
    ) -> None:
        """Write a state; the one before stays valid until all of this lies on the disk.

        Parameters
        ----------
        state : ProjectState
        path : Path, optional
            The project file that it belongs to.
        voxels : VoxelArray, shape (Z, Y, X), optional
            Of a scan that the project embeds.
        opened_as : str, optional
            What told the project file from others when it was opened or saved last.

        Raises
        ------
        ProjectError
            If the folder cannot be written or the disk is full.
        """
        self._count += 1
        parts = dict(self._parts)
        for name, fields in PARTS.items():
            if self._written is not None and all(
                getattr(state, field) is getattr(self._written, field) for field in fields
            ):
                continue
            parts[name] = f"{name}-{self._count}.mbs"
            part = ProjectState(**{field: getattr(state, field) for field in fields})
            write_project(self.folder / parts[name], part, voxels)
        note = {
            "parts": parts,
            "digests": {name: identify(self.folder / file) for name, file in parts.items()},
            "path": None if path is None else str(Path(path).resolve()),
            "opened_as": opened_as,
            "saved": datetime.now(UTC).isoformat(timespec="seconds"),
            "grains": 0 if state.grains is None else len(state.grains),
            "fits": len(state.fits),
            "clones": 0 if state.new_grains is None else len(state.new_grains),
        }
        try:
            with replacing(self.folder / _NOTE) as temporary:
                temporary.write_bytes(seal_json(note))
        except OSError as error:
            raise ProjectError(f"{self.folder} cannot be written ({error}): free some space.") from error
        self._written, self._parts = state, parts
        self._remove_all_but({*parts.values(), _NOTE, _JOURNAL})

    def clear(self) -> None:
        """Remove what was written: the project's file holds it all."""
        (self.folder / _NOTE).unlink(missing_ok=True)
        self._written, self._parts = None, {}
        self._remove_all_but({_JOURNAL})

    def discard(self) -> None:
        """Remove everything and let go."""
        shutil.rmtree(self.folder, ignore_errors=True)
        self.release()
        _lock_path(self.folder).unlink(missing_ok=True)

    def release(self) -> None:
        """Let go; what was written stays for another program to find."""
        self._lock.close()

    def _remove_all_but(self, kept: set[str]) -> None:
        for entry in self.folder.iterdir():
            if entry.name not in kept:
                entry.unlink(missing_ok=True)

    # ---- reading -------------------------------------------------------------------------------

    @property
    def note(self) -> AutosaveNote:
        """What it holds.

        Raises
        ------
        ProjectError
            If the note is damaged.
        """
        return self._read_note().note

    def restore(self) -> Project:
        """Return the project as it was written last, with what was finished since: unsaved, with its path.

        Raises
        ------
        ProjectError
            If it is damaged.
        """
        note, parts, digests, opened_as = self._read_note()
        self._require_its_parts(parts, digests)
        state, scan = ProjectState(), None
        for name, file in parts.items():  # a note of an earlier version names fewer
            part = read_project(self.folder / file)
            state = replace(state, **{field: getattr(part, field) for field in PARTS[name]})
        reference = state.scan
        if reference is not None and reference.embedded:
            scan = read_embedded_scan(self.folder / parts["grains"], reference)
        # Names of parts written from now on must not meet those that are there.
        self._count = max(int(file.rpartition("-")[2].partition(".")[0]) for file in parts.values())
        # A part that is not there is not written yet: the next write makes it.
        complete = parts.keys() == PARTS.keys()
        self._written, self._parts = (state, parts) if complete else (None, {})
        project = Project.recovered(state, note.path, scan, opened_as)
        for place in (None, self.journal):
            project.take_from_journal(place)
        return project

    def _require_its_parts(self, parts: Mapping[str, str], digests: Mapping[str, str]) -> None:
        """Refuse parts that are not those which the note was written with."""
        for name, digest in digests.items():
            if name in parts and identify(self.folder / parts[name]) != digest:
                raise ProjectError(
                    f"{self.folder / parts[name]} is not the file that the autosaved work was written with: "
                    "it was damaged or replaced, and nothing of it was read."
                )

    def _read_note(self) -> _Contents:
        """Return what its note says."""
        try:
            content = (self.folder / _NOTE).read_bytes()
            check_json(content)
            told = parse_json(content)
            note = AutosaveNote(
                path=Path(told["path"]) if told["path"] else None,
                saved=datetime.fromisoformat(told["saved"]),
                **{name: int(told[name]) for name in ("grains", "fits", "clones")},
            )
            parts = {name: told["parts"][name] for name in PARTS if name in told["parts"]}
            if (
                not all(re.fullmatch(rf"{name}-\d{{1,9}}\.mbs", file) for name, file in parts.items())
                or not parts
            ):
                raise ValueError("it names files that do not belong to a project")
            digests = {str(name): str(digest) for name, digest in dict(told.get("digests", {})).items()}
            opened_as = told.get("opened_as")
            if not (opened_as is None or isinstance(opened_as, str)):
                raise ValueError("'opened_as' is no text")
        except (
            AttributeError,
            LookupError,
            OSError,
            OverflowError,
            RecursionError,
            TypeError,
            ValueError,
        ) as error:
            told = " ".join(str(error).split())[:200]
            reason = f"{told} is missing" if isinstance(error, KeyError) else told
            raise ProjectError(f"The autosaved work in {self.folder} cannot be read ({reason}).") from error
        return _Contents(note, parts, digests, opened_as)


def _lock_path(folder: Path) -> Path:
    return folder.with_name(f"{folder.name}.lock")


def _locked(folder: Path) -> IO[bytes] | None:
    """Return the locked lock file of a folder; None if another program (or window) holds it."""
    stream = _lock_path(folder).open("ab")
    try:
        locked = try_lock(stream)
    except OSError:
        stream.close()
        raise
    if locked is None:
        stream.close()
        raise OSError(errno.ENOLCK, f"files in {folder.parent} cannot be locked")
    if not locked:
        stream.close()
        return None
    return stream
