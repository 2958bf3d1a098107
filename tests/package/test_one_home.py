"""Laws, closure, drag, dampings, utilisation have one home each: altered there, all models and tables that have them change."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest
from children import environment, run_python

import cablepod

#: Term -> its file, the line of its sign, and that line with the other sign.
SIGNS = {
    "closure": (
        "discretisation/_formulas.py", "return stiffness * (stretch - 1.0) - load + sag",
        "return stiffness * (stretch - 1.0) - load - sag",
    ),
    "drag": (
        "condensed/_kernels_drag.py", "return chordwise * normal - slope * along", "return chordwise * normal + slope * along"
    ),
    "damping by the tension": (
        "discretisation/_formulas.py", "return damping * rate * (tension > 0.0)", "return -damping * rate * (tension > 0.0)"
    ),
    "drag of particles": ("wind/_kernels_drag.py", "ux -= along * tx", "ux += along * tx"),
    "linear law": (
        "discretisation/_formulas.py", "return stiffness * (1.0 - inverse_stretch)",
        "return stiffness * (1.0 + inverse_stretch)",
    ),
    "law (21)": (
        "discretisation/_formulas.py", "return 0.5 * stiffness * (squared_stretch - 1.0)",
        "return 0.5 * stiffness * (squared_stretch + 1.0)",
    ),
    "viscosity": (
        "discretisation/_formulas.py", "return elastic + damping * rate / square", "return elastic - damping * rate / square"
    ),
    "utilisation": ("parameters/_utilisation.py", "return tension / strength", "return strength / tension"),
    "damping by mass": ("discretisation/_mass_damping.py", "-np.expm1(-damping * time)", "np.expm1(-damping * time)"),
}  # fmt: skip
#: Calls that have a term: masts and hosts have no damping by the tension, periodic responses no wind.
CALLS = {
    "closure": ["run", "batch", "orbit", "mast", "host"],
    "drag": ["windy run", "windy batch", "mast", "windy host"],
    "damping by the tension": [
        "damped chain",
        "damped implicit chain",
        "damped cable",
        "damped implicit cable",
        "damped run",
        "damped batch",
        "damped exact run",
        "damped orbit",
        "damped exact orbit",
    ],
    "drag of particles": ["windy chain", "windy implicit chain", "windy cable", "mast of chains"],
    "linear law": ["chain", "implicit chain", "conserving chain", "cable", "exact run", "mast of chains"],
    "law (21)": ["green chain", "green implicit chain", "green conserving chain", "green cable", "green exact run"],
    "viscosity": ["viscous chain", "viscous implicit chain", "viscous cable", "mast of chains"],
    "utilisation": ["used at rest", "used in stringing", "used guys at rest", "used guys"],
    "damping by mass": ["slow chain", "slow cable", "slow run", "slow batch"],
}
#: Prints a number of each call; kernels are not compiled, so that it takes seconds.
CODE = """
import copy, json, sys, warnings
import numpy as np
import cablepod as cp
from cablepod.errors import AllFailedError, RunStopped, SceneError
from mast_scenes import WIND, small
from periodic_scenes import GUY
from wind_scenes import GUY as CABLE, WIND as STEADY

warnings.simplefilter("ignore")
SHORT = {"duration": 0.2, "interval": 0.1}
STRENGTH = {"breaking_strength": 1e5}

def guy(damping):
    mapping = copy.deepcopy(GUY)
    mapping["damping"] |= damping
    mapping["time"] = SHORT
    return cp.make_scene(mapping)

def windy():
    return cp.make_scene({**CABLE, "wind": STEADY, "time": SHORT})

def mast(**options):
    def change(mapping):
        mapping["wind"], mapping["mast"]["drag_area"], mapping["time"] = WIND, 0.3, {"duration": 0.4, "interval": 0.04}
        del mapping["mast"]["load"]
    return cp.mast.simulate(small(change), **options).guy_tension

def strong():
    return cp.make_scene({**GUY, "cable": {**GUY["cable"], **STRENGTH, "thermal_expansion": 1e-5}})

def strong_mast():
    def change(mapping):
        mapping["cables"]["guy"] |= STRENGTH
        mapping["time"] = {"duration": 0.08, "interval": 0.04}
    return small(change)

def run(scene, **options):
    return cp.condensed.simulate(scene, modes(scene), outputs=("tension",), **options).tension

def modes(scene):
    return cp.condensed.vibration_modes(scene, rank=1)

def batch(scene, **options):
    members = cp.ensemble.design(scene, {"cable.top_tension": [14000.0, 16000.0]}, members=2)
    return cp.condensed.simulate(members, modes(scene), outputs=("tension",), **options).tension

def orbit(scene, **options):
    return cp.periodic.orbit(scene, modes(scene), harmonics=2, out_of_plane=False, outputs=(), **options).growth

def host(scene):
    model = cp.condensed.prepare(scene, modes(scene))
    end, velocity = model.end_position, np.ones(model.end_position.size)
    return np.array([model.step(end + 1e-3 * k * velocity, velocity, 1e-3) for k in range(1, 4)])

def chain(scene, **options):
    return cp.chain.simulate(scene, links=4, **options).tension

def cable(scene, **options):
    return cp.cable.simulate(scene, elements=1, order=3, **options).tension

def exact(scene, **options):
    return run(scene, order="exact", **options)

VERLET, GREEN = {"scheme": "velocity_verlet"}, {"law": "green"}
IMPLICIT, CONSERVING = ({"scheme": name, "step": 0.02} for name in ("generalized_alpha", "energy_momentum"))
plain, damped, slow, viscous = {}, {"tension_proportional": 1e-3}, {"mass_proportional": 2.0}, {"link_viscosity": 1e-3}
calls = {
    "chain": lambda: chain(guy(plain), **VERLET), "implicit chain": lambda: chain(guy(plain), **IMPLICIT),
    "conserving chain": lambda: chain(guy(plain), **CONSERVING), "cable": lambda: cable(guy(plain), law="linear"),
    "exact run": lambda: exact(guy(plain)),
    "green chain": lambda: chain(guy(plain), **VERLET, **GREEN),
    "green implicit chain": lambda: chain(guy(plain), **IMPLICIT, **GREEN),
    "green conserving chain": lambda: chain(guy(plain), **CONSERVING, **GREEN),
    "green cable": lambda: cable(guy(plain), **GREEN), "green exact run": lambda: exact(guy(plain), **GREEN),
    "viscous chain": lambda: chain(guy(viscous), **VERLET), "viscous implicit chain": lambda: chain(guy(viscous), **IMPLICIT),
    "viscous cable": lambda: cable(guy(viscous), law="linear"),
    "run": lambda: run(guy(plain)), "batch": lambda: batch(guy(plain)), "orbit": lambda: orbit(guy(plain)),
    "damped chain": lambda: chain(guy(damped), **VERLET), "damped implicit chain": lambda: chain(guy(damped), **IMPLICIT),
    "damped cable": lambda: cable(guy(damped), scheme="velocity_verlet"),
    "damped implicit cable": lambda: cable(guy(damped), scheme="trapezoidal", step=0.02),
    "damped exact run": lambda: exact(guy(damped)), "damped exact orbit": lambda: orbit(guy(damped), order="exact"),
    "damped run": lambda: run(guy(damped)), "damped batch": lambda: batch(guy(damped)),
    "damped orbit": lambda: orbit(guy(damped)), "windy run": lambda: run(windy()), "windy batch": lambda: batch(windy()),
    "mast": mast, "host": lambda: host(guy(plain)), "windy host": lambda: host(windy()),
    "windy chain": lambda: chain(windy()), "windy implicit chain": lambda: chain(windy(), **IMPLICIT),
    "windy cable": lambda: cable(windy()), "mast of chains": lambda: mast(guys="chain", links=4),
    "slow chain": lambda: chain(guy(slow)), "slow cable": lambda: cable(guy(slow)), "slow run": lambda: run(guy(slow), **VERLET),
    "slow batch": lambda: batch(guy(slow), **VERLET),
    "used at rest": lambda: cp.summary(strong()).utilisation,
    "used in stringing": lambda: cp.catenary.stringing(strong(), [0.0, 20.0]).utilisation,
    "used guys at rest": lambda: cp.mast.summary(strong_mast()).tension_over_breaking_strength,
    "used guys": lambda: cp.mast.simulate(strong_mast()).utilisation,
}
found = {}
for name in sys.argv[1:]:
    try:
        found[name] = float((calls[name]() ** 2).mean())
    except (AllFailedError, RunStopped, SceneError) as error:
        found[name] = str(error)
print(json.dumps([cp.__file__, found]))
"""


def results(folder: Path, calls: list[str]) -> dict[str, float | str]:
    """Results of calls by the package in a folder: numbers, or why there are none."""
    given = environment()
    given |= {"PYTHONPATH": f"{folder}:{given['PYTHONPATH']}", "NUMBA_DISABLE_JIT": "1"}
    done = run_python("-c", CODE, *calls, timeout=300, env=given, cwd=folder)
    assert done.returncode == 0, done.stderr
    file, found = json.loads(done.stdout.splitlines()[-1])
    assert Path(file).is_relative_to(folder)
    return found


@pytest.mark.slow
@pytest.mark.parametrize("term", SIGNS)
def test_one_sign_changes_all_models(tmp_path, term):
    source = Path(cablepod.__file__).parent
    shutil.copytree(source, tmp_path / "cablepod", ignore=shutil.ignore_patterns("__pycache__"))
    before = results(tmp_path, CALLS[term])
    assert all(isinstance(value, float) for value in before.values()), before
    file, line, other = SIGNS[term]
    text = (tmp_path / "cablepod" / file).read_text(encoding="utf-8")
    assert text.count(line) == 1
    (tmp_path / "cablepod" / file).write_text(text.replace(line, other), encoding="utf-8")
    after = results(tmp_path, CALLS[term])
    same = [
        name
        for name, value in before.items()
        if isinstance(after[name], float) and abs(after[name] - value) <= 1e-9 * abs(value)
    ]
    assert not same
