"""A classifier's own file ``*.mbclf``: a sealed header, then plain arrays as an ``.npz`` holds them.

Nothing in it is run; what the arrays mean is checked by who asks for them.
"""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from mbstudio.core.errors import ClassifierError
from mbstudio.core.plain_files import PlainFileError, parse_json, read_npz, require_regular
from mbstudio.core.replacement import replacing
from mbstudio.core.sealing import HEADER_BYTES, BrokenSealError, check_seal, read_seal, seal_image

ENDING = ".mbclf"
_MOST_BYTES = 256 << 20


def write_classifier_file(path: Path, entries: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> None:
    """Write entries and arrays in place of `path`; if that fails, `path` stays as it was.

    Raises
    ------
    ClassifierError
        If it cannot be written.
    """
    image = io.BytesIO()
    image.write(b"\0" * HEADER_BYTES)
    text = json.dumps(entries, allow_nan=False).encode("utf-8")
    every: dict[str, Any] = {"entries": np.frombuffer(text, np.uint8), **arrays}
    np.savez_compressed(image, **every)
    seal_image(image.getbuffer())
    try:
        with replacing(path) as temporary:
            temporary.write_bytes(image.getvalue())
    except OSError as error:
        raise ClassifierError(
            f"{path} cannot be written ({error.strerror or error}): save the classifier in another folder."
        ) from error


def read_classifier_file(path: Path) -> tuple[Any, dict[str, np.ndarray]]:
    """Return the entries and arrays of a file, as they were written.

    Raises
    ------
    ClassifierError
        If there is none, or it is damaged or foreign.
    """
    if not path.exists():
        raise ClassifierError(f"{path} does not exist: check the path of the classifier.")
    try:
        require_regular(path)
        with path.open("rb") as stream:
            seal = read_seal(stream.read(HEADER_BYTES))
            if seal is None:
                raise PlainFileError("it does not begin as one")
            check_seal(stream, seal)
        arrays = read_npz(path, _MOST_BYTES)
        entries = parse_json(arrays.pop("entries").tobytes())
    except (PlainFileError, BrokenSealError, OSError, KeyError) as error:
        raise ClassifierError(
            f"{path} is no classifier of mbstudio, or it is damaged ({error}): copy it here again."
        ) from error
    return entries, arrays
