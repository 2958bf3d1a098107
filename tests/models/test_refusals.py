"""Models that lack a term refuse it by its key, so that none is left out in silence."""

from __future__ import annotations

import re
from typing import Any

import pytest
from wind_scenes import GUY, WIND

import cablepod as cp

#: Tables of a scene, what is said to be given, and the models that refuse it.
REFUSED: dict[str, tuple[dict[str, Any], str, tuple[str, ...]]] = {
    "wind": ({"wind": WIND}, "25 m/s", ("rigid", "galerkin")),
    "ice.thickness": ({"ice": {"thickness": 0.01}}, "0.01", ("prepare",)),
    "damping.tension_proportional": ({"damping": {"tension_proportional": 1e-3}}, "0.001", ("rigid", "galerkin", "prepare")),
    "damping.ratio": ({"damping": {"ratio": 0.02}}, "0.02", ("rigid", "galerkin", "prepare")),
    "damping.ratios": ({"damping": {"ratios": [0.02, 0.01]}}, "[0.02, 0.01]", ("rigid", "galerkin", "prepare")),
}  # fmt: skip


@pytest.fixture(scope="module")
def calls() -> dict[str, Any]:
    """Calls of each model on a scene."""
    plain = cp.make_scene({**GUY, "time": {"duration": 0.2, "interval": 0.1}})
    fields = cp.pod.decompose(cp.chain.simulate(plain, step=5e-4, times=[0.0, 0.1, 0.2]), rank=2)
    modes = cp.condensed.vibration_modes(plain, rank=2)
    return {
        "rigid": lambda scene: cp.rigid.simulate(scene, step=1e-3),
        "galerkin": lambda scene: cp.galerkin.simulate(scene, fields),
        "prepare": lambda scene: cp.condensed.prepare(scene, modes),
    }


@pytest.mark.parametrize(("key", "model"), [(key, model) for key, row in REFUSED.items() for model in row[2]])
def test_it_is_refused_by_its_key(key: str, model: str, calls: dict[str, Any]) -> None:
    tables, given, _ = REFUSED[key]
    with pytest.raises(
        cp.SceneError, match=rf"^{re.escape(key)}: given {re.escape(given)}.*; allowed: (none|0 m).*; try: c"
    ):
        calls[model](cp.make_scene({**GUY, **tables}))
