"""Random scenes that nobody meant end in a result or a clear error.

Mutations of valid scenes: 200 in the suite, as many as CABLEPOD_FUZZ says otherwise, from another seed each time;
tests/README.md has the command (add --hypothesis-show-statistics).  CABLEPOD_FUZZ_VARIANTS=1 adds those whose terms need
kernels compiled that no other scene here needs, some seconds each.
"""

from __future__ import annotations

import functools
import os
import warnings
from typing import Any

import numpy as np
import xarray as xr
from hypothesis import event, given, settings
from mutations import in_time, mutated, tried
from random_scenes import COMMON, MANY
from scenes import SOFT

import cablepod as cp
from cablepod.discretisation._chain import chain_of
from cablepod.parameters._from_scene import parameters

ALL_VARIANTS = bool(os.environ.get("CABLEPOD_FUZZ_VARIANTS"))
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
@given(mutated(BASES))
def test_a_mutated_scene_gives_a_result_or_a_clear_error(mapping):
    with in_time(), warnings.catch_warnings():
        warnings.simplefilter("error")  # what numpy warns of is a nan on its way
        for known in (cp.NotConvergedWarning, cp.OutOfRangeWarning, cp.UnusualSceneWarning, cp.CoarseWarning):
            warnings.simplefilter("ignore", known)
        warnings.filterwarnings("ignore", message=r"catenary\.rest leaves out the point loads")
        the_main_job(mapping)
