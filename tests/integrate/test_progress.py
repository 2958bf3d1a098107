"""The fraction that a call reports never falls and ends at 1, however many runs the call has."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from models_of import ALL, options_of, scene_of

import cablepod as cp


def fractions_of(soft, **options):
    """Run a chain for long enough that each run reports several times; return what is reported."""
    seen = []
    scene = cp.make_scene({**soft, "time": {"duration": 1200.0, "interval": 1200.0}})
    run = cp.chain.simulate(scene, scheme="velocity_verlet", outputs=("position",), progress=seen.append, **options)
    return seen, run.attrs["number_of_steps"]


def test_each_of_several_runs_takes_half_of_what_is_left(soft):
    seen, steps = fractions_of(soft, tolerance=1e-2)
    for runs, share in enumerate((0.5, 0.25), 1):
        own = [fraction for fraction in seen if 1.0 - 2.0 * share < fraction <= 1.0 - share]
        # a report after each block of 65536 steps, of which the second run has half as many again or more
        assert own[-1] == 1.0 - share
        assert np.diff([1.0 - 2.0 * share, *own[:-1]]) == pytest.approx(own[0] - 1.0 + 2.0 * share, rel=1e-9)
        assert len(own) > runs
    assert seen[-1] == 1.0
    assert steps > 2 * 65536


def test_a_run_alone_reports_its_own_fraction(soft):
    seen, steps = fractions_of(soft, step=4e-3)
    assert steps == 300_000
    # one step more, for the rates half a step after the last instant
    assert seen == pytest.approx([*(65536 / 300_001 * np.arange(1, 5)), 1.0])


@pytest.mark.parametrize("model", ALL)
@pytest.mark.parametrize("options", [{"tolerance": 1e-3}, {"step": 1e-3}], ids=str)
def test_progress_never_falls_and_ends_at_one(soft, model, options):
    soft["time"], seen = {"duration": 1.0, "interval": 0.25}, []
    if model == "cable" and "step" in options:
        options = {"step": 1e-4}
    options = options | options_of(model, soft)
    getattr(cp, model).simulate(scene_of(model, soft), progress=seen.append, **options)
    assert all(0.0 < before < after for before, after in itertools.pairwise(seen))
    assert seen[-1] == 1.0
    if "tolerance" in options:
        assert len(seen) > 2  # two runs, and the end


def test_elements_by_tolerance_are_several_runs_even_with_a_step(soft):
    scene = cp.make_scene({**soft, "time": {"duration": 0.5, "interval": 0.25}})
    seen = []
    cp.cable.simulate(scene, step=5e-5, tolerance=None, progress=seen.append)
    assert seen == sorted(set(seen))
    assert seen[-1] == 1.0
