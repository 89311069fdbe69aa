"""Correcting grains by hand: each method gives other grains that share what did not change."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Generic, Self, TypeVar

import numpy as np

from mbstudio.core.errors import EditError, GrainWarning
from mbstudio.core.grains.editing import records
from mbstudio.core.grains.editing.brush import Over
from mbstudio.core.grains.editing.label_volume import LabelVolume
from mbstudio.core.grains.editing.records import Edit, labels_of, point_of, voxel_of
from mbstudio.core.grains.editing.workbench import Workbench

if TYPE_CHECKING:
    from typing import Self

    import pandas as pd

    from mbstudio.core.grains.grain_mesh import GrainMesh
    from mbstudio.core.grains.verdict import SegmentationVerdict
    from mbstudio.core.scan.field_of_view import FieldOfView
    from mbstudio.core.scan.scan import Scan
    from mbstudio.core.units import VoxelSize

Grains = TypeVar("Grains", bound="EditableGrains")

_ALSO_OF_MESHES = (records.Delete, records.Exclude, records.Include, records.Accept)


@dataclass(frozen=True)
class EditOutcome(Generic[Grains]):
    """What came of an edit.

    Attributes
    ----------
    grains : GrainSet
    edit : Edit
        The record of it, which is the last of ``grains.edits``.
    changed : frozenset of int
        Grains that were there before and have other voxels now.
    gone : frozenset of int
        Grains that are no more.
    new : frozenset of int
        Grains that were not there before.
    notes : tuple of str
        What should be told of it: pieces that came apart, crumbs that went.
    """

    grains: Grains
    edit: Edit
    changed: frozenset[int]
    gone: frozenset[int]
    new: frozenset[int]
    notes: tuple[str, ...]


class EditableGrains:
    """What :class:`~mbstudio.core.grains.grain_set.GrainSet` can be corrected by.

    Numbers of grains that an edit does not touch never change, a new grain gets a number that none has had,
    and places are (z, y, x) in voxels. Notes on an edit are given as :class:`GrainWarning`.
    """

    label_volume: LabelVolume
    table: pd.DataFrame
    voxel_size: VoxelSize
    origin: tuple[float, float, float]
    meshes: Mapping[int, GrainMesh]
    verdict: SegmentationVerdict | None
    view: FieldOfView | None
    edits: tuple[Edit, ...]
    last_label: int
    stamps: Mapping[int, object]

    def edit(self, edit: Edit, scan: Scan | None = None) -> EditOutcome[Self]:
        """Make one edit.

        Parameters
        ----------
        edit : Edit
            What to do, such as ``Merge(labels=(3, 7))``.
        scan : Scan, optional
            For edits that look at grey values.

        Raises
        ------
        EditError
            If it cannot be made; nothing has changed then.
        """
        if "name" in self.table and not isinstance(edit, _ALSO_OF_MESHES):
            raise EditError(
                f"{edit.title}: these grains are bodies of mesh files, whose surfaces are exact. Correct the "
                "files, or delete and exclude grains."
            )
        before = {int(label) for label in self.table["label"].to_numpy()}
        bench = Workbench(
            self.label_volume, self.table, self.voxel_size, self.origin, self.view, self.last_label, scan
        )
        done = edit.make(bench)
        if before and before <= bench.gone and not bench.changed:
            raise EditError(f"{edit.title}: no grain would be left. Find the grains anew instead.")
        table = bench.settled_table()
        new = frozenset(bench.changed - before)
        stamps = {label: stamp for label, stamp in self.stamps.items() if label not in bench.gone}
        stamps |= {label: object() for label in bench.changed}
        grains = replace(
            self,  # type: ignore[type-var]  # the grain set itself is the record
            label_volume=bench.volume,
            table=table,
            meshes=self._meshes_left(bench.gone),
            edits=(*self.edits, done),
            last_label=max(self.last_label, *new, 0),
            verdict=self.verdict if done.is_remark else self._verdict_after(table),
            stamps=MappingProxyType(stamps),
        )
        return EditOutcome(
            grains, done, frozenset(bench.changed & before), frozenset(bench.gone), new, tuple(bench.notes)
        )

    # ---- single edits --------------------------------------------------------------------------

    def merged(self, labels: Iterable[int], *, apart: bool = False) -> Self:
        """Make grains one, which keeps the first of their numbers.

        Parameters
        ----------
        labels : iterable of int
            Two or more.
        apart : bool
            Close gaps between grains that do not touch; they are refused otherwise.
        """
        return self._edited(records.Merge(labels=labels_of(labels), apart=apart))

    def split(self, label: int, seeds: Sequence[Sequence[int]], *, scan: Scan | None = None) -> Self:
        """Part a grain by watershed from seeds; the largest part keeps its number.

        Parameters
        ----------
        label : int
        seeds : sequence of (z, y, x)
            A voxel in each part.
        scan : Scan, optional
            Look at the grey values too, and not only at the distance to the surface.

        Raises
        ------
        EditError
            If a seed lies outside the grain, or two of them in one basin.
        """
        places = tuple(voxel_of(seed) for seed in seeds)
        return self._edited(
            records.Split(labels=labels_of(label), seeds=places, by_grey=scan is not None), scan
        )

    def split_along(self, label: int, points: Sequence[Sequence[float]], *, axis: int = 0) -> Self:
        """Part a grain along a line; the largest part keeps its number.

        Parameters
        ----------
        label : int
        points : sequence of (z, y, x)
            Corners of the line, which goes on straight beyond its ends.
        axis : int
            The axis along which it is seen, and along which it extends as a sheet.
        """
        line = tuple(point_of(point) for point in points)
        return self._edited(records.SplitAlong(labels=labels_of(label), points=line, axis=axis))

    def without(self, labels: Iterable[int]) -> Self:
        """Take grains away."""
        return self._edited(records.Delete(labels=labels_of(labels)))

    def excluded(self, labels: Iterable[int]) -> Self:
        """Leave grains out of fits, populations, learning and export without changing them."""
        return self._edited(records.Exclude(labels=labels_of(labels)))

    def included(self, labels: Iterable[int]) -> Self:
        """Take grains in again that were excluded."""
        return self._edited(records.Include(labels=labels_of(labels)))

    def accepted(self, labels: Iterable[int]) -> Self:
        """Mark grains as looked at and right, until they change: see `suspicion`."""
        return self._edited(records.Accept(labels=labels_of(labels)))

    def painted(
        self,
        label: int | None,
        centres: Sequence[Sequence[float]],
        radius: float,
        *,
        over: Over = "void",
        axis: int | None = None,
    ) -> Self:
        """Give the voxels under the stroke of a round brush to a grain, within the field of view.

        Parameters
        ----------
        label : int or None
            None for a new grain.
        centres : sequence of (z, y, x)
            Where the brush has been.
        radius : float
            In voxels (of the smallest edge).
        over : {"void", "everything"}
            Whether voxels of other grains are taken too.
        axis : int, optional
            Paint in the slice across this axis only.
        """
        labels = () if label is None else labels_of(label)
        stroke = tuple(point_of(centre) for centre in centres)
        return self._edited(
            records.Paint(labels=labels, centres=stroke, radius=float(radius), over=over, axis=axis)
        )

    def erased(
        self,
        label: int | None,
        centres: Sequence[Sequence[float]],
        radius: float,
        *,
        axis: int | None = None,
    ) -> Self:
        """Take the voxels under a stroke from a grain, or from every grain; see `painted`."""
        labels = () if label is None else labels_of(label)
        stroke = tuple(point_of(centre) for centre in centres)
        return self._edited(records.Erase(labels=labels, centres=stroke, radius=float(radius), axis=axis))

    def filled(self, label: int, at: Sequence[int], *, axis: int = 0) -> Self:
        """Give the void about a voxel that a grain encloses in the slice across an axis to the grain."""
        return self._edited(records.Fill(labels=labels_of(label), at=voxel_of(at), axis=axis))

    def grown(self, labels: int | Iterable[int], by: float = 1.0) -> Self:
        """Add the void within so many voxels about grains to them."""
        return self._edited(records.Grow(labels=labels_of(labels), by=float(by)))

    def shrunk(self, labels: int | Iterable[int], by: float = 1.0) -> Self:
        """Take what lies within so many voxels of their surface from grains."""
        return self._edited(records.Shrink(labels=labels_of(labels), by=float(by)))

    def smoothed(self, labels: int | Iterable[int], sigma: float = 1.0) -> Self:
        """Smooth the outlines of grains over so many voxels."""
        return self._edited(records.Smooth(labels=labels_of(labels), sigma=float(sigma)))

    def with_holes_filled(self, labels: int | Iterable[int]) -> Self:
        """Give grains the void that they enclose."""
        return self._edited(records.FillHoles(labels=labels_of(labels)))

    def with_new_grain(self, at: Sequence[int], scan: Scan, *, threshold: float | None = None) -> Self:
        """Make a grain of what hangs together with a voxel on its side of a threshold.

        Parameters
        ----------
        at : (z, y, x)
        scan : Scan
        threshold : float, optional
            Grey value; the middle between grains and void about the voxel by default.
        """
        return self._edited(records.NewGrain(at=voxel_of(at), threshold=threshold), scan)

    # ---- what follows --------------------------------------------------------------------------

    def _edited(self, edit: Edit, scan: Scan | None = None) -> Self:
        outcome = self.edit(edit, scan)
        for note in outcome.notes:
            warnings.warn(note, GrainWarning, stacklevel=3)
        return outcome.grains

    def _meshes_left(self, gone: set[int]) -> Mapping[int, GrainMesh]:
        if gone.isdisjoint(self.meshes):
            return self.meshes
        return MappingProxyType({label: mesh for label, mesh in self.meshes.items() if label not in gone})

    def _verdict_after(self, table: pd.DataFrame) -> SegmentationVerdict | None:
        """Return the verdict with those figures anew that follow from the table."""
        if self.verdict is None:
            return None
        voxels, before = table["voxels"].to_numpy(), self.table["voxels"].to_numpy()
        figures: dict[str, Any] = {"median_diameter": float(np.median(np.cbrt(6 * voxels / np.pi)))}
        if "solid_share" in self.verdict.figures and before.sum() > 0:
            share = self.verdict.figures["solid_share"] * float(voxels.sum()) / float(before.sum())
            figures["solid_share"] = share
        if "cut_by_border" in self.verdict.figures:
            figures["cut_by_border"] = float(table["touches_border"].mean())
        return self.verdict.after_edit(figures)
