"""Which sealed files this person's mbstudio wrote itself: those carry a mark that nobody else can make.

The mark is an HMAC of the seal with a key in the person's configuration folder. Files with it are read in
this process, all others in one that can do no harm: see :mod:`mbstudio.core.project.stored_reading`. Without
the mark a file is as good, it only takes some tenths of a second longer to open.
"""

from __future__ import annotations

import contextlib
import hashlib
import hmac
import os
import secrets
from functools import cache
from pathlib import Path

from platformdirs import user_config_path

_KEY_BYTES = 32
NO_MARK = "0" * 64


def mark_of(digest: str) -> str:
    """Return the mark of a file with this seal, 64 hexadecimal digits; `NO_MARK` if no key can be kept."""
    key = _key(user_config_path("mbstudio", appauthor=False) / "seal.key")
    return NO_MARK if key is None else hmac.new(key, digest.encode("ascii"), hashlib.sha256).hexdigest()


def is_own(digest: str, mark: str) -> bool:
    """Return whether a file with this seal was written by this person's mbstudio."""
    return mark != NO_MARK and hmac.compare_digest(mark_of(digest).encode(), mark.encode())


@cache
def _key(path: Path) -> bytes | None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with contextlib.suppress(FileExistsError):
            handle = os.open(path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600)
            with os.fdopen(handle, "wb") as stream:
                stream.write(secrets.token_bytes(_KEY_BYTES))
        key = path.read_bytes()
    except OSError:  # a home that cannot be written: all files are read as a stranger's
        return None
    return key if len(key) == _KEY_BYTES else None
