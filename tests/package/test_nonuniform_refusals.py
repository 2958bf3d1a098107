"""Models without segments and attachments refuse them by key, so that none is left out in silence."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

import cablepod as cp

GUY: dict[str, Any] = {
    "cable": {
        "youngs_modulus": 1.6e11, "area": 1.25e-4, "density": 8000.0, "unstretched_length": 62.0, "thermal_expansion": 1e-5,
    },
    "ends": {"lower": [0.0, 0.0], "upper": [20.4, 57.7]},
    "motion": {"upper": {"x": {"kind": "one_minus_cosine", "amplitude": -0.07, "angular_frequency": 3.0}}},
    "damping": {"mass_proportional": 0.5},
    "chain": {"links": 8},
    "time": {"duration": 0.2, "interval": 0.1},
}  # fmt: skip
THINGS = {
    "attachment.1": {"attachment": [{"arc_length": 0.3, "mass": 20.0}]},
    "segment": {"segment": [{"to": 0.4}, {"density": 9000.0}]},
}


@pytest.fixture(scope="module")
def modes() -> Any:
    return cp.condensed.vibration_modes(cp.make_scene(GUY), rank=2)


@pytest.fixture(scope="module")
def field_modes() -> Any:
    return cp.pod.decompose(cp.chain.simulate(cp.make_scene(GUY)), rank=1)


CALLS: dict[str, Callable[[Any, Any, Any], Any]] = {
    "rigid.rest": lambda scene, modes, fields: cp.rigid.rest(scene),
    "rigid.simulate": lambda scene, modes, fields: cp.rigid.simulate(scene),
    "galerkin.simulate": lambda scene, modes, fields: cp.galerkin.simulate(scene, fields),
    "condensed.simulate, exact": lambda scene, modes, fields: cp.condensed.simulate(scene, modes, order="exact"),
    "condensed.prepare": lambda scene, modes, fields: cp.condensed.prepare(scene, modes),
    "periodic.orbit, exact": lambda scene, modes, fields: cp.periodic.orbit(scene, modes, order="exact"),
    "periodic.orbit, estimate": lambda scene, modes, fields: cp.periodic.orbit(scene, modes, outputs="error_estimate"),
    "periodic.frequency_response": lambda scene, modes, fields: cp.periodic.frequency_response(
        scene, modes, frequency=(2.9, 3.1), outputs="error_estimate"
    ),
}


@pytest.mark.filterwarnings("ignore::cablepod.errors.OutOfRangeWarning")  # of an orbit with two modes
@pytest.mark.parametrize("key", THINGS)
@pytest.mark.parametrize("call", CALLS)
def test_it_names_the_key(call: str, key: str, modes: Any, field_modes: Any) -> None:
    scene = cp.make_scene({**GUY, **THINGS[key]})
    with pytest.raises(cp.SceneError, match=rf"^{key}: given"):
        CALLS[call](scene, modes, field_modes)
    CALLS[call](cp.make_scene(GUY), modes, field_modes)  # the refusal is of the key alone


@pytest.mark.parametrize("table", ["segment", "attachment"])
def test_a_mast_has_no_such_table(table: str) -> None:
    with pytest.raises(cp.SceneError, match=rf"^{table}: unknown key or table of a mast"):
        cp.make_scene({"mast": {}, table: [{}]})
