"""The log that Bruker's SkyScan scanners and NRecon leave beside the slices of a reconstruction."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from mbstudio.core.errors import ScanError, UnitError
from mbstudio.core.scan.readers.text import plain_text
from mbstudio.core.units import conversion_factor, parse_unit

_PIXEL = re.compile(r"^(?:image |scaled image )?pixel size\s*\((?P<unit>[^)]*)\)$", re.IGNORECASE)
_LARGEST_LOG = 2**20


@dataclass(frozen=True)
class SkyScanLog:
    """What a log says about the slices beside it.

    Attributes
    ----------
    path : Path
    spacing : tuple of float
        Edges z, y, x in micrometres.
    fields : dict
        Its entries as ``section/name``.
    notes : tuple of str
    """

    path: Path
    spacing: tuple[float, float, float]
    fields: dict[str, str]
    notes: tuple[str, ...] = ()


def find_log(folder: Path, first_slice: Path) -> SkyScanLog | None:
    """Return the log of the slices in a folder, None if there is none.

    Raises
    ------
    ScanError
        If several logs state different pixel sizes.
    """
    logs = sorted(
        entry
        for entry in folder.iterdir()
        if entry.suffix.lower() == ".log" and entry.is_file() and not entry.name.startswith(".")
    )
    of_these = [log for log in logs if first_slice.stem.lower().startswith(log.stem.lower())]
    read = [log for log in map(_read, of_these or logs) if log is not None]
    if len({log.spacing for log in read}) > 1:
        said = ", ".join(f"{log.path.name}: {log.spacing[2]:g} µm" for log in read)
        raise ScanError(
            f"The folder {folder} contains logs with different pixel sizes ({said}): keep the log of these "
            "slices."
        )
    return read[0] if read else None


def _read(path: Path) -> SkyScanLog | None:
    if path.stat().st_size > _LARGEST_LOG:
        return None
    fields: dict[str, str] = {}
    section = ""
    for line in plain_text(path.read_bytes()).splitlines():
        line = line.strip()
        if line.startswith("[") and line.endswith("]"):
            section = line[1:-1].strip()
            continue
        name, equals, value = line.partition("=")
        if equals:
            fields[f"{section}/{name.strip()}"] = value.strip()
    edge = _edge(fields, "Reconstruction")
    notes: tuple[str, ...] = ()
    if edge is None:
        edge = _edge(fields, "Acquisition")
        if edge is not None and not any(name.startswith("Reconstruction/") for name in fields):
            notes = (
                f"has a log ({path.name}) of an acquisition without a reconstruction: "
                "if these images are projections, open the folder of reconstructed slices instead.",
            )
    if edge is None:
        return None
    step = next(
        (
            _number(value)
            for name, value in fields.items()
            if name.lower().endswith("section to section step")
        ),
        None,
    )
    return SkyScanLog(path, (edge * (step or 1.0), edge, edge), fields, notes)


def _edge(fields: dict[str, str], section: str) -> float | None:
    """Return the pixel size in micrometres that a section states."""
    for name, value in fields.items():
        where, _, key = name.partition("/")
        match = _PIXEL.match(key)
        if where.lower() == section.lower() and match is not None:
            number = _number(value)
            try:
                factor = conversion_factor(parse_unit(match["unit"]), "um")
            except UnitError:
                continue
            if number is not None and number > 0:
                return number * factor
    return None


def _number(text: str) -> float | None:
    try:
        return float(text.replace(",", ".").split()[0])
    except (ValueError, IndexError):
        return None
