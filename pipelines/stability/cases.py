"""Define the hard scenes of the stability report.

All but the last group are changes to one guy, 61.2 m long and K = 2e7 N, whose upper end moves in by up to 10 cm.  The last group
is for the chain of rigid links: the shipped scenes, two motions without a single truth, and one that is refused.
"""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr

import cablepod as cp
from cablepod import examples as shipped
from cablepod.chain import _scheme as chain_scheme
from cablepod.discretisation._chain import chain_of
from cablepod.parameters._from_scene import parameters
from cablepod.rigid._runs import FORMULATIONS, RigidRun
from cablepod.rigid._start import start

GUY: dict[str, Any] = {
    "cable": {"youngs_modulus": 1.6e11, "area": 1.25e-4, "specific_weight": 78500.0, "top_tension": 8000.0},
    "ends": {"lower": [0.0, 0.0], "upper": [20.4, 57.7]},
    "motion": {"upper": {"x": {"kind": "one_minus_cosine", "amplitude": -0.05, "angular_frequency": 1.0}}},
    "time": {"duration": 10.0, "interval": 0.25},
    "chain": {"links": 20},
}
CHORD = math.hypot(20.4, 57.7)
LEVEL = {"lower": [0.0, 0.0], "upper": [40.0, 0.0]}
#: Tables that a case replaces; of the others it replaces single keys.
WHOLE = ("motion", "chain", "ends", "initial")
#: Steps of implicit runs per first transverse period, and per time scale of motions and loads.
PER_PERIOD, PER_CHANGE = 200.0, 40.0
#: Step of velocity Verlet over its limit.
OF_LIMIT = 0.9
#: Maximum rotation of rigid links in a step [rad].
TURN = 0.1


@dataclass(frozen=True)
class Case:
    """A hard scene."""

    group: str
    name: str
    tables: dict[str, Any] = field(default_factory=dict)
    quiet: bool = False  #: ends and loads at rest and no damping: constant energy
    long: bool = False  #: so long that phases are lost: compared by statistics
    implicit_step: float | None = None  #: [s], where that of :meth:`steps` costs too much
    rigid: bool = False  #: a scene of rigid links, in which elastic ones move differently
    shipped: str = ""  #: name of a shipped scene in place of the guy

    def scene(self) -> xr.Dataset:
        """Return the scene: the guy with these tables, or a shipped scene at other times."""
        if self.shipped:
            times = {
                f"time_{key}": ((), float(value), {"units": "s"}) for key, value in self.tables.get("time", {}).items()
            }
            return shipped.scene(self.shipped).assign(times).assign_attrs(title=self.name)
        mapping = copy.deepcopy(GUY)
        for key, table in self.tables.items():
            if not isinstance(table, dict):
                mapping[key] = table
                continue
            mapping[key] = {**({} if key in WHOLE else mapping.get(key, {})), **table}
        cable = mapping["cable"]
        if "unstretched_length" in cable:
            del cable["top_tension"]
        if "density" in cable:
            del cable["specific_weight"]
        return cp.make_scene({"title": self.name, **mapping})

    def steps(self, scene: xr.Dataset) -> dict[str, float]:
        """Return the step of each scheme [s].

        All divide the interval, so that no energy is interpolated.
        """
        if self.rigid:
            return dict.fromkeys(FORMULATIONS, dividing(scene, rigid_step(scene)))
        p = parameters(scene)
        limit = chain_of(p).step_limit()
        wanted = self.implicit_step
        if wanted is None:
            duration, period = float(scene["time_duration"]), 2.0 * np.pi / first_frequency(scene)
            wanted = max(min(period / PER_PERIOD, p.shortest_time_scale / PER_CHANGE, duration / 20.0), limit)
        explicit = chain_scheme.SCHEMES[0]
        elastic = {
            scheme: dividing(scene, OF_LIMIT * limit if scheme == explicit else wanted)
            for scheme in chain_scheme.SCHEMES
        }
        return elastic | dict.fromkeys(FORMULATIONS, dividing(scene, rigid_step(scene, wanted)))


def rigid_step(scene: xr.Dataset, otherwise: float | None = None) -> float:
    """Return a step of rigid links [s].

    It is at most the first of their own choice, and rotates no link by more than TURN.  Scenes that rigid links refuse get
    `otherwise`, if given.
    """
    chain = chain_of(parameters(scene))
    try:
        run = RigidRun(chain, start(chain), times=parameters(scene).times())
        begin = run.resolving(run.unforced_step)
        probe = cp.rigid.simulate(scene, formulation=FORMULATIONS[1], step=dividing(scene, begin / 8.0))
    except cp.SceneError:
        if otherwise is None:
            raise
        return otherwise
    return min(begin, TURN / float(probe.attrs["largest_turn_rate"]))


def dividing(scene: xr.Dataset, step: float) -> float:
    """Return the longest step up to `step` that divides the interval of the output [s]."""
    interval = float(scene["time_interval"])
    return interval / math.ceil(interval / step * (1.0 - 1e-12))


def first_frequency(scene: xr.Dataset) -> float:
    """Return the first transverse angular frequency of the cable at rest as a string [rad/s]."""
    p = parameters(scene)
    at_rest = cp.chain.rest(scene)
    tension = max(float(at_rest["tension"].mean()), 1e-9)
    return math.pi / float(at_rest["unstretched_length"]) * math.sqrt(tension / p.mass)


def moved(kind: str, **values: Any) -> dict[str, Any]:
    """Return a motion of the upper end along x."""
    return {"upper": {"x": {"kind": kind, **values}}}


def short(duration: float, interval: float) -> dict[str, float]:
    """Return the table of times [s]."""
    return {"duration": duration, "interval": interval}


def cases() -> list[Case]:
    """Return all cases, group by group."""
    omega = first_frequency(Case("stiffness", "the guy").scene())
    axial = math.pi / CHORD * math.sqrt(2e7 / (78500.0 * 1.25e-4 / 9.81))
    slack = {"cable": {"unstretched_length": 62.5}}
    plucked: dict[str, Any] = {"motion": {}, "initial": {"top_tension": 6000.0}}
    line = {"points": [[0.0, 0.0], [20.4, 57.7]]}
    fast = moved("one_minus_cosine", amplitude=-0.005, angular_frequency=3.0)
    return [
        Case("stiffness", "the guy, K = 2e7 N"),
        Case("stiffness", "K = 1e10 N", {"cable": {"youngs_modulus": 8e13}, "motion": fast, "time": short(4.0, 0.1)}),
        Case("stiffness", "K = 1e13 N", {"cable": {"youngs_modulus": 8e16}, "motion": fast, "time": short(1.0, 0.05)}),
        Case("stiffness", "rubber, K = 2e4 N", {"cable": {"youngs_modulus": 1.6e8}}),
        Case("stiffness", "K = 1e3 N, ninefold", {"cable": {"youngs_modulus": 8e6}, "chain": {"links": 12}}),
        Case("size", "2 links", {"chain": {"links": 2}}),
        Case("size", "10 links", {"chain": {"links": 10}}),
        Case("size", "2000 links", {"chain": {"links": 2000}, "motion": fast, "time": short(0.5, 0.05)}),
        Case("size", "links 1 : 1000 in turn", {"chain": {"link_lengths": [1.0, 1000.0] * 5}, "time": short(1.0, 0.1)}),
        Case(
            "size",
            "links and masses 1 : 1000",
            {"chain": {"link_lengths": np.geomspace(1.0, 1000.0, 12).tolist()}, "time": short(4.0, 0.1)},
        ),
        Case("slack", "slack cable, end moved", slack),
        Case("slack", "pulled taut with a snap", {
            "cable": {"unstretched_length": 61.5}, "motion": moved("ramp", amplitude=1.0, duration=0.5), "time": short(2.0, 0.05),
        }),
        Case("slack", "slackens and snaps", {"motion": moved("one_minus_cosine", amplitude=-0.5, angular_frequency=4.0)}),
        Case("slack", "let go at zero tension", {
            "motion": {}, "cable": {"unstretched_length": CHORD}, "initial": line, "time": short(1.0, 0.05),
        }, quiet=True),
        Case("slack", "let go above its rest", {"motion": {}, "initial": line, **slack}, quiet=True),
        Case("release", "taut, one end let go", {
            "motion": {}, "ends": {**LEVEL, "free": "upper"}, "time": short(0.5, 0.025),
        }, quiet=True),
        Case("release", "whip, from a level line", {
            "motion": {}, "ends": {**LEVEL, "free": "upper"}, "cable": {"unstretched_length": 40.0},
            "initial": {"points": [[0.0, 0.0], [40.0, 0.0]]}, "time": short(4.0, 0.1),
        }, quiet=True),
        Case("release", "let fall from a wide arc", {
            "motion": {}, "ends": LEVEL, "cable": {"unstretched_length": 70.0},
            "initial": {"points": [[0.0, 0.0], [20.0, 25.0], [40.0, 0.0]]},
        }, quiet=True),
        Case("ends", "moved by half the span", {"motion": moved("one_minus_cosine", amplitude=-5.1, angular_frequency=0.8)}),
        Case("ends", "jump of 20 mm in 1 ms", {
            "motion": moved("ramp", amplitude=-0.02, duration=1e-3), "time": short(4.0, 0.1),
        }),
        Case("ends", "jump of 2 mm in 1 us", {
            "motion": moved("ramp", amplitude=-0.002, duration=1e-6), "time": short(1.0, 0.05),
        }),
        Case("ends", "velocity jumps to 5 cm/s", {
            "motion": moved("polynomial", coefficients=[-0.05]), "time": short(1.0, 0.05),
        }),
        Case("resonance", "at the first frequency", {"motion": moved("harmonic", amplitude=0.005, angular_frequency=omega)}),
        Case("resonance", "at twice the first", {"motion": moved("harmonic", amplitude=0.005, angular_frequency=2 * omega)}),
        Case("resonance", "at the first axial", {
            "motion": moved("harmonic", amplitude=1e-4, angular_frequency=axial), "time": short(1.0, 0.05),
        }),
        Case("geometry", "horizontal", {"ends": LEVEL}),
        Case("geometry", "vertical", {"ends": {"lower": [0.0, 0.0], "upper": [0.0, 60.0]}}),
        Case("geometry", "weightless", {"gravity": 0.0, "cable": {"density": 8000.0}, "motion": fast}),
        Case("geometry", "spatial, wind across", {
            "ends": {"lower": [0.0, 0.0, 0.0], "upper": [20.4, 57.7, 0.0]},
            "load": {"uniform": [0.0, 0.0, 5.0], "kind": "one_minus_cosine", "amplitude": 1.0, "angular_frequency": 2.0},
        }),
        Case("geometry", "vertical, slack: it folds", {
            "ends": {"lower": [0.0, 0.0], "upper": [0.0, 60.0]}, "cable": {"unstretched_length": 70.0},
        }),
        Case("damping", "plucked, none", plucked, quiet=True),
        Case("damping", "by mass, 50 per s", {**plucked, "damping": {"mass_proportional": 50.0}}),
        Case("damping", "viscous links, 10 ms", {**plucked, "damping": {"link_viscosity": 1e-2}, "time": short(4.0, 0.1)}),
        Case("damping", "all terms at once", {
            "damping": {"mass_proportional": 0.1, "link_viscosity": 1e-4},
            "load": {"uniform": [10.0, 0.0], "kind": "harmonic", "amplitude": 1.0, "angular_frequency": 3.0},
        }),
        Case("long runs", "plucked, 1e5 s", {**plucked, "chain": {"links": 5}, "time": short(1e5, 100.0)},
             quiet=True, long=True, implicit_step=0.05),
        Case("long runs", "end moves, 1e5 s", {"chain": {"links": 5}, "time": short(1e5, 100.0)},
             long=True, implicit_step=0.05),
        Case("rigid links", "slack guy", shipped="slack_cable", rigid=True),
        Case("rigid links", "line let go at one end", shipped="released_line", rigid=True, quiet=True),
        Case("rigid links", "bent line let go", shipped="slack_line", rigid=True, quiet=True),
        Case("rigid links", "tight fold falls", shipped="folded_chain", rigid=True, quiet=True),
        Case("rigid links", "whip, handle jerked", shipped="whip", rigid=True),
        Case("rigid links", "pendulum", shipped="pendulum", rigid=True, quiet=True),
        Case("rigid links", "double pendulum, 3 s", shipped="double_pendulum", rigid=True, quiet=True),
        Case("rigid links", "double pendulum, 60 s", {"time": short(60.0, 0.5)}, shipped="double_pendulum", rigid=True,
             quiet=True),
        Case("rigid links", "double pendulum, 1e4 s", {"time": short(1e4, 10.0)}, shipped="double_pendulum", rigid=True,
             quiet=True, long=True),
        Case("rigid links", "ends drawn too far apart", {
            "cable": {"unstretched_length": 61.5}, "motion": moved("ramp", amplitude=1.0, duration=0.5), "time": short(2.0, 0.05),
        }, rigid=True),
    ]  # fmt: skip
