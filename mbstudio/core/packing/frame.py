"""What grains that are settling look like at one moment."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from mbstudio.core.packing.grain_kinds import GrainKinds
from mbstudio.core.packing.mould import Mould
from mbstudio.core.packing.poses import Poses


@dataclass(frozen=True, eq=False)
class PackingFrame:
    """Grains on their way, in the unit of the kinds.

    Attributes
    ----------
    kinds : GrainKinds
        The same object in all frames of a packing.
    poses : Poses
    mould : Mould
    """

    kinds: GrainKinds
    poses: Poses
    mould: Mould


Watch = Callable[[PackingFrame], object]
"""Gets each frame as it comes."""
