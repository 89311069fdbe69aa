"""The axes in the corner: their size and place whatever the picture's size, their colours."""

from __future__ import annotations

import numpy as np
import pytest
import pyvista as pv

from mbstudio.scene import DARK, LIGHT, Scene
from mbstudio.scene.theme import rgb


@pytest.fixture
def corner():
    """Return a function that pictures an empty scene; True where the axes and their letters are drawn."""
    plotters = []

    def picture(size, ratio=1.0, theme=LIGHT):
        plotter = pv.Plotter(off_screen=True, window_size=size)
        plotters.append(plotter)
        scene = Scene(plotter, theme)
        scene.set_pixel_ratio(ratio)
        plotter.view_isometric()
        image = plotter.screenshot(return_img=True).astype(int)
        # The background has one colour in each row.
        return image, np.abs(image - image[:, -1:]).max(axis=2) > 24

    yield picture
    for plotter in plotters:
        plotter.close()


def reach(drawn):
    """Return the columns from the left and the rows from below that the drawn pixels reach."""
    rows, columns = np.nonzero(drawn)
    return columns.min(), columns.max(), len(drawn) - rows.max(), len(drawn) - rows.min()


def test_the_axes_are_as_large_in_every_picture(corner):
    _, small = corner((320, 260))
    _, wide = corner((1200, 300))
    _, high = corner((500, 900))
    assert small.sum() > 200
    for other in (wide, high):
        np.testing.assert_allclose(reach(other), reach(small), atol=2)
        assert other.sum() == pytest.approx(small.sum(), rel=0.1)
    assert max(reach(small)) <= 130


def test_the_axes_grow_with_the_pixels_of_the_screen(corner):
    _, once = corner((600, 600))
    _, twice = corner((600, 600), ratio=2)
    np.testing.assert_allclose(reach(twice), 2 * np.array(reach(once)), atol=8)


def test_the_letters_stand_apart_from_one_another(corner):
    from scipy import ndimage

    image, drawn = corner((400, 300))
    ink = np.abs(image - rgb(LIGHT.ink)).max(axis=2) < 60
    letters, count = ndimage.label(ink & drawn, np.ones((3, 3)))
    boxes = [box for box in ndimage.find_objects(letters) if (letters[box] > 0).sum() > 8]
    assert count >= 3
    assert len(boxes) == 3
    assert all(6 <= extent.stop - extent.start <= 20 for box in boxes for extent in box)


@pytest.mark.parametrize("theme", [LIGHT, DARK])
def test_the_axes_have_the_colours_of_the_theme(corner, theme):
    image, drawn = corner((400, 300), theme=theme)
    for colour in theme.axes:
        assert (np.abs(image[drawn] - rgb(colour)).max(axis=1) <= 4).sum() > 40
