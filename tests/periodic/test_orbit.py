"""One periodic response: closed forms, identities, and the same model integrated in time."""

from __future__ import annotations

import copy

import numpy as np
import pytest
from periodic_scenes import GUY, STIFFNESS, TENSION, guy, loaded, mathieu, multipliers

import cablepod as cp

pytestmark = pytest.mark.filterwarnings("ignore:damping is zero")


def modes_of(scene, rank=2):
    return cp.condensed.vibration_modes(scene, rank=rank)


# --- multipliers ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("damping", [0.0, 0.02])
@pytest.mark.parametrize("omega", [6.1, 12.5])
def test_the_product_of_all_multipliers_is_that_of_liouville(omega, damping):
    scene = guy(angular_frequency=omega, damping=damping)
    orbit = cp.periodic.orbit(scene, modes_of(scene, 3), outputs=())
    mu = multipliers(orbit)
    # six coordinates; rounding of the scheme over some hundred steps
    assert np.prod(mu).real == pytest.approx(np.exp(-damping * 2.0 * np.pi / omega * 6), rel=1e-9)
    assert list(orbit.multiplier_set.values) == ["in_plane"] * 6 + ["out_of_plane"] * 6


@pytest.mark.parametrize("omega", [6.1, 12.5])
def test_without_damping_multipliers_come_in_reciprocal_pairs(omega):
    scene = guy(angular_frequency=omega, damping=0.0)
    mu = multipliers(cp.periodic.orbit(scene, modes_of(scene, 3), outputs=()))
    assert np.abs(mu[:, None] * mu - 1.0).min(axis=1).max() < 1e-8


@pytest.mark.parametrize(("ratio", "grows"), [(1.0 + 1e-4, True), (1.0 - 1e-4, False)])
def test_the_parametric_threshold_is_four_times_the_damping_ratio(ratio, grows):
    zeta = 1e-3
    omega = float(modes_of(mathieu(0.1, stiffer=1e3)).angular_frequency[0])
    scene = mathieu(4.0 * zeta * ratio, 2.0 * omega, 2.0 * zeta * omega, stiffer=1e3)
    orbit = cp.periodic.orbit(scene, modes_of(scene, 1), outputs=())
    assert bool(orbit.growth > 0.0) == grows
    # the centre of the tongue moves by the square of epsilon
    centre = np.exp(np.pi * zeta * (ratio - 1.0))
    assert np.abs(multipliers(orbit)).max() == pytest.approx(centre, abs=1e-8)


# --- orbits -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("omega", [6.2, 3.1, 11.0])
def test_a_stable_orbit_is_where_the_model_settles(omega):
    scene = guy(angular_frequency=omega, damping=0.3, amplitude=0.02)
    modes, period = modes_of(scene, 2), 2.0 * np.pi / omega
    orbit = cp.periodic.orbit(scene, modes, outputs=("position", "tension"))
    assert orbit.stable
    # after transients, which have fallen to 1e-7; the modes have constants of a reference state over the duration of the scene,
    # here a period; the scheme is of fourth order, 512 steps a period
    times = period * (round(np.ceil(2.0 * np.log(1e7) / 0.3 / period)) + np.arange(64) / 64)
    options = {"times": times, "step": period / 512, "scheme": "numerov", "outputs": ("position", "tension")}
    run = cp.condensed.simulate(scene.assign(time_duration=period), modes, **options)
    for name in ("amplitude", "tension", "position"):
        found, settled = orbit[name].values[:-1:2], run[name].values
        assert np.abs(found - settled).max() < 1e-4 * np.ptp(found, axis=0).max(), name


def test_the_amplitude_of_the_parametric_response():
    zeta, epsilon = 2e-3, 0.02
    omega = float(modes_of(mathieu(0.1)).angular_frequency[0])
    forcing = 2.0 * omega * (1.0 + 0.25 * epsilon)
    scene = mathieu(epsilon, forcing, 2.0 * zeta * omega)
    modes = modes_of(scene, 1)
    low, high = forcing * 0.97, forcing
    response = cp.periodic.frequency_response(scene, modes, frequency=(low, high), out_of_plane=False)
    last = response.isel(point=int(np.flatnonzero(response.branch == 2)[-1]))
    assert float(last.angular_frequency) == pytest.approx(forcing)
    delta = (forcing / (2.0 * omega)) ** 2 - 1.0
    square = delta + 0.5 * np.sqrt(epsilon**2 - 16.0 * zeta**2 * (forcing / (2.0 * omega)) ** 2)
    # (3/4) beta a^2 with beta a^2 = (EA/T0) (pi a / l)^2 / 4, times chord / L0
    beta = 0.25 * STIFFNESS / TENSION * (np.pi / 60.0) ** 2 * (1.0 + TENSION / STIFFNESS)
    a = float(last.deflection_maximum)
    # one harmonic: the next holds a share of the square of the detuning, 1e-4; links of (pi / 40)^2 / 24
    assert a == pytest.approx(np.sqrt(square / 0.75 / beta), rel=1e-3)


def test_the_pitchfork_to_whirling():
    zeta = 1e-3
    omega = float(modes_of(mathieu(0.1)).angular_frequency[0])
    scene = loaded(0.4, 7.0, 2.0 * zeta * omega)
    response = cp.periodic.frequency_response(
        scene, modes_of(scene, 1), frequency=(0.98 * omega, 1.1 * omega), follow=()
    )
    found = response.isel(bifurcation=response.bifurcation_kind.values == "pitchfork")
    assert found.sizes["bifurcation"] >= 1
    stretch = 1.0 + TENSION / STIFFNESS
    for k in range(found.sizes["bifurcation"]):
        ratio = float(found.bifurcation_angular_frequency[k]) / omega
        a = float(found.bifurcation_deflection_maximum[k])
        g = 0.25 * STIFFNESS / TENSION * (np.pi * a / 60.0) ** 2 * stretch
        # (d + 3g/4)(d + g/4) + (2 zeta ratio)^2 = 0 for the smaller amplitude of the two at which it can be
        d = -0.5 * g - np.sqrt(0.0625 * g**2 - (2.0 * zeta * ratio) ** 2) * np.array([1.0, -1.0])
        assert np.abs(np.sqrt(1.0 - d) / ratio - 1.0).min() < 2e-4


# --- the same physics, described otherwise ----------------------------------------------------------------------------


def changed(**kinds):
    """The guy, mirrored, turned about the vertical, or rescaled."""
    mapping = copy.deepcopy(GUY)
    mapping["motion"]["upper"]["x"] |= {"angular_frequency": 12.5, "amplitude": 0.005}
    if "mirrored" in kinds:
        mapping["ends"]["upper"][0] *= -1.0
        mapping["motion"]["upper"]["x"]["amplitude"] *= -1.0
    if "spatial" in kinds:
        for end in ("lower", "upper"):
            mapping["ends"][end].append(0.0)
    if "turned" in kinds:
        angle = 0.7
        x, y = mapping["ends"]["upper"]
        mapping["ends"] = {"lower": [0.0, 0.0, 0.0], "upper": [x * np.cos(angle), y, x * np.sin(angle)]}
        along = mapping["motion"]["upper"]["x"]
        mapping["motion"]["upper"] = {
            axis: along | {"amplitude": along["amplitude"] * part}
            for axis, part in (("x", np.cos(angle)), ("z", np.sin(angle)))
        }
    if "rescaled" in kinds:  # all lengths times four, all times times two: weight and stiffness per length stay
        factor = 4.0
        mapping["ends"]["upper"] = [factor * value for value in mapping["ends"]["upper"]]
        mapping["cable"]["top_tension"] *= factor
        mapping["cable"]["youngs_modulus"] *= factor
        mapping["motion"]["upper"]["x"]["amplitude"] *= factor
        mapping["motion"]["upper"]["x"]["angular_frequency"] /= 2.0
        mapping["damping"]["mass_proportional"] /= 2.0
    return cp.make_scene(mapping)


@pytest.mark.parametrize("kind", ["mirrored", "spatial", "turned", "rescaled"])
def test_mirrored_turned_and_rescaled_scenes_have_the_same_orbit(kind):
    first, second = changed(), changed(**{kind: True})
    a, b = (cp.periodic.orbit(scene, modes_of(scene, 3), outputs=()) for scene in (first, second))
    factor = 4.0 if kind == "rescaled" else 1.0
    assert float(b.deflection_maximum) == pytest.approx(factor * float(a.deflection_maximum), rel=1e-9)
    for which in ("in_plane", "out_of_plane"):
        mu, other = (np.sort_complex(multipliers(x)[x.multiplier_set.values == which]) for x in (a, b))
        assert np.abs(mu - other).max() < 1e-9


# --- starts, members, outputs ------------------------------------------------------------------------------------------


def test_an_orbit_is_found_again_from_itself_and_from_a_run():
    scene = guy(angular_frequency=6.2, damping=0.3, amplitude=0.02)
    modes = modes_of(scene, 2)
    orbit = cp.periodic.orbit(scene, modes, outputs=("harmonics",))
    run = cp.condensed.simulate(scene, modes, times=np.linspace(0.0, 60.0, 2401), step=0.005, outputs=())
    for start in (orbit, orbit.drop_vars(["harmonic_cosine", "harmonic_sine"]), run):
        again = cp.periodic.orbit(scene, modes, start=start, outputs=())
        assert float(again.deflection_maximum) == pytest.approx(float(orbit.deflection_maximum), rel=1e-7)


@pytest.mark.parametrize(("ratio", "periods"), [(1.01, 2), (1.0, 4)])
def test_a_doubled_orbit_is_a_start_with_and_without_its_harmonics(ratio, periods):
    scene = guy(angular_frequency=12.68, amplitude=0.01, damping=0.1)
    modes, options = modes_of(scene), {"out_of_plane": False, "outputs": ("harmonics",)}
    response = cp.periodic.frequency_response(scene, modes, frequency=(12.55, 12.68), **options)
    point = response.isel(point=int(np.flatnonzero(response.periods == 2)[-1]))
    near = scene.assign(motion_upper_x_angular_frequency=ratio * scene.motion_upper_x_angular_frequency)
    found = []
    for outputs in ((), ("harmonics",)):
        start = cp.periodic.orbit(scene, modes, periods=2, start=point, outputs=outputs)
        found.append(cp.periodic.orbit(near, modes, periods=periods, start=start, outputs=()).amplitude.values)
    size = np.ptp(found[0])
    assert np.abs(found[0][0] - found[0][128]).max() > 0.1 * size  # instants of a period
    assert np.abs(found[0] - found[1]).max() < 1e-6 * size  # the least share of its harmonics that an orbit leaves out


def test_members_are_computed_one_by_one_and_say_why_they_fail():
    scene = guy(angular_frequency=6.0)
    tensions = [8000.0, 15000.0]
    members = cp.ensemble.design(scene, {"cable.top_tension": tensions}, members=2, sampling="grid")
    modes = modes_of(scene, 3).isel(mode=[0, 2])
    result = cp.periodic.orbit(members, modes, outputs=())
    assert (result.sizes["member"], result.mode.values.tolist()) == (2, [1, 3])
    assert list(result.failure.values) == ["", ""]
    for k in range(2):
        alone = cp.periodic.orbit(members.isel(member=k), modes, outputs=())
        assert float(result.growth[k]) == float(alone.growth)


def test_an_interrupt_keeps_the_members_that_have_an_orbit():
    scene = guy(damping=0.05)
    modes = cp.condensed.vibration_modes(scene, rank=1)
    members = cp.ensemble.design(scene, {"cable.top_tension": [9e3, 15e3]}, members=3, sampling="grid")
    told: list[float] = []

    def stop(done):
        told.append(done)
        if done > 0.5:
            raise KeyboardInterrupt

    whole = cp.periodic.orbit(members, modes, progress=told.append)
    assert told[-1] == 1.0
    with pytest.raises(cp.RunStopped, match="interrupted") as caught:
        cp.periodic.orbit(members, modes, progress=stop)
    partial = caught.value.partial
    assert list(partial.failure.values) == ["", "", "interrupted"]
    assert partial.attrs["incomplete"] == 1
    for name in ("position", "multiplier_real", "growth"):
        assert np.array_equal(partial[name].values[:2], whole[name].values[:2]), name
        assert np.isnan(partial[name].values[2]).all()


def test_members_have_their_own_instants_attributes_and_harmonics(tmp_path):
    scene = guy(damping=0.05)
    modes = cp.condensed.vibration_modes(scene, rank=2)
    ranges = {"motion.upper.x.angular_frequency": [5.0, 12.45], "motion.upper.x.amplitude": [0.003, 0.02]}
    members = cp.ensemble.design(scene, ranges, members=4, sampling="grid")
    outputs = ("position", "harmonics")
    result = cp.periodic.orbit(members, modes, outputs=outputs)
    assert "time" not in result.coords
    assert len({*result.harmonics.values}) > 1
    for k in range(4):
        alone = cp.periodic.orbit(members.isel(member=k), modes, outputs=outputs)
        here = result.isel(member=k)
        assert np.array_equal(here.member_time.values, alone.time.values)
        assert here.member_time.attrs["units"] == "s"
        for name in ("smallest_chordwise_force", "forcing_over_axial_frequency", "harmonics"):
            assert float(here[name]) == alone.attrs[name], name
            assert name not in result.attrs
        count = alone.sizes["harmonic"]
        assert np.array_equal(here.harmonic_cosine.values[:count], alone.harmonic_cosine.values)
        assert not here.harmonic_cosine.values[count:].any()
        assert np.array_equal(here.position.values, alone.position.values)
    last = result.isel(member=3)  # instants of its own, also where it is used
    again = cp.periodic.orbit(members.isel(member=3), modes, start=last.drop_vars("harmonic_cosine"), outputs=outputs)
    assert again.position.values == pytest.approx(last.position.values, rel=1e-9)
    assert cp.plots.animate_orbit(last, frames=8).times[1] == last.member_time.values[16]
    cp.archive.write(result, tmp_path / "orbits.nc")
    same = cp.ensemble.design(scene, {"cable.top_tension": [9e3, 15e3]}, members=2, sampling="grid")
    assert "time" in cp.periodic.orbit(same, modes, outputs=()).coords
