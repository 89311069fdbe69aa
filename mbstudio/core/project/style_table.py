"""How a project file keeps a style-learner and clones: numbers as datasets, the rest as JSON.

``/style`` has ``entries`` (JSON) and one dataset a tensor, by the names of a style-learner's own file;
``/clones`` has ``entries`` and the arrays of the clones, ``/clones/factors`` what was measured of them.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from mbstudio.core.errors import ProjectError

if TYPE_CHECKING:
    from mbstudio.core.populations import Population
    from mbstudio.core.vae.generate.generation import Generation
    from mbstudio.core.vae.models.style_learner import StyleLearner

_TEXTS = h5py.string_dtype("utf-8")
_PACKED: dict[str, Any] = {
    "chunks": True, "compression": "gzip", "compression_opts": 1, "shuffle": True, "fletcher32": True,
}  # fmt: skip


def write_style(group: h5py.Group, learner: StyleLearner) -> None:
    """Write a style-learner into an empty group."""
    from mbstudio.core.vae.models.style_learner import FORMAT, learner_entries, learner_tensors

    group.attrs["format"] = FORMAT
    _write_json(group, "entries", learner_entries(learner))
    for name, array in learner_tensors(learner).items():
        _write_array(group, name, array)


def read_style(group: h5py.Group, path: Path) -> StyleLearner:
    """Return the style-learner of a group.

    Raises
    ------
    ProjectError
        If it is of a newer mbstudio.
    StyleError, KeyError, TypeError, ValueError
        If it is damaged.
    """
    from mbstudio.core.vae.models.style_learner import FORMAT, build_learner

    if int(group.attrs["format"]) > FORMAT:
        raise ProjectError(
            f"The style-learner in {path} is from a newer mbstudio: update mbstudio to open it."
        )
    tensors = {name: group[name][()] for name in group if isinstance(group[name], h5py.Dataset)}
    tensors.pop("entries")
    return build_learner(_read_json(group, "entries"), tensors, path)


def write_clones(group: h5py.Group, clones: Generation) -> None:
    """Write clones into an empty group."""
    from mbstudio.core.vae.serialize.serialization import serialization_arrays

    counts = vars(clones.counts) | {"refused": dict(clones.counts.refused)}
    reached = [vars(figure) for figure in clones.reached]
    entries = {
        "counts": counts, "how": clones.how, "effective": clones.effective, "seed": clones.seed,
        "reached": reached,
    }  # fmt: skip
    _write_json(group, "entries", entries)
    for name, array in serialization_arrays(clones.clones).items():
        _write_array(group, f"avatars/{name}", array)
    for name in ("latents", "parents"):
        _write_array(group, name, getattr(clones, name))
    if clones.factors is not None:
        _write_factors(group.create_group("factors"), clones.factors)


def read_clones(group: h5py.Group, path: Path) -> Generation:
    """Return the clones of a group.

    Raises
    ------
    MbstudioError, KeyError, TypeError, ValueError
        If they are damaged.
    """
    from mbstudio.core.vae.generate.conditions import Reached
    from mbstudio.core.vae.generate.generation import Counts, Generation
    from mbstudio.core.vae.serialize.serialization import build_serialization

    entries = _read_json(group, "entries")
    arrays = {name: _read_array(group["avatars"][name]) for name in group["avatars"]}
    return Generation(
        build_serialization(arrays, str(path)), _read_array(group["latents"]), _read_array(group["parents"]),
        _read_factors(group["factors"]) if "factors" in group else None,
        Counts(**entries["counts"]), str(entries["how"]), float(entries["effective"]),
        tuple(Reached(**figure) for figure in entries["reached"]), int(entries["seed"]),
    )  # fmt: skip


def _write_factors(group: h5py.Group, factors: Population) -> None:
    group.attrs.update(
        name=factors.name, kind=factors.kind, unit=factors.unit, axes=factors.axes, surface=factors.surface,
        columns=list(factors.factors),
    )  # fmt: skip
    group["labels"] = factors.labels
    for name, column in factors.factors.items():
        group[f"columns/{name}"] = column
    for name in ("reasons", "warnings"):
        group.create_dataset(name, data=list(getattr(factors, name)), dtype=_TEXTS)


def _read_factors(group: h5py.Group) -> Population:
    from mbstudio.core.populations import Population

    about = group.attrs
    return Population(
        str(about["name"]), about["kind"], group["labels"][()],
        {str(name): group[f"columns/{name}"][()] for name in about["columns"]},
        str(about["unit"]), str(about["axes"]), str(about["surface"]),
        tuple(group["reasons"].asstr()[:]), tuple(group["warnings"].asstr()[:]),
    )  # fmt: skip


def _write_json(group: h5py.Group, name: str, value: Any) -> None:
    # A dataset: an attribute holds 64 KiB at most, and a card names every parent.
    group.create_dataset(name, data=json.dumps(value, default=_plain), dtype=_TEXTS)


def _plain(value: Any) -> Any:
    """Return one of numpy's numbers as Python's own."""
    return value.item()


def _read_json(group: h5py.Group, name: str) -> Any:
    return json.loads(group[name].asstr()[()])


def _write_array(group: h5py.Group, name: str, array: np.ndarray) -> None:
    array = np.asarray(array)
    if array.dtype.kind == "U":
        group.create_dataset(name, data=array.astype(object), dtype=_TEXTS)
    elif array.ndim and array.size:
        group.create_dataset(name, data=array, **_PACKED)
    else:
        group[name] = array


def _read_array(dataset: h5py.Dataset) -> np.ndarray:
    if h5py.check_string_dtype(dataset.dtype):
        return np.array(dataset.asstr()[()], dtype=np.str_)
    return np.asarray(dataset[()])
