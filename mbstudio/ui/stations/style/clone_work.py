"""Generating clones, and comparing them with their parents."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from PySide6.QtCore import QObject, Signal

from mbstudio.core.batch.processes import usable_cores
from mbstudio.core.errors import CloningError, GenerationError
from mbstudio.core.populations import Population
from mbstudio.ui.language import mark, plural, tr
from mbstudio.ui.stations.run import Run
from mbstudio.ui.stations.work import Work
from mbstudio.ui.workers import Control, Task, TaskQueue
from mbstudio.ui.workspace import Workspace

if TYPE_CHECKING:
    from mbstudio.core.cloning.clone_maker import CloneOptions
    from mbstudio.core.cloning.surface_generation import SurfaceGeneration
    from mbstudio.core.cloning.surface_style import SurfaceStyle
    from mbstudio.core.vae.generate.generation import Generation
    from mbstudio.core.vae.generate.quality import Quality
    from mbstudio.core.vae.models.style_learner import StyleLearner

_MANY = 40  # bodies for which starting processes pays


@dataclass(frozen=True, eq=False)
class Assessed:
    """Clones compared with their parents; clones of surfaces are measured beside them only."""

    clones: Generation | SurfaceGeneration
    parents: Population
    quality: Quality | None


class CloneWork(Work):
    """Generates clones, and says how good they are.

    Attributes
    ----------
    run : Run
        The generation.
    assessing : Run
        The comparison with the parents.
    assessed : Assessed or None
        Of the present clones.
    refused : signal (str)
        Why what was asked for cannot be generated; empty when it can.
    changed : signal
    """

    refused = Signal(str)
    changed = Signal()

    def __init__(self, workspace: Workspace, queue: TaskQueue, parent: QObject | None = None) -> None:
        super().__init__(workspace, queue, parent)
        self.assessed: Assessed | None = None
        self.run, self.assessing = Run(queue, self), Run(queue, self)
        for run in (self.run, self.assessing):
            run.changed.connect(self.changed)
        self._parents: tuple[StyleLearner | SurfaceStyle, Population] | None = None
        workspace.clones_changed.connect(self._clones_changed)

    # ---- what there is ---------------------------------------------------------------------------

    @property
    def factors(self) -> Population | None:
        """What was measured of the clones."""
        clones = self.workspace.clones
        return None if clones is None else clones.factors

    # ---- generating ------------------------------------------------------------------------------

    def targets(self, text: str) -> list[str]:
        """Return the conditions of a text, parted by semicolons or lines.

        Raises
        ------
        GenerationError
            If one cannot be understood.
        """
        parts = [part.strip() for line in text.splitlines() for part in line.split(";")]
        given = [part for part in parts if part]
        learner = self.workspace.style or self.workspace.surfaces
        if given and learner is not None:
            from mbstudio.core.vae.generate.conditions import parse_conditions

            parse_conditions(given, learner.unit)
        return given

    def generate(
        self, count: int, seed: int = 0, where: Sequence[str] = (), options: CloneOptions | None = None
    ) -> Task | None:
        """Generate clones in the style that is there; None without one, or while it runs.

        Options are those of clones of surfaces.
        """
        if self.workspace.surfaces is not None and not self.run.is_running:
            return self._generate_surfaces(self.workspace.surfaces, count, seed, where, options)
        learner = self.workspace.style
        if learner is None or self.run.is_running:
            return None

        def work(control: Control) -> Generation:
            # What station Populations compares with takes a second to load: not in the main thread.
            import scipy.stats  # noqa: F401

            from mbstudio.core.vae.generate.generator import generate

            control.report(0.0, tr("Drawing candidates"))
            return generate(
                learner, count, seed, targets=list(where) or None, processes=_processes(count),
                on_progress=control.progress,
            )  # fmt: skip

        task = Task(plural(count, mark("Generating {count} clone"), mark("Generating {count} clones")), work)
        # What cannot be had is said where it was asked for.
        task.handled = (GenerationError,)
        task.failed.connect(self._refuse)
        task.succeeded.connect(lambda found: self._keep_clones(found, learner))
        self.refused.emit("")
        return self.run.start(task)

    def _generate_surfaces(
        self, style: SurfaceStyle, count: int, seed: int, where: Sequence[str], options: CloneOptions | None
    ) -> Task:
        def work(control: Control) -> SurfaceGeneration:
            # What station Populations compares with takes a second to load: not in the main thread.
            import scipy.stats  # noqa: F401

            from mbstudio.core.cloning.surface_generation import generate_surfaces

            control.report(0.0, tr("Warping surfaces"))
            return generate_surfaces(
                style, count, seed, options=options, targets=where, processes=_processes(count),
                progress=control.progress,
            )  # fmt: skip

        task = Task(plural(count, mark("Generating {count} clone"), mark("Generating {count} clones")), work)
        task.handled = (GenerationError, CloningError)
        task.failed.connect(self._refuse)
        task.succeeded.connect(lambda found: self._keep_surface_clones(found, style))
        self.refused.emit("")
        return self.run.start(task)

    def _keep_surface_clones(self, found: SurfaceGeneration, style: SurfaceStyle) -> None:
        if style is not self.workspace.surfaces:
            return
        title = plural(len(found), mark("Generate {count} clone"), mark("Generate {count} clones"))
        self.workspace.use_surface_clones(found, title)
        told = [plural(len(found), mark("Generated {count} clone."), mark("Generated {count} clones."))]
        fitted = [clone.fitted for clone in found.clones if clone.fitted is not None]
        told.append(
            tr(
                "Their metaballs are {rms} of Dₙ from the surfaces (rms, mean).",
                rms=f"{100 * sum(entry.rms for entry in fitted) / max(1, len(fitted)):.2f} %",
            )
        )
        invalid = sum(not entry.valid for entry in fitted)
        if invalid:
            told.append(
                plural(
                    invalid,
                    mark("The metaball of {count} clone is not valid: its surface is."),
                    mark("The metaballs of {count} clones are not valid: their surfaces are."),
                )
            )
        self.said.emit("warning" if invalid else "success", " ".join(told))
        self.assess()

    def _refuse(self, error: Exception) -> None:
        if isinstance(error, GenerationError | CloningError):
            self.refused.emit(str(error))

    def _keep_clones(self, found: Generation, learner: StyleLearner) -> None:
        if learner is not self.workspace.style:
            return
        title = plural(len(found), mark("Generate {count} clone"), mark("Generate {count} clones"))
        self.workspace.use_clones(found, title)
        missed = [figure for figure in found.reached if not figure.is_met]
        told = [
            tr(
                "Generated {clones} clones from {candidates} candidates; all are valid bodies.",
                clones=len(found),
                candidates=found.counts.candidates,
            )
        ]
        if missed:
            names = ", ".join(figure.what for figure in missed)
            told.append(tr("Conditions not fully met: {figures}.", figures=names))
        self.said.emit("warning" if missed else "success", " ".join(told))
        self.assess()

    # ---- comparing -------------------------------------------------------------------------------

    def assess(self) -> Task | None:
        """Compare the clones with their parents; None if that is done or cannot be."""
        learner, clones = self.workspace.style or self.workspace.surfaces, self.workspace.clones
        if learner is None or clones is None or clones.factors is None or self.assessing.is_running:
            return None
        if self.assessed is not None and self.assessed.clones is clones:
            return None
        task = Task(
            tr("Comparing clones and parents"), lambda control: self._compared(learner, clones, control)
        )
        task.succeeded.connect(self._keep)
        return self.assessing.start(task)

    def write_report(self, path: Path) -> Task | None:
        """Write the report of ``mbstudio generate --report``, comparing first where that is to be done."""
        learner, clones = self.workspace.style, self.workspace.state.clones
        if learner is None or clones is None or clones.factors is None:
            return None
        known = self.assessed if self.assessed is not None and self.assessed.clones is clones else None
        project = self.workspace.project.path

        def work(control: Control) -> Assessed:
            from mbstudio.scene.reports.generation_report import write_generation_report

            found = known or self._compared(learner, clones, control, 0.6)
            begun = 0.0 if known else 0.6
            assert found.quality is not None
            write_generation_report(
                path, project.stem if project else "the project", clones, found.parents, found.quality,
                progress=lambda share, told: control.progress(begun + (1 - begun) * share, told),
            )  # fmt: skip
            return found

        task = Task(tr("Writing {name}", name=path.name), work)
        task.succeeded.connect(self._keep)
        return self.queue.submit(task)

    def _compared(
        self, learner: StyleLearner | SurfaceStyle, clones: Generation | SurfaceGeneration, control: Control,
        share: float = 1.0,
    ) -> Assessed:  # fmt: skip
        from mbstudio.core.cloning.surface_generation import SurfaceGeneration
        from mbstudio.core.cloning.surface_style import SurfaceStyle
        from mbstudio.core.populations import measure_population
        from mbstudio.core.vae.generate.quality import assess

        known = self._parents
        given = None if isinstance(clones, SurfaceGeneration) else clones.parent_factors
        if given is not None:
            parents = given
        elif known is not None and known[0] is learner:
            parents = known[1]
        else:
            of_surfaces = isinstance(learner, SurfaceStyle)
            bodies: list[Any] = (
                [parent.mesh() for parent in learner.parents]
                if isinstance(learner, SurfaceStyle)
                else learner.parents.avatars()
            )
            processes = _processes(len(bodies))
            parents = measure_population(
                bodies, range(1, len(bodies) + 1), name="parents",
                kind="grains" if of_surfaces else "avatars",
                workers=0 if processes == 1 else processes,
                progress=lambda done, told: control.progress(0.7 * share * done, told),
            )  # fmt: skip
            self._parents = learner, parents
        control.progress(0.7 * share, tr("Comparing"))
        if isinstance(clones, SurfaceGeneration) or isinstance(learner, SurfaceStyle):
            return Assessed(clones, parents, None)
        assert clones.factors is not None
        quality = assess(learner.parents, parents, clones.clones, clones.factors, counts=clones.counts)
        return Assessed(clones, parents, quality)

    def _keep(self, found: Assessed) -> None:
        if found.clones is self.workspace.clones:
            self.assessed = found
            self.changed.emit()

    def _clones_changed(self) -> None:
        if self.assessed is not None and self.assessed.clones is not self.workspace.clones:
            self.assessed = None
        self.changed.emit()

    # ---- for the other stations ------------------------------------------------------------------

    def shown_populations(self) -> list[Population]:
        """Return what station Populations shows beside grains and avatars, in their unit."""
        clones, grains = self.factors, self.workspace.state.grains
        if clones is None:
            return []
        if grains is not None:
            return [clones.in_unit(grains.unit)]
        assessed: Any = self.assessed
        return [clones] if assessed is None else [assessed.parents, clones]


def _processes(bodies: int) -> int:
    return usable_cores() if bodies >= _MANY else 1
