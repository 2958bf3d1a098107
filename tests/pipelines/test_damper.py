"""The study of a damper on a stay: closed forms against quadrature and exact roots, decays of known signals, the page."""

from __future__ import annotations

import cmath
import math
from pathlib import Path

import numpy as np
import pytest
from damper import run, stay
from scipy.integrate import quad

PAGE = Path(run.__file__).with_name("README.md")


@pytest.mark.parametrize("parameter", [0.1, 2.0, 30.0])
def test_factor_of_the_sag_is_that_of_the_shape(parameter):
    # the symmetric shape of Irvine and Caughey on 0..1: 1 - cos(w (x - 1/2)) / cos(w / 2), whose slope at 0 is -w tan(w / 2)
    root = stay.symmetric_root(parameter, 1)
    half = 0.5 * root
    assert math.tan(half) == pytest.approx(half - 4.0 / parameter * half**3, rel=1e-9)
    mass = quad(lambda x: (1.0 - math.cos(root * (x - 0.5)) / math.cos(half)) ** 2, 0.0, 1.0)[0]
    slope = -root * math.tan(half)
    assert stay.sag_reduction(root, parameter) == pytest.approx(slope**2 / (2.0 * root**2 * mass), rel=1e-8)


def test_closed_form_is_the_string_of_a_damper_close_to_its_end():
    given = stay.taut(40.0 * stay.TENSION)  # hardly any sag
    assert given.sag_parameter < 1e-5
    errors = []
    for place in (0.02, 0.01):
        damper = stay.rule_of_thumb(place, given)
        eta, root = damper / math.sqrt(given.tension * stay.MASS), complex(math.pi)
        for value in np.linspace(0.0, eta, 400)[1:]:
            for _ in range(6):
                one, two = root * place, root * (1.0 - place)
                misfit = cmath.sin(root) + 1j * value * cmath.sin(one) * cmath.sin(two)
                slope = cmath.cos(root) + 1j * value * (
                    place * cmath.cos(one) * cmath.sin(two) + (1.0 - place) * cmath.sin(one) * cmath.cos(two)
                )
                root -= misfit / slope
        exact = root.imag / abs(root)
        errors.append(stay.closed_form(place, damper, given)[0] / exact - 1.0)
    assert abs(errors[0]) < 0.03
    assert errors[0] / errors[1] == pytest.approx(2.0, rel=0.1)  # relative error of first order in the place


def test_swings_of_a_known_decay():
    time = np.arange(0.0, 20.0, 0.02)
    values = np.exp(-0.05 * time) * np.cos(3.0 * time)
    instants, heights = stay.extremes(time, values)
    exact = (np.arange(1, len(instants) + 1) * math.pi - math.atan(0.05 / 3.0)) / 3.0
    # a parabola through three instants of a cosine, 0.06 of a radian apart
    np.testing.assert_allclose(instants, exact, atol=1e-5)
    np.testing.assert_allclose(np.abs(heights), np.exp(-0.05 * exact) * math.cos(math.atan(0.05 / 3.0)), rtol=1e-6)


def test_best_constant_gives_the_outer_modes_the_same_ratio():
    best = stay.best_constant(0.02, stay.MODES)
    found = stay.ratios(0.02, best)
    assert found[0] == pytest.approx(found[-1], rel=1e-3)
    assert found.min() > max(stay.ratios(0.02, factor * best).min() for factor in (0.97, 1.03))
    assert abs(stay.ratios(0.02, best, elements=16) - found).max() < 1e-10


@pytest.mark.slow
def test_the_page_holds_the_numbers():
    result = run.study(quick=True)
    page = PAGE.read_text(encoding="utf-8")
    for table, count in ((run.constants_table(result), 1), (run.sag_table(result), 4)):
        rows = table.splitlines()[2:]
        assert len(rows) == count
        assert [row for row in rows if row not in page] == []
    change = 100.0 * (result.decay_ratio / result.small_ratio - 1.0).values[0].reshape(6, 2)
    assert np.abs(change[:, 0]).max() < 0.1  # decays of small amplitude have the ratio of small vibrations
    assert (change[[0, 3], 1] < -3.0).all()  # weak dampers
    rows = [row for row in page.splitlines() if row.startswith("| 5 |") and row.count("|") == 11]
    written = np.array([[float(cell.strip(" %")) for cell in row.split("|")[1:-1]] for row in rows])
    np.testing.assert_allclose(100.0 * result.small_ratio.values.ravel(), written[:, 3], atol=1e-3)
    np.testing.assert_allclose(change, written[:, [4, 7]], atol=0.05)
