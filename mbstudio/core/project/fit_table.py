"""Fits and the twin as HDF5 datasets: one row a fit, and all control points and histories end to end.

A group a fit would take seconds to write for thousands of grains; columns take milliseconds
and can be read with any HDF5 program.
"""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Callable, Mapping
from dataclasses import asdict
from itertools import pairwise
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, get_args

import h5py
import numpy as np

from mbstudio.core.errors import TwinError
from mbstudio.core.imaging.steps import FitResult, FittedTo, Method
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.metaball.validity import Verdict
from mbstudio.core.project.stored import ContentError, Stored, json_entries

if TYPE_CHECKING:
    import pandas as pd

    from mbstudio.core.twin.kept_twin import KeptTwin

_TEXT = h5py.string_dtype("utf-8")
UNKNOWN_GENUS = -1

# What a row holds beside its control points and histories: name, type, how to take it.
_COLUMNS: tuple[tuple[str, Any, Callable[[FitResult], Any]], ...] = (
    ("method", _TEXT, lambda fit: fit.method),
    ("n", "i8", lambda fit: fit.n),
    ("seed", "i8", lambda fit: fit.seed),
    ("unit", _TEXT, lambda fit: fit.avatar.unit),
    ("name", _TEXT, lambda fit: fit.avatar.name),
    ("avatar_has_label", "?", lambda fit: fit.avatar.label is not None),
    ("avatar_label", "i8", lambda fit: fit.avatar.label or 0),
    ("valid", "?", lambda fit: fit.verdict.valid),
    ("pieces", "i8", lambda fit: fit.verdict.pieces),
    ("voids", "i8", lambda fit: fit.verdict.voids),
    ("genus", "i8", lambda fit: _or_unknown(fit.verdict.genus)),
    ("points_outside", "i8", lambda fit: fit.verdict.points_outside),
    ("volume_error", "f8", lambda fit: fit.verdict.volume_error),
    ("rms", "f8", lambda fit: fit.verdict.rms),
    ("reasons", _TEXT, lambda fit: "\n".join(fit.verdict.reasons)),
    ("warnings", _TEXT, lambda fit: "\n".join(fit.verdict.warnings)),
    ("smallest_neck", "f8", lambda fit: _or_nan(fit.verdict.smallest_neck)),
    ("grain_genus", "i8", lambda fit: _or_unknown(fit.verdict.grain_genus)),
    ("options", _TEXT, lambda fit: json.dumps(dict(fit.options), default=asdict)),
    ("target", _TEXT, lambda fit: fit.target),
    ("reached", _TEXT, lambda fit: json.dumps(dict(fit.reached))),
    ("fitted_to", _TEXT, lambda fit: fit.fitted_to),
)
# Columns that files written before them do not hold, and what stands for the missing values.
_LATER: dict[str, Any] = {
    "smallest_neck": np.nan, "grain_genus": UNKNOWN_GENUS, "warnings": "", "options": "{}", "target": "",
    "reached": "{}", "fitted_to": "labels",
}  # fmt: skip
# The arrays of a fit, in their order where they lie one behind the other.
_ARRAYS: dict[str, Callable[[FitResult], np.ndarray]] = {
    "centers": lambda fit: fit.avatar.centers,
    "weights": lambda fit: fit.avatar.weights,
    "history": lambda fit: fit.history,
    "rms_history": lambda fit: fit.rms_history,
}
_CELLS = struct.Struct("<I")
_KINDS = {"i8": "iu", "?": "b", "f8": "f"}
_LEAST = {
    "n": 1,
    "pieces": 0,
    "voids": 0,
    "points_outside": 0,
    "genus": UNKNOWN_GENUS,
    "grain_genus": UNKNOWN_GENUS,
}


def write_fits(group: h5py.Group, fits: Mapping[int, FitResult]) -> None:
    """Write fits by label into an empty group."""
    results = list(fits.values())
    group["label"] = np.array(list(fits), dtype="i8")
    for name, dtype, take in _COLUMNS:
        group.create_dataset(name, data=[take(fit) for fit in results], shape=(len(results),), dtype=dtype)
    for name, take in _ARRAYS.items():
        tail = (3,) if name == "centers" else ()
        _write_ragged(group, name, [take(fit) for fit in results], tail)


def pack_fit(label: int, fit: FitResult) -> bytes:
    """Return a fit as one run of bytes: the length of its cells, these as JSON, and its arrays."""
    arrays = {name: np.ascontiguousarray(take(fit), dtype="<f8") for name, take in _ARRAYS.items()}
    cells = {"label": int(label), **{name: _kind(dtype)(take(fit)) for name, dtype, take in _COLUMNS}}
    lengths = {name: len(array) for name, array in arrays.items()}
    told = json.dumps({"cells": cells, "lengths": lengths}).encode("ascii")
    return _CELLS.pack(len(told)) + told + b"".join(array.tobytes() for array in arrays.values())


def unpack_fit(packed: bytes) -> tuple[int, FitResult]:
    """Return label and fit of what :func:`pack_fit` made; everything is checked as in a project.

    Raises
    ------
    ContentError
        If it is something else, or no fit can be so.
    AvatarError, UnitError
        If control points or weights make no avatar.
    """
    size = _CELLS.unpack_from(packed)[0] if len(packed) >= _CELLS.size else -1
    if not 0 <= size <= len(packed) - _CELLS.size:
        raise ContentError("a fit has no cells")
    told = json_entries(packed[_CELLS.size : _CELLS.size + size].decode("utf-8", "replace"), "a fit")
    cells, lengths = told.get("cells"), told.get("lengths")
    if not isinstance(cells, dict) or not isinstance(lengths, dict) or type(cells.get("label")) is not int:
        raise ContentError("a fit has no cells, lengths or label")
    found = {name: _one_cell(cells, name, dtype) for name, dtype, _ in (("label", "i8", None), *_COLUMNS)}
    place = _CELLS.size + size
    for name in _ARRAYS:
        length = lengths.get(name)
        numbers = length * (3 if name == "centers" else 1) if type(length) is int else -1
        if not 0 <= numbers <= (len(packed) - place) // 8:
            raise ContentError(f"a fit has no {name}")
        array = np.frombuffer(packed, "<f8", numbers, place).astype("f8")
        found[name] = array.reshape(-1, 3) if name == "centers" else array
        found[f"{name}_offsets"] = np.array([0, length])
        place += 8 * numbers
    if place != len(packed):
        raise ContentError("a fit is followed by bytes that are none of it")
    ((label, fit),) = read_fits(Stored({"": {}}, found, {})).items()
    return label, fit


def _kind(dtype: Any) -> type:
    """Return what the cells of a column are in Python."""
    return str if dtype is _TEXT else {"i8": int, "?": bool, "f8": float}[dtype]


def _one_cell(cells: Mapping[str, Any], name: str, dtype: Any) -> np.ndarray:
    """Return a cell as a column of one row."""
    value = cells.get(name, _LATER.get(name))
    if type(value) is not _kind(dtype) or (type(value) is int and not -(2**63) <= value < 2**63):
        raise ContentError(f"{name} of a fit is missing or of another kind ({value!r:.80})")
    return np.array([value], dtype=object if dtype is _TEXT else dtype)


def read_fits(stored: Stored) -> dict[int, FitResult]:
    """Read fits by label, in the order in which they were written.

    Raises
    ------
    ContentError
        If a dataset is missing, or holds what no fit can have.
    AvatarError, UnitError
        If control points or weights make no avatar.
    """
    labels = stored.numbers("label", "iu")
    if len(np.unique(labels)) < len(labels):
        raise ContentError("fits/label names a grain twice")
    table = {name: _read_column(stored, name, dtype, len(labels)) for name, dtype, _ in _COLUMNS}
    _check_columns(table)
    ragged = {
        name: _read_ragged(stored, name, len(labels), axes)
        for name, axes in zip(_ARRAYS, (2, 1, 1, 1), strict=True)
    }
    rows = {
        label: {name: _plain(values[row]) for name, values in table.items()}
        for row, label in enumerate(labels.tolist())
    }
    return {
        label: _read_fit(cells, {name: parts[row] for name, parts in ragged.items()})
        for row, (label, cells) in enumerate(rows.items())
    }


def _read_fit(cells: dict[str, Any], arrays: dict[str, np.ndarray]) -> FitResult:
    """Return a fit from the cells of its row and its arrays."""
    avatar = Avatar(
        arrays["centers"],
        arrays["weights"],
        cells["unit"],
        label=cells["avatar_label"] if cells["avatar_has_label"] else None,
        name=cells["name"],
    )
    verdict = Verdict(
        valid=cells["valid"],
        pieces=cells["pieces"],
        voids=cells["voids"],
        genus=None if cells["genus"] == UNKNOWN_GENUS else cells["genus"],
        points_outside=cells["points_outside"],
        volume_error=cells["volume_error"],
        rms=cells["rms"],
        reasons=tuple(cells["reasons"].split("\n")) if cells["reasons"] else (),
        warnings=tuple(cells["warnings"].split("\n")) if cells["warnings"] else (),
        smallest_neck=None if np.isnan(cells["smallest_neck"]) else cells["smallest_neck"],
        grain_genus=None if cells["grain_genus"] == UNKNOWN_GENUS else cells["grain_genus"],
    )
    reached = json_entries(cells["reached"], "fits/reached")
    if not all(isinstance(value, int | float) and math.isfinite(value) for value in reached.values()):
        raise ContentError("fits/reached holds something else than finite numbers")
    return FitResult(
        avatar=avatar,
        history=arrays["history"],
        rms_history=arrays["rms_history"],
        verdict=verdict,
        method=cells["method"],
        n=cells["n"],
        seed=cells["seed"],
        options=json_entries(cells["options"], "fits/options"),
        target=cells["target"],
        reached=reached,
        fitted_to=cells["fitted_to"],
    )


def _read_column(stored: Stored, name: str, dtype: Any, rows: int) -> list[str] | np.ndarray:
    if name in _LATER and name not in stored:
        return np.full(rows, _LATER[name], dtype=object if dtype is _TEXT else dtype)
    if dtype is _TEXT:
        return stored.texts(name, rows)
    return stored.numbers(name, _KINDS[dtype], rows=rows, finite=False)


def _check_columns(table: Mapping[str, list[str] | np.ndarray]) -> None:
    """Refuse counts and names that no fit can have."""
    for name, least in _LEAST.items():
        column = np.asarray(table[name])
        if len(column) and column.min() < least:
            raise ContentError(f"fits/{name} holds numbers below {least}")
    if not set(table["method"]) <= set(get_args(Method)):
        raise ContentError("fits/method names a method that there is not")
    if not set(table["fitted_to"]) <= set(get_args(FittedTo)):
        raise ContentError("fits/fitted_to names what nothing is fitted to")


def _or_unknown(genus: int | None) -> int:
    return UNKNOWN_GENUS if genus is None else genus


def _or_nan(value: float | None) -> float:
    return float("nan") if value is None else value


def _plain(value: Any) -> Any:
    return value.item() if isinstance(value, np.generic) else value


def _write_ragged(group: h5py.Group, name: str, arrays: list[np.ndarray], tail: tuple[int, ...] = ()) -> None:
    """Write arrays of different lengths end to end, and where each begins."""
    group[f"{name}_offsets"] = np.cumsum([0, *(len(array) for array in arrays)], dtype="i8")
    joined = np.concatenate(arrays) if arrays else np.empty((0, *tail))
    group.create_dataset(name, data=joined, dtype="f8")


def _read_ragged(stored: Stored, name: str, rows: int, axes: int) -> list[np.ndarray]:
    finite = name in ("centers", "weights")
    joined = stored.numbers(name, "f", axes=axes, finite=finite)
    offsets = stored.numbers(f"{name}_offsets", "iu", rows=rows + 1)
    if offsets[0] != 0 or offsets[-1] != len(joined) or (np.diff(offsets) < 0).any():
        raise ContentError(f"fits/{name}_offsets do not part what fits/{name} holds")
    if axes == 2 and joined.shape[1] != 3:
        raise ContentError(f"fits/{name} holds {joined.shape[1]} coordinates a point")
    return [joined[start:stop].copy() for start, stop in pairwise(offsets.tolist())]


# ---- a twin: two tables, a column a dataset, and all control points end to end ---------------------

_CONTACTS = {
    "a": "i8", "b": "i8", "x": "f8", "y": "f8", "z": "f8", "nx": "f8", "ny": "f8", "nz": "f8", "gap": "f8",
    "gap_deviation": "f8", "probability": "f8", "area": "f8", "kind": _TEXT, "branch_x": "f8",
    "branch_y": "f8", "branch_z": "f8", "touches_border": "?",
}  # fmt: skip
_RESIDUALS = {
    "label": "i8", "n": "i8", "rms": "f8", "peak": "f8", "buried": "f8", "moved": "f8", "converged": "?",
    "shift": "f8", "touches_border": "?", "note": _TEXT,
}  # fmt: skip
_NUMBERS = ("voxel", "blur", "noise")
_TEXTS = ("unit", "tone_model", "void_model")
_MODELS = {"tone_model": ("constant", "linear"), "void_model": ("constant", "quadratic")}
_PROFILES = ("along_x", "along_y", "along_z")
_CONTACT_KINDS = {"point", "facet"}


def write_twin(group: h5py.Group, twin: KeptTwin) -> None:
    """Write a twin into an empty group."""
    for name in (*_NUMBERS, *_TEXTS, "seed"):
        group.attrs[name] = getattr(twin, name)
    group["misfits"] = np.array(twin.misfits, dtype="f8")
    group.attrs["porosity"] = twin.porosity.whole
    for name in _PROFILES:
        group[name] = getattr(twin.porosity, name)
    group.create_dataset("notes", data=json.dumps({"notes": list(twin.notes)}), dtype=_TEXT)
    _write_columns(group.create_group("contacts"), twin.contacts, _CONTACTS)
    _write_columns(group.create_group("residuals"), twin.residuals, _RESIDUALS)
    avatars = list(twin.avatars.values())
    group["label"] = np.array(list(twin.avatars), dtype="i8")
    group.create_dataset("name", data=[avatar.name for avatar in avatars], shape=(len(avatars),), dtype=_TEXT)
    group["offsets"] = np.cumsum([0, *(avatar.n for avatar in avatars)], dtype="i8")
    group["centers"] = np.concatenate([avatar.centers for avatar in avatars] or [np.empty((0, 3))])
    group["weights"] = np.concatenate([avatar.weights for avatar in avatars] or [np.empty(0)])


def _write_columns(group: h5py.Group, table: pd.DataFrame, kinds: dict[str, Any]) -> None:
    for name, kind in kinds.items():
        group.create_dataset(name, data=table[name].tolist(), shape=(len(table),), dtype=kind)


def read_twin(stored: Stored) -> KeptTwin:
    """Read a twin.

    Raises
    ------
    ContentError
        If something is missing, or holds what no twin can have.
    AvatarError, UnitError
        If control points or weights make no avatar.
    """
    from mbstudio.core.twin.kept_twin import KeptTwin
    from mbstudio.core.twin.porosity import Porosity

    facts: dict[str, Any] = {name: stored.attribute(name, float) for name in _NUMBERS}
    facts |= {name: stored.attribute(name, str) for name in _TEXTS}
    if not all(math.isfinite(facts[name]) and facts[name] > 0 for name in _NUMBERS):
        raise ContentError("voxel, blur or noise of twin is no positive number")
    for name, known in _MODELS.items():
        if facts[name] not in known:
            raise ContentError(f"twin/{name} is none of {', '.join(known)}")
    labels = stored.numbers("label", "iu")
    if len(np.unique(labels)) < len(labels):
        raise ContentError("twin/label names a grain twice")
    names = stored.texts("name", len(labels))
    offsets = stored.numbers("offsets", "iu", rows=len(labels) + 1)
    weights = stored.numbers("weights", "f")
    centers = stored.numbers("centers", "f", axes=2, rows=len(weights))
    if offsets[0] != 0 or offsets[-1] != len(weights) or (np.diff(offsets) < 1).any():
        raise ContentError("twin/offsets do not part what twin/weights holds")
    if centers.shape[1] != 3:
        raise ContentError(f"twin/centers holds {centers.shape[1]} coordinates a point")
    avatars = {
        label: Avatar(centers[first:last].copy(), weights[first:last].copy(), facts["unit"], label, name)
        for label, name, (first, last) in zip(labels.tolist(), names, pairwise(offsets.tolist()), strict=True)
    }
    contacts = _read_columns(stored.group("contacts"), _CONTACTS, {"gap", "gap_deviation"})
    if not set(contacts["kind"]) <= _CONTACT_KINDS:
        raise ContentError("twin/contacts/kind names a kind that there is not")
    if not contacts["probability"].between(0.0, 1.0).all():
        raise ContentError("twin/contacts/probability holds what is no probability")
    residuals = _read_columns(stored.group("residuals"), _RESIDUALS, {"moved", "shift"})
    whole = stored.attribute("porosity", float)
    if not 0.0 <= whole <= 1.0:
        raise ContentError("attribute porosity of twin is no share")
    porosity = Porosity(whole, *(stored.numbers(name, "f", finite=False) for name in _PROFILES))
    notes = stored.entries("notes").get("notes")
    if not isinstance(notes, list) or not all(isinstance(note, str) for note in notes):
        raise ContentError("twin/notes holds no notes")
    try:
        return KeptTwin(
            MappingProxyType(avatars),
            contacts,
            residuals,
            misfits=tuple(stored.numbers("misfits", "f").tolist()),
            porosity=porosity,
            notes=tuple(notes),
            seed=stored.attribute("seed", int),
            **facts,
        )
    except TwinError as error:
        raise ContentError(str(error)) from None


def _read_columns(stored: Stored, kinds: dict[str, Any], unknown: set[str]) -> pd.DataFrame:
    """Return a table; columns in `unknown` may hold numbers that are not finite."""
    import pandas as pd  # imported late: it takes a third of a second

    columns: dict[str, Any] = {}
    rows: int | None = None
    for name, kind in kinds.items():
        if kind is _TEXT:
            columns[name] = stored.texts(name, rows)
        else:
            columns[name] = stored.numbers(name, _KINDS[kind], rows=rows, finite=name not in unknown)
        rows = len(columns[name])
    return pd.DataFrame(columns)
