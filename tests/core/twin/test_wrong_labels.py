"""Labels that are wrong are told by the twin, with what to do about them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import mbstudio as mb
from mbstudio.core.grains.suspicion.suspects import Suspect
from mbstudio.core.twin.wrong_labels import more_suspicious, suspects_of_twin
from tests.core.project.test_twin_table import made_twin


def with_rows(twin, **columns):
    return replace(twin, residuals=twin.residuals.assign(**columns))


def test_a_buried_grain_is_to_be_merged_with_the_one_that_it_touches_most():
    twin = made_twin((1, 2, 3))
    assert suspects_of_twin(twin) == {}
    contacts = twin.contacts.assign(area=[30.0, 90.0])
    found = suspects_of_twin(with_rows(replace(twin, contacts=contacts), buried=[0.0, 0.4, 0.0]))
    (one,) = found.values()
    assert (one.label, one.kind, one.neighbour) == (2, "split", 3)
    assert one.is_suspicious
    assert "40 % of the surface" in one.reasons


def test_a_grain_that_the_scan_differs_from_is_to_be_split():
    found = suspects_of_twin(with_rows(made_twin((1, 2, 3)), peak=[0.05, 0.06, 0.5]))
    (one,) = found.values()
    assert (one.label, one.kind, one.neighbour) == (3, "merged", 0)
    # Where all grains are rough, none stands out.
    assert suspects_of_twin(with_rows(made_twin((1, 2, 3)), peak=[0.4, 0.45, 0.5])) == {}


def test_a_surface_that_moves_is_doubtful_and_no_more():
    found = suspects_of_twin(with_rows(made_twin((1, 2, 3, 4)), moved=[0.01, 0.02, 5.0, np.inf]))
    assert {label: one.score for label, one in found.items()} == {3: 0.45, 4: 0.45}


def test_grains_that_lie_in_each_other_are_to_be_merged():
    twin = made_twin((1, 2, 3))
    deep = replace(twin, contacts=twin.contacts.assign(gap=[-0.2 * twin.voxel, -1.5 * twin.voxel]))
    found = suspects_of_twin(deep)
    assert {(one.label, one.kind, one.neighbour) for one in found.values()} == {
        (2, "split", 3),
        (3, "split", 2),
    }


def test_of_two_verdicts_the_worse_counts():
    one, other = Suspect(1, 0.4, "merged", 0, "a"), Suspect(1, 0.6, "split", 2, "b")
    assert more_suspicious(one, other) is other
    assert more_suspicious(other, one) is other
    assert more_suspicious(one, None) is one


@pytest.mark.parametrize("way", ["merged", "split"])
def test_wrong_labels_of_a_scan_are_found(phantom, way):
    labels = phantom.labels.copy()
    if way == "merged":
        labels[labels == 2] = 1
        labels[labels == 3] = 2
    else:
        z, _, _ = np.indices(labels.shape)
        labels[(labels == 3) & (z > 12)] = 4
    grains = mb.load_labels(labels.astype(np.int32), phantom.scan)
    suspects = suspects_of_twin(mb.twin(phantom.scan, grains, n=12, sweeps=3, workers=0).kept())
    if way == "merged":
        assert {label for label, one in suspects.items() if one.kind == "merged"} == {1}
    else:
        assert {(label, one.neighbour) for label, one in suspects.items()} == {(3, 4), (4, 3)}
