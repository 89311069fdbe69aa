"""The camera over the tray: there while it is shown, back where it was when it is hidden."""

from __future__ import annotations

from typing import Any

from mbstudio.scene import camera
from mbstudio.scene.scene import Scene


class TrayCamera:
    """Looks at the tray from above when it is shown, and goes back when it is hidden.

    Parameters
    ----------
    scene : Scene
        Whose tray it is.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._looked_at = 0
        self._before: tuple[Any, ...] | None = None
        self._placed: tuple[Any, ...] | None = None

    def refit(self) -> bool:
        """Fit the tray into a picture of another size, if nobody has turned it; return whether it was."""
        renderer = self._scene.plotter.renderer
        if not self._looked_at or camera.pose(renderer) != self._placed:
            return False
        self._scene.fit()
        self._placed = camera.pose(renderer)
        return True

    def look_at_tray(self, shown: bool, turned: bool) -> bool:
        """Move the camera if the tray was shown, changed or hidden; return whether it is there.

        Parameters
        ----------
        shown : bool
            Whether the tray is looked at now.
        turned : bool
            Whether what else there is to see was replaced: then there is nothing to go back to.
        """
        serial = self._scene.layers.tray.serial if shown else 0
        renderer = self._scene.plotter.renderer
        came, went = bool(serial and not self._looked_at), bool(self._looked_at and not serial)
        if came:
            self._before = camera.pose(renderer)
        if turned:
            self._before = None
        if serial and serial != self._looked_at:
            self._scene.look_from("top")
            self._placed = camera.pose(renderer)
        self._looked_at = serial
        if went and self._before is not None:
            camera.set_pose(renderer, self._before)
        elif went:
            camera.turn(renderer, "isometric")
        return bool(serial)
