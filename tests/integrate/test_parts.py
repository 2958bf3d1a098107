"""Parts alone: blocks of steps, of which the one that fails is found by few repetitions; weights of means."""

from __future__ import annotations

import numpy as np
import pytest
from models_of import ALL, options_of, scene_of

import cablepod as cp
from cablepod.integrate import _march as march
from cablepod.integrate import _means


@pytest.mark.parametrize("failing", [0, 1, 17, 999, 4095, 4096, 5000, 9999])
def test_the_first_step_that_fails_is_found(monkeypatch, failing):
    monkeypatch.setattr(march, "BLOCK", 4096)
    state, calls = np.zeros(1), []

    def advance(start, steps):
        assert state[0] == start  # each repetition starts from the state before its first step
        calls.append(steps)
        state[0] += steps
        return start + steps <= failing

    assert march.advance_in_blocks(advance, (state,), 10000, None) == failing
    assert sum(calls) < 3 * 10000
    assert len(calls) < 3 + 3 * march.PARTS + 3


def test_a_block_that_succeeds_in_parts_is_taken():
    state = np.zeros(1)

    def advance(start, steps):
        state[0] += steps
        return steps < 100

    assert march.advance_in_blocks(advance, (state,), 300, None) is None
    assert state[0] == 300


def test_weights_are_those_of_the_linear_interpolant():
    steps = np.array([0, 1, 4, 5, 9])
    line = 3.0 - 0.25 * steps  # is its own interpolant
    for begin, end in [(0.0, 9.0), (0.3, 0.6), (0.5, 4.5), (2.0, 9.0), (4.0, 5.0)]:
        weight = _means.weights(steps, begin, end)
        np.testing.assert_allclose([weight.sum(), weight @ line], [1.0, 3.0 - 0.125 * (begin + end)], rtol=1e-14)
    # the hat function at 4 over [2, 4.5]: (1/3 + 1)/2 * 2 + (1 + 1/2)/2 * 1/2
    np.testing.assert_allclose(_means.weights(steps, 2.0, 4.5)[2], (4 / 3 + 3 / 8) / 2.5, rtol=1e-14)


@pytest.mark.parametrize("model", ALL)
def test_means_of_long_runs_are_integrated_over_several_steps_each(soft, model, monkeypatch):
    scene, names = scene_of(model, soft), ("tension_mean", "tension_rms")
    options = {"step": 5e-4 if model == "cable" else 2.5e-3, "outputs": names, **options_of(model, soft)}
    run = getattr(cp, model).simulate(scene, **options)
    monkeypatch.setattr(_means, "MAX_INTERVALS", 200)
    coarse = getattr(cp, model).simulate(scene, **options)
    for name in names:
        assert (coarse[name] != run[name]).any()
        np.testing.assert_allclose(coarse[name], run[name], rtol=1e-3)
