"""How true avatars are against their number of control points: a sweep over grains and n."""

from __future__ import annotations

import csv
import io
import json
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from mbstudio.core.errors import FitError, MbstudioError
from mbstudio.core.grains.grain import Grain
from mbstudio.core.imaging.fitting import start_fit
from mbstudio.core.imaging.goals.likeness import Likeness
from mbstudio.core.imaging.options import make_options
from mbstudio.core.imaging.steps import FitResult, Method, SearchStep
from mbstudio.core.plain_files import PlainFileError, parse_json, read_plain_text

UNKNOWN = float("nan")
MEASURES = ("overlap_error", "hausdorff", "rms")
"""Errors of a row beside those of the shape factors, each a share."""


@dataclass(frozen=True, eq=False)
class SweepRow:
    """One fit of a sweep, and how true it is.

    Attributes
    ----------
    label : int
        The grain's label; its place among the grains where it has none.
    name : str
        The grain's.
    n : int
        Control points asked for.
    method : {'fast', 'paper'}
    seed : int
    loss : float
        The paper's mean loss at the end of the search.
    rms : float
        Root mean square surface distance over D_n.
    volume_error : float
        (V_avatar - V_grain) / V_grain, as in the verdict.
    iou : float
        Intersection over union with the grain's voxels.
    hausdorff : float
        Hausdorff distance of the surfaces over D_n.
    errors : mapping
        Relative error of every shape factor, avatar over grain minus one, by name; empty where they are not
        defined.
    valid : bool
    seconds : float
        CPU time of the fit, without the measuring.
    error : str
        Why there is no fit, or no factors; empty if all went well.
    options : mapping
        Those of the method's options that are not at their defaults.
    """

    label: int
    name: str
    n: int
    method: Method
    seed: int
    loss: float = UNKNOWN
    rms: float = UNKNOWN
    volume_error: float = UNKNOWN
    iou: float = UNKNOWN
    hausdorff: float = UNKNOWN
    errors: Mapping[str, float] = field(default_factory=dict)
    valid: bool = False
    seconds: float = UNKNOWN
    error: str = ""
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def overlap_error(self) -> float:
        """What is not shared: 1 - iou."""
        return 1.0 - self.iou

    def error_of(self, name: str) -> float:
        """Return an error by its name, a share without sign: one of `MEASURES` or of a shape factor."""
        value: float = abs(getattr(self, name) if name in MEASURES else self.errors.get(name, UNKNOWN))
        return value


class Sweep:
    """Step object of a sweep: an iterator of :class:`SweepRow`, one after every fit.

    Grain by grain, each with rising n, so that one grain at a time is held and measured. Dropping the
    iterator between two rows, or raising in `on_step`, cancels; the fit that was cut short is begun anew when
    ``next`` is called again. ``fit(grain, n, method, seed)`` gives each row's avatar again.

    Parameters
    ----------
    grains : iterable of Grain
        Cut out one at a time if it is lazy.
    numbers : sequence of int
        Numbers of control points; sorted, each once.
    method, seed, **options : as in :func:`mbstudio.core.imaging.fit`
    done : iterable of SweepRow
        Rows of an earlier sweep: those with the same label, number, method, seed and options are not done
        again, and are not yielded.
    on_step : callable, optional
        Called with every step of every fit.

    Attributes
    ----------
    rows : list of SweepRow
        All so far, those of `done` that were asked for included.
    latest : FitResult or None
        The fit of the last row.

    Raises
    ------
    FitError
        If a number is no positive whole number, there are none, or an option does not suit.
    """

    def __init__(
        self,
        grains: Iterable[Grain],
        numbers: Sequence[int],
        method: Method = "fast",
        seed: int = 0,
        *,
        done: Iterable[SweepRow] = (),
        on_step: Callable[[SearchStep], None] | None = None,
        **options: Any,
    ) -> None:
        self.numbers = checked_numbers(numbers)
        self.method: Method = method
        self.seed = int(seed)
        self.options = options
        self.on_step = on_step
        self.rows: list[SweepRow] = []
        self.latest: FitResult | None = None
        chosen = make_options(method, options)
        self._cavities = chosen.cavities
        self._changed = chosen.list_changed()
        self._done = {(row.label, row.n): row for row in done if self._is_as_asked(row)}
        self._grains = enumerate(grains)
        self._grain: Grain | None = None
        self._label = 0
        self._likeness: Likeness | None = None
        self._waiting: list[int] = []

    def __iter__(self) -> Iterator[SweepRow]:
        return self

    def __next__(self) -> SweepRow:
        while not self._waiting:
            place, grain = next(self._grains)
            self._begin_grain(place, grain)
        row = self._row(self._waiting[0])
        self._waiting.pop(0)  # only now: what is cut short is to be done again
        self.rows.append(row)
        return row

    def smallest_n(self, error: float, share: float = 0.5) -> dict[str, int | None]:
        """Return by error the smallest n that is good enough; see :func:`smallest_numbers`."""
        return smallest_numbers(self.rows, error, share)

    def _is_as_asked(self, row: SweepRow) -> bool:
        same = (row.method, row.seed) == (self.method, self.seed)
        return same and dict(row.options) == self._changed and not row.error

    def _begin_grain(self, place: int, grain: Grain) -> None:
        self._grain, self._label = grain, place if grain.label is None else grain.label
        self._likeness = Likeness(grain, self._cavities)
        earlier = [self._done[self._label, n] for n in self.numbers if (self._label, n) in self._done]
        self.rows += earlier
        known = {row.n for row in earlier}
        self._waiting = [n for n in self.numbers if n not in known]

    def _row(self, n: int) -> SweepRow:
        assert self._grain is not None
        assert self._likeness is not None
        about: dict[str, Any] = {
            "label": self._label, "name": self._grain.name, "n": n, "method": self.method,
            "seed": self.seed, "options": self._changed,
        }  # fmt: skip
        begun = time.process_time()
        try:
            result = self._fit(n)
        except FitError as error:  # a grain too small for n must not end the sweep
            self.latest = None
            return SweepRow(**about, error=str(error))
        seconds = time.process_time() - begun
        self.latest = result
        return compared(result, self._likeness, seconds=seconds, **about)

    def _fit(self, n: int) -> FitResult:
        assert self._grain is not None
        run = start_fit(self._grain, n, self.method, self.seed, **self.options)
        for step in run:
            if self.on_step is not None:
                self.on_step(step)
        return run.result()


def compared(result: FitResult, likeness: Likeness, **about: Any) -> SweepRow:
    """Return the row of a fit; `about` holds what only the sweep knows."""
    errors: dict[str, float] = {}
    reason = ""
    try:
        errors = likeness.factor_errors(result.avatar)
    except MbstudioError as error:  # distances and overlap are still worth a row
        reason = str(error)
    return SweepRow(
        **about, loss=float(result.history[-1]), rms=result.verdict.rms / likeness.grain.nominal_diameter,
        volume_error=float(result.verdict.volume_error), iou=likeness.iou(result.avatar),
        hausdorff=likeness.hausdorff(result.avatar), errors=errors, valid=result.verdict.valid, error=reason,
    )  # fmt: skip


def checked_numbers(numbers: Sequence[int]) -> tuple[int, ...]:
    """Return numbers of control points in rising order, each once; FitError for what is none."""
    for n in numbers:
        if isinstance(n, bool) or int(n) != n or n < 1:
            raise FitError(f"n = {n} is not possible: n must be a whole number, 1 or more.")
    if not len(numbers):
        raise FitError("A sweep needs at least one number of control points.")
    return tuple(sorted({int(n) for n in numbers}))


def error_names(rows: Iterable[SweepRow]) -> list[str]:
    """Return the names of all errors that rows hold: `MEASURES`, then the shape factors."""
    return [*MEASURES, *dict.fromkeys(name for row in rows for name in row.errors)]


def quantiles_of(
    rows: Sequence[SweepRow], value: Callable[[SweepRow], float], shares: Sequence[float]
) -> dict[int, tuple[float, ...]]:
    """Return quantiles of a value over the grains by n, in rising order; unknown values do not count."""
    found: dict[int, tuple[float, ...]] = {}
    for n in sorted({row.n for row in rows}):
        values = np.array([value(row) for row in rows if row.n == n])
        values = values[np.isfinite(values)]
        if len(values):
            found[n] = tuple(float(q) for q in np.quantile(values, shares))
    return found


def smallest_numbers(rows: Sequence[SweepRow], error: float, share: float = 0.5) -> dict[str, int | None]:
    """Return for each error the smallest n from which on it is small enough; None if none is.

    Parameters
    ----------
    rows : sequence of SweepRow
    error : float
        At most, as a share: 0.01 for 1 %.
    share : float
        Share of the grains for which it must hold; 1 for all. A grain whose error is not known fails.

    Returns
    -------
    dict
        By name: those of `MEASURES` and every shape factor. Every greater n of the sweep does as well:
        an error that only passes through zero at one n is not taken for a small one.

    Raises
    ------
    FitError
        If `error` is not positive or `share` not above 0 and at most 1.
    """
    if not error > 0:
        raise FitError(f"The error must be above 0, for example 0.01 for 1 %, not {error}.")
    if not 0 < share <= 1:
        raise FitError(f"The share of the grains must be above 0 and at most 1, not {share}.")
    found: dict[str, int | None] = {}
    for name in error_names(rows):
        found[name] = None
        for n in sorted({row.n for row in rows}, reverse=True):
            met = [row.error_of(name) <= error for row in rows if row.n == n]
            if sum(met) < share * len(met):
                break
            found[name] = n
    return found


_FACTOR = "error_"
_COLUMNS = tuple(one.name for one in fields(SweepRow) if one.name not in ("errors", "error", "options"))
_LAST = ("error", "options")


def table_of(rows: Sequence[SweepRow], factors: Sequence[str]) -> list[dict[str, Any]]:
    """Return rows as flat records; the relative error of a factor is in a column ``error_...``."""
    return [
        {
            **{name: getattr(row, name) for name in _COLUMNS},
            **{f"{_FACTOR}{name}": row.errors.get(name, float("nan")) for name in factors},
            "error": row.error,
            "options": json.dumps(dict(row.options), default=asdict),
        }
        for row in rows
    ]


def write_sweep(path: Path, rows: Sequence[SweepRow]) -> None:
    """Write rows as CSV, replacing the file as a whole.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    from mbstudio.core.metrics import FACTORS
    from mbstudio.core.replacement import replacing

    columns = [*_COLUMNS, *(f"{_FACTOR}{name}" for name in FACTORS.core), *_LAST]
    with replacing(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, columns)
        writer.writeheader()
        writer.writerows(table_of(rows, FACTORS.core))


def read_sweep(path: Path) -> list[SweepRow]:
    """Read the rows that :func:`write_sweep` wrote.

    Raises
    ------
    FitError
        If the file cannot be read, or is no table of a sweep.
    """
    try:
        text = read_plain_text(path)
        return [_row_of(cells) for cells in csv.DictReader(io.StringIO(text, newline=""))]
    except PlainFileError as error:
        raise FitError(f"{path} is not the table of a sweep ({error}): give another file.") from error
    except (AttributeError, KeyError, OverflowError, ValueError, TypeError, csv.Error) as error:
        told = " ".join(str(error).split())[:200]
        raise FitError(
            f"{path} is not the table of a sweep ({type(error).__name__}: {told}): give another file."
        ) from error


def joined(rows: Sequence[SweepRow], earlier: Sequence[SweepRow]) -> list[SweepRow]:
    """Return rows, then those of an earlier table that they do not replace."""

    def key(row: SweepRow) -> tuple[Any, ...]:
        return row.label, row.n, row.method, row.seed, json.dumps(dict(row.options), default=asdict)

    replaced = {key(row) for row in rows}
    return [*rows, *(row for row in earlier if key(row) not in replaced)]


def _row_of(cells: dict[str, str]) -> SweepRow:
    numbers = ("loss", "rms", "volume_error", "iou", "hausdorff", "seconds")
    errors = {
        name.removeprefix(_FACTOR): float(text) for name, text in cells.items() if name.startswith(_FACTOR)
    }
    if cells["valid"] not in ("True", "False"):
        raise ValueError(f"valid is '{cells['valid']}'")
    return SweepRow(
        label=int(cells["label"]),
        name=cells["name"],
        n=int(cells["n"]),
        method=cells["method"],  # type: ignore[arg-type]
        seed=int(cells["seed"]),
        **{name: float(cells[name]) for name in numbers},
        # A row whose factors were not defined has none, rather than unknown ones.
        errors={name: value for name, value in errors.items() if value == value},
        valid=cells["valid"] == "True",
        error=cells["error"],
        options=_options(cells["options"]),
    )


def _options(text: str) -> dict[str, Any]:
    found = parse_json(text)
    if not isinstance(found, dict):
        raise ValueError("options is no record of names and values")
    return found
