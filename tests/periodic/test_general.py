"""Order "exact" and damping by the tension and by ratios: where the model settles, decay of small vibrations."""

from __future__ import annotations

import copy

import numpy as np
import pytest
from periodic_scenes import GUY, guy, loaded, mathieu, multipliers, tension_damped
from suite import slow

import cablepod as cp


@pytest.mark.filterwarnings("ignore::cablepod.NotConvergedWarning")
@pytest.mark.parametrize("kind", ["exact", "tension", "ratio", slow("exact, tension")])
def test_the_model_settles_on_the_orbit(kind):
    omega, order = 6.2, "exact" if "exact" in kind else "leading"
    scene = guy(angular_frequency=omega, damping=0.5, amplitude=0.02)
    if "tension" in kind:
        scene = tension_damped(5e-3, omega, 0.02, 0.5)
    elif kind == "ratio":
        scene = scene.drop_vars("damping_mass_proportional").assign(damping_ratio=((), 0.05, {"units": "1"}))
    modes = cp.condensed.vibration_modes(scene, rank=2)
    orbit = cp.periodic.orbit(scene, modes, order=order, outputs=("tension",))
    assert orbit.stable
    assert orbit.attrs["order"] == order
    scene = scene.assign(time_duration=2.0 * np.pi / omega)  # the constants of a period
    first = round(np.ceil(2.0 * np.log(1e6) / 0.5 / (2.0 * np.pi / omega)))
    times = 2.0 * np.pi / omega * (first + np.arange(32) / 32)
    runs = [
        cp.condensed.simulate(
            scene, modes, order=order, times=times, step=2.0 * np.pi / omega / steps, outputs=("tension",),
            scheme="velocity_verlet",
        )
        for steps in (128, 256)
    ]  # fmt: skip
    for name in ("amplitude", "tension"):
        coarse, fine = (run[name].values for run in runs)
        settled, found = fine + (fine - coarse) / 3.0, orbit[name].values[:-1:4]  # order two
        assert np.abs(found - settled).max() < 1e-4 * np.ptp(settled, axis=0).max()


def test_small_vibrations_have_the_damping_ratio_of_the_tension():
    beta = 2e-3
    mapping = copy.deepcopy(GUY)
    mapping["gravity"] = 0.0
    mapping["cable"]["density"] = mapping["cable"].pop("specific_weight") / 9.81
    mapping["damping"] = {"tension_proportional": beta}
    mapping["motion"]["upper"]["x"] |= {"amplitude": 1e-9, "angular_frequency": 5.0}
    scene = cp.make_scene(mapping)
    modes = cp.condensed.vibration_modes(scene, rank=3)
    mu = multipliers(cp.periodic.orbit(scene, modes, outputs=()))
    decay = np.sort(-np.log(np.abs(mu)) / (2.0 * np.pi / 5.0))
    omega = modes.angular_frequency.values
    # a taut string: zeta = beta omega / 2, in the plane and out of it; the tension varies by 1e-7
    assert decay == pytest.approx(np.repeat(0.5 * beta * omega**2, 4), rel=1e-6)


@pytest.mark.parametrize("order", ["leading", "exact"])
def test_the_tension_damps_nothing_where_the_cable_is_slack(order):
    epsilon, omega, beta = 1.5, 12.0, 5e-3
    scene = mathieu(epsilon, omega).drop_vars("damping_mass_proportional", errors="ignore")
    scene = scene.assign(damping_tension_proportional=((), beta, {"units": "s"}))
    modes = cp.condensed.vibration_modes(scene, rank=1)
    with pytest.warns(cp.OutOfRangeWarning, match="slack"):
        orbit = cp.periodic.orbit(scene, modes, order=order, out_of_plane=False, outputs=())
    # a straight string: y'' + beta omega_1^2 max(1 + epsilon sin, 0) y' + ... = 0; both multipliers decay by its integral
    slack_from = np.arcsin(1.0 / epsilon)
    integral = (np.pi + 2.0 * slack_from + 2.0 * epsilon * np.cos(slack_from)) / omega
    expected = -beta * float(modes.angular_frequency[0]) ** 2 * integral
    # inertia along the string changes the tension by a few thousandths; without the end of the damping it is 8 % less
    assert np.log(np.abs(multipliers(orbit)).prod()) == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("order", ["leading", "exact"])
@pytest.mark.parametrize("dims", [2, 3])
def test_small_vibrations_have_the_damping_ratios(order, dims):
    mapping = copy.deepcopy(GUY)
    mapping["damping"] = {"ratios": [0.01, 0.05, 0.02]}
    mapping["motion"]["upper"]["x"] |= {"amplitude": 1e-9, "angular_frequency": 5.0}
    if dims == 3:
        mapping["ends"] = {name: [*place, 0.0] for name, place in mapping["ends"].items()}
    scene = cp.make_scene(mapping)
    modes = cp.condensed.vibration_modes(scene, rank=3)
    orbit = cp.periodic.orbit(scene, modes, order=order, outputs=())
    rates = np.log(multipliers(orbit)) * 5.0 / (2.0 * np.pi)  # of the imaginary part up to multiples of 5 rad/s
    found = {}
    for which, suffix in (("in_plane", ""), ("out_of_plane", "_out_of_plane" if dims == 3 else "")):
        of_set = rates[orbit.multiplier_set.values == which]
        for omega in modes[f"angular_frequency{suffix}"].values:
            near = of_set.imag + 5.0 * np.rint((omega - of_set.imag) / 5.0)
            k = np.abs(near - omega).argmin()
            found[which if dims == 2 else "", near[k]] = -of_set.real[k] / np.hypot(of_set.real[k], near[k])
    # by rising frequency, of each deflection of a planar scene for itself; the last holds for all others
    expected = [0.01, 0.05, 0.02] * 2 if dims == 2 else [0.01, 0.05, 0.02, 0.02, 0.02, 0.02]
    # the modes do not hold the sag, which order "exact" has to all powers
    allowed = 1e-6 if order == "leading" else 0.02
    assert [found[key] for key in sorted(found)] == pytest.approx(expected, rel=allowed)


def test_branches_of_order_exact_are_near_those_of_order_leading():
    scene = loaded(0.6, 7.0, 0.05)
    modes = cp.condensed.vibration_modes(scene, rank=1)
    found = [
        cp.periodic.frequency_response(
            scene, modes, frequency=(6.5, 11.0), order=order, follow=(), out_of_plane=False, outputs=()
        )
        for order in ("leading", "exact")
    ]
    leading, exact = (part.bifurcation_angular_frequency.values for part in found)
    assert leading.size == exact.size > 0
    # a string without sag: terms of second order in slopes of some per cent
    assert exact == pytest.approx(leading, rel=2e-3)
    assert not np.allclose(exact, leading, rtol=1e-9)
