"""``mbstudio fit``: avatars for the grains of a scan, a project or a mesh."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args

import typer

from mbstudio.cli import console, inputs
from mbstudio.core.counting import counted
from mbstudio.core.errors import FitError, MbstudioError

if TYPE_CHECKING:
    from mbstudio.cli.going_on import FinishedFits
    from mbstudio.core.grains import GrainSet
    from mbstudio.core.imaging import FitResult
    from mbstudio.core.project import FitSettings, Project

INTERRUPTED = 130


def _tell_options(wanted: bool) -> None:
    """Print the options of both methods and end, if that is wanted."""
    if not wanted:
        return
    from mbstudio.core.imaging.options import find_options
    from mbstudio.core.imaging.steps import Method

    for method in get_args(Method):
        print(f"{method}:")
        console.print_options(find_options(method).list_options().options)
    raise typer.Exit


HELP = """Fit avatars to all grains that the border does not cut, and save the project.

If the project or scan has no grains yet, they are found first, and saved. Each avatar is written to a
journal beside the project as soon as it is finished. So whatever ends the command, the same command then
continues with the rest; --refit begins anew.
"""

SourcesArgument = Annotated[
    list[Path],
    typer.Argument(
        metavar="SCAN|PROJECT|MESHES...",
        help="A scan, a project, or closed surface meshes: files, folders or patterns.",
    ),
]
NOption = Annotated[int, typer.Option("-n", "--control-points", help="Control points of each avatar.")]
OutputOption = Annotated[
    Path | None,
    typer.Option(
        "--output", "-o", metavar="FILE", help="Project file; by default a project is saved in place."
    ),
]
MethodOption = Annotated[
    str, typer.Option("--method", help="'fast', or 'paper' for the published algorithms.")
]
ExtraOption = Annotated[
    list[str] | None,
    typer.Option(
        "--option",
        metavar="NAME=VALUE",
        help="An option of the method; repeat for more. --options lists all.",
    ),
]
TellOptionsOption = Annotated[
    bool,
    typer.Option(
        "--options",
        is_eager=True,
        callback=_tell_options,
        help="List the options of both methods, and exit.",
    ),
]
CavitiesOption = Annotated[
    str,
    typer.Option("--cavities", help="'fill' enclosed cavities, or 'keep' them as voids of the avatar."),
]
TargetOption = Annotated[
    str | None,
    typer.Option(
        "--target",
        metavar="WORDS",
        help="Find the fewest control points that reach this, instead of -n: "
        "'volume 0.5 % and hausdorff 2 %'.",
    ),
]
SeedOption = Annotated[int, typer.Option("--seed", help="Seed of the random numbers.")]
GrainsOption = Annotated[
    str | None, typer.Option("--grains", metavar="3,5,9", help="Fit only these labels (1-20 is a range).")
]
LimitOption = Annotated[int | None, typer.Option("--limit", help="Fit at most this many grains.")]
RefitOption = Annotated[bool, typer.Option("--refit", help="Also fit grains that already have an avatar.")]
ResolutionOption = Annotated[int, typer.Option("--resolution", help="Voxels along a mesh's longest edge.")]
EmbedScanOption = Annotated[
    bool, typer.Option("--embed-scan", help="Store the scan's voxels in the project.")
]


def fit(
    sources: SourcesArgument,
    voxel_size: inputs.VoxelSizeOption = None,
    n: NOption = 40,
    output: OutputOption = None,
    method: MethodOption = "fast",
    option: ExtraOption = None,
    _options: TellOptionsOption = False,
    cavities: CavitiesOption = "fill",
    target: TargetOption = None,
    seed: SeedOption = 0,
    workers: inputs.WorkersOption = None,
    grains: GrainsOption = None,
    limit: LimitOption = None,
    refit: RefitOption = False,
    labels: inputs.LabelsOption = None,
    splitting: inputs.SplittingOption = None,
    smallest: inputs.SmallestOption = None,
    threshold: inputs.ThresholdOption = None,
    dark: inputs.DarkOption = None,
    unit: inputs.UnitOption = None,
    resolution: ResolutionOption = 120,
    scan: inputs.ScanOption = None,
    embed_scan: EmbedScanOption = False,
    shape: inputs.ShapeOption = None,
    dtype: inputs.DtypeOption = None,
    header_bytes: inputs.HeaderOption = 0,
    big_endian: inputs.EndianOption = False,
    crop: inputs.CropOption = None,
    binning: inputs.BinOption = None,
    anyway: inputs.AnywayOption = False,
    as_json: inputs.JsonOption = False,
) -> None:
    """Run ``mbstudio fit``; `HELP` says what it does."""
    from mbstudio.cli.going_on import FinishedFits, go_on_from, was_found_so
    from mbstudio.core.imaging.goals.fit_goal import FitGoal
    from mbstudio.core.imaging.options import read_options
    from mbstudio.core.project import FitSettings, Project

    begun = time.monotonic()
    options = read_options(method, [f"cavities={cavities}", *(option or ())])  # type: ignore[arg-type]
    aims = str(FitGoal.parse(target)) if target is not None else ""
    meshes = inputs.meshes_among(sources)
    source = sources[0]
    inputs.require_scan_to_crop(source, crop, binning)
    is_named, output = output is not None, _choose_output(meshes or sources, output)
    settings = inputs.segmentation_options(splitting, smallest, threshold, dark)
    if meshes is not None:
        inputs.refuse_for_meshes(settings, voxel_size=voxel_size, shape=shape, labels=labels, scan=scan)
        project = Project.new()
        project.change("Load mesh", grains=inputs.grains_of_meshes(meshes, resolution, unit, cavities))
    elif inputs.is_project(source):
        project = Project.open(source)
        if scan is not None:
            project.relocate_scan(scan)
    else:
        opened = inputs.open_input_scan(
            source, voxel_size, shape, dtype, header_bytes, big_endian, crop, binning
        )
        project = Project.new(opened, embed_scan=embed_scan)
    project = go_on_from(output, project, labels, settings, named=is_named)
    with project:
        project.hold("mbstudio fit", output)
        if not was_found_so(project, labels, settings):
            inputs.find_grains(project, labels, settings, anyway)
        assert project.grains is not None
        wanted = FitSettings(n, method, seed, options, aims)  # type: ignore[arg-type]
        project.change("Fit settings", fit_settings=wanted)
        asked = inputs.included_numbers(grains, "--grains", project.grains)
        chosen = choose_labels(project, asked, limit, refit)
        _tell_done(len(choose_labels(project, asked, None, True)), chosen, limit)
        embed = True if embed_scan else None
        outcome = fit_into(project, chosen, workers, FinishedFits(project, output, embed))
        if outcome.fits or not chosen or not output.exists():  # a file of avatars must not give way to none
            inputs.save_results(project, output, embed)

    summary = summarise(project.grains, outcome.fits, outcome.failures, time.monotonic() - begun)
    summary["project"] = str(output) if output.exists() else None
    _tell_outcome(inputs.title_of(sources), summary, project.grains, outcome, as_json)
    _end_as(outcome, chosen, inputs.title_of(sources), output)


def _tell_done(asked: int, chosen: list[int], limit: int | None) -> None:
    """Say what was done before, if something was."""
    done = asked - len(chosen)
    if done and limit is None:
        console.tell(f"mbstudio: {done} of {asked} grains were fitted before; {len(chosen)} to go.")


def _end_as(outcome: Outcome, chosen: list[int], title: str, output: Path) -> None:
    """End the command with an error if fitting was interrupted, or came to nothing."""
    if outcome.interrupted:
        left = len(chosen) - len(outcome.fits) - len(outcome.failures)
        console.tell(
            f"mbstudio: interrupted; {counted(left, 'grain is', 'grains are')} left: "
            f"run 'mbstudio fit {output}' to continue."
        )
        raise typer.Exit(INTERRUPTED)
    if chosen and not outcome.fits:
        raise FitError(
            f"None of the {len(chosen)} grains of {title} could be fitted: the reasons are listed above."
        )


def _tell_outcome(
    title: str, summary: dict[str, Any], grains: GrainSet, outcome: Outcome, as_json: bool
) -> None:
    names = _names_of(grains)
    if as_json:
        told = {"names": names} if names else {}
        console.print_json(
            {**summary, **told, "failures": outcome.failures, "interrupted": outcome.interrupted}
        )
    else:
        console.print_facts(f"Avatars of {title}", summary)
        if len(names) > 1:
            console.print_table("Grains of the meshes", ("grain", "name"), list(names.items()))
    _tell_failures_and_warnings(outcome)


def _tell_failures_and_warnings(outcome: Outcome) -> None:
    """Name the first few grains without an avatar, and the first few with warnings."""
    for label, reason in list(outcome.failures.items())[:5]:
        console.tell(f"mbstudio: grain {label} has no avatar: {reason}")
    warned = {
        label: result.verdict.warnings for label, result in outcome.fits.items() if result.verdict.warnings
    }
    for label, told in list(warned.items())[:5]:
        console.tell(f"mbstudio: grain {label}: {' '.join(told)}")
    if len(warned) > 5:
        console.tell(f"mbstudio: and {len(warned) - 5} more grains with warnings.")


class Outcome:
    """What came of fitting: avatars and failures by label, and whether it was cut short."""

    def __init__(self) -> None:
        self.fits: dict[int, FitResult] = {}
        self.failures: dict[int, str] = {}
        self.interrupted = False


def _names_of(grains: GrainSet) -> dict[int, str]:
    """Return the names of grains that were made of meshes."""
    if "name" not in grains.table:
        return {}
    return dict(zip(map(int, grains.table["label"]), map(str, grains.table["name"]), strict=True))


def _choose_output(sources: Sequence[Path], output: Path | None) -> Path:
    for source in sources:
        if not source.exists():
            raise MbstudioError(f"{source} does not exist: check the name and the folder.")
    source = sources[0] if len(sources) == 1 else sources[0].parent.resolve()
    if output is not None:
        return inputs.require_project_output(output)
    if inputs.is_project(source):
        return source
    output = Path(source.name).with_suffix(inputs.PROJECT_ENDING)
    return inputs.require_project_output(output)


def choose_labels(project: Project, wanted: list[int] | None, limit: int | None, refit: bool) -> list[int]:
    """Return the labels to fit: all interior grains without an avatar by default."""
    assert project.grains is not None
    if limit is not None and limit < 1:
        raise FitError(f"--limit {limit} leaves no grain to fit: give at least 1.")
    if wanted is None:
        labels = project.grains.interior_labels
    else:
        known = {int(label) for label in project.grains.table["label"]}
        unknown = [label for label in wanted if label not in known]
        if unknown:
            raise FitError(f"There is no grain {unknown[0]}: the labels are {min(known)} to {max(known)}.")
        labels = wanted
    settings = project.state.fit_settings
    if not refit:
        labels = [
            label
            for label in labels
            if label not in project.fits
            or label in project.state.changed_labels
            or not _is_as_asked(project.fits[label], label, settings)
        ]
    return labels[:limit]


def _is_as_asked(done: FitResult, label: int, settings: FitSettings) -> bool:
    from mbstudio.core.batch.many_fits import grain_seed

    # The window fits single grains with the seed itself, a batch with one made of it.
    seeds = (settings.seed, grain_seed(settings.seed, label))
    same_number = done.target == settings.target and (bool(done.target) or done.n == settings.n)
    same = same_number and done.method == settings.method and done.seed in seeds
    return same and dict(done.options) == dict(settings.options)


def fit_into(
    project: Project, labels: list[int], workers: int | None = None, finished: FinishedFits | None = None
) -> Outcome:
    """Fit grains and add their avatars to the project, also when interrupted.

    Each avatar goes to what is `finished` at once.
    """
    from mbstudio.core.batch.many_fits import fit_many

    outcome = Outcome()
    settings = project.state.fit_settings
    assert project.grains is not None
    items: Any = fit_many(
        project.grains, labels, n=settings.n, method=settings.method, seed=settings.seed, workers=workers,
        options=settings.options, target=settings.target,
    )  # fmt: skip
    if finished is not None and labels:
        finished.begin()
    with console.progress("Fitting") as report, terminate_as_interrupt():
        try:
            for done, item in enumerate(items, start=1):
                if item.result is not None:
                    outcome.fits[item.label] = item.result
                    if finished is not None:
                        finished.keep(item.label, item.result)
                else:
                    outcome.failures[item.label] = item.error or "The reason is unknown."
                report(done / len(labels), f"{done} of {len(labels)} grains")
        except KeyboardInterrupt:
            outcome.interrupted = True
        finally:
            items.close()
    if outcome.fits:
        project.add_fits({label: outcome.fits[label] for label in sorted(outcome.fits)})
    return outcome


@contextmanager
def terminate_as_interrupt() -> Iterator[None]:
    """Let the signal that batch systems send before they kill a job stop it as Ctrl-C does."""

    def stop(_number: int, _frame: Any) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGTERM, stop)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def summarise(
    grains: GrainSet, fits: dict[int, FitResult], failures: dict[int, str], seconds: float
) -> dict[str, Any]:
    """Return the figures of a batch: how many, how true, how long."""
    from mbstudio.core.formulas import nominal_diameter
    from mbstudio.core.imaging.goals.fit_goal import FitGoal

    volume_of = dict(zip(grains.table["label"], grains.table["volume"], strict=True))
    diameters = [nominal_diameter(volume_of[label]) for label in fits]
    verdicts = [result.verdict for result in fits.values()]
    rms = [verdict.rms / diameter for verdict, diameter in zip(verdicts, diameters, strict=True)]
    aimed = [result for result in fits.values() if result.target]
    of_target = {
        "reached_target": sum(FitGoal.parse(result.target).is_met(result.reached) for result in aimed),
        "median_control_points": _median([result.n for result in aimed]),
    }
    return {
        "grains": len(grains),
        "interior": len(grains.interior_labels),
        "fitted": len(fits),
        "failed": len(failures),
        "valid": sum(verdict.valid for verdict in verdicts),
        "not_one_piece": sum(verdict.pieces != 1 for verdict in verdicts),
        "with_voids": sum(verdict.voids > 0 for verdict in verdicts),
        "median_volume_error_percent": _median([100 * abs(verdict.volume_error) for verdict in verdicts]),
        "median_rms_percent_of_dn": _median([100 * ratio for ratio in rms]),
        **(of_target if aimed else {}),
        "seconds": round(seconds, 1),
    }


def _median(values: list[float]) -> float | None:
    import numpy as np

    return float(np.median(values)) if values else None
