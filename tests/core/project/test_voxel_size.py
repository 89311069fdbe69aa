"""A voxel size that is corrected afterwards: all is as if the scan had been opened with the right one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mbstudio.core.errors import ProjectError, UnitError
from mbstudio.core.grains.labelling import build_grain_set
from mbstudio.core.imaging import fit
from mbstudio.core.metrics import measure
from mbstudio.core.metrics.factor_table import FACTORS
from mbstudio.core.populations.population import Population
from mbstudio.core.project import Project
from mbstudio.core.project.voxel_size import _scaled_population
from mbstudio.core.scan import Scan
from mbstudio.core.units import VoxelSize
from mbstudio.core.vae.generate.generation import Counts, Generation
from mbstudio.core.vae.models.training import learn
from mbstudio.core.vae.shaping.kept_grain import KeptGrain
from mbstudio.core.vae.shaping.latent_recipe import Recipe, style_digest
from tests.core.grains.editing.placed_grains import placed_labels, scan_of
from tests.core.project.conftest import make_fit
from tests.core.vae.models.test_style_learner import SHORT
from tests.core.vae.populations import population

OLD = VoxelSize(2.0, 2.0, 2.0, "um")
ORIGIN = (6.0, 8.0, 10.0)
LABELS = placed_labels()


def project_of(size, origin=ORIGIN):
    voxels = scan_of(LABELS).voxels
    project = Project.new(Scan(voxels, size, origin), embed_scan=True)
    project.change("Find grains", grains=build_grain_set(LABELS, size, origin))
    return project


def the_factors(body):
    found = measure(body)
    return {name: float(getattr(found, name)) for name in FACTORS.core}, found.unit


def origin_of(size):
    return tuple(at / 2.0 * edge for at, edge in zip(ORIGIN, size.xyz, strict=True))


@pytest.fixture(params=["pca", "aligned", "paper"])
def style_of_grains(request, rng):
    """A project whose avatars have a style, with clones and a grain kept of it."""
    bodies = population(24, unit="um")
    project = project_of(OLD)
    rows = pd.concat([project.grains.table.iloc[[0]]] * len(bodies), ignore_index=True)
    rows["label"] = np.arange(1, len(rows) + 1)
    volumes = np.pi / 6 * bodies.diameters**3
    rows["volume"], rows["voxels"] = volumes, volumes / OLD.volume
    project.change("Grains of the parents", grains=replace(project.grains, table=rows))
    made = make_fit(1, 3, rng)
    project.add_fits(
        {
            label: replace(made, avatar=replace(made.avatar, name=name, label=label))
            for label, name in enumerate(bodies.names, 1)
        }
    )
    style = learn(bodies, request.param, **SHORT[request.param])
    latents, counts = style.latents[:4], Counts(4, 4, 0, {}, 0, 0)
    clones = Generation(style.decode(latents), latents, np.arange(4), None, counts, "", 4.0, (), 0)
    recipe = Recipe("kept 1", tuple(style.latents[0]), (), style_digest(style))
    kept = KeptGrain(recipe, (60.0, 1.0, 1.0, 1.0, 1.0), "um")
    project.change("Learn", style=style, clones=clones, kept=(kept,))
    return project, style, clones, kept


edges = st.floats(0.05, 50.0)


@settings(max_examples=12, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    st.one_of(st.tuples(edges).map(lambda e: e * 3), st.tuples(edges, edges, edges)),
    st.sampled_from(["um", "mm", "nm"]),
)
def test_measures_are_those_of_a_project_made_with_the_right_size(lengths, unit):
    size = VoxelSize(*lengths, unit)
    right, corrected = project_of(size, origin_of(size)), project_of(OLD)
    corrected.correct_voxel_size(size)
    assert corrected.state.scan.voxel_size == size
    assert corrected.state.scan.origin == pytest.approx(origin_of(size), rel=1e-12)
    for column in right.grains.table.columns:
        np.testing.assert_allclose(
            corrected.grains.table[column].to_numpy(float), right.grains.table[column].to_numpy(float),
            rtol=1e-9, err_msg=column,
        )  # fmt: skip
    for label in (1, 3):
        mine, my_unit = the_factors(corrected.grains.body(label))
        theirs, their_unit = the_factors(right.grains.body(label))
        assert my_unit == their_unit == unit
        assert mine == pytest.approx(theirs, rel=1e-9)


@pytest.mark.parametrize("size", ["3 um", "0.0025 mm", "1500 nm"])
def test_avatars_are_those_fitted_to_grains_of_the_right_size(size):
    size = VoxelSize.parse(size)
    right, corrected = project_of(size, origin_of(size)), project_of(OLD)
    corrected.add_fits({1: fit(corrected.grains.grain(1), 6)})
    wanted = fit(right.grains.grain(1), 6)
    correction = corrected.correct_voxel_size(size)
    assert correction.factor == pytest.approx(size.x * {"um": 1, "mm": 1e3, "nm": 1e-3}[size.unit] / 2.0)
    assert not correction.notes
    found = corrected.state.fits[1]
    assert found.avatar.unit == size.unit
    mine, theirs = the_factors(found.avatar)[0], the_factors(wanted.avatar)[0]
    assert mine == pytest.approx(theirs, rel=1e-3)
    assert found.verdict.rms == pytest.approx(wanted.verdict.rms, rel=1e-2)
    assert found.rms_history[-1] == pytest.approx(wanted.rms_history[-1], rel=1e-2)
    assert found.avatar.contains(np.array([corrected.grains.grain(1).centroid])).all()


def test_factors_of_avatars_scale_with_their_powers(rng):
    project = project_of(OLD)
    project.add_fits({1: fit(project.grains.grain(1), 4)})
    before = the_factors(project.state.fits[1].avatar)[0]
    project.correct_voxel_size("5 um")
    after = the_factors(project.state.fits[1].avatar)[0]
    for name, value in before.items():
        assert after[name] == pytest.approx(value * 2.5 ** FACTORS[name].power, rel=1e-6), name


def test_it_is_one_step_of_undo_and_stays_in_the_file(tmp_path, rng):
    project = project_of(OLD)
    project.add_fits({2: make_fit(2, 3, rng)})
    before = project.state
    project.correct_voxel_size("4 um")
    after = project.state
    assert project.history.undo_title == "Correct the voxel size to 4 µm"
    project.save(tmp_path / "sand.mbs")
    with Project.open(tmp_path / "sand.mbs") as opened:
        assert opened.state.scan.voxel_size == opened.scan.voxel_size == VoxelSize(4.0, 4.0, 4.0, "um")
        assert opened.scan.origin == pytest.approx((12.0, 16.0, 20.0))
        assert opened.grains.table["volume"].tolist() == after.grains.table["volume"].tolist()
        assert np.array_equal(opened.state.fits[2].avatar.centers, after.fits[2].avatar.centers)
    project.undo()
    assert project.state is before


def test_voxels_of_another_form_leave_no_avatar_behind(rng):
    project = project_of(OLD)
    project.add_fits({2: make_fit(2, 3, rng), 3: make_fit(3, 3, rng)})
    correction = project.correct_voxel_size("4 x 2 x 2 um")
    assert correction.factor is None
    assert not project.state.fits
    assert "2 avatars no longer lie on their grains" in correction.notes[0]


def test_a_style_of_these_grains_is_scaled_with_its_clones_and_another_is_not(style_of_grains):
    project, style, clones, kept = style_of_grains
    before, wanted = clones.avatars(), style.decode(style.latents[:3]).avatars()
    correction = project.correct_voxel_size("5 um")
    assert not correction.notes
    state = project.state
    assert state.style.card.smallest == pytest.approx(2.5 * style.card.smallest)
    assert "All sizes were multiplied by 2.5" in state.style.card.notes[-1]
    assert state.style.encode(state.style.parents) == pytest.approx(style.encode(style.parents), abs=1e-9)
    for mine, old in zip(state.style.decode(style.latents[:3]).avatars(), wanted, strict=True):
        assert mine.centers == pytest.approx(2.5 * old.centers, rel=1e-9, abs=1e-9)
    for mine, old in zip(state.clones.avatars(), before, strict=True):
        assert mine.weights == pytest.approx(2.5**2 * old.weights)
    assert state.kept[0].factors == pytest.approx((2.5 * kept.factors[0], *kept.factors[1:]))
    project.undo()
    foreign = {
        label: replace(made, avatar=replace(made.avatar, name=f"other {label}"))
        for label, made in project.state.fits.items()
    }
    project.change("Rename", fits=foreign)
    assert "was not learned from these grains" in project.correct_voxel_size("5 um").notes[0]
    assert project.state.style is style


def test_factors_of_clones_scale_with_their_powers():
    factors = {name: np.array([2.0, np.nan]) for name in ("dn", "area", "volume", "sphericity")}
    labels, words = np.array([1, 2]), ("", "")
    measured = Population("Clones", "clones", labels, factors, "um", "obb", "avatar", words, words)
    found = _scaled_population(measured, 3.0).factors
    assert [found[name][0] for name in factors] == pytest.approx([6.0, 18.0, 54.0, 2.0])
    assert np.isnan(found["dn"][1])


def test_marks_of_corrected_grains_stay(rng):
    project = project_of(OLD)
    project.add_fits({2: make_fit(2, 3, rng), 3: make_fit(3, 3, rng)})
    project.change("Mark", outdated={3: project.state.fits[3]})
    project.correct_voxel_size("4 um")
    assert project.state.changed_labels == {3}


def test_words_of_a_verdict_follow(rng):
    made = make_fit(2, 3, rng)
    verdict = replace(made.verdict, reasons=("The surface is off by 1.25 um (rms): fit with more.",))
    project = project_of(OLD)
    project.add_fits({2: replace(made, verdict=verdict)})
    project.correct_voxel_size("0.004 mm")
    assert project.state.fits[2].verdict.reasons == ("The surface is off by 0.0025 mm (rms): fit with more.",)


def test_what_cannot_be_is_refused():
    with pytest.raises(ProjectError, match="neither scan nor grains"):
        Project.new().correct_voxel_size("4 um")
    with pytest.raises(ProjectError, match="is 2 µm already"):
        project_of(OLD).correct_voxel_size("2 um")
    with pytest.raises(UnitError):
        project_of(OLD).correct_voxel_size("-2 um")
