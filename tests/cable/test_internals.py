"""The cable from inside: quadrature, mesh, bound of the frequencies, numbers of elements that are tried, text of a run."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from scenes import scene_with
from wind_scenes import GUY, WIND

import cablepod as cp
from cablepod.cable import _scheme as cable_scheme
from cablepod.cable._equilibrium import solve_equilibrium
from cablepod.cable._frequencies import vibrations
from cablepod.cable._mesh import mesh_of
from cablepod.cable._start import catenary_nodes
from cablepod.cli import _report
from cablepod.discretisation import _gll as gll
from cablepod.parameters._from_scene import parameters

# --- elements ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("order", [1, 2, 3, 7, 8, 16])
def test_quadrature_and_derivative_are_exact_for_polynomials(order):
    node, weight, d = gll.gll_rule(order)
    for power in range(2 * order):
        exact = 2.0 / (power + 1) if power % 2 == 0 else 0.0
        assert weight @ node**power == pytest.approx(exact, abs=1e-14)  # sums of numbers of size 1
        if power <= order:
            slope = power * node ** max(power - 1, 0)
            # the entries of d grow with the square of the order: rounding times 16^2 times a few
            assert np.allclose(d @ node**power, slope, atol=1e-12)
    place = np.linspace(-1.0, 1.0, 9)
    assert np.allclose(gll.lagrange_basis(order, place) @ node**order, place**order, atol=1e-14)


def test_point_loads_stand_between_elements(soft):
    soft["point_load"] = [{"arc_length": 0.1, "force": [0.0, -1.0]}, {"arc_length": 0.73, "force": [0.0, -2.0]}]
    mesh = mesh_of(parameters(scene_with(soft)), 7)
    border = mesh.arc_length[:: mesh.order] / mesh.total_length
    assert np.abs(border[:, None] - [0.1, 0.73]).min(axis=0) == pytest.approx([0.0, 0.0], abs=1e-14)
    loads = mesh.loads() - mesh.tributary_length[:, None] * parameters(scene_with(soft)).weight
    assert sorted(loads[:, 1])[:2] == pytest.approx([-2.0, -1.0], rel=1e-14)
    assert mesh.sizes.size == 7
    assert mesh.sizes.sum() == pytest.approx(mesh.total_length, rel=1e-14)
    with pytest.raises(cp.SceneError, match=r"elements: given 2; allowed: at least 3"):
        mesh_of(parameters(scene_with(soft)), 2)


@pytest.mark.parametrize("law", ["linear", "green"])
def test_bound_of_the_frequencies_holds_and_is_sharp_along_the_cable(law):
    # a straight cable without weight, and a stiff spring along it, which has the highest vibration
    cable = {"youngs_modulus": 2e7, "area": 1e-3, "density": 1000.0, "unstretched_length": 10.02}
    tables = {"cable": cable, "segment": [{"to": 0.45}, {"youngs_modulus": 6e7, "density": 2500.0}]}
    ends = {"lower": [0.0, 0.0], "upper": [10.1, 0.0]}
    spring = {"arc_length": 0.2, "spring": 5e7, "direction": [1.0, 0.0]}
    attached = [spring, {"arc_length": 0.7, "mass": 3.0}]
    scene = cp.make_scene({**tables, "ends": ends, "gravity": 0.0, "attachment": attached})
    mesh = mesh_of(parameters(scene), 5, law=law)
    position = solve_equilibrium(mesh, catenary_nodes(mesh))
    bound = mesh.highest_frequency(mesh.tangent_stiffness_ratio(position))
    highest = vibrations(mesh, 2 * (mesh.links - 1))[0][-1]
    assert highest == pytest.approx(bound, rel=1e-9)
    without = mesh_of(
        parameters(cp.make_scene({**tables, "ends": ends, "gravity": 0.0, "attachment": attached[1:]})), 5
    )
    assert bound > 1.01 * without.highest_frequency()


# --- numbers of elements ----------------------------------------------------------------------------------------------


def test_a_cable_that_goes_slack_is_warned_of(soft, monkeypatch):
    # its upper end is pushed in faster than the strain at rest can follow
    push = {"upper": {"x": {"kind": "ramp", "amplitude": -0.1, "duration": 0.05}}}
    scene = scene_with(soft, motion=push, time={"duration": 0.2, "interval": 0.01})
    monkeypatch.setattr(cable_scheme, "ELEMENT_COUNTS", (4, 8, 12))
    with pytest.warns(cp.NotConvergedWarning, match=r"not converged in space: .* with 12 elements, .* goes slack"):
        run = cp.cable.simulate(scene, law="linear", scheme="velocity_verlet", tolerance=1e-2)
    assert run.attrs["space_error_estimate"] > 1e-2


def test_more_point_loads_than_the_largest_number_of_elements(soft, monkeypatch):
    monkeypatch.setattr(cable_scheme, "ELEMENT_COUNTS", (2, 4))
    loads = [{"arc_length": place / 6, "force": [0.0, -1.0]} for place in range(1, 6)]
    scene = scene_with(soft, point_load=loads, time={"duration": 0.5, "interval": 0.5})
    assert cp.cable.rest(scene).attrs["elements"] >= 6
    own, finer = (cp.cable.frequencies(scene, count=2, **options) for options in ({}, {"elements": 18}))
    np.testing.assert_allclose(own.angular_frequency, finer.angular_frequency, rtol=1e-8)
    run = cp.cable.simulate(scene, scheme="trapezoidal", tolerance=1e-3)
    assert run.attrs["elements"] == 12
    assert run.attrs["space_error_estimate"] <= 1e-3


def test_elements_are_compared_with_clearly_more_elements():
    # one element more, of fifteen between point loads, would leave most of the error in both runs
    for least in range(1, 200):
        counts = cable_scheme.element_counts(least)
        assert counts[0] >= least
        assert counts[-1] >= cable_scheme.MIN_REFINEMENT * least
    assert cable_scheme.element_counts(60) == [80, 128]
    assert cable_scheme.element_counts(141) == [141, 282]


# --- text -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("ramp", [0.0, 3.0])
def test_a_run_names_the_air_of_its_rest(ramp):
    scene = cp.make_scene({**GUY, "wind": {**WIND, "ramp": ramp}, "time": {"duration": 0.2, "interval": 0.1}})
    run = cp.chain.simulate(
        scene, step=1e-3, scheme="trapezoidal", outputs=("position", "tension_extremes", "tension_peaks")
    )
    results = {"summary": cp.summary(scene), "chain_rest": cp.chain.rest(scene), "chain": run}
    study = xr.DataTree.from_dict(results)
    text = _report.answers_text(study)
    windy, still = (float(results["summary"][f"tension_upper_{ending}"]) for ending in ("mean_wind", "still_air"))
    rest, air, other = (
        (still, "still air, from which the wind rises", f"in the mean wind: {1e-3 * windy:.5g} kN at the upper end")
        if ramp
        else (
            windy,
            "mean wind of 25 m/s at 10 m above the ground",
            f"in still air: {1e-3 * still:.5g} kN at the upper end",
        )
    )
    assert f"{1e-3 * rest:.5g} kN at the upper\n" in text
    # 20 links are not the catenary in still air: the difference in the same air is theirs, 0.1 % at most
    assert f"continuous cable in {air}; the chain of 20 links differs by 0.0" in text
    assert other in text
    found = _report.answers(study)
    assert (found["air"], found["tension_upper"]) == (air, rest)
    assert {"tension_upper_still_air", "frequency_in_plane_mean_wind"} <= set(found)
