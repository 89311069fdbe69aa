"""Candidates of a generation: each checked, mended where that is easy, and measured quickly."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float, Float64, Int

from mbstudio.core.batch.messages import Arrays, Head, Message, Report
from mbstudio.core.batch.pool import Job, WorkerPool
from mbstudio.core.errors import GenerationError
from mbstudio.core.metaball.topology import topology
from mbstudio.core.metrics.factor_table import FACTORS
from mbstudio.core.metrics.star_factors import STAR_FACTORS, star_factors
from mbstudio.core.vae.serialize.serialization import Serialization

Progress = Callable[[float, str], None]

VALID, REPAIRED, PIECES, VOID, UNUSABLE = range(5)
REASONS = {
    PIECES: "falls into pieces",
    VOID: "has a void inside",
    UNUSABLE: "is not a body around its centre",
}
"""Why a candidate is refused."""

_BLOCK = 25
_MOST_ROUNDS = 12
_FAR = 4.0
_PULL = 0.8
_GROWTH = 1.03


@dataclass(frozen=True, eq=False)
class Candidates:
    """Avatars of which a generation chooses.

    Attributes
    ----------
    shapes : Serialization
        As they are after the guard; `valid` says which may be chosen.
    latents : float array, shape (candidates, latent)
    parents : int array, shape (candidates, ...)
        Rows of the parents that each was made from.
    states : int array, shape (candidates,)
        `VALID` as drawn, `REPAIRED`, or refused for one of `REASONS`.
    factors : float array, shape (candidates, 11)
        Those named in `STAR_FACTORS`, in the unit of the shapes.
    """

    shapes: Serialization
    latents: Float[np.ndarray, "candidates latent"]
    parents: Int[np.ndarray, "candidates ..."]
    states: Int[np.ndarray, " candidates"]
    factors: Float64[np.ndarray, "candidates 11"]

    def __len__(self) -> int:
        return len(self.states)

    def column(self, factor: str) -> Float64[np.ndarray, " candidates"]:
        """Return a quick factor of every candidate, NaN where it has none.

        Raises
        ------
        GenerationError
            If the factor is not found quickly.
        """
        if factor not in FACTORS.quick:
            raise GenerationError(f"'{factor}' is not a quick factor: use one of {', '.join(FACTORS.quick)}.")
        known = dict(zip(STAR_FACTORS, self.factors.T, strict=True))
        return np.asarray(FACTORS.value(factor, known))

    def join(self, more: Candidates) -> Candidates:
        """Return these candidates and then the others."""
        arrays: dict[str, Any] = {
            name: np.concatenate([getattr(self.shapes, name), getattr(more.shapes, name)])
            for name in ("centers", "log_weights", "diameters", "rms", "valid")
        }
        shapes = replace(self.shapes, names=(*self.shapes.names, *more.shapes.names), **arrays)
        return Candidates(
            shapes,
            *(
                np.concatenate([getattr(self, name), getattr(more, name)])
                for name in ("latents", "parents", "states", "factors")
            ),
        )


def examine(control: Float64[np.ndarray, "4 n"]) -> tuple[Float64[np.ndarray, "4 n"], int, np.ndarray]:
    """Check one candidate in its frame (unit D_n); mend it if it can be; measure it if it is a body.

    Returns
    -------
    control : float array, shape (4, n)
    state : int
    factors : float array, shape (11,)
        NaN for a candidate that is refused.
    """
    nothing = np.full(len(STAR_FACTORS), np.nan)
    # Nothing so far away belongs to the body, and a grid that reaches there would see nothing of it.
    if np.isfinite(control).all() and np.abs(control[:3]).max() > _FAR:
        return control, PIECES, nothing
    if not (np.isfinite(control).all() and control[3].min() > 0 and control[3].max() < 1e3):
        return control, UNUSABLE, nothing
    found = topology(control)
    state = VALID
    if not found.is_sound:
        state = PIECES if found.pieces > 1 else VOID
        mended = _mend(control)
        if mended is None:
            return control, state, nothing
        control, state = mended, REPAIRED
    factors = star_factors(control)
    return control, state if np.isfinite(factors).all() else UNUSABLE, factors


def _mend(control: Float64[np.ndarray, "4 n"]) -> Float64[np.ndarray, "4 n"] | None:
    """Pull stray control points towards the body and grow weights over voids; None where that fails."""
    mended = control.copy()
    found = topology(mended, finest=64)
    volume = 0.0
    for _ in range(_MOST_ROUNDS):
        if found.is_sound and (found := topology(mended)).is_sound:
            break
        if found.pieces > 1:
            stray = found.piece_of_point != 0
            main = mended[:3, ~stray].T
            for i in np.flatnonzero(stray):
                nearest = main[np.square(main - mended[:3, i]).sum(axis=1).argmin()]
                mended[:3, i] = nearest + _PULL * (mended[:3, i] - nearest)
        else:
            volume = volume or float(found.volumes[0])
            mended[3] *= _GROWTH
        found = topology(mended, finest=64)
    else:
        return None
    # Growing must not make the clone larger than it was drawn.
    scale = np.cbrt(volume / float(found.volumes[0])) if volume else 1.0
    scaled: np.ndarray = mended * np.array([scale, scale, scale, scale**2])[:, None]
    return scaled


def examine_all(
    shapes: Serialization,
    latents: np.ndarray,
    parents: np.ndarray,
    *,
    processes: int = 1,
    progress: Progress | None = None,
) -> Candidates:
    """Check, mend and measure candidates, the same whatever the number of processes.

    Parameters
    ----------
    shapes : Serialization
    latents, parents : arrays of as many rows
    processes : int
        1 works in the calling thread.
    progress : callable, optional
        ``progress(share, message)``; what it raises ends the work at once.
    """
    control = np.concatenate([shapes.centers.transpose(0, 2, 1), np.exp(shapes.log_weights)[:, None]], axis=1)
    blocks = [slice(start, start + _BLOCK) for start in range(0, len(control), _BLOCK)]
    states = np.zeros(len(control), dtype=np.int64)
    factors = np.full((len(control), len(STAR_FACTORS)), np.nan)
    done = 0

    def keep(block: slice, found: Arrays) -> None:
        nonlocal done
        control[block], states[block], factors[block] = found["control"], found["states"], found["factors"]
        done += len(found["states"])
        if progress is not None:
            progress(done / len(control), f"{done} of {len(control)} candidates")

    WorkerPool(_Examinations(control), 0 if processes <= 1 else processes).map(blocks, keep)
    powers = np.array([FACTORS[name].power for name in STAR_FACTORS])
    return Candidates(
        replace(
            shapes,
            centers=control[:, :3].transpose(0, 2, 1),
            log_weights=np.log(control[:, 3]),
            valid=states <= REPAIRED,
        ),
        np.asarray(latents),
        np.asarray(parents),
        states,
        factors * shapes.diameters[:, None] ** powers,
    )


class _Examinations(Job[slice, Arrays]):
    """In goes a block of candidates, out come their mended control points, states and factors."""

    def __init__(self, control: Float64[np.ndarray, "candidates 4 n"]) -> None:
        self._control = control

    def pack(self, block: slice) -> Message:
        return {}, {"control": self._control[block]}

    @staticmethod
    def work(head: Head, arrays: Arrays, report: Report) -> Message:
        found = [examine(np.ascontiguousarray(one)) for one in arrays["control"]]
        return {}, {
            "control": np.stack([one[0] for one in found]),
            "states": np.array([one[1] for one in found], dtype=np.int64),
            "factors": np.stack([one[2] for one in found]),
        }

    def unpack(self, block: slice, head: Head, arrays: Arrays) -> Arrays:
        return arrays

    def lose(self, block: slice, code: int) -> Arrays:
        raise GenerationError(f"A process that checked clones ended with code {code}: try fewer processes.")
