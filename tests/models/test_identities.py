"""What holds for every model and scheme: its order, rest, planes, mirror images, units, members, instants."""

from __future__ import annotations

import copy
import math
import re
from typing import Any

import numpy as np
import pytest
import xarray as xr
from convergence import distances, orders
from scenes import RIGID_CABLE, SOFT, everything, full_modes, spatial
from suite import with_slow

import cablepod as cp
from cablepod.conventions import ATTRIBUTES

#: Ways to run a model: options, step [s], order of the scheme.
CASES: dict[str, tuple[dict[str, Any], float, float]] = {
    "chain velocity_verlet": ({}, 1e-3, 2.0),
    "chain velocity_verlet green": ({"law": "green"}, 1.25e-4, 2.0),
    "chain trapezoidal": ({}, 2e-3, 2.0),
    "chain generalized_alpha": ({}, 2e-3, 2.0),
    "chain energy_momentum": ({}, 2e-3, 2.0),
    "cable velocity_verlet": ({"elements": 3, "law": "linear", "order": 3}, 5e-4, 2.0),
    "cable trapezoidal": ({"elements": 3, "law": "linear", "order": 3}, 5e-4, 2.0),
    "rigid rattle": ({}, 2e-3, 2.0),
    "rigid index1": ({}, 5e-3, 4.0),
    "galerkin velocity_verlet": ({}, 2.5e-4, 2.0),
    "galerkin filtered_verlet": ({}, 1e-3, 2.0),
    "galerkin trapezoidal": ({}, 1.25e-4, 2.0),
    "condensed velocity_verlet": ({}, 1e-3, 2.0),
    "condensed numerov": ({}, 1e-2, 4.0),
    "condensed trapezoidal": ({}, 1e-3, 2.0),
    "condensed velocity_verlet exact": ({"order": "exact"}, 1e-3, 2.0),
    "condensed trapezoidal exact": ({"order": "exact"}, 1e-3, 2.0),
    "condensed velocity_verlet inertial": ({"order": "inertial"}, 1e-3, 2.0),
    "condensed trapezoidal inertial": ({"order": "inertial"}, 1e-3, 2.0),
}
MODES = {"galerkin": "separate", "condensed": "normal"}
EVERY = ("position", "velocity", "tension", "tension_extremes")
EVERY_VARIABLE = (*EVERY[:3], "tension_minimum", "tension_maximum")
#: Of these a planar and a spatial run give the same bits.
BIT_FOR_BIT = ("chain velocity_verlet", "cable", "rigid")
# the modes are of another cable, and few
pytestmark = pytest.mark.filterwarnings("ignore::cablepod.OutOfRangeWarning")


def scene_of(case: str, dims: int = 2) -> dict[str, Any]:
    """The mapping of a soft scene with the terms that the reduced models know, in the plane or in space.

    Explicit chains are compiled for each combination: without damping in space and by law (21), as other tests have them.
    """
    mapping = everything(copy.deepcopy(SOFT), 2)
    if case.startswith("rigid"):
        mapping["cable"] = RIGID_CABLE
    if case.startswith(
        ("chain", "cable")
    ):  # whose links a jump of the velocity would make ring, faster than steps resolve
        for motions in mapping["motion"].values():
            for axis, motion in motions.items():
                motions[axis] = {**motion, "ramp": 0.5}
    if "green" in case or (case.startswith("chain velocity_verlet") and dims == 3):
        del mapping["damping"]
    return mapping if dims == 2 else spatial(mapping)


def turned(mapping: dict[str, Any], turn: np.ndarray) -> dict[str, Any]:
    """A spatial scene turned about the vertical."""
    result = copy.deepcopy(mapping)
    result["ends"] = {end: (turn @ place).tolist() for end, place in mapping["ends"].items()}
    for load in (result["load"], *result["point_load"]):
        for key in {"uniform", "force"} & set(load):
            load[key] = (turn @ load[key]).tolist()
    x = mapping["motion"]["upper"]["x"]
    result["motion"]["upper"] = {
        axis: {**x, "amplitude": turn[k, 0] * x["amplitude"]} for axis, k in (("x", 0), ("z", 2))
    }
    return result


@pytest.fixture(scope="module")
def modes():
    """Modes of both layouts, in the plane and in space."""
    found = {}
    for dims in (2, 3):
        run = cp.chain.simulate(cp.make_scene(scene_of("galerkin", dims)), scheme="trapezoidal", step=5e-3)
        found["galerkin", dims] = cp.pod.decompose(run)
        found["condensed", dims] = full_modes(dims=dims).assign(mode_shape=full_modes().mode_shape)
    return found


@pytest.fixture
def simulate(modes):
    """Run a case on a scene, or on the mapping of one, by its own step times a factor."""

    def run(case: str, scene: Any, *, longer: float = 1.0, **options: Any) -> xr.Dataset:
        model, scheme, *_ = case.split()
        own, step, _ = CASES[case]
        scene = scene if isinstance(scene, xr.Dataset) else cp.make_scene(scene)
        given = [modes[model, scene.sizes["coordinate"]]] if model in MODES else []
        own = own | {"formulation" if model == "rigid" else "scheme": scheme}
        own |= {"rank": 3} if given else {}
        outputs = ("position", "tension_extremes") if "green" in case else ("position",)
        options = own | {"step": longer * step, "outputs": outputs} | options
        return getattr(cp, model).simulate(scene, *given, **options)

    return run


def test_every_model_and_scheme_is_here(simulate):
    models = {name for name in dir(cp) if hasattr(getattr(cp, name), "simulate")} - {"mast"}
    assert {case.split()[0] for case in CASES} == models
    for model in models:
        schemes = {case.split()[1] for case in CASES if case.startswith(model)}
        case = next(case for case in CASES if case.startswith(model))
        option = "formulation" if model == "rigid" else "scheme"
        with pytest.raises(cp.SceneError, match=f"^{option}: given 'euler'; allowed: ") as refused:
            simulate(case, scene_of(case), **{option: "euler"})
        assert (
            set(re.findall(r"\w+_?\w*", str(refused.value).partition("allowed: ")[2])) - {"one", "of", "or"} == schemes
        )


#: Explicit steps of the condensed model are compiled for its number of modes, which the other tests leave out; those of fourth
#: order are in condensed/test_kernels.py.
BY_NUMBER = ("condensed velocity_verlet",)


@pytest.mark.parametrize(
    "case", [pytest.param(case, marks=pytest.mark.constant_sizes) if case in BY_NUMBER else case for case in CASES]
)
def test_the_scheme_has_its_order(case, simulate):
    order = CASES[case][2]
    runs = [simulate(case, scene_of(case), times=[0.5, 1.0, 2.0], longer=0.5**i) for i in range(4)]
    found = orders(distances([run.position for run in runs]))
    np.testing.assert_allclose(found, order, atol=0.1 * order)


@pytest.mark.parametrize("case", CASES)
def test_what_rests_stays_at_rest(case, simulate):
    still = scene_of(case) | {"motion": {}, "load": {"uniform": [3.0, -2.0]}}
    still["point_load"] = still["point_load"][:1]
    run = simulate(case, still, times=np.arange(5.0))
    # rounding of the rest, 1e-15 of 10 m times k/k, set swinging
    assert float(np.abs(run.position - run.position[0]).max()) < 1e-11


@pytest.mark.parametrize("case", with_slow(CASES, "chain velocity_verlet green", "rigid rattle", "rigid index1"))
def test_a_plane_in_space_is_a_plane(case, simulate):
    times, wide = [0.0, 0.2, 0.5001], scene_of(case, 3)
    narrow = scene_of(case)
    if "damping" not in wide:
        narrow.pop("damping", None)
    same = case.startswith(BIT_FOR_BIT)
    flat, deep = (simulate(case, scene, times=times, outputs=EVERY[: None if same else 1]) for scene in (narrow, wide))
    # blocks of two and three unknowns are eliminated in another order, and so are sums over modes
    rounding = 0.0 if same else 1e-10
    np.testing.assert_allclose(deep.position[..., :2], flat.position, rtol=0, atol=rounding)
    np.testing.assert_allclose(deep.position[..., 2], 0.0, atol=1e-3 * rounding)
    for name in EVERY_VARIABLE if same else ():
        values = deep[name].values[..., :2] if "coordinate" in deep[name].dims else deep[name].values
        np.testing.assert_array_equal(values, flat[name], err_msg=name)
    if case.startswith("galerkin"):  # whose modes of single coordinates do not turn
        return
    cosine, sine = 0.6, 0.8
    turn = np.array([[cosine, 0.0, -sine], [0.0, 1.0, 0.0], [sine, 0.0, cosine]])
    other = simulate(case, turned(wide, turn), times=times)
    # rounding of the turned ends, 1e-15, and of their motion, grown over some hundred steps
    np.testing.assert_allclose(other.position, deep.position.values @ turn.T, rtol=0, atol=1e-10)


#: The mean shape of the modes of the Galerkin model would have to be changed too, as properties/test_identities.py does.
BY_SCENE_ALONE = [case for case in CASES if not case.startswith("galerkin")]


@pytest.mark.parametrize("case", BY_SCENE_ALONE)
def test_a_mirrored_scene_moves_as_its_mirror_image(case, simulate):
    mapping = scene_of(case)
    mirrored = copy.deepcopy(mapping)
    mirrored["ends"]["upper"][0] *= -1.0
    mirrored["load"]["uniform"][0] *= -1.0
    for load in mirrored["point_load"]:
        load["force"][0] *= -1.0
    mirrored["motion"]["upper"]["x"]["amplitude"] *= -1.0
    run, image = (simulate(case, given, times=[0.3, 0.5]) for given in (mapping, mirrored))
    # rounding of the mirrored rest and of some hundred steps
    np.testing.assert_allclose(image.position * [-1.0, 1.0], run.position, rtol=0, atol=1e-11)
    if case.startswith("condensed"):
        np.testing.assert_allclose(image.amplitude, -run.amplitude, rtol=0, atol=1e-11)


@pytest.mark.parametrize("case", [case for case in CASES if case.startswith(("chain", "rigid"))])
def test_a_free_lower_end_is_a_free_upper_end_seen_from_the_other_side(case, simulate):
    ratios, (lower, upper) = [1.0, 2.0, 3.0, 1.5], ([0.0, 0.0], [8.0, 6.0])
    given = seen = RIGID_CABLE
    if case.startswith("chain"):
        given, seen = SOFT["cable"], {**SOFT["cable"], "bottom_tension": SOFT["cable"]["top_tension"]}
        del seen["top_tension"]
    still = {**SOFT, "motion": {}}
    scenes = (
        {**still, "cable": given, "ends": {"lower": lower, "upper": upper, "free": "upper"}, "chain": {"link_lengths": ratios}},
        {
            **still, "cable": seen, "ends": {"lower": upper, "upper": lower, "free": "lower"},
            "chain": {"link_lengths": ratios[::-1]},
        },
    )  # fmt: skip
    run, other = (simulate(case, scene, times=[0.2, 0.4], outputs=("position", "tension_extremes")) for scene in scenes)
    # rounding of the rest and of sums in the other order, 1e-15 of 10 m, over 400 steps of a motion that is not chaotic yet
    np.testing.assert_allclose(other.position[:, ::-1], run.position, rtol=0, atol=1e-11)
    np.testing.assert_allclose(other.tension_maximum[::-1], run.tension_maximum, rtol=1e-8)


def in_other_units(table: Any, of_key: dict[str, float]) -> Any:
    """Nested tables whose numbers are multiplied by the factors of their keys."""
    if isinstance(table, dict):
        return {key: in_other_units(value, {**of_key, "": of_key.get(key, 1.0)}) for key, value in table.items()}
    if isinstance(table, list):
        return [in_other_units(value, of_key) for value in table]
    return table * of_key[""] if isinstance(table, float) else table


def factor_of(units: str) -> float:
    """The factor of numbers with these units, as "kg m-1", in the units of the test below."""
    parts = re.findall(r"([A-Za-z]+)(-?\d*)", units)
    return math.prod(UNITS[name] ** int(power or 1) for name, power in parts)


#: Of the units of a scene in other ones.
METRE, KILOGRAM, SECOND = 3.0, 7.0, 0.6
NEWTON = KILOGRAM * METRE / SECOND**2
UNITS = {"m": METRE, "kg": KILOGRAM, "s": SECOND, "N": NEWTON, "J": NEWTON * METRE, "rad": 1.0}
OF_KEY = {
    "gravity": METRE / SECOND**2, "youngs_modulus": NEWTON / METRE**2, "area": METRE**2, "density": KILOGRAM / METRE**3,
    "top_tension": NEWTON, "unstretched_length": METRE, "lower": METRE, "upper": METRE, "uniform": NEWTON / METRE,
    "force": NEWTON, "angular_frequency": 1.0 / SECOND, "ramp": SECOND, "mass_proportional": 1.0 / SECOND,
    "duration": SECOND, "interval": SECOND,
}  # fmt: skip


@pytest.mark.parametrize("case", BY_SCENE_ALONE)
def test_units_do_not_matter(case, simulate):
    mapping = {"gravity": 9.81} | scene_of(case)
    scaled = in_other_units({**mapping, "motion": {}}, OF_KEY)
    scaled["motion"] = in_other_units(mapping["motion"], OF_KEY | {"amplitude": METRE})  # those of loads are factors
    outputs = ("position", "velocity", "tension") if case.startswith("condensed") else ("position", "tension_extremes")
    run, other = (
        simulate(case, given, times=unit * np.array([0.3, 0.5]), longer=unit, outputs=outputs)
        for given, unit in ((mapping, 1.0), (scaled, SECOND))
    )
    # other numbers are rounded otherwise: by 3e-11 in velocities after 500 implicit steps, by 4e-12 in tensions
    for name, values in run.data_vars.items():
        if values.dtype.kind == "f":
            found, size = other[name] / factor_of(values.units), float(np.abs(values).max())
            np.testing.assert_allclose(found, values, rtol=0, atol=1e-10 * size, err_msg=str(name))
    numbers = {name: value for name, value in run.attrs.items() if isinstance(value, float) and name in ATTRIBUTES}
    assert "step" in numbers
    for name, value in numbers.items():
        found = other.attrs[name] / factor_of(ATTRIBUTES[name][0])
        assert found == pytest.approx(value, rel=1e-9, abs=1e-12), name


@pytest.mark.parametrize("case", CASES)
def test_an_instant_depends_on_no_other_and_inputs_stay(case, simulate, modes):
    scene, step = cp.make_scene(scene_of(case)), CASES[case][1]
    before = scene.copy(deep=True), {key: value.copy(deep=True) for key, value in modes.items()}
    every = simulate(case, scene, times=np.arange(round(1.0 / step) + 1) * step, outputs=EVERY)
    few = simulate(case, scene, times=[0.5, 1.0], outputs=EVERY)
    alone = simulate(case, scene, times=[1.0])
    # positions of the condensed model follow from its amplitudes, at all instants together in the order "exact"
    state = "amplitude" if "condensed" in case else "position"
    for name in (state,) if "condensed" in case else EVERY[:3]:
        np.testing.assert_array_equal(few[name], every[name][[round(0.5 / step), -1]], err_msg=name)
    np.testing.assert_array_equal(alone[state], few[state][1:])
    for name, extreme in (
        ("tension_maximum", every.tension.max("time")),
        ("tension_minimum", every.tension.min("time")),
    ):
        np.testing.assert_allclose(few[name], every[name], rtol=1e-12, err_msg=name)
        # of all steps; the closure of the condensed model begins with another guess, which rounds otherwise
        np.testing.assert_allclose(
            every[name], extreme, rtol=1e-9, atol=1e-9 * float(every.tension.max()), err_msg=name
        )
    start = simulate(case, scene, times=[0.0])
    np.testing.assert_array_equal(start[state][0], every[state][0])
    assert start.attrs["number_of_steps"] == 0
    assert few.attrs["number_of_steps"] * few.attrs["step"] == pytest.approx(1.0)
    xr.testing.assert_identical(scene, before[0])
    for key, value in modes.items():
        xr.testing.assert_identical(value, before[1][key])


@pytest.mark.parametrize("case", CASES)
def test_members_are_their_single_runs(case, simulate):
    scene = cp.make_scene(scene_of(case))
    key, values = ("unstretched_length", [10.6, 11.5]) if case.startswith("rigid") else ("top_tension", [250.0, 320.0])
    scenes = cp.ensemble.design(scene, {f"cable.{key}": [*values, 2]})
    before = scenes.copy(deep=True)
    both = simulate(case, scenes, times=[0.0, 0.5])
    xr.testing.assert_identical(scenes, before)
    assert both.position.dims == ("member", "time", "particle", "coordinate")
    np.testing.assert_array_equal(both[f"cable_{key}"], values)
    for i in range(2):
        alone = simulate(case, scenes.isel(member=i, drop=True), times=[0.0, 0.5])
        # the condensed model scales its coefficients from one member to another, which rounds otherwise
        np.testing.assert_allclose(both.position[i], alone.position, rtol=0, atol=1e-12 if "condensed" in case else 0.0)
    assert float(np.abs(both.position[1] - both.position[0]).max()) > 1e-3
