from __future__ import annotations

import csv
import json
import shutil

import numpy as np
import pytest
from scipy import ndimage

from mbstudio.core.grains import load_labels
from mbstudio.core.imaging import fit
from mbstudio.core.project import Project
from mbstudio.core.scan import Scan
from mbstudio.core.units import VoxelSize


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    """Two ellipsoids that touch, and their avatars."""
    bodies = ((np.array([9.3, 12.2, 12.4]), [7.0, 6.0, 6.5]), (np.array([23.3, 12.2, 12.4]), [7.0, 6.6, 5.6]))
    z, y, x = np.mgrid[:26, :26, :36]
    shares = [
        np.clip(0.5 - 6 * (np.sqrt((((np.stack((x, y, z), -1) - m) / a) ** 2).sum(-1)) - 1), 0, 1)
        for m, a in bodies
    ]
    image = 1000 + 1000 * ndimage.gaussian_filter(shares[0] + shares[1], 0.6)
    image += 20 * np.random.default_rng(3).standard_normal(image.shape)
    scan = Scan(image.astype(np.float32), VoxelSize.parse("20 um"))
    path = tmp_path_factory.mktemp("twin") / "sand.mbs"
    with Project.new(scan, embed_scan=True) as project:
        labels = np.where(shares[0] > 0.5, 1, np.where(shares[1] > 0.5, 2, 0)).astype(np.int32)
        grains = load_labels(labels, scan)
        project.change("Load labels", grains=grains)
        project.add_fits({grain.label: fit(grain, 12) for grain in grains})
        project.save(path)
    return path


@pytest.fixture
def project(fitted, tmp_path):
    return shutil.copy(fitted, tmp_path / "sand.mbs")


def test_a_twin_is_kept_in_the_project_with_its_contacts_beside(mbstudio, project, tmp_path):
    with Project.open(project) as before:
        labels, avatars = sorted(before.fits), {label: fit.avatar for label, fit in before.fits.items()}
    network = tmp_path / "sand.vtu"
    ran = mbstudio("twin", project, "-n", 12, "--sweeps", 2, "--workers", 0, "--network", network, "--json")
    assert ran.code == 0, ran.err
    told = json.loads(ran.out)
    assert told["misfit_percent"] < told["misfit_before_percent"]
    with Project.open(project) as after:
        fits = {label: after.fits[label] for label in labels}
        assert {fit.fitted_to for fit in fits.values()} == {"grey values"}
        assert any((fits[label].avatar.control != avatars[label].control).any() for label in labels)
        assert after.state.log[-1] == "Fit the twin"
    with (tmp_path / "sand-contacts.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert sum(float(row["probability"]) >= 0.5 for row in rows) == told["contacts"]
    # All that has a unit says so.
    bare = {"a", "b", "nx", "ny", "nz", "probability", "kind", "touches_border"}
    assert {name for name in rows[0] if "[" not in name} == bare
    assert {"gap [um]", "branch_x [um]", "area [um^2]"} <= set(rows[0])
    assert network.stat().st_size > 1000
    # To fit again asks for nothing: the twin's avatars stand.
    assert mbstudio("fit", project, "-n", 12, "--workers", 0, "--json").code == 0
    with Project.open(project) as after:
        assert {after.fits[label].fitted_to for label in labels} == {"grey values"}


def test_contacts_of_labels_fit_nothing(mbstudio, project, tmp_path):
    table = tmp_path / "touching.csv"
    ran = mbstudio("twin", project, "--labels", "--contacts", table)
    assert ran.code == 0, ran.err
    assert "mean coordination" in ran.out
    with table.open() as stream:
        assert len(list(csv.DictReader(stream))) > 0
    with Project.open(project) as after:
        assert {fit.fitted_to for fit in after.fits.values()} == {"labels"}


def test_what_cannot_be_is_refused_first(mbstudio, project, small_scan_file, tmp_path):
    ran = mbstudio("twin", small_scan_file)
    assert ran.code == 1
    assert "no project" in ran.err
    ran = mbstudio("twin", project, "--network", tmp_path / "network.xyz")
    assert ran.code == 1
    assert "graphml" in ran.err
    ran = mbstudio("twin", project, "--contacts", tmp_path / "none" / "c.csv")
    assert ran.code == 1
    assert "does not exist" in ran.err
