"""Making one grain of several."""

from __future__ import annotations

from collections.abc import Sequence

import edt
import numpy as np
from jaxtyping import Bool

from mbstudio.core.errors import EditError
from mbstudio.core.grains.editing.boxes import joined, widened
from mbstudio.core.grains.editing.label_volume import Box
from mbstudio.core.grains.editing.workbench import Workbench
from mbstudio.core.grains.pieces import label_pieces

_WIDEST_GAP = 16  # voxels between grains that can be made one


def merge_grains(bench: Workbench, labels: Sequence[int], apart: bool) -> None:
    """Make grains one, which keeps the first of their numbers.

    Parameters
    ----------
    labels : sequence of int
        Two or more.
    apart : bool
        Whether gaps between them are closed, where they do not touch.

    Raises
    ------
    EditError
        If fewer than two grains are named, one is named twice, they do not touch (unless `apart`), or a gap
        cannot be closed.
    """
    if len(set(labels)) < 2 or len(set(labels)) < len(labels):
        raise EditError(f"Grains {_named(labels)} cannot be merged: name two or more, each once.")
    bench.require(labels)
    region = widened(
        joined(bench.box(label) for label in labels), 1 + (_WIDEST_GAP if apart else 0), bench.shape
    )
    before = bench.read(region)
    inside = np.isin(before, labels)
    while True:
        pieces, counts = label_pieces(inside)
        if len(counts) == 1:
            break
        one, other = pieces == 1, pieces > 1
        if not apart:
            raise EditError(
                f"Grains {_named(np.unique(before[one]))} and {_named(np.unique(before[other]))} do not "
                "touch: paint the voxels between them, or merge them with apart=True (--apart), which closes "
                "the gap."
            )
        bridge = _bridge(one, other, (before == 0) & bench.seen(region), bench, region)
        if bridge is None:
            raise EditError(
                f"The gap between grains {_named(np.unique(before[one]))} and "
                f"{_named(np.unique(before[other]))} cannot be closed: it is wider than {_WIDEST_GAP} "
                "voxels, or something else lies in it. Paint what is to join them."
            )
        inside |= bridge
        bench.notes.append(f"A gap was closed with {int(np.count_nonzero(bridge)):,} voxels.")
    values = before.copy()
    values[inside] = labels[0]
    bench.write(region, values)


def _bridge(
    one: Bool[np.ndarray, "z y x"],
    other: Bool[np.ndarray, "z y x"],
    free: Bool[np.ndarray, "z y x"],
    bench: Workbench,
    region: Box,
) -> Bool[np.ndarray, "z y x"] | None:
    """Return the free voxels on the shortest ways between two bodies; None if they do not join them."""
    size = np.array(bench.voxel_size.zyx) / min(bench.voxel_size.zyx)
    from_one, from_other = (
        edt.edt(np.ascontiguousarray(~body), anisotropy=tuple(size), black_border=False)
        for body in (one, other)
    )
    gap = float(from_one[other].min())
    if gap > _WIDEST_GAP:
        return None
    # Distances run from voxel to voxel, so that a straight way is as long as the gap.
    bridge: np.ndarray = free & (from_one + from_other <= gap + 1.0)
    pieces, _ = label_pieces(one | other | bridge)
    if not np.isin(pieces[other], pieces[one][:1]).any():
        return None
    return bridge


def _named(labels: Sequence[int] | np.ndarray) -> str:
    words = [str(int(label)) for label in labels]
    return " and ".join((", ".join(words[:-1]), words[-1])) if len(words) > 1 else "".join(words)
