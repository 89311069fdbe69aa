"""What a tool must offer to take the left button in the flat slices."""

from __future__ import annotations

from typing import Protocol


class SliceTool(Protocol):
    """Takes strokes of the mouse in the flat slices."""

    def stroke(self, voxel: tuple[int, int, int], axis: int, begun: bool) -> None:
        """Take the next place of a stroke.

        Parameters
        ----------
        voxel : tuple of int
            (z, y, x).
        axis : int
            Across which the slice was cut: 0, 1 or 2 for z, y or x.
        begun : bool
            Whether the button was pressed just now.
        """

    def end_stroke(self) -> None:
        """Take note that the button was let go."""
