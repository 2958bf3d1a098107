"""Models that lack a term refuse it by its key, so that none is left out in silence."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import pytest
from wind_scenes import GUY, WIND

import cablepod as cp

#: A guy that every model runs: of given length, in still air, with an end that moves.
PLAIN: dict[str, Any] = {
    **GUY,
    "cable": {name: value for name, value in GUY["cable"].items() if name != "top_tension"}
    | {"unstretched_length": 62.0},
    "motion": {"upper": {"x": {"kind": "one_minus_cosine", "amplitude": -0.07, "angular_frequency": 3.0}}},
    "damping": {"mass_proportional": 0.5},
    "chain": {"links": 8},
    "time": {"duration": 0.2, "interval": 0.1},
}
#: Calls of a scene, vibration modes, and modes of the coordinates.
CALLS: dict[str, Callable[[Any, Any, Any], Any]] = {
    "rigid.rest": lambda scene, modes, fields: cp.rigid.rest(scene),
    "rigid": lambda scene, modes, fields: cp.rigid.simulate(scene),
    "galerkin": lambda scene, modes, fields: cp.galerkin.simulate(scene, fields),
    "exact": lambda scene, modes, fields: cp.condensed.simulate(scene, modes, order="exact"),
    "prepare": lambda scene, modes, fields: cp.condensed.prepare(scene, modes),
    "orbit, exact": lambda scene, modes, fields: cp.periodic.orbit(scene, modes, order="exact"),
    "orbit, estimate": lambda scene, modes, fields: cp.periodic.orbit(scene, modes, outputs="error_estimate"),
    "response, estimate": lambda scene, modes, fields: cp.periodic.frequency_response(
        scene, modes, frequency=(2.9, 3.1), outputs="error_estimate"
    ),
}
#: Tables of a scene, what is said to be given, and the calls that refuse it.
REFUSED: dict[str, tuple[dict[str, Any], str, tuple[str, ...]]] = {
    "wind": ({"wind": WIND}, " 25 m/s", ("rigid.rest", "rigid", "galerkin")),
    "ice.thickness": ({"ice": {"thickness": 0.01}}, " 0.01", ("prepare",)),
    "damping.tension_proportional": ({"damping": {"tension_proportional": 1e-3}}, " 0.001", ("rigid", "galerkin", "prepare")),
    "damping.ratio": ({"damping": {"ratio": 0.02}}, " 0.02", ("rigid", "galerkin", "prepare")),
    "damping.ratios": ({"damping": {"ratios": [0.02, 0.01]}}, " [0.02, 0.01]", ("rigid", "galerkin", "prepare")),
    "segment": ({"segment": [{"to": 0.4}, {"density": 9000.0}]}, " 2 different parts", tuple(CALLS)),
    "attachment.1": ({"attachment": [{"arc_length": 0.3, "mass": 20.0}]}, "", tuple(CALLS)),
}  # fmt: skip
pytestmark = pytest.mark.filterwarnings("ignore::cablepod.errors.OutOfRangeWarning")  # of an orbit with two modes


@pytest.fixture(scope="module")
def modes() -> tuple[Any, Any]:
    """Vibration modes, and modes of the coordinates."""
    plain = cp.make_scene(PLAIN)
    return cp.condensed.vibration_modes(plain, rank=2), cp.pod.decompose(cp.chain.simulate(plain), rank=1)


@pytest.mark.parametrize("call", CALLS)
def test_without_the_table_it_runs(call: str, modes: Any) -> None:
    CALLS[call](cp.make_scene(PLAIN), *modes)


@pytest.mark.parametrize(("key", "call"), [(key, call) for key, row in REFUSED.items() for call in row[2]])
def test_it_is_refused_by_its_key(key: str, call: str, modes: Any) -> None:
    tables, given, _ = REFUSED[key]
    with pytest.raises(
        cp.SceneError,
        match=rf"^{re.escape(key)}: given{re.escape(given)}.*; allowed: (none|0 m).*; try: (c|order|more modes)",
    ):
        CALLS[call](cp.make_scene({**PLAIN, **tables}), *modes)
