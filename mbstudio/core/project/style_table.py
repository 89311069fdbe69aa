"""How a project file keeps a style-learner and clones: numbers as datasets, the rest as JSON.

``/style`` has ``entries`` (JSON) and one dataset a tensor, by the names of a style-learner's own file;
``/clones`` has ``entries`` and the arrays of the clones, ``/clones/factors`` what was measured of them.
``/surfaces`` has ``entries`` and the numbers of a style of surfaces as its own folder has them, and
``/surface_clones`` the same of its clones: surfaces of record, recipes and metaballs, end to end.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from mbstudio.core.errors import ProjectError
from mbstudio.core.project.stored import ContentError, Stored

if TYPE_CHECKING:
    from mbstudio.core.cloning.surface_generation import SurfaceGeneration
    from mbstudio.core.cloning.surface_style import SurfaceStyle
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


def read_style(stored: Stored, path: Path) -> StyleLearner:
    """Return the style-learner of a group.

    Raises
    ------
    ProjectError
        If it is of a newer mbstudio.
    StyleError, ContentError, KeyError, TypeError, ValueError
        If it is damaged.
    """
    from mbstudio.core.vae.models.style_learner import FORMAT, build_learner, require_finite

    if stored.attribute("format", int) > FORMAT:
        raise ProjectError(
            f"The style-learner in {path} is from a newer mbstudio: update mbstudio to open it."
        )
    tensors = {name: stored.array(name) for name in stored.names() if name != "entries"}
    if any(array.dtype == object for array in tensors.values()):
        raise ContentError(f"{stored.path} holds texts where numbers are due")
    require_finite(tensors, path)
    return build_learner(stored.entries("entries"), tensors, path)


def write_clones(group: h5py.Group, clones: Generation) -> None:
    """Write clones into an empty group."""
    from mbstudio.core.vae.serialize.serialization import serialization_arrays

    counts = vars(clones.counts) | {"refused": dict(clones.counts.refused)}
    reached = [figure.as_record() for figure in clones.reached]
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


def read_clones(stored: Stored, path: Path) -> Generation:
    """Return the clones of a group.

    Raises
    ------
    MbstudioError, ContentError, KeyError, TypeError, ValueError
        If they are damaged.
    """
    from mbstudio.core.vae.generate.conditions import Reached
    from mbstudio.core.vae.generate.generation import Counts, Generation
    from mbstudio.core.vae.serialize.serialization import build_serialization

    entries = stored.entries("entries")
    avatars = stored.group("avatars")
    arrays = {name: avatars.array(name) for name in avatars.names()}
    clones = build_serialization(arrays, str(path))
    parents = stored.numbers("parents", "iu", rows=len(clones))
    if len(parents) and parents.min() < -1:
        raise ContentError("clones/parents names rows below -1")
    factors = _read_factors(stored.group("factors")) if "factors" in stored else None
    if factors is not None and len(factors) != len(clones):
        raise ContentError("clones/factors are not of all clones")
    return Generation(
        clones, stored.numbers("latents", "f", axes=2, rows=len(clones)), parents, factors,
        Counts(**entries["counts"]), str(entries["how"]), float(entries["effective"]),
        tuple(Reached.from_record(figure) for figure in entries["reached"]), int(entries["seed"]),
    )  # fmt: skip


def write_surfaces(group: h5py.Group, style: SurfaceStyle) -> None:
    """Write a style of surfaces into an empty group."""
    from mbstudio.core.cloning.surface_style_file import style_entries, style_tensors

    _write_json(group, "entries", style_entries(style))
    for name, array in style_tensors(style).items():
        _write_array(group, name, array)


def read_surfaces(stored: Stored) -> SurfaceStyle:
    """Return the style of surfaces of a group.

    Raises
    ------
    MbstudioError, ContentError, AttributeError, LookupError, TypeError, ValueError
        If it is damaged.
    """
    from mbstudio.core.cloning.surface_style_file import build_surface_style

    return build_surface_style(stored.entries("entries"), _tensors(stored))


def write_surface_clones(group: h5py.Group, clones: SurfaceGeneration) -> None:
    """Write clones of surfaces into an empty group."""
    from mbstudio.core.cloning.surface_generation_file import generation_entries, generation_tensors

    _write_json(group, "entries", generation_entries(clones))
    for name, array in generation_tensors(clones).items():
        _write_array(group, name, array)
    _write_factors(group.create_group("factors"), clones.factors)


def read_surface_clones(stored: Stored) -> SurfaceGeneration:
    """Return the clones of surfaces of a group.

    Raises
    ------
    MbstudioError, ContentError, AttributeError, LookupError, TypeError, ValueError
        If they are damaged.
    """
    from mbstudio.core.cloning.surface_generation_file import build_generation

    factors = _read_factors(stored.group("factors"))
    return build_generation(stored.entries("entries"), _tensors(stored), factors)


def _tensors(stored: Stored) -> dict[str, np.ndarray]:
    """Return all numbers of a group, known to be finite."""
    found = {name: stored.array(name) for name in stored.names() if name != "entries"}
    for name, array in found.items():
        if array.dtype.kind not in "iuf" or (array.dtype.kind == "f" and not np.isfinite(array).all()):
            raise ContentError(f"{stored.path}/{name} holds values that are no finite numbers")
    return found


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


def _read_factors(stored: Stored) -> Population:
    from mbstudio.core.populations import Population

    names = stored.attributes().get("columns")
    if not isinstance(names, list) or stored.attribute("kind", str) != "clones":
        raise ContentError(f"{stored.path} are no factors of clones")
    return Population(
        stored.attribute("name", str), "clones", stored.numbers("labels", "iu"),
        {str(name): stored.numbers(f"columns/{name}", "iuf", finite=False) for name in names},
        stored.attribute("unit", str), stored.attribute("axes", str), stored.attribute("surface", str),
        tuple(stored.texts("reasons")), tuple(stored.texts("warnings")),
    )  # fmt: skip


def _write_json(group: h5py.Group, name: str, value: Any) -> None:
    # A dataset: an attribute holds 64 KiB at most, and a card names every parent.
    group.create_dataset(name, data=json.dumps(value, default=_plain), dtype=_TEXTS)


def _plain(value: Any) -> Any:
    """Return one of numpy's numbers as Python's own."""
    return value.item()


def _write_array(group: h5py.Group, name: str, array: np.ndarray) -> None:
    array = np.asarray(array)
    if array.dtype.kind == "U":
        group.create_dataset(name, data=array.astype(object), dtype=_TEXTS)
    elif array.ndim and array.size:
        group.create_dataset(name, data=array, **_PACKED)
    else:
        group[name] = array
