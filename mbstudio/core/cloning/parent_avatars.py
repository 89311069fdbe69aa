"""Avatars of the parents of a style, from which those of clones begin."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from mbstudio.core.batch.messages import Arrays, Head, Message, Report
from mbstudio.core.batch.pool import Job, WorkerPool
from mbstudio.core.cloning.parent_surface import ParentSurface
from mbstudio.core.cloning.surface_avatar import SurfaceAvatar
from mbstudio.core.cloning.surface_avatars import CONTROL_POINTS, fit_surface
from mbstudio.core.cloning.surface_style import SurfaceStyle
from mbstudio.core.errors import CloningError
from mbstudio.core.metaball.avatar import Avatar

Progress = Callable[[float, str], None]

FEW_CONTROL_POINTS = 40
_GOOD_RMS = 0.0035
"""In D_n: with as much left by few control points, more would follow noise of the scan."""
_TRIED = 6


def fit_parents(
    style: SurfaceStyle, n: int | None = None, *, known: Sequence[SurfaceAvatar] = (), processes: int = 1,
    progress: Progress | None = None,
) -> SurfaceStyle:  # fmt: skip
    """Return a style with an avatar of each parent.

    Parameters
    ----------
    style : SurfaceStyle
    n : int, optional
        Control points. By default those of `known`, else 40 where these leave little of smooth grains, else
        120.
    known : sequence of SurfaceAvatar, optional
        Of the first parents, which are not fitted again.
    processes : int
    progress : callable, optional
        ``progress(share, message)``; what it raises ends the work.

    Raises
    ------
    CloningError
        If a parent has no avatar.
    """
    report = progress or (lambda _share, _words: None)
    tried: dict[int, SurfaceAvatar] = dict(enumerate(known))
    if n is None and known:
        n = len(known[0].avatar.weights)
    if n is None:
        rows = np.unique(np.linspace(0, len(style.parents) - 1, _TRIED).round().astype(int)).tolist()
        found = _fit(
            style, rows, FEW_CONTROL_POINTS, processes, lambda share: report(0.1 * share, "trying 40")
        )
        few = float(np.median([entry.rms for entry in found])) <= _GOOD_RMS
        n = FEW_CONTROL_POINTS if few else CONTROL_POINTS
        tried = dict(zip(rows, found, strict=True)) if few else {}
    rows = [row for row in range(len(style.parents)) if row not in tried]
    words = f"fitting {n} control points"
    found = _fit(style, rows, n, processes, lambda share: report(0.1 + 0.9 * share, words)) if rows else []
    every = tried | dict(zip(rows, found, strict=True))
    return replace(style, avatars=tuple(every[row] for row in range(len(style.parents))))


def _fit(
    style: SurfaceStyle, rows: list[int], n: int, processes: int, report: Callable[[float], None]
) -> list[SurfaceAvatar]:
    done = 0

    def count(_task: ParentSurface, _result: SurfaceAvatar) -> None:
        nonlocal done
        done += 1
        report(done / len(rows))

    pool = WorkerPool(_ParentJob(n), 0 if processes <= 1 else processes)
    return pool.map([style.parents[row] for row in rows], count)


class _ParentJob(Job[ParentSurface, SurfaceAvatar]):
    """In goes a parent's surface in its principal frame in D_n, out comes its avatar."""

    def __init__(self, n: int) -> None:
        self._n = n

    def pack(self, parent: ParentSurface) -> Message:
        head = {"unit": parent.unit, "name": parent.name, "n": self._n}
        return head, {"vertices": parent.body_vertices(), "faces": parent.faces}

    @staticmethod
    def work(head: Head, arrays: Arrays, report: Report) -> Message:
        found = fit_surface(
            np.array(arrays["vertices"]),
            np.array(arrays["faces"]),
            head["unit"],
            head["n"],
            name=head["name"],
        )
        return (
            {"rms": found.rms, "volume_error": found.volume_error, "valid": found.valid},
            {"centers": found.avatar.centers, "weights": found.avatar.weights},
        )

    def unpack(self, parent: ParentSurface, head: Head, arrays: Arrays) -> SurfaceAvatar:
        avatar = Avatar(
            np.array(arrays["centers"]), np.array(arrays["weights"]), parent.unit, name=parent.name
        )
        return SurfaceAvatar(avatar, head["rms"], head["volume_error"], head["valid"])

    def lose(self, parent: ParentSurface, code: int) -> SurfaceAvatar:
        raise CloningError(
            f"The process that fitted {parent.name} ended with code {code}: try fewer processes."
        )
