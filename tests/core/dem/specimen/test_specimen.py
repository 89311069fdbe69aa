"""Specimens: the sieve curve by hand, places, shares, and the decks that pour them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mbstudio.core.dem import SpecimenPlan, export, target_curve, validate
from mbstudio.core.dem.body import prepare_bodies
from mbstudio.core.dem.specimen.placing import lattice, random_quaternions, scattered
from mbstudio.core.dem.specimen.specimen import SpecimenKinds, draw_sizes, in_classes, make_specimen
from mbstudio.core.dem.specimen.specimen_files import describe_specimen
from mbstudio.core.errors import ExportError
from mbstudio.core.metaball import Avatar
from mbstudio.core.metrics.measuring import measure
from mbstudio.core.packing.contacts import SIDE
from mbstudio.core.packing.reading import read_packing
from mbstudio.core.populations.sieving import SizeDistribution
from tests.core.dem.corruption import assert_refused
from tests.core.dem.formats.test_lammps import run_deck as run_lammps
from tests.core.dem.formats.test_lammps import table_of, thermo_rows
from tests.core.dem.formats.test_liggghts import logged_templates
from tests.core.dem.formats.test_liggghts import run_deck as run_liggghts
from tests.core.dem.formats.test_liggghts import thermo_rows as liggghts_rows

CURVE = target_curve([0.5, 1.0, 2.0, 3.0], [0, 30, 80, 100], "mm")


def finer_of(curve: SizeDistribution, size: float) -> float:
    """Percent finer on a curve that is linear in the logarithm of the size."""
    return float(np.interp(np.log(size), np.log(curve.sizes), curve.finer))


def test_sizes_of_one_segment_by_hand():
    """Mass even in ln d from 1 to 2: numbers go with d**-3, so the median by number has d**-3 = 9 / 16."""
    curve = target_curve([1.0, 2.0], [0, 100], "mm")
    sizes = draw_sizes(curve, 20001, np.random.default_rng(0))
    assert (np.diff(sizes) > 0).all()
    assert sizes.min() >= 1
    assert sizes.max() <= 2
    assert np.median(sizes) == pytest.approx((16 / 9) ** (1 / 3), rel=1e-3)
    # Half the mass lies below the geometric mean.
    assert (sizes[sizes < np.sqrt(2)] ** 3).sum() / (sizes**3).sum() == pytest.approx(0.5, abs=1e-3)


def test_a_gap_in_the_curve_stays_empty():
    sizes = draw_sizes(target_curve([1, 2, 3, 4], [0, 50, 50, 100], "mm"), 500, np.random.default_rng(1))
    assert not ((sizes > 2) & (sizes < 3)).any()
    assert ((sizes[sizes < 2.5] ** 3).sum() / (sizes**3).sum()) == pytest.approx(0.5, abs=0.02)


@pytest.fixture(scope="module")
def bodies(avatars):
    return prepare_bodies(avatars, ["a", "b", "c"], "mm", 2650)


def test_without_a_curve_no_avatar_is_scaled(bodies):
    specimen = make_specimen(bodies, SpecimenPlan(30, seed=3), "mm")
    assert (specimen.scales == 1).all()
    assert np.bincount(specimen.kinds).tolist() == [10, 10, 10]
    own = np.array([measure(body.avatar).intermediate for body in bodies])
    assert specimen.sizes == pytest.approx(own[specimen.kinds])
    wide = make_specimen(bodies, SpecimenPlan(30, seed=3, width=0.05, width_unit="m"), "mm")
    assert wide.half == pytest.approx(25)
    assert describe_specimen(specimen, SpecimenPlan(30, seed=3))["wanted"] is None
    assert describe_specimen(specimen, SpecimenPlan(30, seed=3))["scales"] == [1.0, 1.0]


def test_the_avatars_own_curve_has_the_points_that_it_needs():
    rng = np.random.default_rng(8)
    sizes = np.exp(rng.normal(0, 0.4, 500))
    axes = np.column_stack([1.3 * sizes, sizes, 0.7 * sizes])
    kinds = SpecimenKinds.from_factors([f"a{i}" for i in range(500)], axes, sizes**3, "mm")
    curve = kinds.curve()
    assert 8 < len(curve.sizes) < 120
    assert (np.diff(curve.sizes) > 0).all()
    assert curve.finer[[0, -1]].tolist() == [0, 100]
    assert curve.sizes[-1] == sizes.max()
    order = np.argsort(sizes)
    finer = 100 * np.cumsum(sizes[order] ** 3) / (sizes**3).sum()
    told = np.interp(np.log(sizes[order]), np.log(curve.sizes), curve.finer)
    assert np.abs(told - finer).max() <= 0.25
    for percent in (10, 50, 60):
        true = np.exp(np.interp(percent, finer, np.log(sizes[order])))
        assert curve.diameter(percent) == pytest.approx(true, rel=0.01)
    # It is a curve that a specimen can be scaled to.
    target_curve(curve.sizes, curve.finer, curve.unit)


def test_avatars_of_one_size_have_a_steep_curve():
    one = SpecimenKinds.from_factors(["a", "b"], np.full((2, 3), 2.0), np.ones(2), "mm").curve()
    assert one.finer.tolist() == [0, 100]
    assert one.sizes == pytest.approx([1.96, 2.0])


@pytest.mark.parametrize("count", [200, 2000])
def test_the_sieve_curve_of_a_specimen_meets_the_target(count, bodies):
    specimen = make_specimen(bodies, SpecimenPlan(count, CURVE, seed=3), "mm")
    found = specimen.curve()
    masses = specimen.volumes[specimen.kinds] * specimen.scales**3
    # One particle a stratum: off by about the largest particle, and by the shapes' different volumes.
    allowed = 100 * 2 * masses.max() / masses.sum() + 1.0
    for size, finer in zip(found.sizes, found.finer, strict=True):
        assert finer == pytest.approx(finer_of(CURVE, size), abs=allowed)
    assert found.d50 == pytest.approx(CURVE.d50, rel=0.08 if count == 200 else 0.02)
    assert found.cu == pytest.approx(CURVE.cu, rel=0.1 if count == 200 else 0.03)


def test_the_size_is_the_intermediate_axis():
    """Two control points on x: longest along x, the other two axes alike: 2 sqrt(sum k / (a^2 + r^2) = 1)."""
    a = 0.5
    pair = Avatar([[-a, 0, 0], [a, 0, 0]], [1.0, 1.0], "mm", name="pair")
    (body,) = prepare_bodies([pair], ["pair"], "mm", None)
    plan = SpecimenPlan(50, target_curve([1.0, 1.0001], [0, 100], "mm"))
    specimen = make_specimen([body], plan, "mm")
    assert specimen.scales == pytest.approx(1 / (2 * np.sqrt(2 - a**2)), rel=1e-3)


def test_particles_neither_touch_nor_leave_the_box(bodies):
    specimen = make_specimen(bodies, SpecimenPlan(300, CURVE, seed=1), "mm")
    radii = specimen.reaches[specimen.kinds] * specimen.scales
    apart = np.linalg.norm(specimen.positions[:, None] - specimen.positions[None], axis=2)
    apart[np.diag_indices(300)] = np.inf
    assert (apart > radii[:, None] + radii[None]).all()
    assert (np.abs(specimen.positions[:, :2]) + radii[:, None] <= specimen.half).all()
    assert (specimen.positions[:, 2] >= radii).all()
    assert (specimen.positions[:, 2] + radii <= specimen.top).all()


def test_shares_are_met_and_do_not_go_with_size(bodies):
    plan = SpecimenPlan(400, CURVE, seed=2, shares={"a": 1, "c": 3})
    specimen = make_specimen(bodies, plan, "mm")
    assert np.bincount(specimen.kinds, minlength=3).tolist() == [100, 0, 300]
    order = np.argsort(specimen.sizes)
    for quarter in np.array_split(specimen.kinds[order], 4):
        assert np.count_nonzero(quarter == 0) == pytest.approx(25, abs=3)


def test_the_seed_decides(bodies):
    first, again, other = (make_specimen(bodies, SpecimenPlan(40, CURVE, seed=s), "mm") for s in (5, 5, 6))
    assert np.array_equal(first.positions, again.positions)
    assert np.array_equal(first.quaternions, again.quaternions)
    assert np.array_equal(first.sizes, again.sizes)
    assert not np.array_equal(first.sizes, other.sizes)


def test_units_change_only_the_numbers(avatars):
    first, second = (
        make_specimen(prepare_bodies(avatars, ["a", "b", "c"], unit, 2650), SpecimenPlan(30, CURVE), unit)
        for unit in ("mm", "um")
    )
    assert second.sizes == pytest.approx(1000 * first.sizes)
    assert second.scales == pytest.approx(first.scales, rel=1e-6)
    assert second.positions == pytest.approx(1000 * first.positions, rel=1e-6, abs=1e-3)


def test_orientations_are_uniform():
    """The mean of a turned vector is zero, and that of its square components a third, for any start."""
    turns = random_quaternions(20000, np.random.default_rng(0))
    turned = Rotation.from_quat(turns[:, [1, 2, 3, 0]]).apply([0.6, 0, 0.8])
    assert turned.mean(axis=0) == pytest.approx([0, 0, 0], abs=0.02)
    assert (turned**2).mean(axis=0) == pytest.approx([1 / 3] * 3, abs=0.01)


def test_classes_keep_the_mass(bodies):
    specimen = make_specimen(bodies, SpecimenPlan(100, CURVE), "mm")
    rounded = in_classes(specimen, 4)
    assert len({(kind, scale) for kind, scale in zip(rounded.kinds, rounded.scales, strict=True)}) == 12

    def mass(one):
        return (one.volumes[one.kinds] * one.scales**3).sum()

    assert mass(rounded) / mass(specimen) == pytest.approx(1, rel=1e-12)


def test_a_lattice_keeps_spheres_apart_and_inside():
    places = lattice(30, 3.0, 1.1, 1.0)
    apart = np.linalg.norm(places[:, None] - places[None], axis=2)[np.triu_indices(30, 1)]
    assert apart.min() >= 2
    assert np.abs(places[:, :2]).max() <= 2


def test_where_there_is_no_room_the_box_grows():
    radii = np.full(60, 1.0)
    places, top = scattered(radii, 1.5, 0.0, 0.9, np.random.default_rng(0))
    apart = np.linalg.norm(places[:, None] - places[None], axis=2)[np.triu_indices(60, 1)]
    assert apart.min() > 2
    assert places[:, 2].max() + 1 <= top
    assert top > 60 * 4 / 3 * np.pi / 0.9 / 9


@pytest.mark.parametrize(
    ("sizes", "finer", "message"),
    [
        ([1], [100], "at least two"),
        ([1, 2], [0, 50, 100], "at least two"),
        ([1, np.nan], [0, 100], "at least two"),
        ([2, 1], [0, 100], "rise"),
        ([0, 1], [0, 100], "positive"),
        ([1, 2, 3], [0, 60, 50], "not fall"),
        ([1, 2], [10, 100], "from 10 to 100"),
        ([1, 2], [0, 99], "from 0 to 99"),
    ],
)
def test_what_is_no_curve_is_refused(sizes, finer, message):
    with pytest.raises(ExportError, match=message):
        target_curve(sizes, finer, "mm")


def test_impossible_plans_are_refused(bodies):
    with pytest.raises(ExportError, match="at least 1"):
        SpecimenPlan(0, CURVE)
    with pytest.raises(ExportError, match="must be positive, not -1"):
        SpecimenPlan(1, CURVE, width=-1)
    with pytest.raises(ExportError, match="no room for the largest"):
        make_specimen(bodies, SpecimenPlan(10, CURVE, width=1.0), "mm")
    with pytest.raises(ExportError, match="no avatar 'd'"):
        make_specimen(bodies, SpecimenPlan(10, CURVE, shares={"d": 1}), "mm")
    with pytest.raises(ExportError, match="positive numbers"):
        make_specimen(bodies, SpecimenPlan(10, CURVE, shares={"a": -1}), "mm")


def test_a_box_is_as_wide_as_its_grains_lie_high(bodies):
    specimen = make_specimen(bodies, SpecimenPlan(300), "mm")
    solid = (specimen.volumes[specimen.kinds] * specimen.scales**3).sum()
    height = solid / (1 - 0.43) / (2 * specimen.half) ** 2
    assert height / (2 * specimen.half) == pytest.approx(1, rel=1e-6)
    assert specimen.top > height


def test_a_periodic_specimen_has_no_side_walls_and_comes_back(avatars, lammps, tmp_path):
    plan = SpecimenPlan(30, seed=2, width=4.5, width_unit="mm", periodic=True)
    report = export(avatars, "lammps", tmp_path / "out", density=2650, spheres=5, specimen=plan)
    assert report.manifest["specimen"]["box"]["periodic"]
    log = run_lammps(lammps, tmp_path / "out", "in.specimen")
    assert "SETTLED 30 grains" in log
    rows = thermo_rows(log)
    assert (rows[:, 1] == 30 * 5).all()
    back = read_packing(tmp_path / "out" / "specimen_settled.lammpstrj", avatars)
    assert back.mould.periodic
    assert back.mould.half == pytest.approx(2.25e-3)
    assert (back.found_contacts.pairs[:, 1] != SIDE).all()
    # Some grain stands across a side: with walls there its spheres would lie in them.
    reach = np.abs(back.poses.positions[:, :2]).max() + back.kinds.reaches.min()
    assert reach > back.mould.half
    with pytest.raises(ExportError, match="has walls"):
        export(avatars, "liggghts", tmp_path / "other", density=2650, spheres=5, specimen=plan)


PLAN = SpecimenPlan(24, target_curve([1.5, 2, 3], [0, 40, 100], "mm"), seed=4)


@pytest.fixture(scope="module")
def for_lammps(avatars, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("specimen") / "lammps"
    export(avatars, "lammps", folder, density=2650, spheres=5, specimen=PLAN)
    return folder


@pytest.fixture(scope="module")
def for_liggghts(avatars, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("specimen") / "liggghts"
    export(avatars, "liggghts", folder, density=2650, unit="mm", spheres=5, classes=3, specimen=PLAN)
    return folder


def test_lammps_gives_every_body_its_mass_and_moments(lammps, for_lammps, tmp_path):
    """Each turned tensor comes back with the moments of its grain, so its order is the engine's."""
    (deck,) = re.findall(r"(?s)^(.*)compute translation", (for_lammps / "in.specimen").read_text())
    for name in ("specimen.data", "specimen.bodies"):
        (tmp_path / name).write_text((for_lammps / name).read_text())
    (tmp_path / "in.look").write_text(
        deck
        + "compute local all rigid/local bodies mol mass inertiax inertiay inertiaz x y z\n"
        + "dump local all local 1 bodies.* c_local[*]\ndump_modify local format float %.12g\n"
        + "thermo_style custom step atoms\nrun 0\n"
    )
    run_lammps(lammps, tmp_path, "in.look")
    rows = table_of(next(tmp_path.glob("bodies.*")))
    rows = rows[np.argsort(rows[:, 0])]
    manifest = validate(for_lammps)
    items = {item["name"]: item for item in manifest["items"]}
    lines = (for_lammps / "specimen.csv").read_text().splitlines()[1:]
    assert len(rows) == len(lines) == 24
    for row, line in zip(rows, lines, strict=True):
        name, *numbers = line.split(",")
        scale, _, *place = (float(number) for number in numbers[:5])
        assert row[1] / (items[name]["mass"] * scale**3) == pytest.approx(1, rel=1e-5)
        moments = np.array(items[name]["moments"]) * scale**5
        assert np.sort(row[2:5]) / moments == pytest.approx(1, rel=1e-5)
        assert row[5:8] == pytest.approx(place, abs=1e-9)


def test_lammps_settles_the_specimen(lammps, for_lammps):
    rows = thermo_rows(run_lammps(lammps, for_lammps, "in.specimen"))
    energy = rows[:, 2] + rows[:, 3]
    assert (rows[:, 1] == 24 * 5).all()
    assert energy[-1] < 0.02 * energy.max()


def test_liggghts_settles_the_specimen_in_its_numbers(liggghts, for_liggghts):
    log = run_liggghts(liggghts, for_liggghts, "in.specimen")
    inserted = [int(number) for number in re.findall(r"inserted (\d+) particle templates", log)]
    assert sum(inserted) == 24
    items = validate(for_liggghts)["items"]
    deck = (for_liggghts / "in.specimen").read_text()
    files = re.findall(r"spheres file (\S+)\.multisphere scale (\S+)", deck)
    templates = logged_templates(log)
    assert len(files) == len(templates) == 9
    for (name, scale), (mass, moments) in zip(files, templates, strict=True):
        (item,) = (item for item in items if item["name"] == name)
        factor = float(scale) / 1e-3  # the spheres are in mm
        assert mass / (item["mass"] * factor**3) == pytest.approx(1, rel=1e-4)
        assert moments / (np.array(item["moments"]) * factor**5) == pytest.approx(1, rel=1e-4)
    rows = liggghts_rows(log)
    energy = rows[:, 2] + rows[:, 3]
    assert rows[-1, 1] == 24 * 5
    assert energy[-1] < 0.02 * energy.max()


def row_of(change):
    """Change the first particle's row."""

    def edit(text: str) -> str:
        head, row, *rest = text.split("\n")
        return "\n".join([head, change(row.split(",")), *rest])

    return edit


TABLE = {
    "header": (lambda t: t.partition("\n")[2], "instead of"),
    "a particle lost": (lambda t: re.sub(r"\n.*\n", "\n", t, count=1), "does not hold the particles"),
    "another avatar": (row_of(lambda c: ",".join(["nobody", *c[1:]])), "does not hold the particles"),
    "negative scale": (row_of(lambda c: ",".join([c[0], "-" + c[1], *c[2:]])), "not positive"),
    "another scale": (row_of(lambda c: ",".join([c[0], "1.5", *c[2:]])), "volume differs"),
    "outside": (row_of(lambda c: ",".join([*c[:3], "1", *c[4:]])), "outside the box"),
    "no rotation": (row_of(lambda c: ",".join([*c[:6], "2", *c[7:]])), "not of length 1"),
    "text": (row_of(lambda c: ",".join([*c[:3], "x", *c[4:]])), "not nine numbers"),
}


@pytest.mark.parametrize("kind", TABLE)
def test_a_corrupted_table_of_particles_is_refused(kind, for_lammps):
    assert_refused(for_lammps, "specimen.csv", *TABLE[kind])


LAMMPS = {
    "count of bodies": ("specimen.bodies", lambda t: t.replace("24\n", "23\n", 1), "does not number"),
    "a body lost": ("specimen.bodies", lambda t: t.rstrip().rpartition("\n")[0], "does not number"),
    "negative mass": ("specimen.bodies", lambda t: t.replace("\n1 ", "\n1 -", 1), "not positive"),
    "impossible tensor": (
        "specimen.bodies",
        lambda t: re.sub(r"\n1 (\S+ \S+ \S+ \S+) \S+", r"\n1 \1 1", t),
        "no solid body|not a positive",
    ),
    "a column lost": ("specimen.bodies", lambda t: t.replace(" 0\n", "\n", 1), "numbers"),
    "a sphere lost": ("specimen.data", lambda t: re.sub(r"\n1 1 .*\n", "\n", t, count=1), "spheres of the"),
    "negative diameter": ("specimen.data", lambda t: t.replace("\n1 1 ", "\n1 1 -", 1), "not positive"),
    "a body without spheres": (
        "specimen.data",
        lambda t: re.sub(r"\n(\d+) 24(?=\n)", r"\n\1 23", t),
        "without",
    ),
    "no molecules": ("specimen.data", lambda t: t.partition("\nMolecules")[0], "must have the sections"),
}


@pytest.mark.parametrize("kind", LAMMPS)
def test_corrupted_bodies_of_a_specimen_are_refused(kind, for_lammps):
    name, change, message = LAMMPS[kind]
    assert_refused(for_lammps, name, change, message)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: re.sub(r"particles_in_region \d+", "particles_in_region 99", t, count=1), "counts"),
        (lambda t: re.sub(r"mass \S+ inertia", "mass 1 inertia", t, count=1), "mass that differs"),
    ],
)
def test_a_corrupted_deck_of_a_specimen_is_refused(change, message, for_liggghts):
    assert_refused(for_liggghts, "in.specimen", change, message)


def test_a_manifest_that_lacks_the_specimens_numbers_is_refused(for_lammps):
    path = for_lammps / "manifest.json"
    text = path.read_text()
    try:
        path.write_text(text.replace('"solid_volume"', '"volume_of_solids"'))
        with pytest.raises(ExportError, match="entry 'solid_volume'"):
            validate(for_lammps, digests=False)
    finally:
        path.write_text(text)


def test_any_target_gets_the_table(avatars, tmp_path):
    report = export(avatars, "edem", tmp_path / "out", unit="mm", spheres=4, specimen=PLAN)
    assert report.manifest["specimen"]["count"] == 24
    assert report.manifest["specimen"]["numbers"] == {"grain_1": 8, "grain_2": 8, "grain_3": 8}
    assert len((tmp_path / "out" / "specimen.csv").read_text().splitlines()) == 25
