"""Corrupt a file of an export, and see that reading it back refuses it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from mbstudio.core.dem import validate
from mbstudio.core.errors import ExportError

Change = Callable[[str], str]


def assert_refused(folder: Path, name: str, change: Change, message: str) -> None:
    """Change a file of an export, expect ExportError naming it, and put it back."""
    path = folder / name
    text = path.read_bytes()
    changed = change(text.decode("latin-1")).encode("latin-1")
    assert changed != text, "the corruption must change the file"
    try:
        path.write_bytes(changed)
        with pytest.raises(ExportError, match=message) as caught:
            validate(folder, digests=False)
        assert str(path) in str(caught.value)
    finally:
        path.write_bytes(text)
    validate(folder)


def assert_arrays_refused(folder: Path, name: str, change: Callable[[dict], None], message: str) -> None:
    """Change the arrays of an .npz file in place, expect ExportError naming it, and put it back."""
    path = folder / name
    stored = path.read_bytes()
    with np.load(path) as arrays:
        content = {key: arrays[key].copy() for key in arrays.files}
    change(content)
    try:
        np.savez(path, **content)
        with pytest.raises(ExportError, match=message) as caught:
            validate(folder, digests=False)
        assert str(path) in str(caught.value)
    finally:
        path.write_bytes(stored)
    validate(folder)
