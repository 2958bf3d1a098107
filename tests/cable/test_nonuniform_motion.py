"""Motion of a cable with segments and attachments: against independent equations of motion, and decay against its ratio."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import cablepod as cp

WIND, AIR_DENSITY = 15.0, 1.25
PARTS = [{"to": 0.45}, {"youngs_modulus": 6.0e7, "density": 2500.0, "diameter": 0.02}]
ATTACHED = [
    {"arc_length": 0.3, "mass": 2.0, "drag_area": 0.1},
    {"arc_length": 0.5, "damper": 30.0, "direction": "normal"},
    {"arc_length": 0.75, "spring": 200.0, "damper": 5.0, "direction": [1.0, 1.0]},
]
SCENE: dict[str, Any] = {
    "cable": {
        "youngs_modulus": 2.0e7,
        "area": 1.0e-3,
        "density": 1000.0,
        "unstretched_length": 10.02,
        "diameter": 0.03,
    },
    "ends": {"lower": [0.0, 0.0], "upper": [8.0, 6.0]},
    "motion": {"upper": {"x": {"kind": "one_minus_cosine", "amplitude": -0.05, "angular_frequency": 4.0}}},
    "damping": {"mass_proportional": 0.2, "tension_proportional": 2e-3},
    "time": {"duration": 1.5, "interval": 0.25},
    "segment": PARTS,
    "attachment": ATTACHED,
    "wind": {"speed": WIND, "direction": [1.0, 0.0], "profile": "uniform", "air_density": AIR_DENSITY},
}
#: Elements of order 1, with parts, bodies and wind: all quick tests have these, for which one kernel of each scheme is compiled.
ELEMENTS = {"elements": 12, "order": 1}
#: As good as still air.
LULL = {"speed": 1e-3, "direction": [1.0, 0.0], "profile": "uniform"}


def tables_of_parts(arc_length: np.ndarray, total: float) -> dict[str, np.ndarray]:
    """Return stiffness [N], mass per length [kg/m] and diameter [m] of the elements between nodes."""
    lower = 0.5 * (arc_length[1:] + arc_length[:-1]) < 0.45 * total
    return {
        "stiffness": np.where(lower, 2.0e4, 6.0e4),
        "mass": np.where(lower, 1.0, 2.5),
        "diameter": np.where(lower, 0.03, 0.02),
    }


def independent(arc_length: np.ndarray, start: np.ndarray, times: np.ndarray, *, green: bool, viscosity: float) -> Any:
    """Integrate the equations of motion of elements of order 1 from rest at `start` (nodes, 2); return (times, nodes, 2)."""
    length, total = np.diff(arc_length), arc_length[-1]
    parts = tables_of_parts(arc_length, total)
    mass = np.zeros(len(start))
    mass[:-1] += 0.5 * parts["mass"] * length
    mass[1:] += 0.5 * parts["mass"] * length
    nodes = [int(np.argmin(np.abs(arc_length - item["arc_length"] * total))) for item in ATTACHED]
    assert np.abs(arc_length[nodes] - [item["arc_length"] * total for item in ATTACHED]).max() < 1e-12
    mass[nodes[0]] += 2.0
    directions = np.array([[-0.6, 0.8], [math.sqrt(0.5)] * 2])

    def accelerations(t: float, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        g, g_dot = (np.diff(values, axis=0) / length[:, None] for values in (x, v))
        xi = np.linalg.norm(g, axis=1)
        secant = 0.5 * (xi**2 - 1.0) if green else 1.0 - 1.0 / xi + viscosity * (g * g_dot).sum(axis=1) / xi**2
        pull = (parts["stiffness"] * secant)[:, None] * (g + 2e-3 * g_dot)
        force = np.zeros_like(x)
        force[:-1] += pull
        force[1:] -= pull
        force[:, 1] -= 9.81 * mass
        force -= 0.2 * mass[:, None] * v
        for node, direction, spring, damper in zip(nodes[1:], directions, (0.0, 200.0), (30.0, 5.0), strict=True):
            force[node] -= (spring * direction @ (x - start)[node] + damper * direction @ v[node]) * direction
        for side in (slice(None, -1), slice(1, None)):
            relative = np.array([WIND, 0.0]) - v[side]
            along = (relative * g).sum(axis=1) / xi**2
            normal = relative - along[:, None] * g
            size = 0.5 * AIR_DENSITY * 1.2 * parts["diameter"] * 0.5 * length * xi * np.linalg.norm(normal, axis=1)
            force[side] += size[:, None] * normal
        relative = np.array([WIND, 0.0]) - v[nodes[0]]
        force[nodes[0]] += 0.5 * AIR_DENSITY * 0.1 * np.linalg.norm(relative) * relative
        return np.asarray(force[1:-1] / mass[1:-1, None])

    def rates(t: float, state: np.ndarray) -> np.ndarray:
        x, v = start.copy(), np.zeros_like(start)
        x[-1, 0] += -0.05 * (1.0 - math.cos(4.0 * t))
        v[-1, 0] = -0.05 * 4.0 * math.sin(4.0 * t)
        x[1:-1], v[1:-1] = state.reshape(2, -1, 2)
        return np.concatenate([v[1:-1].ravel(), accelerations(t, x, v).ravel()])

    still = accelerations(0.0, start, np.zeros_like(start))
    assert np.abs(still).max() < 1e-6  # of a cable with 10 m/s2 everywhere: rest with all its loads
    state = np.concatenate([start[1:-1].ravel(), np.zeros(2 * (len(start) - 2))])
    found = solve_ivp(rates, (0.0, times[-1]), state, method="DOP853", t_eval=times, rtol=1e-9, atol=1e-11)
    return found.y[: state.size // 2].T.reshape(times.size, -1, 2)


@pytest.mark.parametrize("scheme", ["velocity_verlet", "trapezoidal"])
@pytest.mark.parametrize("law", ["green", "linear"])
def test_elements_of_order_one_obey_independent_equations(scheme: str, law: str) -> None:
    viscosity = 0.0 if law == "green" else 2e-3
    damping = SCENE["damping"] if law == "green" else {**SCENE["damping"], "link_viscosity": viscosity}
    scene = cp.make_scene({**SCENE, "damping": damping})
    errors = []
    for step in (5e-4, 2.5e-4):
        run = cp.cable.simulate(
            scene, law=law, scheme=scheme, step=step, points="nodes", outputs=("position", "tension"), **ELEMENTS
        )
        x = run.position.values
        if not errors:
            exact = independent(run.arc_length.values, x[0], run.time.values, green=law == "green", viscosity=viscosity)
        motion = np.sqrt(((exact - exact[0]) ** 2).sum(axis=-1)).max()
        errors.append(np.abs(x[:, 1:-1] - exact).max() / motion)
    assert errors[0] < 2e-5
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.15)  # second order with every term
    strain = np.linalg.norm(np.diff(x[0], axis=0), axis=1) / np.diff(run.arc_length.values) - 1.0
    stiffness = tables_of_parts(run.arc_length.values, run.arc_length.values[-1])["stiffness"]
    tension = stiffness * strain * (1.0 if law == "linear" else (1.0 + strain) * (1.0 + 0.5 * strain))
    assert run.tension.values[0] == pytest.approx(tension, rel=1e-9)


# --- decay ------------------------------------------------------------------------------------------------------------

#: A stay of 100 m and 49 m2/s2 of tension over mass, with a sag of 1/160 and an elasticity that lets explicit steps be long.
STAY: dict[str, Any] = {
    "cable": {"youngs_modulus": 2.0e10, "area": 1.0e-3, "density": 8000.0, "horizontal_force": 1.6e5, "diameter": 0.01},
    "ends": {"lower": [0.0, 0.0], "upper": [100.0, 30.0]},
}
PLACE, DAMPER = 0.05, 5.0e3


def decay_of(position: np.ndarray, shape: np.ndarray, weight: np.ndarray) -> float:
    """Return the damping ratio of the first vibration, from the peaks of its share in displacements (times, particle, 2)."""
    share = np.einsum("tpc,pc,p->t", position, shape, weight)
    peak = np.flatnonzero((share[1:-1] > share[:-2]) & (share[1:-1] > share[2:])) + 1
    slope, bend = 0.5 * (share[peak + 1] - share[peak - 1]), share[peak + 1] + share[peak - 1] - 2.0 * share[peak]
    heights = share[peak] - 0.5 * slope**2 / bend  # of the parabola through three instants
    half = len(heights) // 2  # the vibrations that the start has beside the first one have decayed
    decrement = -np.polyfit(np.arange(len(heights) - half), np.log(heights[half:]), 1)[0]
    return float(decrement / math.hypot(2.0 * math.pi, decrement))


@pytest.mark.slow
@pytest.mark.parametrize(("scheme", "step"), [("trapezoidal", 0.02), ("velocity_verlet", 2.5e-4)])
def test_decay_in_time_is_that_of_the_damping_ratio(scheme: str, step: float) -> None:
    attached = {"arc_length": PLACE, "damper": DAMPER, "direction": "normal"}
    scene = {**STAY, "attachment": [attached], "time": {"duration": 60.0, "interval": 0.02}}
    vibration = cp.cable.frequencies(cp.make_scene(scene), count=1, law="linear", points=201)
    rest = cp.cable.rest(cp.make_scene(scene), law="linear", points=201).position.values
    shape = vibration.mode_shape.values[0]
    assert float(vibration.damping_ratio[0]) > 0.005
    # 2 cm at the middle, from which the tension changes by 1e-4
    scene["initial"] = {"points": (rest + 0.01 * shape).tolist()}
    run = cp.cable.simulate(
        cp.make_scene(scene), law="linear", elements=6, scheme=scheme, step=step, points=201, outputs=("position",)
    )
    weight = np.gradient(run.arc_length.values)
    found = decay_of(run.position.values - rest, shape, weight)
    assert found == pytest.approx(float(vibration.damping_ratio[0]), rel=0.01)


@pytest.mark.parametrize("scheme", ["velocity_verlet", "trapezoidal"])
def test_stiff_damper_holds_its_point_in_every_scheme(scheme: str) -> None:
    stiff = {"arc_length": 0.5, "damper": 1e9, "direction": [0.0, 1.0]}
    scene = cp.make_scene({**SCENE, "attachment": [ATTACHED[0], stiff]})
    run = cp.cable.simulate(scene, scheme=scheme, step=1e-3 if scheme == "trapezoidal" else None, points=41, **ELEMENTS)
    moved = (run.position - run.position[0]).isel(coordinate=1)
    assert np.abs(moved[:, 20]).max() < 1e-6
    assert np.abs(moved[:, 10]).max() > 1e-3
    assert float(run.attrs["energy_excess"]) < 1.0


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["velocity_verlet", "trapezoidal"])
def test_spring_draws_a_cable_of_another_length_to_its_rest(scheme: str) -> None:
    # the start is that of another length; the spring has its rest where the cable of the scene has it, and holds energy
    spring = [{"arc_length": 0.5, "spring": 2e3, "damper": 50.0, "direction": [0.0, 1.0]}]
    tables = {name: table for name, table in SCENE.items() if name not in ("wind", "motion")}
    scene = {
        **tables,
        "attachment": spring,
        "initial": {"unstretched_length": 10.05},
        "damping": {"mass_proportional": 6.0},
        "time": {"duration": 3.0, "interval": 0.25},
    }
    step = {"scheme": scheme, "step": 1e-3} if scheme == "trapezoidal" else {"scheme": scheme}
    run = cp.cable.simulate(cp.make_scene(scene), elements=8, points=41, law="linear", outputs=("position",), **step)
    rest = cp.cable.rest(cp.make_scene(scene), elements=8, points=41, law="linear").position
    moved = np.abs(run.position - rest).max(("particle", "coordinate"))
    assert float(moved[0]) > 0.05
    assert float(moved[-1]) < 0.01 * float(moved[0])
    longer = {**SCENE["cable"], "unstretched_length": 10.05}
    exact = cp.catenary.rest(cp.make_scene({**tables, "attachment": spring, "cable": longer}), points=41)
    assert np.abs(run.position[0] - exact.position).max() < 1e-8
    assert float(run.attrs["energy_excess"]) < 1.0


def test_damping_ratios_hold_with_a_mass_and_a_spring() -> None:
    ratio = 0.02
    attached = [
        {"arc_length": 0.4, "mass": 200.0, "drag_area": 1e-6},
        {"arc_length": 0.8, "spring": 2e4, "direction": "normal"},
    ]
    tables = {"segment": [{"to": 0.5, "diameter": 0.02}, {"diameter": 0.01}], "attachment": attached, "wind": LULL}
    scene = {**STAY, **tables, "time": {"duration": 30.0, "interval": 0.02}, "damping": {"ratio": ratio}}
    vibration = cp.cable.frequencies(cp.make_scene(scene), count=1, law="linear", points=201)
    options = {"law": "linear", "elements": 60, "order": 1, "points": 201}
    rest = cp.cable.rest(cp.make_scene(scene), **options).position.values
    shape = vibration.mode_shape.values[0]
    scene["initial"] = {"points": (rest + 0.01 * shape).tolist()}
    run = cp.cable.simulate(cp.make_scene(scene), scheme="trapezoidal", step=0.01, outputs=("position",), **options)
    found = decay_of(run.position.values - rest, shape, np.gradient(run.arc_length.values))
    assert found == pytest.approx(ratio, rel=0.01)


@pytest.mark.parametrize("scheme", ["velocity_verlet", "trapezoidal"])
def test_extremes_are_those_of_all_steps(scheme: str) -> None:
    run = cp.cable.simulate(
        cp.make_scene(SCENE), scheme=scheme, step=2e-4, times=2e-4 * np.arange(400), points=21, law="linear",
        outputs=("tension", "tension_extremes"), **ELEMENTS,
    )  # fmt: skip
    np.testing.assert_allclose(run.tension_maximum, run.tension.max("time"), rtol=1e-9)
    np.testing.assert_allclose(run.tension_minimum, run.tension.min("time"), rtol=1e-9)
    assert float((run.tension_maximum / run.tension_minimum).max()) > 1.01


def test_results_have_the_masses_of_their_particles() -> None:
    options: dict[str, Any] = ELEMENTS | {"step": 2e-4, "times": [0.0, 0.1, 0.2], "law": "linear"}
    run = cp.cable.simulate(cp.make_scene(SCENE), points=41, **options)
    total, mass = float(run.arc_length[-1]), run.particle_mass.values
    # 45 % of 1 kg/m, the rest of 2.5 kg/m, and a body of 2 kg
    assert mass.sum() == pytest.approx((0.45 * 1.0 + 0.55 * 2.5) * total + 2.0, rel=1e-12)
    assert mass @ run.arc_length.values == pytest.approx(
        (0.45**2 / 2.0 * 1.0 + (1.0 - 0.45**2) / 2.0 * 2.5) * total**2 + 2.0 * 0.3 * total, rel=1e-3
    )  # ends of segments within a link
    by_mass, by_length = (cp.pod.decompose(run, rank=2, weights=weights) for weights in ("mass", "length"))
    assert abs(by_mass.mode_shape - by_length.mode_shape).max() > 1e-3
    plain = {name: SCENE[name] for name in ("cable", "ends", "motion")}
    assert "particle_mass" not in cp.cable.simulate(cp.make_scene(plain), points=41, **options).coords
