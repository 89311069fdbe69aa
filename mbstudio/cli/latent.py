"""``mbstudio latent``: grains shaped by hand in the latent space of a style-learner."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mbstudio.cli import console, inputs
from mbstudio.core.errors import StyleError

if TYPE_CHECKING:
    import numpy as np

    from mbstudio.core.vae import Serialization, StyleLearner

TABLE = "latents.csv"


def latent(
    style: Annotated[Path, typer.Argument(metavar="STYLE", help="The folder that 'mbstudio learn' wrote.")],
    folder: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FOLDER", help="Where the grains go.")
    ] = None,
    interpolate: Annotated[
        tuple[str, str] | None,
        typer.Option("--interpolate", metavar="A B", help="Grains on the way from A to B, ends included."),
    ] = None,
    add: Annotated[
        tuple[str, str, str] | None,
        typer.Option("--add", metavar="C A B", help="C plus what makes A differ from B."),
    ] = None,
    noise: Annotated[
        str | None, typer.Option("--noise", metavar="A", help="Variations of A; see --sigma, --count.")
    ] = None,
    move: Annotated[
        str | None, typer.Option("--move", metavar="A", help="A moved along meanings; see --by.")
    ] = None,
    by: Annotated[
        list[str] | None,
        typer.Option("--by", metavar="csf=-1", help="In standard deviations; may be given again."),
    ] = None,
    design: Annotated[
        list[str] | None,
        typer.Option("--design", metavar="csf=0.6", help="A grain of this factor; may be given again."),
    ] = None,
    steps: Annotated[int, typer.Option("--steps", min=2, help="Of --interpolate.")] = 11,
    sigma: Annotated[float, typer.Option("--sigma", min=0.0, help="Of --noise; 1 is like a parent.")] = 0.3,
    count: Annotated[int, typer.Option("--count", min=1, help="Of --noise.")] = 10,
    strength: Annotated[float, typer.Option("--strength", help="Of --add.")] = 1.0,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of everything random.")] = 0,
    unit: Annotated[str | None, typer.Option("--unit", help="Length unit of the files.")] = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Write into a folder that holds other files too.")
    ] = False,
    as_json: inputs.JsonOption = False,
) -> None:
    """Shape grains by hand: interpolate, add, vary, move along meanings, design by factors.

    A, B and C are parents, by name or by number from 1. Meanings are size, elongation, csf, sphericity and
    roughness. Without one of these options: what the style-learner knows.
    """
    from mbstudio.core.vae import load_style_learner

    begun = time.monotonic()
    asked = [interpolate, add, noise, move, design or None]
    if sum(option is not None for option in asked) > 1:
        raise StyleError("Give one of --interpolate, --add, --noise, --move and --design at a time.")
    learner = load_style_learner(style)
    work = _ByHand(learner, seed)
    if interpolate:
        latents, what = work.interpolated(*interpolate, steps), "steps"
    elif add:
        latents, what = work.added(*add, strength), "sum"
    elif noise:
        latents, what = work.varied(noise, sigma, count), "variation"
    elif move:
        latents, what = work.moved(move, by or []), "moved"
    elif design:
        latents, what = work.designed(design), "design"
    else:
        _tell_about(style, learner, work, as_json)
        return
    if folder is None:
        raise StyleError("Say where the grains are to go: -o FOLDER.")
    recipe = _recipe(style, interpolate, add, noise, move, by, design, sigma, strength, seed)
    _finish(learner, latents, what, folder, recipe, unit, overwrite, as_json, begun)


def _recipe(
    style: Path, interpolate: Any, add: Any, noise: Any, move: Any, by: Any, design: Any, sigma: float,
    strength: float, seed: int,
) -> str:  # fmt: skip
    """Return how the grains were made, as it stands in their table."""
    if interpolate:
        return f"{style.name}: from {interpolate[0]} to {interpolate[1]}"
    if add:
        return f"{style.name}: {add[0]} + {strength:g} ({add[1]} - {add[2]}), seed {seed}"
    if noise:
        return f"{style.name}: {noise} with noise of sigma {sigma:g}, seed {seed}"
    if move:
        return f"{style.name}: {move} moved by {' '.join(by or [])}, seed {seed}"
    return f"{style.name}: designed for {' '.join(design)}, seed {seed}"


class _ByHand:
    """The operations on a style-learner's parents by name; the meanings are learned when they are needed."""

    def __init__(self, learner: StyleLearner, seed: int) -> None:
        self.learner, self._seed = learner, seed
        self._meanings: Any = None

    @property
    def meanings(self) -> Any:
        from mbstudio.core.vae.meaning import Meanings

        if self._meanings is None:
            self._meanings = Meanings.of(self.learner)
        return self._meanings

    def _parent(self, name: str) -> np.ndarray:
        names = list(self.learner.parents.names)
        if name in names:
            return self.learner.latents[names.index(name)]
        if name.isdigit() and 1 <= int(name) <= len(names):
            return self.learner.latents[int(name) - 1]
        raise StyleError(
            f"The style-learner has no parent '{name}': give a number from 1 to {len(names)}, or a name such "
            f"as '{names[0]}'."
        )

    def interpolated(self, first: str, second: str, steps: int) -> np.ndarray:
        from mbstudio.core.vae.latent import morphed

        return morphed(self.learner, self._parent(first), self._parent(second), steps)

    def added(self, base: str, plus: str, minus: str, strength: float) -> np.ndarray:
        from mbstudio.core.vae.latent import added

        third, first, second = (self._parent(name) for name in (base, plus, minus))
        moved = added(self.learner, third, first, second, strength, meanings=self.meanings)
        return moved[None]

    def varied(self, name: str, sigma: float, count: int) -> np.ndarray:
        from mbstudio.core.vae.latent import noisy

        return noisy(self.learner, self._parent(name), sigma, self._seed, count)

    def moved(self, name: str, by: list[str]) -> np.ndarray:
        if not by:
            raise StyleError("Say how to move the grain: --by csf=-1, in standard deviations of the parents.")
        return self.meanings.moved(self._parent(name), _numbers(by))[None]

    def designed(self, targets: list[str]) -> np.ndarray:
        found = self.meanings.designed(_numbers(targets))
        if found.residual > 0.02:
            reached = ", ".join(f"{name} {value:.4g}" for name, value in found.reached.items())
            raise StyleError(
                f"These parents cannot give {' '.join(targets)}: the nearest grain has {reached}."
            )
        return found.latent[None]


def _numbers(words: list[str]) -> dict[str, float]:
    found: dict[str, float] = {}
    for word in words:
        name, sign, value = word.partition("=")
        try:
            found[name.strip()] = float(value)
        except ValueError:
            sign = ""
        if not sign:
            raise StyleError(f"'{word}' is no meaning with a number: write for example csf=0.6.")
    return found


def _finish(
    learner: StyleLearner, latents: np.ndarray, what: str, folder: Path, recipe: str, unit: str | None,
    overwrite: bool, as_json: bool, begun: float,
) -> None:  # fmt: skip
    """Decode, check, measure and write."""
    import numpy as np

    from mbstudio.core.dem import export
    from mbstudio.core.metaball.topology import topology
    from mbstudio.core.vae.latent import is_far_outside

    digits = len(str(len(latents)))
    names = tuple(f"{what}_{i + 1:0{digits}d}" for i in range(len(latents)))
    grains = learner.decode(latents, names=names)
    sound = np.array([topology(avatar.control).is_sound for avatar in grains.avatars()])
    for name in np.array(names)[~sound]:
        console.tell(f"mbstudio: {name} falls into pieces or has a void: left out.")
    if not sound.any():
        raise StyleError("None of these grains is a valid body: stay nearer to the parents.")
    kept = np.flatnonzero(sound)
    rows = _rows(grains.take(kept), latents[kept], recipe)
    with console.progress("Writing") as tell:
        export(
            grains.take(kept).avatars(), "metaball", folder, unit=unit, names=[names[i] for i in kept],
            overwrite=overwrite, progress=tell, attachments={TABLE: _csv(rows)},
        )  # fmt: skip
    outside = [names[i] for i in kept if is_far_outside(learner, latents[i])]
    summary = {
        "grains": len(kept), "folder": str(folder), "left_out": int((~sound).sum()),
        "far_outside_the_parents": len(outside), "seconds": round(time.monotonic() - begun, 1),
    }  # fmt: skip
    shown = [{key: value for key, value in row.items() if not key.startswith("z")} for row in rows]
    if as_json:
        console.print_json({**summary, "recipe": recipe, "table": shown})
        return
    console.print_table(recipe, tuple(shown[0])[:-1], [tuple(row.values())[:-1] for row in shown])
    console.print_facts("Written", summary)


def _rows(grains: Serialization, latents: np.ndarray, recipe: str) -> list[dict[str, Any]]:
    import numpy as np

    from mbstudio.core.vae.meaning_factors import MEANINGS, meaning_factors

    factors = meaning_factors(grains)
    factors[:, 0] = np.exp(factors[:, 0])
    columns = (f"dn_{grains.unit}", *MEANINGS[1:])
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

    return pd.DataFrame(rows).to_csv(index=False, lineterminator="\r\n")


def _tell_about(style: Path, learner: StyleLearner, work: _ByHand, as_json: bool) -> None:
    import numpy as np

    from mbstudio.core.vae.meaning_factors import MEANINGS

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
