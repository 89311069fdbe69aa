"""A job to try the pool with: numbers are squared, and some do harm."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from mbstudio.core.batch.pool import Job
from mbstudio.core.errors import FitError


class TooLarge(FitError):
    """Of a class that the errors of mbstudio do not know by name."""


class SquareJob(Job):
    """Negative numbers cannot be packed, 666 ends the process, numbers above 1000 are refused there."""

    def pack(self, task):
        if task < 0:
            raise FitError(f"{task} is negative")
        return {"number": task}, {"powers": np.array([task, task**2])}

    @staticmethod
    def work(head, arrays, report):
        report(0.5, f"squaring {head['number']}")
        print("this must not end up between the messages")
        if head["number"] == 666:
            os._exit(7)
        if head["number"] > 1000:
            raise TooLarge(f"{head['number']} is too large")
        return {"square": arrays["powers"][1]}, {}

    def unpack(self, task, head, arrays):
        return head["square"]

    def fail(self, task, error):
        return f"{type(error).__name__}: {error}"

    def lose(self, task, code):
        return f"ended with {code}"


class OnceJob(SquareJob):
    """Is not tried again, and says how often it was begun."""

    tries = 1

    def __init__(self):
        self.packed = []

    def pack(self, task):
        self.packed.append(task)
        return super().pack(task)


class TwiceJob(OnceJob):
    tries = 2


class StrictJob(SquareJob):
    def fail(self, task, error):
        raise error


class CountedJob(SquareJob):
    """Writes down what was worked on, in whichever process."""

    @staticmethod
    def work(head, arrays, report):
        with Path(os.environ["MBSTUDIO_TEST_COUNT"]).open("a", encoding="ascii") as count:
            count.write(f"{head['number']}\n")
        return SquareJob.work(head, arrays, report)

    @staticmethod
    def worked():
        """Return what was worked on since this was asked last."""
        count = Path(os.environ["MBSTUDIO_TEST_COUNT"])
        found = [int(line) for line in count.read_text().split()] if count.exists() else []
        count.unlink(missing_ok=True)
        return found
