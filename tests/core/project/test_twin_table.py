"""A twin in a project: saved and read, undone, gone when its grains change, scaled with the voxel size."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from types import MappingProxyType

import h5py
import numpy as np
import pandas as pd
import pytest

from mbstudio.core.errors import ProjectError, TwinError
from mbstudio.core.grains.editing.records import Exclude, Merge
from mbstudio.core.metaball.avatar import Avatar
from mbstudio.core.project import Project, ProjectState
from mbstudio.core.project.file import read_project, write_project
from mbstudio.core.project.merging import merge_states
from mbstudio.core.sealing import seal_image
from mbstudio.core.twin.contacts import COLUMNS
from mbstudio.core.twin.kept_twin import KeptTwin
from mbstudio.core.twin.porosity import Porosity
from tests.core.project.test_voxel_size import OLD, project_of


def made_twin(labels=(1, 2), unit="um") -> KeptTwin:
    """A twin of balls in a row, each touching the next."""
    avatars = {
        label: Avatar(np.array([[20.0 * place, 3.0, 5.0]]), np.array([100.0]), unit, label, f"grain {label}")
        for place, label in enumerate(labels)
    }
    rest = (1.0, 0.0, 0.0, 0.2, 0.9, 0.7, 30.0, "point", 20.0, 0.0, 0.0, False)
    rows = [(a, b, 20.0 * place + 10, 3.0, 5.0, *rest) for place, (a, b) in enumerate(pairwise(labels))]
    contacts = pd.DataFrame(rows, columns=list(COLUMNS))
    columns = ("n", "rms", "peak", "buried", "moved", "converged", "shift", "touches_border", "note")
    values = (1, 0.03, 0.08, 0.0, 0.01, True, 0.2, False, "")
    rows = [{"label": label} | dict(zip(columns, values, strict=True)) for label in labels]
    residuals = pd.DataFrame(rows)
    porosity = Porosity(0.4, np.full(4, 0.4), np.array([0.3, np.nan]), np.full(3, 0.4))
    return KeptTwin(
        MappingProxyType(avatars), contacts, residuals, unit, 10.0, 7.5, 0.03, "linear", "quadratic",
        (0.08, 0.05, 0.04), porosity, ("Look.",), 3,
    )  # fmt: skip


def same(one: KeptTwin, other: KeptTwin) -> bool:
    pd.testing.assert_frame_equal(one.contacts, other.contacts)
    pd.testing.assert_frame_equal(one.residuals, other.residuals)
    for label, avatar in one.avatars.items():
        assert (avatar.control == other.avatars[label].control).all()
        assert (avatar.name, avatar.unit) == (other.avatars[label].name, other.avatars[label].unit)
    for before, after in zip(one.porosity, other.porosity, strict=True):
        np.testing.assert_array_equal(before, after)
    names = ("unit", "voxel", "blur", "noise", "tone_model", "void_model", "misfits", "notes", "seed")
    return all(getattr(one, name) == getattr(other, name) for name in names)


def test_a_twin_comes_back(tmp_path):
    twin = made_twin()
    write_project(tmp_path / "a.mbs", ProjectState(twin=twin))
    assert same(twin, read_project(tmp_path / "a.mbs").twin)
    with h5py.File(tmp_path / "a.mbs") as file:
        assert file.attrs["schema"] == 10


def _put(name, value):
    def change(twin: h5py.Group) -> None:
        if name in twin:
            del twin[name]
        twin[name] = value

    return change


@pytest.mark.parametrize(
    "damage",
    [
        _put("label", np.array([1, 1])),
        _put("offsets", np.array([0, 2, 1])),
        _put("weights", np.array([1.0, np.nan])),
        _put("contacts/a", np.array([7])),
        _put("contacts/gap", np.array([0.1, 0.2])),
        _put("contacts/probability", np.array([1.5])),
        _put("residuals/label", np.array([1, 3])),
        _put("misfits", np.array(["x"], dtype=object)),
        lambda twin: twin.attrs.modify("blur", -1.0),
        lambda twin: twin.attrs.modify("porosity", 2.0),
        lambda twin: twin.attrs.modify("tone_model", "cubic"),
        lambda twin: twin.__delitem__("along_y"),
    ],
)
def test_a_damaged_twin_is_refused(tmp_path, damage):
    path = tmp_path / "a.mbs"
    write_project(path, ProjectState(twin=made_twin()))
    with h5py.File(path, "r+") as file:
        damage(file["twin"])
    image = bytearray(path.read_bytes())
    seal_image(memoryview(image))
    path.write_bytes(image)
    with pytest.raises(ProjectError, match=r"damaged"):
        read_project(path)


def test_the_contacts_go_with_the_grains_that_they_are_of():
    project = project_of(OLD)
    labels = project.grains.table["label"].tolist()
    twin = made_twin(labels)
    project.change("Fit the twin", twin=twin)
    project.edit_grains(Exclude(labels=(labels[0],)))
    assert project.state.twin is twin
    project.edit_grains(Merge(labels=(labels[0], labels[1])))
    assert project.state.twin is None
    project.undo()
    assert project.state.twin is twin


def test_other_grains_and_another_scan_take_the_twin_away():
    project = project_of(OLD)
    twin = made_twin(project.grains.table["label"].tolist())
    project.change("Fit the twin", twin=twin)
    project.use_grains(replace(project.grains), None)
    assert project.state.twin is twin  # the same voxels under the same numbers
    fewer = replace(project.grains, table=project.grains.table.iloc[:1].reset_index(drop=True))
    project.use_grains(fewer, None)
    assert project.state.twin is None


def test_lengths_follow_the_voxel_size():
    project = project_of(OLD)
    project.change("Fit the twin", twin=made_twin(project.grains.table["label"].tolist()))
    before = project.state.twin
    factor = 2.0
    z, y, x = project.grains.voxel_size.zyx
    unit = project.grains.voxel_size.unit
    project.correct_voxel_size(f"{factor * z} x {factor * y} x {factor * x} {unit}")
    after = project.state.twin
    assert after.contacts["gap"].tolist() == pytest.approx((factor * before.contacts["gap"]).tolist())
    assert after.contacts["area"].tolist() == pytest.approx((factor**2 * before.contacts["area"]).tolist())
    assert after.blur == factor * before.blur
    label = next(iter(after.avatars))
    assert after.middles[label] == pytest.approx(factor * before.middles[label], abs=1e-6)
    project.correct_voxel_size(f"{3 * z} x {factor * y} x {factor * x} {unit}")
    assert project.state.twin is None


def test_the_twin_of_who_changed_it_stays_in_a_merge():
    begun = ProjectState()
    ours, theirs = replace(begun, twin=made_twin()), replace(begun)
    assert merge_states(begun, ours, theirs).state.twin is ours.twin
    assert merge_states(begun, begun, ours).state.twin is ours.twin


def test_a_project_keeps_it_through_a_save(tmp_path):
    project = Project(ProjectState())
    project.add_fits({}, "Fit the twin", made_twin())
    project.save(tmp_path / "a.mbs")
    assert same(project.state.twin, Project.open(tmp_path / "a.mbs").state.twin)


def test_tables_that_do_not_belong_together_are_refused():
    twin = made_twin()
    with pytest.raises(TwinError, match="no column gap"):
        replace(twin, contacts=twin.contacts.drop(columns="gap"))
    with pytest.raises(TwinError, match="residuals"):
        replace(twin, residuals=twin.residuals.iloc[:1])
