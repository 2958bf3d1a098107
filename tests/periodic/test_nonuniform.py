"""Periodic responses of cables with segments and attachments: closed forms of strings, runs in time, chains."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
import xarray as xr
from periodic_scenes import GUY, STIFFNESS, STRING, TENSION, mathieu, multipliers
from references.damped_string import roots_with_damper
from suite import slow

import cablepod as cp

LENGTH = 60.0
#: Mass per stretched length [kg/m] and first angular frequency [rad/s] of the string.
MASS = 1.0 / (1.0 + TENSION / STIFFNESS)
FIRST = np.pi / LENGTH * np.sqrt(TENSION / MASS)
OMEGA = 6.2
PARTS = [{"to": 0.35}, {"from": 0.35, "youngs_modulus": 1.1e11, "area": 9e-5, "density": 7000.0}]
THINGS: dict[str, dict[str, Any]] = {
    "mass and segments": {"segment": PARTS, "attachment": [{"arc_length": 0.3, "mass": 20.0}]},
    "spring": {"attachment": [{"arc_length": 0.3, "spring": 3000.0, "direction": "normal"}]},
    "damper": {"attachment": [{"arc_length": 0.05, "damper": 1000.0, "direction": "normal"}]},
    "all": {
        "segment": PARTS,
        "attachment": [
            {"arc_length": 0.3, "mass": 20.0, "spring": 300.0, "direction": [1.0, 0.0]},
            {"arc_length": 0.95, "damper": 500.0, "direction": [0.8, 0.6]},
        ],
    },
}  # fmt: skip


def damper(place: float, eta: float) -> dict[str, Any]:
    """Return an attached damper of eta times sqrt(T m)."""
    return {"arc_length": place, "damper": eta * np.sqrt(TENSION * MASS), "direction": "normal"}


def string(omega: float, attachment: list[dict[str, Any]], *, force: float = 0.0, links: int = 200) -> Any:
    """Make the string with things under a load normal to it, force sin(omega t) [N/m]."""
    load = {"uniform": [0.0, force], "kind": "harmonic", "amplitude": 1.0, "angular_frequency": omega}
    return cp.make_scene({**STRING, "load": load, "attachment": attachment, "chain": {"links": links}})


def guy(damping: float = 0.5, **tables: Any) -> Any:
    """Make the guy, both of whose ends move at one frequency, with further tables."""
    mapping = copy.deepcopy(GUY) | copy.deepcopy(tables)
    cable = mapping["cable"]
    cable["density"] = cable.pop("specific_weight") / 9.81
    upper = {"kind": "harmonic", "amplitude": 0.02, "angular_frequency": OMEGA}
    mapping["motion"] = {"upper": {"x": upper}, "lower": {"y": upper | {"amplitude": 0.01}}}
    if "load" in tables:
        del mapping["motion"]
    mapping["damping"] = {"mass_proportional": damping}
    return cp.make_scene(mapping)


def response_at_middle(omega: float, force: float, place: float, eta: float) -> float:
    """Return the amplitude at the middle of a string with a damper under a uniform harmonic load [m], place below a half."""
    beta = omega * np.sqrt(MASS / TENSION) * LENGTH
    near, far, middle = beta * place, beta * (1.0 - place), 0.5 * beta
    size = force / omega**2  # of a mass of 1 kg per unstretched metre

    def without(x: float) -> float:
        return float(size * (np.cos(x) + np.tan(0.5 * beta) * np.sin(x) - 1.0))

    # by a unit of i omega c times the displacement at the damper
    at_damper = without(near) / (1.0 + 1j * eta * np.sin(near) * np.sin(far) / np.sin(beta))
    return float(abs(without(middle) - 1j * eta * at_damper * np.sin(near) * np.sin(middle) / np.sin(beta)))


# --- closed forms -----------------------------------------------------------------------------------------------------


def test_the_resonance_with_a_damper_is_that_of_the_string() -> None:
    place, eta = 0.1, 0.4
    force = 1e-4  # stretching changes the stiffness by less than 1e-7
    attached = [damper(place, eta)]
    scene = string(FIRST, attached, force=force)
    modes = cp.condensed.vibration_modes(scene, rank=8)
    ratio, first = float(modes.damping_ratio[0]), float(modes.angular_frequency[0])
    assert 0.01 < ratio < 0.02
    for share in (0.9, 0.98, 1.0, 1.01, 1.1):
        omega = share * first
        orbit = cp.periodic.orbit(
            string(omega, attached, force=force), modes, outputs=("position",), out_of_plane=False
        )
        found = 0.5 * np.ptp(orbit.position.sel(coordinate="y").values[:, 100])
        # the frequency errs by 1e-5 of the links, which the flank of the resonance amplifies by up to 1 / 2 zeta
        assert found == pytest.approx(response_at_middle(omega, force, place, eta), rel=1e-3)
        if share == 1.0:
            static = 4.0 * force / (np.pi * first**2)  # of the first sine
            assert found == pytest.approx(static / (2.0 * ratio), rel=0.02)  # other sines are left out


@pytest.mark.parametrize(("place", "kappa"), [(0.04, 0.3), (0.1, 3.0)])
@pytest.mark.filterwarnings("ignore:nothing damps motion out of the plane")
def test_multipliers_have_the_decay_of_the_damped_string(place: float, kappa: float) -> None:
    eta = kappa / (np.pi * place)
    roots = roots_with_damper(place, eta, 3) / np.pi * FIRST
    omega = 1.37 * FIRST
    scene = string(omega, [damper(place, eta)], force=1e-6)
    modes = cp.condensed.vibration_modes(scene, rank=12)
    orbit = cp.periodic.orbit(scene, modes, outputs=())
    mu, period = multipliers(orbit), 2.0 * np.pi / omega
    inside = mu[orbit.multiplier_set.values == "in_plane"]
    for number, root in enumerate(roots, start=1):
        nearest = inside[np.abs(inside - np.exp(1j * root * period)).argmin()]
        # links: (n pi / 200)^2 / 24 of phases of up to 15 rad; twelve modes and the kink miss 2e-3 of the ratio
        assert abs(nearest / np.exp(1j * root * period) - 1.0) < 1e-3 * number
        assert -np.log(abs(nearest)) / period == pytest.approx(root.imag, rel=2e-3)
    # a damper in the plane does not act out of it
    assert np.abs(mu[orbit.multiplier_set.values == "out_of_plane"]) == pytest.approx(1.0, abs=1e-9)


def test_a_tongue_moves_with_a_damper() -> None:
    place, eta = 0.1, 0.1
    root = roots_with_damper(place, eta, 1)[0]
    stiffer = 1e3
    first = np.pi / LENGTH * np.sqrt(TENSION * (1.0 + TENSION / (stiffer * STIFFNESS)))
    ratio, omega = root.imag / abs(root), abs(root) / np.pi * first
    plain = mathieu(4.0 * ratio, 2.0 * omega, stiffer=stiffer)
    scene = cp.make_scene(
        {
            **STRING,
            "cable": STRING["cable"] | {"youngs_modulus": 1.6e11 * stiffer},
            "motion": {
                "upper": {
                    "x": {
                        "kind": "harmonic",
                        "amplitude": float(plain.motion_upper_x_amplitude),
                        "angular_frequency": 2.0 * omega,
                    }
                }
            },
            "attachment": [damper(place, eta)],
            "chain": {"links": 200},
        }
    )
    modes = cp.condensed.vibration_modes(scene, rank=6)
    threshold = float(scene.motion_upper_x_amplitude)  # 4 zeta
    frequency = 2.0 * omega * np.linspace(0.985, 1.015, 31)
    found = cp.periodic.stability_map(
        scene, modes, frequency=frequency, amplitude=threshold * np.array([0.97, 1.03, 2.0]), out_of_plane=False
    )
    assert (found.kind[0] == "stable").all()
    assert (found.kind[1] == "period_doubling").any()
    for factor in (1.03, 2.0):
        edges = found.edge_angular_frequency.values[np.isclose(found.edge_amplitude.values, factor * threshold)]
        epsilon = 4.0 * ratio * factor
        width = 0.5 * np.sqrt(epsilon**2 - 16.0 * ratio**2)
        exact = 2.0 * omega * np.sqrt(1.0 + np.array([-width, width]))
        # of first order in epsilon; the string without weight has other constants by the links only
        assert edges == pytest.approx(exact, abs=0.05 * 2.0 * omega * width + 2.0 * omega * epsilon**2)


def test_free_vibrations_with_a_mass_begin_at_the_frequency_of_the_string() -> None:
    mass = MASS * LENGTH
    attached = [{"arc_length": 0.5, "mass": mass}, damper(0.2, 0.3)]  # damping is left out
    scene = string(FIRST, attached)
    modes = cp.condensed.vibration_modes(scene, rank=6)
    found = cp.periodic.backbone(scene, modes, amplitude=0.05)
    # sin b l = b l sin^2(b l / 2), b l = 0.5477054 pi, with links of 1e-5 and stretching of the first amplitude
    extrapolated = np.sqrt(
        float(found.angular_frequency[0]) ** 2 - found.attrs["hardening"] * float(found.amplitude[0]) ** 2
    )
    assert extrapolated == pytest.approx(0.5477054 * FIRST, rel=3e-5)


# --- the same model in time -------------------------------------------------------------------------------------------


def settled(scene: Any, modes: Any, names: tuple[str, ...], damping: float = 0.5) -> dict[str, np.ndarray]:
    """Return variables at 32 instants of a period after the transients of a run of the condensed model."""
    period = 2.0 * np.pi / OMEGA
    first = round(np.ceil(2.0 * np.log(1e8) / damping / period))
    times = period * (first + np.arange(32) / 32)
    scene = scene.assign(time_duration=period)  # the constants of a period
    runs = [
        cp.condensed.simulate(
            scene, modes, times=times, step=period / steps, outputs=("position", "tension"), scheme="velocity_verlet"
        )
        for steps in (512, 1024)
    ]
    # of second order in the step
    return {name: runs[1][name].values + (runs[1][name].values - runs[0][name].values) / 3.0 for name in names}


@pytest.mark.filterwarnings("ignore::cablepod.NotConvergedWarning")
@pytest.mark.parametrize("case", ["mass and segments", slow("spring"), "damper", "all"])
def test_the_model_settles_on_the_orbit(case: str) -> None:
    scene = guy(**THINGS[case])
    modes = cp.condensed.vibration_modes(scene, rank=4, static_modes=True)
    orbit = cp.periodic.orbit(scene, modes, outputs=("position", "tension"))
    assert orbit.stable
    for name, values in settled(scene, modes, ("position", "tension")).items():
        # harmonics hold all but 1e-6, the step of the runs a part of that
        assert np.abs(orbit[name].values[:-1:4] - values).max() < 1e-6 * np.ptp(values, axis=0).max()


@pytest.mark.filterwarnings("ignore::cablepod.NotConvergedWarning")
@pytest.mark.parametrize("forcing", ["motion", "load"])
@pytest.mark.parametrize("kind", ["damper", slow("spring")])
def test_a_thing_oblique_to_the_plane_moves_the_cable_out_of_it(kind: str, forcing: str) -> None:
    given: dict[str, Any] = {"ends": {"lower": [0.0, 0.0, 0.0], "upper": [20.4, 57.7, 0.0]}}
    if forcing == "load":  # in the plane, between held ends
        wave = {"kind": "harmonic", "amplitude": 1.0, "angular_frequency": OMEGA}
        given["load"] = {"uniform": [5.0, 0.0, 0.0], **wave}
    scene = guy(**given, attachment=[{"arc_length": 0.1, kind: 1000.0, "direction": [0.5, 0.0, 0.8]}])
    modes = cp.condensed.vibration_modes(scene, rank=3)
    orbit = cp.periodic.orbit(scene, modes, outputs=("position",))
    assert set(orbit.multiplier_set.values) == {"coupled"}
    values = settled(scene, modes, ("position",))["position"]
    assert np.abs(orbit.position.values[:-1:4] - values).max() < 1e-6 * np.ptp(values, axis=0).max()
    assert np.ptp(orbit.position.sel(coordinate="z").values, axis=0).max() > 0.01 * np.ptp(values, axis=0).max()
    planar = cp.periodic.orbit(guy(**given), modes, outputs=())
    assert set(planar.multiplier_set.values) == {"in_plane", "out_of_plane"}


@pytest.mark.parametrize("case", ["mass and segments", "all"])
def test_the_chain_settles_near_the_orbit(case: str) -> None:
    scene = guy(**THINGS[case], chain={"links": 80})
    modes = cp.condensed.vibration_modes(scene, rank=8, static_modes=True)
    orbit = cp.periodic.orbit(scene, modes, outputs=("position",)).position.values[:-1:4]
    period = 2.0 * np.pi / OMEGA
    times = period * (round(np.ceil(2.0 * np.log(1e5) / 0.5 / period)) + np.arange(32) / 32)
    # explicit chains with springs in the plane have no other quick test, for which they would be compiled
    chain = cp.chain.simulate(scene, times=times, step=1e-3, scheme="trapezoidal").position.values

    def size(field: np.ndarray) -> float:
        return float(np.sqrt((field**2).sum(axis=2).mean(axis=1)).max())

    motion = size(chain - chain.mean(axis=0))
    # the waves along the cable that the model leaves out, as of the cable without things
    assert size(orbit - chain) < 2e-3 * motion
    plain = guy(chain={"links": 80})
    other = cp.periodic.orbit(plain, modes, outputs=("position",)).position.values[:-1:4]
    assert size(other - chain) > 0.1 * motion  # the things matter


def test_branches_with_a_damper_have_the_orbits() -> None:
    scene = guy(**THINGS["damper"])
    modes = cp.condensed.vibration_modes(scene, rank=3, static_modes=True)
    response = cp.periodic.frequency_response(scene, modes, frequency=(5.5, 7.0), outputs=("harmonics",))
    near = response.isel(point=int(np.abs(response.angular_frequency.values - OMEGA).argmin()))
    orbit = cp.periodic.orbit(scene, modes, outputs=())
    assert response.attrs["branch_1_ended"] == "range"
    at = np.interp(OMEGA, response.angular_frequency.values, response.deflection_maximum.values)
    assert at == pytest.approx(float(orbit.deflection_maximum), rel=1e-3)  # linear between points
    again = cp.periodic.orbit(scene, modes, start=near, outputs=())
    assert float(again.deflection_maximum) == pytest.approx(float(orbit.deflection_maximum), rel=1e-9)


def test_members_of_different_places_are_those_alone() -> None:
    scenes = [guy(attachment=[{"arc_length": place, "mass": 20.0}]) for place in (0.3, 0.5)]
    modes = cp.condensed.vibration_modes(scenes[0], rank=3)
    stack = xr.concat(scenes, "member", data_vars="different", compat="equals")
    found = cp.periodic.orbit(stack, modes, outputs=())
    for k, scene in enumerate(scenes):
        alone = cp.periodic.orbit(scene, modes, outputs=())
        assert float(found.deflection_maximum[k]) == pytest.approx(float(alone.deflection_maximum), rel=1e-12)
    assert not np.isclose(*found.deflection_maximum.values, rtol=1e-3)


def test_it_warns_of_a_deflection_that_no_damper_damps() -> None:
    scene = guy(damping=0.0, **THINGS["damper"])
    modes = cp.condensed.vibration_modes(scene, rank=2)
    with pytest.warns(cp.OutOfRangeWarning, match="^nothing damps motion out of the plane: responses"):
        cp.periodic.orbit(scene, modes, outputs=())
    cp.periodic.orbit(scene, modes, outputs=(), out_of_plane=False)  # without a warning


# --- refusals ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("options", [{"order": "exact"}, {"outputs": ("error_estimate",)}])
def test_order_exact_is_refused(options: dict[str, Any]) -> None:
    scene = guy(**THINGS["damper"])
    modes = cp.condensed.vibration_modes(scene, rank=2)
    with pytest.raises(cp.SceneError, match=r"^attachment\.1: given; allowed: none here; try: (order|more modes)"):
        cp.periodic.orbit(scene, modes, **options)
    with pytest.raises(cp.SceneError, match=r"^attachment\.1: given"):
        cp.periodic.frequency_response(scene, modes, frequency=(5.0, 6.0), **options)
