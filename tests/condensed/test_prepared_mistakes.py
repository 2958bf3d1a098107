"""Prepared models refuse what they cannot do, say when they stop, and keep their state."""

from __future__ import annotations

import math
import re
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from host_scenes import GUY, SPATIAL, prepared, sines, table

import cablepod as cp


@pytest.mark.parametrize(
    ("arguments", "key"),
    [
        (([50.0], [0.0, 0.0], 0.01), "end_position"),
        (([50.0, 35.0, 0.0], [0.0, 0.0], 0.01), "end_position"),
        (("here", [0.0, 0.0], 0.01), "end_position"),
        (([50.0, math.nan], [0.0, 0.0], 0.01), "end_position"),
        (([50.0, 35.0], [[0.0, 0.0]], 0.01), "end_velocity"),
        (([50.0, 35.0], [math.inf, 0.0], 0.01), "end_velocity"),
        (([50.0, 35.0], [0.0, 0.0], 0.0), "step"),
        (([50.0, 35.0], [0.0, 0.0], -0.1), "step"),
        (([50.0, 35.0], [0.0, 0.0], "long"), "step"),
        (([50.0, 35.0], [0.0, 0.0], 5.0), "step"),
        (([50.0, 35.0], [0.0, 0.0], 0.01, [1.0]), "end_acceleration"),
        (([50.0, 35.0], [0.0, 0.0], 0.01, [0.0, math.nan]), "end_acceleration"),
        (([1e200, 35.0], [0.0, 0.0], 0.01), "end_position"),
        (([-50.0, -35.0], [0.0, 0.0], 0.01), "end_position"),
        (([5.0, 3.0], [0.0, 0.0], 0.01), "end_position"),
        (([5.0e4, 35.0], [0.0, 0.0], 0.01), "end_position"),
    ],
)
def test_a_bad_step_is_refused_before_anything_runs(arguments, key):
    guy = prepared(GUY)
    before = guy.state
    guy.trial([50.0, 35.0], [0.0, 0.0], 0.01)  # the bad one takes its place
    with pytest.raises(cp.SceneError, match=rf"^{key}: given .*; allowed: "):
        guy.step(*arguments)
    np.testing.assert_array_equal(guy.state, before)
    with pytest.raises(cp.SceneError, match=r"^accept: "):
        guy.accept()


def test_accept_takes_each_trial_once():
    guy = prepared(GUY)
    guy.step([50.0, 35.0], [0.0, 0.0], 0.01)
    with pytest.raises(cp.SceneError, match=r"^accept: "):
        guy.accept()
    guy.trial([50.0, 35.0], [0.0, 0.0], 0.01)
    guy.state = guy.state
    with pytest.raises(cp.SceneError, match=r"^accept: "):
        guy.accept()
    assert guy.time == 0.01


@pytest.mark.parametrize("state", [None, "rest", np.zeros((2, 2)), math.nan], ids=str)
def test_a_bad_state_is_refused(state):
    guy = prepared(GUY)
    before = guy.state
    with pytest.raises(cp.SceneError, match=r"^state: given .*; allowed: "):
        guy.state = state if state is not math.nan else math.nan * before
    np.testing.assert_array_equal(guy.state, before)


def test_a_chord_along_its_first_normal_is_refused():
    guy = prepared(SPATIAL)
    chord = np.linalg.norm(guy.end_position)
    along = guy.end_position / chord
    up = np.array([0.0, 1.0, 0.0]) - along[1] * along
    normal = up / np.linalg.norm(up)
    with pytest.raises(
        cp.SceneError, match=f"^end_position: .*from the direction {re.escape(str(normal.round(3).tolist()))}"
    ):
        guy.step(chord * (normal + 0.01 * along), np.zeros(3), 0.01)
    with pytest.raises(cp.SceneError, match=r"^end_position: .*pass each other"):
        guy.step(chord * (normal - 0.01 * along), np.zeros(3), 0.01)
    with pytest.raises(cp.RunStopped):  # farther away the frame is no reason, but so large a step is
        guy.step(chord * (np.cos(1.4) * along + np.sin(1.4) * normal), np.zeros(3), 1e-3)


def test_a_motion_that_diverges_says_when_and_keeps_the_accepted_state():
    guy = prepared(GUY)
    position, velocity, _ = table(GUY, 0.01)
    for k in range(1, 11):
        guy.step(position[k], velocity[k], 0.01)
    before = guy.state
    with pytest.raises(cp.RunStopped, match=r"at 0\.14 s; it keeps its last accepted state, of 0\.1 s") as stopped:
        guy.step([5.0e2, 3.5e2], [0.0, 0.0], 0.04)  # ten chords: the tension raises the frequencies above the limit
    np.testing.assert_array_equal(guy.state, before)
    assert stopped.value.partial.attrs["incomplete"].startswith("stopped at 0.14 s")
    np.testing.assert_array_equal(cp.condensed.resume(stopped.value.partial).state, before)
    guy.step(position[11], velocity[11], 0.01)


def test_a_slack_guy_warns_once():
    guy = prepared(GUY)
    with pytest.warns(cp.OutOfRangeWarning, match="slack"):
        guy.step([49.8, 34.8], [0.0, 0.0], 0.01)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        guy.step([49.8, 34.8], [0.0, 0.0], 0.01)
    assert guy.smallest_chordwise_force < 0.0


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"outputs": ("velocity",)}, "outputs: "),
        ({"links": [99], "outputs": ("tension",)}, "links: "),
        ({"times": [-1.0]}, "times: "),
        ({"outputs": None}, "outputs: "),
    ],
)
def test_a_bad_run_is_refused(options, text):
    with pytest.raises(cp.SceneError, match=f"^{text}"):
        prepared(GUY, step=0.01).run(**options)


@pytest.mark.parametrize(
    ("changes", "options", "text"),
    [
        ({"point_load": [{"arc_length": 0.4, "force": [0.0, -20.0]}]}, {}, "point_load.1: "),
        (
            {"load": {"uniform": [1.0, 0.0], "kind": "harmonic", "amplitude": 1.0, "angular_frequency": 3.0}},
            {},
            "load.kind: ",
        ),
        ({"initial": {"top_tension": 5000.0}}, {}, "initial.top_tension: "),
        ({"ends": GUY["ends"] | {"free": "upper"}, "motion": {}}, {}, "ends.free: "),
        *(
            ({}, {"order": order}, f'order: given {order!r}; allowed: "leading"; try: condensed.simulate$')
            for order in ("exact", "inertial", None)
        ),
        ({}, {"rank": 9}, "rank: "),
        ({}, {"step": 1.0}, "step: .*stability"),
    ],
)
def test_what_prepare_lacks_is_refused(changes, options, text):
    with pytest.raises(cp.SceneError, match=f"^{text}"):
        cp.condensed.prepare(cp.make_scene({**GUY, **changes}), sines(4), **options)


#: Values that no argument of a prepared model takes, and some that only few do.
WRONG: list[Any] = [
    None, "a", b"a", math.nan, -math.inf, 1e300, 10**400, 1j, [], [1.0, 2.0, 3.0], {}, {"a": 1}, set(), object(), type,
    np.array(3.0), np.zeros((3, 2)), np.array(["a", "b"]), np.array([1.0, 2.0j]),
    np.array(["2020-01-01"] * 2, dtype="datetime64[D]"),
    np.array([None, 1.0]), np.full(2, np.nan), np.full(2, 1e308), np.zeros(2), [10**400, 0], [None, 1.0], -1, xr.Dataset(),
    xr.DataArray([1.0, 2.0]), slice(3), [[[]]], np.ma.masked_array([50.0, 35.0], mask=[True, False]),
]  # fmt: skip


def test_random_wrong_calls_give_one_clear_error_and_leave_the_state():
    rng, guy, scene, modes = np.random.default_rng(19), prepared(GUY, step=0.02), cp.make_scene(GUY), sines(4)
    guy.step([50.0, 35.0], [0.0, 0.0], 0.01)

    def wrong_step(value: Any) -> Any:
        arguments: list[Any] = [[50.0, 35.0], [0.0, 0.0], 0.01, None]
        arguments[rng.integers(4)] = value
        return lambda: guy.trial(*arguments)

    def wrong_run(value: Any) -> Any:
        options = {
            rng.choice(["times", "outputs", "links"]): value,
            "outputs": ("tension",),
        }
        return lambda: guy.run(**options)

    def wrong_model(value: Any) -> Any:
        options = {"scene": scene, "modes": modes}
        options[rng.choice(["scene", "modes", "rank", "order", "step"])] = value
        return lambda: cp.condensed.prepare(options.pop("scene"), options.pop("modes"), **options)

    makers = [
        wrong_step,
        wrong_run,
        wrong_model,
        lambda value: lambda: cp.condensed.resume(value),
    ]
    before, messages, stops = guy.state, [], []
    for _ in range(300):
        call = makers[rng.integers(len(makers))](WRONG[rng.integers(len(WRONG))])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            try:
                call()
            except cp.SceneError as error:
                messages.append(str(error))
            except cp.RunStopped as error:
                stops.append(str(error))
        np.testing.assert_array_equal(guy.state, before)
    assert len(messages) > 200
    assert [text for text in messages if not re.match(r"\S.*: (.*; allowed: |.*; try: )", text, re.DOTALL)] == []
    assert [text for text in stops if not re.search(r" (at|from) .* s", text)] == []


@pytest.mark.parametrize(
    "make",
    [
        list, tuple, np.float32, lambda value: np.array(value, dtype=">f8"), lambda value: np.array(value * 2)[::2][:2],
        lambda value: np.array(value, dtype=int), lambda value: np.array(value, dtype=object),
    ],
)  # fmt: skip
def test_any_array_of_numbers_gives_the_same_bits(make):
    end, velocity = [50.0, 35.0], [2.0, -1.0]
    given = make(end)
    if isinstance(given, np.ndarray):
        given = given if list(given) == end else np.array([end[0], 0.0, end[1]])[::2]
        given.flags.writeable = False
    expected = prepared(GUY).step(np.array(end), np.array(velocity), 0.01)
    np.testing.assert_array_equal(prepared(GUY).step(given, velocity, 0.01), expected)


def test_velocities_beyond_the_finite_numbers_are_not_accepted():
    guy = prepared(GUY)
    guy.step([50.0, 35.0], [0.0, 0.0], 0.01)
    before = guy.state
    with pytest.raises((cp.RunStopped, cp.SceneError), match=r"0\.02 s; it keeps|end_velocity: "):
        guy.step([50.0, 35.0], [1e307, -1e307], 0.01)
    np.testing.assert_array_equal(guy.state, before)
    assert np.isfinite(guy.step([50.0, 35.0], [0.0, 0.0], 0.01)).all()


def moved(**motion: Any) -> dict[str, Any]:
    """The guy with another motion of its upper end."""
    return {
        **GUY,
        "motion": {"upper": {"x": {"kind": "harmonic", "amplitude": -0.05, "angular_frequency": 0.9} | motion}},
    }


def test_a_run_that_leaves_the_finite_numbers_says_when_and_leaves_the_state():
    guy = prepared(moved(amplitude=20.0), step=0.02)
    guy.step([50.0, 35.0], [0.0, 0.0], 0.01)
    before = guy.state
    with pytest.raises(cp.RunStopped, match=r"(from|at) [0-9.]+ s"):
        guy.run()
    np.testing.assert_array_equal(guy.state, before)


def test_a_step_that_the_start_of_a_run_does_not_allow_is_refused():
    # the end starts with an acceleration along the cable, which tightens it beyond rest
    mapping = {
        **GUY,
        "motion": {"upper": {"x": {"kind": "one_minus_cosine", "amplitude": 1.0, "angular_frequency": 10.0}}},
    }
    guy = prepared(mapping, step=0.999 * prepared(mapping).step_limit)
    with pytest.raises(cp.SceneError, match=r"^step: given .* highest angular frequency"):
        guy.run()


def test_a_run_beyond_its_range_warns():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert prepared(GUY, step=0.02).run().smallest_chordwise_force > 0.0
    slack = prepared(moved(amplitude=-0.4), step=0.02)
    with pytest.warns(cp.OutOfRangeWarning, match="goes slack"):
        assert slack.run().smallest_chordwise_force < 0.0
    fast = prepared(moved(amplitude=1e-4, angular_frequency=150.0), step=0.02)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        fast.run()
    assert [warning.category for warning in caught] == [cp.NotConvergedWarning, cp.OutOfRangeWarning]
    assert "does not resolve" in str(caught[0].message)
    assert "waves along the cable" in str(caught[1].message)
    assert {Path(warning.filename).name for warning in caught} == {Path(__file__).name}  # the caller's own line


def test_members_and_other_datasets_are_refused(tmp_path):
    scene = cp.make_scene(GUY)
    members = cp.ensemble.design(scene, {"cable.top_tension": [7000.0, 8000.0]}, members=2)
    with pytest.raises(cp.SceneError, match=r"^scene: "):
        cp.condensed.prepare(members, sines(2))
    for other in (scene, "guy.nc", prepared(GUY).dataset().drop_attrs()):
        with pytest.raises(cp.SceneError, match=r"^dataset: .*prepared model"):
            cp.condensed.resume(other)


def test_a_dataset_of_altered_variables_is_refused():
    guy = prepared(GUY, step=0.01)
    guy.step([50.0, 35.01], [0.0, 1.0], 0.01)
    dataset = guy.dataset()
    altered = {
        key: dataset.assign({key: dataset[key] * 1.001}) for key in ("end_position", "end_force", "amplitude", "state")
    }
    altered |= {key: dataset.assign({key: dataset[key] * 2}) for key in dataset.variables if "coefficient" in key}
    altered = {key: value for key, value in altered.items() if dataset[key].size}
    altered["time"] = dataset.assign_coords(time=3.0)
    altered["coefficient_numbers: "] = dataset.assign(scene_cable_area=dataset.scene_cable_area * 2)
    altered["coefficient_numbers: given"] = dataset.assign(modes_mode_shape=dataset.modes_mode_shape**3)
    altered["step"] = dataset.assign_attrs(step=5.0)
    assert len(altered) > 10
    for key, value in altered.items():
        with pytest.raises(cp.SceneError, match=f"^{key}"):
            cp.condensed.resume(value)
    lacking = [dataset.drop_vars(key) for key in ("state", "coefficient_numbers", "end_force")]
    lacking += [dataset.assign_attrs({key: "?"}) for key in ("rank", "step", "scene_attributes_json")]
    for value in lacking:
        with pytest.raises(cp.SceneError, match=r"^dataset: "):
            cp.condensed.resume(value)


def test_resume_takes_the_stored_coefficients_to_the_last_bit():
    # another machine may round the modes' eigenproblem differently
    dataset = prepared(GUY).dataset()
    rounded = dataset.assign(coefficient_by_coordinate=dataset.coefficient_by_coordinate * (1.0 + 1e-14))
    again = cp.condensed.resume(rounded)
    np.testing.assert_array_equal(again.coefficients.by_coordinate, rounded.coefficient_by_coordinate.values)
    assert (again.coefficients.by_coordinate != prepared(GUY).coefficients.by_coordinate).any()


def test_a_moving_lower_end_is_for_runs_only():
    mapping = {**GUY, "motion": {"lower": {"x": {"kind": "harmonic", "amplitude": 0.02, "angular_frequency": 2.0}}}}
    guy = prepared(mapping, step=0.01)
    with pytest.raises(cp.SceneError, match=r"^motion\.lower\.x: "):
        guy.step([50.0, 35.0], [0.0, 0.0], 0.01)
    truth = cp.condensed.simulate(cp.make_scene(mapping), sines(4), step=0.01, outputs=("position",))
    assert np.abs(guy.run(outputs=("position",)).position - truth.position.values).max() < 1e-9
