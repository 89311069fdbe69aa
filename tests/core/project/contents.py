"""What a project holds, as plain JSON: to compare files that different versions of mbstudio wrote.

Arrays are told by type, shape and digest, so that the last bit counts.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np

from mbstudio.core.grains.editing import LabelVolume

_WRITTEN_AS = {"is_met": "met", "label_volume": "labels"}
"""Names in files of fields that are called otherwise by now."""


def describe(value: Any) -> Any:
    """Return a record, mapping, table, array or number as JSON can hold it."""
    if isinstance(value, LabelVolume):
        return describe(value.whole())
    if is_dataclass(value):
        return {
            _WRITTEN_AS.get(field.name, field.name): describe(getattr(value, field.name))
            for field in fields(value)
        }
    if isinstance(value, Mapping):
        return {str(key): describe(item) for key, item in value.items()}
    if hasattr(value, "to_dict") and hasattr(value, "columns"):
        return {str(name): value[name].tolist() for name in value.columns}
    if isinstance(value, np.ndarray):
        digest = hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()[:16]
        return f"{value.dtype.str} {list(value.shape)} {digest}"
    if isinstance(value, list | tuple):
        return [describe(item) for item in value]
    if isinstance(value, np.generic):
        return value.item()
    if value is None or isinstance(value, bool | int | float | str):
        return value
    return {"kind": type(value).__name__, **{name: describe(item) for name, item in vars(value).items()}}


def differences(before: Any, now: Any, place: str = "project") -> list[str]:
    """Return where `now` is not what `before` says; what `before` does not know may be there."""
    if isinstance(before, dict) and isinstance(now, dict):
        found = [f"{place}.{key} is missing" for key in before.keys() - now.keys()]
        for key in before.keys() & now.keys():
            found += differences(before[key], now[key], f"{place}.{key}")
        return found
    if isinstance(before, list) and isinstance(now, list) and len(before) == len(now):
        pairs = enumerate(zip(before, now, strict=True))
        return [word for at, (one, other) in pairs for word in differences(one, other, f"{place}[{at}]")]
    same = before == now or (before != before and now != now)  # what is not known stays so
    return [] if same else [f"{place}: {before!r} became {now!r}"]
