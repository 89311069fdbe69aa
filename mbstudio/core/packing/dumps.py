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
    owners : int array, shape (spheres,), or None
        Which grain each sphere belongs to, where the dump tells (``mol``).
    radii : float array, shape (spheres,), or None
    half : float
        Half the width of the box.
    """

    step: int
    ids: Int[np.ndarray, " spheres"]
    places: Float[np.ndarray, "spheres 3"]
    widths: Float[np.ndarray, " 3"]
    owners: Int[np.ndarray, " spheres"] | None = None
    radii: Float[np.ndarray, " spheres"] | None = None
    half: float = float("nan")


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
    owners = radii = None
    if {"mol", "radius"} <= set(columns):
        owners = np.array([int(row[columns["mol"]]) for row in rows], dtype=np.int64)[order]
        radii = np.array([float(row[columns["radius"]]) for row in rows])[order]
        if not np.isfinite(radii).all() or (radii <= 0).any():
            raise ValueError("a radius is not positive")
    half = (box[0][1] - box[0][0]) / 2
    return Frame(step, ids[order], places[order], widths, owners, radii, half)


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
        place, turn, off, extent = _lay(local, placed, frame.widths)
        if off > tolerance * extent:
            raise PackingError(
                f"{where} is of other grains: the spheres of grain {grain + 1} are up to {off:.3g} from "
                "those of its clump."
            )
        positions[grain], rotations[grain] = place, turn
    return positions, rotations


@dataclass(frozen=True, eq=False)
class FoundGrains:
    """Grains of a dump that tells owners and radii: their kinds, sizes and poses, in the unit of the dump."""

    kinds: Int[np.ndarray, " count"]
    scales: Float[np.ndarray, " count"]
    positions: Float[np.ndarray, "count 3"]
    rotations: Float[np.ndarray, "count 3 3"]


def find_grains(
    frame: Frame, clumps: Sequence[Float[np.ndarray, "n 4"]], tolerance: float, where: str
) -> FoundGrains:
    """Find what grain each body of a dump is, by the radii of its spheres, and how it lies.

    Parameters
    ----------
    frame : Frame
        With owners and radii; the spheres of each grain by their numbers as in its clump.
    clumps : sequence of float array, shape (n, 4)
        Centres and radii of the spheres of each kind, in its principal frame and the unit of the frame.
    tolerance : float
        How far a sphere may be from its place in the clump, over the clump's extent; the same for radii, over
        their mean.
    where : str
        The file, for messages.

    Raises
    ------
    PackingError
        If the dump does not tell owners and radii, or the spheres of a grain are those of no clump.
    """
    if frame.owners is None or frame.radii is None:
        raise PackingError(
            f"{where} does not tell which sphere is whose: name the specimen.csv of its export (specimen), "
            "or dump 'id mol x y z radius'."
        )
    kinds, scales, places, turns = [], [], [], []
    order = np.argsort(frame.owners, kind="stable")
    starts = np.flatnonzero(np.diff(frame.owners[order], prepend=frame.owners[order][:1] - 1))
    for grain, mine in enumerate(np.split(order, starts[1:]) if len(order) else [], start=1):
        radii, best = frame.radii[mine], (np.inf, -1, 1.0)
        for kind, clump in enumerate(clumps):
            if len(clump) == len(mine):
                scale = float(radii.sum() / clump[:, 3].sum())
                off = float(np.abs(radii - scale * clump[:, 3]).max() / radii.mean())
                best = min(best, (off, kind, scale))
        off, kind, scale = best
        if off <= tolerance:
            local = scale * clumps[kind][:, :3]
            place, turn, away, extent = _lay(local, frame.places[mine], frame.widths)
            off = away / extent
        if off > tolerance:
            raise PackingError(
                f"{where} is of other grains: the {len(mine)} spheres of grain {grain} are those of no "
                "clump here."
            )
        kinds.append(kind)
        scales.append(scale)
        places.append(place)
        turns.append(turn)
    if not kinds:
        raise PackingError(f"{where} has no grains in its last frame.")
    return FoundGrains(np.array(kinds), np.array(scales), np.array(places), np.array(turns))


def _lay(
    local: Float[np.ndarray, "n 3"], placed: Float[np.ndarray, "n 3"], widths: Float[np.ndarray, " 3"]
) -> tuple[Float[np.ndarray, " 3"], Float[np.ndarray, "3 3"], float, float]:
    """Return where a clump lies, how it is turned, how far a sphere is off, and the clump's extent."""
    apart = placed - placed[0]
    steps = np.where(np.isfinite(widths), np.round(apart / widths), 0.0)
    placed = placed - steps * np.where(np.isfinite(widths), widths, 0.0)
    turn, place = _superpose(local, placed)
    extent = max(float(np.linalg.norm(local - local.mean(axis=0), axis=1).max()), 1e-300)
    return place, turn, float(np.linalg.norm(local @ turn.T + place - placed, axis=1).max()), extent


def _superpose(
    local: Float[np.ndarray, "n 3"], placed: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, " 3"]]:
    """Return the rotation and shift that bring points nearest to others."""
    middle, center = local.mean(axis=0), placed.mean(axis=0)
    u, _, v = np.linalg.svd((placed - center).T @ (local - middle))
    turn = u @ np.diag([1.0, 1.0, float(np.sign(np.linalg.det(u @ v)))]) @ v
    return turn, center - turn @ middle
