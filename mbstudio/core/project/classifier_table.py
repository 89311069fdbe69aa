"""How a project file keeps strokes and a classifier of voxels: ``/strokes`` and ``/classifier``.

``/strokes/entries`` has one JSON text a stroke, ``/classifier`` has ``entries`` (JSON) and one dataset an
array, by the names of a classifier's own file.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import h5py

from mbstudio.core.project.grain_table import PACKED
from mbstudio.core.project.stored import ContentError, Stored, json_entries

if TYPE_CHECKING:
    from mbstudio.core.grains.classifying import Stroke, VoxelClassifier

_TEXTS = h5py.string_dtype("utf-8")


def write_strokes(group: h5py.Group, strokes: Sequence[Stroke]) -> None:
    """Write strokes into an empty group."""
    group.create_dataset("entries", data=[json.dumps(one.to_record()) for one in strokes], dtype=_TEXTS)


def read_strokes(stored: Stored) -> tuple[Stroke, ...]:
    """Return the strokes of a group.

    Raises
    ------
    ClassifierError, ContentError
        If they are damaged.
    """
    from mbstudio.core.grains.classifying import Stroke

    return tuple(
        Stroke.from_record(json_entries(text, "strokes/entries")) for text in stored.texts("entries")
    )


def write_classifier(group: h5py.Group, classifier: VoxelClassifier) -> None:
    """Write a classifier into an empty group."""
    group.create_dataset("entries", data=json.dumps(classifier.entries), dtype=_TEXTS)
    for name, array in classifier.arrays.items():
        group.create_dataset(name, data=array, chunks=True, **PACKED)


def read_classifier(stored: Stored, path: Path) -> VoxelClassifier:
    """Return the classifier of a group.

    Raises
    ------
    ClassifierError, ContentError
        If it is damaged, or of other features.
    """
    from mbstudio.core.grains.classifying.voxel_classifier import build_classifier

    arrays = {name: stored.array(name) for name in stored.names() if name != "entries"}
    if any(array.dtype == object for array in arrays.values()):
        raise ContentError(f"{stored.path} holds texts where numbers are due")
    return build_classifier(stored.entries("entries"), arrays, f"The classifier in {path}")
