from __future__ import annotations

import numpy as np
import trimesh

from mbstudio.scene.figures.side_by_side import side_by_side_figure
from mbstudio.scene.pictures.mesh_thumbnails import mesh_thumbnail


def ball(level: int = 3) -> tuple[np.ndarray, np.ndarray]:
    mesh = trimesh.creation.icosphere(subdivisions=level)
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


def test_a_ball_is_drawn_round_and_lit_from_above():
    picture = mesh_thumbnail(*ball(), "#ffffff", 80, 1.0)
    cover = picture[..., 3] / 255
    assert abs(cover.sum() / (np.pi * (40 / 1.12) ** 2) - 1) < 0.02
    rows, columns = np.nonzero(cover > 0.5)
    assert abs(rows.mean() - 39.5) < 0.5
    assert abs(columns.mean() - 39.5) < 0.5
    grey = picture[..., 0].astype(float)
    assert grey[15:30, 30:50].mean() > 1.5 * grey[52:66, 30:50].mean()
    # Facets do not show: corners share their normals.
    assert np.abs(np.diff(grey[30:50, 30:50], axis=0)).max() < 12


def test_what_lies_in_front_hides_what_lies_behind():
    vertices, faces = ball(2)
    both = np.concatenate([vertices, 0.5 * vertices]), np.concatenate([faces, faces + len(vertices)])
    assert (
        mesh_thumbnail(*both, "#ffffff", 40, 1.0) == mesh_thumbnail(vertices, faces, "#ffffff", 40, 1.0)
    ).all()


def test_sixteen_stand_beside_sixteen_of_one_size():
    vertices, faces = ball(2)
    large, small = [(100.0 * vertices + 7.0, faces)] * 20, [(vertices, faces)] * 3
    figure = side_by_side_figure(large, small, seed=1)
    pictures = [np.asarray(axes.images[0].get_array()) for axes in figure.axes]
    assert len(pictures) == 16 + 3
    covers = [picture[..., 3].sum() for picture in pictures]
    assert max(covers) < 1.02 * min(covers)
    again = side_by_side_figure(large, small, seed=1)
    assert all(
        (np.asarray(one.images[0].get_array()) == np.asarray(other.images[0].get_array())).all()
        for one, other in zip(figure.axes, again.axes, strict=True)
    )
