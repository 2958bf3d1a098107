"""Drag of the wind on the particles of a chain: tables of the kernels, forces at the start, interval of its evaluation."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from cablepod.discretisation._chain import LumpedChain
from cablepod.scene._wind_field import linear_between
from cablepod.wind._air import CableAir, density_of, refined
from cablepod.wind._drag import (
    TENSION_MARGIN,
    body_drag,
    drag_rate,
    drag_step_limit,
    largest_speed,
    longest_hold,
    straight_drag,
    tension_by_drag,
)

#: Maximum number of explicit steps from one evaluation of the drag to the next.
MAX_HOLD = 16
#: Maximum time of these steps over the shortest transverse period at the start: a fifth of it for a tension twice as large.
HOLD_OVER_PERIOD = 0.14
#: Maximum number of samples of gusts, and number of points along the cable, from which the error by their sampling is taken.
SAMPLES_OF_GUSTS, FINE_POINTS = 256, 1001
#: Squares of gusts over those of the velocity below which they are rounding.
ROUNDING = 1e-20


@dataclass(frozen=True, eq=False)
class ChainAir:
    """Velocity of the air at the particles of a chain."""

    chain: LumpedChain
    air: CableAir
    max_hold: ClassVar[int] = MAX_HOLD  #: maximum number of explicit steps from one evaluation of the drag to the next

    @cached_property
    def velocity(self) -> np.ndarray:
        """Velocity of the air (samples, dims, n + 1) [m/s]."""
        at_particles = self.air.at(self.chain.arc_length / self.chain.total_length)
        return refined(np.moveaxis(at_particles, 1, 2))

    @property
    def drag(self) -> float:
        """Half the density of the air times drag coefficient and diameter, mean of the cable [kg/m2]."""
        return self.air.drag

    @cached_property
    def drags(self) -> np.ndarray:
        """Half the density of the air times drag coefficient and diameter at the particles (n + 1,) [kg/m2]."""
        ratio = self.chain.drag_ratio
        return np.full(self.chain.links + 1, self.drag) if ratio is None else self.drag * ratio

    @cached_property
    def bodies(self) -> np.ndarray | None:
        """Half the density of the air times drag area at the particles (n + 1,) [kg/m], 0 at held ones; None without."""
        chain, p = self.chain, self.chain.p
        if not any(attachment.drag_area for attachment in p.attachments):
            return None
        result = np.zeros(chain.links + 1)
        result[chain.attached_particles] = [attachment.drag_area for attachment in p.attachments]
        return 0.5 * density_of(p) * result

    @property
    def sampling_error(self) -> float:
        """Error of the load by gusts on the first vibration, as a part of its rms, by the points at which particles meet them.

        Particles between the points of a field miss some gusts and take others for more of the cable than they act on.
        """
        velocity = self.air.velocity[len(self.air.velocity) // 2 :]  # after a ramp
        some = velocity[:: -(-len(velocity) // SAMPLES_OF_GUSTS)]
        loads = []
        for places in (np.linspace(0.0, 1.0, FINE_POINTS), self.chain.arc_length / self.chain.total_length):
            gusts = linear_between(self.air.sigma, some - some.mean(axis=0), places)
            loads.append(np.trapezoid(gusts * np.sin(math.pi * places)[:, None], places, axis=1))
        size = float((loads[0] ** 2).sum())
        is_rounding = size <= ROUNDING * float((some * some).sum())
        return 0.0 if is_rounding else math.sqrt(float(((loads[1] - loads[0]) ** 2).sum()) / size)

    @property
    def samples_per_second(self) -> float:
        """Samples of the velocity per second."""
        return self.air.samples_per_second * self.air.refinement

    @property
    def interval(self) -> float:
        """Interval of the gusts, which the steps of a run resolve [s]."""
        return self.air.interval

    def force(self, position: np.ndarray, velocity: np.ndarray, time: float = 0.0) -> np.ndarray:
        """Return the drag on all particles (n + 1, dims) [N] at an instant [s]; 0 at held ones."""
        relative = self.relative_velocity(velocity, time)
        # half of the vector between the neighbours, at the ends of the link
        padded = np.concatenate([position[:1], position, position[-1:]])
        return self._of_free(straight_drag(0.5 * self.drags, padded[2:] - padded[:-2], relative)[0], relative)

    def relative_velocity(self, velocity: np.ndarray, time: float) -> np.ndarray:
        """Return the velocity of the air less that of the particles (n + 1, dims) [m/s] at an instant [s]."""
        last = len(self.velocity) - 1
        place = min(max(time * self.samples_per_second, 0.0), last)
        sample = min(int(place), last - 1)
        before, after = self.velocity[sample : sample + 2]
        return (before + (place - sample) * (after - before)).T - velocity

    def _of_free(self, force: np.ndarray, relative: np.ndarray) -> np.ndarray:
        """Return the drag of the cable with that of bodies (n + 1, dims) [N], 0 at held particles."""
        free, result = self.chain.free_particles, np.zeros(force.shape)
        result[free] = force[free] if self.bodies is None else (force + body_drag(self.bodies, relative))[free]
        return result

    def at_rest(self, position: np.ndarray) -> np.ndarray:
        """Return the drag of the mean wind on all particles at rest (n + 1, dims) [N]."""
        return self._steady.force(position, np.zeros_like(position))

    @cached_property
    def _steady(self) -> ChainAir:
        return ChainAir(self.chain, self.air.steady)

    def energy_bound(self, position: np.ndarray) -> float:
        """Return the work of the largest drag over the reach of the cable [J]."""
        reach = self.chain.total_length + float(np.abs(position[-1] - position[0]).sum())
        return self.largest_force * reach

    @property
    def largest_force(self) -> float:
        """Largest drag on the whole cable and its bodies [N]."""
        area = self.drag * self.chain.total_length + (0.0 if self.bodies is None else float(self.bodies.sum()))
        return area * self.air.largest_speed**2

    def rate(self, end_time: float) -> float:
        """Return a bound of the rate at which drag takes away a motion along the wind in a run until an instant [s] [1/s]."""
        chain, p, free = self.chain, self.chain.p, self.chain.free_particles
        speed = largest_speed(p, self.air, end_time)
        if not (p.segments or p.attachments or p.masses is not None):
            return float(drag_rate(self.drag, p.mass, speed))
        return float(drag_rate(self.of_particles[free], chain.mass[free], speed).max())

    @property
    def of_particles(self) -> np.ndarray:
        """Half the density of the air times drag area of the particles and their bodies (n + 1,) [kg/m]."""
        return self.drags * self.chain.tributary_length + (0.0 if self.bodies is None else self.bodies)

    def step_limit(self, end_time: float) -> float:
        """Return the longest step [s] from one evaluation of the drag to the next for which a run until `end_time` is stable."""
        return drag_step_limit(self.rate(end_time))

    def hold(self, tension: float, step: float, end_time: float) -> int:
        """Return the number of explicit steps [s] from one evaluation to the next.

        Parameters
        ----------
        tension
            Largest tension at the start [N].
        step, end_time
            Step and end of the run [s].
        """
        chain, p = self.chain, self.chain.p
        mass = chain.mass[1:-1].min()
        tension = max(tension, TENSION_MARGIN * tension_by_drag(p, tension, self.largest_force))
        omega = 2.0 * math.sqrt(max(tension, 1e-300) / (chain.length.min() * mass))
        times = HOLD_OVER_PERIOD * 2.0 * math.pi / omega, longest_hold(self.rate(end_time))
        return max(1, min(self.max_hold, int(min(times) / step)))
