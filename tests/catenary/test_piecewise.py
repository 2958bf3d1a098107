"""Cables of several segments with masses on them at rest, against a closed form in 40 digits and an ODE solver."""

from __future__ import annotations

import itertools
import math
from typing import Any

import numpy as np
import pytest
from references import hanging_mass_mpmath as reference
from scipy.integrate import solve_ivp
from scipy.optimize import root

import cablepod as cp

MP = reference.MP
SPAN, RISE, GRAVITY = 20.4, 57.7, 9.81
CABLE = {"youngs_modulus": 1.6e11, "area": 1.25e-4, "density": 8000.0}
#: A wire of the upper part, and an insulator between the two.
WIRE, MASS = {"youngs_modulus": 1.1e11, "area": 9e-5, "density": 7000.0}, 60.0
#: Rounding of the length of a taut cable, 1e-16, grows by K/T = 1e3 to 1e4 in its tension.
RTOL = 1e-12


def scene(tables: dict[str, Any], **length: float) -> Any:
    """Make a guy with segments and attachments."""
    ends = {"lower": [0.0, 0.0], "upper": [SPAN, RISE]}
    return cp.make_scene({"cable": {**CABLE, **length}, "ends": ends, **tables})


def stiffness_and_weight(cable: dict[str, float]) -> tuple[Any, Any]:
    """Return K [N] and w [N/m] of a cable."""
    area = MP.mpf(cable["area"])
    return cable["youngs_modulus"] * area, cable["density"] * area * GRAVITY


HUNG = {
    "mass by fraction": {"attachment": [{"arc_length": 0.3, "mass": MASS}]},
    "mass by distance": {"attachment": [{"distance_from_upper": 6.0, "mass": MASS}]},
    "parts": {"segment": [{"to": 0.35}, {"from": 0.35, **WIRE}]},
    "parts and mass": {
        "segment": [{"to": 0.35}, {"from": 0.35, **WIRE}],
        "attachment": [{"distance_from_lower": 0.5, "mass": MASS}],
    },
}


def parts_of(name: str) -> reference.Parts:
    """Return the parts of a cable of :data:`HUNG` for the reference."""
    (k1, w1), (k2, w2) = stiffness_and_weight(CABLE), stiffness_and_weight(WIRE)
    load = MP.mpf(MASS) * GRAVITY
    return {
        "mass by fraction": lambda length: [(0.3 * length, k1, w1, load), (0.7 * length, k1, w1, 0)],
        "mass by distance": lambda length: [(length - 6, k1, w1, load), (MP.mpf(6), k1, w1, 0)],
        "parts": lambda length: [(0.35 * length, k1, w1, 0), (0.65 * length, k2, w2, 0)],
        "parts and mass": lambda length: [
            (MP.mpf(0.5), k1, w1, load),
            (0.35 * length - 0.5, k1, w1, 0),
            (0.65 * length, k2, w2, 0),
        ],
    }[name]


GIVEN = {"unstretched_length": 61.3, "top_tension": 15000.0, "bottom_tension": 9000.0, "horizontal_force": 4000.0}
SLACK = {"unstretched_length": 75.0, "horizontal_force": 200.0}


@pytest.mark.parametrize("name", HUNG)
@pytest.mark.parametrize(("key", "value"), [*GIVEN.items(), *SLACK.items()])
def test_hanging_mass_and_parts_by_the_closed_form(name: str, key: str, value: float) -> None:
    rest = cp.catenary.rest(scene(HUNG[name], **{key: value}))
    force, below = float(rest.horizontal_force), float(rest.tension_lower)
    vertical = math.copysign(math.sqrt(below**2 - force**2), float(rest.position[1, 1] - rest.position[0, 1]))
    start = [force, vertical, float(rest.unstretched_length)]
    h, v0, v1, length = reference.solve(parts_of(name), SPAN, RISE, key, value, start)
    expected = np.array([length, h, MP.hypot(h, v0), MP.hypot(h, v1)], dtype=float)
    found = [float(rest[each]) for each in ("unstretched_length", "horizontal_force", "tension_lower", "tension_upper")]
    np.testing.assert_allclose(found, expected, rtol=RTOL if key == "unstretched_length" else 1e-13)


def test_mass_on_a_level_cable_hangs_at_the_kink_and_rest_tells_its_shape() -> None:
    made = cp.make_scene(
        {
            "cable": {**CABLE, "unstretched_length": 52.0},
            "ends": {"lower": [0.0, 0.0], "upper": [50.0, 0.0]},
            "attachment": [{"arc_length": 0.5, "mass": 100.0}],
        }
    )
    rest = cp.catenary.rest(made, points=101)
    weight = 52.0 * float(CABLE["density"]) * CABLE["area"] * GRAVITY + 100.0 * GRAVITY
    lower, upper = rest.position.values[[0, -1]]
    np.testing.assert_allclose(np.concatenate([lower, upper]), [0.0, 0.0, 50.0, 0.0], atol=1e-12)
    assert float(rest.position[50, 0]) == pytest.approx(25.0, abs=1e-12)
    vertical = math.sqrt(float(rest.tension_lower) ** 2 - float(rest.horizontal_force) ** 2)
    assert vertical == pytest.approx(weight / 2.0, rel=1e-12)
    assert int(np.argmin(rest.position.values[:, 1])) == 50
    chords = np.sqrt((np.diff(rest.position.values, axis=0) ** 2).sum(axis=1)).sum()
    assert float(rest.stretched_length) == pytest.approx(chords, rel=1e-6)  # chords of 101 points are that much shorter


def in_space(seed: int) -> Any:
    """Make a cable in space under a load across its weight, so that no two parts have loads in one direction."""
    rng = np.random.default_rng(seed)
    segments = [
        {"to": 0.2, "density": 900.0},
        {"to": 0.7, "area": 3e-4},
        {"density": float(rng.uniform(5e3, 2e4)), "youngs_modulus": 2e10},
    ]
    attachments = [
        {"arc_length": float(rng.uniform(0.1, 0.9)), "mass": float(rng.uniform(1.0, 300.0))},
        {"distance_from_upper": 3.0, "mass": 5.0},
    ]
    upper = [30.0, float(rng.uniform(-40.0, 40.0)), 15.0]
    length = math.hypot(*upper) * float(rng.uniform(0.999, 1.3))
    return {
        "cable": {**CABLE, "unstretched_length": length},
        "ends": {"lower": [0.0, 0.0, 0.0], "upper": upper},
        "segment": segments,
        "attachment": attachments,
        "load": {"uniform": [3.0, 0.0, -7.0]},
    }


@pytest.mark.parametrize("seed", range(5))
def test_loads_in_several_directions_by_an_ode_solver(seed: int) -> None:
    """Integrate along the cable from its lower end, and seek the force there that leads to the upper one."""
    tables = in_space(seed)
    rest = cp.catenary.rest(cp.make_scene(tables), points=33)
    total, places = tables["cable"]["unstretched_length"], rest.arc_length.values[:-1]
    borders = np.array([0.0, 0.2, 0.7, 1.0]) * total
    first, second = tables["attachment"]
    masses = {first["arc_length"] * total: first["mass"], total - 3.0: second["mass"]}

    def shoot(force: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return positions and stretched length at the places and the upper end (places + 1, 4), and the force there."""
        state, found = np.zeros(4), []
        for low, high in itertools.pairwise(sorted({*borders, *masses})):
            part = CABLE | tables["segment"][int(np.searchsorted(borders, 0.5 * (low + high))) - 1]
            stiffness = part["youngs_modulus"] * part["area"]
            load = np.array([3.0, -part["density"] * part["area"] * GRAVITY, -7.0])

            def slope(s: float, _: np.ndarray) -> np.ndarray:
                here = force - load * (s - low)  # noqa: B023
                tension = np.sqrt(here @ here)
                return np.append(here / tension + here / stiffness, 1.0 + tension / stiffness)  # noqa: B023

            at = np.append(places[(places >= low) & (places < high)], high)
            values = solve_ivp(slope, (low, high), state, "DOP853", at, rtol=1e-12, atol=1e-12).y.T
            found += [*values[:-1]]
            state = values[-1]
            force = force - load * (high - low) + [0.0, masses.get(high, 0.0) * GRAVITY, 0.0]
        return np.array([*found, state]), force

    ends = np.subtract(tables["ends"]["upper"], tables["ends"]["lower"])
    along = np.diff(rest.position.values[:2], axis=0)[0]
    guess = float(rest.tension_lower) * along / np.linalg.norm(along)
    below = root(lambda force: shoot(force)[0][-1, :3] - ends, guess, tol=1e-13).x
    expected, above = shoot(below)
    np.testing.assert_allclose(rest.position, expected[:, :3], rtol=0.0, atol=1e-9)  # tolerance of the ODE solver, 50 m
    # rounding of positions is worth up to K/T of it in the forces of a taut cable
    assert float(rest.tension_lower) == pytest.approx(np.linalg.norm(below), rel=1e-8)
    assert float(rest.tension_upper) == pytest.approx(np.linalg.norm(above), rel=1e-8)
    assert float(rest.stretched_length) == pytest.approx(expected[-1, 3], rel=1e-11)
    for key, name in (("top_tension", "tension_upper"), ("bottom_tension", "tension_lower"), ("horizontal_force",) * 2):
        cable = {**CABLE, key: float(rest[name])}
        again = cp.catenary.rest(cp.make_scene({**tables, "cable": cable}))
        assert float(again[name]) == pytest.approx(float(rest[name]), rel=1e-12)
        assert float(again.unstretched_length) <= total * (1.0 + 1e-12)  # the shorter one of two


#: Parts that differ in a diameter alone, on which nothing depends in still air.
EQUAL = {"segment": [{"to": 0.3, "diameter": 0.01}, {"diameter": 0.02}]}
NUMBERS = ("unstretched_length", "stretched_length", "horizontal_force", "tension_lower", "tension_upper")


def assert_parts_change_nothing(key: str, value: float, rtol: float) -> Any:
    """Compare the cable of equal parts with the uniform one, which is returned."""
    uniform, cut = (cp.catenary.rest(scene(tables, **{key: value})) for tables in ({}, EQUAL))
    for name in NUMBERS:
        np.testing.assert_allclose(cut[name], uniform[name], rtol=rtol, err_msg=name)
    return uniform


@pytest.mark.parametrize("length", [60.0, 61.156, 61.3, 65.0, 300.0])
def test_equal_parts_are_a_uniform_cable(length: float) -> None:
    uniform = assert_parts_change_nothing("unstretched_length", length, RTOL)
    for key, name in (("top_tension", "tension_upper"), ("bottom_tension", "tension_lower"), ("horizontal_force",) * 2):
        assert_parts_change_nothing(key, float(uniform[name]), 1e-13)
    with pytest.raises(cp.SceneError, match=r"^cable\.top_tension: given 500\.0; allowed: at least 628\.132 N"):
        scene(EQUAL, top_tension=500.0)


def test_ice_grows_after_tensioning() -> None:
    tables = {
        "segment": [{"to": 0.4, "diameter": 0.02}, {"diameter": 0.01}],
        "attachment": [{"arc_length": 0.5, "mass": MASS}],
    }
    bare = cp.catenary.rest(scene(tables, top_tension=15000.0, diameter=0.014))
    tables["ice"] = {"thickness": 0.02}
    iced = cp.catenary.rest(scene(tables, top_tension=15000.0, diameter=0.014))
    assert float(iced.unstretched_length) == float(bare.unstretched_length)
    ice = 700.0 * math.pi * 0.02 * (0.4 * (0.02 + 0.02) + 0.6 * (0.01 + 0.02)) * float(bare.unstretched_length)

    def vertical(rest: Any) -> float:
        ends = (
            math.sqrt(float(rest[end]) ** 2 - float(rest.horizontal_force) ** 2)
            for end in ("tension_lower", "tension_upper")
        )
        lower, upper = ends
        return upper - lower

    assert vertical(iced) - vertical(bare) == pytest.approx(GRAVITY * ice, rel=1e-9)  # differences of forces of 15 kN


def test_what_no_cable_has_is_refused_by_key() -> None:
    mass = {"attachment": [{"arc_length": 0.4, "mass": MASS}]}
    with pytest.raises(
        cp.SceneError, match=r"^cable\.top_tension: given 800\.0; allowed: at least \d+\.\d+ N"
    ) as error:
        scene(mass, top_tension=800.0)
    least = float(str(error.value).split("at least ")[1].split(" N")[0])
    scene(mass, top_tension=least * (1.0 + 1e-5))
    with pytest.raises(
        cp.SceneError, match=r"^attachment\.1\.distance_from_lower: given 70\.0; allowed: at most 61\.\d+ m"
    ):
        scene({"attachment": [{"distance_from_lower": 70.0, "mass": MASS}]}, top_tension=15000.0)
    upright = {"cable": {**CABLE, "horizontal_force": 10.0}, "ends": {"lower": [0.0, 0.0], "upper": [0.0, 50.0]}}
    with pytest.raises(cp.SceneError, match=r"^cable\.horizontal_force: given 10\.0; allowed: a tension or a length"):
        cp.make_scene({**upright, **mass})
    slack = {"cable": {**CABLE, "unstretched_length": 60.0}, "ends": {"lower": [0.0, 0.0], "upper": [0.0, 50.0]}}
    with pytest.raises(
        cp.SceneError, match=r"^cable\.unstretched_length: given 60\.0; allowed: at most the chord, 50 m"
    ):
        cp.make_scene({**slack, **mass, "gravity": 0.0})


def test_vertical_cable_with_a_mass_hangs_folded() -> None:
    ends = {"lower": [0.0, 0.0], "upper": [0.0, 50.0]}
    mass = [{"arc_length": 0.4, "mass": MASS}]
    rest = cp.catenary.rest(
        cp.make_scene({"cable": {**CABLE, "unstretched_length": 60.0}, "ends": ends, "attachment": mass})
    )
    w, force = float(CABLE["density"]) * CABLE["area"] * GRAVITY, MASS * GRAVITY
    # the mass hangs on the upper part; the lower part, longer than the height of the mass, hangs folded between it and the end
    total = float(rest.tension_upper) + float(rest.tension_lower)
    assert total == pytest.approx(60.0 * w + force, rel=1e-12)
    assert float(rest.position[-1, 1]) == pytest.approx(50.0, rel=1e-13)


def test_members_have_their_own_places() -> None:
    made = scene(
        {"segment": [{"to": 0.4}, dict(WIRE)], "attachment": [{"arc_length": 0.5, "mass": 1.0}]}, top_tension=15000.0
    )
    values = {"segment.1.to": [0.3, 0.6], "attachment.1.arc_length": [0.2, 0.8], "attachment.1.mass": [10.0, 90.0]}
    rest = cp.catenary.rest(cp.ensemble.design(made, values, members=2, sampling="list"))
    for k in range(2):
        tables = {
            "segment": [{"to": values["segment.1.to"][k]}, dict(WIRE)],
            "attachment": [
                {"arc_length": values["attachment.1.arc_length"][k], "mass": values["attachment.1.mass"][k]}
            ],
        }
        alone = cp.catenary.rest(scene(tables, top_tension=15000.0))
        np.testing.assert_array_equal(rest.position[k], alone.position)


def test_sag_is_that_of_the_rest_and_gives_the_length() -> None:
    tables = HUNG["parts and mass"]
    rest = cp.catenary.rest(scene(tables, sag=0.8), points=4001)
    x, y = rest.position.values.T
    # points of 15 mm near the largest distance, of a curvature of 1e-2 or less
    assert (RISE / SPAN * x - y).max() == pytest.approx(0.8, abs=1e-5)
    for sag in (0.01, 0.5, 20.0):
        assert_parts_change_nothing("sag", sag, RTOL)
    with pytest.raises(cp.SceneError, match=r"^cable\.sag: given 0\.5; allowed: a tension or a length"):
        cp.make_scene(
            {
                "gravity": 0.0,
                "cable": {**CABLE, "sag": 0.5},
                "ends": {"lower": [0.0, 0.0], "upper": [SPAN, RISE]},
                "attachment": [{"arc_length": 0.5, "mass": MASS}],
            }
        )


def test_each_segment_expands_by_its_own_coefficient() -> None:
    """Lengths, mass and stiffness of the parts; a mass keeps its place on the parts."""
    warm = {"to": 0.25, "thermal_expansion": 2e-5, "density": 9000.0}
    tables = {"segment": [warm, {}], "attachment": [{"arc_length": 0.25, "mass": MASS}], "temperature": 60.0}
    factors = np.array([1.0 + 40.0 * 2e-5, 1.0 + 40.0 * 1.2e-5])
    lengths = 61.3 * np.array([0.25, 0.75]) * factors
    border = lengths[0] / lengths.sum()
    by_hand = {
        "segment": [{"to": border, "density": 9000.0 / factors[0]}, {"density": 8000.0 / factors[1]}],
        "attachment": [{"arc_length": border, "mass": MASS}],
    }
    found = cp.catenary.rest(scene(tables, unstretched_length=61.3, thermal_expansion=1.2e-5))
    expected = cp.catenary.rest(scene(by_hand, unstretched_length=float(lengths.sum())))
    for name in NUMBERS:
        np.testing.assert_allclose(found[name], expected[name], rtol=RTOL, err_msg=name)
    np.testing.assert_allclose(found.position, expected.position, rtol=0.0, atol=1e-11)
    cold = cp.catenary.rest(scene({**tables, "temperature": 20.0}, top_tension=15000.0, thermal_expansion=1.2e-5))
    assert float(cold.tension_upper) == pytest.approx(15000.0, rel=1e-12)
    hot = cp.catenary.rest(scene(tables, top_tension=15000.0, thermal_expansion=1.2e-5))
    expansion = lengths.sum() / 61.3
    assert float(hot.unstretched_length) == pytest.approx(expansion * float(cold.unstretched_length), rel=1e-14)


def test_a_sag_of_an_upright_cable_is_refused_as_given() -> None:
    # no force acts across the load; the message once told a trial of the search instead of the sag
    tables = {"ends": {"lower": [0.0, 0.0], "upper": [0.0, 50.0]}, "segment": [{"to": 0.5}, {"density": 9000.0}]}
    with pytest.raises(cp.SceneError, match=r"^cable\.sag: given 0\.5; allowed: a tension or a length, as the chord"):
        cp.make_scene({"cable": {**CABLE, "sag": 0.5}, "chain": {"links": 10}, **tables})
