"""Estimates of the error by a richer model, against errors that are known."""

from __future__ import annotations

import numpy as np
import pytest
from periodic_scenes import guy, loaded

import cablepod as cp


def response_of(scene, modes, **options):
    return cp.periodic.frequency_response(scene, modes, frequency=(12.4, 12.75), follow=(), **options)


@pytest.mark.slow  # 2 s
def test_the_estimate_of_bifurcations_is_near_their_error():
    scene = guy(damping=0.09)
    modes = cp.condensed.vibration_modes(scene, rank=2)
    found = response_of(scene, modes, outputs=("error_estimate",))
    assert found.attrs["error_estimate_by"] == "2 more modes, order exact"
    best = response_of(scene, cp.condensed.vibration_modes(scene, rank=6), order="exact", outputs=())
    assert list(found.bifurcation_kind.values) == list(best.bifurcation_kind.values)
    error = np.abs(found.bifurcation_angular_frequency.values / best.bifurcation_angular_frequency.values - 1.0)
    estimate = found.bifurcation_error_estimate.values
    assert np.isfinite(estimate).all()
    # two more modes of four make nearly all of the error of two
    assert estimate == pytest.approx(error, rel=0.3)
    assert error.max() > 1e-5


def test_the_estimate_of_an_orbit_is_near_its_error():
    scene = guy(angular_frequency=12.46, damping=0.1)
    modes = cp.condensed.vibration_modes(scene, rank=2)
    orbit = cp.periodic.orbit(scene, modes, outputs=("position", "error_estimate"))
    best = cp.periodic.orbit(scene, cp.condensed.vibration_modes(scene, rank=8), order="exact", outputs=("position",))

    def size(field):
        return float(np.sqrt((field**2).sum("coordinate").mean("particle")).max())

    error = size(orbit.position - best.position) / size(best.position - best.position.isel(time=slice(-1)).mean("time"))
    # sag that the modes lack is most of it: of 1/27 and 1/125 of the third and fifth sine the estimate sees the first
    assert float(orbit.error_estimate) == pytest.approx(error, rel=0.3)
    assert orbit.attrs["error_estimate_by"] == "2 more modes, order exact"


def test_modes_beyond_the_rank_are_those_of_the_richer_model():
    scene = loaded(0.4, 7.0, 0.3)
    modes = cp.condensed.vibration_modes(scene, rank=3, static_modes=False)
    few = cp.periodic.orbit(scene, modes, rank=2, outputs=("error_estimate",))
    assert few.attrs["error_estimate_by"] == "1 more modes, order exact"
    damped = scene.assign(damping_tension_proportional=((), 1e-4, {"units": "s"}))
    all_of_them = cp.periodic.orbit(damped, modes.assign_attrs(method="svd"), outputs=("error_estimate",))
    assert all_of_them.attrs["error_estimate_by"] == "order exact"
    assert 0.0 < float(all_of_them.error_estimate) < float(few.error_estimate)
