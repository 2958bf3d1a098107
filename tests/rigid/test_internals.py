"""Chain of rigid links from inside: RATTLE turned back, and a run whose ends nobody looked at before."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scenes import RIGID_CABLE, link_length_errors, rigid_scene

import cablepod as cp
from cablepod.discretisation._chain import chain_of
from cablepod.integrate._output_times import OutputTimes
from cablepod.parameters._from_scene import parameters
from cablepod.rigid import _kernels_layout as layout
from cablepod.rigid import _simulate as rigid
from cablepod.rigid import _start as rigid_start
from cablepod.rigid._runs import RigidRun, RigidStepper


def test_rattle_can_be_turned_back(soft):
    line = [[0.0, 0.0], [5.0, -2.0], [8.0, 6.0]]
    scene = rigid_scene(soft, motion={}, cable={**RIGID_CABLE, "unstretched_length": 13.93}, initial={"points": line})
    chain = chain_of(parameters(scene))
    run = RigidRun(chain, rigid_start.start(chain), times=np.array([10.0]))
    stepper = RigidStepper(run, OutputTimes.of(run.times, 50.0))
    first = stepper.s[:3].copy()
    assert stepper.advance(0, 100) == 100
    assert np.abs(stepper.s[:3] - first).max() > 0.5
    stepper.s[layout.V : layout.V + 3] *= -1.0
    assert stepper.advance(0, 100) == 100
    # 200 steps that each solve their constraints to 1e-14, in a motion that is not chaotic yet
    assert np.abs(stepper.s[:3] - first).max() < 1e-10
    assert np.abs(stepper.s[layout.V : layout.V + 3]).max() < 1e-9


@pytest.mark.parametrize("formulation", ["rattle", "index1"])
def test_a_chain_pulled_straight_stops_with_its_partial_result(soft, formulation, monkeypatch):
    # as if nobody had looked at the distance of the ends: 11 m at 0.5 s
    monkeypatch.setattr(rigid, "check_ends", lambda *_: None)
    motion = {
        axis: {"kind": "polynomial", "coefficients": [0.0, 4.0 * part]} for axis, part in (("x", 0.8), ("y", 0.6))
    }
    with pytest.raises(cp.RunStopped, match=rf" at 0\.\d+ s \({formulation}, step 0\.01 s") as caught:
        cp.rigid.simulate(
            rigid_scene(soft, motion={"upper": motion}),
            times=np.arange(11) / 10,
            formulation=formulation,
            step=0.01,
            outputs=("position", "velocity", "tension", "tension_extremes"),
        )
    partial = caught.value.partial
    assert 0.3 <= float(partial.time[-1]) <= 0.5
    # it says when: after what was partial, and not after the chain is straight
    when = float(re.search(r" at (0\.\d+) s", str(caught.value))[1])
    assert float(partial.time[-1]) <= when <= 0.5
    assert np.isfinite(partial.position).all()
    assert np.abs(link_length_errors(partial)).max() < 1e-12
    assert partial.attrs["incomplete"].startswith("stopped at 0.")
