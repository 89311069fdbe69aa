"""Digests of records: whether a state of the project is still what it was when it was made."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass

import numpy as np
import pandas as pd
import torch


def digest(value: object) -> str:
    """Return the SHA-256 of a record with all that it holds."""
    found = hashlib.sha256()
    _feed(found, value)
    return found.hexdigest()


def _feed(found: hashlib._Hash, value: object) -> None:
    found.update(type(value).__name__.encode())
    if isinstance(value, np.ndarray):
        found.update(f"{value.shape} {value.dtype}".encode())
        if value.dtype.hasobject:
            _feed(found, value.tolist())
        else:
            found.update(np.ascontiguousarray(value).tobytes())
    elif isinstance(value, torch.Tensor):
        _feed(found, value.detach().cpu().numpy())
    elif isinstance(value, torch.nn.Module):
        _feed(found, value.state_dict())
    elif isinstance(value, pd.DataFrame):
        for name in value.columns:
            _feed(found, str(name))
            _feed(found, value[name].to_numpy())
    elif isinstance(value, Mapping):
        for key in sorted(value, key=repr):
            _feed(found, key)
            _feed(found, value[key])
    elif isinstance(value, frozenset | set):
        _feed(found, sorted(value, key=repr))
    elif isinstance(value, Sequence) and not isinstance(value, str | bytes):
        for part in value:
            _feed(found, part)
    elif is_dataclass(value):
        for field in fields(value):
            _feed(found, field.name)
            _feed(found, getattr(value, field.name))
    elif not callable(value):
        found.update(repr(value).encode())
    found.update(b";")
