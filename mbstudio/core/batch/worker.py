"""The process that fits one grain after another for :func:`mbstudio.core.batch.fit_many`.

It talks over its standard input and output, so that it needs nothing of the caller's
``__main__`` and works from a window's thread, a test or a bare script alike.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from typing import Any, BinaryIO

import numpy as np

from mbstudio.core.batch.body_messages import grain_message, grain_of
from mbstudio.core.batch.messages import answer_requests, receive, send
from mbstudio.core.errors import MbstudioError
from mbstudio.core.grains.grain import Grain
from mbstudio.core.imaging.steps import FitResult
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.metaball.validity import Verdict


def send_task(
    stream: BinaryIO,
    grain: Grain,
    n: int,
    method: str,
    seed: int,
    options: Mapping[str, Any],
    target: str = "",
) -> None:
    """Ask for one fit; the mask travels as packed bits."""
    described, arrays = grain_message(grain)
    asked = {"n": n, "method": method, "seed": seed, "options": dict(options), "target": target}
    send(stream, {**described, **asked}, arrays)


def receive_answer(stream: BinaryIO) -> tuple[FitResult | None, str | None]:
    """Read the result of one fit, or why there is none."""
    head, arrays = receive(stream)
    if head["error"] is not None:
        return None, head["error"]
    avatar = Avatar(arrays["centers"], arrays["weights"], head["unit"], head["label"], head["name"])
    told = {name: tuple(head["verdict"][name]) for name in ("reasons", "warnings")}
    verdict = Verdict(**{**head["verdict"], **told})
    return FitResult(
        avatar, arrays["history"], arrays["rms_history"], verdict, head["method"], head["n"], head["seed"],
        head["options"], head["target"], head["reached"],
    ), None  # fmt: skip


def _send_answer(stream: BinaryIO, result: FitResult | None, error: str | None) -> None:
    if result is None:
        send(stream, {"error": error})
        return
    avatar = result.avatar
    head = {
        "error": None,
        "unit": avatar.unit,
        "label": avatar.label,
        "name": avatar.name,
        "verdict": asdict(result.verdict),
        "method": result.method,
        "n": result.n,
        "seed": result.seed,
        "options": dict(result.options),
        "target": result.target,
        "reached": dict(result.reached),
    }
    arrays = {
        "centers": avatar.centers,
        "weights": avatar.weights,
        "history": result.history,
        "rms_history": result.rms_history,
    }
    send(stream, head, arrays)


def run_task(
    grain: Grain, n: int, method: str, seed: int, options: dict[str, Any], target: str = ""
) -> tuple[FitResult | None, str | None]:
    """Fit one grain; return the result, or what went wrong: one bad grain must not end a batch.

    A grain that holds at least half of n control points, but not n, gets as many as it can hold:
    a scan always has fragments among its grains. With a target the number is looked for.
    """
    from mbstudio.core.imaging import fit
    from mbstudio.core.imaging.run import TooManyControlPoints

    try:
        try:
            return fit(grain, n, method, seed, target=target, **options), None  # type: ignore[arg-type]
        except TooManyControlPoints as error:
            if 2 * error.most < n:
                raise
            result = fit(grain, error.most, method, seed, **options)  # type: ignore[arg-type]
            return replace(result, n=n), None
    except MbstudioError as error:
        return None, str(error)
    except (ArithmeticError, ValueError, IndexError, MemoryError, RuntimeError) as error:
        return None, f"Grain '{grain.name}' could not be fitted: {type(error).__name__}: {error}."


def serve() -> None:
    """Fit grains until the caller closes the pipe."""

    def answer(answers: BinaryIO, head: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
        task = (head["n"], head["method"], head["seed"], head["options"], head["target"])
        _send_answer(answers, *run_task(grain_of(head, arrays), *task))

    answer_requests(answer)
