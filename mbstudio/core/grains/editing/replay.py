"""Making edits again on other grains of the same scan, such as those of another segmentation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Generic

from mbstudio.core.errors import EditError
from mbstudio.core.grains.editing.boxes import holds
from mbstudio.core.grains.editing.editable import EditOutcome, Grains
from mbstudio.core.grains.editing.records import Edit, Split

if TYPE_CHECKING:
    from mbstudio.core.scan.scan import Scan


@dataclass(frozen=True)
class Replay(Generic[Grains]):
    """What came of making edits again.

    Attributes
    ----------
    grains : GrainSet
    made : tuple of EditOutcome
        Those that could be made, in their order.
    left_out : tuple of (Edit, str)
        Those that could not, each with the reason.
    """

    grains: Grains
    made: tuple[EditOutcome[Grains], ...]
    left_out: tuple[tuple[Edit, str], ...]


def replay(edits: Sequence[Edit], grains: Grains, scan: Scan | None = None) -> Replay[Grains]:
    """Make edits again, on the grains that lie where those lay that the edits were made on.

    Grains are found by a voxel inside each, not by their numbers.

    Parameters
    ----------
    edits : sequence of Edit
        Such as the ``edits`` of other grains of the same scan.
    grains : GrainSet
    scan : Scan, optional
        For edits that look at grey values.
    """
    made, left_out = [], []
    for edit in edits:
        try:
            outcome = grains.edit(relabelled(edit, grains), scan)
        except EditError as error:
            left_out.append((edit, str(error)))
            continue
        grains = outcome.grains
        made.append(outcome)
    return Replay(grains, tuple(made), tuple(left_out))


def relabelled(edit: Edit, grains: Grains) -> Edit:
    """Return an edit with the numbers of the grains that lie where its own lay.

    Raises
    ------
    EditError
        If there is no grain at such a place, or what were several grains are one, or the other way round.
    """
    if len(edit.anchors) != len(edit.labels):
        raise EditError(f"{edit.described()}: it is not noted where its grains lay.")
    labels = []
    for label, (z, y, x) in zip(edit.labels, edit.anchors, strict=True):
        if not holds(grains.label_volume.shape, (z, y, x)):
            raise EditError(f"{edit.described()}: (z, y, x) = {(z, y, x)} lies outside this scan.")
        found = int(grains.label_volume[z, y, x])
        if not found:
            raise EditError(
                f"{edit.described()}: there is no grain at (z, y, x) = {(z, y, x)}, where grain {label} was."
            )
        labels.append(found)
    if len(set(labels)) < len(set(edit.labels)):
        raise EditError(f"{edit.described()}: what were several grains is grain {labels[0]} alone here.")
    if isinstance(edit, Split):
        at_seeds = {int(grains.label_volume[seed]) for seed in edit.seeds} - {0}
        if len(at_seeds) > 1:
            raise EditError(
                f"{edit.described()}: the seeds lie in {len(at_seeds)} grains already: "
                f"{', '.join(map(str, sorted(at_seeds)))}."
            )
        labels = sorted(at_seeds) or labels
    return replace(edit, labels=tuple(labels))
