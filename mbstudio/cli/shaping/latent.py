"""``mbstudio latent``: grains shaped by hand in the latent space of a style-learner."""

from __future__ import annotations

import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mbstudio.cli import console, inputs
from mbstudio.cli.shaping.by_hand import TABLE, ByHand
from mbstudio.core.errors import StyleError

if TYPE_CHECKING:
    import numpy as np

    from mbstudio.cli.shaping.surfaces_by_hand import SurfacesByHand
    from mbstudio.core.cloning.surface_studio import GrainShape
    from mbstudio.core.vae.models.style_learner import StyleLearner
    from mbstudio.core.vae.serialize.serialization import Serialization


HELP = """Shape grains by hand: interpolate, add, blend, vary, move along meanings, design by factors.

A, B and C are parents, by name or by number from 1; files with a mesh or an avatar; or grains made
before, as folder/latents.csv:moved_1 or recipes.json:NAME. Meanings are size, elongation, csf,
sphericity and roughness. Without an operation, the command describes the style-learner.

With a style of surfaces A, B and C are parents, or shapes made before, as folder/shapes.json:moved_1;
the factors are also elongation (I/L), flatness (S/I) and convexity, and what is written is as of
'mbstudio generate'.
"""

StyleArgument = Annotated[
    Path, typer.Argument(metavar="STYLE", help="The folder that 'mbstudio learn' wrote.")
]
FolderOption = Annotated[Path | None, typer.Option("--output", "-o", metavar="FOLDER", help="Output folder.")]
InterpolateOption = Annotated[
    tuple[str, str] | None,
    typer.Option("--interpolate", metavar="A B", help="Interpolate from A to B, ends included."),
]
AddOption = Annotated[
    tuple[str, str, str] | None,
    typer.Option("--add", metavar="C A B", help="Add the difference between A and B to C."),
]
BlendOption = Annotated[
    list[str] | None,
    typer.Option(
        "--blend", metavar="A=0.5", help="Weighted sum about the parents' mean; repeat for each grain."
    ),
]
NoiseOption = Annotated[
    str | None, typer.Option("--noise", metavar="A", help="Variations of A; see --sigma, --count.")
]
MoveOption = Annotated[
    str | None, typer.Option("--move", metavar="A", help="Move A along meanings; see --by.")
]
ByOption = Annotated[
    list[str] | None,
    typer.Option(
        "--by", metavar="csf=-1", help="How far --move goes, in standard deviations; repeat for more."
    ),
]
DesignOption = Annotated[
    list[str] | None,
    typer.Option("--design", metavar="csf=0.6", help="Find a grain with this factor; repeat for more."),
]
TakeOption = Annotated[
    list[str] | None,
    typer.Option("--take", metavar="A", help="Reconstruct A with the style-learner; repeat for more."),
]
StepsOption = Annotated[int, typer.Option("--steps", min=2, help="Number of grains of --interpolate.")]
SigmaOption = Annotated[
    float, typer.Option("--sigma", min=0.0, help="Strength of --noise; 1 is as far as another parent.")
]
CountOption = Annotated[int, typer.Option("--count", min=1, help="Number of grains of --noise.")]
StrengthOption = Annotated[float, typer.Option("--strength", help="Factor of the difference in --add.")]
SeedOption = Annotated[int, typer.Option("--seed", min=0, help="Seed of the random numbers.")]
BeyondOption = Annotated[
    bool, typer.Option("--beyond", help="Allow grains farther from the mean than any parent.")
]
UnitOption = Annotated[
    str | None, typer.Option("--unit", help="Length unit of the files, and of given meshes.")
]
OverwriteOption = Annotated[
    bool, typer.Option("--overwrite", help="Write into a folder that contains other files.")
]


def latent(
    style: StyleArgument,
    folder: FolderOption = None,
    interpolate: InterpolateOption = None,
    add: AddOption = None,
    blend: BlendOption = None,
    noise: NoiseOption = None,
    move: MoveOption = None,
    by: ByOption = None,
    design: DesignOption = None,
    take: TakeOption = None,
    steps: StepsOption = 11,
    sigma: SigmaOption = 0.3,
    count: CountOption = 10,
    strength: StrengthOption = 1.0,
    seed: SeedOption = 0,
    beyond: BeyondOption = False,
    unit: UnitOption = None,
    overwrite: OverwriteOption = False,
    as_json: inputs.JsonOption = False,
) -> None:
    """Run ``mbstudio latent``; `HELP` says what it does."""
    from mbstudio.cli.shaping.surfaces_by_hand import shape_surfaces
    from mbstudio.core.cloning.surface_style_file import holds_surface_style
    from mbstudio.core.vae.models.style_learner import load_style_learner

    begun = time.monotonic()
    asked = [interpolate, add, blend or None, noise, move, design or None, take or None]
    if sum(option is not None for option in asked) > 1:
        raise StyleError(
            "Give only one of --interpolate, --add, --blend, --noise, --move, --design and --take."
        )
    if holds_surface_style(style):
        operation = partial(
            _on_surfaces, interpolate=interpolate, add=add, blend=blend, noise=noise, move=move, by=by,
            design=design, take=take, steps=steps, sigma=sigma, count=count, strength=strength,
        )  # fmt: skip
        shape_surfaces(
            style, operation if any(asked) else None, folder, seed, unit, overwrite=overwrite, as_json=as_json
        )
        return
    learner = load_style_learner(style)
    work = ByHand(learner, seed, unit)
    if not any(asked):
        _tell_about(style, learner, work, as_json)
        return
    if folder is None:
        raise StyleError("The grains need an output folder: give -o FOLDER.")
    if interpolate:
        latents, what = work.interpolated(*interpolate, steps), "steps"
        recipe = f"from {interpolate[0]} to {interpolate[1]}"
    elif add:
        latents, what = work.added(*add, strength), "sum"
        recipe = f"{add[0]} + {strength:g} ({add[1]} - {add[2]})"
    elif blend:
        latents, what, recipe = work.blended(blend), "blend", f"blend of {' '.join(blend)}"
    elif noise:
        latents, what = work.varied(noise, sigma, count), "variation"
        recipe = f"{noise} with noise of sigma {sigma:g}, seed {seed}"
    elif move:
        latents, what, recipe = work.moved(move, by or []), "moved", f"{move} moved by {' '.join(by or [])}"
    elif design:
        latents, what, recipe = work.design(design), "design", f"designed for {' '.join(design)}"
    else:
        assert take is not None
        latents, what, recipe = work.taken(take), "grain", f"{', '.join(take)} rebuilt"
    _finish(
        learner, latents, what, folder, f"{style.name}: {recipe}", unit, overwrite, as_json, begun, beyond
    )


def _on_surfaces(
    work: SurfacesByHand, *, interpolate: tuple[str, str] | None, add: tuple[str, str, str] | None,
    blend: list[str] | None, noise: str | None, move: str | None, by: list[str] | None,
    design: list[str] | None, take: list[str] | None, steps: int, sigma: float, count: int, strength: float,
) -> tuple[list[GrainShape], str, str]:  # fmt: skip
    """Return the shapes that were asked for, what each is called, and how they were made."""
    if interpolate:
        return work.interpolated(*interpolate, steps), "steps", f"from {interpolate[0]} to {interpolate[1]}"
    if add:
        return work.added(*add, strength), "sum", f"{add[0]} + {strength:g} ({add[1]} - {add[2]})"
    if blend:
        return work.blended(blend), "blend", f"blend of {' '.join(blend)}"
    if noise:
        return work.varied(noise, sigma, count), "variation", f"{noise} with warps of strength {sigma:g}"
    if move:
        return work.moved(move, by or []), "moved", f"{move} moved by {' '.join(by or [])}"
    if design:
        return work.design(design), "design", f"designed for {' '.join(design)}"
    assert take is not None
    return work.taken(take), "grain", ", ".join(take)


def _finish(
    learner: StyleLearner, latents: np.ndarray, what: str, folder: Path, recipe: str, unit: str | None,
    overwrite: bool, as_json: bool, begun: float, beyond: bool,
) -> None:  # fmt: skip
    """Hold in the parents' range, decode, check, measure and write."""
    import numpy as np

    from mbstudio.core.dem import export
    from mbstudio.core.metaball.topology import topology
    from mbstudio.core.vae.shaping.latent import clamp, is_far_outside

    digits = len(str(len(latents)))
    names = tuple(f"{what}_{i + 1:0{digits}d}" for i in range(len(latents)))
    outside = [is_far_outside(learner, latent) for latent in latents]
    if any(outside) and not beyond:
        latents = np.stack([clamp(learner, latent) for latent in latents])
        console.tell(
            f"mbstudio: {', '.join(np.array(names)[outside])} would be farther from the mean than any "
            "parent: held at the limit of their range (--beyond allows it)."
        )
    grains = learner.decode(latents, names=names)
    sound = np.array([topology(avatar.control).is_sound for avatar in grains.avatars()])
    for name in np.array(names)[~sound]:
        console.tell(f"mbstudio: {name} is in pieces or has a void: left out.")
    if not sound.any():
        raise StyleError("None of these grains is a valid body: stay closer to the parents.")
    kept = np.flatnonzero(sound)
    rows = _rows(grains.take(kept), latents[kept], recipe)
    with console.progress("Writing") as tell:
        export(
            grains.take(kept).avatars(), "metaball", folder, unit=unit, names=[names[i] for i in kept],
            overwrite=overwrite, progress=tell, attachments={TABLE: _csv(rows)},
        )  # fmt: skip
    summary = {
        "grains": len(kept), "folder": str(folder), "left_out": int((~sound).sum()),
        "far_outside_the_parents": sum(outside[i] for i in kept) if beyond else 0,
        "held_at_their_range": 0 if beyond else sum(outside), "seconds": round(time.monotonic() - begun, 1),
    }  # fmt: skip
    shown = [{key: value for key, value in row.items() if not key.startswith("z")} for row in rows]
    if as_json:
        console.print_json({**summary, "recipe": recipe, "table": shown})
        return
    console.print_table(recipe, tuple(shown[0])[:-1], [tuple(row.values())[:-1] for row in shown])
    console.print_facts("Written", summary)


def _rows(grains: Serialization, latents: np.ndarray, recipe: str) -> list[dict[str, Any]]:
    import numpy as np

    from mbstudio.core.metrics import FACTORS
    from mbstudio.core.vae.shaping.meaning_factors import MEANINGS, meaning_factors

    factors = meaning_factors(grains)
    factors[:, 0] = np.exp(factors[:, 0])
    columns = (FACTORS["dn"].column(grains.unit), *MEANINGS[1:])
    return [
        {
            "name": grains.names[i],
            **{name: float(value) for name, value in zip(columns, factors[i], strict=True)},
            "recipe": recipe,
            **{f"z{k + 1}": float(value) for k, value in enumerate(latents[i])},
        }
        for i in range(len(grains))
    ]


def _csv(rows: list[dict[str, Any]]) -> str:
    import pandas as pd

    text: str = pd.DataFrame(rows).to_csv(index=False, lineterminator="\r\n")
    return text


def _tell_about(style: Path, learner: StyleLearner, work: ByHand, as_json: bool) -> None:
    import numpy as np

    from mbstudio.core.vae.shaping.meaning_factors import MEANINGS

    meanings = work.meanings
    known = meanings.known.copy()
    known[:, 0] = np.exp(known[:, 0])
    table = [
        (name, *(float(v) for v in np.percentile(known[:, i], (5, 50, 95))), float(known[:, i].std(ddof=1)))
        for i, name in enumerate(MEANINGS)
    ]
    facts = {"preset": learner.preset, "parents": len(learner.parents), "latents": learner.dimension}
    if as_json:
        keys = ("meaning", "p5", "median", "p95", "deviation")
        console.print_json(
            {**facts, "unit": learner.unit, "meanings": [dict(zip(keys, row, strict=True)) for row in table]}
        )
        return
    console.print_facts(f"Style-learner {style.name}", facts)
    console.print_table(
        f"Meanings of its latent space (size in {learner.unit})",
        ("meaning", "5 %", "median", "95 %", "s.d."), table,
    )  # fmt: skip
