"""Poses: which grain lies where, turned how; and their table in a CSV file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from mbstudio.core.dem.specimen.placing import rotations_of
from mbstudio.core.errors import PackingError
from mbstudio.core.plain_files import PlainFileError, read_plain_text
from mbstudio.core.replacement import replacing

COLUMNS = ("avatar", "scale", "x", "y", "z", "qw", "qx", "qy", "qz")
_UNIT_LENGTH = 1e-4
"""How far the length of a quaternion may be from one: files of other programs have six digits, or fewer."""


@dataclass(frozen=True, eq=False)
class Poses:
    """Where grains lie: ``x_world = position + scale R(quaternion) x_principal``.

    Attributes
    ----------
    kinds : int array, shape (count,)
        Which avatar each grain is.
    scales : float array, shape (count,)
        Its size over the avatar's.
    positions : float array, shape (count, 3)
        Centres of mass.
    quaternions : float array, shape (count, 4)
        Orientations (w, x, y, z) of the principal axes, of length 1.
    """

    kinds: Int[np.ndarray, " count"]
    scales: Float[np.ndarray, " count"]
    positions: Float[np.ndarray, "count 3"]
    quaternions: Float[np.ndarray, "count 4"]

    def __len__(self) -> int:
        return len(self.kinds)

    @cached_property
    def rotations(self) -> Float[np.ndarray, "count 3 3"]:
        """The orientations as matrices."""
        return rotations_of(self.quaternions)


def require_rotations(quaternions: Float[np.ndarray, "count 4"], where: str) -> Float[np.ndarray, "count 4"]:
    """Return quaternions made exactly of length 1.

    Raises
    ------
    PackingError
        If one is no rotation.
    """
    with np.errstate(over="ignore"):  # a length beyond all numbers is not 1 either
        lengths = np.linalg.norm(quaternions, axis=1)
    wrong = np.flatnonzero(~(np.abs(lengths - 1.0) <= _UNIT_LENGTH))
    if len(wrong):
        first = int(wrong[0])
        raise PackingError(
            f"{where} has a pose that is no rotation: the quaternion of grain {first + 1} has the length "
            f"{lengths[first]:.4g}, not 1."
        )
    unit: np.ndarray = quaternions / lengths[:, None]
    return unit


def write_poses(path: Path, poses: Poses, names: Sequence[str]) -> None:
    """Write a row for each grain, in the unit of the packing."""
    lines = [",".join(COLUMNS)]
    for kind, *numbers in zip(
        poses.kinds, poses.scales, *poses.positions.T, *poses.quaternions.T, strict=True
    ):
        lines.append(",".join([names[kind], *(f"{number:.12g}" for number in numbers)]))
    with replacing(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def read_poses(path: Path, names: Sequence[str], metres: float = 1.0) -> Poses:
    """Read a table of poses: that of :func:`write_poses`, ``specimen.csv`` of an export, or one of one's own.

    Columns are found by their names; ``scale`` may be missing, others are passed over. Places in columns
    ``x_m``, ``y_m``, ``z_m``, as ``settled.csv`` of Kratos, Yade and peclet-dem has them, are in metres.

    Parameters
    ----------
    path : Path
    names : sequence of str
        Of the avatars.
    metres : float
        Of the unit that places in metres are turned into.

    Raises
    ------
    PackingError
        If the file cannot be read, is cut off, names other avatars, or has a pose that is no rotation.
    """
    try:
        lines = [line for line in read_plain_text(path).splitlines() if line.strip()]
    except (OSError, PlainFileError) as error:
        raise PackingError(f"{path} cannot be read: {error}") from error
    header = [word.strip() for word in lines[0].split(",")] if lines else []
    in_metres = "x" not in header and {"x_m", "y_m", "z_m"} <= set(header)
    if in_metres:
        header = [{"x_m": "x", "y_m": "y", "z_m": "z"}.get(word, word) for word in header]
    missing = [name for name in COLUMNS if name not in header and name != "scale"]
    if missing:
        raise PackingError(f"{path} has no column '{missing[0]}': a table of poses has {', '.join(COLUMNS)}.")
    known = {name: kind for kind, name in enumerate(names)}
    kinds, rows = [], []
    for number, line in enumerate(lines[1:], start=1):
        words = dict(zip(header, (word.strip() for word in line.split(",")), strict=False))
        try:
            row = [float(words.get(name, "1" if name == "scale" else "")) for name in COLUMNS[1:]]
        except ValueError as error:
            raise PackingError(
                f"{path} is cut off or damaged: row {number} has no number in each of its columns."
            ) from error
        name = words.get("avatar", "")
        if name not in known:
            raise PackingError(f"{path} is of other grains: there is no avatar '{name:.40}' here.")
        kinds.append(known[name])
        rows.append(row)
    table = np.array(rows, dtype=float).reshape(-1, 8)
    if not len(table) or not np.isfinite(table).all() or table[:, 0].min() <= 0:
        raise PackingError(
            f"{path} has no grains, or numbers that are not finite, or a scale that is not positive."
        )
    places = table[:, 1:4] / metres if in_metres else table[:, 1:4]
    return Poses(np.array(kinds), table[:, 0], places, require_rotations(table[:, 4:], str(path)))
