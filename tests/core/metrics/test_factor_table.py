"""The table of shape factors: complete, true to the records, and open to one more entry."""

from __future__ import annotations

import re
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
import trimesh

import mbstudio
from mbstudio.core import formulas
from mbstudio.core.errors import MeasureError
from mbstudio.core.grains import Grain
from mbstudio.core.imaging.goals.fit_goal import list_measures
from mbstudio.core.metrics import FACTORS, Factor, factor_intervals, measure, measure_detail
from mbstudio.core.metrics.factor_table import AXES, LATENT_MEANINGS
from mbstudio.core.metrics.measuring import AxisConvention
from mbstudio.core.metrics.star_factors import STAR_FACTORS
from mbstudio.core.populations import measure_population
from mbstudio.core.vae.generate.candidates import examine_all
from mbstudio.core.vae.generate.conditions import parse_conditions
from mbstudio.core.vae.shaping.meaning_factors import MEANINGS
from tests.core.vae.boxes import boxes

DOCUMENT = Path(mbstudio.__file__).parents[1] / "docs" / "shape-factors.md"
SURFACE = Factor(
    name="specific_surface", title="Specific surface", symbol="S_V", formula="A / V", power=-1, quick=True,
    meaning="Surface area over volume", derive=lambda area, volume: area / volume,
)  # fmt: skip
SLACK = Factor(
    name="slack", title="Slack", meaning="Enclosing over nominal diameter", measured="detail",
    derive=lambda enclosing, dn: enclosing / dn,
)  # fmt: skip


def box(*edges: float) -> trimesh.Trimesh:
    return trimesh.creation.box(edges)


def test_the_document_describes_every_factor_of_the_table():
    text = DOCUMENT.read_text(encoding="utf-8")
    named = set(re.findall(r"`(\w+)`", text))
    assert {*FACTORS.core, *FACTORS.detail} <= named
    assert FACTORS.bands == tuple(f"band_{band}" for band in range(1, 13))


def test_what_is_stored_agrees_with_the_functions_of_the_table():
    body = box(1, 2, 3)
    core, detail = measure(body), measure_detail(body)
    known = vars(detail) | vars(core)
    for name, factor in FACTORS.items():
        if factor.derive is not None and name in known:
            found = factor.derive(*(known[argument] for argument in factor.arguments))
            assert known[name] == pytest.approx(found, rel=1e-15), name
    assert core.krumbein == formulas.krumbein_sphericity(*core.lengths)
    assert core.elongation == core.intermediate / core.longest


def test_ratios_are_bounded_and_the_conventions_known():
    body = box(1, 2, 3)
    values = measure(body).as_dict() | measure_detail(body).as_dict()
    for name, factor in FACTORS.items():
        if name in values:
            assert values[name] <= factor.highest * (1 + 1e-9), name
        assert (factor.highest < np.inf) <= (factor.power == 0), name
    assert set(AXES) == set(get_args(AxisConvention))
    by_convention = {name for name, factor in FACTORS.items() if factor.axes == "chosen"}
    odd = trimesh.convex.convex_hull(np.random.default_rng(3).normal(size=(20, 3)) * (1, 2, 3))
    by_box, by_inertia = (measure(odd, axes=axes).as_dict() for axes in ("obb", "inertia"))
    assert {name for name in FACTORS.core if by_box[name] != by_inertia[name]} == by_convention


def test_rays_and_meanings_are_of_the_table():
    assert set(STAR_FACTORS) <= set(FACTORS.quick)
    assert tuple(LATENT_MEANINGS) == MEANINGS
    assert {meaning.factor for meaning in LATENT_MEANINGS.values()} <= set(FACTORS)


def test_one_entry_is_measured_like_any_other():
    body = box(1, 2, 3)
    with FACTORS.extended(SURFACE, SLACK):
        found = measure(body, unit="mm")
        assert found.specific_surface == found.as_dict()["specific_surface"] == pytest.approx(22 / 6)
        assert measure(body, unit="mm").as_dict()["krumbein"] == found.krumbein
        alone, processes = (
            measure_population([body, body], unit="mm", detail=True, workers=workers) for workers in (0, 2)
        )
        for population in (alone, processes):
            assert population.column("specific_surface") == pytest.approx([22 / 6] * 2)
            assert population.column("slack") == pytest.approx([np.sqrt(14) / found.dn] * 2)
        assert alone.in_unit("cm").column("specific_surface") == pytest.approx([220 / 6] * 2)
        assert {"specific_surface_per_mm", "slack"} <= set(alone.table().columns)
        assert FACTORS["specific_surface"].heading("um") == "Specific surface S_V (µm⁻¹)"
        assert "specific_surface" in list_measures()
        (condition,) = parse_conditions(["specific_surface=3..4"], "mm")
        assert condition.factor == "specific_surface"
    assert "specific_surface" not in FACTORS
    assert "specific_surface" not in measure(body).as_dict()
    with pytest.raises(AttributeError, match="specific_surface"):
        _ = found.specific_surface


def test_one_entry_has_intervals_and_is_found_quickly():
    z, y, x = np.mgrid[:16, :16, :16] - 7.5
    grain = Grain.from_mask(x**2 + y**2 + 1.4 * z**2 < 36, "1 mm")
    parents = boxes(3, np.random.default_rng(0))
    with FACTORS.extended(SURFACE):
        found = factor_intervals(grain, axes="inertia")
        low, high = found.intervals["specific_surface"]
        assert low <= found.factors.area / found.factors.volume <= high
        quick = examine_all(parents, np.empty((3, 0)), np.empty((3, 0)))
        area, volume = quick.column("area"), quick.column("volume")
        np.testing.assert_array_equal(quick.column("specific_surface"), area / volume)


@pytest.mark.parametrize(
    ("factor", "says"),
    [
        (Factor(name="csf", title="", meaning=""), "already"),
        (Factor(name="a b", title="", meaning=""), "cannot name"),
        (Factor(name="new", title="", meaning="", derive=lambda colour: colour), "which is not a factor"),
        (Factor(name="new", title="", meaning="", derive=lambda roundness: roundness), "measured='detail'"),
        (
            Factor(name="new", title="", meaning="", derive=lambda krumbein: 1 - krumbein, quick=True),
            None,
        ),
        (
            Factor(
                name="new", title="", meaning="", derive=lambda potticary_flatness: potticary_flatness,
                quick=True,
            ),
            "not a quick factor",
        ),
    ],
)  # fmt: skip
def test_an_entry_that_cannot_be_is_refused(factor, says):
    if says is None:
        with FACTORS.extended(factor):
            assert FACTORS.quick[-1] == factor.name
        return
    before = dict(FACTORS)
    with pytest.raises(MeasureError, match=says):
        FACTORS.add(factor)
    assert dict(FACTORS) == before


def test_where_a_factor_is_not_defined_it_is_no_number():
    strange = Factor(name="strange", title="", meaning="", derive=lambda volume: volume / 0.0)
    with FACTORS.extended(strange):
        assert np.isnan(measure(box(1, 2, 3)).strange)
        assert np.isnan(measure_population([box(1, 2, 3)], workers=0).column("strange")).all()
    assert np.isnan(FACTORS.value("roundness", {"volume": 1.0}))


def test_the_entry_in_the_document_works():
    text = DOCUMENT.read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?FACTORS\.add.*?)```", text, re.DOTALL)
    before = dict(FACTORS)
    with FACTORS.extended():
        exec(compile(code, str(DOCUMENT), "exec"), {})
        (name,) = set(FACTORS) - set(before)
        assert np.isfinite(measure(box(1, 2, 3)).as_dict()[name])
    assert dict(FACTORS) == before
