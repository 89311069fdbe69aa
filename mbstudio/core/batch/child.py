"""What a process of a pool runs: one task after another, until its pool closes the pipe."""

from __future__ import annotations

import os
import sys
from importlib import import_module

from mbstudio.core import errors
from mbstudio.core.batch.messages import Arrays, receive, send


def serve(job: str) -> None:
    """Do the tasks that come in over standard input.

    Parameters
    ----------
    job : str
        Module and name of a :class:`~mbstudio.core.batch.pool.Job`, with a colon between them.
    """
    # Whatever prints must not end up between the messages.
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    module, _, name = job.partition(":")
    work = getattr(import_module(module), name).work

    def report(share: float, message: str, arrays: Arrays | None = None, /) -> None:
        send(answers, {"report": [share, message]}, arrays)

    while True:
        try:
            task = receive(sys.stdin.buffer)
        except EOFError:
            return
        try:
            head, arrays = work(*task, report)
        except errors.MbstudioError as error:
            send(answers, {"error": [_known_kind(error), str(error)]})
        else:
            send(answers, {"answer": head}, arrays)


def _known_kind(error: errors.MbstudioError) -> str:
    """Return the name of an error's class, or of the class in `errors` that it is a kind of."""
    return next(kind.__name__ for kind in type(error).__mro__ if kind.__module__ == errors.__name__)
