"""Which layers of the view each station has, and which of them are switched on."""

from __future__ import annotations

# Layers that can be switched at each station.
STATION_LAYERS: dict[str, tuple[str, ...]] = {
    "scan": ("slices", "volume"),
    "grains": ("slices", "volume", "grains"),
    "fit": ("slices", "grain", "avatar", "deviation", "points"),
    "populations": ("slices", "grains", "avatars"),
    "style": (),
    "latent": ("live", "ghost_a", "ghost_b"),
    "export": ("slices", "grains", "avatars", "shape", "envelope"),
}


class StationLayers:
    """What each station shows: what it shows at first, and what was switched since."""

    def __init__(self) -> None:
        self._shown: dict[str, set[str]] = {
            "scan": {"slices"},
            "grains": {"grains"},
            "fit": {"grain", "avatar"},
            "populations": {"grains"},
            "style": set(),
            "latent": {"live"},
            "export": {"avatars", "shape", "envelope"},
        }
        self._covered: set[str] = set()

    def shown(self, station: str) -> set[str]:
        """Return the layers that are on, as a copy."""
        return set(self._shown[station])

    def is_shown(self, station: str, layer: str) -> bool:
        """Return whether a layer is on."""
        return layer in self._shown[station]

    def switch(self, station: str, layer: str, shown: bool) -> None:
        """Switch a layer on or off.

        The map of deviations lies on the avatar's surface and is not to be looked at through the
        grain: with it both are switched off, and on again after it.
        """
        layers = self._shown[station]
        if layer == "deviation" and shown:
            self._covered = layers & {"grain", "avatar"}
            layers -= self._covered
        elif layer == "deviation":
            layers |= self._covered
        elif layer == "avatar" and shown:
            layers.discard("deviation")
        (layers.add if shown else layers.discard)(layer)
