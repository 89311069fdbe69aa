"""What a station shows in the 3-D view: which layers, from where, and what may be done there."""

from __future__ import annotations

from collections.abc import Iterable

from mbstudio.ui.workspace import Workspace


class Display:
    """The layers of one station: what it shows at first, and what was switched since.

    Stations that show more than their layers as they are switched have a class of their own.

    Parameters
    ----------
    workspace : Workspace
    layers : iterable of str
        Layers that can be switched.
    shown : iterable of str
        Those that are on at first.
    compares : bool
        Whether grain, avatar and clone can be shown side by side.
    shows_slices : bool
        Whether the slices can be looked at as flat pictures.
    own_space : bool
        Whether bodies stand by themselves, not where the scan has them: the camera is moved for them.
    kept_built : iterable of str
        Layers whose surfaces are kept up to date even while they are switched off.

    Attributes
    ----------
    opacity : dict of str to float
        Of the layers that are seen through.
    """

    def __init__(
        self,
        workspace: Workspace,
        layers: Iterable[str] = (),
        shown: Iterable[str] = (),
        *,
        compares: bool = False,
        shows_slices: bool = False,
        own_space: bool = False,
        kept_built: Iterable[str] = (),
    ) -> None:
        self._workspace = workspace
        self._layers, self._shown = tuple(layers), set(shown)
        self._covered: set[str] = set()
        self.compares, self.shows_slices, self.own_space = compares, shows_slices, own_space
        self.kept_built = frozenset(kept_built)
        self.opacity: dict[str, float] = {}

    # ---- what is switched ------------------------------------------------------------------------

    def offers(self, layer: str) -> bool:
        """Return whether a layer can be switched now."""
        return layer in self._layers

    @property
    def shown(self) -> set[str]:
        """The layers that are on, as a copy."""
        return set(self._shown)

    def is_shown(self, layer: str) -> bool:
        """Return whether a layer is on."""
        return layer in self._shown

    def switch(self, layer: str, shown: bool) -> None:
        """Switch a layer on or off.

        The map of deviations lies on the avatar's surface and is not to be looked at through the
        grain: with it both are switched off, and on again after it.
        """
        layers = self._shown
        if layer == "deviation" and shown:
            self._covered = layers & {"grain", "avatar"}
            layers -= self._covered
        elif layer == "deviation":
            layers |= self._covered
        elif layer == "avatar" and shown:
            layers.discard("deviation")
        (layers.add if shown else layers.discard)(layer)

    # ---- what is to be seen ----------------------------------------------------------------------

    @property
    def has_content(self) -> bool:
        """Whether there is something to be seen in the view."""
        state = self._workspace.state
        return self._workspace.scan is not None or state.grains is not None or state.new_grains is not None

    @property
    def shows_tray(self) -> bool:
        """Whether clones are laid out in the view: by default if there is nothing else."""
        return self._workspace.state.grains is None and self._workspace.scan is None

    @property
    def looked_at(self) -> object:
        """The single thing that is looked at, None for all of them; the camera moves when it changes."""
        return None

    def layers_now(self, tray: bool) -> set[str]:
        """Return the layers to be shown; `tray`: whether clones are laid out in the view."""
        return self.shown

    # ---- for stations ----------------------------------------------------------------------------

    def overview(self) -> set[str]:
        """Return what stands for the whole project: its grains, before there are any the slices."""
        return {"grains"} if self._workspace.state.grains is not None else {"slices"}

    def with_chosen(self, layers: set[str]) -> set[str]:
        """Return layers with the chosen grain by itself, where all grains are shown."""
        chosen = self._workspace.selected is not None and "grains" in layers
        return layers | {"grain"} if chosen else layers


class GrainsDisplay(Display):
    """All grains, the chosen one brought out; slices as long as there are none."""

    def layers_now(self, tray: bool) -> set[str]:
        layers = self.shown
        if self._workspace.state.grains is None:
            layers |= {"slices"}
        return self.with_chosen(layers)
