"""How a project file keeps the grains of the latent studio: ``/kept/entries``, one JSON text a grain.

JSON writes a number with as many digits as it takes to read the same number back, so that a latent vector
makes the same grain again bit by bit.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING

import h5py

from mbstudio.core.project.stored import Stored, json_entries

if TYPE_CHECKING:
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
