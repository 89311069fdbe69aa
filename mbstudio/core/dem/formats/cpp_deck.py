"""What the C++ example decks share: tables of files, places and orientations, and reading them back."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from mbstudio.core.dem.reading_back import read_text
from mbstudio.core.dem.specimen.pouring import Pouring, check_count, check_names, check_pouring
from mbstudio.core.errors import ExportError

_TABLE = r"\b{name}\[\]\[{columns}\] = \{{\n(.*?)\n\}};"
_NAMES = re.compile(r"\bKINDS\[\] = \{(.*?)\};", re.DOTALL)


def constants(plan: Pouring) -> str:
    """Return the numbers of a deck as constants."""
    return (
        f"const double DENSITY = {plan.density:.9g};\n"
        f"const double GRAVITY = {plan.gravity:.9g};\n"
        f"const double STIFFNESS = {plan.contact.stiffness:.6g};  // N/m\n"
        f"const double STEP = {plan.contact.step:.6g};  // s, a 30th of the shortest contact\n"
        f"const double SECONDS = {plan.seconds:.6g};\n"
        f"const double HALF = {plan.stack.half:.9g}, TOP = {plan.stack.top:.9g};\n"
    )


def names_table(names: Sequence[str]) -> str:
    """Return the names of what lies beside the deck as an array ``KINDS``."""
    quoted = ", ".join(f'"{name}"' for name in names)
    return f"const char* const KINDS[] = {{{quoted}}};\n"


def number_table(name: str, rows: Float[np.ndarray, "rows columns"]) -> str:
    """Return rows of numbers as an array."""
    lines = ",\n".join("    {" + ", ".join(f"{value:.9g}" for value in row) + "}" for row in rows)
    return f"const double {name}[][{rows.shape[1]}] = {{\n{lines}\n}};\n"


def check_cpp_deck(path: Path, manifest: Mapping[str, Any], names: Sequence[str]) -> str:
    """Return the text of a deck; ExportError unless its tables and numbers are those of the manifest.

    Parameters
    ----------
    path : Path
    manifest : mapping
    names : sequence of str
        What its ``KINDS`` must be.

    Raises
    ------
    ExportError
        If brackets do not match, files are named that are not those of the export, there is another number of
        particles, places are not finite or quaternions not of length 1, or density, gravity or step are off.
    """
    text = read_text(path)
    if not brackets_match(text):
        raise ExportError(f"{path} is cut off or broken: its brackets do not match.")
    found = _NAMES.search(text)
    check_names(path, re.findall(r'"([^"]*)"', found[1]) if found else [], list(names))
    places, turns = _read_table(path, text, "PLACES", 3), _read_table(path, text, "QUATERNIONS", 4)
    for table in (places, turns):
        check_count(path, len(table), manifest)
    if not np.isfinite(places).all() or not np.allclose(np.linalg.norm(turns, axis=1), 1.0, atol=1e-6):
        raise ExportError(f"{path} has places that are not finite, or quaternions that are not of length 1.")
    check_pouring(path, text, manifest)
    return text


def brackets_match(text: str) -> bool:
    """Return whether every bracket outside comments and strings is closed by its kind."""
    code = re.sub(r'"(?:\\.|[^"\\])*"|//[^\n]*|/\*.*?\*/', "", text, flags=re.DOTALL)
    closing, waiting = {")": "(", "]": "[", "}": "{"}, []
    for sign in code:
        if sign in "([{":
            waiting.append(sign)
        elif sign in closing and (not waiting or waiting.pop() != closing[sign]):
            return False
    return not waiting


def _read_table(path: Path, text: str, name: str, columns: int) -> Float[np.ndarray, "rows columns"]:
    found = re.search(_TABLE.format(name=name, columns=columns), text, re.DOTALL)
    rows = re.findall(r"\{([^{}]*)\}", found[1]) if found else []
    try:
        return np.array([[float(word) for word in row.split(",")] for row in rows], dtype=float).reshape(
            -1, columns
        )
    except ValueError as error:
        raise ExportError(f"{path} has a table {name} that is not of {columns} numbers a row.") from error
