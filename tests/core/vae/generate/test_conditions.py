from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.errors import GenerationError
from mbstudio.core.vae.generate.conditions import FactorCurve, FactorMoments, FactorRange, parse_conditions


def one(text: str, unit: str = "mm"):
    (condition,) = parse_conditions([text], unit)
    return condition


def test_ranges_means_and_curves_are_read() -> None:
    assert one("sphericity=0.75..0.8") == FactorRange("sphericity", 0.75, 0.8, "mm")
    assert one("csf = ..0.5") == FactorRange("csf", -np.inf, 0.5, "mm")
    assert one("csf=0.7") == FactorMoments("csf", 0.7, None, "mm")
    assert one("csf=0.7+-0.05") == one("csf=0.7 ± 0.05") == FactorMoments("csf", 0.7, 0.05, "mm")
    assert one("D50=0.4 mm") == FactorCurve("intermediate", (0.4,), (50.0,), "mass", "mm")
    by_number = FactorCurve("sphericity", (0.7, 0.8), (10.0, 60.0), "number", "mm")
    assert one("sphericity=0.7:10,0.8:60") == by_number
    assert len(parse_conditions(["csf=0.7; dn=1..2", "D50=1"], "mm")) == 3


def test_lengths_areas_and_volumes_come_in_the_unit_of_the_parents() -> None:
    assert one("D50=0.4 mm", "um").points == pytest.approx((400.0,))
    assert one("volume=2 mm3", "um").mean == pytest.approx(2e9)
    assert one("area=300..500 um²", "mm").low == pytest.approx(3e-4)
    assert one("dn=0.3..0.5 mm", "um").low == pytest.approx(300.0)
    sieve = one("sieve=0.3:10, 0.4:55, 0.6:100 mm", "um")
    assert sieve.points == pytest.approx((300.0, 400.0, 600.0))
    assert sieve.percents == (10.0, 55.0, 100.0)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("sphericity", "cannot be read"),
        ("angularity=0.5", "not a factor"),
        ("sphericity=0.8..0.7", "empty range"),
        ("sphericity=..", "at least one end"),
        ("sphericity=0.5 mm", "has no unit"),
        ("dn=0.5 furlongs", "not a length unit"),
        ("volume=0.5 mm", "mm³"),
        ("sieve=0.4:50,0.3:60 mm", "rise"),
        ("sieve=0.3:50,0.4:40 mm", "rise"),
        ("sieve=0.3:10:2", "cannot be read"),
        ("csf=many", "cannot be read"),
        ("csf=0.7+-0", "above 0"),
    ],
)
def test_what_cannot_be_read_is_refused_with_its_text(text: str, words: str) -> None:
    with pytest.raises(GenerationError, match=words):
        parse_conditions([text], "mm")


def test_a_curve_by_mass_counts_mass() -> None:
    # Three bodies of volumes 1, 1, 2: half of the mass is finer than 2.
    curve = FactorCurve("intermediate", (2.0,), (50.0,), "mass", "mm")
    sizes, volumes = np.array([1.0, 2.0, 3.0]), np.array([1.0, 1.0, 2.0])
    assert curve.rows(sizes, volumes).sum() == pytest.approx(0)
    (found,) = curve.reached(sizes, volumes)
    assert found.is_met
    assert found.found == pytest.approx(50.0)
    (by_number,) = FactorCurve("intermediate", (2.0,), (40.0,), "number", "mm").reached(sizes, volumes)
    assert not by_number.is_met
    assert by_number.found == pytest.approx(200 / 3)


def test_points_of_all_and_of_nothing_bound_every_body() -> None:
    curve = FactorCurve("intermediate", (1.0, 2.0, 3.0), (0.0, 40.0, 100.0), "mass", "mm")
    assert curve.admits(np.array([0.5, 1.0, 2.0, 3.0, 3.1])).tolist() == [False, False, True, True, False]
