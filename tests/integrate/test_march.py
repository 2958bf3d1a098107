"""Advance in blocks: the step that fails is found by few repetitions of parts."""

from __future__ import annotations

import numpy as np
import pytest

from cablepod.integrate import _march as march


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
