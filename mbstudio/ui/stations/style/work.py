"""Learning a style: parents are serialized, then a style-learner is trained on them, before the eyes."""

from __future__ import annotations

import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from PySide6.QtCore import QObject, Signal

from mbstudio.core.batch.processes import usable_cores
from mbstudio.core.cloning.parent_choice import spread_over_sizes
from mbstudio.core.cloning.surface_style import SurfaceStyle
from mbstudio.core.cloning.surface_style_file import save_surface_style
from mbstudio.core.formulas import nominal_diameter
from mbstudio.core.project import ProjectState
from mbstudio.core.units import conversion_factor
from mbstudio.core.vae.models.presets import PRESETS, find_preset
from mbstudio.ui.language import mark, plural, tr
from mbstudio.ui.stations.run import Run
from mbstudio.ui.stations.style.parents import Parents, Source
from mbstudio.ui.stations.style.style_folder import open_style_folder
from mbstudio.ui.stations.style.surface_learning import SURFACES, learned_surfaces
from mbstudio.ui.stations.work import Work
from mbstudio.ui.workers import Control, Report, Task, TaskQueue
from mbstudio.ui.workspace import Workspace

if TYPE_CHECKING:
    from mbstudio.core.vae.models.style_learner import StyleLearner
    from mbstudio.core.vae.models.training import StyleTraining
    from mbstudio.core.vae.models.training_step import TrainingStep
    from mbstudio.core.vae.serialize.serialization import Serialization, Template
    from mbstudio.core.vae.serialize.template_loss import TemplateLoss

KEPT_EVERY = 10.0  # seconds; what a training has learned until then outlives a crash
_MANY = 16  # bodies for which starting processes pays
_SAME_SIZE = 0.05  # voxels and the smoothed surface differ by less in D_n


@dataclass(frozen=True)
class LearnRequest:
    """How a style is to be learned; no steps means as many as the preset usually takes.

    Of surfaces, no n means as many control points as the parents need.
    """

    parents: Parents
    n: int | None = 40
    preset: str = PRESETS[0]
    steps: int | None = None
    seed: int = 0


@dataclass(eq=False)
class _Learning:
    """A training that runs."""

    training: StyleTraining
    title: str
    stop: bool = False
    latest: StyleLearner | None = None  # what a crash would leave of it
    announced: StyleLearner | None = None


@dataclass(frozen=True, eq=False)
class _Learned:
    learner: StyleLearner


@dataclass(frozen=True, eq=False)
class _Serialized:
    """Parents that were serialized, and from what: learning again does not serialize again."""

    key: tuple[Any, ...]
    state: ProjectState
    parents: Serialization
    told: tuple[str, ...]
    loss: TemplateLoss | None = None

    def is_from(self, key: tuple[Any, ...], state: ProjectState) -> bool:
        same = self.state.grains is state.grains and self.state.fits is state.fits
        return key == self.key and same


class StyleWork(Work):
    """Learns styles, and reads and writes them.

    Attributes
    ----------
    run : Run
        The serialization of the parents, then the training.
    records : list of TrainingStep
        Of the training that runs or ran last.
    began : signal
        A training begins: its curves are empty.
    recorded : signal (list of TrainingStep)
        The newest records.
    arrived : signal
        A long training has come further.
    changed : signal
        Something runs, pauses or has ended.
    """

    began = Signal()
    recorded = Signal(object)
    arrived = Signal()
    changed = Signal()

    def __init__(self, workspace: Workspace, queue: TaskQueue, parent: QObject | None = None) -> None:
        super().__init__(workspace, queue, parent)
        self.records: list[TrainingStep] = []
        self.run = Run(queue, self)
        self.run.changed.connect(self.changed)
        self._learning: _Learning | None = None
        self._keeps_surfaces = False
        self._serialized: _Serialized | None = None
        workspace.project_replaced.connect(self._forget)

    # ---- what runs -----------------------------------------------------------------------------

    @property
    def is_training(self) -> bool:
        """Whether a training runs, of which the best state can be kept."""
        return self.run.can_stop and self._learning is not None

    @property
    def learns_surfaces(self) -> bool:
        """Whether what runs keeps surfaces, without a training."""
        return self.run.is_running and self._keeps_surfaces

    @property
    def arrived_style(self) -> StyleLearner | None:
        """The best state so far of a long training, for a project that has no style-learner yet."""
        learning = self._learning
        if not self.run.is_running or learning is None or self.workspace.has_style:
            return None
        return learning.announced

    # ---- what there is to learn from -------------------------------------------------------------

    def labels(self, source: Source) -> tuple[int, ...]:
        """Return the labels of the grains or avatars that a source means."""
        state = self.workspace.state
        if source == "avatars":
            return tuple(state.included_fits)
        if state.grains is None:
            return ()
        if source == "chosen":
            return tuple(sorted(self.workspace.chosen - state.grains.excluded_labels))
        return tuple(state.grains.interior_labels) if source == "inside" else ()

    def new_labels(self, source: Source) -> tuple[int, ...]:
        """Return those of `labels` that the style-learner has not learned from.

        Grains of another project may have the same names: only one as large counts as known.
        """
        learner, grains = self.workspace.style, self.workspace.state.grains
        surfaces = self.workspace.surfaces
        if grains is None:
            return self.labels(source)
        if surfaces is not None:
            known, unit = {parent.name: parent.diameter for parent in surfaces.parents}, surfaces.unit
        elif learner is not None:
            known = dict(zip(learner.parents.names, learner.parents.diameters, strict=True))
            unit = learner.unit
        else:
            return self.labels(source)
        factor = conversion_factor(grains.unit, unit)
        volumes = dict(zip(grains.table["label"], grains.table["volume"], strict=True))

        def is_new(label: int) -> bool:
            size = factor * nominal_diameter(volumes[label])
            return not abs(known.get(_name(label), 0.0) / size - 1) < _SAME_SIZE

        return tuple(label for label in self.labels(source) if is_new(label))

    def spread(self, labels: tuple[int, ...], most: int) -> tuple[int, ...]:
        """Return so many of these grains at most, spread evenly over their sizes."""
        grains = self.workspace.state.grains
        if grains is None or len(labels) <= most:
            return labels
        volumes = dict(zip(grains.table["label"], grains.table["volume"], strict=True))
        chosen = spread_over_sizes([float(volumes[label]) for label in labels], most)
        return tuple(labels[place] for place in chosen)

    # ---- learning --------------------------------------------------------------------------------

    def learn(self, asked: LearnRequest) -> Task | None:
        """Serialize the parents, then train; None while something is learned already."""
        if self.run.is_running:
            return None
        if asked.preset == SURFACES:
            return self._learn_surfaces(asked)
        n = asked.n or LearnRequest.n
        assert n is not None
        key = (asked.parents, n, asked.seed)

        def train(parents: Serialization) -> StyleTraining:
            from mbstudio.core.vae.models.training import StyleTraining

            in_steps = find_preset(asked.preset).in_steps
            given: dict[str, Any] = {"steps": asked.steps} if in_steps and asked.steps is not None else {}
            return StyleTraining(parents, asked.preset, seed=asked.seed, **given)

        known = self._serialized
        if known is not None and known.is_from(key, self.workspace.state):
            return self._train(known, train, tr("Learn style"))
        return self._serialize(key, asked.parents, n, asked.seed, None, train, tr("Learn style"))

    def _learn_surfaces(self, asked: LearnRequest, onto: SurfaceStyle | None = None) -> Task:
        state = self.workspace.state

        def work(control: Control) -> tuple[SurfaceStyle, tuple[str, ...]]:
            control.report(0.0, tr("Reading the parents"))
            return learned_surfaces(state, asked.parents, asked.n, asked.seed, control, onto)

        self.records, self._learning, self._keeps_surfaces = [], None, True
        self.began.emit()
        # It can be paused: every report of progress is a place to wait.
        task = Task(tr("Learning surfaces"), work, fraction=lambda _: (-1.0, ""))
        title = tr("Learn style") if onto is None else tr("Continue learning")
        source = asked.parents.source
        offered = 0 if onto is not None or source == "folder" else len(self.labels(source))
        task.succeeded.connect(lambda found: self._keep_surfaces(found, title, offered))
        return self.run.start(task)

    def _keep_surfaces(self, found: tuple[SurfaceStyle, tuple[str, ...]], title: str, offered: int) -> None:
        style, notes = found
        self.workspace.use_surfaces(style, title)
        count = len(style.parents)
        words = tr("Learned the surfaces of {count} parents.", count=count)
        if count < offered:
            words = tr(
                "Learned the surfaces of {count} of {offered} grains, spread evenly over their sizes.",
                count=count,
                offered=f"{offered:,}",
            )
        invalid = sum(not entry.valid for entry in style.avatars)
        told = [words]
        if invalid:
            told.append(
                plural(
                    invalid,
                    mark("The metaball of {count} parent is not valid: surfaces are not affected."),
                    mark("The metaballs of {count} parents are not valid: surfaces are not affected."),
                )
            )
        self.said.emit("warning" if notes or invalid else "success", " ".join((*told, *notes)))

    def learn_on(self, parents: Parents, seed: int = 0) -> Task | None:
        """Teach new parents to the style-learner that is there."""
        learner = self.workspace.style
        if not self.run.is_running and self.workspace.surfaces is not None:
            asked = LearnRequest(parents, None, SURFACES, seed=seed)
            return self._learn_surfaces(asked, self.workspace.surfaces)
        if self.run.is_running or learner is None:
            return None

        def train(new: Serialization) -> StyleTraining:
            from mbstudio.core.vae.models.learning_on import LearningOn

            return LearningOn(learner, new, seed=seed)

        template = learner.template
        return self._serialize((), parents, template.n, seed, template, train, tr("Continue learning"))

    def _serialize(
        self, key: tuple[Any, ...], parents: Parents, n: int, seed: int, template: Template | None,
        train: Any, title: str,
    ) -> Task:  # fmt: skip
        state = self.workspace.state

        def work(control: Control) -> _Serialized:
            control.report(0.0, tr("Reading the parents"))
            return _serialized(key, state, parents, n, seed, template, control)

        self._keeps_surfaces = False
        # It can be paused: every report of progress is a place to wait.
        task = Task(tr("Serializing the parents"), work, fraction=lambda _: (-1.0, ""))
        task.succeeded.connect(lambda found: self._train(found, train, title))
        self._learning = None
        return self.run.start(task)

    def _train(self, serialized: _Serialized, train: Any, title: str) -> Task:
        self._serialized = serialized

        def work(control: Control) -> Iterator[TrainingStep | _Learned]:
            control.report(0.0, tr("Preparing the training"))
            learning = _Learning(train(serialized.parents), title)
            self._learning = learning
            return _drive(learning)

        def end_early() -> None:
            if self._learning is not None:
                self._learning.stop = True

        self.records, self._learning = [], None
        self.began.emit()
        task = Task(tr("Learning the style"), work, fraction=_fraction)
        task.reported.connect(self._report)
        task.succeeded.connect(lambda last: self._keep_learner(last, title, serialized))
        task.ended.connect(self.arrived)
        return self.run.start(task, end_early)

    def _report(self, report: Report) -> None:
        learning = self._learning
        if learning is not None and learning.latest is not learning.announced:
            learning.announced = learning.latest
            self.arrived.emit()
        records = [step for step in report.steps if not isinstance(step, _Learned)]
        if records:
            self.records += records
            self.recorded.emit(records)

    def _keep_learner(self, last: object, title: str, serialized: _Serialized) -> None:
        if not isinstance(last, _Learned):
            return
        learner, card = last.learner, last.learner.card
        if serialized.loss is not None:
            # Beside the style wherever it goes: what is learned from has lost this already.
            card = replace(card, notes=(*card.notes, describe_loss(serialized.loss)))
            learner = replace(learner, card=card)
        self._learning = None
        self.workspace.use_style(learner, title)
        notes = [*serialized.told, *[step.note for step in self.records if step.note]]
        words = [tr("Learned the style of {count} parents.", count=card.count)]
        if np.isfinite(card.held_out_rms):
            error = percent(card.held_out_rms)
            words.append(tr("Unseen parents are reproduced to {error} of Dₙ.", error=error))
        self.said.emit("warning" if notes else "success", " ".join((*words, *notes)))

    # ---- files -----------------------------------------------------------------------------------

    def open(self, folder: Path) -> Task:
        """Read the style-learner of a folder."""

        def take(opened: tuple[Any, tuple[str, ...]]) -> None:
            learner, notes = opened
            if isinstance(learner, SurfaceStyle):
                self.workspace.use_surfaces(learner, tr("Open style"))
            else:
                self.workspace.use_style(learner, tr("Open style-learner"))
            for note in notes:
                self.said.emit("warning", note)
            self.began.emit()

        task = Task(tr("Opening {name}", name=folder.name), lambda control: open_style_folder(folder))
        task.succeeded.connect(take)
        self.records = []
        return self.queue.submit(task)

    def save(self, folder: Path) -> Task | None:
        """Write the style-learner into a folder."""
        learner, surfaces = self.workspace.style, self.workspace.surfaces
        if surfaces is not None:
            task = Task(
                tr("Saving {name}", name=folder.name), lambda control: save_surface_style(surfaces, folder)
            )
        elif learner is not None:
            task = Task(tr("Saving {name}", name=folder.name), lambda control: learner.save(folder))
        else:
            return None
        task.succeeded.connect(
            lambda written: self.said.emit("success", tr("Saved the style in {path}.", path=written))
        )
        return self.queue.submit(task)

    def _forget(self) -> None:
        self.run.cancel()
        self.records, self._serialized, self._learning = [], None, None
        self.began.emit()
        self.changed.emit()


def percent(share: float) -> str:
    """Return an error in percent; what is nothing but rounding is not called zero."""
    return f"{100 * share:.2f} %" if share >= 5e-5 else tr("less than 0.01 %")


def describe_loss(loss: TemplateLoss) -> str:
    """Return what grains have lost to the template, in words."""
    return tr(
        "Loss of the template against {grains} grains: volume {volume:+.2f} %, convexity {convexity:+.3f}.",
        grains=loss.grains,
        volume=100 * loss.volume,
        convexity=loss.convexity,
    )


def _name(label: int) -> str:
    return f"grain {label}"


def _serialized(
    key: tuple[Any, ...], state: ProjectState, parents: Parents, n: int, seed: int,
    template: Template | None, control: Control,
) -> _Serialized:  # fmt: skip
    from mbstudio.core.errors import SerializationWarning
    from mbstudio.core.vae.serialize.mesh_folder import read_parents
    from mbstudio.core.vae.serialize.serializer import serialize
    from mbstudio.core.vae.serialize.template_loss import measure_loss

    bodies: list[Any]
    if parents.source == "folder":
        bodies, names = read_parents(parents.folder or Path(), parents.unit)
    else:
        names = [_name(label) for label in parents.labels]
        if parents.source == "avatars":
            bodies = [state.fits[label].avatar for label in parents.labels]
        else:
            assert state.grains is not None
            bodies = [state.grains.body(label, fill_cavities=True) for label in parents.labels]
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always", SerializationWarning)
        found = serialize(
            bodies, n, template=template, unit=parents.unit, names=names, seed=seed,
            processes=usable_cores() if len(bodies) >= _MANY else 1, on_progress=control.progress,
        )  # fmt: skip
    words = tuple(str(entry.message) for entry in told if issubclass(entry.category, SerializationWarning))
    control.report(-1.0, tr("Comparing with the grains"))
    loss = measure_loss(bodies, found, unit=parents.unit) if len(found) == len(bodies) else None
    return _Serialized(key, state, found, words, loss)


def _drive(learning: _Learning) -> Iterator[TrainingStep | _Learned]:
    kept = time.monotonic()
    for record in learning.training:
        if time.monotonic() - kept > KEPT_EVERY:
            learning.latest, kept = learning.training.result(), time.monotonic()
        yield record
        if learning.stop:
            break
    yield _Learned(learning.training.result())


def _fraction(step: TrainingStep | _Learned) -> tuple[float, str]:
    if isinstance(step, _Learned):
        return 1.0, tr("Done")
    told = tr("Step {step} of {steps}", step=step.step, steps=step.steps)
    return (step.step / step.steps if step.steps else 1.0), told
