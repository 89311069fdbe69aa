"""Opening a project file: nothing of it is understood before its seal is compared."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import BinaryIO

from mbstudio.core.errors import DamagedProjectError, ProjectError, ProjectWarning
from mbstudio.core.sealing import HEADER_BYTES, BrokenSealError, Seal, check_seal, read_seal

_SIGNATURE = b"\x89HDF\r\n\x1a\n"


@contextmanager
def open_sealed(path: Path) -> Iterator[tuple[BinaryIO, Seal | None]]:
    """Open a project file for reading, at its beginning, once its seal was found whole; give the seal too.

    HDF5 files without one are given with None. What is read later comes from the file that was compared, also
    if another one takes its place meanwhile.

    Raises
    ------
    DamagedProjectError
        If the file is not what was written.
    ProjectError
        If it is missing, cannot be read, or is no project file.
    """
    with _opened(path) as stream:
        head = stream.read(HEADER_BYTES)
        seal = read_seal(head)
        if seal is not None:
            try:
                check_seal(stream, seal)
            except BrokenSealError as error:
                raise _damaged(path, str(error), seal, stream) from None
        elif not head.startswith(_SIGNATURE):
            if stream.read(len(_SIGNATURE)) == _SIGNATURE:
                raise _damaged(path, "its first 512 bytes are not those that were written", None, stream)
            raise ProjectError(
                f"{path} is not an mbstudio project, or its beginning is damaged: open a copy that was "
                "saved earlier, or copy it here again."
            )
        stream.seek(0)
        yield stream, seal


def warn_unsealed(path: Path) -> None:
    """Tell that nobody can know whether a file of an earlier mbstudio is as it was written."""
    warnings.warn(
        f"{path} is from an mbstudio that did not seal its files: whether it is as it was written cannot be "
        "told. Save it once to seal it.",
        ProjectWarning,
        stacklevel=3,
    )


def identify(path: Path) -> str | None:
    """Return what tells a project file from any other that was ever at its place; None if there is none.

    That is the digest of its header, which names the digest of all the rest; of a file without a seal its
    length and the time of its last change.
    """
    try:
        with path.open("rb") as stream:
            seal = read_seal(stream.read(HEADER_BYTES))
            told = os.fstat(stream.fileno())
    except OSError:
        return None
    return f"{told.st_size} bytes, {told.st_mtime_ns}" if seal is None else seal.header


@contextmanager
def _opened(path: Path) -> Iterator[BinaryIO]:
    # Also keeps away pipes and devices, which give no end.
    if not path.is_file():
        raise ProjectError(f"{path} does not exist or is not a file: check the name and the folder.")
    try:
        stream = path.open("rb")
    except PermissionError as error:
        raise ProjectError(f"{path} cannot be read: you have no permission to open it.") from error
    except OSError as error:
        raise ProjectError(f"{path} cannot be read ({error.strerror or error}).") from error
    with stream:
        yield stream


def _damaged(path: Path, reason: str, seal: Seal | None, stream: BinaryIO) -> DamagedProjectError:
    changed = datetime.fromtimestamp(os.fstat(stream.fileno()).st_mtime, UTC).isoformat(timespec="seconds")
    saved = "" if seal is None else f" It was whole when mbstudio {seal.version} saved it at {seal.saved}."
    return DamagedProjectError(
        f"{path} is damaged ({reason}).{saved} The system says that it was last changed at {changed}; "
        "nothing in it can be trusted since, and nothing of it was read. Open another copy: a backup, or the "
        "work that the window offers at its next start where it ended unexpectedly."
    )
