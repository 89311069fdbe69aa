"""The process that measures one body after another for :mod:`mbstudio.core.populations.measuring`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from mbstudio.core.batch.body_messages import body_message, body_of
from mbstudio.core.batch.messages import answer_requests, receive, send
from mbstudio.core.errors import MbstudioError
from mbstudio.core.metrics.detail import measure_detail
from mbstudio.core.metrics.measuring import measure

if TYPE_CHECKING:
    import trimesh

    from mbstudio.core.grains.grain import Grain
    from mbstudio.core.metaball.avatar import Avatar

_STATED = ("unit", "surface", "axes", "warning")


@dataclass(frozen=True)
class Conventions:
    """How every body of a population is measured: the arguments of `measure`, and whether in detail."""

    unit: str | None = None
    axes: str = "obb"
    surface: str | None = None
    detail: bool = False


@dataclass(frozen=True)
class Measurement:
    """One body measured, or why not.

    Attributes
    ----------
    factors : mapping of str to float
        Empty where the body could not be measured; NaN for a factor that is not defined.
    unit, surface, warning, reason : str
        As in `Population`; empty where they do not apply.
    """

    factors: Mapping[str, float]
    unit: str = ""
    surface: str = ""
    warning: str = ""
    reason: str = ""


def measured(body: Grain | Avatar | trimesh.Trimesh, asked: Conventions) -> Measurement:
    """Measure one body, or say what went wrong: one bad body must not end a batch."""
    try:
        core = measure(body, unit=asked.unit, axes=asked.axes, surface=asked.surface)  # type: ignore[arg-type]
        found: dict[str, Any] = core.as_dict()
        warnings = [core.warning]
        if asked.detail:
            detail = measure_detail(body, unit=asked.unit)
            found = {**detail.as_dict(), **found}
            warnings.append(detail.warning)
    except MbstudioError as error:
        return Measurement({}, reason=str(error))
    except (ArithmeticError, ValueError, IndexError, MemoryError, RuntimeError) as error:
        return Measurement({}, reason=f"It could not be measured: {type(error).__name__}: {error}.")
    numbers = {
        name: float("nan") if value is None else float(value)
        for name, value in found.items()
        if name not in _STATED
    }
    return Measurement(numbers, core.unit, core.surface, " ".join(dict.fromkeys(filter(None, warnings))))


def ask(stream: BinaryIO, body: Grain | Avatar | trimesh.Trimesh, asked: Conventions) -> None:
    """Ask a process for one measurement."""
    head, arrays = body_message(body)
    send(stream, {"body": head, "asked": asdict(asked)}, arrays)


def receive_measurement(stream: BinaryIO) -> Measurement:
    """Read what the process found."""
    head, _ = receive(stream)
    return Measurement(**head)


def serve() -> None:
    """Measure bodies until the caller closes the pipe."""

    def answer(answers: BinaryIO, head: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
        body = body_of(head["body"], arrays)
        send(answers, asdict(measured(body, Conventions(**head["asked"]))))

    answer_requests(answer)
