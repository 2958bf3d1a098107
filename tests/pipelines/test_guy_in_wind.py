"""Studies of a guy in the wind: MoorDyn as a wind tunnel, the condensed model beside chains."""

from __future__ import annotations

import numpy as np
import pytest
from guy_in_wind import insulator, wind_tunnel
from guy_in_wind import run as gusts

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


@pytest.mark.slow
def test_a_guy_with_an_insulator():
    duration = 60.0
    given = insulator.scene(duration)
    wind = cp.wind.field(given)
    modes = cp.condensed.vibration_modes(given, rank=insulator.RANK, static_modes=True)
    model = insulator.condensed(wind, given, modes, "with kink", 0.01)[2]
    chain = insulator.chain(wind, duration, insulator.FINEST)[2]
    bare = insulator.condensed(wind, gusts.scene(duration, insulator.FINEST), modes.isel(mode=slice(6)), "", 0.01)[2]
    true, found, without = (gusts.measures(call().tension.isel(link=-1)) for call in (chain, model, bare))
    assert np.abs(found / true - 1.0).max() < 0.02
    assert np.abs(without / true - 1.0).max() > 0.02
    assert min(gusts.seconds_of(model) for _ in range(3)) < 0.2 * gusts.seconds_of(chain)
