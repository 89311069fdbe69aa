"""Numbers as people read them: four digits, in little room."""

from __future__ import annotations

import math

import pytest

from mbstudio.ui.widgets.numbers import four_digits

SHOWN = {
    0.8: "0.8000",
    0.0: "0.000",
    7162.3: "7162",
    9999.6: "10,000",
    47404.0: "47,400",
    -47404.0: "-47,400",
    4.7e8: "4.70e8",
    0.00123456: "0.001235",
    0.00081234: "8.12e-4",
}


@pytest.mark.parametrize(("value", "text"), SHOWN.items())
def test_four_digits_say_the_number(value, text):
    assert four_digits(value) == text
    assert float(text.replace(",", "")) == pytest.approx(value, rel=5e-3)


def test_what_is_no_number_is_a_dash():
    assert four_digits(math.nan) == four_digits(math.inf) == "–"


@pytest.mark.parametrize("exponent", range(-9, 12))
def test_numbers_take_little_room(exponent):
    assert len(four_digits(1.23456 * 10.0**exponent)) <= 9
