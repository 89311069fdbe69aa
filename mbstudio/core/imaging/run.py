"""What the step objects of both methods share: clustering steps, records, result."""

from __future__ import annotations

import math
import numbers
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from typing import Any, Protocol

import numpy as np
from jaxtyping import Float64

from mbstudio.core.errors import FitError
from mbstudio.core.grains.grain import Grain
from mbstudio.core.imaging.depths import count_outside
from mbstudio.core.imaging.preprocess import Cavities, PreparedGrain, prepare
from mbstudio.core.imaging.start.control_points import control_of_spheres, with_number
from mbstudio.core.imaging.start.sphere_clustering import Sphere, cluster_incrementally, cluster_overlapping
from mbstudio.core.imaging.start.thin import number_needed
from mbstudio.core.imaging.steps import FitResult, Method, SearchStep
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.metaball.topology import Topology
from mbstudio.core.metaball.validity import Verdict, check


def cluster_spheres(prepared: PreparedGrain, n: int) -> list[Sphere]:
    """Return up to `n` spheres: as many as do not overlap, then overlapping ones."""
    transform = prepared.distance + np.float32(0.5 * prepared.voxel)
    found = list(cluster_incrementally(transform, prepared.spacing, n, prepared.voxel))
    if len(found) < n:
        found += cluster_overlapping(transform, prepared.spacing, found, n, prepared.voxel)
    return found


def greatest_number(grain: Grain) -> int:
    """Return how many control points sphere clustering can place in a grain."""
    return len(cluster_spheres(prepare(grain), grain.voxel_count))


def require_number(n: int, grain: Grain) -> int:
    """Return n as an int; FitError unless the grain may hold that many control points."""
    whole = isinstance(n, numbers.Real) and not isinstance(n, bool) and math.isfinite(n) and int(n) == n
    if not whole or n < 1:
        raise FitError(
            f"n = {n} is not possible for grain '{grain.name}': n must be a whole number, 1 or more."
        )
    if n > grain.voxel_count:  # spheres do not share voxels; how many really fit shows in the clustering
        raise TooManyControlPoints(grain, int(n), max(1, greatest_number(grain)))
    return int(n)


class TooManyControlPoints(FitError):
    """A grain that cannot hold n control points; `most` is the greatest number that it can."""

    def __init__(self, grain: Grain, n: int, most: int) -> None:
        self.most = most
        super().__init__(
            f"Grain '{grain.name}' of {grain.voxel_count} voxels cannot hold n = {n} control points: "
            f"ask for n = {most} or fewer."
        )

    def __reduce__(self) -> tuple[type[FitError], tuple[str]]:
        return FitError, (str(self),)


class _Options(Protocol):
    """What the options of both methods hold."""

    @property
    def generations(self) -> int: ...
    @property
    def working_side(self) -> int: ...
    @property
    def hull_points(self) -> int: ...
    @property
    def cavities(self) -> Cavities: ...

    def list_changed(self) -> dict[str, Any]: ...


class StepRun(ABC):
    """Base of the step objects; a method fills in clustering, start and search.

    The steps come from one generator; changing the number of control points or asking for more
    generations replaces it by another that goes on from the state as it stands.

    Parameters
    ----------
    grain : Grain
    n : int
        Number of control points.
    seed : int
    options : FastOptions or PaperOptions

    Raises
    ------
    FitError
        If n is no positive whole number, or more than the grain has voxels for.
    """

    method: Method

    def __init__(self, grain: Grain, n: int, seed: int, options: Any) -> None:
        self.grain = grain
        self.n = require_number(n, grain)
        self.seed = int(seed)
        self.options: _Options = options
        self._prepared: PreparedGrain | None = None
        self._control: Float64[np.ndarray, "4 n"] | None = None
        self.generation = -1
        self._spheres_found: list[Sphere] = []
        self._losses: list[float] = []
        self._rms: list[float] = []
        self._verdict: Verdict | None = None
        self._note = ""
        self._steps: Iterator[SearchStep] = self._all_steps()

    @property
    def prepared(self) -> PreparedGrain:
        """The grain as the search works on it, prepared when it is first needed."""
        if self._prepared is None:
            self._prepared = self._prepare()
        return self._prepared

    def share_preparation(self, other: StepRun) -> None:
        """Take over what another run of the same grain and options has prepared, if it has."""
        self._prepared = self._prepared or other._prepared

    @property
    def has_begun(self) -> bool:
        """Whether the search has begun, so that there are control points."""
        return self._control is not None

    @property
    def control(self) -> Float64[np.ndarray, "4 n"]:
        """Control points as rows x, y, z, k in the working frame; FitError before the search has begun."""
        if self._control is None:
            raise FitError(f"The search for grain '{self.grain.name}' has not begun: there is no avatar yet.")
        return self._control

    @control.setter
    def control(self, control: Float64[np.ndarray, "4 n"]) -> None:
        self._control = control

    def __iter__(self) -> Iterator[SearchStep]:
        return self

    def __next__(self) -> SearchStep:
        return next(self._steps)

    def change_control_points(self, n: int) -> None:
        """Go on from here with another number of control points.

        Those there are are kept, split or merged; where that leaves a larger loss than a start
        from n spheres (few control points do not say where many belong), the search starts there.

        Raises
        ------
        FitError
            If the grain cannot hold n control points; the run then stays as it was.
        """
        n = require_number(n, self.grain)
        if n == self.n:
            return
        if not self.has_begun:  # still clustering: simply more or fewer spheres
            self.n = n
            self._steps = self._all_steps()
            return
        start = self._place_control_points(self._require_spheres(n))
        kept = with_number(self.control, n, self.prepared)
        self.n, self._verdict = n, None
        self._note = f"goes on with {n} control points"
        start_loss = self._begin_at(start)
        if self._begin_at(kept) > start_loss:
            self._begin_at(start)
            self._note = f"restarts with {n} control points: better than the previous ones, split or merged"
        self._steps = self._search(self.options.generations)

    def more_generations(self, count: int) -> None:
        """Let a finished or stopped search go on for `count` more generations.

        Raises
        ------
        FitError
            If the search has not begun, or `count` is not positive.
        """
        if count < 1:
            raise FitError(f"{count} more generations are not possible: give a whole number, 1 or more.")
        if not self.has_begun:
            raise FitError("The gradient search has not begun: let the sphere clustering finish first.")
        self._verdict = None
        self._steps = self._search(int(count))

    def result(self) -> FitResult:
        """Return avatar, history and verdict as they stand now.

        Raises
        ------
        FitError
            If the search has not begun.
        """
        control = self.control
        if self._verdict is None:
            self._verdict = self._judge()
        return FitResult(
            avatar=self.prepared.avatar(control),
            history=np.array(self._losses),
            rms_history=np.array(self._rms),
            verdict=self._verdict,
            method=self.method,
            n=self.n,
            seed=self.seed,
            options=self.options.list_changed(),
        )

    # What a method brings along.
    @abstractmethod
    def _find_spheres(self, n: int) -> Iterator[Sphere]:
        """Yield the spheres after those found so far, up to n in all."""

    @abstractmethod
    def _place_control_points(self, spheres: Sequence[Sphere]) -> Float64[np.ndarray, "4 n"]:
        """Return the control points that the search starts from."""

    @abstractmethod
    def _begin_at(self, control: Float64[np.ndarray, "4 n"]) -> float:
        """Let the search go on from these control points; return their loss."""

    @abstractmethod
    def _search(self, generations: int) -> Iterator[SearchStep]:
        """Yield the generations of the search; first of all the start, where it is new."""

    @abstractmethod
    def _measure_rms(self) -> float:
        """Return the root mean square surface distance of the control points, in working lengths."""

    def _known_topology(self) -> Topology | None:
        """Return the topology of the avatar where the method knows it."""
        return None

    def _prepare(self) -> PreparedGrain:
        options = self.options
        return prepare(
            self.grain, self.seed, working_side=options.working_side, hull_points=options.hull_points,
            cavities=options.cavities,
        )  # fmt: skip

    def _require_spheres(self, n: int) -> list[Sphere]:
        """Return n spheres; those of a smaller number are the first of a larger."""
        if len(self._spheres_found) < n:
            self._spheres_found += list(self._find_spheres(n))
            if len(self._spheres_found) < n:
                raise TooManyControlPoints(self.grain, n, len(self._spheres_found))
        return self._spheres_found[:n]

    def _pop_note(self) -> str:
        """Return what is to be said of the next start, once."""
        note, self._note = self._note, ""
        return note

    def _judge(self) -> Verdict:
        prepared = self.prepared
        return check(
            prepared.avatar(self.control), self.grain, rms=self._measure_rms() * prepared.scale,
            found=self._known_topology(), outside=count_outside(self.control, prepared), asked=self.n,
            grain_genus=prepared.genus, needed=lambda: number_needed(prepared), kept=prepared.cavities,
            filled=prepared.filled_voxels,
        )  # fmt: skip

    def _all_steps(self) -> Iterator[SearchStep]:
        prepared = self.prepared
        # After a change of n on the way the spheres found so far are kept.
        for sphere in self._find_spheres(self.n):
            self._spheres_found.append(sphere)
            yield self._clustering_step(prepared, self._spheres_found)
        self._begin_at(self._place_control_points(self._require_spheres(self.n)))
        yield from self._search(self.options.generations)

    def _clustering_step(self, prepared: PreparedGrain, found: list[Sphere]) -> SearchStep:
        spheres = tuple(found)

        def make() -> Avatar:
            return prepared.avatar(control_of_spheres(prepared, spheres))

        note = ""
        if len(spheres) == 1 and prepared.filled_voxels:
            note = f"cavities of {prepared.filled_voxels} voxels inside the grain were filled"
        return SearchStep("clustering", len(spheres), self.n, float("nan"), float("nan"), make, note)

    def _record(self, loss: float, rms: float, generations: int, note: str = "") -> SearchStep:
        """Take down one generation of the search and return its step; `rms` in working lengths."""
        prepared, control = self.prepared, self.control.copy()
        self.generation += 1
        self._verdict = None
        self._losses.append(loss)
        self._rms.append(rms * prepared.scale)
        return SearchStep(
            "search", self.generation, max(generations, self.generation), loss, rms * prepared.scale,
            lambda: prepared.avatar(control), note,
        )  # fmt: skip
