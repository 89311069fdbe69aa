"""Which bodies a style is learned from."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

Source = Literal["inside", "chosen", "avatars", "folder"]


@dataclass(frozen=True)
class Parents:
    """Which bodies a style is learned from.

    Attributes
    ----------
    source : {'inside', 'chosen', 'avatars', 'folder'}
        All grains that the edge does not cut, the chosen ones, the avatars of the project, or the meshes of
        a folder.
    labels : tuple of int
        Of grains or avatars.
    folder : Path or None
    unit : str or None
        That the numbers of the meshes are in.
    """

    source: Source
    labels: tuple[int, ...] = ()
    folder: Path | None = None
    unit: str | None = None
