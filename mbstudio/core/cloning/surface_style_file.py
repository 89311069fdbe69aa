"""Styles of surfaces as folders: a card of what JSON can hold, and the surfaces beside it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mbstudio.core.cloning.parent_surface import MOST_FACES, ParentSurface
from mbstudio.core.cloning.solid_moments import solid_moments
from mbstudio.core.cloning.surface_avatar import SurfaceAvatar
from mbstudio.core.cloning.surface_style import SurfaceStyle
from mbstudio.core.errors import CloningError, MbstudioError, StyleWarning
from mbstudio.core.meshes.edges import EdgeTable
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.tensor_folder import TensorFolder, Tensors
from mbstudio.core.units import parse_unit
from mbstudio.core.version import __version__

_FOLDER = TensorFolder(
    stem="surface-style", kind="mbstudio surface style", title="style of surfaces", newest=1,
    error=CloningError, warning=StyleWarning, made_again="learn it again",
)  # fmt: skip
CARD_FILE = _FOLDER.card
_MOST_PARENTS = 100_000


def holds_surface_style(folder: Path) -> bool:
    """Return whether a folder is one of a style of surfaces, whatever its state."""
    return (folder / CARD_FILE).is_file()


def save_surface_style(style: SurfaceStyle, folder: str | Path) -> Path:
    """Write a style into a folder and return it; an older one there is replaced.

    Raises
    ------
    CloningError
        If the folder cannot be written.
    """
    return _FOLDER.write(Path(folder), style_entries(style), style_tensors(style))


def style_entries(style: SurfaceStyle) -> dict[str, Any]:
    """Return what JSON can hold of a style, for any file that keeps one."""
    return {
        "names": [parent.name for parent in style.parents], "unit": style.unit, "misfit": style.misfit,
        "mbstudio": __version__,
    }  # fmt: skip


def style_tensors(style: SurfaceStyle) -> Tensors:
    """Return the numbers of a style, for any file that keeps one."""
    parents, avatars = style.parents, style.avatars
    tensors: Tensors = {
        "modes": style.modes,
        "vertices": np.concatenate([parent.vertices for parent in parents]),
        "faces": np.concatenate([parent.faces for parent in parents]).astype(np.int32),
        "counts": np.array([[len(parent.vertices), len(parent.faces)] for parent in parents], dtype=np.int64),
        "semi_axes": np.stack([parent.semi_axes for parent in parents]),
        "diameters": np.array([parent.diameter for parent in parents]),
    }
    if avatars:
        tensors |= avatar_tensors(avatars)
    return tensors


def avatar_tensors(avatars: Sequence[SurfaceAvatar]) -> Tensors:
    """Return the numbers of metaballs fitted to surfaces, by names that begin with ``avatars.``."""
    return {
        "avatars.centers": np.concatenate([entry.avatar.centers for entry in avatars]),
        "avatars.weights": np.concatenate([entry.avatar.weights for entry in avatars]),
        "avatars.counts": np.array([len(entry.avatar.weights) for entry in avatars], dtype=np.int64),
        "avatars.errors": np.array([[entry.rms, entry.volume_error] for entry in avatars]),
        "avatars.valid": np.array([entry.valid for entry in avatars], dtype=np.uint8),
    }


def load_surface_style(folder: str | Path) -> SurfaceStyle:
    """Return the style that was saved in a folder.

    Raises
    ------
    CloningError
        If there is none, or a file is damaged, foreign, or from a newer mbstudio; it names the file.
    """
    folder = Path(folder)
    path = folder / CARD_FILE
    entries = _FOLDER.read_card(folder)
    try:
        tensors, weights = _FOLDER.read_tensors(folder, entries)
        _FOLDER.require_finite(tensors, weights)
        return build_surface_style(entries, tensors)
    except (AttributeError, IndexError, KeyError, OverflowError, TypeError, ValueError) as error:
        told = " ".join(str(error).split())[:200]
        raise CloningError(
            f"{path} is incomplete ({type(error).__name__}: {told}): learn the style again."
        ) from None
    except MbstudioError as error:
        if str(folder) in str(error):
            raise
        raise CloningError(f"{path} cannot be used as a style of surfaces: {error}") from error


def build_surface_style(entries: Mapping[str, Any], tensors: Tensors) -> SurfaceStyle:
    """Return the style of entries and finite numbers as a file holds them.

    Raises
    ------
    CloningError, UnitError, AttributeError, IndexError, KeyError, OverflowError, TypeError, ValueError
        If they belong to none.
    """
    unit = parse_unit(str(entries["unit"]))
    names = entries["names"]
    counts = tensors["counts"]
    if not (isinstance(names, list) and all(isinstance(name, str) for name in names)):
        raise ValueError("'names' are no texts")
    if counts.shape != (len(names), 2) or not 0 < len(names) <= _MOST_PARENTS or counts.min() < 4:
        raise ValueError(f"'counts' of shape {counts.shape}")
    for name, wanted in (("semi_axes", (len(names), 3)), ("diameters", (len(names),))):
        if tensors[name].shape != wanted or not (tensors[name] > 0).all():
            raise ValueError(f"'{name}' of shape {tensors[name].shape}, or not positive")
    vertices = split_rows(tensors, "vertices", counts[:, 0])
    faces = split_rows(tensors, "faces", counts[:, 1])
    parents = tuple(
        _parent(name, corners, triangles.astype(np.int64), semi_axes, float(diameter), unit)
        for name, corners, triangles, semi_axes, diameter in zip(
            names, vertices, faces, tensors["semi_axes"], tensors["diameters"], strict=True
        )
    )
    misfit = float(entries["misfit"])
    if not (np.isfinite(misfit) and misfit >= 0):
        raise ValueError(f"'misfit' {misfit}")
    avatars = build_avatars([parent.name for parent in parents], unit, tensors)
    return SurfaceStyle(parents, tensors["modes"], misfit, avatars)


def split_rows(tensors: Tensors, name: str, counts: np.ndarray) -> list[np.ndarray]:
    """Return the rows of each of many bodies; ValueError if there are not so many, or not three columns."""
    array = tensors[name]
    if array.ndim != 2 or array.shape[1] != 3 or len(array) != int(counts.sum()):
        raise ValueError(f"'{name}' of shape {array.shape}")
    return np.split(array, np.cumsum(counts)[:-1])


def _parent(
    name: str, vertices: np.ndarray, faces: np.ndarray, semi_axes: np.ndarray, diameter: float, unit: str
) -> ParentSurface:
    require_closed(vertices, faces, name)
    return ParentSurface(name, vertices, faces, semi_axes, diameter, unit)


def require_closed(vertices: np.ndarray, faces: np.ndarray, name: str) -> None:
    """Raise ValueError unless a surface is closed and wound outwards."""
    if len(faces) > MOST_FACES or faces.min() < 0 or faces.max() >= len(vertices):
        raise ValueError(f"the triangles of '{name}'")
    edges = EdgeTable.from_faces(faces)
    if not (edges.is_closed and edges.is_consistent and solid_moments(vertices, faces).volume > 0):
        raise ValueError(f"the surface of '{name}', which is not closed")


def build_avatars(names: Sequence[str], unit: str, tensors: Tensors) -> tuple[SurfaceAvatar, ...]:
    """Return the metaballs of :func:`avatar_tensors`, one for each name; none where there are none.

    Raises
    ------
    AvatarError, KeyError, ValueError
        If they are damaged.
    """
    if "avatars.counts" not in tensors:
        return ()
    counts, errors, valid = (tensors[f"avatars.{name}"] for name in ("counts", "errors", "valid"))
    if counts.shape != (len(names),) or errors.shape != (len(names), 2) or valid.shape != (len(names),):
        raise ValueError("'avatars'")
    centers = split_rows(tensors, "avatars.centers", counts)
    weights = np.split(tensors["avatars.weights"], np.cumsum(counts)[:-1])
    return tuple(
        SurfaceAvatar(Avatar(places, k, unit, name=name), float(error[0]), float(error[1]), bool(sound))
        for name, places, k, error, sound in zip(names, centers, weights, errors, valid, strict=True)
    )
