"""``mbstudio generate``: new grains in the style of their parents."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mbstudio.cli import console, inputs
from mbstudio.cli.going_on import keeping_results
from mbstudio.cli.measure import require_table_output
from mbstudio.core.errors import GenerationError

if TYPE_CHECKING:
    from mbstudio.core.vae.generate.generation import Generation
    from mbstudio.core.vae.generate.quality import Quality
    from mbstudio.core.vae.models.style_learner import StyleLearner

TABLE = "factors.csv"

WhereOption = Annotated[
    list[str] | None,
    typer.Option(
        "--where",
        metavar="WORDS",
        help="A condition on the clones: 'sphericity=0.75..0.8', 'csf=0.7+-0.05', 'D50=0.4 mm', "
        "'sieve=0.3:10,0.4:55,0.6:100 mm'; repeat for more.",
    ),
]
StretchOption = Annotated[
    float | None,
    typer.Option("--stretch", help="Of a style of surfaces: largest stretch of a parent, usually 1.4."),
]
DetailOption = Annotated[
    float | None,
    typer.Option(
        "--detail-stretch",
        help="Of a style of surfaces: share of the stretch that edges and roughness take on, usually 0; "
        "1 keeps planes plane.",
    ),
]
WarpingOption = Annotated[
    float | None,
    typer.Option(
        "--warping", help="Of a style of surfaces: strength of the warp, usually 0.2; 1 is as grains differ."
    ),
]
ReportOption = Annotated[
    Path | None,
    typer.Option("--report", metavar="FILE", help="Write a comparison of parents and clones as HTML."),
]


HELP = """Generate new valid grains whose factors are distributed like their parents', or as --where states.

Each clone becomes a CSV and a JSON file of control points, as 'mbstudio export --to metaball' writes
them. factors.csv holds the shape factors of all clones. What is found on the way is kept beside the output
until that is written, so that the same command goes on where it was ended. Of a style of surfaces ('mbstudio
learn --preset surfaces') each clone comes with its surface as a PLY file too, on which its factors are
measured; clones.csv says what each was made of and how far its metaball is from its surface.
"""


def generate(
    style: Annotated[Path, typer.Argument(metavar="STYLE", help="The folder that 'mbstudio learn' wrote.")],
    folder: Annotated[
        Path, typer.Option("--output", "-o", metavar="FOLDER", help="Output folder of the clones.")
    ],
    count: Annotated[int, typer.Option("--count", help="Number of clones.")] = 100,
    seed: Annotated[int, typer.Option("--seed", min=0, help="The same seed gives the same clones.")] = 0,
    where: WhereOption = None,
    stretch: StretchOption = None,
    warping: WarpingOption = None,
    detail_stretch: DetailOption = None,
    unit: Annotated[str | None, typer.Option("--unit", help="Length unit of the files.")] = None,
    report: ReportOption = None,
    workers: inputs.WorkersOption = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Write into a folder that contains other files.")
    ] = False,
    as_json: inputs.JsonOption = False,
) -> None:
    """Run ``mbstudio generate``; `HELP` says what it does."""
    from mbstudio.cli.surfaces import generate_surface_clones
    from mbstudio.core.batch.processes import usable_cores
    from mbstudio.core.cloning.surface_style_file import holds_surface_style
    from mbstudio.core.dem.folder import check_replaceable
    from mbstudio.core.dem.manifest import files_of_earlier_export
    from mbstudio.core.vae.generate.generator import generate as generate_clones
    from mbstudio.core.vae.models.style_learner import load_style_learner

    begun = time.monotonic()
    if holds_surface_style(style):
        if report is not None:
            raise GenerationError(
                "--report compares serialized parents with clones, and this is a style of surfaces: "
                "use 'mbstudio judge' on the clones."
            )
        given = {"stretch": stretch, "warping": warping, "detail_stretch": detail_stretch}
        generate_surface_clones(
            style, folder, count, seed, where or [], {name: x for name, x in given.items() if x is not None},
            unit, workers or usable_cores(), overwrite=overwrite, as_json=as_json,
        )  # fmt: skip
        return
    if not (stretch is warping is detail_stretch is None):
        raise GenerationError(
            f"--stretch, --warping and --detail-stretch are for styles of surfaces, which {style} is not."
        )
    if report is not None:
        require_table_output(report, style)
    if folder.resolve() == style.resolve():
        raise GenerationError(
            f"{folder} is the folder of the style-learner: choose another folder for the clones."
        )
    check_replaceable(folder, files_of_earlier_export, overwrite)
    learner = load_style_learner(style)
    processes = workers or usable_cores()
    with keeping_results(folder):
        with console.progress("Generating") as tell:
            found = generate_clones(
                learner, count, seed, targets=where, processes=processes, on_progress=tell
            )
        _write(found, folder, unit, overwrite)
        quality = None if report is None else _report(learner, found, report, style.name, processes)
    summary = _summary(found, folder, report, time.monotonic() - begun)
    if as_json:
        console.print_json(
            {**summary, "reached": [figure.as_record() for figure in found.reached],
             "quality": None if quality is None else quality.as_dict()}
        )  # fmt: skip
        return
    console.print_facts(f"Clones in the style of {style.name}", summary)
    if found.reached:
        console.print_table(
            "Conditions", ("", "target", "found"), [(f.what, f.wanted, f.found) for f in found.reached]
        )
    if quality is not None:
        _print_quality(quality)


def _write(found: Generation, folder: Path, unit: str | None, overwrite: bool) -> None:
    from mbstudio.core.dem import export

    assert found.factors is not None
    table = found.factors.table().drop(columns=["warning", "not_measured"])
    table.insert(1, "name", list(found.clones.names))
    text = table.to_csv(index=False, lineterminator="\r\n")
    with console.progress("Writing") as tell:
        export(
            found.avatars(), "metaball", folder, unit=unit, names=found.clones.names, overwrite=overwrite,
            progress=tell, attachments={TABLE: text},
        )  # fmt: skip


def _report(learner: StyleLearner, found: Generation, path: Path, name: str, processes: int) -> Quality:
    from mbstudio.core.populations import measure_population
    from mbstudio.core.vae.generate.quality import assess
    from mbstudio.scene.reports.generation_report import write_generation_report

    assert found.factors is not None
    parents = found.parent_factors
    if parents is None:
        with console.progress("Measuring the parents") as tell:
            parents = measure_population(
                learner.parents.avatars(), range(1, len(learner.parents) + 1), name="parents", kind="avatars",
                workers=0 if processes == 1 else processes, progress=tell,
            )  # fmt: skip
    quality = assess(learner.parents, parents, found.clones, found.factors, counts=found.counts)
    with console.progress("Drawing") as tell:
        write_generation_report(path, name, found, parents, quality, progress=tell)
    return quality


def _summary(found: Generation, folder: Path, report: Path | None, seconds: float) -> dict[str, Any]:
    counts = found.counts
    return {
        "clones": len(found),
        "folder": str(folder),
        "seed": found.seed,
        "candidates": counts.candidates,
        "valid_before_the_guard": counts.valid,
        "repaired": counts.repaired,
        "refused": sum(counts.refused.values()),
        "replaced": counts.replaced,
        "distribution": found.how,
        "report": None if report is None else str(report),
        "seconds": round(seconds, 1),
    }


def _print_quality(quality: Quality) -> None:
    rows = [
        (
            row.factor,
            row.mean_error,
            row.floor.mean_error[0],
            row.deviation_error,
            row.floor.deviation_error[0],
        )
        for row in quality.factors
    ]
    console.print_table(
        "Errors against the parents in percent",
        ("", "mean", "true new grains", "s.d.", "true new grains"),
        rows,
    )
    facts: dict[str, Any] = {
        "novelty": quality.novelty.novelty,
        "copies_percent": 100 * quality.novelty.copies,
        "diversity": quality.novelty.diversity,
    }
    if quality.discrimination is not None:
        facts["classifier_auc"] = quality.discrimination.auc
        facts["classifier_auc_error"] = quality.discrimination.error
    console.print_facts("Novelty", facts)
