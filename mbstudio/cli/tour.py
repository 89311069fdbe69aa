"""``mbstudio tour``: the whole workflow on the built-in sample scan, without a window."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated, Any

import typer

from mbstudio.cli import console, inputs
from mbstudio.core.errors import MbstudioError

TARGETS = ("stl", "metaball", "liggghts")
DENSITY = 2650.0  # quartz sand, kg/m3
OURS = {"sample.mbs", "factors.csv", "summary.json", "pictures", *TARGETS}


HELP = "Run the whole workflow on the built-in sample scan: grains, avatars, factors, pictures, DEM files."


def tour(
    folder: Annotated[
        Path,
        typer.Option(
            "--out", "-o", metavar="FOLDER", help="Output folder of pictures, project and DEM files."
        ),
    ] = Path("tour"),
    n: Annotated[int, typer.Option("-n", "--control-points", help="Control points of each avatar.")] = 40,
    limit: Annotated[int | None, typer.Option("--limit", min=1, help="Fit at most this many grains.")] = None,
    workers: inputs.WorkersOption = None,
    as_json: inputs.JsonOption = False,
) -> None:
    """Run ``mbstudio tour``; `HELP` says what it does."""
    from mbstudio.scene.pictures.offscreen import prepare_offscreen_rendering

    prepare_offscreen_rendering()
    prepare_folder(folder)
    steps = _Steps(folder, n, limit, workers)
    summary = steps.run()
    if as_json:
        console.print_json(summary)
        return
    console.print_facts("The sample scan, from voxels to avatars", summary)
    print(f"\nPictures, the project and the DEM files are in {folder}")
    print(f"To open the project in the window, run: mbstudio gui {folder / 'sample.mbs'}")


def prepare_folder(folder: Path) -> None:
    """Make the folder; refuse one that holds what the tour does not write."""
    if folder.exists() and not folder.is_dir():
        raise MbstudioError(f"{folder} is a file: give the name of a folder with --out.")
    if folder.is_dir():
        others = sorted(entry.name for entry in folder.iterdir() if entry.name not in OURS)
        if others:
            raise MbstudioError(
                f"{folder} contains other files ({others[0]}): choose a new folder with --out."
            )
    (folder / "pictures").mkdir(parents=True, exist_ok=True)


class _Steps:
    """The stations of the tour; each says what it does and adds to the summary."""

    def __init__(self, folder: Path, n: int, limit: int | None, workers: int | None) -> None:
        self.folder, self.n, self.limit, self.workers = folder, n, limit, workers
        self.summary: dict[str, Any] = {}
        self._begun = time.monotonic()

    def run(self) -> dict[str, Any]:
        import json

        from mbstudio.core.replacement import replacing

        project = self._segmented_sample()
        self._fit(project)
        self._measure(project)
        console.tell("Rendering pictures ...")
        self._render(project)
        self._export(project)
        self.summary["project"] = str(project.save(self.folder / "sample.mbs"))
        self.summary["seconds"] = round(time.monotonic() - self._begun, 1)
        with replacing(self.folder / "summary.json") as temporary:
            temporary.write_text(json.dumps(console.plain(self.summary), indent=2) + "\n", encoding="utf-8")
        return self.summary

    def _segmented_sample(self) -> Any:
        from mbstudio.core.grains.agreement import agreement
        from mbstudio.core.project import Project
        from mbstudio.core.scan import sample_scan

        console.tell("Making the sample scan ...")
        sample = sample_scan()
        project = Project.new(sample.scan)
        grains = inputs.find_grains(project, None, {})
        scored = agreement(grains.labels, sample.labels)
        self.summary.update(
            voxels=" x ".join(map(str, sample.scan.shape)),
            voxel_size=str(sample.scan.voxel_size),
            true_grains=scored.true,
            grains=scored.found,
            foreground_iou=scored.foreground_iou,
            instance_f1=scored.f1,
        )
        return project

    def _fit(self, project: Any) -> None:
        from mbstudio.cli.fit import choose_labels, fit_into, summarise
        from mbstudio.core.project import FitSettings

        begun = time.monotonic()
        project.change("Fit settings", fit_settings=FitSettings(self.n))
        labels = choose_labels(project, None, self.limit, refit=False)
        outcome = fit_into(project, labels, self.workers)
        if outcome.interrupted:
            raise KeyboardInterrupt
        if not outcome.fits:
            raise MbstudioError(
                f"No grain of the sample could be fitted: {next(iter(outcome.failures.values()))}"
            )
        figures = summarise(project.grains, outcome.fits, outcome.failures, time.monotonic() - begun)
        figures["seconds_to_fit"] = figures.pop("seconds")
        self.summary.update(figures)

    def _measure(self, project: Any) -> None:
        from mbstudio.cli.measuring import measure_grains, rows_of, summarise, table_of, write_csv

        populations = measure_grains(project, sorted(project.fits), workers=self.workers)
        write_csv(self.folder / "factors.csv", table_of(populations, project))
        for name, medians in summarise(rows_of(populations, project)).items():
            if name in ("sphericity", "circularity", "csf"):
                self.summary[f"median_{name}"] = medians["grain"]
                error = medians["error"]
                self.summary[f"median_{name}_error_percent"] = None if error is None else 100 * error

    def _render(self, project: Any) -> None:
        from mbstudio.scene.pictures.pictures import render_tour

        pictures = render_tour(project, self.folder / "pictures")
        self.summary["pictures"] = ", ".join(path.name for path in pictures)

    def _export(self, project: Any) -> None:
        from mbstudio.core.dem import export

        avatars = [fit.avatar for fit in project.fits.values() if fit.verdict.valid]
        for target in TARGETS:
            with console.progress(f"Exporting {target}") as report:
                done = export(
                    avatars, target, self.folder / target, density=DENSITY, unit="mm", progress=report
                )
            self.summary[f"{target}_files"] = len(done.files)
