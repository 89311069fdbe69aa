"""``mbstudio edit``: correct the grains of a project by hand."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperCommand

from mbstudio.cli import console, inputs
from mbstudio.core.errors import EditError, ProjectError

if TYPE_CHECKING:
    from collections.abc import Callable

    from mbstudio.core.grains.editing import EditOutcome
    from mbstudio.core.grains.editing.records import Edit
    from mbstudio.core.grains.grain_set import GrainSet
    from mbstudio.core.project import Project

HELP = """Correct the grains of a project by hand, in the order of the options.

Places are z,y,x in voxels, several of them parted by semicolons; LABELS are numbers as 3,5,9 or 1-20. Edits
are kept in the project; avatars of grains that do not change stay. Without an edit, those made so far are
listed."""

_AXES = {"z": 0, "y": 1, "x": 2}


class OrderedCommand(TyperCommand):
    """A command that knows in which order its options were given."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Note the order of the options before they are read."""
        _, _, order = self.make_parser(ctx).parse_args(args=list(args))
        ctx.meta["mbstudio.order"] = [parameter.name for parameter in order]
        left: list[str] = super().parse_args(ctx, args)
        return left


def _edits(metavar: str, text: str) -> Any:
    return typer.Option(metavar=metavar, help=text)


SourceArgument = Annotated[Path, typer.Argument(metavar="PROJECT", help="A project with grains.")]
MergeOption = Annotated[list[str] | None, _edits("LABELS", "Make grains one, which keeps the first number.")]
ApartOption = Annotated[
    bool, typer.Option("--apart", help="Close the gaps between merged grains that do not touch.")
]
SplitOption = Annotated[
    list[str] | None,
    _edits("LABEL@PLACES", "Part a grain from a seed in each part, as 5@40,31,22;40,31,60."),
]
ByShapeOption = Annotated[
    bool, typer.Option("--by-shape", help="Split by the grain's outline only, without grey values.")
]
SplitAlongOption = Annotated[
    list[str] | None,
    _edits("LABEL@PLACES", "Part a grain along a line, seen along --axis."),
]
DeleteOption = Annotated[list[str] | None, _edits("LABELS", "Take grains away.")]
ExcludeOption = Annotated[list[str] | None, _edits("LABELS", "Leave grains out of all that follows.")]
AcceptOption = Annotated[
    list[str] | None, _edits("LABELS", "Mark grains as looked at and right: --suspicious leaves them out.")
]
IncludeOption = Annotated[list[str] | None, _edits("LABELS", "Take excluded grains in again.")]
PaintOption = Annotated[
    list[str] | None,
    _edits("LABEL@RADIUS@PLACES", "Paint a stroke in space; LABEL may be 'new'."),
]
EraseOption = Annotated[
    list[str] | None, _edits("LABEL@RADIUS@PLACES", "Erase under a stroke; LABEL may be 'all'.")
]
FillOption = Annotated[
    list[str] | None, _edits("LABEL@PLACE", "Fill what a grain encloses in the slice across --axis.")
]
GrowOption = Annotated[list[str] | None, _edits("LABELS[@BY]", "Add void about grains, by a voxel or BY.")]
ShrinkOption = Annotated[list[str] | None, _edits("LABELS[@BY]", "Take the outermost voxels from grains.")]
SmoothOption = Annotated[
    list[str] | None, _edits("LABELS[@SIGMA]", "Smooth outlines, over a voxel or SIGMA.")
]
FillHolesOption = Annotated[list[str] | None, _edits("LABELS", "Give grains the void that they enclose.")]
NewGrainOption = Annotated[
    list[str] | None, _edits("PLACE[@GREY]", "Make a grain of what hangs together with a voxel.")
]
ReplayOption = Annotated[
    list[Path] | None,
    typer.Option("--replay", metavar="PROJECT", help="Make the edits of another project here."),
]
SuspiciousOption = Annotated[
    int | None,
    typer.Option(
        "--suspicious",
        metavar="N",
        help="List the N grains that are most likely several, or parts of one; nothing is changed.",
    ),
]
VoxelSizeOption = Annotated[
    str | None,
    typer.Option(
        "--correct-voxel-size",
        metavar="SIZE",
        help="Correct the voxel size after the edits, as '14 um' or '20 x 14 x 14 um' (z, y, x); all "
        "lengths follow.",
    ),
]
AxisOption = Annotated[str, typer.Option(help="The axis along which slices are looked at: z, y or x.")]
OutputOption = Annotated[
    Path | None,
    typer.Option("--output", "-o", metavar="FILE", help="Write another project instead of this one."),
]
WriteLabelsOption = Annotated[
    Path | None, typer.Option("--write-labels", metavar="FILE", help="Also write the label image.")
]


def edit(
    context: typer.Context,
    source: SourceArgument,
    merge: MergeOption = None,
    apart: ApartOption = False,
    split: SplitOption = None,
    by_shape: ByShapeOption = False,
    split_along: SplitAlongOption = None,
    delete: DeleteOption = None,
    exclude: ExcludeOption = None,
    include: IncludeOption = None,
    accept: AcceptOption = None,
    paint: PaintOption = None,
    erase: EraseOption = None,
    fill: FillOption = None,
    grow: GrowOption = None,
    shrink: ShrinkOption = None,
    smooth: SmoothOption = None,
    fill_holes: FillHolesOption = None,
    new_grain: NewGrainOption = None,
    replay: ReplayOption = None,
    suspicious: SuspiciousOption = None,
    correct_voxel_size: VoxelSizeOption = None,
    axis: AxisOption = "z",
    output: OutputOption = None,
    write_labels: WriteLabelsOption = None,
    scan: inputs.ScanOption = None,
    as_json: inputs.JsonOption = False,
) -> None:
    """Run ``mbstudio edit``; `HELP` says what it does."""
    from mbstudio.core.grains.label_writing import require_ending, write_label_image
    from mbstudio.core.project import Project

    if not inputs.is_project(source):
        raise ProjectError(
            f"{source} is not a project ({inputs.PROJECT_ENDING}): find grains with 'mbstudio segment'."
        )
    if write_labels is not None:
        require_ending(write_labels)
    given = {
        "merge": merge, "split": split, "split_along": split_along, "delete": delete, "exclude": exclude,
        "include": include, "accept": accept, "paint": paint, "erase": erase, "fill": fill, "grow": grow,
        "shrink": shrink, "smooth": smooth, "fill_holes": fill_holes, "new_grain": new_grain,
        "replay": replay,
    }  # fmt: skip
    wanted = _in_order(context.meta["mbstudio.order"], given)
    read = _Reading(_read_axis(axis), apart, by_shape)
    steps = [(name, value if name == "replay" else read.edit(name, value)) for name, value in wanted]
    target = inputs.require_project_output(output) if output is not None else source
    with Project.open(source) as project:
        if scan is not None:
            project.relocate_scan(scan)
        if suspicious is not None:
            _list_suspicious(project, suspicious, as_json)
            return
        if not steps and correct_voxel_size is None:
            _list_edits(project, as_json)
            return
        project.hold("mbstudio edit", target)
        outcome = _make(project, steps) if steps else {"edits": [], "left_out": []}
        if correct_voxel_size is not None:
            outcome |= _correct_voxel_size(project, correct_voxel_size)
        if write_labels is not None and project.grains is not None:
            grid = project.scan.grid if project.scan is not None else None
            write_label_image(write_labels, project.grains, grid)
            outcome["labels"] = str(write_labels)
        outcome["project"] = str(inputs.save_results(project, target))
    if as_json:
        console.print_json(outcome)
        return
    _tell(outcome)
    console.print_facts(f"Edited {source.name}", outcome)


def _correct_voxel_size(project: Project, size: str) -> dict[str, Any]:
    """Correct the voxel size and return what came of it."""
    correction = project.correct_voxel_size(size)
    for note in correction.notes:
        console.tell(f"mbstudio: {note}")
    found: dict[str, Any] = {
        "voxel_size_before": str(correction.before),
        "voxel_size": str(correction.after),
        "factor": correction.factor,
    }
    if correction.median_diameters is not None:
        before, after = correction.median_diameters
        found["median_diameter_before"] = f"{before:.6g} {correction.before.unit}"
        found["median_diameter"] = f"{after:.6g} {correction.after.unit}"
    return found


def _tell(outcome: dict[str, Any]) -> None:
    """Tell the notes on edits and what was left out, and take them from the outcome."""
    for made in outcome.pop("edits"):
        for note in made["notes"]:
            console.tell(f"mbstudio: {note}")
    for left_out in outcome.pop("left_out"):
        console.tell(f"mbstudio: left out: {left_out['reason']}")


def _make(project: Project, steps: list[tuple[str, Any]]) -> dict[str, Any]:
    """Make edits and replays in their order and return what came of them."""
    from mbstudio.core.project import Project

    made: list[EditOutcome[GrainSet]] = []
    left_out = []
    for name, what in steps:
        if name == "replay":
            with Project.open(what) as other:
                edits = other.grains.edits if other.grains is not None else ()
            if not edits:
                raise EditError(f"{what} holds no edits of grains that could be made here.")
            replayed = project.replay_edits(edits)
            made += replayed.made
            left_out += [{"edit": edit_.described(), "reason": reason} for edit_, reason in replayed.left_out]
            continue
        made.append(project.edit_grains(what))
    assert project.grains is not None
    return {
        "edits": [
            {
                **outcome.edit.to_record(),
                "changed": sorted(outcome.changed),
                "gone": sorted(outcome.gone),
                "new": sorted(outcome.new),
                "notes": list(outcome.notes),
            }
            for outcome in made
        ],
        "left_out": left_out,
        **_summary(project, project.grains),
        "made": len(made),
    }


def _summary(project: Project, grains: GrainSet) -> dict[str, Any]:
    return {
        "grains": len(grains),
        "interior": len(grains.interior_labels),
        "excluded": len(grains.excluded_labels),
        "fitted": len(project.fits),
        "changed_since_fitted": sorted(project.state.changed_labels),
    }


def _list_edits(project: Project, as_json: bool) -> None:
    grains = project.grains
    if grains is None:
        raise ProjectError("The project has no grains to correct: find them with 'mbstudio segment' first.")
    if as_json:
        console.print_json(
            {"edits": [edit.to_record() for edit in grains.edits], **_summary(project, grains)}
        )
        return
    console.print_table(
        f"{len(grains.edits)} edits by hand", ("edit",), [(edit.described(),) for edit in grains.edits]
    )


def _list_suspicious(project: Project, count: int, as_json: bool) -> None:
    grains = project.grains
    if grains is None or count < 1:
        raise ProjectError("There are no grains to list: find them first, and list 1 or more.")
    residuals = project.state.relative_residuals
    with console.progress("Looking at the grains") as report:
        ranked = grains.suspicion(project.scan, residuals=residuals, progress=report)
        ranked = ranked[~ranked["label"].isin(grains.accepted_labels)].head(count)
    if as_json:
        console.print_json({"suspicious": ranked.to_dict("records")})
        return
    rows = list(ranked[["label", "score", "kind", "reasons"]].itertuples(index=False, name=None))
    console.print_table("The most suspicious grains", ("grain", "score", "kind", "reasons"), rows)


def _in_order(order: list[str], given: dict[str, list[Any] | None]) -> list[tuple[str, Any]]:
    """Return the values of options in the order in which they stood on the command line."""
    left = {name: list(values) for name, values in given.items() if values}
    return [(name, left[name].pop(0)) for name in order if left.get(name)]


def _read_axis(word: str) -> int:
    if word not in _AXES:
        raise EditError(f"--axis '{word}' is not known: use z, y or x.")
    return _AXES[word]


class _Reading:
    """Reads the values of options into edits."""

    def __init__(self, axis: int, apart: bool, by_shape: bool) -> None:
        self._axis, self._apart, self._by_shape = axis, apart, by_shape

    def edit(self, name: str, text: str) -> Edit:
        """Return the edit that the value of an option describes."""
        option = f"--{name.replace('_', '-')}"
        maker: Callable[[str, str], Edit] = getattr(self, f"_{name}", self._of_labels)
        return maker(text, option)

    def _of_labels(self, text: str, option: str) -> Edit:
        from mbstudio.core.grains.editing import records

        kinds: dict[str, type[Edit]] = {
            "--delete": records.Delete, "--exclude": records.Exclude, "--include": records.Include,
            "--fill-holes": records.FillHoles, "--accept": records.Accept,
        }  # fmt: skip
        return kinds[option](labels=_labels(text, option))

    def _merge(self, text: str, option: str) -> Edit:
        from mbstudio.core.grains.editing.records import Merge

        return Merge(labels=_labels(text, option), apart=self._apart)

    def _split(self, text: str, option: str) -> Edit:
        from mbstudio.core.grains.editing.records import Split, voxel_of

        label, places = _parts(text, option, 2)
        seeds = tuple(voxel_of(place) for place in _places(places, option))
        return Split(labels=_labels(label, option), seeds=seeds, by_grey=not self._by_shape)

    def _split_along(self, text: str, option: str) -> Edit:
        from mbstudio.core.grains.editing.records import SplitAlong

        label, places = _parts(text, option, 2)
        return SplitAlong(labels=_labels(label, option), points=_places(places, option), axis=self._axis)

    def _paint(self, text: str, option: str) -> Edit:
        from mbstudio.core.grains.editing.records import Paint

        label, radius, places = _parts(text, option, 3)
        labels = () if label == "new" else _labels(label, option)
        return Paint(labels=labels, centres=_places(places, option), radius=_number(radius, option))

    def _erase(self, text: str, option: str) -> Edit:
        from mbstudio.core.grains.editing.records import Erase

        label, radius, places = _parts(text, option, 3)
        labels = () if label == "all" else _labels(label, option)
        return Erase(labels=labels, centres=_places(places, option), radius=_number(radius, option))

    def _fill(self, text: str, option: str) -> Edit:
        from mbstudio.core.grains.editing.records import Fill, voxel_of

        label, place = _parts(text, option, 2)
        return Fill(labels=_labels(label, option), at=voxel_of(_places(place, option)[0]), axis=self._axis)

    def _grow(self, text: str, option: str) -> Edit:
        from mbstudio.core.grains.editing.records import Grow

        labels, _, by = text.partition("@")
        return Grow(labels=_labels(labels, option), by=_number(by or "1", option))

    def _shrink(self, text: str, option: str) -> Edit:
        from mbstudio.core.grains.editing.records import Shrink

        labels, _, by = text.partition("@")
        return Shrink(labels=_labels(labels, option), by=_number(by or "1", option))

    def _smooth(self, text: str, option: str) -> Edit:
        from mbstudio.core.grains.editing.records import Smooth

        labels, _, sigma = text.partition("@")
        return Smooth(labels=_labels(labels, option), sigma=_number(sigma or "1", option))

    def _new_grain(self, text: str, option: str) -> Edit:
        from mbstudio.core.grains.editing.records import NewGrain, voxel_of

        place, _, grey = text.partition("@")
        at = voxel_of(_places(place, option)[0])
        return NewGrain(at=at, threshold=_number(grey, option) if grey else None)


def _labels(text: str, option: str) -> tuple[int, ...]:
    return tuple(inputs.numbers_in(text, option) or ())


def _parts(text: str, option: str, count: int) -> list[str]:
    parts = text.split("@")
    if len(parts) != count:
        form = (
            "LABEL@PLACES, as 5@40,31,22;40,31,60" if count == 2 else "LABEL@RADIUS@PLACES, as 5@4@40,31,22"
        )
        raise EditError(f"{option} '{text}' cannot be read: write it as {form}.")
    return parts


def _places(text: str, option: str) -> tuple[tuple[float, float, float], ...]:
    from mbstudio.core.grains.editing.records import point_of

    try:
        return tuple(point_of([float(word) for word in place.split(",")]) for place in text.split(";"))
    except (ValueError, EditError) as error:
        raise EditError(
            f"{option}: '{text}' are no places: write each as z,y,x and part them by semicolons."
        ) from error


def _number(text: str, option: str) -> float:
    try:
        return float(text)
    except ValueError as error:
        raise EditError(f"{option}: '{text}' is no number.") from error
