"""Classes and indices of standards, on grains whose class can be told by eye."""

from __future__ import annotations

import numpy as np
import pytest

from mbstudio.core.errors import MeasureError, UnitError
from mbstudio.core.populations.classes import class_shares, form_indices, uscs_symbol
from tests.core.populations.made import population, spheres


def boxes(*axes):
    """Return boxes of edges c, b, a in mm."""
    c, b, a = np.array(axes, dtype=float).T
    return population(shortest=c, intermediate=b, longest=a, volume=c * b * a)


@pytest.mark.parametrize(
    ("size", "wentworth", "uscs", "iso"),
    [
        (0.1, "very fine sand", "fine sand", "fine sand"),
        (0.2, "fine sand", "fine sand", "medium sand"),
        (0.45, "medium sand", "medium sand", "medium sand"),
        (0.7, "coarse sand", "medium sand", "coarse sand"),
        (1.5, "very coarse sand", "medium sand", "coarse sand"),
        (3.0, "granule", "coarse sand", "fine gravel"),
        (4.75, "pebble", "fine gravel", "fine gravel"),
        (30.0, "pebble", "coarse gravel", "coarse gravel"),
        (100.0, "cobble", "cobbles", "cobble"),
        (0.01, "fine silt", "fines", "medium silt"),
    ],
)
def test_each_size_in_its_class(size, wentworth, uscs, iso):
    for scale, name in (("wentworth", wentworth), ("uscs", uscs), ("iso14688", iso)):
        shares = class_shares(spheres(size), scale)
        assert shares[name] == pytest.approx(100.0)
        assert sum(shares.values()) == pytest.approx(100.0)
    assert class_shares(spheres(1000 * size, unit="um"), "wentworth")[wentworth] == pytest.approx(100.0)


def test_shares_are_of_mass():
    shares = class_shares(spheres(1.5, 3.0), "wentworth")
    assert shares["granule"] == pytest.approx(100 * 8 / 9)


def test_symbols_of_clean_soils_and_none_where_plasticity_decides():
    uniform = spheres(*np.linspace(0.4, 0.5, 50))
    assert uscs_symbol(uniform)[0] == "SP"
    spread = np.exp(np.linspace(np.log(0.1), np.log(4.0), 400))
    sizes = population(
        shortest=spread, intermediate=spread, longest=spread, volume=np.ones(400)
    )  # as much mass at each step of ln d: C_u = exp(0.5 * 3.69) = 6.3, C_c = 0.83 ... by hand below
    d10, d30, d60 = (0.1 * 40 ** (p / 100) for p in (10, 30, 60))
    expected = "SW" if d60 / d10 >= 6 and 1 <= d30**2 / (d10 * d60) <= 3 else "SP"
    assert uscs_symbol(sizes)[0] == expected
    gravel = population(
        **dict.fromkeys(("shortest", "intermediate", "longest"), spread * 20), volume=np.ones(400)
    )
    assert uscs_symbol(gravel)[0][0] == "G"
    symbol, words = uscs_symbol(spheres(*[0.05] * 30, *[0.1] * 10))
    assert symbol == ""
    assert "plasticity" in words


def test_indices_of_bricks_and_needles():
    found = {one.name: one for one in form_indices(boxes((5, 12, 14), (11, 12, 14), (11, 12, 40)))}
    # BS 812: slot 7.2 and gap 21.6 of 10 to 14 mm; EN 933-3: bar sieve 6.3 of 10 to 12.5 mm.
    masses = np.array([5 * 12 * 14, 11 * 12 * 14, 11 * 12 * 40], dtype=float)
    shares = 100 * masses / masses.sum()
    assert found["flakiness_bs812"].percent == pytest.approx(shares[0])
    assert found["elongation_bs812"].percent == pytest.approx(shares[2])
    assert found["flakiness_en933_3"].percent == pytest.approx(shares[0])
    assert found["shape_en933_4"].percent == pytest.approx(shares[2])
    assert found["flat_2_d4791"].percent == pytest.approx(shares[0])
    assert found["elongated_3_d4791"].percent == pytest.approx(shares[2])
    assert found["flat_and_elongated_5_d4791"].percent == 0.0
    assert found["flat_and_elongated_3_d4791"].percent == pytest.approx(shares[2])
    assert found["flakiness_bs812"].bodies == 3
    assert found["flakiness_bs812"].mass_share == 1.0


def test_sizes_that_a_standard_does_not_test_have_no_index():
    for one in form_indices(spheres(0.3, 0.5)):
        assert np.isnan(one.percent)
        assert one.bodies == 0
    # A stone above 50 mm has a flakiness and no elongation by BS 812.
    found = {one.name: one for one in form_indices(spheres(55.0))}
    assert found["flakiness_bs812"].percent == 0.0
    assert np.isnan(found["elongation_bs812"].percent)


def test_bodies_without_size_or_unit_have_no_class():
    with pytest.raises(UnitError, match="no unit"):
        class_shares(spheres(1.0, unit="unitless"), "uscs")
    with pytest.raises(MeasureError, match="no classes"):
        form_indices(spheres(np.nan))
    with pytest.raises(MeasureError, match="not known"):
        class_shares(spheres(1.0), "din")
    assert class_shares(spheres(1.5, np.nan), "wentworth")["very coarse sand"] == pytest.approx(100.0)
