"""``mbstudio learn``: a style-learner from grains, avatars or meshes."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mbstudio.cli import console, inputs
from mbstudio.cli.fit import INTERRUPTED, terminate_as_interrupt
from mbstudio.cli.going_on import keeping_results
from mbstudio.cli.measure import GrainsOption, LimitOption, chosen_grains
from mbstudio.core.errors import MbstudioError, SerializationError, StyleError
from mbstudio.core.vae.models.presets import PRESETS, find_preset

if TYPE_CHECKING:
    from mbstudio.core.vae.models.style_learner import StyleLearner
    from mbstudio.core.vae.models.training import StyleTraining
    from mbstudio.core.vae.serialize.serialization import Serialization, Template


SURFACES = "surfaces"
_KNOWN = (*PRESETS, SURFACES)


def _known_preset(name: str) -> str:
    if name not in _KNOWN:
        raise typer.BadParameter(f"{name!r} is not one of {', '.join(map(repr, _KNOWN))}.")
    return name


HELP = """Train a style-learner on grains, from which 'mbstudio generate' makes new ones.

Every grain is first fitted from one common template, so that control point i means the same in each.
Then the style-learner is trained. When interrupted, the command saves the best state so far; the same command
goes on with the training, also after a kill. With --on, preset and number of control points are those of the
given style-learner; it does not forget its parents.

Preset 'surfaces' keeps the surfaces of the grains themselves: clones have their faces and edges, and each
comes with a metaball that was freely fitted to it. It is the one for angular grains.
"""


def learn(
    sources: Annotated[
        list[Path],
        typer.Argument(
            metavar="PROJECT|MESHES...",
            help="A project with grains, meshes or folders of them, or an .npz file of avatars.",
        ),
    ],
    folder: Annotated[
        Path, typer.Option("--output", "-o", metavar="FOLDER", help="Output folder of the style-learner.")
    ],
    preset: Annotated[
        str,
        typer.Option(
            "--preset",
            metavar=f"[{'|'.join(_KNOWN)}]",
            callback=_known_preset,
            help="'surfaces' keeps faces and edges of angular grains, 'pca' is the linear baseline, 'paper' "
            "the method as published.",
        ),
    ] = PRESETS[0],
    n: Annotated[
        int | None,
        typer.Option(
            "-n",
            "--n",
            min=1,
            help="Control points of each avatar; 40 by default, with 'surfaces' 120 unless smooth.",
        ),
    ] = None,
    on: Annotated[
        Path | None,
        typer.Option(
            "--on",
            metavar="STYLE",
            help="Continue training this style-learner with the grains, in addition to its parents.",
        ),
    ] = None,
    steps: Annotated[int | None, typer.Option("--steps", min=1, help="Number of training steps.")] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the random numbers.")] = 0,
    grains: GrainsOption = None,
    limit: LimitOption = None,
    from_avatars: Annotated[
        bool, typer.Option("--avatars", help="Learn from a project's avatars instead of its grains.")
    ] = False,
    unit: inputs.UnitOption = None,
    cavities: inputs.MeshCavitiesOption = "fill",
    workers: inputs.WorkersOption = None,
    as_json: inputs.JsonOption = False,
) -> None:
    """Run ``mbstudio learn``; `HELP` says what it does."""
    from mbstudio.core.batch.processes import usable_cores

    if inputs.require_cavities(cavities) == "keep":
        raise StyleError("A style is learned of outer surfaces, without cavities: leave --cavities keep out.")
    _require_folder(folder)
    if preset == SURFACES:
        from mbstudio.cli.surfaces import learn_surface_style

        if on is not None or steps is not None:
            raise StyleError("--on and --steps do not apply to preset 'surfaces': leave them out.")
        learn_surface_style(
            lambda: _bodies(sources, grains, limit, from_avatars, unit), inputs.title_of(sources), folder, n,
            seed, unit, workers or usable_cores(), takes_all=limit is not None, as_json=as_json,
        )  # fmt: skip
        return
    _learn_by_template(
        lambda number, template: _parents(
            sources, number, seed, grains, limit, from_avatars, unit, workers or usable_cores(), template
        ),
        inputs.title_of(sources), folder, preset, n, on, steps, seed, as_json=as_json,
    )  # fmt: skip


_USUAL_NUMBER = 40


def _learn_by_template(
    read: Callable[[int, Template | None], Serialization], title: str, folder: Path, preset: str,
    n: int | None, on: Path | None, steps: int | None, seed: int, *, as_json: bool,
) -> None:  # fmt: skip
    """Learn a style of serialized grains; `read` returns them, given control points and a template."""
    from mbstudio.core.vae.models.style_learner import load_style_learner

    begun = time.monotonic()
    options: dict[str, Any] = {}
    known = None if on is None else load_style_learner(on)
    if steps is not None:
        chosen = find_preset(preset if known is None else known.preset)
        if not chosen.in_steps:
            raise StyleError(f"--steps does not apply to preset '{chosen.name}': leave it out.")
        options["steps"] = steps
    template = None if known is None else known.template
    with keeping_results(folder) as kept:
        parents = read(n or _USUAL_NUMBER, template)
        training = _begin(parents, known, preset, seed, options, _checkpoint(folder))
        learner, kept.stays = _trained(training)
        learner.save(folder)
    interrupted = kept.stays
    if not interrupted:
        _checkpoint(folder).unlink(missing_ok=True)
    summary = _summary(learner, folder, time.monotonic() - begun)
    if as_json:
        console.print_json({**summary, "notes": learner.card.notes, "interrupted": interrupted})
    else:
        console.print_facts(f"Style of {title}", summary)
        for note in learner.card.notes:
            console.tell(f"mbstudio: {note}")
    if interrupted:
        console.tell("mbstudio: interrupted: the best state so far was saved.")
        raise typer.Exit(INTERRUPTED)


def _checkpoint(folder: Path) -> Path:
    """Return where a training is kept until it has come to its end."""
    target = folder.resolve()
    return target.with_name(f"{target.name}.checkpoint")


def _begin(
    parents: Serialization, known: StyleLearner | None, preset: str, seed: int, options: dict[str, Any],
    checkpoint: Path,
) -> StyleTraining:  # fmt: skip
    """Return a training, which goes on where it was ended before."""
    from mbstudio.core.vae.models.learning_on import learn_on
    from mbstudio.core.vae.models.training import StyleTraining

    training = (
        StyleTraining(parents, preset, seed=seed, **options)
        if known is None
        else learn_on(known, parents, seed=seed, **options)
    )
    _go_on(training, checkpoint)
    return training


def _go_on(training: StyleTraining, checkpoint: Path) -> None:
    """Keep a training from now on, and go on from where it was ended before."""
    if not training.preset.in_steps:
        return
    try:
        training.keep_at(checkpoint)
    except StyleError:
        console.tell(f"mbstudio: {checkpoint.name} is damaged or of another training, which begins anew.")
        checkpoint.unlink()
        training.keep_at(checkpoint)
    if training.history:
        console.tell(f"mbstudio: going on from step {training.history[-1].step} ({checkpoint.name}).")


def _require_folder(folder: Path) -> None:
    """Refuse a place that holds something else, before the work begins."""
    from mbstudio.core.cloning.surface_style_file import CARD_FILE as SURFACE_CARD
    from mbstudio.core.vae.models.style_learner import CARD_FILE

    if folder.exists() and not folder.is_dir():
        raise StyleError(f"{folder} is a file: give the name of a folder for the style-learner.")
    known = any((folder / card).exists() for card in (CARD_FILE, SURFACE_CARD))
    if folder.is_dir() and any(folder.iterdir()) and not known:
        raise StyleError(
            f"{folder} contains other files but no style-learner: choose an empty or a new folder."
        )


def _parents(
    sources: list[Path], n: int, seed: int, grains: str | None, limit: int | None, from_avatars: bool,
    unit: str | None, workers: int, template: Template | None,
) -> Serialization:  # fmt: skip
    """Return the serialized parents of whatever was given."""
    from mbstudio.core.vae.serialize.serialization import load_serialization
    from mbstudio.core.vae.serialize.serializer import serialize

    stored = _stored(sources[0]) if len(sources) == 1 else None
    if stored is not None:
        return load_serialization(stored)
    bodies, names = _bodies(sources, grains, limit, from_avatars, unit)
    with console.progress("Serializing") as report, warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        found = serialize(
            bodies,
            n,
            template=template,
            unit=unit,
            names=names,
            seed=seed,
            processes=workers,
            on_progress=report,
        )
    for entry in told:
        if entry.category.__module__.startswith("mbstudio"):
            console.tell(f"mbstudio: {entry.message}")
    return found


def _bodies(
    sources: list[Path], grains: str | None, limit: int | None, from_avatars: bool, unit: str | None
) -> tuple[list[Any], list[str]]:
    """Return grains, avatars or meshes and their names."""
    meshes = inputs.meshes_among(sources)
    source = sources[0]
    if meshes is not None:
        bodies: list[Any] = list(inputs.bodies_of_meshes(meshes, unit, "fill", grains, limit))
        return bodies, [str(body.metadata["name"]) for body in bodies]
    if not source.exists():
        raise MbstudioError(f"{source} does not exist: check the name and the folder.")
    if source.is_dir():
        raise MbstudioError(
            f"{source} contains no meshes ({', '.join(inputs.mesh_endings())}): "
            "give a project or another folder."
        )
    project, labels = chosen_grains(source, grains, limit)
    if from_avatars:
        labels = [label for label in labels if label in project.fits]
        bodies = [project.fits[label].avatar for label in labels]
    else:
        bodies = [project.grains.body(label, fill_cavities=True) for label in labels]
    if not bodies:
        raise SerializationError(f"{source} has no avatars yet: fit them first, or leave --avatars out.")
    return bodies, [f"grain {label}" for label in labels]


def _stored(source: Path) -> Path | None:
    """Return the file of serialized avatars that is meant, alone or in a folder without meshes."""
    if source.suffix.lower() == ".npz" and source.exists():
        return source
    if not source.is_dir() or any(inputs.is_mesh(path) for path in source.iterdir()):
        return None
    found = sorted(source.glob("*.npz"))
    return found[0] if len(found) == 1 else None


def _trained(training: StyleTraining) -> tuple[StyleLearner, bool]:
    interrupted = False
    with console.progress("Learning") as report, terminate_as_interrupt():
        try:
            for record in training:
                share = record.step / record.steps if record.steps else 1.0
                report(
                    share, f"step {record.step} of {record.steps}, error {100 * record.held_out:.2f} % of D_n"
                )
        except KeyboardInterrupt:
            if not training.history:
                raise
            interrupted = True
    return training.result(), interrupted


def _summary(learner: StyleLearner, folder: Path, seconds: float) -> dict[str, Any]:
    card = learner.card
    return {
        "style": str(folder),
        "preset": card.preset,
        "parents": card.count,
        "control_points": card.n,
        "latents": card.latents,
        "steps": card.steps,
        "avatars_rms_percent_of_dn": 100 * card.parents_rms,
        "trained_rms_percent_of_dn": 100 * card.trained_rms,
        "held_out_rms_percent_of_dn": 100 * card.held_out_rms,
        "seconds": round(seconds, 1),
    }
