"""Batches from inside: variables computed on reading, threads, the order of attributes, coefficients scaled to other members."""

from __future__ import annotations

import copy

import numpy as np
import pytest
import xarray as xr
from scenes import everything, full_modes

import cablepod as cp
from cablepod.batch import _computed as computed
from cablepod.batch import _members as members
from cablepod.batch._stack import MemberResults
from cablepod.condensed._assembly import unit_of
from cablepod.condensed._model import CondensedModel
from cablepod.condensed._rescale import rescaled_model
from cablepod.parameters._from_scene import parameters

# --- variables computed on reading -------------------------------------------------------------------------------------

SHAPE = (7, 5, 2)
VALUES = np.arange(70.0).reshape(SHAPE)


class Rows:
    """Rows of known values; counts those that are asked for."""

    def __init__(self):
        self.asked = 0

    def __call__(self, first, last):
        self.asked += last - first
        return VALUES[first:last].copy()


def variable():
    rows = Rows()
    return xr.Variable(*computed.computed_variable(("member", "time", "end"), SHAPE, rows)), rows


@pytest.mark.parametrize("block", [1, 3, 100])
@pytest.mark.parametrize(
    "key",
    [
        {},
        {"member": 2},
        {"member": -1, "time": 3},
        {"member": slice(1, 6)},
        {"member": slice(1, 6, 2), "time": slice(None, None, -1)},
        {"member": slice(None, None, -1)},
        {"member": slice(4, 4), "end": 1},
        {"member": [5, 0, 2], "time": [1, 1]},
        {"member": np.arange(7) > 3},
        {"member": xr.Variable("point", [6, 1]), "time": xr.Variable("point", [0, 4])},
    ],
    ids=str,
)
def test_elements_equal_those_of_an_array(monkeypatch, block, key):
    monkeypatch.setattr(computed, "BLOCK", block)
    truth = xr.Variable(("member", "time", "end"), VALUES)
    xr.testing.assert_identical(variable()[0].isel(key).load(), truth.isel(key))


def test_rows_are_computed_once_and_only_those_that_are_read():
    values, rows = variable()
    assert values.shape == SHAPE
    assert values.nbytes == VALUES.nbytes
    assert rows.asked == 0
    values.isel(member=slice(None, None, 3)).load()
    assert rows.asked == 3
    values.load()
    values.load()
    assert rows.asked == 3 + 7


# --- members ----------------------------------------------------------------------------------------------------------


def test_any_number_of_threads_gives_the_same_bits(soft):
    scenes = cp.ensemble.design(cp.make_scene(soft), {"cable.top_tension": [200.0, 300.0, 7]})
    runs = []
    for count in (1, 2, 5):
        with members.thread_limit(count):
            runs.append(cp.chain.simulate(scenes, step=1e-3))
    xr.testing.assert_identical(runs[0], runs[1])
    xr.testing.assert_identical(runs[0], runs[2])
    assert [run.attrs["id"] for run in runs[1:]] == [runs[0].attrs["id"]] * 2


def other(soft, dims):
    """A scene of the same kind in which every number differs."""
    first = everything(soft, dims)
    second = copy.deepcopy(first)
    second["cable"] |= {"youngs_modulus": 7e7, "area": 1.3e-3, "density": 800.0, "top_tension": 450.0}
    second["ends"]["upper"] = [value + 0.7 for value in second["ends"]["upper"]]
    second["damping"]["mass_proportional"] = 0.3
    second["load"]["uniform"] = [1.5 * value for value in second["load"]["uniform"]]
    second["point_load"][0]["force"] = [2.0 * value for value in second["point_load"][0]["force"]]
    second["motion"]["lower"]["y"]["amplitude"] = 0.01
    return first, second


@pytest.mark.parametrize("order", ["leading", "inertial"])
@pytest.mark.parametrize("dims", [2, 3])
def test_coefficients_scaled_from_the_unit_cable_are_the_scenes_own(soft, dims, order):
    modes = full_modes(dims=dims)
    p, q = (parameters(cp.make_scene(item)) for item in other(soft, dims))
    scaled = rescaled_model(unit_of(p, modes, rank=3, order=order, law="linear"), q)
    own = CondensedModel(scaled.chain, order, scaled.modes)  # its coefficients are computed from the modes
    names = (
        "mass", "shapes", "slopes", "load_patterns", "chordwise_force_patterns", "mean_chordwise_forces",
        "chordwise_forces_at_candidates", "geometric_stiffness", "geometric_stiffness_norms", "load_projection", "inertia",
    )  # fmt: skip
    # they differ by the rounding of some ten operations
    for name in names:
        expected = getattr(own, name)
        atol = 1e-13 * np.abs(expected).max(initial=0.0)
        np.testing.assert_allclose(getattr(scaled, name), expected, rtol=1e-12, atol=atol, err_msg=name)
    (one, *_), squared = scaled.spectral_basis
    (other_one, *_), other_squared = own.spectral_basis
    np.testing.assert_allclose(squared, other_squared, rtol=1e-12)
    np.testing.assert_allclose(one, other_one, rtol=1e-12, atol=1e-12 * np.abs(other_one).max())
    np.testing.assert_allclose(scaled.initial()[0], own.initial()[0], rtol=1e-11, atol=1e-12)


def test_attributes_are_in_the_order_of_the_members_whichever_ends_first():
    results = MemberResults(3)
    for i, names in ((2, ("a", "c")), (0, ("a", "b", "c")), (1, ("d", "a"))):
        results.store(i, {}, dict.fromkeys(names, float(i)))
    assert results.attribute_names == ["a", "b", "c", "d"]
    assert list(results.attrs) != results.attribute_names  # as they came
