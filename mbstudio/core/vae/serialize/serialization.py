"""Serialized avatars: control point i means the same in every one of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from mbstudio.core.errors import MbstudioError, SerializationError
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.plain_files import PlainFileError, read_npz
from mbstudio.core.replacement import replacing
from mbstudio.core.units import parse_unit

_ARRAYS = ("centers", "log_weights", "diameters", "rms", "valid")
_TEMPLATE = ("centers", "log_weights", "exchange")


FLIPS = np.array([[1 - 2 * (f & 1), 1 - (f & 2), 1 - (f >> 1 & 2)] for f in range(8)], dtype=np.float64)
"""Signs of (x, y, z) of the eight flips of the principal axes, shape (8, 3); the first changes nothing."""


@dataclass(frozen=True, eq=False)
class Template:
    """The control points from which every avatar of a population is fitted.

    As a set they are mirror-symmetric in the three planes of the principal axes, so that a flipped avatar
    is serialized by flipping its coordinates and exchanging its control points: an exact augmentation.

    Attributes
    ----------
    centers : float array, shape (n, 3)
        In nominal diameters D_n, along the long, middle and short principal axis. Read-only.
    log_weights : float array, shape (n,)
        ln k, k in D_n**2. Read-only.
    exchange : int array, shape (8, n)
        Row f: the control point that takes place i after flip f of `FLIPS`. Read-only.
    stiffness : float array, shape (4 n, 4 n), or None
        How strongly a fit is held to the template: symmetric and positive definite, the weight of
        squares and products of the changes of all ln k (in units of 0.5), then of all x, y, z (in 0.1 D_n).
        Soft where the population varies, so that a body is made of the changes that others
        show too. None holds every change alike. Read-only.

    Raises
    ------
    SerializationError
        If shapes disagree, values are not finite, or the points are not symmetric.
    """

    centers: Float[np.ndarray, "n 3"]
    log_weights: Float[np.ndarray, " n"]
    exchange: Int[np.ndarray, "8 n"]
    stiffness: Float[np.ndarray, "m m"] | None = None

    def __post_init__(self) -> None:
        centers = np.array(self.centers, dtype=np.float64)
        log_weights = np.array(self.log_weights, dtype=np.float64)
        exchange = np.array(self.exchange, dtype=np.int64)
        n = len(log_weights)
        if centers.shape != (n, 3) or exchange.shape != (8, n) or n < 1:
            raise SerializationError(
                f"A template has centers of shape {centers.shape}, log weights of shape {log_weights.shape} "
                f"and exchanges of shape {exchange.shape}: they must be (n, 3), (n,) and (8, n)."
            )
        if not (np.isfinite(centers).all() and np.isfinite(log_weights).all()):
            raise SerializationError("A template has control points or weights that are not finite numbers.")
        if not np.array_equal(np.sort(exchange, axis=1), np.tile(np.arange(n), (8, 1))):
            raise SerializationError(
                "The exchanges of a template must be permutations of its control points."
            )
        flipped = np.stack([centers[row] * signs for row, signs in zip(exchange, FLIPS, strict=True)])
        if not (
            np.allclose(flipped, centers, atol=1e-6)
            and np.allclose(log_weights[exchange], log_weights, atol=1e-6)
        ):
            raise SerializationError("The control points of a template are not symmetric under its flips.")
        if self.stiffness is not None:
            stiffness = np.array(self.stiffness, dtype=np.float64)
            if stiffness.shape != (4 * n, 4 * n) or not np.isfinite(stiffness).all():
                raise SerializationError(
                    f"A template of {n} control points has a stiffness of shape {stiffness.shape}: "
                    f"it must be ({4 * n}, {4 * n}), of finite numbers."
                )
            stiffness.flags.writeable = False
            object.__setattr__(self, "stiffness", stiffness)
        for name, array in (("centers", centers), ("log_weights", log_weights), ("exchange", exchange)):
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @property
    def n(self) -> int:
        """Number of control points."""
        return len(self.log_weights)


@dataclass(frozen=True, eq=False)
class Serialization:
    """Avatars in one common frame (centroid, principal axes, unit D_n), point i the same in each.

    Attributes
    ----------
    template : Template
    centers : float array, shape (avatars, n, 3)
        Control points in D_n. Read-only.
    log_weights : float array, shape (avatars, n)
        ln k, k in D_n**2. Read-only.
    diameters : float array, shape (avatars,)
        Nominal diameter D_n of each body in `unit`: its size, kept apart from its shape. Read-only.
    unit : str
        Canonical length unit of the diameters.
    names : tuple of str
        One an avatar, for tables.
    rms : float array, shape (avatars,)
        Root mean square distance of avatar and grain over the grain's surface in D_n; NaN where there is
        no grain (clones). Read-only.
    valid : bool array, shape (avatars,)
        Whether each is one piece without void and holds all its control points. Read-only.

    Raises
    ------
    SerializationError
        If shapes disagree, values are not finite, or a diameter is not positive.
    """

    template: Template
    centers: Float[np.ndarray, "avatars n 3"]
    log_weights: Float[np.ndarray, "avatars n"]
    diameters: Float[np.ndarray, " avatars"]
    unit: str
    names: tuple[str, ...]
    rms: Float[np.ndarray, " avatars"]
    valid: Bool[np.ndarray, " avatars"]

    def __post_init__(self) -> None:
        count, n = len(self.names), self.template.n
        shapes = {
            "centers": (count, n, 3), "log_weights": (count, n), "diameters": (count,),
            "rms": (count,), "valid": (count,),
        }  # fmt: skip
        for name, shape in shapes.items():
            array = np.array(getattr(self, name), dtype=np.bool_ if name == "valid" else np.float64)
            if array.shape != shape:
                raise SerializationError(
                    f"Serialized avatars have {name} of shape {array.shape}, not {shape}."
                )
            if name not in ("rms", "valid") and not np.isfinite(array).all():
                raise SerializationError(f"Serialized avatars have {name} that are not finite numbers.")
            array.flags.writeable = False
            object.__setattr__(self, name, array)
        if count and self.diameters.min() <= 0:
            raise SerializationError("Serialized avatars have a nominal diameter that is not positive.")
        object.__setattr__(self, "unit", parse_unit(self.unit))
        object.__setattr__(self, "names", tuple(self.names))

    def __len__(self) -> int:
        return len(self.names)

    def avatar(self, i: int) -> Avatar:
        """Return avatar `i` in its principal frame, in `unit`."""
        size = float(self.diameters[i])
        return Avatar(
            self.centers[i] * size, np.exp(self.log_weights[i]) * size**2, self.unit, name=self.names[i]
        )

    def avatars(self) -> list[Avatar]:
        """Return all avatars in their principal frames, in `unit`."""
        return [self.avatar(i) for i in range(len(self))]

    def take(self, rows: Sequence[int] | Int[np.ndarray, " rows"]) -> Serialization:
        """Return the avatars of these rows, in this order."""
        chosen = np.asarray(rows, dtype=np.int64)
        arrays = {
            name: getattr(self, name)[chosen]
            for name in ("centers", "log_weights", "diameters", "rms", "valid")
        }
        return replace(self, names=tuple(self.names[i] for i in chosen), **arrays)

    def flipped(self, flips: Int[np.ndarray, " avatars"]) -> Serialization:
        """Return each avatar mirrored by its flip of `FLIPS`, its control points exchanged to fit.

        Parameters
        ----------
        flips : int array, shape (avatars,)
            Row of `FLIPS` for each avatar; 0 leaves it as it is.
        """
        flips = np.asarray(flips, dtype=np.int64)
        exchange = self.template.exchange[flips]
        centers = np.take_along_axis(self.centers, exchange[:, :, None], axis=1) * FLIPS[flips][:, None, :]
        return replace(
            self, centers=centers, log_weights=np.take_along_axis(self.log_weights, exchange, axis=1)
        )


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


def build_serialization(arrays: Mapping[str, np.ndarray], source: str = "The file") -> Serialization:
    """Return the serialized avatars of plain arrays.

    Raises
    ------
    SerializationError
        If an array is missing, or what they hold are no serialized avatars.
    """
    wanted = [*(f"template_{name}" for name in _TEMPLATE), *_ARRAYS, "unit", "names"]
    missing = [name for name in wanted if name not in arrays]
    if missing:
        raise SerializationError(f"{source} contains no serialized avatars: '{missing[0]}' is missing.")
    # Texts of a project file arrive as objects.
    kinds = {"unit": "UO", "names": "UO", "valid": "b"}
    for name in [*wanted, *(["template_stiffness"] if "template_stiffness" in arrays else [])]:
        if arrays[name].dtype.kind not in kinds.get(name, "fiu"):
            raise SerializationError(
                f"{source} contains no serialized avatars: '{name}' holds {arrays[name].dtype}."
            )
    if arrays["unit"].ndim or arrays["names"].ndim != 1:
        raise SerializationError(f"{source} contains no serialized avatars: its unit or names are none.")
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
    try:
        with replacing(path) as temporary, temporary.open("wb") as stream:
            np.savez_compressed(stream, **serialization_arrays(serialization))  # type: ignore[arg-type]
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
        arrays = read_npz(Path(path))
    except PlainFileError as error:
        raise SerializationError(f"{path} cannot be read as serialized avatars ({error}).") from error
    try:
        return build_serialization(arrays, str(path))
    except MbstudioError as error:
        if str(path) in str(error):
            raise
        raise SerializationError(f"{path} is damaged: {error}") from error
