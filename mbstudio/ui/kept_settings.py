"""What the window's settings say, read with suspicion: anybody may write into their file."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from PySide6.QtCore import QByteArray, QSettings

_MOST_DIGITS = 9


def whole_number(settings: QSettings, name: str, default: int, least: int, most: int) -> int:
    """Return a number that is kept, moved between its bounds; the default where there is none."""
    digits, _, rest = str(settings.value(name, default)).strip().partition(".")
    is_number = digits.isascii() and digits.isdecimal() and (rest.isdecimal() or not rest)
    if not is_number or len(digits) > _MOST_DIGITS:
        return default
    return min(max(int(digits), least), most)


def record(settings: QSettings, name: str) -> dict[str, Any]:
    """Return what is kept as JSON under names; nothing where somebody has spoilt it."""
    text = settings.value(name)
    try:
        found = json.loads(text) if isinstance(text, str) else {}
    except (ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def words(value: object) -> list[str]:
    """Return a list of words as it is; nothing where it is anything else."""
    if isinstance(value, list | tuple) and all(isinstance(word, str) for word in value):
        return list(value)
    return []


def files_that_exist(settings: QSettings, name: str) -> list[Path]:
    """Return those of the files kept under a name that are there and may be looked at."""
    kept = settings.value(name)
    found = []
    for word in words([kept] if isinstance(kept, str) else kept):
        try:
            if word and Path(word).exists():
                found.append(Path(word))
        except OSError:  # no file can have such a name, or its folder is another person's
            continue
    return found


def places(value: object) -> list[list[float]] | None:
    """Return three places in space, none of them endless; None where it is anything else."""
    if not isinstance(value, list) or len(value) != 3:
        return None
    for place in value:
        if not isinstance(place, list) or len(place) != 3:
            return None
        if not all(type(number) in (int, float) and abs(number) < _FARTHEST for number in place):
            return None
    return [[float(number) for number in place] for place in value]


_FARTHEST = 1e15
"""No camera stands farther away; a number that is none is not nearer than this."""


def see_from(value: object) -> list[list[float]] | None:
    """Return position, focal point and upward direction of a camera; None where nothing could be seen."""
    found = places(value)
    if found is None:
        return None
    position, focus, up = found
    ahead = [end - start for start, end in zip(position, focus, strict=True)]
    # Whoever looks along his own upward direction has no left and right.
    across = (
        ahead[1] * up[2] - ahead[2] * up[1],
        ahead[2] * up[0] - ahead[0] * up[2],
        ahead[0] * up[1] - ahead[1] * up[0],
    )
    return found if math.hypot(*across) > 1e-9 * math.hypot(*ahead) * math.hypot(*up) > 0 else None


def stored_bytes(settings: QSettings, name: str) -> QByteArray | None:
    """Return what Qt had to keep; None where it is anything else."""
    found = settings.value(name)
    return found if isinstance(found, QByteArray) else None
