"""Many clumps on all cores: processes fit them, and the memory of clumps takes what they have found."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing

from mbstudio.core.batch.messages import Arrays, Head, Message, Report
from mbstudio.core.batch.pool import Job, WorkerPool
from mbstudio.core.batch.processes import usable_cores
from mbstudio.core.dem.shapes.clump import is_remembered, sphere_clump
from mbstudio.core.dem.shapes.clump_goal import ClumpGoal, clump_for_target
from mbstudio.core.dem.shapes.clump_memory import MEMORY, normal_form
from mbstudio.core.errors import MbstudioError
from mbstudio.core.metaball.avatar import Avatar

FEWEST = 6
"""Clumps for which processes are worth their start; a goal is as much work as several."""
_FITS_OF_A_GOAL = 6


def fit_ahead(
    avatars: Sequence[Avatar],
    wanted: int | ClumpGoal,
    progress: Callable[[float, int], object],
    processes: int | None = None,
) -> None:
    """Fit the clumps of many avatars on several cores, so that :func:`sphere_clump` then has them at once.

    Clumps do not depend on where they are fitted: those that this leaves out are the same later.

    Parameters
    ----------
    avatars : sequence of Avatar
    wanted : int or ClumpGoal
        The number of spheres, or what each clump is to reach.
    progress : callable(share, number done)
        At least ten times a second; raising in it cancels.
    processes : int, optional
        As many as there are cores by default.
    """
    missing = [
        avatar for avatar in avatars if isinstance(wanted, ClumpGoal) or not is_remembered(avatar, wanted)
    ]
    processes = usable_cores() if processes is None else processes
    weight = _FITS_OF_A_GOAL if isinstance(wanted, ClumpGoal) else 1
    if processes < 2 or weight * len(missing) < FEWEST:
        return
    pool = WorkerPool(_Clumps(wanted), processes)
    done = len(avatars) - len(missing)

    def tell(_share: float = 0.0, _message: str = "") -> None:
        progress(done / len(avatars), done)

    with closing(pool.as_completed(missing, tell)) as results:
        for _ in results:
            done += 1
            tell()


class _Clumps(Job[Avatar, None]):
    """In goes an avatar, out come all clumps that were fitted to it, into the memory."""

    def __init__(self, wanted: int | ClumpGoal) -> None:
        self._wanted = wanted

    def pack(self, avatar: Avatar) -> Message:
        goal = str(self._wanted) if isinstance(self._wanted, ClumpGoal) else ""
        head = {"unit": avatar.unit, "spheres": 0 if goal else self._wanted, "goal": goal}
        return head, {"centers": avatar.centers, "weights": avatar.weights}

    @staticmethod
    def work(head: Head, arrays: Arrays, report: Report) -> Message:
        avatar = Avatar(arrays["centers"], arrays["weights"], head["unit"])
        numbers = [int(head["spheres"])]
        if head["goal"]:
            found = clump_for_target(avatar, head["goal"], progress=report)
            numbers = list(found.tried)
        else:
            sphere_clump(avatar, numbers[0])
        digest = normal_form(avatar).digest
        figures, rows = {}, {}
        for number in numbers:
            kept = MEMORY.find(digest, number, 0)
            if kept is not None:
                rows[str(number)], figures[str(number)] = kept
        return {"digest": digest, "figures": figures}, rows

    def unpack(self, avatar: Avatar, head: Head, arrays: Arrays) -> None:
        for number, rows in arrays.items():
            MEMORY.keep(head["digest"], int(number), 0, rows, tuple(head["figures"][number]))

    def fail(self, avatar: Avatar, error: MbstudioError) -> None:
        """Leave it to the caller, who will come upon the same error at its place."""

    def lose(self, avatar: Avatar, code: int) -> None:
        """Leave it to the caller, who fits it again."""
