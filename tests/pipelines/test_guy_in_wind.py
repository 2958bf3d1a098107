"""Studies of a guy in the wind: MoorDyn as a wind tunnel, the condensed model beside chains."""

from __future__ import annotations

import numpy as np
import pytest
from guy_in_wind import run as gusts
from guy_in_wind import wind_tunnel

import cablepod as cp


@pytest.mark.slow
def test_the_chain_in_wind_agrees_with_moordyn(capfd):
    pytest.importorskip("moordyn")
    tunnel = wind_tunnel.compare(20, 10.0)
    position, tension = tunnel.errors
    assert position < wind_tunnel.POSITION_RTOL
    assert tension < wind_tunnel.TENSION_RTOL
    # in still air the guy would hang elsewhere
    still = cp.catenary.rest(wind_tunnel.scene(20, 10.0), points=21).position.values
    assert np.abs(tunnel.position[0] - still).max() > 100.0 * position * tunnel.chain.position.values.std(axis=0).max()


@pytest.mark.slow
def test_the_condensed_model_is_as_good_as_a_chain_and_faster():
    duration = 60.0
    wind = cp.wind.field(gusts.scene(duration))
    truth = gusts.cable(wind, duration, 16)
    model, chain = gusts.condensed(wind, duration, 4), gusts.chain(wind, duration, 40, "velocity_verlet", None)
    for candidate in (model, chain):
        assert gusts.errors(candidate.call(), truth).max() < 0.005
    seconds = [min(gusts.seconds_of(candidate.call) for _ in range(3)) for candidate in (model, chain)]
    assert seconds[0] < seconds[1]
