"""The part of the scan that is being chosen: a region, and a bin."""

from __future__ import annotations

import numpy as np
from PySide6.QtCore import QObject, Signal

from mbstudio.core.memory import readable_bytes
from mbstudio.core.scan import Scan
from mbstudio.core.scan.excerpt import Counts, Excerpt, times
from mbstudio.core.scan.voxel_blocks import in_memory_bytes
from mbstudio.core.units import VoxelSize
from mbstudio.scene.layers.slices import Axis
from mbstudio.ui.language import tr

ORDER: tuple[Axis, Axis, Axis] = ("z", "y", "x")
BINS: tuple[Counts, ...] = ((1, 1, 1), (2, 2, 2), (3, 3, 3), (4, 4, 4), (8, 8, 8), (1, 2, 2), (1, 4, 4))


class PartDraft(QObject):
    """Region and bin as they stand, and what would become of the scan.

    Attributes
    ----------
    changed : signal
    scan : Scan or None
        The scan that the part is to be taken of; None while none is being chosen.
    """

    changed = Signal()

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.scan: Scan | None = None
        self._ends: dict[Axis, tuple[int, int]] = {}
        self._bin: Counts = (1, 1, 1)

    # ---- choosing --------------------------------------------------------------------------------

    def begin(self, scan: Scan) -> None:
        """Begin with all of a scan."""
        self.scan = scan
        self.reset()

    def end(self) -> None:
        """Choose no longer."""
        if self.scan is not None:
            self.scan = None
            self.changed.emit()

    def reset(self) -> None:
        """Choose all of the scan, as it is."""
        if self.scan is not None:
            self._ends = {axis: (0, count) for axis, count in zip(ORDER, self.scan.shape, strict=True)}
            self._bin = (1, 1, 1)
            self.changed.emit()

    def set_ends(self, ends: dict[Axis, tuple[int, int]]) -> None:
        """Let the region reach from and up to voxels along some axes, within the scan and never empty."""
        if self.scan is None:
            return
        for axis, (start, stop) in ends.items():
            count = self.scan.shape[ORDER.index(axis)]
            start = min(max(start, 0), count - 1)
            self._ends[axis] = start, min(max(stop, start + 1), count)
        self.changed.emit()

    def set_bin(self, factors: Counts) -> None:
        """Choose how many voxels along z, y, x become one."""
        if self.scan is not None and factors != self._bin:
            self._bin = factors
            self.changed.emit()

    # ---- what it is ------------------------------------------------------------------------------

    @property
    def ends(self) -> dict[Axis, tuple[int, int]]:
        """First voxel, and the one behind the last, along each axis."""
        return dict(self._ends)

    @property
    def bin(self) -> Counts:
        return self._bin

    @property
    def may_bin(self) -> bool:
        """Whether the scan is not binned already."""
        return self.scan is not None and (self.scan.excerpt is None or not self.scan.excerpt.is_binned)

    @property
    def region(self) -> Excerpt:
        """The region in voxels of the scan, not yet binned."""
        assert self.scan is not None
        start, stop = zip(*(self._ends[axis] for axis in ORDER), strict=True)
        return Excerpt(self.scan.shape, start, stop)

    @property
    def is_possible(self) -> bool:
        """Whether there is a block along each axis."""
        return min(self.region.binned(self._bin).shape) > 0

    @property
    def is_change(self) -> bool:
        """Whether it is anything but the scan as it is."""
        return not self.region.binned(self._bin).is_whole

    # ---- what becomes of it ----------------------------------------------------------------------

    def length_along(self, axis: Axis) -> float:
        """Return the length of the region along an axis, in the scan's unit."""
        assert self.scan is not None
        start, stop = self._ends[axis]
        return (stop - start) * self.scan.voxel_size.zyx[ORDER.index(axis)]

    def describe_result(self) -> str:
        """Return size, voxels and memory of what would become of the scan."""
        assert self.scan is not None
        if not self.is_possible:
            return tr("The bin is larger than the region: choose a smaller one, or a larger region.")
        shape, size = self.region.binned(self._bin).shape, self.scan.voxel_size
        z, y, x = (edge * factor for edge, factor in zip(size.zyx, self._bin, strict=True))
        return tr(
            "{shape} voxels of {size}, {memory}",
            shape=times(shape),
            size=VoxelSize(z, y, x, size.unit),
            memory=readable_bytes(in_memory_bytes(shape, np.dtype(self.scan.voxels.dtype))),
        )

    def describe_left_out(self) -> str:
        """Return what the bin leaves out at the far end; empty if nothing."""
        if not self.is_possible:
            return ""
        shape = self.region.shape
        rest = [
            f"{axis} {count % factor}"
            for axis, count, factor in zip(ORDER, shape, self._bin, strict=True)
            if count % factor
        ]
        if not rest:
            return ""
        return tr("Voxels at the far end that fill no block are left out: {rest}.", rest=", ".join(rest))
