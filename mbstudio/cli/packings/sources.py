"""Where the avatars of a packing come from, and what is printed of it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from mbstudio.cli import console, inputs
from mbstudio.cli.export import choose_avatars
from mbstudio.core.errors import PackingError

if TYPE_CHECKING:
    from mbstudio.core.metaball.avatar import Avatar
    from mbstudio.core.packing.packing import Packing


def avatars_of(source: Path, select: str = "valid") -> list[Avatar]:
    """Return the avatars of a project, or of a folder of control points.

    Raises
    ------
    MbstudioError
        If there are none.
    """
    from mbstudio.core.project import Project

    if inputs.is_project(source):
        return choose_avatars(Project.open(source), select, source)
    return _avatars_of_folder(source)


def clones_of(source: Path) -> list[Avatar]:
    """Return the avatars of a project's clones, or of a folder of control points.

    Raises
    ------
    MbstudioError
        If there are none.
    """
    from mbstudio.core.project import Project

    if not inputs.is_project(source):
        return _avatars_of_folder(source)
    clones = Project.open(source).state.clones
    if clones is None or not len(clones):
        raise PackingError(f"{source} has no clones: generate some and save the project.")
    return clones.avatars()


def _avatars_of_folder(folder: Path) -> list[Avatar]:
    from mbstudio.core.dem.formats.metaball import read_metaball
    from mbstudio.core.dem.manifest import read_manifest

    manifest = read_manifest(folder)
    if manifest["target"] != "metaball":
        raise PackingError(
            f"{folder} holds no control points but files for '{manifest['target']}': give a project, or a "
            "folder that 'mbstudio generate' or 'mbstudio export --to metaball' wrote."
        )
    return [
        read_metaball(folder / next(name for name in item["files"] if name.endswith(".json")))
        for item in manifest["items"]
    ]


def write_and_print(
    packing: Packing, folder: Path | None, inset: float, title: str, *, as_json: bool
) -> None:
    """Write a packing where it is wanted, and print its measures."""
    from mbstudio.core.packing.packing_files import write_packing

    summary: dict[str, Any] = packing.summary(inset)
    if folder is not None:
        write_packing(packing, folder, inset=inset)
        summary["folder"] = str(folder)
    if as_json:
        console.print_json(summary)
        return
    summary.pop("fabric")
    console.print_facts(title, summary)
