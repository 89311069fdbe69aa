"""Other grains for a project: what of its work stays, and what would be discarded."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING

from mbstudio.core.grains.editing.replay import replay
from mbstudio.core.grains.editing.unchanged import match_unchanged
from mbstudio.core.project.state import ProjectState

if TYPE_CHECKING:
    from mbstudio.core.grains.editing.records import Edit
    from mbstudio.core.grains.grain_set import GrainSet
    from mbstudio.core.grains.segmentation import SegmentationSettings
    from mbstudio.core.scan.scan import Scan


@dataclass(frozen=True, eq=False)
class Regraining:
    """A project's state with other grains.

    Attributes
    ----------
    state : ProjectState
        With the other grains, corrected as those before were, and all avatars whose grain is the same, voxel
        by voxel.
    kept : int
        Avatars that stay.
    discarded : tuple of int
        Labels, before, of the grains whose avatars go.
    left_out : tuple of (Edit, str)
        Corrections by hand that cannot be made on the other grains, each with the reason.
    renumbered : mapping of int to int
        From the label before to the label now, of all grains that are the same.
    """

    state: ProjectState
    kept: int
    discarded: tuple[int, ...]
    left_out: tuple[tuple[Edit, str], ...]
    renumbered: MappingProxyType[int, int]

    @property
    def loses_something(self) -> bool:
        """Whether avatars or corrections by hand go."""
        return bool(self.discarded or self.left_out)


def regrain(
    state: ProjectState,
    grains: GrainSet,
    settings: SegmentationSettings | None,
    scan: Scan | None = None,
) -> Regraining:
    """Return a state with other grains of the same scan, and what that would discard.

    Corrections by hand are made again where there is a grain in their place. Avatars stay, under the grain's
    number now, where a grain has the same voxels as before.

    Parameters
    ----------
    state : ProjectState
    grains : GrainSet
        As they were found or loaded.
    settings : SegmentationSettings or None
        What they were found with.
    scan : Scan, optional
        For corrections that look at grey values.

    Notes
    -----
    The measures of a grain belong to its avatar and its voxels: they stay with it.
    """
    before = state.grains
    if before is None:
        changed = replace(
            state,
            grains=grains,
            segmentation=settings,
            fits=MappingProxyType({}),
            outdated=MappingProxyType({}),
            twin=None,
        )
        return Regraining(changed, 0, (), (), MappingProxyType({}))
    replayed = replay(before.edits, grains, scan)
    matched = match_unchanged(before, replayed.grains)
    fits = {matched[label]: fit for label, fit in state.fits.items() if label in matched}
    outdated = {
        matched[label]: fit
        for label, fit in state.outdated.items()
        if label in matched and state.fits.get(label) is fit
    }
    # Its contacts hang on all grains together, under their numbers.
    same = len(matched) == len(before) == len(replayed.grains) and all(
        label == number for label, number in matched.items()
    )
    changed = replace(
        state,
        grains=replayed.grains,
        segmentation=settings,
        fits=MappingProxyType({label: fits[label] for label in sorted(fits)}),
        outdated=MappingProxyType({label: outdated[label] for label in sorted(outdated)}),
        twin=state.twin if same else None,
    )
    discarded = tuple(sorted(label for label in state.fits if label not in matched))
    return Regraining(changed, len(fits), discarded, replayed.left_out, MappingProxyType(matched))
