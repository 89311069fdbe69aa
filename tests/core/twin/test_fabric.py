"""Contacts of labels, fabric tensors, and the files of the network."""

from __future__ import annotations

import networkx
import numpy as np
import pandas as pd
import pytest
import pyvista

import mbstudio as mb
from mbstudio.core.errors import ExportError, TwinError
from mbstudio.core.twin.fabric import fabric_tensor, measure_fabric
from mbstudio.core.twin.kept_fits import usual_limits
from mbstudio.core.twin.label_contacts import contacts_of_labels
from mbstudio.core.twin.network_files import write_network


@pytest.fixture(scope="module")
def blocks():
    """Three boxes in a row along x; the second and third touch over 4 x 6 faces, shifted along y."""
    labels = np.zeros((10, 14, 30), np.int32)
    labels[2:8, 2:8, 2:9] = 1
    labels[2:8, 2:8, 9:16] = 2
    labels[2:8, 4:10, 16:23] = 3
    return mb.load_labels(labels, voxel_size="10 x 20 x 20 um")


def test_labels_that_share_faces_are_in_contact(blocks):
    rows = contacts_of_labels(blocks).set_index(["a", "b"])
    assert rows.index.tolist() == [(1, 2), (2, 3)]
    assert rows.loc[(1, 2), ["nx", "ny", "nz"]].tolist() == pytest.approx([1, 0, 0], abs=1e-9)
    assert rows.loc[(1, 2), ["x", "y", "z"]].tolist() == pytest.approx([8.5 * 20, 4.5 * 20, 4.5 * 10])
    assert rows["area"].tolist() == pytest.approx([36 * 200, 24 * 200])
    assert rows.loc[(2, 3), ["branch_x", "branch_y", "branch_z"]].tolist() == pytest.approx([140, 40, 0])


def test_normals_follow_slanted_faces():
    z, y, x = np.mgrid[:24, :24, :24]
    within = ((z - 11.5) ** 2 + (y - 11.5) ** 2 + (x - 11.5) ** 2) < 81
    labels = np.where(within, np.where(x + 2 * y + 2 * z < 5 * 11.5, 1, 2), 0).astype(np.int32)
    (row,) = contacts_of_labels(mb.load_labels(labels, voxel_size="1 um")).to_dict("records")
    assert np.array([row["nx"], row["ny"], row["nz"]]) @ [1 / 3, 2 / 3, 2 / 3] > np.cos(np.radians(2))
    assert row["area"] == pytest.approx(np.pi * 81, rel=0.08)


def test_a_fabric_tensor_tells_how_much_and_where_directions_gather():
    rng = np.random.default_rng(0)
    even = fabric_tensor(rng.normal(size=(4000, 3)))
    assert np.trace(even.tensor) == pytest.approx(1)
    assert even.anisotropy < 0.2
    along = fabric_tensor(rng.normal(size=(400, 3)) * [1, 1, 3])
    assert abs(along.directions[0][2]) > 0.99
    low, high = along.anisotropy_interval
    assert low < along.anisotropy < high
    # All along one direction: D = 15/2 diag(2/3, -1/3, -1/3).
    assert fabric_tensor(np.array([[2.0, 0, 0], [-1, 0, 0]])).anisotropy == pytest.approx(7.5)


def test_coordination_counts_probable_contacts_of_whole_grains(blocks):
    table = contacts_of_labels(blocks)
    found = measure_fabric(table, [1, 2, 3], frozenset({3}))
    assert found.coordination == {1: 1, 2: 2, 3: 1}
    assert found.mean_coordination == 1.5
    less = measure_fabric(table.assign(probability=[0.9, 0.2]), [1, 2, 3])
    assert less.coordination == {1: 1, 2: 1, 3: 0}
    with pytest.raises(TwinError, match="no contact"):
        measure_fabric(table.assign(probability=0.1), [1, 2, 3])


def test_the_network_can_be_read_back(blocks, tmp_path):
    table = contacts_of_labels(blocks).assign(gap=[0.5, -0.25])
    rows = blocks.table
    middles = dict(zip(rows["label"].tolist(), rows[["x", "y", "z"]].to_numpy(float), strict=True))
    graph = networkx.read_graphml(write_network(tmp_path / "n.graphml", table, middles, "um"), node_type=int)
    assert sorted(graph.edges) == [(1, 2), (2, 3)]
    assert graph.edges[2, 3]["gap"] == -0.25
    assert graph.nodes[1]["x"] == pytest.approx(middles[1][0])
    mesh = pyvista.read(write_network(tmp_path / "n.vtu", table, middles, "um"))
    assert (mesh.n_points, mesh.n_cells) == (3, 2)
    assert mesh.cell_data["gap"].tolist() == [0.5, -0.25]
    assert mesh.point_data["coordination"].tolist() == [1, 2, 1]
    assert mesh.cell_data["normal"].shape == (2, 3)
    assert "gap_deviation" not in mesh.cell_data  # labels tell none
    empty = pyvista.read(write_network(tmp_path / "e.vtu", table[:0], middles, "um"))
    assert (empty.n_points, empty.n_cells) == (3, 0)
    with pytest.raises(ExportError, match="graphml"):
        write_network(tmp_path / "n.txt", table, middles, "um")


def test_a_twin_gives_fabric_and_fits(phantom):
    found = mb.twin(phantom.scan, phantom.grains, n=12, sweeps=2, workers=0)
    fabric = found.fabric()
    assert fabric.coordination == {1: 1, 2: 1, 3: 0}
    assert abs(fabric.normal.directions[0][0]) > 0.99
    fits = found.fits(phantom.grains)
    assert sorted(fits) == [1, 2, 3]
    assert {fit.fitted_to for fit in fits.values()} == {"grey values"}
    assert all(fit.verdict.valid and fit.n == 12 for fit in fits.values())
    assert isinstance(found.contacts, pd.DataFrame)
    assert found.middles()[3] == pytest.approx(
        np.asarray(phantom.scan.origin) + 20 * np.array([16.1, 27.4, 12.7]), abs=2
    )


def test_grains_that_stand_out_from_the_others_are_told():
    even = pd.DataFrame({"peak": [0.4, 0.45, 0.5], "moved": [0.04, 0.05, 0.06]})
    assert usual_limits(even).tolist() == pytest.approx([0.9, 0.15])
    clean = pd.DataFrame({"peak": [0.02, 0.03, 0.04], "moved": [0.001, 0.002, 0.003]})
    assert usual_limits(clean).tolist() == pytest.approx([0.12, 0.05])
