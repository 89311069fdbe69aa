"""Boxes about the parts of a solid that lie far apart.

One grid about bodies that are small beside their distance sees none of them, or one by chance. Each part
that surely lies apart from the others therefore gets a box of its own. A solid of one piece has one box.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float64

from mbstudio.core.metaball.field import solid_bounds, tighten_box
from mbstudio.core.metaball.lines import join_by_lines

_CELLS = (16, 48)
"""Cells along each side of a box in which parts are told apart; the finer for bodies small beside it."""
_SHRUNK = 0.9
"""Of a box: one that becomes smaller than that is looked into again."""
_SMALL = 1 / 16
"""A ball about a control point that is surely solid, as a share of the box, below which the finer is used."""
_SPECK = 1e-10
"""Of the whole, below which a box is not looked into: rounding decides there."""


def solid_boxes(control: Float64[np.ndarray, "4 n"]) -> list[Float64[np.ndarray, "2 3"]]:
    """Return disjoint boxes that surely hold the solid f >= 1 between them, and little more.

    Parameters
    ----------
    control : float array, shape (4, n)
        Rows x, y, z, k.

    Returns
    -------
    list of float array, shape (2, 3)
        Lowest and highest corner of each; :func:`~mbstudio.core.metaball.field.solid_bounds` alone where
        no part lies apart from the others.
    """
    parent = np.arange(control.shape[1])
    join_by_lines(control, parent, 64)
    if not parent.any():  # all are joined to the first
        return [solid_bounds(control)]
    whole = solid_bounds(control, rounds=0)
    done, waiting = [], [whole]
    speck = _SPECK * max(float(np.abs(whole).max()), float((whole[1] - whole[0]).max()))
    while waiting:
        box = waiting.pop()
        size = float((box[1] - box[0]).max())
        parts = _parts(box, control) if size > speck else [box]
        if len(parts) == 1 and float((parts[0][1] - parts[0][0]).max()) > _SHRUNK * size:
            done.append(parts[0])
        else:
            waiting += parts
    # One part after all, though no straight lines join it.
    return done if len(done) > 1 else [solid_bounds(control)]


def _parts(
    box: Float64[np.ndarray, "2 3"], control: Float64[np.ndarray, "4 n"]
) -> list[Float64[np.ndarray, "2 3"]]:
    """Return disjoint boxes about what may hold something in a box; one where nothing can be told apart."""
    within = ((box[0] <= control[:3].T) & (box[1] >= control[:3].T)).all(axis=1)
    for cells in _CELLS:
        low, high, full = tighten_box(box, control, 1, cells, margin=1.001)
        found = _disjoint(full)
        if len(found) > 1:
            spacing = (high - low) / np.array(full.shape[::-1])
            boxes = [np.array([low + part[0] * spacing, low + part[1] * spacing]) for part in found]
            # f has no maximum away from the control points: a part without one holds nothing.
            boxes = [part for part in boxes if _holds_any(part, control[:3, within].T)]
            if len(boxes) > 1:
                return boxes
        if np.sqrt(control[3, within].max()) > _SMALL * float((high - low).max()):
            break
    return [np.array([low, high])]


def _holds_any(box: Float64[np.ndarray, "2 3"], places: Float64[np.ndarray, "m 3"]) -> bool:
    return bool(((places >= box[0]) & (places <= box[1])).all(axis=1).any())


def _disjoint(full: Bool[np.ndarray, "Z Y X"]) -> list[np.ndarray]:
    """Return disjoint boxes about the groups of full cells: cell (x, y, z), lowest, and highest plus one."""
    import cc3d

    labels = cc3d.connected_components(full, connectivity=26)
    boxes = [
        np.array([[place.start for place in part], [place.stop for place in part]])[:, ::-1]
        for part in cc3d.statistics(labels)["bounding_boxes"][1:]
    ]
    at = 0
    while at < len(boxes):
        meets = [
            other
            for other in range(len(boxes))
            if other != at
            and (boxes[at][0] < boxes[other][1]).all()
            and (boxes[other][0] < boxes[at][1]).all()
        ]
        if not meets:
            at += 1
            continue
        joined = [boxes[index] for index in (at, *meets)]
        boxes = [box for index, box in enumerate(boxes) if index not in (at, *meets)]
        boxes.append(
            np.array([np.min([b[0] for b in joined], axis=0), np.max([b[1] for b in joined], axis=0)])
        )
        at = 0
    return boxes
