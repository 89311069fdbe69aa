"""The process that fits one body after another from a template, for the serializer."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from mbstudio.core.batch.body_messages import body_message, body_of
from mbstudio.core.batch.messages import answer_requests, receive, send
from mbstudio.core.errors import SerializationError
from mbstudio.core.vae.serialize.serialization import Template
from mbstudio.core.vae.serialize.template_fit import FittedBody, fit_from_template

if TYPE_CHECKING:
    from mbstudio.core.vae.serialize.frame import Body

_FITTED = ("centers", "log_weights")
_TEMPLATE = ("centers", "log_weights", "exchange")


def ask(stream: BinaryIO, body: Body, template: Template, *, unit: str | None, seed: int, name: str) -> None:
    """Ask a process to fit one body."""
    head, arrays = body_message(body)
    laid = {f"template_{field}": getattr(template, field) for field in _TEMPLATE}
    if template.stiffness is not None:
        laid["template_stiffness"] = template.stiffness
    send(stream, {"body": head, "unit": unit, "seed": seed, "name": name}, {**arrays, **laid})


def receive_fitted(stream: BinaryIO) -> FittedBody:
    """Read what the process found; SerializationError where it could not fit the body."""
    head, arrays = receive(stream)
    if head["error"]:
        raise SerializationError(head["error"])
    return FittedBody(
        **{field: arrays[field] for field in _FITTED},
        diameter=head["diameter"], unit=head["unit"], rms=head["rms"], valid=head["valid"],
    )  # fmt: skip


def serve() -> None:
    """Fit bodies until the caller closes the pipe."""

    def answer(answers: BinaryIO, head: dict[str, Any], arrays: dict[str, np.ndarray]) -> None:
        stiffness = arrays.pop("template_stiffness", None)
        template = Template(
            **{field: arrays.pop(f"template_{field}") for field in _TEMPLATE}, stiffness=stiffness
        )
        body = body_of(head["body"], arrays)
        try:
            fitted = fit_from_template(
                body, template, unit=head["unit"], seed=head["seed"], name=head["name"]
            )
        except SerializationError as error:
            send(answers, {"error": str(error)})
            return
        found = {"diameter": fitted.diameter, "unit": fitted.unit, "rms": fitted.rms, "valid": fitted.valid}
        send(answers, {"error": "", **found}, {field: getattr(fitted, field) for field in _FITTED})

    answer_requests(answer)
