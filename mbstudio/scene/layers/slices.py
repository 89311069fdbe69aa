"""Slices through a scan: the picture of one, and three of them standing in space."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal, cast

import numpy as np
import pyvista as pv
from jaxtyping import Float, Int, Shaped, UInt8
from vtkmodules.vtkRenderingCore import vtkImageSlice, vtkImageSliceMapper

from mbstudio.core.grains.editing.label_volume import LabelVolume
from mbstudio.core.translation import mark
from mbstudio.scene.label_overlay import LabelLook, members, rim_of
from mbstudio.scene.layers.layer import Hit, Layer, Stage
from mbstudio.scene.layers.picking import sight
from mbstudio.scene.theme import SceneTheme, label_colours

if TYPE_CHECKING:
    from mbstudio.core.scan import Scan

Axis = Literal["x", "y", "z"]
AXES: tuple[Axis, Axis, Axis] = ("x", "y", "z")


def grey_window(scan: Scan, slices: int = 7) -> tuple[float, float]:
    """Return grey values (low, high) between which the scan shows well: its 0.5 and 99.8 percentiles.

    Voxels of exactly 0 are left out where they are many: they are the box around the field of view.
    """
    sample = sample_of_voxels(scan, slices)
    if not sample.size:
        return 0.0, 1.0
    low, high = np.percentile(sample, (0.5, 99.8))
    return (float(low), float(high)) if high > low else (float(low), float(low) + 1.0)


def sample_of_voxels(scan: Scan, slices: int = 7, side: int = 256) -> Shaped[np.ndarray, " m"]:
    """Return some of the scan's finite voxels, from evenly spaced slices, without the empty box."""
    nz, ny, nx = scan.shape
    step_y, step_x = max(1, ny // side), max(1, nx // side)
    rows = np.unique(np.linspace(0, nz - 1, min(slices + 2, nz)).astype(int))
    rows = rows[1:-1] if len(rows) > 2 else rows
    sample = np.concatenate([np.asarray(scan.voxels[int(z)])[::step_y, ::step_x].ravel() for z in rows])
    if np.issubdtype(sample.dtype, np.floating):
        sample = sample[np.isfinite(sample)]
    inside = sample[sample != 0]
    return inside if 0 < inside.size < 0.95 * sample.size else sample


def cut(volume: Any, axis: Axis, index: int) -> np.ndarray:
    """Return the slice of a [z, y, x] volume across `axis`, its rows along the later axis."""
    if axis == "z":
        return np.asarray(volume[index])
    # Each voxel lies in another page of memory across x: they are fetched once, not at every step after it.
    return np.ascontiguousarray(volume[:, index, :] if axis == "y" else volume[:, :, index])


def slice_image(
    grey: Shaped[np.ndarray, "h w"],
    window: tuple[float, float],
    labels: Int[np.ndarray, "h w"] | None = None,
    colours: UInt8[np.ndarray, "k 3"] | None = None,
    look: LabelLook = LabelLook(),  # noqa: B008  # frozen
) -> UInt8[np.ndarray, "h w 3"]:
    """Return a slice as red, green and blue: grey values in the window, grains outlined or filled.

    Parameters
    ----------
    window : tuple of float
        Grey values shown black and white.
    labels : int array, shape (h, w), optional
        Grain labels of the same slice; the outline of each lies inside it.
    colours : uint8 array, shape (k, 3), optional
        Colour of each label; by default :func:`label_colours`.
    look : LabelLook
        Whether grains are filled, outlined, or left out.
    """
    return with_grains(grey_picture(grey, window), labels, colours, look)


def with_grains(
    shown: UInt8[np.ndarray, "h w"],
    labels: Int[np.ndarray, "h w"] | None = None,
    colours: UInt8[np.ndarray, "k 3"] | None = None,
    look: LabelLook = LabelLook(),  # noqa: B008  # frozen
) -> UInt8[np.ndarray, "h w 3"]:
    """Return a grey picture as red, green and blue, grains outlined or filled as in :func:`slice_image`."""
    image = np.repeat(shown[..., None], 3, axis=2)
    if labels is None or look.draws_nothing or not labels.any():
        return image
    if look.only is not None:
        labels = np.where(members(labels, look.only), labels, 0)
    if colours is None:
        colours = label_colours(int(labels.max()))
    if look.opacity > 0:
        inside = labels > 0
        share = np.float32(min(look.opacity, 1.0))
        image[inside] = (1 - share) * image[inside] + share * colours[labels[inside]]
    if look.outlines:
        edge = rim_of(labels)
        image[edge] = colours[labels[edge]]
    return image


def grey_picture(grey: Shaped[np.ndarray, "h w"], window: tuple[float, float]) -> UInt8[np.ndarray, "h w"]:
    """Return grey values as they are shown: 0 for those at the lower end of the window, 255 at the upper."""
    low, high = window
    scale = 255.0 / max(high - low, 1e-30)
    shown = np.nan_to_num((np.asarray(grey, dtype=np.float32) - low) * scale, nan=0.0)
    return np.clip(shown, 0, 255).astype(np.uint8)


class SlicePlanes:
    """Three slices across x, y and z, standing where they were cut, each with a thin frame.

    Parameters
    ----------
    plotter : pyvista.BasePlotter
    scan : Scan
    axis_colours : tuple of str
        Colours of the frames across x, y and z.

    Attributes
    ----------
    window : tuple of float
        Grey values shown black and white.
    index : dict of Axis to int
        The voxel at which each axis is cut.
    look : LabelLook
        How grains are drawn over the grey values.
    images : dict of Axis to uint8 array, shape (h, w, 3)
        Each slice as it stands in space, since it was last seen there.
    greys : dict of Axis to uint8 array, shape (h, w)
        Each slice without grains.
    labels : dict of Axis to int array, shape (h, w), or None
        The labels of each slice.
    """

    def __init__(self, plotter: pv.BasePlotter, scan: Scan, axis_colours: tuple[str, str, str]) -> None:
        # pyvista's wrappers hide the methods' types.
        self._plotter: Any = cast(Any, plotter)
        self._scan = scan
        self.window = grey_window(scan)
        nz, ny, nx = scan.shape
        self.counts: dict[Axis, int] = {"x": nx, "y": ny, "z": nz}
        self.index: dict[Axis, int] = {axis: count // 2 for axis, count in self.counts.items()}
        self.shown: dict[Axis, bool] = dict.fromkeys(AXES, True)
        self._visible = False
        self._stale: set[Axis] = set()  # cut since they were last laid into space
        self._labels: LabelVolume | None = None
        self._colours: np.ndarray | None = None
        self.look = LabelLook()
        self.images: dict[Axis, UInt8[np.ndarray, "h w 3"]] = {}
        self.greys: dict[Axis, UInt8[np.ndarray, "h w"]] = {}
        self.labels: dict[Axis, Int[np.ndarray, "h w"] | None] = {}
        self._planes: dict[Axis, vtkImageSlice] = {}
        self._frames: dict[Axis, pv.Actor] = {}
        for axis, colour in zip(AXES, axis_colours, strict=True):
            plane = vtkImageSlice()
            mapper = vtkImageSliceMapper()
            mapper.SetOrientation(AXES.index(axis))
            plane.SetMapper(mapper)
            plane.GetProperty().SetColorWindow(255)
            plane.GetProperty().SetColorLevel(127.5)
            plane.GetProperty().SetInterpolationTypeToNearest()
            plane.PickableOff()
            self._plotter.add_actor(plane, name=f"slice {axis}", reset_camera=False, render=False)
            self._planes[axis] = plane
            self._frames[axis] = self._plotter.add_mesh(
                pv.PolyData(np.zeros((1, 3), np.float32)),
                color=colour,
                line_width=2,
                name=f"frame {axis}",
                pickable=False,
                reset_camera=False,
                render=False,
                lighting=False,
            )
            self._draw(axis)

    def move(self, axis: Axis, index: int) -> None:
        """Cut across `axis` at voxel `index`."""
        self.index[axis] = int(np.clip(index, 0, self.counts[axis] - 1))
        self._draw(axis)

    def set_window(self, low: float, high: float) -> None:
        """Show grey value `low` black and `high` white."""
        self.window = (float(low), float(high))
        self._draw_all()

    def set_labels(self, labels: LabelVolume | None, largest: int = 0) -> None:
        """Outline the grains of a label volume of the scan's shape, whose labels go up to `largest`."""
        self._labels = labels
        self._colours = None if labels is None else label_colours(largest)
        self._draw_all()

    def set_look(self, look: LabelLook) -> None:
        """Fill, outline or leave out grains."""
        # Slices in space are too coarse for lines of two widths.
        differs = replace(look, bold=self.look.bold) != self.look
        self.look = look
        if differs and self._labels is not None:
            self._draw_all()

    @property
    def colours(self) -> UInt8[np.ndarray, "k 3"] | None:
        """The colour of each label; None without labels."""
        return self._colours

    @property
    def auto_window(self) -> tuple[float, float]:
        """Grey values between which the scan shows well."""
        return grey_window(self._scan)

    def set_visible(self, visible: bool) -> None:
        """Show or hide all three."""
        self._visible = visible
        self._apply_visibility()

    def show(self, axis: Axis, shown: bool) -> None:
        """Show or hide the slice across one axis."""
        self.shown[axis] = shown
        self._apply_visibility()

    def is_seen(self, axis: Axis) -> bool:
        """Return whether the slice across one axis is to be seen."""
        return self._visible and self.shown[axis]

    def corners(self, axis: Axis) -> Float[np.ndarray, "4 3"]:
        """Return the corners (x, y, z) of the slice across an axis: its outermost voxels' centres."""
        number = AXES.index(axis)
        spacing = np.array(self._scan.voxel_size.xyz)
        low = np.array(self._scan.origin, dtype=float)
        size = spacing * (np.array([self.counts[name] for name in AXES]) - 1)
        low[number] += self.index[axis] * spacing[number]
        size[number] = 0.0
        return _rectangle(low, size, number)

    def spacing(self, axis: Axis) -> float:
        """Return the edge of a voxel along an axis."""
        return float(self._scan.voxel_size.xyz[AXES.index(axis)])

    def voxel_at(self, point: Float[np.ndarray, "3"]) -> tuple[int, int, int]:
        """Return the indices (x, y, z) of the voxel nearest to a point within the scan."""
        places = (np.asarray(point) - self._scan.origin) / self._scan.voxel_size.xyz
        x, y, z = (
            int(np.clip(round(float(place)), 0, self.counts[axis] - 1))
            for place, axis in zip(places, AXES, strict=True)
        )
        return x, y, z

    def point_on(
        self, start: Float[np.ndarray, "3"], along: Float[np.ndarray, "3"]
    ) -> Float[np.ndarray, "3"] | None:
        """Return where a line of sight first meets a slice that is seen, or None."""
        best, found = np.inf, None
        for number, axis in enumerate(AXES):
            if not self.is_seen(axis) or abs(along[number]) < 1e-9:
                continue
            corners = self.corners(axis)
            share = (corners[0, number] - start[number]) / along[number]
            place = start + share * along
            others = [other for other in range(3) if other != number]
            low, high = corners.min(axis=0)[others], corners.max(axis=0)[others]
            if share < best and ((place[others] >= low) & (place[others] <= high)).all():
                best, found = share, place
        return found

    @property
    def actors(self) -> Sequence[Any]:
        """The three slices and their frames."""
        return [*self._planes.values(), *self._frames.values()]

    def recolour(self, axis_colours: tuple[str, str, str]) -> None:
        """Give the frames other colours."""
        for axis, colour in zip(AXES, axis_colours, strict=True):
            self._frames[axis].prop.color = colour

    def remove(self) -> None:
        """Take everything out of the plotter."""
        for actor in self.actors:
            self._plotter.remove_actor(actor, reset_camera=False, render=False)
        self._planes.clear()
        self._frames.clear()

    def _apply_visibility(self) -> None:
        for axis in AXES:
            seen = self.is_seen(axis)
            if seen and axis in self._stale:
                self._lay(axis)
            self._planes[axis].SetVisibility(seen)
            self._frames[axis].SetVisibility(seen)

    def _draw_all(self) -> None:
        for axis in AXES:
            self._draw(axis)

    def _draw(self, axis: Axis) -> None:
        """Cut a slice anew, and lay it into space if it is seen there."""
        index = self.index[axis]
        self.labels[axis] = None if self._labels is None else cut(self._labels, axis, index)
        self.greys[axis] = grey_picture(cut(self._scan.voxels, axis, index), self.window)
        self._stale.add(axis)
        if self.is_seen(axis):
            self._lay(axis)

    def _lay(self, axis: Axis) -> None:
        """Lay a slice into space."""
        self._stale.discard(axis)
        image = with_grains(self.greys[axis], self.labels[axis], self._colours, self.look)
        self.images[axis] = image
        number = AXES.index(axis)
        dimensions = [self.counts[name] for name in AXES]
        dimensions[number] = 1
        spacing = np.array(self._scan.voxel_size.xyz)
        origin = np.array(self._scan.origin, dtype=float)
        origin[number] += self.index[axis] * spacing[number]
        data = pv.ImageData(dimensions=dimensions, spacing=tuple(spacing), origin=tuple(origin))
        data.point_data["grey"] = image.reshape(-1, 3)
        self._planes[axis].GetMapper().SetInputData(data)
        self._frames[axis].mapper.dataset = _frame(origin, spacing * (np.array(dimensions) - 1), number)


def _frame(origin: np.ndarray, size: np.ndarray, axis: int) -> pv.PolyData:
    """Return the closed rectangle around a slice across `axis`."""
    corners = _rectangle(origin, size, axis)
    return pv.lines_from_points(np.concatenate([corners, corners[:1]]))


def _rectangle(origin: np.ndarray, size: np.ndarray, axis: int) -> Float[np.ndarray, "4 3"]:
    first, second = (np.eye(3)[number] * size[number] for number in range(3) if number != axis)
    return np.array([origin, origin + first, origin + first + second, origin + second])


class Slices(Layer["Scan"]):
    """Three slices through the scan.

    Attributes
    ----------
    planes : SlicePlanes or None
        None without a scan.
    """

    title = mark("Slices")
    icon = "ph.squares-four"
    tip = mark("Slices through the scan")
    is_clipped = False
    has_outline = True
    is_within_scan = True
    shows_one_grain = True

    def __init__(self, name: str, stage: Stage) -> None:
        super().__init__(name, stage)
        self.planes: SlicePlanes | None = None

    @property
    def actors(self) -> Sequence[Any]:
        return [] if self.planes is None else self.planes.actors

    def set(self, content: Scan | None, unit: str | None = None) -> None:
        if self.planes is not None:
            self.planes.remove()
        self.planes = self.stage.grey_window = None
        if content is not None:
            self.stage.set_unit(content.unit)
            self.planes = SlicePlanes(self.stage.plotter, content, self.stage.theme.axes)
            self.planes.set_visible(self.is_visible)
            self.stage.grey_window = self.planes.window
        self.stage.update()

    def set_window(self, low: float, high: float) -> None:
        """Show grey value `low` of the scan black and `high` white."""
        if self.planes is not None:
            self.planes.set_window(low, high)
            self.stage.grey_window = self.planes.window

    def refresh(self) -> None:
        if self.planes is not None:
            self.planes.set_visible(self.is_visible)

    def recolour(self, theme: SceneTheme) -> None:
        if self.planes is not None:
            self.planes.recolour(theme.axes)

    def points(self) -> Float[np.ndarray, "m 3"] | None:
        """Return the corners of all three slices, shape (12, 3), or None."""
        planes = self.planes
        return None if planes is None else np.concatenate([planes.corners(axis) for axis in AXES])

    def pick(self, x: float, y: float) -> Hit | None:
        """Return where a slice lies under a pixel, or None."""
        if self.planes is None:
            return None
        point = self.planes.point_on(*sight(self.stage.renderer, x, y))
        return None if point is None else Hit(self.name, point)
