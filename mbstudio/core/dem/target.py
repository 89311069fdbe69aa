"""What a DEM target is, and the registry of them: one module a target, found by its name."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

from mbstudio.core.dem.body import DemBody
from mbstudio.core.errors import ExportError

if TYPE_CHECKING:
    from mbstudio.core.dem.specimen.specimen import Specimen

Progress = Callable[[float, str], None]
Geometry = Literal["clump", "mesh", "grid", "metaball"]

_MODULES = (
    "stl", "obj", "ply", "metaball", "liggghts.target", "lammps.target", "kratos.target", "peclet",
    "yade.target", "yade.level_set", "pfc.target", "dem_engine.target", "comflusom", "mercury.target",
    "edem", "mechsys.target",
)  # fmt: skip


@dataclass(frozen=True)
class Option:
    """One setting of a target: its default and what it means, for dialogs and the command line.

    Attributes
    ----------
    default : object
        Its type is the type of the option.
    meaning : str
    minimum, maximum : float or None
        Bounds of a number, both included.
    """

    default: Any
    meaning: str
    minimum: float | None = None
    maximum: float | None = None


@dataclass(frozen=True)
class Job:
    """Everything that a target writes from.

    Attributes
    ----------
    bodies : sequence of DemBody
        The avatars, each with its centre of mass at the origin and principal axes.
    folder : Path
        An empty folder to write into.
    unit : str
        Length unit of the files.
    density : float or None
        In kg/m**3.
    options : mapping
        A value for every option of the target.
    progress : callable
        To be called with the fraction done; it raises to cancel.
    specimen : Specimen or None
        Particles that are to be poured, in `unit`.
    remarks : dict
        What a target wants the manifest to say further about a body, by its name; ``warnings`` are told.
    """

    bodies: Sequence[DemBody]
    folder: Path
    unit: str
    density: float | None
    options: Mapping[str, Any]
    progress: Progress
    specimen: Specimen | None = None
    remarks: dict[str, dict[str, Any]] = field(default_factory=dict)


@dataclass(frozen=True)
class Written:
    """What a target wrote.

    Attributes
    ----------
    item_files : one tuple of file names for each body
    item_details : one mapping for each body
        What the manifest says about it beside mass and pose.
    shared_files : tuple of str
        Files that belong to no single body, such as an example deck.
    """

    item_files: Sequence[tuple[str, ...]]
    item_details: Sequence[Mapping[str, Any]]
    shared_files: tuple[str, ...] = ()


@dataclass(frozen=True)
class Target:
    """A kind of DEM file.

    Attributes
    ----------
    name, title : str
        The name in the registry and the name for people.
    needs_density : bool
        Whether the files state a mass.
    default_unit : str or None
        Unit of the files unless the caller says another; None: that of the first avatar.
    options : mapping of str to Option
    units : tuple of str
        Those that the files can be in; empty: any.
    write : callable(Job) -> Written
    validate : callable(folder, manifest)
        Reads every file back and raises ExportError for what an engine would swallow.
    """

    name: str
    title: str
    needs_density: bool
    default_unit: str | None
    write: Callable[[Job], Written]
    validate: Callable[[Path, Mapping[str, Any]], None]
    options: Mapping[str, Option] = field(default_factory=lambda: MappingProxyType({}))
    units: tuple[str, ...] = ()

    @property
    def geometry(self) -> Geometry:
        """As what a grain is handed over, told by what can be chosen about it."""
        if "spheres" in self.options:
            return "clump"
        if "padding" in self.options:
            return "grid"
        return "mesh" if "cells" in self.options else "metaball"


@cache
def targets() -> Mapping[str, Target]:
    """Return every target by its name."""
    found = [import_module(f"mbstudio.core.dem.formats.{module}").TARGET for module in _MODULES]
    return MappingProxyType({target.name: target for target in found})


def find_target(name: str) -> Target:
    """Return a target; ExportError if there is none of that name."""
    known = targets()
    if name not in known:
        raise ExportError(
            f"'{name}' is not a DEM target that mbstudio writes: use one of {', '.join(known)}."
        )
    return known[name]


def complete_options(target: Target, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return a value for every option of a target.

    Raises
    ------
    ExportError
        If an option is unknown, of the wrong type, or out of its bounds.
    """
    unknown = sorted(set(given) - set(target.options))
    if unknown:
        known = ", ".join(target.options) or "none"
        raise ExportError(f"The target '{target.name}' has no option '{unknown[0]}'; it has: {known}.")
    return {name: _checked(target, name, option, given.get(name)) for name, option in target.options.items()}


def _checked(target: Target, name: str, option: Option, value: Any) -> Any:
    if value is None:
        return option.default
    converted = _converted(value, type(option.default))
    if converted is None:
        kind = {bool: "yes or no", int: "a whole number", float: "a number"}.get(type(option.default), "text")
        raise ExportError(f"Option '{name}' of '{target.name}' cannot be {value!r}: give {kind}.")
    too_low = option.minimum is not None and not converted >= option.minimum
    too_high = option.maximum is not None and not converted <= option.maximum
    if too_low or too_high:
        low = "" if option.minimum is None else f" from {option.minimum:g}"
        high = "" if option.maximum is None else f" to {option.maximum:g}"
        raise ExportError(f"Option '{name}' of '{target.name}' is {value!r}: give a number{low}{high}.")
    return converted


def _converted(value: Any, wanted: type) -> Any:
    """Return a value, or text from a command line, as the wanted type; None if it is not one."""
    if wanted is bool:
        words = {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}
        return words.get(str(value).strip().lower())
    if wanted in (int, float):
        try:
            number = float(value)
        except (TypeError, ValueError):
            return None
        if not math.isfinite(number) or (wanted is int and number != int(number)):
            return None
        return wanted(number)
    return str(value)
