"""Files of grains shaped by hand: recipes (JSON) and tables of latent vectors (CSV), read with suspicion."""

from __future__ import annotations

import csv
import math
import re
from pathlib import Path

import numpy as np
from jaxtyping import Float64

from mbstudio.core.errors import StyleError
from mbstudio.core.plain_files import PlainFileError, read_json, read_plain_text
from mbstudio.core.vae.shaping.latent_recipe import Recipe, read_recipe

_MOST_VARIABLES = 100_000


def read_recipes(path: str | Path) -> list[Recipe]:
    """Return the recipes of a file that mbstudio wrote.

    Raises
    ------
    StyleError
        If it cannot be read, is no list of recipes, or one of them is damaged; the file is named.
    """
    path = Path(path)
    cure = "give a recipes.json that mbstudio wrote"
    try:
        records = read_json(path)
    except PlainFileError as error:
        raise StyleError(f"{path} cannot be read as recipes ({error}): {cure}.") from error
    if not isinstance(records, list):
        raise StyleError(f"{path} is no list of recipes: {cure}.")
    try:
        return [read_recipe(record) for record in records]
    except StyleError as error:
        raise StyleError(f"{path} is damaged: {error}") from error


def read_latents(path: str | Path) -> dict[str, Float64[np.ndarray, " d"]]:
    """Return the latent vectors of a table with the columns ``name, z1, z2, ...`` by name.

    Raises
    ------
    StyleError
        If it cannot be read, lacks a column, names a grain twice, or holds anything but finite numbers; the
        file and the place are named.
    """
    path = Path(path)
    try:
        rows = list(csv.reader(read_plain_text(path).splitlines(), strict=True))
    except (PlainFileError, csv.Error) as error:
        raise StyleError(f"{path} cannot be read as a table of latent vectors ({error}).") from error
    header, *rows = rows or [[]]
    columns = _columns(path, header)
    place = header.index("name")
    found: dict[str, np.ndarray] = {}
    for number, row in enumerate(rows, start=2):
        if not row:
            continue
        if len(row) != len(header):
            raise StyleError(f"{path} has {len(row)} cells in line {number} under {len(header)} headings.")
        if row[place] in found:
            raise StyleError(f"{path} names two grains {_quoted(row[place])}: rename one.")
        found[row[place]] = np.array([_number(path, number, header[k], row[k]) for k in columns])
    return found


def _columns(path: Path, header: list[str]) -> list[int]:
    """Return where z1, z2, ... stand, in that order."""
    if header.count("name") != 1:
        raise StyleError(f"{path} has no single column 'name': give a table that mbstudio latent wrote.")
    numbered = {name: k for k, name in enumerate(header) if re.fullmatch(r"z[1-9]\d{0,5}", name)}
    wanted = [f"z{k}" for k in range(1, min(len(numbered), _MOST_VARIABLES) + 1)]
    missing = next((name for name in wanted or ["z1"] if name not in numbered), None)
    if missing or sum(name in numbered for name in header) != len(numbered):
        raise StyleError(f"{path} lacks the column '{missing or 'z1'}', or has one twice: it is damaged.")
    return [numbered[name] for name in wanted]


def _number(path: Path, line: int, column: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise StyleError(
            f"{path} has {_quoted(text)} in line {line} under {column}, which is no finite number."
        )
    return value


def _quoted(text: str) -> str:
    return f"'{text}'" if len(text) <= 40 and text.isprintable() else f"{text[:40]!r}..."
