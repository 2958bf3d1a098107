"""Motion of a mast: kinds of guys against each other, energy, outputs, archive, members, refusals."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from mast_scenes import WIND, small, windy
from suite import slow

import cablepod as cp
from cablepod import provenance
from cablepod.errors import OutOfRangeWarning, RunStopped, SceneError

SIGMA = np.linspace(0.0, 1.0, 41)
TWO_MODES = cp.modes(np.sin(np.pi * np.outer([1, 2], SIGMA)), arc_length=SIGMA)


def modes_of_moves(upper, amplitude):
    """Two modes of a cable from the origin that moves as two sines in a vertical plane, by amplitudes (mode,) [m]."""
    chord = np.array(upper)
    normal = np.array([-chord[1], chord[0], 0.0]) / np.linalg.norm(chord)
    waves = np.asarray(amplitude)[:, None] * np.sin(np.pi * np.outer([1, 2], SIGMA))
    position = SIGMA[:, None] * chord + np.concatenate([waves, -waves, waves[::-1]])[:, :, None] * normal
    return cp.pod.decompose(cp.snapshots(position, arc_length=SIGMA), rank=2, layout="normal")


def undamped(mapping):
    mapping["mast"]["damping_ratio"] = 0.0
    del mapping["damping"]


def rms(run, reference, name="guy_tension"):
    """Difference of two runs over the standard deviation of the reference (guys,)."""
    difference = np.sqrt(((run[name] - reference[name]) ** 2).mean("time"))
    return (difference / reference[name].std("time")).values


def test_compiled_forces_at_rest_are_those_of_the_model():
    """The rest is that of the model in numpy: with other forces in the kernel a mast under a constant load would move."""
    load = {"level": 30.0, "force": [1000.0, 0.0, 400.0]}
    run = cp.mast.simulate(small(lambda mapping: mapping["mast"].update(load=[load])), rank=3)
    assert float(np.ptp(run.guy_tension.values, axis=0).max()) < 1e-9 * float(run.guy_tension.max())
    assert float(np.ptp(run.displacement.values, axis=0).max()) < 1e-9 * float(abs(run.displacement).max())


def test_condensed_guys_are_as_good_as_chains_after_a_pull():
    scene = small()
    chain = cp.mast.simulate(scene, guys="chain", links=60)
    run = cp.mast.simulate(scene, rank=8, step=0.005)
    top = abs(run.displacement - chain.displacement).max() / abs(chain.displacement).max()
    assert float(top) < 0.001
    assert rms(run, chain).max() < 0.009  # 0.0104 without the vertical force of the deflections' inertia
    np.testing.assert_allclose(
        run.bending_moment_maximum, chain.bending_moment_maximum, atol=0.01 * float(chain.bending_moment_maximum.max())
    )
    static = cp.mast.simulate(scene, guys="catenary")
    assert rms(static, chain).max() > 0.1  # guys without motion of their own are not
    np.testing.assert_allclose(static.guy_tension[-1], chain.guy_tension[-1], rtol=0.1)


def test_energy_is_bounded_without_damping():
    scene = small(lambda mapping: (undamped(mapping), mapping["time"].update(duration=600.0, interval=0.5)))
    run = cp.mast.simulate(scene, outputs=("energy", "displacement"), step=0.005)
    energy = run.energy.values[1:]  # after the ramp of the load
    motion = 0.5 * abs(energy).mean()
    assert np.ptp(energy) < 1e-4 * motion
    coarse = cp.mast.simulate(scene, outputs=("energy",), step=0.01).energy.values[1:]
    assert np.ptp(coarse) > 2.0 * np.ptp(energy)  # of second order
    assert abs(coarse[-200:].mean() - coarse[:200].mean()) < 0.5 * np.ptp(coarse)  # no drift, but a slow beat


@pytest.mark.slow
def test_a_mast_without_loads_stays_at_rest():
    scene = small(lambda mapping: mapping["mast"].pop("load"))
    rest = cp.mast.rest(scene)
    for kind in ("condensed", "chain", "catenary"):
        run = cp.mast.simulate(scene, guys=kind)
        np.testing.assert_allclose(run.displacement, rest.displacement.broadcast_like(run.displacement), atol=1e-9)
        np.testing.assert_allclose(run.guy_tension, rest.guy_tension.broadcast_like(run.guy_tension), rtol=1e-3)


@pytest.mark.parametrize("kind", [slow("condensed"), slow("chain"), slow("catenary")])
def test_steady_wind_leaves_a_mast_at_rest(kind):
    def steady(mapping):
        windy(mapping)
        mapping["wind"] = {name: value for name, value in WIND.items() if name != "turbulence"}

    scene = small(steady)
    run = cp.mast.simulate(scene, guys=kind)
    assert float(np.ptp(run.displacement.values, axis=0).max()) < 1e-6 * float(abs(run.displacement).max())


@pytest.mark.slow  # 20 s
def test_turbulence_moves_condensed_guys_as_chains():
    def storm(mapping):
        windy(mapping)
        mapping["time"].update(duration=60.0, interval=0.05)

    scene = small(storm)
    chain = cp.mast.simulate(scene, guys="chain", links=40)
    run = cp.mast.simulate(scene, rank=6, step=0.005)
    assert rms(run, chain).max() < 0.05
    np.testing.assert_allclose(run.guy_tension_std, chain.guy_tension_std, rtol=0.01)
    np.testing.assert_allclose(run.guy_tension_maximum, chain.guy_tension_maximum, rtol=0.01)


def test_extremes_and_means_are_those_of_the_steps():
    scene = small()
    run = cp.mast.simulate(scene, times=np.arange(401) * 0.01, step=0.01)
    np.testing.assert_allclose(run.guy_tension_maximum, run.guy_tension.max("time"), rtol=1e-14)
    np.testing.assert_allclose(run.guy_tension_std, run.guy_tension.std("time"), rtol=1e-6)
    np.testing.assert_allclose(run.displacement_minimum, run.displacement.min("time"), atol=1e-15)
    at = run.guy_tension.isel(guy=2).idxmax("time")
    assert float(run.guy_tension_maximum_time[2]) == pytest.approx(float(at), abs=1e-9)
    for window in ((1.0, 2.0), (0.994, 2.006)):  # steps beside a window do not count
        part = cp.mast.simulate(scene, times=np.arange(401) * 0.01, step=0.01, window=window)
        within = run.guy_tension.sel(time=slice(0.995, 2.005))
        np.testing.assert_allclose(part.guy_tension_mean, within.mean("time"), rtol=1e-12)


def test_tolerance_halves_the_step():
    loose, tight = (cp.mast.simulate(small(), tolerance=tolerance) for tolerance in (0.1, 0.003))
    assert tight.attrs["step"] < loose.attrs["step"]
    assert tight.attrs["time_error_estimate"] <= 0.003


@pytest.mark.parametrize("options", [{"rank": 2}, {"modes": TWO_MODES}])
def test_error_estimate_is_of_the_size_of_the_error(options):
    """Also of modes of one's own, however few there are."""
    scene = small()
    run = cp.mast.simulate(scene, **options, step=0.005, outputs=("guy_tension", "error_estimate"))
    rich = cp.mast.simulate(scene, rank=12, step=0.002, outputs=("guy_tension",))
    actual = rms(run, rich).max()
    assert run.attrs["rank"] == 2
    assert 0.5 * actual < run.attrs["error_estimate"] < 2.0 * actual


def test_error_estimate_has_the_error_of_the_step():
    """With eight modes in taut guys it is nearly all; of a richer run with the same step the estimate was a fifth of it."""
    scene = small(lambda mapping: mapping["guy"][0].update(top_tension=15000.0))
    run = cp.mast.simulate(scene, rank=8, outputs=("guy_tension", "error_estimate"))
    fine = cp.mast.simulate(scene, rank=12, step=5e-4, outputs=("guy_tension",))
    assert 0.7 < run.attrs["error_estimate"] / rms(run, fine).max() < 1.3


@pytest.mark.parametrize("options", [{}, {"times": [0.0]}])
@pytest.mark.filterwarnings("error")
def test_errors_of_a_mast_that_stands_still_are_parts_of_its_tensions(options):
    """They are no parts of a deviation that is rounding: 1e8 times that was the estimate, and no step met a tolerance."""

    def still(mapping):
        del mapping["mast"]["load"]

    run = cp.mast.simulate(small(still), outputs=("error_estimate",), tolerance=1e-6, **options)
    assert run.attrs["time_error_estimate"] < 1e-9  # rounding
    assert run.attrs["error_estimate"] < 1e-4  # of the tension at rest by four sines


def test_a_guy_that_breaks_after_the_run_is_noted():
    def breaking(mapping, at):
        mapping["guy"][0].update(breaks=at, breaks_number=2)

    late = "guy.1.breaks: guy 2 breaks at 4 s, not before the end of the run at 4 s"
    scene = small(lambda mapping: breaking(mapping, 4.0))
    assert late in str(cp.mast.summary(scene)["note"].values)
    with pytest.warns(
        cp.UnusualSceneWarning, match=r"^guy\.1\.breaks: guy 2 breaks at 4 s, .* at 4 s; try a longer run$"
    ):
        cp.mast.simulate(scene, guys="chain")
    with pytest.warns(cp.UnusualSceneWarning, match=r"at 0\.8 s; try"):
        cp.mast.simulate(small(lambda mapping: breaking(mapping, 1.0)), guys="chain", times=np.arange(5) * 0.2)
    assert "breaks" not in str(cp.mast.summary(small(lambda mapping: breaking(mapping, 3.9)))["note"].values)


def test_one_guy_of_a_table_breaks():
    def breaking(mapping, **keys):
        mapping["guy"][0].update(breaks=1.0, **keys)

    run = cp.mast.simulate(
        small(lambda mapping: breaking(mapping, breaks_number=2)), guys="chain", times=np.arange(8) * 0.2
    )
    pulls = (run.guy_tension.sel(time=slice(1.1, None)) > 0.0).all("time")
    assert pulls.values.tolist() == [True, False, True]
    for keys, text in (({}, "missing; allowed: 1 to 3"), ({"breaks_number": 4}, "given 4; allowed: 1 to 3")):
        with pytest.raises(SceneError, match=rf"^guy\.1\.breaks_number: {text}"):
            small(lambda mapping, keys=keys: breaking(mapping, **keys))
    with pytest.raises(SceneError, match=r"^guy\.1\.breaks_number: given 1; allowed: none without guy\.1\.breaks"):
        small(lambda mapping: mapping["guy"][0].update(breaks_number=1))


@pytest.mark.parametrize("guys", ["chain", "condensed"])
def test_all_outputs_break_at_the_same_instant(guys):
    # 0.28 s is an instant of the output, but 7 * 0.04 is more by rounding, and 0.28 / step more than a whole number
    scene = small(lambda mapping: mapping["guy"][0].update(breaks=0.28, breaks_number=2))
    run = cp.mast.simulate(
        scene, guys=guys, times=0.04 * np.arange(10), step=0.04 / 128, outputs=("guy_tension", "anchor_force")
    ).isel(guy=1)
    assert (run.guy_tension == 0.0).values.tolist() == 7 * [False] + 3 * [True]
    assert (run.anchor_force == 0.0).all("coordinate").values.tolist() == 7 * [False] + 3 * [True]


def breaking(mapping):
    """Four guys, of which the last breaks after a second."""
    mapping["guy"][0]["count"] = 1
    guy = {name: value for name, value in mapping["guy"][0].items() if name != "direction"}
    for angle in (2.0, 4.0, 5.0):
        mapping["guy"].append({**guy, "direction": [np.cos(angle), 0.0, np.sin(angle)]})
    mapping["guy"][3]["breaks"] = 1.0


def test_a_broken_guy_pulls_no_more():
    for kind in ("condensed", "chain"):
        run = cp.mast.simulate(small(breaking), guys=kind, times=np.arange(11) * 0.2)
        tension = run.guy_tension.isel(guy=3)
        assert float(tension.sel(time=slice(0.0, 0.9)).min()) > 1000.0
        assert float(abs(tension.sel(time=slice(1.1, 2.0))).max()) == 0.0
    with pytest.raises(SceneError, match=r"^guy\.4\.breaks: .*condensed"):
        cp.mast.simulate(small(breaking), guys="catenary")


def test_a_broken_guy_takes_its_energy_away():
    scene = small(lambda mapping: (breaking(mapping), undamped(mapping), mapping["mast"].pop("load")))

    def drift(step):
        energy = cp.mast.simulate(scene, outputs=("energy",), step=step, times=0.1 * np.arange(41)).energy
        assert float(abs(energy[:10]).max()) < 1e-6
        left = energy[10:]
        assert float(left.max()) < -1000.0  # what the guy had
        return float(np.ptp(left.values))

    coarse, fine = drift(0.01), drift(0.005)
    assert coarse < 1e-4 * 1000.0
    assert 3.3 < coarse / fine < 4.7  # bounded, of second order


def rupture(*, built=True, modes=8, **breaks):
    """A mast of two levels in the wind, whose windward guy of the upper level breaks, or is not built."""
    directions = np.array([[-1.0, 0.0, 0.0], [0.5, 0.0, 0.75**0.5], [0.5, 0.0, -(0.75**0.5)]])
    guys = [
        {"cable": "steel", "level": level, "anchor": (radius * direction).tolist(), "top_tension": tension}
        for level, radius, tension in ((30.0, 30.0, 12000.0), (58.0, 40.0, 15000.0))
        for direction in directions
    ]
    guys[3].update(breaks)
    return cp.make_scene(
        {
            "mast": {
                "height": 60.0, "bending_stiffness": 6e7, "mass": 40.0, "drag_area": 0.4, "modes": modes, "damping_ratio": 0.1,
            },
            "cables": {"steel": {"youngs_modulus": 1.5e11, "area": 1.13e-4, "density": 8000.0, "diameter": 0.012}},
            "guy": guys if built else [*guys[:3], *guys[4:]],
            "wind": {"speed": 24.0, "direction": [1.0, 0.0, 0.0]},
            "damping": {"mass_proportional": 0.3},
            "time": {"duration": 60.0, "interval": 0.2},
            "chain": {"links": 16},
        }
    )  # fmt: skip


def settled(run):
    """Mean of the end of a run."""
    return run.sel(time=slice(50.0, None)).mean("time")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:guy... the chordwise force:cablepod.errors.OutOfRangeWarning")  # as the mast swings
@pytest.mark.parametrize("kind", ["condensed", "chain"])
def test_a_mast_whose_guy_breaks_becomes_the_mast_without_it(kind):
    outputs = ("displacement", "bending_moment", "guy_force")
    without = cp.mast.rest(rupture(built=False))
    tops, moments = [], []
    for modes in (4, 16):
        run = settled(cp.mast.simulate(rupture(breaks=2.0, modes=modes), guys=kind, outputs=outputs))
        tops.append(float(run.displacement[-1, 0]))
        moments.append(run.bending_moment[:, 0].values)
        largest = float(abs(without.bending_moment[:, 0]).max())
        # guys of four modes or sixteen links, far from their rest, differ from catenaries by up to 3 %
        assert tops[-1] == pytest.approx(float(without.displacement[-1, 0]), rel=0.035)
        np.testing.assert_allclose(moments[-1], without.bending_moment[:, 0], atol=0.035 * largest)
    assert tops[0] == pytest.approx(tops[1], rel=1e-3)
    np.testing.assert_allclose(
        moments[0], moments[1], atol=2e-3 * largest
    )  # they were 325 and 37 kN m with 8 and 24 modes
    # moment at the lower level by hand: wind, guys and weight above it, at their displaced places
    y = np.linspace(30.0, 60.0, 3001)
    speed = 24.0 * np.log(y / 0.03) / np.log(10.0 / 0.03)
    end = settled(cp.mast.simulate(rupture(breaks=2.0), guys=kind, outputs=outputs))
    x = end.displacement[:, 0]
    upper = end.guy_force[3:].sum("guy").values
    by_hand = np.trapezoid(0.5 * 1.25 * 0.4 * speed**2 * (y - 30.0), y) + upper[0] * 28.0
    by_hand -= upper[1] * float(x.sel(level=58.0) - x.sel(level=30.0))
    by_hand += 40.0 * 9.81 * 30.0 * 0.5 * float(x.sel(level=60.0) - x.sel(level=30.0))  # nearly straight above the guys
    at = int(abs(end.node_height.values - 30.0).argmin())
    assert float(end.bending_moment[at, 0]) == pytest.approx(by_hand, abs=0.02 * largest)
    six = cp.mast.rest(rupture())
    assert float(without.displacement[-1, 0]) > 10.0 * float(six.displacement[-1, 0])


@pytest.mark.slow  # 20 s
def test_slack_guys_are_those_of_finer_chains():
    def gusty(mapping):
        windy(mapping)
        mapping["wind"] = {**WIND, "speed": 55.0, "direction": [-1.0, 0.0, 0.0]}
        mapping["time"].update(duration=60.0, interval=0.05)
        mapping["guy"][0]["top_tension"] = 600.0
        mapping["mast"]["bending_stiffness"] = 2.5e7  # it does not buckle under its guys

    scene = small(gusty)
    chain = cp.mast.simulate(scene, guys="chain", links=20)
    finer = cp.mast.simulate(scene, guys="chain", links=20, step=chain.attrs["step"] / 5.0)
    assert chain.attrs["smallest_tension"] == 0.0  # links go slack
    np.testing.assert_allclose(chain.guy_tension_std, finer.guy_tension_std, rtol=0.01)
    with pytest.warns(OutOfRangeWarning, match="slack"):
        run = cp.mast.simulate(scene, rank=6)
    np.testing.assert_allclose(run.guy_tension_std, finer.guy_tension_std, rtol=0.03)


@pytest.mark.parametrize("kind", ["condensed", "catenary"])
def test_slack_guys_warn(kind):
    def strong(mapping):
        mapping["mast"]["load"][0]["force"] = [5000.0, 0.0, 0.0]
        mapping["mast"]["damping_ratio"] = 0.05

    with pytest.warns(OutOfRangeWarning, match=r"guy\.1: .*slack.*guys=\"chain\""):
        cp.mast.simulate(small(strong), guys=kind)


@pytest.mark.parametrize(
    ("speed", "kind", "ratio"), [(20.0, "catenary", 1.027), (30.0, "catenary", 0.885), (30.0, "chain", 1.0)]
)
def test_static_guys_warn_of_the_drag_that_they_leave_out(speed, kind, ratio):
    def steady(mapping):
        windy(mapping)
        mapping["wind"] = {"speed": speed, "direction": [1.0, 0.0, 0.0]}

    scene = small(steady)
    at_rest = cp.mast.rest(scene).guy_tension[0]
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", OutOfRangeWarning)
        run = cp.mast.simulate(scene, guys=kind, times=[0.0, 0.04])
    said = [str(item.message) for item in caught if "starts with" in str(item.message)]
    np.testing.assert_allclose(run.guy_tension[0, 0] / at_rest, ratio, atol=0.01)
    assert len(said) == (kind == "catenary" and speed > 20.0)
    assert all(text.startswith("guy.1: static guys are catenaries in still air: guy 1 starts with") for text in said)


def test_large_displacements_warn():
    def strong(mapping):
        mapping["mast"]["load"][0]["force"] = [2e5, 0.0, 0.0]
        mapping["mast"]["bending_stiffness"] = 4e8  # it does not buckle under its guys

    with (
        pytest.warns(OutOfRangeWarning, match=r"the mast slopes by .* small slopes"),
        pytest.warns(OutOfRangeWarning, match=r"a guy's end moved"),
        pytest.warns(OutOfRangeWarning, match=r"chord of guy 1 .*goes slack"),
    ):
        run = cp.mast.simulate(small(strong), guys="catenary")
    assert float(abs(run.displacement).max()) > 0.1 * float(small().mast_height)


def test_more_steps_than_memory_holds_are_refused():
    with pytest.raises(SceneError, match=r"^step: given 1e-10 s, .* steps"):
        cp.mast.simulate(small(), step=1e-10)


def test_a_run_that_leaves_the_finite_numbers_stops_and_keeps_its_start():
    def huge(mapping):
        mapping["mast"]["load"][0]["force"] = [1e9, 0.0, 0.0]

    with pytest.raises(RunStopped, match=r"at [0-9.]+ s") as stopped:
        cp.mast.simulate(small(huge))
    assert 0 < stopped.value.partial.sizes["time"] < 101
    assert "incomplete" in stopped.value.partial.attrs


@pytest.mark.filterwarnings("ignore::cablepod.errors.OutOfRangeWarning")  # guy 1 goes slack, the mast slopes
def test_the_default_step_serves_guys_that_become_many_times_as_taut():
    def pulled(mapping):
        mapping["mast"]["load"][0]["force"] = [3000.0, 0.0, 1200.0]
        mapping["guy"][0]["top_tension"] = 1000.0

    run, chain = cp.mast.simulate(small(pulled)), cp.mast.simulate(small(pulled), guys="chain")
    # of the taut guys, to 9 times their tension at rest: 3 % and 1.1 %, for guy 1 resists compression
    np.testing.assert_allclose(run.guy_tension_maximum[1:], chain.guy_tension_maximum[1:], rtol=0.04)
    with pytest.raises(RunStopped, match=r"stability limit of the step 0\.02 s \(guy\.1\)"):  # a given one stays
        cp.mast.simulate(small(pulled), step=2.0 * run.attrs["step"])


def test_archive_keeps_a_run(tmp_path):
    run = cp.mast.simulate(small(), outputs=("displacement", "guy_tension", "guy_force", "bending_moment", "extremes"))
    for name, variable in run.variables.items():
        assert {"units", "long_name"} <= set(variable.attrs), name
    cp.archive.write(run, tmp_path / "run.nc")
    read = cp.archive.read(tmp_path / "run.nc")
    assert read.equals(run)
    assert [stage["function"] for stage in provenance.stages_of(read)] == ["make_scene", "mast.simulate"]


@pytest.mark.parametrize(
    ("options", "key"),
    [
        ({"guys": "springs"}, "guys"),
        ({"rank": 0}, "rank"),
        ({"rank": 4, "guys": "chain"}, "rank"),
        ({"links": 4}, "links"),
        ({"step": 0.013}, "step"),
        ({"step": 0.04, "rank": 20}, "step"),
        ({"times": [0.0, 0.1, 0.3]}, "times"),
        ({"times": [0.1, 0.2]}, "times"),
        ({"outputs": ("position",)}, "outputs"),
        ({"outputs": ("energy",), "guys": "chain"}, "outputs"),
        ({"window": (3.0, 1.0)}, "window"),
        ({"window": (0.0, 9.0)}, "window"),
        ({"window": 3.0}, "window"),
        ({"window": (1.0, 1.001)}, "window"),
        ({"progress": 3}, "progress"),
        ({"tolerance": 0.0}, "tolerance"),
        ({"tolerance": 0.1, "step": 0.01}, "tolerance"),
        ({"modes": cp.make_scene}, "modes"),
        ({"modes": TWO_MODES, "rank": 3}, "rank"),
        ({"modes": modes_of_moves([20.0, 28.0, 0.0], [0.3, 0.0]), "rank": 2}, "rank"),
        ({"modes": modes_of_moves([20.0, 0.0, 0.0], [0.0, 0.0])}, "modes"),
        ({"modes": modes_of_moves([2.0, 28.0, 0.0], [0.3, 0.1])}, "modes: normal_reference"),
    ],
)
def test_invalid_options_are_refused_by_key(options, key):
    with pytest.raises(SceneError, match=rf"^{key}: .*allowed"):
        cp.mast.simulate(small(), **options)


def test_modes_of_a_cable_serve_as_guys():
    guy = {
        "cable": {"youngs_modulus": 1.6e11, "area": 3.8e-5, "density": 8000.0, "top_tension": 5000.0},
        "ends": {"lower": [20.0, 0.0, 0.0], "upper": [0.0, 28.0, 0.0]},
        "chain": {"links": 80},
    }
    modes = cp.condensed.vibration_modes(cp.make_scene(guy), rank=4)
    own, default = (cp.mast.simulate(small(), given, rank=4, step=0.01) for given in (modes, None))
    assert rms(own, default).max() < 0.05


def test_a_deflection_that_no_mode_moves_has_the_modes_of_the_other():
    """Shapes out of the plane of plane snapshots are arbitrary: with them tensions erred by a quarter."""
    planar = modes_of_moves([20.0, 28.0, 0.0], [0.3, 0.1])
    own, of_both = (cp.mast.simulate(small(), modes, step=0.01) for modes in (planar, TWO_MODES))
    assert rms(own, of_both).max() < 1e-6  # sines both, of 40 links
