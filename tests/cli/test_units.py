"""Units for people: what tables print of a quantity in SI."""

from __future__ import annotations

import math

import pytest

from cablepod.conventions import digits, direction, printed, printed_unit


@pytest.mark.parametrize(
    ("value", "units", "text"),
    [
        (15000.0, "N", "15 kN"), (-1234.5678, "N", "-1.2346 kN"), (999.0, "N", "999 N"), (1e7, "N", "10 MN"), (0.0, "N", "0 kN"),
        (0.0894764, "m", "89.476 mm"), (53.8516, "m", "53.852 m"), (0.0, "m", "0 m"), (13740.0, "N m", "13.74 kN m"),
        (1.2e8, "Pa", "120 MPa"), (math.pi / 3.0, "rad", "60 degrees"), (math.pi, "rad s-1", "0.5 Hz"),
        (1.0003, "kg m-1", "1.0003 kg/m"),
        (0.0833333, "%", "8.3333 %"), (1.958, "1", "1.958"), (math.nan, "N", "nan kN"), (3.0, "m s-1", "3 m s-1"),
    ],
)  # fmt: skip
def test_a_quantity_is_printed_in_the_unit_of_its_size(value, units, text):
    assert printed(value, units) == text


def test_quantities_beside_each_other_have_the_unit_of_the_largest():
    factor, unit = printed_unit("N", 16911.0)
    assert (factor * 19.0, unit) == (pytest.approx(0.019), "kN")


def test_large_numbers_have_no_exponent():
    assert [digits(123456.7), digits(12345.6, 4), digits(0.00012345678), digits(2e11)] == [
        "123457",
        "12346",
        "0.00012346",
        "2e+11",
    ]


@pytest.mark.parametrize(
    ("x", "z", "text"),
    [(3.0, 0.0, "0 deg"), (0.0, 2.0, "90 deg"), (-1.0, -1e-9, "180 deg"), (1.0, -1.0, "315 deg"), (1.0, -1e-9, "0 deg")],
)  # fmt: skip
def test_a_direction_turns_from_x_towards_z(x, z, text):
    assert direction(x, z) == text
