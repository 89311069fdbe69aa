"""The files of a Zarr folder or archive, none of which may lie outside it."""

from __future__ import annotations

import os
import stat
import zipfile
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

from mbstudio.core.errors import ScanError

# Documents are small; consolidated metadata of thousands of arrays reach some megabytes.
_LARGEST_DOCUMENT = 64 * 2**20
DOCUMENTS = ("zarr.json", ".zarray", ".zgroup", ".zattrs")


class ZarrFiles(Protocol):
    """What is stored under keys such as ``labels/grains/0/c/0/1/2``."""

    path: Path

    def size(self, key: str) -> int | None:
        """Return how many bytes there are, None if there is no such file."""
        ...

    def read(self, key: str, start: int = 0, count: int | None = None) -> bytes:
        """Return the bytes of a file, or a part of them."""
        ...

    def children(self, key: str) -> list[str]:
        """Return the names of the folders directly within one."""
        ...

    def within(self, key: str) -> Iterator[tuple[str, int]]:
        """Yield the keys below one, relative to it, with their sizes."""
        ...


def open_files(path: Path) -> ZarrFiles:
    """Return the files of a folder, or of an archive.

    Raises
    ------
    ScanError
        If an archive is none, or damaged.
    """
    return FolderFiles(path) if path.is_dir() else ArchiveFiles(path)


def document(files: ZarrFiles, key: str) -> bytes | None:
    """Return a document, None if it is not there; ScanError if it is too large to be one."""
    size = files.size(key)
    if size is None:
        return None
    if size > _LARGEST_DOCUMENT:
        raise ScanError(
            f"{files.path} holds {size:,} bytes in {key}, too many for what it is: export it again."
        )
    return files.read(key)


def checked_key(key: str, files: ZarrFiles) -> str:
    """Return a path within the folder without needless slashes; ScanError if it leads out of it."""
    parts = [part for part in key.split("/") if part]
    if any(part in (".", "..") or "\\" in part or ":" in part or "\0" in part for part in parts):
        raise ScanError(
            f"{files.path} names '{key}', outside its own folder: put all parts into one folder and "
            "export it again."
        )
    return "/".join(parts)


class FolderFiles:
    """The files of a folder.

    Parameters
    ----------
    path : Path
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._root = os.path.realpath(path)

    def _place(self, key: str) -> str:
        """Return where a key lies; ScanError if a link leads out of the folder."""
        real = os.path.realpath(Path(self._root, *key.split("/")))
        if real != self._root and not real.startswith(self._root + os.sep):
            raise ScanError(
                f"{self.path} holds {key} as a link to another folder: copy what is linked into it."
            )
        return real

    def size(self, key: str) -> int | None:
        try:
            found = Path(self._place(key)).stat()
        except OSError:
            return None
        return found.st_size if stat.S_ISREG(found.st_mode) else None

    def read(self, key: str, start: int = 0, count: int | None = None) -> bytes:
        with Path(self._place(key)).open("rb") as stream:
            stream.seek(start)
            return stream.read(-1 if count is None else count)

    def children(self, key: str) -> list[str]:
        try:
            with os.scandir(self._place(key)) as entries:
                return sorted(entry.name for entry in entries if entry.is_dir())
        except OSError:
            return []

    def within(self, key: str) -> Iterator[tuple[str, int]]:
        top = self._place(key)
        for folder, _, names in os.walk(top):
            inside = os.path.relpath(folder, top).replace(os.sep, "/")
            for name in names:
                size = self.size(
                    "/".join(part for part in (key, "" if inside == "." else inside, name) if part)
                )
                if size is not None:
                    yield (name if inside == "." else f"{inside}/{name}"), size


class ArchiveFiles:
    """The files of a ZIP archive, of which none is unpacked beyond the size that it states.

    Parameters
    ----------
    path : Path

    Raises
    ------
    ScanError
        If it is no archive, or damaged.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._archive = zipfile.ZipFile(path)
        except (zipfile.BadZipFile, ValueError, EOFError, NotImplementedError) as error:
            raise ScanError(
                f"{path} is not a ZIP archive, or is cut off or damaged ({error}): copy or export it again."
            ) from error
        entries = {
            info.filename: info for info in self._archive.infolist() if not info.filename.endswith("/")
        }
        prefix = self._prefix(entries)
        self._entries = {
            name.removeprefix(prefix): info for name, info in entries.items() if name.startswith(prefix)
        }

    def _prefix(self, entries: dict[str, zipfile.ZipInfo]) -> str:
        """Return the one folder in which all lies, if it does; some programs pack the folder itself."""
        if any(name in entries for name in DOCUMENTS):
            return ""
        tops = {name.partition("/")[0] for name in entries}
        return f"{tops.pop()}/" if len(tops) == 1 else ""

    def size(self, key: str) -> int | None:
        info = self._entries.get(key)
        return None if info is None else info.file_size

    def read(self, key: str, start: int = 0, count: int | None = None) -> bytes:
        info = self._entries[key]
        try:
            with self._archive.open(info) as stream:
                if start:
                    stream.seek(start)
                return stream.read(info.file_size if count is None else count)
        except (zipfile.BadZipFile, zlib.error, EOFError, OSError, RuntimeError, NotImplementedError,
                ValueError) as error:  # fmt: skip
            raise ScanError(
                f"{self.path} holds {key} in a way that cannot be unpacked ({error}): it is "
                "damaged, encrypted or "
                "packed unusually; unpack the archive and open the folder."
            ) from error

    def children(self, key: str) -> list[str]:
        start = f"{key}/" if key else ""
        inside = (name[len(start) :] for name in self._entries if name.startswith(start))
        return sorted({name.partition("/")[0] for name in inside if "/" in name})

    def within(self, key: str) -> Iterator[tuple[str, int]]:
        start = f"{key}/" if key else ""
        for name, info in self._entries.items():
            if name.startswith(start):
                yield name[len(start) :], info.file_size
