"""How a project file keeps what was made by hand or by an engine: grains of the latent studio, and packings.

``/kept/entries`` is one JSON text a grain. JSON writes a number with as many digits as it takes to read the
same number back, so that a latent vector makes the same grain again bit by bit. ``/packing`` has the entries
and arrays of a trial, see mbstudio.core.packing.trial_file.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING

import h5py
import numpy as np

from mbstudio.core.project.grain_table import PACKED
from mbstudio.core.project.stored import ContentError, Stored, json_entries

if TYPE_CHECKING:
    from mbstudio.core.packing.trial import PackingTrial
    from mbstudio.core.vae.shaping.kept_grain import KeptGrain

_TEXTS = h5py.string_dtype("utf-8")


def write_kept(group: h5py.Group, kept: Sequence[KeptGrain]) -> None:
    """Write kept grains into an empty group."""
    group.create_dataset("entries", data=[json.dumps(grain.as_record()) for grain in kept], dtype=_TEXTS)


def read_kept(stored: Stored) -> tuple[KeptGrain, ...]:
    """Return the kept grains of a group.

    Raises
    ------
    StyleError, ContentError
        If they are damaged.
    """
    from mbstudio.core.vae.shaping.kept_grain import read_kept_grain

    return tuple(read_kept_grain(json_entries(text, "kept/entries")) for text in stored.texts("entries"))


def write_packing_trial(group: h5py.Group, trial: PackingTrial) -> None:
    """Write a trial into an empty group."""
    from mbstudio.core.packing.trial_file import trial_arrays, trial_entries

    text = json.dumps(trial_entries(trial), default=lambda number: number.item())
    group.create_dataset("entries", data=text, dtype=_TEXTS)
    for name, array in trial_arrays(trial).items():
        if array.size:
            group.create_dataset(name, data=array, **PACKED)
        else:
            group[name] = array


def read_packing_trial(stored: Stored) -> PackingTrial:
    """Return the trial of a group.

    Raises
    ------
    MbstudioError, ContentError, LookupError, TypeError, ValueError
        If it is damaged.
    """
    from mbstudio.core.packing.trial_file import build_trial

    arrays = {name: stored.array(name) for name in stored.names() if name != "entries"}
    for name, array in arrays.items():
        if array.dtype.kind not in "iuf" or (array.dtype.kind == "f" and not np.isfinite(array).all()):
            raise ContentError(f"{stored.path}/{name} holds values that are no finite numbers")
    return build_trial(stored.entries("entries"), arrays)
