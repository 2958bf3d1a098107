"""Step of the elastic chain: stability limit, tolerance, broken runs, ends that start with a speed."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scenes import scene_with, uniform_chain

import cablepod as cp


def test_a_step_above_the_limit_is_refused_with_both_numbers(soft):
    scene = scene_with(soft)
    limit = cp.chain.simulate(scene, step=1e-3).attrs["step_limit"]
    with pytest.raises(cp.SceneError, match=rf"step: given {1.01 * limit:.6g} s; allowed: below .* {limit:.6g} s"):
        cp.chain.simulate(scene, step=1.01 * limit)


@pytest.mark.parametrize(
    ("scheme", "step"),
    [("velocity_verlet", 1e-3), ("trapezoidal", 0.01), ("generalized_alpha", 0.01), ("energy_momentum", 0.01)],
)
def test_a_divergent_run_stops_at_the_step_that_leaves_the_bound(soft, scheme, step):
    # the upper end is at 1e-3 t^30 m: 1.7e7 m at 2.19 s, 2e82 m at the last output time
    scene = scene_with(
        soft,
        motion={"upper": {"x": {"kind": "polynomial", "coefficients": [0.0] * 29 + [1e-3]}}},
        time={"duration": 1.0, "interval": 1.0},  # later it takes the end far away, which a scene may not say
    )
    with pytest.raises(cp.RunStopped, match=rf"left the finite numbers at .* s \(.*step {step:g} s.*; try") as stopped:
        cp.chain.simulate(scene, scheme=scheme, step=step, times=np.arange(700.0))
    partial = stopped.value.partial
    np.testing.assert_array_equal(partial.time, [0.0, 1.0, 2.0])
    assert np.isfinite(partial.position).all()
    assert "stopped at" in partial.attrs["incomplete"]
    bound = 1e6 * (partial.unstretched_length.item() + 8.0)
    when = float(re.search(r" at ([\d.]+) s", str(stopped.value))[1])
    assert 8.0 + 1e-3 * when**30 <= bound < 8.0 + 1e-3 * (when + step) ** 30
    # solved as well as in a run that ends before: distant ends of later steps do not loosen Newton's tolerance
    count, rounding = (3, 0.0) if scheme == "velocity_verlet" else (2, 1e-6)
    again = cp.chain.simulate(scene, scheme=scheme, step=step, times=partial.time.values[:count])
    np.testing.assert_allclose(partial.position[:count], again.position, rtol=0.0, atol=rounding)


@pytest.mark.parametrize(
    ("scheme", "tolerance"),
    [(None, 1e-4), (None, 1e-6), ("trapezoidal", 1e-4), ("generalized_alpha", 1e-4), ("energy_momentum", 1e-4)],
)
def test_a_tolerance_is_met(soft, scheme, tolerance):
    scene = scene_with(soft)
    exact = cp.chain.simulate(scene, step=1 / 64000)
    run = cp.chain.simulate(scene, scheme=scheme, tolerance=tolerance, outputs=("position",))
    assert run.attrs["scheme"] == scheme or scheme is None
    error = float(cp.compare.errors(run, exact).error_max)
    # the estimate is a bound after two runs, and right within a factor of two after more
    assert error < 2 * run.attrs["time_error_estimate"]
    assert run.attrs["time_error_estimate"] <= tolerance
    assert error < tolerance


def test_the_tolerance_is_met_where_the_motion_begins_with_a_jump(soft):
    # an end that starts with a velocity sends a shock along the chain, for which the scheme is not of second order
    scene = scene_with(
        soft,
        motion={"upper": {"x": {"kind": "harmonic", "amplitude": 0.03, "angular_frequency": 5.0}}},
        time={"duration": 4.0, "interval": 0.5},
    )
    run = cp.chain.simulate(scene)
    exact = cp.chain.simulate(scene, step=run.attrs["step"] / 16)
    assert float(cp.compare.errors(run, exact).error_max) < 1e-6


def test_a_broken_finite_run_is_stopped_at_the_first_sign(scenes):
    # links slacken and snap taut: the step is below the limit of taut links, 3.4e-4 s, yet every snap adds energy; when it is
    # too much depends on rounding, as the motion is chaotic
    scene = cp.read_scene(scenes / "example3_swapped_rows.toml")
    said = (
        r"the run broke down: at (\d+) s the links hold .* J, .* explain \(velocity_verlet, step 0\.00025 s, limit 0\.0"
    )
    with pytest.raises(cp.RunStopped, match=said) as stopped:
        cp.chain.simulate(scene, step=2.5e-4)
    assert str(stopped.value).endswith("try scheme energy_momentum, or a step half as long")
    at = int(re.match(said, str(stopped.value)).group(1))
    assert 0 < at <= 124
    assert stopped.value.partial.sizes["time"] == at
    assert stopped.value.partial.attrs["incomplete"] == f"stopped at {at} s of 124 s"
    sound = cp.chain.simulate(scene, step=2e-4)
    assert sound.attrs["energy_excess"] < 0.01


def test_a_chaotic_scene_is_warned_of(scenes):
    scene = cp.read_scene(scenes / "example2.toml")
    wild = scene.assign(
        motion_upper_x_amplitude=scene.motion_upper_x_amplitude * 2,
        motion_upper_x_angular_frequency=scene.motion_upper_x_angular_frequency * 0 + 2.0,
    )
    with pytest.warns(cp.NotConvergedWarning, match="not converged in time: an error of"):
        cp.chain.simulate(wild, links=10, times=[45.0])


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"links": 1}, "links: given 1; allowed: a whole number of at least 2"),
        ({"links": True}, "links: given True"),
        ({"links": 10**12}, "links: .* GB of output; allowed: half of this machine's memory"),
        ({"scheme": "euler"}, 'scheme: given \'euler\'; allowed: one of "velocity_verlet", "trapez'),
        ({"scheme": "generalized_alpha", "spectral_radius": 1.2}, r"spectral_radius: given 1\.2; allowed: .* at most 1"),
        ({"scheme": "trapezoidal", "spectral_radius": 0.5}, r'spectral_radius: given 0\.5; allowed: none, but for scheme "gen'),
        ({"scheme": "trapezoidal", "step": 100.0}, r"step: given 100\.0; allowed: .* at most 4"),
        ({"step": -1.0}, "step: given -1.0; allowed: a finite number above 0"),
        ({"step": "fast"}, "step: given 'fast'"),
        ({"step": 1e-3, "tolerance": 1e-3}, "step and tolerance"),
        ({"progress": 3}, "progress: given 3; allowed: a function of the completed fraction, or None"),
        ({"tolerance": 0.0}, "tolerance: given 0.0"),
        ({"times": []}, r"times: given \[\]; allowed: finite, rising"),
        ({"times": [1.0, 1.0]}, "times: given"),
        ({"times": [-1.0]}, "times: given"),
        ({"times": [np.nan]}, "times: given"),
        ({"times": "now"}, "times: given 'now'"),
        ({"outputs": ("positions",)}, "outputs: given 'positions'; allowed: some of position"),
    ],
)  # fmt: skip
def test_invalid_options_are_refused(soft, options, match):
    with pytest.raises(cp.SceneError, match=match):
        cp.chain.simulate(scene_with(soft), **options)


def test_the_energy_of_a_velocity_jump_is_that_of_the_axial_wave():
    # a straight cable without weight: until the wave arrives, the chain has its energy and the work against the first tension
    speed, stiffness, mass, length = 0.5, 2e4, 1.0, 10.0
    scene = cp.make_scene(
        {
            "gravity": 0.0,
            "cable": {"youngs_modulus": stiffness / 1e-3, "area": 1e-3, "density": 1000.0, "unstretched_length": length / 1.01},
            "ends": {"lower": [0.0, 0.0], "upper": [8.0, 6.0]},
            "motion": {"upper": {axis: {"kind": "polynomial", "coefficients": [speed * part]}
                                 for axis, part in (("x", 0.8), ("y", 0.6))}},
            "chain": {"links": 800},
        }
    )  # fmt: skip
    arrival = length / 1.01 / np.sqrt(stiffness / mass)
    run = cp.chain.simulate(
        scene, times=[0.0, 0.9 * arrival], step=0.25 * arrival / 800, outputs=("position", "velocity", "tension")
    )
    chain = uniform_chain(scene, run)
    kinetic = 0.5 * (chain.mass[1:-1, None] * run.velocity.values[1, 1:-1] ** 2).sum()
    strain = (run.tension**2 / (2 * chain.stiffness)).sum("link")
    work = run.tension[0, -1] * speed * 0.9 * arrival
    found = float(kinetic + strain[1] - strain[0] - work)
    # 0.9 of the way; the front of a chain is not sharp: a few links of 800
    assert found == pytest.approx(0.9 * run.attrs["start_jolt_energy"], rel=0.01)
    assert run.attrs["start_jolt_speed"] == pytest.approx(speed, rel=1e-12)
    behind = float((run.tension[1, 400:700] - run.tension[0, 400:700]).mean())
    assert behind == pytest.approx(run.attrs["start_jolt_tension"], rel=0.01)


def test_ends_that_start_smoothly_have_no_velocity_jump(soft):
    run = cp.chain.simulate(cp.make_scene(soft), times=[0.0], scheme="trapezoidal", step=0.1)
    assert not [name for name in run.attrs if name.startswith("start_jolt")]
