"""A stay with a damper: scene, damping ratios by the continuous cable and by closed forms, decay in time."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import brentq, minimize_scalar

import cablepod as cp

#: Axial stiffness [N], mass per length [kg/m], chord [m] and inclination [deg] of the stay: 8200 mm2 of steel in a pipe.
STIFFNESS, MASS, CHORD, INCLINATION = 1.6e9, 80.0, 250.0, 30.0
#: Tension in service [N], at the upper end.
TENSION = 5e6
MODES = 5
#: Elements of the cable and order 7: with 16 the ratios of five modes change by less than 1e-10.
ELEMENTS = 8
#: Points of shapes and positions, and interval of the output [s].
POINTS, INTERVAL = 201, 0.02
#: Constants between which the best one is sought, over the closed form.
BRACKET = (0.2, 5.0)


class Taut(NamedTuple):
    """What closed forms need of a stay at rest."""

    tension: float  #: mean along the chord [N]
    sag_parameter: float  #: Irvine's, [1]
    omega: np.ndarray  #: angular frequencies without a damper, by the closed form (modes,) [rad/s]
    reduction: np.ndarray  #: factor of the damping ratios by sag (modes,)


def tables(place: float = 0.0, damper: float = 0.0, tension: float = TENSION, **more: Any) -> dict[str, Any]:
    """Return the tables of the scene.

    Parameters
    ----------
    place
        Place of the damper over the length of the stay, from its lower end.
    damper
        Its constant [N s/m]; without one where it is 0.
    tension
        At the upper end [N].
    more
        Further tables.
    """
    attached = [{"arc_length": place, "damper": damper, "direction": "normal"}] if damper else []
    return {
        "title": "stay with a damper",
        "cable": {"axial_stiffness": STIFFNESS, "mass_per_length": MASS, "top_tension": tension},
        "ends": {"lower": [0.0, 0.0], "chord": CHORD, "inclination": INCLINATION},
        **({"attachment": attached} if attached else {}),
        **more,
    }


def ratios(place: float, damper: float, tension: float = TENSION, elements: int = ELEMENTS) -> np.ndarray:
    """Return the damping ratios of the first modes in the plane (modes,), by the continuous cable."""
    scene = cp.make_scene(tables(place, damper, tension))
    return np.asarray(cp.cable.frequencies(scene, count=MODES, elements=elements, law="linear").damping_ratio.values)


def ratios_without_sag(place: float, damper: float, given: Taut) -> np.ndarray:
    """Return the damping ratios of a weightless stay with the same mean tension (modes,), by the continuous cable."""
    scene = cp.make_scene(tables(place, damper, given.tension, gravity=0.0))
    return np.asarray(cp.cable.frequencies(scene, count=MODES, elements=ELEMENTS, law="linear").damping_ratio.values)


# --- closed forms -----------------------------------------------------------------------------------------------------


def symmetric_root(sag_parameter: float, number: int) -> float:
    """Return the root omega l sqrt(m/T) of Irvine and Caughey's equation for the symmetric mode `number`, from 1."""

    def misfit(half: float) -> float:
        return math.sin(half) - (half - 4.0 / sag_parameter * half**3) * math.cos(half)

    return 2.0 * float(brentq(misfit, (number - 0.5) * math.pi, (number + 0.5) * math.pi, xtol=1e-13))


def sag_reduction(root: float, sag_parameter: float) -> float:
    """Return T l phi'(0)^2 / (2 omega^2 M) of a symmetric mode phi with the modal mass M; 1 without sag."""
    square = math.tan(0.5 * root) ** 2
    return square / (square + 12.0 / sag_parameter * (0.5 * root) ** 2)


def taut(tension: float = TENSION) -> Taut:
    """Return tension, sag parameter, frequencies and reductions of the stay with sag, by closed forms."""
    numbers = cp.summary(cp.make_scene(tables(tension=tension)))
    mean, parameter = (
        float(numbers.horizontal_force) / math.cos(math.radians(INCLINATION)),
        float(numbers.irvine_parameter),
    )
    roots, factors = math.pi * np.arange(1.0, MODES + 1.0), np.ones(MODES)
    for n in range(0, MODES, 2):
        roots[n] = symmetric_root(parameter, n // 2 + 1)
        factors[n] = sag_reduction(roots[n], parameter)
    return Taut(mean, parameter, roots / CHORD * math.sqrt(mean / MASS), factors)


def closed_form(place: float, damper: float, given: Taut, *, sag: bool = True) -> np.ndarray:
    """Return R a/l kappa / (1 + kappa^2) with kappa = c a omega / T (modes,); R = 1 and a string's omega without sag."""
    omega = given.omega if sag else np.arange(1, MODES + 1) * math.pi / CHORD * math.sqrt(given.tension / MASS)
    kappa = damper * place * CHORD * omega / given.tension
    return np.asarray((given.reduction if sag else 1.0) * place * kappa / (1.0 + kappa**2))


def rule_of_thumb(place: float, given: Taut, first: int = 1, last: int = 1) -> float:
    """Return T / (a sqrt(omega_first omega_last)) [N s/m] of a string.

    This constant is the best for one mode, and gives two modes the same ratio.
    """
    string = math.pi / CHORD * math.sqrt(given.tension / MASS)
    return given.tension / (place * CHORD * string * math.sqrt(first * last))


def best_constant(place: float, modes: int, tension: float = TENSION) -> float:
    """Return the constant [N s/m] with which the lowest ratio of the first modes is largest, by the continuous cable."""
    start = rule_of_thumb(place, taut(tension), 1, modes)
    found = minimize_scalar(
        lambda log: -ratios(place, math.exp(log), tension)[:modes].min(),
        bounds=tuple(math.log(factor * start) for factor in BRACKET),
        method="bounded",
        options={"xatol": 1e-4},
    )
    return math.exp(float(found.x))


# --- decay ------------------------------------------------------------------------------------------------------------


class Decay(NamedTuple):
    """The first cycles of a decay."""

    ratio: float  #: damping ratio, from the decrement of the swings between maxima and minima
    frequency: float  #: angular, from their instants, over that of small vibrations
    tension_range: float  #: of the tension, over that at rest, at the upper end


def decay(
    place: float,
    damper: float,
    amplitude: float,
    *,
    mode: int = 1,
    tension: float = TENSION,
    cycles: int = 10,
    step: float = 0.01,
    elements: int = ELEMENTS,
) -> Decay:
    """Release the stay from the shape of a vibration; return the decay from the first minimum on.

    Swings from a maximum to a minimum count, as a stay with sag moves further up than down.

    Parameters
    ----------
    place, damper, tension
        As for :func:`tables`.
    amplitude
        Largest displacement of the start, over the chord.
    mode
        Number of the vibration.
    cycles
        Number of cycles.
    step
        Of the trapezoidal rule [s].
    elements
        Of the cable.
    """
    still = cp.make_scene(tables(place, damper, tension))
    common: dict[str, Any] = {"law": "linear", "points": POINTS, "elements": elements}
    vibration = cp.cable.frequencies(still, count=mode, **common)
    rest = cp.cable.rest(still, **{name: common[name] for name in ("law", "points")})
    shape, omega = vibration.mode_shape.values[-1], float(vibration.angular_frequency[-1])
    start = rest.position.values + amplitude * CHORD / np.abs(shape).max() * shape
    duration = math.ceil((cycles + 2.5) * 2.0 * math.pi / omega / INTERVAL) * INTERVAL
    scene = tables(
        place,
        damper,
        tension,
        time={"duration": duration, "interval": INTERVAL},
        initial={"points": start.tolist()},
    )
    run = cp.cable.simulate(cp.make_scene(scene), scheme="trapezoidal", step=step, **common)
    weight = np.gradient(run.arc_length.values)
    share = np.einsum("tpc,pc,p->t", run.position.values - rest.position.values, shape, weight)
    instants, heights = extremes(run.time.values, share)
    halves = np.arange(2.0 * cycles)
    swings = np.abs(np.diff(heights[1 : 2 * cycles + 2]))
    decrement = -2.0 * np.polyfit(halves, np.log(swings), 1)[0]
    period = 2.0 * np.polyfit(halves, instants[1 : 2 * cycles + 1], 1)[0]
    ratio = float(decrement / math.hypot(2.0 * math.pi, decrement))
    upper = run.tension.isel(link=-1)
    spread = float((upper.max() - upper.min()) / rest.tension.isel(link=-1))
    small = omega * math.sqrt(1.0 - float(vibration.damping_ratio[-1]) ** 2)
    return Decay(ratio, 2.0 * math.pi / float(period) / small, spread)


def extremes(time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return instants and values of maxima and minima, each of a parabola through three instants."""
    steps = np.sign(np.diff(values))
    top = np.flatnonzero(steps[1:] != steps[:-1]) + 1
    slope = 0.5 * (values[top + 1] - values[top - 1])
    bend = values[top + 1] + values[top - 1] - 2.0 * values[top]
    return time[top] - slope / bend * (time[1] - time[0]), values[top] - 0.5 * slope**2 / bend
