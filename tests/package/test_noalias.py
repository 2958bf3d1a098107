"""Kernels compiled for arrays that share no memory are called with such arrays.

The compiler takes their word for it: a kernel that writes to an array which another argument shares gives wrong numbers.  Here
these kernels and all that call them run as plain Python, in a process of its own, and each call is looked at.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

TESTS = Path(__file__).resolve().parents[1]
CHECK = """
import functools, sys
import numpy as np
from cablepod import _jit

called = set()

def compiled(function=None, *, noalias=False, counted=True, **options):
    if function is None:
        return lambda kernel: compiled(kernel, noalias=noalias)
    if not noalias:
        return function

    def arrays_of(arguments):
        flat = []
        for item in arguments:
            if type(item).__name__ == "Sizes":  # whose lengths alone count
                continue
            named = isinstance(item, tuple) and hasattr(item, "_fields")
            flat += arrays_of(item) if named else [item] if isinstance(item, np.ndarray) else []
        return flat

    @functools.wraps(function)
    def checked(*arguments):
        arrays = [array for array in arrays_of(arguments) if array.size]
        pairs = [(a, b) for i, a in enumerate(arrays) for b in arrays[i + 1 :] if np.shares_memory(a, b)]
        before = [(a.copy(), b.copy()) for a, b in pairs]
        result = function(*arguments)
        for now, then in zip(pairs, before):  # to share what nobody writes to is harmless
            if not all(np.array_equal(*both, equal_nan=True) for both in zip(now, then)):
                sys.exit(f"{function.__module__}.{function.__name__}: writes to memory that two arguments share")
        called.add(f"{function.__module__}.{function.__name__}")
        return result

    return checked

_jit.compiled = compiled
sys.path[:0] = [TESTS, TESTS + "/condensed"]
import cablepod as cp
from scenes import HARMONIC, SOFT, full_modes, spatial

np.seterr(all="ignore")
"""
SCENES = """
def scenes_of(dims, links, count):
    mapping = {**SOFT, "motion": {"upper": {"x": {**HARMONIC, "amplitude": 0.02}}}, "damping": {"mass_proportional": 0.8}}
    mapping["chain"] = {"links": links}
    if dims == 3:
        mapping = spatial(mapping)
        mapping["ends"]["upper"][2] = 1.0
    mapping["cable"] = {**mapping["cable"], "diameter": 0.02}
    scene = cp.make_scene(mapping)
    return scene.assign(cable_top_tension=("member", np.linspace(220.0, 240.0, count), scene["cable_top_tension"].attrs))

def windy(dims):
    return {"wind.speed": [10.0], "wind.direction": [[1.0, 0.0, 0.5][:dims]]}
"""
RUNS = {
    "condensed": """
for dims in (2, 3):
    scenes, modes = scenes_of(dims, 6, 2), full_modes(dims=dims)
    outputs = ("position", "tension", "tension_extremes")
    cp.condensed.simulate(scenes, modes, rank=2, step=0.01, times=[0.0, 0.02], outputs=outputs)
    cp.condensed.simulate(scenes, modes, rank=2, times=[0.0, 0.3], outputs=outputs)
    cp.condensed.simulate(scenes.isel(member=0), modes, rank=2, times=[0.0, 0.3])
""",
    "chain": """
from cablepod.chain import _lanes
_lanes.MIN_MEMBERS = 2
for dims in (2, 3):
    for scheme in ("trapezoidal", "generalized_alpha", "energy_momentum"):
        outputs = ("position", "tension_extremes")
        cp.chain.simulate(scenes_of(dims, 3, 2), scheme=scheme, step=0.05, times=[0.0, 0.1], outputs=outputs)
    for links in (3, 11):  # fewer particles than a vector has numbers, and more
        scene = scenes_of(dims, links, 1).isel(member=0)
        scene = cp.ensemble.design(scene, windy(dims), members=1, sampling="list").isel(member=0)
        cp.chain.simulate(scene, step=1e-3, times=[0.0, 0.05], outputs=outputs)
""",
    "cable": """
for dims in (2, 3):
    scene = scenes_of(dims, 3, 1).isel(member=0)
    damped = scene.assign(damping_tension_proportional=((), 1e-3, {"units": "s"}))
    scene = cp.ensemble.design(scene, windy(dims), members=1, sampling="list").isel(member=0)
    outputs = ("position", "velocity", "tension_extremes")
    for law in ("linear", "green"):
        for each in (scene, damped):
            for scheme, step in (("velocity_verlet", 1e-3), ("trapezoidal", 0.05)):
                options = {"scheme": scheme, "law": law, "step": step, "elements": 2, "order": 2, "outputs": outputs}
                cp.cable.simulate(each, times=[0.0, 4.0 * step], **options)
""",
}
#: Kernels that each run must call.
KERNELS = {
    "condensed": (
        "_kernels_closure", "_kernels_recorder", "_kernels_explicit", "_kernels_frame", "_kernels_sines", "_kernels_error",
    ),
    "cable": ("_kernels_forces", "_kernels_explicit", "_kernels_trapezoidal"),
    "chain": ("_kernels_links", "_kernels_banded", "_kernels_newton", "_kernels_implicit", "_kernels_drag"),
}  # fmt: skip


@pytest.mark.parametrize("model", RUNS)
def test_no_kernel_writes_to_memory_that_two_of_its_arguments_share(model):
    script = f"TESTS = {str(TESTS)!r}\n{CHECK}{SCENES}{RUNS[model]}\nprint(*called)"
    done = subprocess.run([sys.executable, "-W", "ignore", "-c", script], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    for name in KERNELS[model]:
        assert f".{name}." in done.stdout, name
