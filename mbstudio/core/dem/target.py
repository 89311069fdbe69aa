"""What a DEM target is, and the registry of them: one module a target, found by its name.

A new target is one module in :mod:`mbstudio.core.dem.formats` that ends with its ``TARGET``, and its line in
`_MODULES`: commands, forms, previews and checks find everything else in that record.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any, Literal

from mbstudio.core.dem.body import DemBody
from mbstudio.core.dem.particles import Specimen
from mbstudio.core.errors import ExportError
from mbstudio.core.options import Option, OptionList

Progress = Callable[[float, str], None]
Geometry = Literal["clump", "mesh", "grid", "metaball"]

_MODULES = (
    "stl", "obj", "ply", "metaball", "liggghts.target", "lammps.target", "kratos.target", "peclet",
    "yade.target", "yade.level_set", "pfc.target", "dem_engine.target", "comflusom", "mercury.target",
    "edem", "mechsys.target",
)  # fmt: skip


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
    runs : mapping
        What each deck costs, by its name: time steps, the step in s, and about how many hours on one core.
    """

    item_files: Sequence[tuple[str, ...]]
    item_details: Sequence[Mapping[str, Any]]
    shared_files: tuple[str, ...] = ()
    runs: Mapping[str, Mapping[str, Any]] = field(default_factory=lambda: MappingProxyType({}))


@dataclass(frozen=True)
class Target:
    """A kind of DEM file.

    Attributes
    ----------
    name, title : str
        The name in the registry and the name for people.
    geometry : {'clump', 'mesh', 'grid', 'metaball'}
        As what a grain is handed over.
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
    geometry: Geometry
    needs_density: bool
    default_unit: str | None
    write: Callable[[Job], Written]
    validate: Callable[[Path, Mapping[str, Any]], None]
    options: Mapping[str, Option] = field(default_factory=lambda: MappingProxyType({}))
    units: tuple[str, ...] = ()


@cache
def targets() -> Mapping[str, Target]:
    """Return every target by its name."""
    found = [import_module(f"mbstudio.core.dem.formats.{module}").TARGET for module in _MODULES]
    return MappingProxyType({target.name: target for target in found})


def find_target(name: str) -> Target:
    """Return a target; ExportError if there is none of that name."""
    known = targets()
    if name not in known:
        raise ExportError(f"'{name}' is not a DEM target: use one of {', '.join(known)}.")
    return known[name]


def complete_options(target: Target, given: Mapping[str, Any]) -> dict[str, Any]:
    """Return a value for every option of a target.

    Raises
    ------
    ExportError
        If an option is unknown, of the wrong type, or out of its bounds.
    """
    return OptionList(f"target '{target.name}'", ExportError, target.options).complete(given)
