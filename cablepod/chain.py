"""The elastic chain, eqs. (1)-(3) of the paper with the signs repaired: scene -> chain at rest, scene -> trajectory."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr

from cablepod import implicit, provenance, stepping
from cablepod.conventions import label
from cablepod.implicit import ImplicitRun
from cablepod.links import LAWS, Chain, chain_of, check_law, square
from cablepod.members import over_members
from cablepod.parameters import check_memory, load_plane, parameters, solve_statics
from cablepod.runs import SUSPECT, Run, State, coordinates, suffix
from cablepod.schema import SceneError, number, refuse
from cablepod.verlet import VerletRun

__all__ = ["rest", "simulate"]

SCHEMES = ("velocity_verlet", *implicit.SCHEMES)


# --- rest -----------------------------------------------------------------------------------------------------------


@over_members
def rest(scene: xr.Dataset, *, links: int | None = None, law: str = LAWS[0]) -> xr.Dataset:
    """Compute the chain at rest between its ends, under all loads of the scene at time 0.

    Parameters
    ----------
    scene
        A scene; an end that is free during the run is held here.
    links
        Number of links, instead of the scene's.
    law
        "linear" or "green", see :func:`simulate`.

    Returns
    -------
    xarray.Dataset
        ``position (particle, coordinate)`` [m], ``tension (link)`` [N], ``arc_length (particle)`` [m] and the scalars
        ``unstretched_length``, ``stretched_length`` [m], ``tension_lower``, ``tension_upper``, ``residual`` [N].

    Raises
    ------
    SceneError
        For a law that is not known, a scene without rest, and a chain that at rest has a link without force (folded on itself).

    Notes
    -----
    Newton's method on the force in the first link, which determines all else (the discrete catenary).  The residual is
    that of the tensions along the links as they are stored; tensions computed again from the positions carry the rounding
    of these, about K/l 2^-53 times the chord.

    Where a scene gives a tension, its unstretched length follows by the linear law whatever `law` is: both laws have the same
    cable, and by law (21), T = K xi (xi^2 - 1) / 2, the tension at rest is not quite the one given: with a strain e it is off by
    1.5 e at most, relatively, and by much less where the sag decides.

    Examples
    --------
    >>> import cablepod as cp
    >>> from cablepod import shipped
    >>> scene = shipped.scene("example2")
    >>> rest = cp.chain.rest(scene, links=10)
    >>> rest.position.dims, rest.sizes["particle"], rest.tension.units
    (('particle', 'coordinate'), 11, 'N')
    """
    check_law(law)
    p = parameters(scene)
    chain = chain_of(p, links, law)
    position, tension = _rest(chain)
    reach = np.diff(position, axis=0)
    force = (tension / np.sqrt(square(reach)))[:, None] * reach
    unbalanced = force[1:] - force[:-1] + chain.loads(0.0)[1:-1]
    scalars = {
        "unstretched_length": chain.total_length,
        "stretched_length": float(np.sum(np.sqrt(square(reach)))),
        "tension_lower": tension[0],
        "tension_upper": tension[-1],
        "residual": float(np.sqrt(square(unbalanced)).max()),
    }
    result = xr.Dataset(
        {
            "position": (("particle", "coordinate"), position),
            "tension": ("link", tension),
            **{name: ((), value) for name, value in scalars.items()},
        },
        coords=coordinates(chain),
    )
    label(result)
    result.attrs.update(
        title=f"{scene.attrs.get('title', 'scene')}: chain at rest{suffix(chain)}", stage="rest", law=chain.law
    )
    options = {"links": chain.links, "law": chain.law}
    return provenance.record(
        result, function="chain.rest", parameters=options, inputs=[scene], chosen=provenance.unset(links=links)
    )


def _rest(chain: Chain) -> tuple[np.ndarray, np.ndarray]:
    """Positions (n + 1, dims) [m] and tensions (n,) [N] of a chain at rest."""
    from cablepod.kernels import chain as kernel  # numba is imported only to compute

    p = chain.p
    ends = p.end_positions(np.zeros(1))[0]
    chord = ends[1] - ends[0]
    loads = chain.loads(0.0)[1:-1]
    solution = solve_statics(p, "unstretched_length", chain.total_length)
    _, _, _, q, across, against = load_plane(p)
    v0 = solution[3] - 0.5 * q * (chain.total_length - chain.length[0])
    force = solution[2] * across + v0 * against
    if not np.isfinite(force).all() or not force.any():
        # weightless and slack but for point loads, or just without tension: begin with any pull along the chord
        force = chord / np.linalg.norm(chord) * max(float(np.abs(loads).sum()), 1e-6 * p.stiffness)
    gap = kernel.equilibrium(chord, loads, chain.length, p.stiffness, chain.green, force)
    scale = max(float(np.linalg.norm(chord)), chain.total_length)
    forces = force - np.concatenate([np.zeros((1, p.dims)), np.cumsum(loads, axis=0)])
    tension = np.sqrt(square(forces))
    if not gap <= 1e-11 * scale or not tension.min() > 0.0:
        left = f" (a gap of {gap:.2g} m is left)" if np.isfinite(gap) else ""
        raise SceneError(
            f"chain: no rest found with all links taut{left}; allowed: a scene whose chain does not fold on itself at rest and "
            f"is not far softer than its loads (its stiffness is {p.stiffness:.3g} N), or a start from initial.points"
        )
    secant = np.array([kernel.secant_modulus(size, p.stiffness, chain.green) for size in tension])
    reach = chain.length[:, None] * (forces / tension[:, None] + forces / secant[:, None])
    position = ends[0] + np.concatenate([np.zeros((1, p.dims)), np.cumsum(reach, axis=0)])
    position[-1] = ends[1]
    return position, tension


def start(chain: Chain) -> np.ndarray:
    """Positions from which a run starts (n + 1, dims) [m]: at rest, or the shape that the scene's initial table says."""
    p = chain.p
    if "points" in p.initial:
        return along_line(chain, np.asarray(p.initial["points"], dtype=float))
    for key in ("top_tension", "unstretched_length"):
        if key in p.initial:
            other = solve_statics(p, key, p.initial[key], prefix="initial")[0]
            factor = other / chain.total_length
            return _rest(replace(chain, length=factor * chain.length, arc_length=factor * chain.arc_length))[0]
    return _rest(chain)[0]


def along_line(chain: Chain, line: np.ndarray) -> np.ndarray:
    """Lay the particles on a line: one on each point, or by unstretched length.

    Between two held ends the line is shared out in proportion; a free end lies where the unstretched length ends.
    """
    if len(line) == chain.links + 1:
        position = line.copy()
    else:
        reach = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
        place = chain.arc_length / chain.total_length * reach[-1]
        if chain.p.free is not None:
            spare = reach[-1] - chain.total_length
            if spare < -1e-9 * chain.total_length:
                raise SceneError(
                    f"initial.points: given a line of {reach[-1]:.9g} m; allowed: at least the unstretched length, "
                    f"{chain.total_length:.9g} m, so that the free end can lie on it"
                )
            place = chain.arc_length + (spare if chain.p.free == "lower" else 0.0)
        position = np.stack([np.interp(place, reach, line[:, c]) for c in range(line.shape[1])], axis=1)
    ends = chain.p.end_positions(np.zeros(1))[0]
    for index, end in ((0, "lower"), (-1, "upper")):
        if chain.p.free != end:
            position[index] = ends[index]
    return position


# --- motion ---------------------------------------------------------------------------------------------------------


@over_members
def simulate(
    scene: xr.Dataset,
    *,
    links: int | None = None,
    times: Any = None,
    law: str = LAWS[0],
    scheme: str | None = None,
    spectral_radius: float | None = None,
    step: float | None = None,
    tolerance: float | None = None,
    outputs: tuple[str, ...] = ("position",),
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Simulate the elastic chain of a scene.

    Parameters
    ----------
    scene
        A scene, with or without ``member``.
    links
        Number of links, instead of the scene's.
    times
        Instants of the output [s], rising from 0 on; by default 0, interval, ... up to the scene's duration.  They change
        no bit of the motion: what lies between two steps is interpolated to the order of the scheme.
    law
        "linear": T = K (xi - 1), xi = |R| / l, where that is positive; a slack link carries nothing.  "green": eq. (21) of the
        paper, T / xi = K (xi^2 - 1) / 2, the extensible cable cut into lumped linear elements; it resists compression.  A run
        from equilibrium starts from that of its law.
    scheme
        By default picked by `tolerance`; the attribute ``choice_of_scheme`` says why.  "velocity_verlet" is explicit.  Implicit,
        in O(n) per step and stable at any step as far as linear theory goes, are "trapezoidal" (average acceleration),
        "generalized_alpha" (Chung and Hulbert; damps what its steps do not resolve) and "energy_momentum" (Simo and Tarnow;
        keeps the energy).
    spectral_radius
        Of "generalized_alpha" for the highest frequencies, in [0, 1]; 0.8 by default.
    step
        Time step [s].  By default it follows from the highest frequency and is then halved or shortened until two runs agree
        within `tolerance`; with a given step there is one run and no such check.
    tolerance
        Wanted time error as a fraction of the largest rms displacement; 1e-6 by default.
    outputs
        Some of "position", "velocity", "tension", "tension_extremes" (over all steps); nothing else is computed.
    progress
        Called now and then with the part of the run that is done, from 0 to 1.

    Returns
    -------
    xarray.Dataset
        ``position (time, particle, coordinate)`` [m], ``velocity`` [m/s], ``tension (time, link)`` [N],
        ``tension_minimum``, ``tension_maximum (link)`` [N] as asked for; by law "green" compression is negative.  Attributes say
        law, scheme, step [s], number of steps, stability limit of the step [s], highest angular frequency [rad/s] and the
        estimate of the time error; with law "green" limit and frequency are those of the start, and ``smallest_stretch`` says
        the least xi at the instants of the output.  ``energy_excess`` is the largest strain energy over what start, loads and
        ends explain; implicit runs add ``newton_iterations`` and ``steps_cut``.  Ends whose speed jumps at the start are
        accepted; the energy that this injects is then in ``start_jolt_energy`` [J], with ``start_jolt_speed`` [m/s] and
        ``start_jolt_tension`` [N], see Notes.

    Raises
    ------
    SceneError
        For options that cannot be, law "green" with viscous links, a step above the stability limit, an output that would not
        fit in memory.
    RunStopped
        Where the motion leaves the finite numbers, or its links hold far more energy than can be explained; its ``partial`` holds
        what was computed until then.  With law "green" also where at an instant of the output the links have become too stiff for
        a given step.

    Warns
    -----
    NotConvergedWarning
        Where no step meets the tolerance, as in chaotic scenes, and where a given step leaves more energy than can be explained.

    Notes
    -----
    m r'' = P + T_j - T_(j-1) with T = k (1 - l/|R|) R for |R| > l, else 0; eqs. (1)-(3) of the paper.  Second order in step
    and in 1/n.  Damping by mass is integrated exactly; viscous links use a velocity predicted from the last two half steps,
    which keeps the order.

    No motion can jump in position: each kind is continuous and starts from where the end is, a record being a spline.  A jump of
    its speed by v along the cable, at the start, sends out an axial wave that changes the tension by v sqrt(K mu) and, when it
    has run along the cable once, carries the energy mu L v^2 (of both ends the sum).

    By law (21) T = k/2 (|R|^2/l^2 - 1) R, from the energy K (xi^2 - 1)^2 / 8 per unstretched length.  Along a link it is
    (3 xi^2 - 1) / 2 times as stiff as unstretched, so the limit of the step is that of the stretch at the start and falls as the
    links are pulled; the step that is chosen here counts on the largest distance of the ends, keeps a margin, and is halved where
    that is not enough.

    Examples
    --------
    >>> import cablepod as cp
    >>> from cablepod import shipped
    >>> scene = shipped.scene("example2")
    >>> run = cp.chain.simulate(scene, times=[0.0, 45.0], outputs=("position", "tension"))
    >>> run.position.dims, run.attrs["scheme"], run.attrs["time_error_estimate"] < 1e-6
    (('time', 'particle', 'coordinate'), 'velocity_verlet', True)
    """
    check_law(law)
    stepping.check_scheme(scheme, SCHEMES)
    names = stepping.check_outputs(outputs)
    if step is not None and tolerance is not None:
        raise refuse("step and tolerance", (step, tolerance), "one of them: a tolerance chooses the step")
    goal = stepping.DEFAULT_TOLERANCE if tolerance is None else stepping.check_positive("tolerance", tolerance)
    radius = _check_radius(spectral_radius, scheme)
    p = parameters(scene)
    if law == "green" and p.link_viscosity is not None:
        raise refuse(
            "law and damping.link_viscosity",
            (law, p.link_viscosity),
            'viscous links with law "linear"; with "green" none, mass_proportional is possible',
        )
    chain = chain_of(p, links, law)
    instants = p.times() if times is None else stepping.check_times(times)
    p.check_reach(float(instants[-1]))
    check_memory(
        instants.size, chain.links, p.dims, key="links" if links is not None else "chain.links and times", variables=3
    )
    initial = start(chain)
    limit = chain.step_limit(chain.stiffening(initial))
    about = (chain, instants, initial, names, progress, str(scene.attrs.get("title", "scene")))
    explicit = VerletRun(*about)
    run: Run = explicit
    if scheme not in (None, explicit.scheme):
        run = ImplicitRun(*about, method=scheme, spectral_radius=radius)
    reason = "given"
    if step is not None:
        if run is explicit:
            why = f"2 over the highest angular frequency, {2 / limit:.6g} rad/s; implicit schemes have none"
            rate = 1.0 / stepping.check_step(step, limit, why)
        else:
            rate = 1.0 / number(above=0.0, most=float(instants[-1]) or np.inf)("step", step)
        state, estimate = run(rate), None
        if state.notes["energy_excess"] > SUSPECT:
            warnings.warn(
                f"the links hold up to {state.notes['energy_excess']:.2g} times the energy that rest, loads and ends explain: a "
                "resonance, or a step too long for links that slacken and snap taut; compare with half the step or with scheme "
                "energy_momentum",
                stepping.NotConvergedWarning,
                stacklevel=3,
            )
    elif scheme is not None:
        state, rate, estimate = _refined(run, limit, goal)
    else:
        run, (state, rate, estimate), reason = _picked(
            explicit, ImplicitRun(*about), limit, goal, asked=tolerance is not None
        )
    result = run.dataset(state)
    if estimate is not None:
        result.attrs["time_error_estimate"] = estimate
    result.attrs["choice_of_scheme"] = reason
    options = {
        "links": chain.links,
        "times": instants,
        "law": law,
        "scheme": run.scheme,
        "spectral_radius": radius if run.scheme == "generalized_alpha" else None,
        "step": 1.0 / rate,
        "tolerance": None if step is not None else goal,
        "outputs": list(names),
    }
    return provenance.record(
        result,
        function="chain.simulate",
        parameters=options,
        inputs=[scene],
        chosen=provenance.unset(
            links=links, times=times, scheme=scheme, spectral_radius=spectral_radius, step=step, tolerance=tolerance
        ),
    )


def _check_radius(radius: float | None, scheme: str | None) -> float:
    if radius is None:
        return ImplicitRun.spectral_radius
    if scheme != "generalized_alpha":
        raise refuse("spectral_radius", radius, 'none, but for scheme "generalized_alpha"')
    return number(least=0.0, most=1.0)("spectral_radius", radius)


#: An implicit step costs about as much as so many explicit ones, with the iterations of Newton's method.
IMPLICIT_COST = 25.0
#: Below so many seconds of explicit run time, at about 2 ns per link and step, no other scheme is tried unasked.
CHEAP, LINK_STEP = 0.3, 2e-9
#: Steps of the first implicit run in the period of the first transverse vibration.
STEPS_PER_PERIOD = 8.0


def _picked(
    explicit: VerletRun, trapezoidal: ImplicitRun, limit: float, goal: float, *, asked: bool
) -> tuple[Run, tuple[State, float, float], str]:
    """Pick scheme and step for a tolerance: implicit as long as its steps are so long that it is the faster one."""
    rate = 1.0 / _first_step(explicit, limit)
    cost = 3.0 * float(explicit.times[-1]) * rate * explicit.chain.links * LINK_STEP
    if not asked and cost < CHEAP:
        return explicit, _refined(explicit, limit, goal), f"explicit: all its runs take about {cost:.1g} s"
    most = 2.0 * rate / IMPLICIT_COST
    found = stepping.halve(
        *_compared(trapezoidal, limit), goal, most, (float(explicit.times[-1]), explicit.chain.links)
    )
    if found is not None:
        return trapezoidal, found, f"implicit: its steps may be {1.0 / (found[1] * limit):.3g} times the explicit limit"
    return (
        explicit,
        _refined(explicit, limit, goal),
        f"explicit: implicit steps would have to be shorter than {1 / most:.3g} s",
    )


def _refined(run: Run, limit: float, goal: float) -> tuple[State, float, float]:
    def slackened(state: State) -> bool:
        # law (21) pulls and pushes without a kink
        return not run.chain.green and bool((run.chain.stretch(state.position) < 1.0).any())

    return stepping.refine(*_compared(run, limit), goal, slackened, (float(run.times[-1]), run.chain.links))


def _compared(run: Run, limit: float) -> tuple[Run, Callable[[State], np.ndarray], Callable[[State], float], float]:
    """Return a run, how two of them are compared, and the number of steps per second to begin with."""
    chord = float(np.linalg.norm(run.chain.p.upper - run.chain.p.lower))

    def position(state: State) -> np.ndarray:
        return state.position

    def scale(state: State) -> float:
        return stepping.motion_scale(state.position, run.initial, chord)

    return run, position, scale, stepping.preferred_rate(1.0 / _first_step(run, limit))


def _first_step(run: Run, limit: float) -> float:
    """Choose the step to begin with [s]."""
    return min(_unforced_step(run, limit), run.chain.p.time_scale / stepping.STEPS_PER_CHANGE)


def _unforced_step(run: Run, limit: float) -> float:
    chain, initial, until = run.chain, run.initial, float(run.times[-1])
    if isinstance(run, ImplicitRun):
        period = 2.0 * chain.total_length / np.sqrt(max(chain.pull(initial)[0].mean(), 1e-300) / chain.p.mass)
        return float(max(min(until / 20.0, period / STEPS_PER_PERIOD), limit))
    if not chain.green:
        return 0.9 * limit
    # for the stretch to come, as far as the ends enforce it, and waves on top
    return 0.8 * chain.step_limit(np.maximum(chain.stiffening(initial), chain.enforced_stiffening(until)))
