"""``mbstudio sweep``: accuracy of avatars against their number of control points."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mbstudio.cli import console, inputs
from mbstudio.core.errors import FitError, MbstudioError

if TYPE_CHECKING:
    from mbstudio.core.grains import Grain, GrainSet
    from mbstudio.core.imaging.sweep import Sweep, SweepRow

INTERRUPTED = 130
NUMBERS = "10,20,40,80,120"
_SHOWN = ("rms", "hausdorff", "overlap_error", "area", "sphericity", "circularity", "csf", "dns")


HELP = """Fit grains with several numbers of control points, and measure the accuracy of each avatar.

The table is written after every fit; --resume continues an interrupted sweep. By default all grains
that the border does not cut are fitted; --grains selects others.
"""


def sweep(
    sources: Annotated[
        list[Path],
        typer.Argument(
            metavar="PROJECT|SCAN|MESHES...",
            help="A project, a scan, or closed surface meshes or folders of them.",
        ),
    ],
    voxel_size: inputs.VoxelSizeOption = None,
    grains: Annotated[
        str | None,
        typer.Option("--grains", metavar="1,5,9", help="Only these labels (1-20 is a range)."),
    ] = None,
    limit: Annotated[int | None, typer.Option("--limit", min=1, help="At most this many grains.")] = None,
    n: Annotated[str, typer.Option("-n", "--n", metavar="10,20,40", help="Control points to try.")] = NUMBERS,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE", help="CSV table, one row per fit.")
    ] = Path("sweep.csv"),
    figure: Annotated[
        Path | None, typer.Option("--figure", metavar="FILE", help="Draw the sweep: .svg, .png or .pdf.")
    ] = None,
    error: Annotated[
        float, typer.Option("--error", metavar="PERCENT", help="Report the smallest n that meets this error.")
    ] = 1.0,
    resume: Annotated[
        bool,
        typer.Option("--resume", help="Continue the existing table without repeating its fits."),
    ] = False,
    method: Annotated[str, typer.Option("--method", help="'fast', or 'paper'.")] = "fast",
    option: Annotated[
        list[str] | None,
        typer.Option("--option", metavar="NAME=VALUE", help="An option of the method; repeat for more."),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", help="Seed of the random numbers.")] = 0,
    splitting: inputs.SplittingOption = None,
    smallest: inputs.SmallestOption = None,
    threshold: inputs.ThresholdOption = None,
    dark: inputs.DarkOption = None,
    unit: inputs.UnitOption = None,
    resolution: Annotated[
        int, typer.Option("--resolution", help="Voxels along a mesh's longest edge.")
    ] = 120,
    cavities: inputs.MeshCavitiesOption = "fill",
    shape: inputs.ShapeOption = None,
    dtype: inputs.DtypeOption = None,
    header_bytes: inputs.HeaderOption = 0,
    big_endian: inputs.EndianOption = False,
    crop: inputs.CropOption = None,
    binning: inputs.BinOption = None,
    anyway: inputs.AnywayOption = False,
    as_json: inputs.JsonOption = False,
) -> None:
    """Run ``mbstudio sweep``; `HELP` says what it does."""
    from mbstudio.core.imaging.options import read_options
    from mbstudio.core.imaging.sweep import Sweep, read_sweep

    options = read_options(method, [f"cavities={cavities}", *(option or ())])  # type: ignore[arg-type]
    numbers = inputs.numbers_in(n, "--n") or []
    meshes = inputs.meshes_among(sources)
    _check_outputs(meshes or sources, output, figure, error, resume)
    done = read_sweep(output) if resume and output.exists() else []
    settings = inputs.segmentation_options(splitting, smallest, threshold, dark)
    inputs.require_scan_to_crop(sources[0], crop, binning)
    scan_options = (voxel_size, shape, dtype, header_bytes, big_endian, crop, binning)
    if meshes is not None:
        inputs.refuse_for_meshes(settings, voxel_size=voxel_size, shape=shape)
        found = inputs.grains_of_meshes(meshes, resolution, unit, cavities)
    else:
        found = _grains_of(inputs.one_input(sources), scan_options, settings, anyway)
    labels = _labels(found, inputs.included_numbers(grains, "--grains", found))[:limit]
    cut_out = _cut_out(found, labels, options.get("cavities") != "keep")
    work = Sweep(cut_out, numbers, method, seed, done=done, **options)  # type: ignore[arg-type]
    begun = time.monotonic()
    interrupted = _drive(work, output, done, len(labels) * len(work.numbers))
    _draw(work, figure)
    _tell(work, inputs.title_of(sources), error / 100, as_json, output, figure, time.monotonic() - begun)
    _end_as(work, interrupted)


def _end_as(work: Sweep, interrupted: bool) -> None:
    """End the command with an error if the sweep was interrupted, or came to nothing."""
    if interrupted:
        console.tell("mbstudio: interrupted: run the same command with --resume to continue.")
        raise typer.Exit(INTERRUPTED)
    if work.rows and all(row.error for row in work.rows):
        raise FitError(f"None of the {len(work.rows)} fits could be made: {work.rows[0].error}")


def _check_outputs(
    sources: Sequence[Path], output: Path, figure: Path | None, error: float, resume: bool
) -> None:
    """Refuse before the work begins what could not be written after it."""
    for source in sources:
        if not source.exists():
            raise MbstudioError(f"{source} does not exist: check the name and the folder.")
    if not error > 0:
        raise FitError(f"--error must be above 0, not {error:g} %.")
    if figure is not None:
        from mbstudio.scene.figures.sweep_figure import require_ending

        require_ending(figure)
    for path in (output, figure):
        if path is None:
            continue
        if path.is_dir():
            raise MbstudioError(f"{path} is a folder: give the name of a file.")
        if not path.resolve().parent.is_dir():
            raise MbstudioError(f"{path} cannot be written: the folder {path.parent} does not exist.")
        if path.resolve() in [source.resolve() for source in sources]:
            raise MbstudioError(f"{path} is the input of the sweep: give the output another name.")
    if output.exists() and not resume:
        raise MbstudioError(f"{output} already exists: continue it with --resume, or give another name.")


def _grains_of(
    source: Path, scan_options: tuple[Any, ...], settings: dict[str, Any], anyway: bool
) -> GrainSet:
    from mbstudio.core.project import Project

    if inputs.is_project(source):
        project = Project.open(source)
    else:
        project = Project.new(inputs.open_input_scan(source, *scan_options))
    if project.grains is None or settings:
        inputs.find_grains(project, None, settings, anyway)
    assert project.grains is not None
    return project.grains


def _labels(grains: GrainSet, wanted: list[int] | None) -> list[int]:
    known = {int(label) for label in grains.table["label"]}
    labels = grains.interior_labels if wanted is None else list(dict.fromkeys(wanted))
    for label in labels:
        if label not in known:
            raise FitError(f"There is no grain {label}: the labels are {min(known)} to {max(known)}.")
    if not labels:
        raise FitError("There is no grain to sweep: all are cut by the border. Select some with --grains.")
    return labels


def _cut_out(grains: GrainSet, labels: Sequence[int], fill_cavities: bool) -> Iterator[Grain]:
    return (grains.grain(label, fill_cavities=fill_cavities) for label in labels)


def _drive(work: Sweep, output: Path, done: Sequence[SweepRow], fits: int) -> bool:
    """Do the fits, writing the table after each; return whether it was interrupted.

    What the table held before stays in it, also where it was not asked for again.
    """
    from mbstudio.cli.fit import terminate_as_interrupt
    from mbstudio.core.imaging.sweep import joined, write_sweep

    with console.progress("Sweeping") as report, terminate_as_interrupt():
        try:
            for row in work:
                write_sweep(output, joined(work.rows, done))
                report(len(work.rows) / fits, f"grain {row.label}, n = {row.n}: loss {row.loss:.3g}")
        except KeyboardInterrupt:
            return True
    write_sweep(output, joined(work.rows, done))
    return False


def _draw(work: Sweep, figure: Path | None) -> None:
    """Draw the sweep into a file, if that is asked for and something was fitted."""
    if figure is not None and any(not row.error for row in work.rows):
        from mbstudio.scene.figures.sweep_figure import save_sweep_figure

        save_sweep_figure(figure, work.rows)


def _tell(
    work: Sweep, title: str, error: float, as_json: bool, output: Path, figure: Path | None, seconds: float
) -> None:
    smallest = work.smallest_n(error)
    if as_json:
        console.print_json(
            {
                "rows": [_plain(row) for row in work.rows],
                "error": error,
                "smallest_n": smallest,
                "table": output,
                "figure": figure,
                "seconds": round(seconds, 1),
            }
        )
    else:
        _print(work.rows, smallest, title, error)
        for path in (output, figure):
            if path is not None and path.exists():
                print(path)
    failed = [row for row in work.rows if row.error]
    for row in failed[:5]:
        console.tell(f"mbstudio: grain {row.label}, n = {row.n}: {row.error}")


def _plain(row: SweepRow) -> dict[str, Any]:
    from dataclasses import asdict

    return asdict(row)


def _print(rows: Sequence[SweepRow], smallest: dict[str, int | None], title: str, error: float) -> None:
    from mbstudio.core.imaging.sweep import quantiles_of

    def middles(name: str, numbers: Sequence[int]) -> list[Any]:
        found = quantiles_of(rows, lambda row: row.error_of(name), (0.5,))
        return [f"{100 * found[n][0]:.3g} %" if n in found else None for n in numbers]

    numbers = sorted({row.n for row in rows})
    losses = quantiles_of(rows, lambda row: row.loss, (0.5,))
    seconds = quantiles_of(rows, lambda row: row.seconds, (0.5,))
    lines = [["loss", *(losses[n][0] if n in losses else None for n in numbers), ""]]
    names = [name for name in smallest if name in _SHOWN]
    lines += [[name, *middles(name, numbers), smallest[name] or "none"] for name in names]
    lines.append(["CPU seconds", *(seconds[n][0] if n in seconds else None for n in numbers), ""])
    grains = len({row.label for row in rows})
    console.print_table(
        f"{title}, medians over {grains} grain{'s' if grains > 1 else ''}",
        ("", *(f"n = {n}" for n in numbers), f"n for {100 * error:g} %"),
        lines,
    )
