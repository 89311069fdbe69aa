"""The in-place twin of a scan: the entry points."""

from __future__ import annotations

import numbers
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float32

from mbstudio.core.batch.processes import usable_cores
from mbstudio.core.errors import TwinError
from mbstudio.core.grains.grain_set import GrainSet
from mbstudio.core.imaging.steps import FitResult
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.scan.field_of_view import find_field_of_view
from mbstudio.core.scan.scan import Scan
from mbstudio.core.threads import one_thread
from mbstudio.core.twin.contacts import contact_table
from mbstudio.core.twin.frame import Frame
from mbstudio.core.twin.placing import find_levels, guess_blur, place_bodies
from mbstudio.core.twin.residuals import residual_table
from mbstudio.core.twin.result import TwinResult
from mbstudio.core.twin.start import LabelFits
from mbstudio.core.twin.sweeps import Sweeps, TwinStep

_MOST_UNEVEN = 1.5  # longest edge of a voxel over the shortest
_SHARE_OF_LABELS = 0.5  # of the work, where all grains are fitted to their labels first


class TwinRun:
    """Step object of a twin: pausing is not calling ``next``, cancelling is dropping it.

    Parameters
    ----------
    scan, grains, fits, n, seed, sweeps, workers
        As in :func:`twin`.
    """

    def __init__(
        self,
        scan: Scan | None,
        grains: GrainSet,
        fits: Mapping[int, Avatar | FitResult] | None = None,
        n: int = 40,
        *,
        seed: int = 0,
        sweeps: int = 4,
        workers: int | None = None,
    ) -> None:
        self.scan = _require_scan(scan, grains)
        self.grains, self.n, self.seed, self.sweeps = grains, _require_number(n), int(seed), int(sweeps)
        if self.sweeps < 1:
            raise TwinError(f"A twin needs 1 sweep or more, not {sweeps}.")
        self._given, self._workers = dict(fits or {}), workers
        self.frame = Frame.of(self.scan)
        self._run: Sweeps | None = None
        self._fits: dict[int, FitResult] = {}
        self._share_of_labels = 0.0
        self._steps = self._all_steps()

    def __iter__(self) -> Iterator[TwinStep]:
        return self

    def __next__(self) -> TwinStep:
        with one_thread():
            return next(self._steps)

    @property
    def sweeping(self) -> Sweeps | None:
        """The sweeps as they stand; None as long as grains are fitted to their labels."""
        return self._run

    def begin(self) -> Sweeps:
        """Fit what is missing to the labels, and return the sweeps before the first of them."""
        while self._run is None:
            next(self)
        return self._run

    def _all_steps(self) -> Iterator[TwinStep]:
        yield from self._begin()
        assert self._run is not None
        yield TwinStep(0, self.sweeps, self._share_of_labels, self._run.blur, float("nan"))
        for step in self._run:
            yield replace(step, done=self._share_of_labels + (1.0 - self._share_of_labels) * step.done)

    def _begin(self) -> Iterator[TwinStep]:
        grains, frame = self.grains, self.frame
        voxels, seen = _read(self.scan, grains)
        columns = ["label", "voxels", "z0", "z1", "y0", "y1", "x0", "x1"]
        rows = [{key: int(row[key]) for key in columns} for row in grains.table[columns].to_dict("records")]
        levels = find_levels(voxels, grains.labels, seen, rows, np.dtype(self.scan.voxels.dtype))
        labels = [row["label"] for row in rows]
        noise = levels.grain_noise / abs(levels.contrast)
        start = LabelFits(grains, self._given, labels, self.n, noise, self.seed, self._workers)
        missing = sum(label not in self._given for label in labels)
        self._share_of_labels = _SHARE_OF_LABELS * missing / max(len(labels), 1)
        unknown = float("nan")
        for share in start:
            yield TwinStep(0, self.sweeps, self._share_of_labels * share, unknown, unknown)
        avatars, self._fits = start.avatars, start.fits
        grey = ((voxels - levels.void) / levels.contrast).astype(np.float32)
        blur = guess_blur(grey, grains.labels, seen, rows)
        bodies = place_bodies(grains, avatars, frame, levels, blur, rows)
        table = grains.table
        border = dict(zip(table["label"].tolist(), table["touches_border"].tolist(), strict=True))
        for body in bodies:
            body.touches_border = border[body.label]
            if body.label not in self._fits and body.label not in self._given:
                body.note = "started as a ball: no avatar fits its labels"
        threads = usable_cores() if self._workers is None else self._workers
        self._run = Sweeps(voxels, grains.labels, seen, bodies, levels, frame, blur, self.sweeps, threads)

    def result(self) -> TwinResult:
        """Return the twin as it stands now.

        Raises
        ------
        TwinError
            If no step has been taken.
        """
        run = self._run
        if run is None:
            raise TwinError("The twin has not begun: take a step first.")
        names = {body.label: self.grains.name_of(body.label) for body in run.bodies}
        avatars = {
            body.label: self.frame.avatar_of(body.control, body.label, names[body.label])
            for body in run.bodies
        }
        with one_thread():
            return TwinResult(
                avatars,
                run.blur * self.frame.edge, run.levels, residual_table(run), contact_table(run),
                run.misfit_at_start, run.misfit(), self.frame.unit, self.seed, run, self._fits,
            )  # fmt: skip


def start_twin(
    scan: Scan | None,
    grains: GrainSet,
    fits: Mapping[int, Avatar | FitResult] | None = None,
    n: int = 40,
    *,
    seed: int = 0,
    sweeps: int = 4,
    workers: int | None = None,
) -> TwinRun:
    """Return the step object of a twin; grains are fitted to their labels at its first step.

    Parameters and errors are those of :func:`twin`.
    """
    return TwinRun(scan, grains, fits, n, seed=seed, sweeps=sweeps, workers=workers)


def twin(
    scan: Scan | None,
    grains: GrainSet,
    fits: Mapping[int, Avatar | FitResult] | None = None,
    n: int = 40,
    *,
    seed: int = 0,
    sweeps: int = 4,
    workers: int | None = None,
    on_step: Callable[[TwinStep], None] | None = None,
) -> TwinResult:
    """Fit the avatars of all grains together to the grey values of their scan.

    The scan is taken for a void level plus the tone of each grain, blurred by a Gaussian across the
    avatars' surfaces. All control points, the tones, the blur and the void level are found by damped
    Gauss-Newton steps with Huber weights, a grain at a time, its neighbours' model subtracted, in a few
    sweeps over all grains.

    Parameters
    ----------
    scan : Scan
        With grey values.
    grains : GrainSet
        The grains of that scan; those at its border are fitted too, and marked.
    fits : mapping of int to Avatar or FitResult, optional
        Avatars to start from, by label; grains without are fitted to their labels first.
    n : int
        Control points of avatars that are fitted here; grains of few voxels get
        fewer, and so do those of noisy scans.
    seed : int
        Of those fits. The same seed gives the same twin, with any number of workers.
    sweeps : int
    workers : int, optional
        Threads, and processes of the fits to labels; all usable cores by default. 0 computes in the calling
        thread.
    on_step : callable, optional
        Called with every step; raising in it cancels the twin.

    Returns
    -------
    TwinResult

    Raises
    ------
    TwinError
        If there is no scan, it is of another size than the labels, has no grey values, no pore voxel, a
        saturated grain, or grains that look like pores.
    FitError
        If n is no positive whole number.
    """
    run = start_twin(scan, grains, fits, n, seed=seed, sweeps=sweeps, workers=workers)
    for step in run:
        if on_step is not None:
            on_step(step)
    return run.result()


def _require_number(n: int) -> int:
    if isinstance(n, bool) or not isinstance(n, numbers.Integral) or n < 1:
        raise TwinError(f"n = {n} is not possible: n must be a whole number, 1 or more.")
    return int(n)


def _require_scan(scan: Scan | None, grains: GrainSet) -> Scan:
    if scan is None:
        raise TwinError("A twin needs the scan's grey values: open the scan, or fit avatars to the labels.")
    if not len(grains):
        raise TwinError("There are no grains: find them first.")
    if grains.is_of_meshes:
        raise TwinError("These grains are meshes without grey values: fit avatars to them instead.")
    if scan.shape != tuple(grains.label_volume.shape):
        raise TwinError(
            f"The scan has {scan.shape} voxels (z, y, x) and the labels {tuple(grains.label_volume.shape)}: "
            "open the scan that they were made from."
        )
    edges = scan.voxel_size.xyz
    if max(edges) > _MOST_UNEVEN * min(edges):
        raise TwinError(
            f"The voxels are {max(edges) / min(edges):.3g} times as long as wide: a twin needs no more than "
            f"{_MOST_UNEVEN:g} times. Resample the scan."
        )
    return scan


def _read(scan: Scan, grains: GrainSet) -> tuple[Float32[np.ndarray, "Z Y X"], Bool[np.ndarray, "Z Y X"]]:
    """Return grey values and what was seen of them."""
    stored = scan.load()
    view = grains.view if grains.view is not None else find_field_of_view(stored)
    voxels = np.asarray(stored, dtype=np.float32)
    seen = np.array(view.mask)
    return voxels, seen
