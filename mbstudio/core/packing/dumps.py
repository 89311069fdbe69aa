"""Dumps of LAMMPS and LIGGGHTS: the spheres of the last frame of a text file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from mbstudio.core.errors import PackingError
from mbstudio.core.plain_files import PlainFileError, read_plain_text

_TIME, _NUMBER, _BOX, _ATOMS = "ITEM: TIMESTEP", "ITEM: NUMBER OF ATOMS", "ITEM: BOX BOUNDS", "ITEM: ATOMS"
_MOST_BYTES = 2**30
_PLACES = (("xu", "yu", "zu"), ("x", "y", "z"))


@dataclass(frozen=True, eq=False)
class Frame:
    """Spheres at one time.

    Attributes
    ----------
    step : int
    ids : int array, shape (spheres,)
        Rising.
    places : float array, shape (spheres, 3)
        In the unit of the dump.
    widths : float array, shape (3,)
        Of the box where its sides are periodic, infinity elsewhere or where places are unwrapped.
    """

    step: int
    ids: Int[np.ndarray, " spheres"]
    places: Float[np.ndarray, "spheres 3"]
    widths: Float[np.ndarray, " 3"]


def is_dump(path: Path) -> bool:
    """Return whether a file begins as a dump of LAMMPS does."""
    try:
        with path.open("rb") as stream:
            return stream.read(len(_TIME)) == _TIME.encode()
    except OSError:
        return False


def read_last_frame(path: Path) -> Frame:
    """Return the last frame of a dump.

    Raises
    ------
    PackingError
        If the file cannot be read, is no dump, or is cut off.
    """
    try:
        lines = read_plain_text(path, _MOST_BYTES).splitlines()
    except (OSError, PlainFileError) as error:
        raise PackingError(f"{path} cannot be read: {error}") from error
    starts = [number for number, line in enumerate(lines) if line.strip() == _TIME]
    if not starts:
        raise PackingError(f"{path} is no dump of LAMMPS or LIGGGHTS: it has no line '{_TIME}'.")
    try:
        return _parse(iter(lines[starts[-1] + 1 :]))
    except (StopIteration, ValueError, IndexError, OverflowError) as error:
        raise PackingError(
            f"{path} is cut off or damaged in its last frame: let the engine finish, or remove that frame."
        ) from error
    except KeyError as error:
        raise PackingError(
            f"{path} has no column {error}: dump 'id x y z' or 'id xu yu zu', as the decks of mbstudio do."
        ) from error


def _parse(lines: Iterator[str]) -> Frame:
    step = int(next(lines))
    _require(next(lines), _NUMBER)
    count = int(next(lines))
    bounds = next(lines)
    _require(bounds, _BOX)
    periodic = [word == "pp" for word in bounds.removeprefix(_BOX).split()[-3:]]
    box = [[float(word) for word in next(lines).split()[:2]] for _ in range(3)]
    header = next(lines)
    _require(header, _ATOMS)
    columns = {name: place for place, name in enumerate(header.removeprefix(_ATOMS).split())}
    names = next((names for names in _PLACES if set(names) <= set(columns)), None)
    if "id" not in columns or names is None:
        raise KeyError("id" if "id" not in columns else "x")
    rows = [next(lines).split() for _ in range(count)]
    if any(len(row) != len(columns) for row in rows):
        raise ValueError("a row is short")
    ids = np.array([int(row[columns["id"]]) for row in rows], dtype=np.int64)
    places = np.array([[float(row[columns[name]]) for name in names] for row in rows]).reshape(-1, 3)
    if not np.isfinite(places).all():
        raise ValueError("a place is not finite")
    order = np.argsort(ids, kind="stable")
    widths = np.array(
        [
            high - low if is_periodic and names == _PLACES[1] else np.inf
            for (low, high), is_periodic in zip(box, [*periodic, False, False, False], strict=False)
        ]
    )
    return Frame(step, ids[order], places[order], widths)


def _require(line: str, start: str) -> None:
    if not line.startswith(start):
        raise ValueError(f"'{line}' is not '{start}'")


def find_poses(
    frame: Frame,
    clumps: Sequence[Float[np.ndarray, "n 3"]],
    kinds: Int[np.ndarray, " count"],
    scales: Float[np.ndarray, " count"],
    tolerance: float,
    where: str,
) -> tuple[Float[np.ndarray, "count 3"], Float[np.ndarray, "count 3 3"]]:
    """Lay each grain's clump onto its spheres; return positions of the centres of mass, and rotations.

    Parameters
    ----------
    frame : Frame
        Whose spheres lie grain after grain by their numbers, each grain's in the order of its clump.
    clumps : sequence of float array, shape (n, 3)
        Centres of the spheres of each kind, in its principal frame and the unit of the frame.
    kinds, scales : arrays
    tolerance : float
        How far a sphere may be from its place in the clump, over the clump's extent.
    where : str
        The file, for messages.

    Raises
    ------
    PackingError
        If the spheres are not those of the clumps.

    References
    ----------
    Kabsch (1976), Acta Crystallographica A 32, 922.
    """
    expected = int(sum(len(clumps[kind]) for kind in kinds))
    if len(frame.ids) != expected:
        what = "cut off, or grains were lost" if len(frame.ids) < expected else "of other grains"
        raise PackingError(f"{where} is {what}: it has {len(frame.ids)} spheres, the specimen {expected}.")
    positions, rotations, start = np.empty((len(kinds), 3)), np.empty((len(kinds), 3, 3)), 0
    for grain, (kind, scale) in enumerate(zip(kinds, scales, strict=True)):
        local = scale * clumps[kind]
        placed = frame.places[start : start + len(local)]
        start += len(local)
        apart = placed - placed[0]
        steps = np.where(np.isfinite(frame.widths), np.round(apart / frame.widths), 0.0)
        placed = placed - steps * np.where(np.isfinite(frame.widths), frame.widths, 0.0)
        turn, place = _superpose(local, placed)
        extent = float(np.linalg.norm(local - local.mean(axis=0), axis=1).max())
        off = float(np.linalg.norm(local @ turn.T + place - placed, axis=1).max())
        if off > tolerance * max(extent, 1e-300):
            raise PackingError(
                f"{where} is of other grains: the spheres of grain {grain + 1} are up to {off:.3g} from "
                "those of its clump."
            )
        positions[grain], rotations[grain] = place, turn
    return positions, rotations


def _superpose(
    local: Float[np.ndarray, "n 3"], placed: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, " 3"]]:
    """Return the rotation and shift that bring points nearest to others."""
    middle, center = local.mean(axis=0), placed.mean(axis=0)
    u, _, v = np.linalg.svd((placed - center).T @ (local - middle))
    turn = u @ np.diag([1.0, 1.0, float(np.sign(np.linalg.det(u @ v)))]) @ v
    return turn, center - turn @ middle
