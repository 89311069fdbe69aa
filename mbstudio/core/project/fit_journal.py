"""Avatars that outlive their program before the project is saved: ``sand.mbs.journal`` beside ``sand.mbs``.

Each finished avatar is a record of :mod:`mbstudio.core.journal_file`. The header ties the journal to
the file that the work began from and to its grains, so that it is never brought into something else. The
next opening of the project takes the avatars in; the next save removes those that the file holds by then.
Only who holds the project's lock writes its journal.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mbstudio.core.errors import JournalError, MbstudioError
from mbstudio.core.imaging.steps import FitResult
from mbstudio.core.journal_file import Contents, JournalWriter, read_journal
from mbstudio.core.project.fit_table import pack_fit, unpack_fit
from mbstudio.core.project.stored import ContentError, json_entries
from mbstudio.core.replacement import flush_folder, free_name
from mbstudio.core.version import __version__

if TYPE_CHECKING:
    from mbstudio.core.grains.grain_set import GrainSet

log = logging.getLogger(__name__)

KIND = "finished avatars"
_FILE = b"file "
"""Begins the record that names what the project's file is about to become; no avatar begins so."""
_GONE = b"gone"
"""Begins the record of a grain whose avatar was taken back."""
SYNC_AFTER = 0.5
"""Seconds after which what was appended is flushed to the disk, together with what came meanwhile."""


def journal_path(project: Path) -> Path:
    """Return where the journal of a project file lies."""
    target = project.resolve()
    return target.with_name(f"{target.name}.journal")


def grains_digest(grains: GrainSet) -> str:
    """Return what tells grains from all others: the SHA-256 of their labels and their place."""
    labels = np.asarray(grains.labels)
    told = {"shape": labels.shape, "type": labels.dtype.str, "size": grains.voxel_size.zyx,
            "unit": grains.voxel_size.unit, "origin": [float(place) for place in grains.origin]}  # fmt: skip
    digest = hashlib.sha256(json.dumps(told).encode("ascii"))
    for plane in labels:
        digest.update(np.ascontiguousarray(plane).data)
    return digest.hexdigest()


@dataclass(frozen=True)
class Origin:
    """What a journal belongs to.

    Attributes
    ----------
    file : str
        What tells the project file that the work began from, as `sealed_file.identify` says it; empty for
        work that has no file.
    grains : str
        The digest of its grains.
    """

    file: str
    grains: str

    def pack(self) -> bytes:
        """Return the header of the journal."""
        told = {"kind": KIND, "file": self.file, "grains": self.grains, "written_by": __version__}
        return json.dumps(told).encode("ascii")

    @classmethod
    def unpack(cls, header: bytes) -> Origin:
        """Return what a header says; ContentError if it is none of a journal of avatars."""
        told = json_entries(header.decode("utf-8", "replace"), "the header")
        file, grains = told.get("file"), told.get("grains")
        if told.get("kind") != KIND or not isinstance(file, str) or not isinstance(grains, str):
            raise ContentError("it is of another kind or of a newer mbstudio")
        return cls(file, grains)


@dataclass(frozen=True)
class Found:
    """What a journal holds.

    Attributes
    ----------
    origin : Origin
    fits : mapping of int to FitResult
        By label; of a grain that was fitted twice the later one.
    files : frozenset of str
        What the project's file can be: what the work began from, or what a save was about to make of it.
    labels : mapping of bytes to int
        The label of every record that holds an avatar, by the record's digest.
    damaged : int
        Places that are not as they were written, and records that hold no avatar.
    contents : Contents
    """

    origin: Origin
    fits: Mapping[int, FitResult]
    files: frozenset[str]
    labels: Mapping[bytes, int]
    damaged: int
    contents: Contents = field(repr=False)


def find_fits(path: Path) -> Found | None:
    """Read a journal of avatars; None if there is none.

    Raises
    ------
    JournalError
        If it is something else, or cannot be read.
    """
    contents = read_journal(path)
    if contents is None:
        return None
    try:
        origin = Origin.unpack(contents.header)
    except ContentError as error:
        raise JournalError(f"{path} is no journal of avatars ({error}): move it elsewhere.") from error
    fits: dict[int, FitResult] = {}
    labels: dict[bytes, int] = {}
    damaged, files = contents.damaged, {origin.file}
    for record in contents.records:
        if record.content.startswith(_FILE):
            files.add(record.content[len(_FILE) :].decode("ascii", "replace"))
            continue
        if record.content.startswith(_GONE) and len(record.content) == len(_GONE) + 8:
            label = int.from_bytes(record.content[len(_GONE) :], "little")
            fits.pop(label, None)
            labels[record.digest] = label
            continue
        try:
            label, fit = unpack_fit(record.content)
        except (MbstudioError, ContentError) as error:
            log.warning("%s: a record holds no avatar: %s", path, error)
            damaged += 1
        else:
            fits[label], labels[record.digest] = fit, label
    return Found(origin, fits, frozenset(files), labels, damaged, contents)


@dataclass(eq=False)
class Entry:
    """An avatar in a journal (None: it was taken back), and whether it came into the project.

    On what came into the project the next save decides.
    """

    label: int
    fit: FitResult | None
    entered: bool = False

    def pack(self) -> bytes:
        """Return it as a record holds it."""
        if self.fit is None:
            return _GONE + self.label.to_bytes(8, "little")
        return pack_fit(self.label, self.fit)


class FitJournal:
    """The journal of a project that is worked on; who makes one holds the project's lock.

    Parameters
    ----------
    path : Path
    origin : Origin
        What the avatars to come belong to.
    taken : mapping of int to FitResult
        What the project has taken out of the journal that lies there: it stays in it until it is saved.
    left : mapping of int to FitResult
        What else it holds: it stays in it for the next opening.

    Attributes
    ----------
    path : Path
    trouble : OSError or None
        Why the last avatars are not on the disk yet; they are tried again with the next.

    Raises
    ------
    OSError
        If the journal that lies there cannot be continued or moved.
    """

    def __init__(
        self, path: Path, origin: Origin, taken: Mapping[int, FitResult], left: Mapping[int, FitResult]
    ) -> None:
        self.path, self.origin = path, origin
        self.trouble: OSError | None = None
        self._lock = threading.RLock()
        self._entries = [Entry(label, fit, entered=True) for label, fit in taken.items()]
        self._entries += [Entry(label, fit) for label, fit in left.items()]
        self._latest: dict[int, Entry] = {entry.label: entry for entry in self._entries}
        self._waiting: list[Entry] = []
        self._announced: list[str] = []
        self._timer: threading.Timer | None = None
        self._writer: JournalWriter | None = None
        if self._entries:
            self._create()

    def _create(self) -> None:
        packed = [_FILE + file.encode("ascii") for file in self._announced]
        packed += [entry.pack() for entry in self._entries]
        self._writer = JournalWriter.create(self.path, self.origin.pack(), packed)
        self._waiting.clear()

    # ---- writing -------------------------------------------------------------------------------

    def keep(self, label: int, fit: FitResult) -> None:
        """Write an avatar: it outlives this process at once, and the system half a second later.

        What cannot be written waits for the next one; :attr:`trouble` tells.
        """
        with self._lock:
            latest = self._latest.get(label)
            if latest is None or latest.fit is not fit:
                self._add([Entry(label, fit)])

    def enter(self, fits: Mapping[int, FitResult]) -> None:
        """Take note that these avatars have come into the project: the next save decides on them."""
        with self._lock:
            for entry in self._entries:
                if entry.fit is not None and fits.get(entry.label) is entry.fit:
                    entry.entered = True

    def follow(self, fits: Mapping[int, FitResult], saved: Mapping[int, FitResult]) -> None:
        """Write what undo, redo or a change has made of the avatars that had come into the project.

        Parameters
        ----------
        fits : mapping of int to FitResult
            Those of the project, by label.
        saved : mapping of int to FitResult
            Those that lie in its file.
        """
        with self._lock:
            changed = []
            for label, latest in self._latest.items():
                fit = fits.get(label)
                if latest.entered and fit is not latest.fit:
                    in_file = fit is None or fit is saved.get(label)
                    if latest.fit is not None or not in_file:
                        changed.append(Entry(label, None if in_file else fit, entered=True))
            if changed:
                self._add(changed)

    def _add(self, entries: list[Entry]) -> None:
        self._entries += entries
        self._waiting += entries
        self._latest |= {entry.label: entry for entry in entries}
        self._write()
        if self._timer is None:
            self._timer = threading.Timer(SYNC_AFTER, self._sync_later)
            self._timer.daemon = True
            self._timer.start()

    def sync(self) -> None:
        """Wait until all lies on the disk.

        Raises
        ------
        OSError
            If it does not get there.
        """
        with self._lock:
            self._write()
            if self.trouble is None and self._writer is not None:
                self._try(self._writer.sync)
            if self.trouble is not None:
                raise self.trouble

    def _write(self) -> None:
        """Write what waits; what does not get through goes on waiting."""
        self.trouble = None
        while self._waiting and self.trouble is None:
            self._try(self._write_one)

    def _write_one(self) -> None:
        if self._writer is None:
            self._create()
            return
        entry = self._waiting[0]
        self._writer.append(entry.pack())
        del self._waiting[0]

    def _try(self, step: Callable[[], object]) -> None:
        try:
            step()
        except OSError as error:
            self.trouble = error

    def _sync_later(self) -> None:
        with self._lock:
            self._timer = None
            if self._writer is not None:
                self._try(self._writer.sync)

    # ---- at a save -----------------------------------------------------------------------------

    def announce(self, file: str) -> None:
        """Write what the project's file is about to become: whoever is ended then belongs to it as well.

        Where the disk is full a save goes on all the same; :attr:`trouble` tells.
        """
        with self._lock:
            self._announced.append(file)
            if self._writer is not None:
                self._try(lambda: self._append_file(file))

    def _append_file(self, file: str) -> None:
        assert self._writer is not None
        self._writer.append(_FILE + file.encode("ascii"))
        self._writer.sync()

    def entered(self) -> frozenset[Entry]:
        """Return which of the avatars have come into the project by now, for :meth:`settle`."""
        with self._lock:
            return frozenset(entry for entry in self._entries if entry.entered)

    def settle(self, entered: frozenset[Entry], path: Path, origin: Origin) -> None:
        """Remove what a save has decided on, once it lies on the disk; the rest belongs to what was saved.

        Parameters
        ----------
        entered : frozenset of Entry
            What had come into the project before it was saved.
        path : Path
            Where the journal of the file lies that was written.
        origin : Origin
            What the rest belongs to.

        Raises
        ------
        OSError
            If it cannot be written; what was there stays.
        """
        with self._lock:
            before, writer = self.path, self._writer
            self._entries = [entry for entry in self._entries if entry not in entered]
            self._latest = {entry.label: entry for entry in self._entries}
            self._waiting = list(self._entries)
            self.path, self.origin, self._writer, self._announced = path, origin, None, []
            if writer is not None:
                writer.close()
            if path != before and os.path.lexists(path):
                set_aside(path)
            if self._entries:
                self._create()
            if path != before or not self._entries:
                remove_durably(before)

    def discard(self) -> None:
        """Remove it: what it holds is given up.

        Raises
        ------
        OSError
            If it cannot be removed.
        """
        self._stop_timer()
        self.settle(frozenset(self._entries), self.path, self.origin)

    def close(self) -> None:
        """Let go; what it holds stays for the next opening.

        Raises
        ------
        OSError
            If not all came to the disk.
        """
        self._stop_timer()
        with self._lock:
            try:
                self.sync()
            finally:
                if self._writer is not None:
                    self._writer.close()
                self._writer = None

    def _stop_timer(self) -> None:
        with self._lock:
            timer, self._timer = self._timer, None
        if timer is not None:
            timer.cancel()
            timer.join()


def remove_durably(path: Path) -> None:
    """Remove a file, if it is there, so that a failure of the system does not bring it back."""
    if os.path.lexists(path):
        path.unlink()
        flush_folder(path.parent)


def set_aside(path: Path) -> Path:
    """Give a journal that belongs to something else another name, and return that."""
    other = free_name(path)
    path.rename(other)
    return other
