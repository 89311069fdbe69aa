"""The figures of the paper show what they are about."""

from __future__ import annotations

import csv
from types import SimpleNamespace

import imageio.v3 as imageio
import numpy as np
import pytest

from mbstudio.scene.figures.paper_figures import (
    KINDS,
    FigurePlan,
    loss_figure,
    plane_figure,
    render_paper_figures,
    space_figure,
    typical_grain,
)
from mbstudio.scene.theme import LIGHT, rgb

RED = (197, 52, 43)


def near(image, colour, tolerance=30):
    return (np.abs(image.astype(int) - colour).max(axis=2) < tolerance).sum()


def bluish(image):
    """Pixels of a lit avatar: much more blue than red."""
    return (image[..., 2].astype(int) - image[..., 0]) > 40


def test_the_plane_shows_contour_circles_and_values():
    image = plane_figure()
    left, right = np.split(image, [image.shape[1] // 2], axis=1)
    assert near(left, RED) > 1000
    assert near(right, RED) > 1000
    assert near(left, (0, 0, 0)) > 1000  # control circles
    assert len(np.unique(right.reshape(-1, 3), axis=0)) > 200  # the range of values


def test_two_metaballs_become_one_as_they_approach():
    import cc3d

    image = space_figure()
    upper = bluish(image[: image.shape[0] // 2])
    pieces = cc3d.connected_components(upper[None], connectivity=26)
    sizes = np.bincount(pieces.ravel())[1:]
    assert (sizes > 500).sum() == 6  # two apart, two apart, joined, joined
    assert bluish(image[image.shape[0] // 2 :]).sum() > 10_000


def test_losses_are_drawn_by_kind():
    fits = {
        (kind, i, n): SimpleNamespace(history=np.array([1.0, 10.0 ** (-k - i / 5) / n]))
        for k, kind in enumerate(KINDS)
        for i in range(2)
        for n in (5, 10, 40)
    }
    image = loss_figure(fits)
    for colour in (LIGHT.grain, LIGHT.avatar, LIGHT.points, "#2f8f6b"):
        assert near(image, rgb(colour)) > 300


@pytest.mark.parametrize("kind", KINDS)
def test_grains_are_of_about_the_size_asked_for(kind):
    grain = typical_grain(kind, 30, 1)
    assert grain.nominal_diameter == pytest.approx(300, rel=0.25)


def test_all_figures_are_written_and_none_is_blank(tmp_path):
    plan = FigurePlan(numbers=(3, 24), shown=(3, 24), grains=1, diameter=22)
    said = []
    written = render_paper_figures(
        tmp_path, plan, progress=lambda share, message: said.append((share, message))
    )
    assert sorted(path.name[:8] for path in written) == [
        "figure_2",
        "figure_3",
        "figure_5",
        "figure_5",
        "figure_6",
    ]
    assert said[-1][0] <= 1
    for path in written:
        if path.suffix == ".png":
            assert imageio.imread(path).std() > 5
    avatars = imageio.imread(tmp_path / "figure_6_avatars.png")
    # One column of grains, two of avatars, four rows.
    columns = np.array_split(avatars, 3, axis=1)
    assert [bluish(column).sum() > 5000 for column in columns] == [False, True, True]
    for row in np.array_split(columns[1], 4, axis=0):
        assert bluish(row).sum() > 1000
    with (tmp_path / "figure_5_losses.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 8
    for kind in KINDS:
        few, many = (float(row["mean_loss"]) for row in rows if row["kind"] == kind)
        assert many < few
