"""Serialized avatars on disk: an .npz file of plain arrays."""

from __future__ import annotations

import os
import zipfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from mbstudio.core.errors import SerializationError
from mbstudio.core.vae.serialization import Serialization, Template

_ARRAYS = ("centers", "log_weights", "diameters", "rms", "valid")
_TEMPLATE = ("centers", "log_weights", "exchange")


def serialization_arrays(serialization: Serialization) -> dict[str, np.ndarray]:
    """Return serialized avatars as plain arrays, by the names that they have in a file."""
    stiffness = serialization.template.stiffness
    return {
        **({} if stiffness is None else {"template_stiffness": stiffness}),
        **{f"template_{name}": getattr(serialization.template, name) for name in _TEMPLATE},
        **{name: getattr(serialization, name) for name in _ARRAYS},
        "unit": np.array(serialization.unit),
        "names": np.array(serialization.names, dtype=np.str_),
    }


def serialization_of(arrays: Mapping[str, np.ndarray], source: str = "The file") -> Serialization:
    """Return the serialized avatars of plain arrays.

    Raises
    ------
    SerializationError
        If an array is missing, or what they hold are no serialized avatars.
    """
    wanted = [*(f"template_{name}" for name in _TEMPLATE), *_ARRAYS, "unit", "names"]
    missing = [name for name in wanted if name not in arrays]
    if missing:
        raise SerializationError(f"{source} holds no serialized avatars: '{missing[0]}' is missing.")
    return Serialization(
        Template(
            **{name: arrays[f"template_{name}"] for name in _TEMPLATE},
            stiffness=arrays.get("template_stiffness"),
        ),
        **{name: arrays[name] for name in _ARRAYS},
        unit=str(arrays["unit"]),
        names=tuple(str(name) for name in arrays["names"]),
    )


def save_serialization(serialization: Serialization, path: str | Path) -> None:
    """Write serialized avatars to an .npz file; it is written beside its place and renamed over it.

    Raises
    ------
    SerializationError
        If the file cannot be written.
    """
    path = Path(path)
    beside = path.with_name(path.name + ".part")
    try:
        with beside.open("wb") as stream:
            np.savez_compressed(stream, **serialization_arrays(serialization))  # type: ignore[arg-type]
            stream.flush()
            os.fsync(stream.fileno())
        beside.replace(path)
    except OSError as error:
        raise SerializationError(f"{path} cannot be written ({error}).") from error


def load_serialization(path: str | Path) -> Serialization:
    """Read serialized avatars that `save_serialization` wrote.

    Raises
    ------
    SerializationError
        If the file cannot be read, or holds none.
    """
    try:
        with np.load(path, allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
    except (OSError, ValueError, zipfile.BadZipFile, EOFError) as error:
        raise SerializationError(f"{path} cannot be read as serialized avatars ({error}).") from error
    return serialization_of(arrays, str(path))
