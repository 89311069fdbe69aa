"""The operations of ``mbstudio latent`` on a style of surfaces."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mbstudio.cli import console
from mbstudio.cli.shaping.by_hand import numbers
from mbstudio.core.errors import CloningError, StyleError

if TYPE_CHECKING:
    from mbstudio.core.cloning.surface_design import DesignedGrain, ParentFactors
    from mbstudio.core.cloning.surface_studio import GrainShape, ShapedGrain, SurfaceStudio
    from mbstudio.core.cloning.surface_style import SurfaceStyle


class SurfacesByHand:
    """Grains made of surfaces, as people name them: a parent's name or number from 1, or shapes.json:NAME."""

    def __init__(self, style: SurfaceStyle, seed: int) -> None:
        from mbstudio.core.cloning.surface_studio import SurfaceStudio

        self.style, self._seed = style, seed
        self.studio: SurfaceStudio = SurfaceStudio(style)
        self.notes: list[str] = []

    @cached_property
    def known(self) -> ParentFactors:
        """The factors of the parents."""
        from mbstudio.core.cloning.surface_design import ParentFactors

        with console.progress("Measuring the parents") as tell:
            return ParentFactors.measure(self.studio, tell)

    def shape(self, name: str) -> GrainShape:
        """Return the shape of a grain.

        Raises
        ------
        StyleError
            If there is none of that name.
        """
        from mbstudio.core.cloning.shapes_file import read_shapes

        file, _, grain = name.rpartition(":")
        if grain and Path(file).suffix.lower() == ".json":
            shapes = read_shapes(file, self.style)
            if grain not in shapes:
                raise StyleError(f"{file} has no shape '{grain}': it has {', '.join(shapes) or 'none'}.")
            return shapes[grain]
        return self.studio.begin(self._row(name))

    def _row(self, name: str) -> int:
        names = [parent.name for parent in self.style.parents]
        if name in names:
            return names.index(name)
        if name.isdigit() and 1 <= int(name) <= len(names):
            return int(name) - 1
        raise StyleError(
            f"The style has no parent '{name}': give a number from 1 to {len(names)}, a name such as "
            f"'{names[0]}', or a shape as shapes.json:NAME. A file with a grain is no surface of this style: "
            "learn it with the others first."
        )

    # ---- the operations ----------------------------------------------------------------------------

    def taken(self, names: list[str]) -> list[GrainShape]:
        """Return grains as they are."""
        return [self.shape(name) for name in names]

    def interpolated(self, first: str, second: str, steps: int) -> list[GrainShape]:
        """Return a morph in equal shares from one parent's surface to another's."""
        begin, end = self.shape(first), self._row(second)
        if begin.parent == end:
            raise StyleError(f"{first} and {second} are of the same parent: a morph needs two.")
        return [self.studio.blended(begin, end, step / (steps - 1))[0] for step in range(steps)]

    def blended(self, parts: list[str]) -> list[GrainShape]:
        """Return a blend of two parents, each as NAME=WEIGHT."""
        weights = numbers(parts)
        if len(weights) != 2 or min(weights.values()) < 0 or not sum(weights.values()) > 0:
            raise StyleError(
                "A blend of surfaces is of two grains with weights that are not negative: "
                "--blend 3=0.5 --blend 7=0.5."
            )
        (first, one), (second, other) = weights.items()
        share = other / (one + other)
        return [self.studio.blended(self.shape(first), self._row(second), share)[0]]

    def varied(self, name: str, sigma: float, count: int) -> list[GrainShape]:
        """Return warps of a grain; a sigma of 1 is as grains of this kind differ."""
        begin, found = self.shape(name), []
        for place in range(count):
            shape, weaker = self.studio.warped(begin, sigma, self._seed + place)
            if weaker:
                self.notes.append(f"variation {place + 1} would fold: its warp is weaker than {sigma:g}.")
            found.append(shape)
        return found

    def moved(self, name: str, by: list[str]) -> list[GrainShape]:
        """Return a grain whose factors have moved by standard deviations of the parents."""
        from mbstudio.core.cloning.surface_design import move_by

        if not by:
            raise StyleError(
                "--move needs a distance: give for example --by csf=-1 (standard deviations of the parents)."
            )
        return self._told(move_by(self.studio, self.known, self.shape(name), numbers(by)))

    def added(self, base: str, plus: str, minus: str, strength: float) -> list[GrainShape]:
        """Return a grain whose factors differ from one as another's do from a third's."""
        from mbstudio.core.cloning.surface_design import add_difference

        third, first, second = (self.shape(name) for name in (base, plus, minus))
        return self._told(add_difference(self.studio, third, first, second, strength))

    def design(self, targets: list[str]) -> list[GrainShape]:
        """Return a grain of given factors; refused if these surfaces cannot have them."""
        from mbstudio.core.cloning.surface_design import design

        found = design(self.studio, self.known, numbers(targets))
        if found.missed:
            raise StyleError(_refusal(found, " ".join(targets)))
        return [found.grain.shape]

    def _told(self, found: DesignedGrain) -> list[GrainShape]:
        for name in found.missed:
            self.notes.append(
                f"{name} is {found.grain.values[name]:.4g} instead of {found.targets[name]:.4g}: the surface "
                "allows no more."
            )
        return [found.grain.shape]


def _refusal(found: DesignedGrain, asked: str) -> str:
    from mbstudio.core.metrics.form_bound import FLATTEST, highest_sphericity

    reached = ", ".join(f"{name} {found.grain.values[name]:.4g}" for name in found.targets)
    csf, sphericity = found.targets.get("csf", 1.0), found.targets.get("sphericity", 0.0)
    if FLATTEST <= csf <= 1.0 and sphericity > highest_sphericity(csf):
        why = f"the most spherical body of csf {csf:g} has {highest_sphericity(csf):.3f}"
        return f"No body can have {asked}: {why}. The closest grain of these parents has {reached}."
    return f"These parents cannot give {asked}: the closest grain has {reached}."


def shape_surfaces(
    style_folder: Path, make: Callable[[SurfacesByHand], tuple[list[GrainShape], str, str]] | None,
    folder: Path | None, seed: int, unit: str | None, *, overwrite: bool, as_json: bool,
) -> None:  # fmt: skip
    """Make grains of a style of surfaces, write them and say what they are, or describe the style.

    Parameters
    ----------
    style_folder : Path
    make : callable or None
        Returns shapes, what each is called, and how they were made in words. None: the style is described.
    folder : Path or None
    seed : int
    unit : str or None
        Of the files.
    overwrite, as_json : bool
    """
    from mbstudio.core.cloning.surface_style_file import load_surface_style

    begun = time.monotonic()
    work = SurfacesByHand(load_surface_style(style_folder), seed)
    if make is None:
        _tell_about(style_folder, work, as_json)
        return
    if folder is None:
        raise StyleError("The grains need an output folder: give -o FOLDER.")
    if folder.resolve() == style_folder.resolve():
        raise StyleError(f"{folder} is the folder of the style: choose another folder for the grains.")
    shapes, what, recipe = make(work)
    grains = [work.studio.make(shape) for shape in shapes]
    digits = len(str(len(grains)))
    names = [f"{what}_{place:0{digits}d}" for place in range(1, len(grains) + 1)]
    for name, grain in zip(names, grains, strict=True):
        if not grain.is_sound:
            raise CloningError(
                f"{name} would fold over in {100 * grain.folded:.2g} % of its area: ask for less."
            )
    for note in work.notes:
        console.tell(f"mbstudio: {note}")
    _write(work, names, grains, folder, unit, overwrite)
    rows = [{"name": name, **_values(work, grain)} for name, grain in zip(names, grains, strict=True)]
    summary = {
        "grains": len(rows), "folder": str(folder), "notes": len(work.notes),
        "seconds": round(time.monotonic() - begun, 1),
    }  # fmt: skip
    recipe = f"{style_folder.name}: {recipe}"
    if as_json:
        console.print_json({**summary, "recipe": recipe, "table": rows})
        return
    console.print_table(recipe, tuple(rows[0]), [tuple(row.values()) for row in rows])
    console.print_facts("Written", summary)


def _values(work: SurfacesByHand, grain: ShapedGrain) -> dict[str, float]:
    from mbstudio.core.cloning.surface_studio import SHAPE_FACTORS
    from mbstudio.core.metrics import FACTORS

    size = FACTORS["dn"].column(work.style.unit)
    return {size if name == "size" else name: float(grain.values[name]) for name in SHAPE_FACTORS}


def _write(
    work: SurfacesByHand, names: list[str], grains: list[ShapedGrain], folder: Path, unit: str | None,
    overwrite: bool,
) -> None:  # fmt: skip
    from mbstudio.cli.surfaces import write_clones
    from mbstudio.core.cloning.kept_shapes import keep_shapes
    from mbstudio.core.cloning.shapes_file import SHAPES_FILE, write_shapes

    with console.progress("Fitting avatars") as tell:
        found = keep_shapes(work.studio, grains, names, progress=tell)
    shapes = {name: grain.shape for name, grain in zip(names, grains, strict=True)}
    write_clones(found, folder, unit, overwrite, {SHAPES_FILE: write_shapes(shapes, work.style)})


def _tell_about(folder: Path, work: SurfacesByHand, as_json: bool) -> None:
    import numpy as np

    from mbstudio.core.cloning.surface_studio import SHAPE_FACTORS

    known = work.known
    table: list[tuple[Any, ...]] = [
        (
            name,
            *(float(v) for v in np.percentile(known.values[:, place], (5, 50, 95))),
            known.deviations[name],
        )
        for place, name in enumerate(SHAPE_FACTORS)
    ]
    facts = {"preset": "surfaces", "parents": len(work.style.parents), "warps": len(work.style.modes)}
    if as_json:
        keys = ("meaning", "p5", "median", "p95", "deviation")
        console.print_json(
            {
                **facts,
                "unit": work.style.unit,
                "meanings": [dict(zip(keys, row, strict=True)) for row in table],
            }
        )
        return
    console.print_facts(f"Style of surfaces {folder.name}", facts)
    console.print_table(
        f"Factors of its parents (size in {work.style.unit})",
        ("factor", "5 %", "median", "95 %", "s.d."), table,
    )  # fmt: skip
