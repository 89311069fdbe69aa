"""Everything that a project holds, as one frozen record: undo is the record before."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from mbstudio.core.formulas import nominal_diameter
from mbstudio.core.imaging.steps import FitResult, Method
from mbstudio.core.scan.excerpt import Excerpt
from mbstudio.core.units import VoxelSize

if TYPE_CHECKING:
    from mbstudio.core.cloning.surface_generation import SurfaceGeneration
    from mbstudio.core.cloning.surface_style import SurfaceStyle
    from mbstudio.core.grains.classifying import Stroke, VoxelClassifier
    from mbstudio.core.grains.editing.editable import EditOutcome
    from mbstudio.core.grains.grain_set import GrainSet
    from mbstudio.core.grains.segmentation import SegmentationSettings
    from mbstudio.core.packing.trial import PackingTrial
    from mbstudio.core.twin.kept_twin import KeptTwin
    from mbstudio.core.vae.generate.generation import Generation
    from mbstudio.core.vae.models.style_learner import StyleLearner
    from mbstudio.core.vae.shaping.kept_grain import KeptGrain

ScanIdentity = tuple[str, tuple[int, int, int], Excerpt | None]
"""Digest, shape and excerpt of a scan's voxels."""


@dataclass(frozen=True)
class ScanReference:
    """Where the scan lies and how to recognise it: the project file does not hold its voxels.

    `digest` is the SHA-256 of the voxels as they lie in memory order (z, y, x), so that it does
    not depend on the file format; `shape` is (Z, Y, X), `dtype` numpy's name. `header_bytes` and
    `big_endian` matter for RAW files, which say nothing about themselves. `embedded` scans lie
    in the project file; `path` then only tells where they came from (None: made by a program).
    `excerpt` says which of the file's voxels these are, in how large blocks; None for all as they are.
    """

    path: Path | None
    shape: tuple[int, int, int]
    dtype: str
    voxel_size: VoxelSize
    origin: tuple[float, float, float]
    digest: str
    embedded: bool = False
    header_bytes: int = 0
    big_endian: bool = False
    excerpt: Excerpt | None = None

    @property
    def identity(self) -> ScanIdentity:
        """What tells the voxels from others: two empty regions have one digest."""
        return self.digest, self.shape, self.excerpt


@dataclass(frozen=True)
class FitSettings:
    """What the next fit will use.

    `options` are those of the method that are not at their defaults. With a `target` (see
    :class:`~mbstudio.core.imaging.goals.fit_goal.FitGoal`) the number of control points is looked for,
    and `n` is not used.
    """

    n: int = 40
    method: Method = "fast"
    seed: int = 0
    options: Mapping[str, Any] = field(default_factory=dict)
    target: str = ""


LOGGED_CHANGES = 1000
"""How many titles of changes a project keeps."""


@dataclass(frozen=True, eq=False)
class ProjectState:
    """The state of a project; changing it makes a new record that shares what did not change.

    Attributes
    ----------
    scan : ScanReference or None
    segmentation : SegmentationSettings or None
        What the grains were found with; None for labels made elsewhere.
    grains : GrainSet or None
    fits : mapping of int to FitResult
        By grain label.
    fit_settings : FitSettings
    style : StyleLearner or None
        What was learned of the form of grains.
    clones : Generation or None
        New grains in a style, made last.
    surfaces : SurfaceStyle or None
        A style of surfaces in place of a style-learner.
    surface_clones : SurfaceGeneration or None
        New grains made last of those surfaces.
    packing : PackingTrial or None
        The packings made last, of avatars, clones or spheres.
    twin : KeptTwin or None
        All avatars fitted together to the grey values of the scan, of the grains as they are now.
    kept : tuple of KeptGrain
        Grains shaped by hand, of any style-learner that the project had.
    outdated : mapping of int to FitResult
        By grain label, fits whose grain was corrected by hand after it was fitted; see `changed_labels`.
    strokes : tuple of Stroke
        What was painted in the scan to tell voxels by.
    classifier : VoxelClassifier or None
        What was learned from strokes, in this scan or in another.
    log : tuple of str
        Titles of the changes that led here, oldest first, those before the file was opened among them; the
        last `LOGGED_CHANGES` of them.
    """

    scan: ScanReference | None = None
    segmentation: SegmentationSettings | None = None
    grains: GrainSet | None = None
    fits: Mapping[int, FitResult] = field(default_factory=lambda: MappingProxyType({}))
    fit_settings: FitSettings = field(default_factory=FitSettings)
    style: StyleLearner | None = None
    clones: Generation | None = None
    kept: tuple[KeptGrain, ...] = ()
    outdated: Mapping[int, FitResult] = field(default_factory=lambda: MappingProxyType({}))
    strokes: tuple[Stroke, ...] = ()
    classifier: VoxelClassifier | None = None
    log: tuple[str, ...] = ()
    surfaces: SurfaceStyle | None = None
    surface_clones: SurfaceGeneration | None = None
    packing: PackingTrial | None = None
    twin: KeptTwin | None = None

    @property
    def new_grains(self) -> Generation | SurfaceGeneration | None:
        """The clones made last, of whichever style the project has."""
        return self.clones if self.clones is not None else self.surface_clones

    @property
    def changed_labels(self) -> frozenset[int]:
        """Labels of the grains that have changed since they were fitted."""
        return frozenset(label for label, fit in self.outdated.items() if self.fits.get(label) is fit)

    @property
    def included_fits(self) -> Mapping[int, FitResult]:
        """The fits of all grains that are not excluded, by ascending label."""
        excluded = self.grains.excluded_labels if self.grains is not None else frozenset()
        return MappingProxyType(
            {label: self.fits[label] for label in sorted(self.fits) if label not in excluded}
        )

    @property
    def relative_residuals(self) -> dict[int, float]:
        """By grain label, how far avatars are off over the nominal diameters; of grains unchanged since."""
        if self.grains is None:
            return {}
        volumes = dict(zip(self.grains.table["label"], self.grains.table["volume"], strict=True))
        changed = self.changed_labels
        return {
            label: fit.verdict.rms / nominal_diameter(float(volumes[label]))
            for label, fit in self.fits.items()
            if label in volumes and label not in changed
        }

    def logging(self, title: str, since: ProjectState) -> ProjectState:
        """Return this state with its log: that of the state before it, and the title of what led here."""
        return replace(self, log=(*since.log, title)[-LOGGED_CHANGES:])

    def with_edit(self, outcome: EditOutcome[GrainSet]) -> ProjectState:
        """Return this state with its grains corrected by hand.

        Avatars of grains that are no more go, those of grains that have changed are marked. A twin goes when
        voxels change hands: its contacts are of the grains before.
        """
        fits = {label: fit for label, fit in self.fits.items() if label not in outcome.gone}
        marked = (self.changed_labels | outcome.changed) & fits.keys()
        outdated = {label: fits[label] for label in sorted(marked)}
        same = self.grains is not None and outcome.grains.label_volume is self.grains.label_volume
        return replace(
            self,
            grains=outcome.grains,
            fits=MappingProxyType(fits),
            outdated=MappingProxyType(outdated),
            twin=self.twin if same else None,
        )

    def with_fits(self, added: Mapping[int, FitResult]) -> ProjectState:
        """Return this state with fits added (or replaced) by label."""
        return replace(self, fits=MappingProxyType({**self.fits, **added}))
