"""The layers of a scene, one line each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, get_type_hints

from mbstudio.scene.layers.avatar import ChosenAvatar
from mbstudio.scene.layers.avatars import AllAvatars
from mbstudio.scene.layers.contact_network import ContactNetwork
from mbstudio.scene.layers.control_points import ControlPoints
from mbstudio.scene.layers.deviation_map import DeviationMap
from mbstudio.scene.layers.envelope import Envelope
from mbstudio.scene.layers.export_shape import ExportShape
from mbstudio.scene.layers.ghosts import GhostA, GhostB
from mbstudio.scene.layers.grain import ChosenGrain
from mbstudio.scene.layers.grains import AllGrains
from mbstudio.scene.layers.layer import Layer, Stage
from mbstudio.scene.layers.live import LiveGrain
from mbstudio.scene.layers.outline import Outline
from mbstudio.scene.layers.packing import PackedLayer
from mbstudio.scene.layers.part_box import PartBox
from mbstudio.scene.layers.side_by_side import SideBySide
from mbstudio.scene.layers.slices import Slices
from mbstudio.scene.layers.tray import Tray
from mbstudio.scene.layers.volume import Volume


class Layers(Mapping[str, Layer[Any]]):
    """The layers of one scene, by name (``layers["avatar"]``) and as attributes (``layers.avatar``).

    The annotations below are the registry: name and class of each layer, in the order in which they are
    drawn (those one sees through come last) and in which the window offers their switches.

    Parameters
    ----------
    stage : Stage
        What they share.
    """

    outline: Outline
    part_box: PartBox
    slices: Slices
    volume: Volume
    grains: AllGrains
    grain: ChosenGrain
    avatar: ChosenAvatar
    deviation: DeviationMap
    points: ControlPoints
    avatars: AllAvatars
    network: ContactNetwork
    live: LiveGrain
    ghost_a: GhostA
    ghost_b: GhostB
    shape: ExportShape
    envelope: Envelope
    packing: PackedLayer
    tray: Tray
    side_by_side: SideBySide

    def __init__(self, stage: Stage) -> None:
        self._by_name = {name: kind(name, stage) for name, kind in LAYERS.items()}
        vars(self).update(self._by_name)

    def __getitem__(self, name: str) -> Layer[Any]:
        return self._by_name[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._by_name)

    def __len__(self) -> int:
        return len(self._by_name)


LAYERS: dict[str, type[Layer[Any]]] = get_type_hints(Layers)
"""The class of each layer by its name. A scene has those that are here when it is made."""


def switched_layers() -> dict[str, type[Layer[Any]]]:
    """Return the layers that a person can switch on and off: those with a title."""
    return {name: kind for name, kind in LAYERS.items() if kind.title}
