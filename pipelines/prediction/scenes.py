"""Draw guys over ranges of parameters and run them as chains."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import xarray as xr
from scipy.stats import qmc

import cablepod as cp
from cablepod.discretisation._chain import chain_of
from cablepod.parameters._from_scene import parameters

LINKS = 40
#: The cable of the paper's examples: Young's modulus [N/m^2], area [m^2], weight per volume [N/m^3].
CABLE = {"youngs_modulus": 1.6e11, "area": 1.25e-4, "specific_weight": 78500.0}
WEIGHT = CABLE["specific_weight"] * CABLE["area"]  # q [N/m]
#: Key -> (unit, least, most, spacing): top tension, frequency and size of the motion of the top end, horizontal load over q,
#: angle of the chord to the horizontal, distance of the ends.  The size has both signs.
RANGES = {
    "tension": ("N", 2e3, 2e4, "ratio"),
    "frequency": ("rad s-1", 0.05, 2.0, "ratio"),
    "size": ("m", 0.01, 0.1, "both signs"),
    "load": ("1", -1.0, 1.5, "difference"),
    "inclination": ("degree", 20.0, 80.0, "difference"),
    "chord": ("m", 30.0, 120.0, "ratio"),
}
#: Relative change of the motion of the end that measures the sensitivity of a scene.
NUDGE = 1e-5
#: Maximum growth of that sensitivity from the first half of the time to the second (a shift of phase grows in proportion to time
#: and makes it 2, chaos grows exponentially).
FASTEST_GROWTH = 4.0
#: Maximum difference of two fine steps of the chain, over the motion.
STEPS_DISAGREE = 1e-3


def draw(count: int, seed: int) -> list[dict[str, float]]:
    """Draw scenes from a scrambled Sobol sequence over RANGES, uniformly in the spacing of each."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # a count that is no power of two: the sequence is less balanced
        points = qmc.Sobol(len(RANGES), rng=seed).random(count)
    return [
        {
            key: _spread(u, low, high, spacing)
            for u, (key, (_, low, high, spacing)) in zip(row, RANGES.items(), strict=True)
        }
        for row in points
    ]


def _spread(u: float, low: float, high: float, spacing: str) -> float:
    if spacing == "ratio":
        return float(low * (high / low) ** u)
    if spacing == "both signs":
        return float((low + (high - low) * abs(2.0 * u - 1.0)) * np.copysign(1.0, 2.0 * u - 1.0))
    return float(low + (high - low) * u)


def scene_of(values: dict[str, float], duration: float = 125.0) -> xr.Dataset:
    """Make a guy at rest with a moving top end and a uniform load."""
    angle = np.deg2rad(values["inclination"])
    upper = [values["chord"] * np.cos(angle), values["chord"] * np.sin(angle)]
    motion = {"kind": "one_minus_cosine", "amplitude": values["size"], "angular_frequency": values["frequency"]}
    return cp.make_scene(
        {
            "title": "a guy",
            "cable": {**CABLE, "top_tension": values["tension"]},
            "ends": {"lower": [0.0, 0.0], "upper": upper},
            "motion": {"upper": {"x": motion}},
            "load": {"uniform": [values["load"] * WEIGHT, 0.0]},
            "time": {"duration": duration, "interval": 0.1},
            "chain": {"links": LINKS},
        }
    )


def run_chain(scene: xr.Dataset, part: float = 0.2) -> xr.Dataset:
    """Run the chain by velocity Verlet with a part of its stability limit."""
    limit = chain_of(parameters(scene), LINKS).step_limit()
    return cp.chain.simulate(
        scene, links=LINKS, scheme="velocity_verlet", step=part * limit, outputs=("position", "tension")
    )


@dataclass(frozen=True)
class Case:
    """A scene with its chain."""

    values: dict[str, float]
    duration: float = 125.0

    @cached_property
    def scene(self) -> xr.Dataset:
        """The scene."""
        return scene_of(self.values, self.duration)

    @cached_property
    def truth(self) -> xr.Dataset:
        """The run of the chain, every 0.1 s."""
        return run_chain(self.scene)

    @cached_property
    def time_error(self) -> float:
        """Distance of the chains of two steps over the motion.

        It is three times the error of the finer one if that converges.
        """
        return np.inf if self.coarse is None else float(cp.compare.errors(self.coarse, self.truth)["error_max"])

    @cached_property
    def coarse(self) -> xr.Dataset | None:
        """The run of the chain with twice the step; None if it breaks down."""
        try:
            return run_chain(self.scene, 0.4)
        except cp.RunStopped:  # long steps break down where links slacken and snap taut
            return None

    @cached_property
    def sensitivity(self) -> tuple[float, float]:
        """Relative change of the cable's motion over that of its end, in both halves.

        It is 1 for a linear cable.
        """
        nudged = replace(self, values={**self.values, "size": self.values["size"] * (1.0 + NUDGE)}).coarse
        if nudged is None or self.coarse is None:
            return np.inf, np.inf
        change = cp.compare.errors(nudged, self.coarse)["error"].values / NUDGE
        return float(change[: change.size // 2].max()), float(change[change.size // 2 :].max())

    @cached_property
    def least_tension(self) -> float:
        """Minimum tension of all links at the instants of the output [N]."""
        return float(self.truth["tension"].min())

    @property
    def apart(self) -> str:
        """Reason to compare statistics instead of trajectories, by the chain alone; or empty."""
        if self.least_tension <= 0.0:
            return "slack"
        if self.time_error > STEPS_DISAGREE:
            return "steps disagree"
        return "sensitive" if self.sensitivity[1] > FASTEST_GROWTH * self.sensitivity[0] else ""


def cases(count: int, seed: int, duration: float = 125.0) -> list[Case]:
    """Return scenes of a sequence that have a rest.

    Others have a top tension below the minimum for the weight.
    """
    found: list[Case] = []
    for values in draw(2 * count, seed):
        case = Case(values, duration)
        try:
            parameters(case.scene)
            cp.chain.rest(case.scene, links=LINKS)
        except cp.SceneError:
            continue
        found.append(case)
        if len(found) == count:
            break
    return found
