"""Every warning names the line of the user: all calls of ``warnings.warn`` ask for it, and warnings of each package name it."""

from __future__ import annotations

import ast
import inspect
import warnings
from pathlib import Path

import numpy as np
import pytest

import cablepod as cp
from cablepod.integrate import _scheme as integrate_scheme

PACKAGE = Path(cp.__file__).parent


def test_no_warning_counts_the_frames_by_hand():
    found = []
    texts = {path: path.read_text() for path in PACKAGE.rglob("*.py")}
    for path, text in texts.items():
        for node in ast.walk(ast.parse(text)) if "warnings" in text else ():
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "warnings.warn":
                levels = [item.value for item in node.keywords if item.arg == "stacklevel"] + node.args[2:]
                found.append((path.name, node.lineno, [ast.unparse(level) for level in levels]))
    # all others call `errors.warn`, which counts them itself
    assert [(name, levels) for name, _, levels in found] == [("errors.py", ["level"])]


@pytest.fixture
def modes(soft):
    run = cp.chain.simulate(cp.make_scene(soft), tolerance=1e-3)
    return {layout: cp.pod.decompose(run, rank=2, layout=layout) for layout in ("normal", "separate")}


def lifted(soft):
    """A scene whose cable goes slack."""
    return cp.make_scene({**soft, "load": {"uniform": [0.0, 30.0], "kind": "ramp", "amplitude": 1.0, "duration": 1.0}})


#: Calls that warn, by the beginning of the text, of a mapping of a scene and its modes.
CALLS = {
    "catenary.rest leaves out": lambda soft, _: cp.catenary.rest(
        cp.make_scene({**soft, "point_load": [{"arc_length": 0.5, "force": [0.0, -1.0]}]})
    ),
    "step: given": lambda soft, _: cp.chain.simulate(cp.make_scene(soft), scheme="trapezoidal", step=2.0),
    "the links hold": lambda soft, _: cp.chain.simulate(cp.make_scene(soft), step=1e-3),
    "1 of 2 members failed": lambda soft, _: cp.chain.simulate(
        cp.ensemble.design(cp.make_scene(soft), {"cable.top_tension": [200.0, 240.0]}, members=2).assign(
            cable_top_tension=("member", [200.0, 1.0], {"units": "N"})
        ),
        step=1e-3,
    ),
    "the step is too long": lambda soft, _: cp.rigid.simulate(
        cp.make_scene(soft).drop_vars("cable_top_tension").assign(cable_unstretched_length=((), 12.0, {"units": "m"})),
        step=0.4,
    ),
    "the chordwise force falls": lambda soft, modes: cp.condensed.simulate(
        lifted(soft), modes["normal"], step=1e-3, times=[0.0, 1.0]
    ),
    "links are compressed": lambda soft, modes: cp.galerkin.simulate(
        lifted(soft), modes["separate"], step=1e-3, times=[0.0, 2.0], outputs=()
    ),
}


@pytest.mark.parametrize("text", CALLS)
def test_a_warning_names_the_line_of_the_user(soft, modes, text, monkeypatch):
    if text == "the links hold":
        monkeypatch.setattr(integrate_scheme, "ENERGY_WARN", 1e-9)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        CALLS[text](soft, modes)
    own = [item for item in caught if str(item.message).startswith(text)]
    assert len(own) == 1
    assert {item.filename for item in caught} == {__file__}
    lines, first = inspect.getsourcelines(CALLS[text])
    assert first <= own[0].lineno < first + len(lines)


def test_a_helper_of_the_user_is_the_line_not_what_calls_it(soft):
    def helper(scene):
        return cp.chain.simulate(scene, scheme="trapezoidal", step=2.0, times=np.array([0.0, 4.0]))

    with pytest.warns(cp.NotConvergedWarning) as caught:
        helper(cp.make_scene(soft))
    assert caught[0].lineno == inspect.getsourcelines(helper)[1] + 1
