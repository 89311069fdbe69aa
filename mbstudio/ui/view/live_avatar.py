"""An avatar while it is being fitted, as the view draws it."""

from __future__ import annotations

from dataclasses import dataclass

from mbstudio.scene.surfaces import Surface


@dataclass(frozen=True, eq=False)
class LiveAvatar:
    """The avatar as it stands, ready to be drawn."""

    surface: Surface
    points: Surface
