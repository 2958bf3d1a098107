"""Random scenes that nobody meant end in a result or a clear error.

Mutations of valid scenes: 200 in the suite, as many as CABLEPOD_FUZZ says otherwise, from another seed each time;
tests/README.md has the command (add --hypothesis-show-statistics).  CABLEPOD_FUZZ_VARIANTS=1 adds those whose terms need
kernels compiled that no other scene here needs, some seconds each.
"""

from __future__ import annotations

import copy
import functools
import math
import os
import signal
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import xarray as xr
from hypothesis import event, given, settings
from hypothesis import strategies as st
from numba.core import event as numba_event
from random_scenes import COMMON, MANY
from scenes import SOFT, spatial

import cablepod as cp
from cablepod.discretisation._chain import chain_of
from cablepod.parameters._from_scene import parameters

ALL_VARIANTS = bool(os.environ.get("CABLEPOD_FUZZ_VARIANTS"))
#: A job that takes longer than this, compilation apart, counts as hanging [s of processor time: other load does not count].
HANGS = 10.0
BUSY: dict[str, Any] = {
    "title": "every table",
    "gravity": 9.7,
    "cable": {"youngs_modulus": 2.0e7, "area": 1.0e-3, "density": 1000.0, "bottom_tension": 180.0},
    "ends": {"lower": [0.0, 0.0], "upper": [8.0, 6.0]},
    "motion": {
        "upper": {
            "x": {"kind": "one_minus_cosine", "amplitude": -0.05, "angular_frequency": 2.0},
            "y": {"kind": "harmonic", "amplitude": 0.02, "angular_frequency": 3.0, "phase": 0.3},
        },
        "lower": {"x": {"kind": "ramp", "amplitude": 0.1, "duration": 2.0}},
    },
    "load": {"uniform": [1.0, -2.0], "kind": "polynomial", "coefficients": [0.0, 0.01, 0.002]},
    "point_load": [
        {"arc_length": 0.25, "force": [0.0, -5.0]},
        {"arc_length": 0.5, "force": [3.0, 0.0], "kind": "harmonic", "amplitude": 1.0, "angular_frequency": 2.5},
    ],
    "time": {"duration": 4.0, "interval": 0.5},
    "chain": {"links": 5, "link_lengths": [1.0, 2.0, 1.0, 2.0, 1.0]},
    "initial": {"top_tension": 260.0},
    "damping": {"mass_proportional": 0.1},
}
FREE: dict[str, Any] = {
    **{key: SOFT[key] for key in ("title", "time", "chain")},
    "cable": {"youngs_modulus": 2.0e7, "area": 1.0e-3, "specific_weight": 9810.0, "unstretched_length": 9.0},
    "ends": {"lower": [0.0, 0.0], "upper": [8.0, 0.0], "free": "upper"},
    "initial": {"points": [[0.0, 0.0], [5.0, -1.0], [9.5, 0.0]]},
}
BASES = (SOFT, BUSY, FREE)
NUMBERS = st.one_of(
    st.sampled_from([0, 1, -1, 2, 0.0, -0.0, 1e-320, 1e-30, 1e-9, 1e9, 1e30, 1e300, 10**400, 2**63, True]),
    st.sampled_from([math.nan, math.inf, -math.inf]),
    st.floats(),
    st.floats(1e-3, 1e3),
    st.integers(-5, 50),
)
JUNK = st.one_of(
    NUMBERS,
    st.none(),
    st.sampled_from(
        ["", " ", "upper", "lower", "ramp", "file", "é\n", [], {}, [[]], [1.0], [1.0, 2.0], [1.0, 2.0, 3.0], {"x": 1}]
    ),
    st.lists(NUMBERS, max_size=4),
    st.sampled_from([np.float64(3.0), np.int8(3), np.zeros(2), np.array(2.5), 1j, b"2", object()]),
)
CHANGES = (*["nudge"] * 6, *["scale"] * 4, *["negate"] * 2, "junk", "delete", "copy", "add", "longer")
NAMES = (
    "x",
    "z",
    "kind",
    "amplitude",
    "duration",
    "links",
    "free",
    "force",
    "density",
    "uniform",
    "no_such_key",
    "",
    "a.b",
    5,
)


def places(tree: Any) -> list[tuple[Any, Any]]:
    """List all (container, key) of a nested value."""
    found = []
    items = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, value in items:
        found += [(tree, key), *places(value)]
    return found


def is_real(value: Any) -> bool:
    """Tell a number that can be scaled."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e290


@st.composite
def mutated(draw: st.DrawFn, bases: tuple[dict[str, Any], ...] = BASES) -> dict[str, Any]:
    """Draw a valid scene with one to three changes that a user, a program or an accident could make."""
    scene = copy.deepcopy(draw(st.sampled_from(bases)))
    if draw(st.integers(0, 19)) == 19:
        scene = spatial(scene)
    for _ in range(draw(st.sampled_from([1, 1, 2, 3]))):
        change = draw(st.sampled_from(CHANGES))
        found = places(scene)
        if change in ("nudge", "scale", "negate"):
            found = [(container, key) for container, key in found if is_real(container[key])]
        if not found:
            continue
        container, key = draw(st.sampled_from(found))
        value = container[key]
        if change == "scale":
            container[key] = value * 10.0 ** draw(st.integers(-8, 8))
        elif change == "nudge":
            container[key] = (
                value * draw(st.floats(0.3, 3.0)) if isinstance(value, float) else value + draw(st.integers(-3, 9))
            )
        elif change == "negate":
            container[key] = -value
        elif change == "delete":
            del container[key]
        elif change == "copy":
            other, its = draw(st.sampled_from(found))
            container[key] = copy.deepcopy(other[its])
        elif change == "add" and isinstance(container, dict):
            container[draw(st.sampled_from(NAMES))] = draw(JUNK)
        elif change == "longer" and isinstance(value, list):
            container[key] = [*value, draw(JUNK)]
        else:
            container[key] = draw(JUNK)
    return scene


class HangError(Exception):
    """A job did not end in time."""


@contextmanager
def in_time() -> Iterator[None]:
    """Raise where the body takes longer than HANGS, the compilation of kernels apart."""
    with numba_event.install_recorder("numba:compile") as compiled:
        seen = [0]

        def ring(*_: object) -> None:
            count = len(compiled.buffer)
            if count == seen[0] and count % 2 == 0:  # a begin and an end each: an odd number of them is one at work
                raise HangError(f"more than {HANGS:g} s")
            seen[0] = count
            signal.setitimer(signal.ITIMER_PROF, HANGS)

        before = signal.signal(signal.SIGPROF, ring)
        signal.setitimer(signal.ITIMER_PROF, HANGS)
        try:
            yield
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0.0)
            signal.signal(signal.SIGPROF, before)


def finite(dataset: xr.Dataset) -> None:
    """Hold that no number of a result is nan or infinite."""
    for name, variable in dataset.variables.items():
        if variable.dtype.kind == "f":
            assert np.isfinite(variable.values).all(), f"{dataset.attrs.get('title')}: {name} is not finite"


def clear(error: Exception) -> None:
    """Hold that an error is one line that says what is wrong and what to do."""
    text = str(error)
    assert "\n" not in text
    assert len(text) < 1000
    assert "; allowed: " in text if isinstance(error, cp.SceneError) else "; try " in text, text


#: So much work a run of the suite asks for: steps over the stability limit, links times instants, links.  What asks for more is
#: the user's right, and may take its time (a cable of 1e18 N for an hour): it is moved for a shorter time.
STEPS, VALUES, LINKS = 5e3, 2e5, 2000


def to_move(scene: xr.Dataset) -> dict[str, Any]:
    """Give the options by which a run takes some tenths of a second at most, with all refinements of its step.

    Those that the scene lacks: links, instants; and those without which it would take long.
    """
    p = parameters(scene)
    options: dict[str, Any] = {}
    links = 5 if p.links is None else p.links
    if p.links is None or links > LINKS:
        links = min(links, LINKS // 100)
        options["links"] = links
    chain = chain_of(p, options.get("links"))
    # by law (21) of the Galerkin model a link stiffens with the square of its stretch
    ends = p.end_positions(np.linspace(0.0, p.duration or 0.0, 101))
    stretch = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).max() / chain.total_length
    shortest = min(chain.step_limit() / max(1.0, stretch), p.shortest_time_scale)
    most = STEPS * shortest / max(1.0, links / 10.0)
    if p.duration is None or p.interval is None:
        event("moved: without times of its own")
        options["times"] = np.linspace(0.0, min(4.0, most), 9)
    elif p.duration > most or p.duration / p.interval * links > VALUES:
        event("moved: for a shorter time")
        options["times"] = np.linspace(0.0, min(p.duration, most), 9)
    else:
        event("moved: for its own time")
    return options


def terms(scene: xr.Dataset) -> tuple[bool | int, ...]:
    """What decides which variants of the kernels a run compiles."""
    p = parameters(scene)
    ends = {end for end, _ in p.motions}
    varying = [load.factor is not None for load in p.point_loads]
    given = (p.mass_damping, p.link_viscosity, p.load, p.load_factor, p.free_end)
    return p.dims, len(ends), bool(varying), any(varying), *(item is not None for item in given)


@functools.cache
def compiled_anyway() -> set[tuple[bool | int, ...]]:
    """Terms of the scenes themselves: a mutation with others is only run where there is time to compile."""
    return {terms(cp.make_scene(base)) for base in (BASES if MANY else (SOFT,))}


def tried(what: str, function: Any, *arguments: Any, **options: Any) -> xr.Dataset | None:
    """Call `function`: a result without nan, or None after a clear error."""
    try:
        result = function(*arguments, **options)
    except cp.SceneError as error:
        event(f"{what}: refused")
        clear(error)
        return None
    except cp.RunStopped as error:
        event(f"{what}: stopped")
        clear(error)
        if error.partial is not None:
            finite(error.partial)
        return None
    event(f"{what}: a result")
    finite(result)
    return result


def the_main_job(mapping: dict[str, Any]) -> None:
    """Do what ``cablepod run`` does, and the condensed model."""
    before = repr(mapping)
    scene = tried("scene", cp.make_scene, mapping)
    assert repr(mapping) == before
    if scene is None:
        return
    tried("catenary.rest", cp.catenary.rest, scene)
    if not ALL_VARIANTS and terms(scene) not in compiled_anyway():
        event("not moved: a variant that is not compiled")
        return
    move = to_move(scene)
    tried("chain.rest", cp.chain.rest, scene, links=move.get("links"))
    chain = tried("chain.simulate", cp.chain.simulate, scene, **move, outputs=("position", "tension"))
    if chain is None:
        return
    for layout, model in (("separate", cp.galerkin), ("normal", cp.condensed)):
        modes = tried("pod.decompose", cp.pod.decompose, chain, layout=layout)
        if modes is not None:
            rank = min(2, modes.sizes["mode"])
            # few runs: the default alone, which compiles one scheme; many: a tolerance too, which may pick the other
            options = {"tolerance": 1e-2} if MANY else {"outputs": ("position",)}
            options["times"] = move.get("times")
            tried(f"{model.__name__}.simulate", model.simulate, scene, modes, rank=rank, **options)


@settings(max_examples=MANY or 200, **COMMON)
@given(mutated())
def test_a_mutated_scene_gives_a_result_or_a_clear_error(mapping):
    with in_time(), warnings.catch_warnings():
        warnings.simplefilter("error")  # what numpy warns of is a nan on its way
        for known in (cp.NotConvergedWarning, cp.OutOfRangeWarning, cp.UnusualSceneWarning):
            warnings.simplefilter("ignore", known)
        warnings.filterwarnings("ignore", message=r"catenary\.rest leaves out the point loads")
        the_main_job(mapping)
