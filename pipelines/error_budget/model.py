"""Integrate a condensed model with switches for the terms of the error.

Planar, steady uniform loads, linear law.  Written without the package's kernels: positions of the chord's ends, the closure
and the force link by link, velocity Verlet.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numba import njit
from scipy.interpolate import CubicSpline

import cablepod as cp
from cablepod.discretisation._chain import chain_of
from cablepod.parameters._from_scene import parameters
from cablepod.pod._normal import deflections

#: Whether the truncated modes are hidden from the retained ones in the tension, and in the force.
HIDDEN = {"nothing": (False, False), "tension": (True, False), "force": (False, True), "both": (True, True)}


@njit(cache=True, error_model="numpy", nogil=True)
def reach(dw, tau, length, stiffness, chord, force, z, n):
    """Solve the closure for H [N] of links with slopes dw.

    Fills stretches z along the chord and forces n.
    """
    for _ in range(50):
        total, give = 0.0, 0.0
        for j in range(z.size):
            n[j] = force + tau[j]
            for _ in range(3):
                xi = math.sqrt(z[j] * z[j] + dw[j] * dw[j])
                slope = 1.0 - dw[j] * dw[j] / xi**3
                z[j] -= (z[j] - n[j] / stiffness - z[j] / xi) / slope
            total += length[j] * z[j]
            give += length[j] / (stiffness * slope)
        change = (chord - total) / give
        force += change
        if abs(change) < 1e-12 * abs(force):
            break
    return force


@njit(cache=True, error_model="numpy", nogil=True)
def accelerations(
    q, row, mass, length, sigma, stiffness, load, slopes, test, push, rank, see, part, tau, state, z, n, f
):
    """Compute accelerations f of coordinates for test functions biorthonormal to the shapes in mass.

    `row`: chord, its direction (2,), second derivatives of both ends (4,).  `push`: further force normal to the chord per mass
    (particle,) [m/s^2].  `see`: whether tension and force on the first `rank` coordinates depend on themselves alone.  `part`:
    chordwise accelerations (particle,) [m/s^2].  `state`: H of all, H of the first coordinates.
    """
    r, m = slopes.shape
    ex, ey = row[1], row[2]
    dw, few, g = np.zeros(m), np.zeros(m), np.empty(m + 1)
    for k in range(r):
        for j in range(m):
            dw[j] += slopes[k, j] * q[k]
            if k < rank:
                few[j] += slopes[k, j] * q[k]
    total = 0.0
    for j in range(m):
        if j > 0:
            total += mass[j] * (part[j] + row[3] * ex + row[4] * ey) - load[j, 0] * ex - load[j, 1] * ey
        tau[j] = total
    normal = row[3] * -ey + row[4] * ex
    turn = (row[5] - row[3]) * -ey + (row[6] - row[4]) * ex
    again = see[0] or see[1]
    for kind in range(2 if again else 1):
        # the second pass without the truncated coordinates
        hide_tension, hide_force = kind == 1 and see[0], kind == 1 and see[1]
        state[kind] = reach(few if hide_tension else dw, tau, length, stiffness, row[0], state[kind], z, n)
        for j in range(m + 1):
            g[j] = -load[j, 0] * ey + load[j, 1] * ex - mass[j] * (normal + sigma[j] * turn) - mass[j] * push[j]
        for j in range(m):
            pull = n[j] / z[j] * (few[j] if hide_force else dw[j])
            g[j] += pull
            g[j + 1] -= pull
        for k in range(rank if kind == 1 else r):
            f[k] = 0.0
            for j in range(m + 1):
                f[k] += test[k, j] * g[j]
    if again:  # z of all coordinates
        reach(dw, tau, length, stiffness, row[0], state[0], z, n)


@njit(cache=True, error_model="numpy", nogil=True)
def place(w, row, length, stiffness, load, state, z, n, tau, places):
    """Compute positions along the chord [m] of particles with deflections w.

    `places`: of this step and two before.  Geometry alone gives the stretch to second order; the effect of
    chordwise inertia on it is a part H/K.
    """
    m = length.size
    dw = (w[1:] - w[:-1]) / length
    total = 0.0
    for j in range(m):
        tau[j] = total
        total -= load[j + 1, 0] * row[1] + load[j + 1, 1] * row[2]
    state[0] = reach(dw, tau, length, stiffness, row[0], state[0], z, n)
    places[2], places[1] = places[1], places[0]
    for j in range(m):
        places[0, j + 1] = places[0, j] + length[j] * z[j]


@njit(cache=True, error_model="numpy", nogil=True)
def march(q, v, step, every, rows, rates, mass, length, sigma, stiffness, load, slopes, test, rank, see, terms, saved):
    """Integrate by velocity Verlet; save q at `every` steps.

    `rates`: angular velocity and acceleration of the chord, derivative of its length (steps, 3).  `terms`: whether chordwise
    inertia and the rotation of the chord count; chordwise accelerations and velocities are differences of the last steps.
    """
    r, m = slopes.shape
    z, n, tau, f = np.ones(m), np.empty(m), np.empty(m), np.empty(r)
    places, part, push = np.zeros((3, m + 1)), np.zeros(m + 1), np.zeros(m + 1)
    shapes = np.zeros((r, m + 1))
    for j in range(m):
        shapes[:, j + 1] = shapes[:, j] + slopes[:, j] * length[j]
    state = np.full(2, stiffness * 1e-3)
    for i in range(rows.shape[0]):
        row, rate = rows[i], rates[i]
        # of an evenly stretched cable
        part = sigma * ((row[5] - row[3]) * row[1] + (row[6] - row[4]) * row[2])
        if terms[0] or terms[1]:
            w = q @ shapes
            place(w, row, length, stiffness, load, state, z, n, tau, places)
            if i == 0:
                places[1], places[2] = places[0], places[0]
            if terms[0]:
                part = (places[0] - 2.0 * places[1] + places[2]) / step**2
            if terms[1]:
                speed = (1.5 * places[0] - 2.0 * places[1] + 0.5 * places[2]) / step - sigma * rate[2]
                push = (places[0] - sigma * row[0]) * rate[1] + 2.0 * speed * rate[0] - w * rate[0] ** 2
        accelerations(
            q, row, mass, length, sigma, stiffness, load, slopes, test, push, rank, see, part, tau, state, z, n, f
        )
        if i % every == 0:
            saved[i // every] = q
        v += (0.5 if i == 0 else 1.0) * step * f
        q += step * v


def taken_length(w: np.ndarray, length: np.ndarray) -> np.ndarray:
    """Return the shortening of the cable by deflections w (times, particle), to leading order (times,) [m]."""
    return 0.5 * ((np.diff(w, axis=1) / length) ** 2 * length).sum(axis=1)


@dataclass(frozen=True)
class Switched:
    """The model with switches on the links of a scene's chain."""

    scene: xr.Dataset
    times: np.ndarray
    links: int = 40

    def parts(self, step: float) -> dict[str, Any]:
        """Return the arguments of `march` that depend on the scene."""
        p = parameters(self.scene)
        chain = chain_of(p, self.links)
        every = round((self.times[1] - self.times[0]) / step)
        t = np.arange((self.times.size - 1) * every + 1) * step
        ends, first, second = (p.end_positions(t, d) for d in (0, 1, 2))
        chord, speed, push = (item[:, 1] - item[:, 0] for item in (ends, first, second))
        size = np.sqrt((chord**2).sum(axis=1))
        along = chord / size[:, None]
        across = np.stack([-along[:, 1], along[:, 0]], axis=1)
        grow, turn = (speed * along).sum(axis=1), (speed * across).sum(axis=1) / size
        rates = np.stack([turn, ((push * across).sum(axis=1) - 2.0 * grow * turn) / size, grow], axis=1)
        rows = np.concatenate([size[:, None], along, second[:, 0], second[:, 1]], axis=1)
        return {
            "every": every, "rows": rows, "rates": rates, "mass": p.mass * chain.tributary_length, "length": chain.length,
            "sigma": chain.arc_length / chain.total_length, "stiffness": p.stiffness, "load": chain.loads(0.0),
        }  # fmt: skip

    def run(
        self, shapes: np.ndarray, step: float, *, tests: np.ndarray | None = None, rank: int = 0, hidden: str = "nothing",
        inertia: bool = False, frame: bool = False, taken: np.ndarray | None = None,
    ) -> np.ndarray:  # fmt: skip
        """Return deflections (times, particle) [m] on shapes (r, particle), by any test functions, from the model's own rest.

        `taken` is the shortening of the cable by deflections beside these shapes (times,) [m], their only effect on the tension.
        """
        parts = self.parts(step)
        if taken is not None:
            parts["rows"][:, 0] += CubicSpline(self.times, taken)(np.arange(len(parts["rows"])) * step)
        test = shapes if tests is None else tests
        test = np.ascontiguousarray(np.linalg.solve((test * parts["mass"]) @ shapes.T, test))
        rest = cp.chain.rest(self.scene, links=self.links)["position"].values
        q = test @ (parts["mass"] * deflections(rest[None])[0, 0])
        slopes = np.ascontiguousarray(np.diff(shapes, axis=1) / parts["length"])
        see = np.array(HIDDEN[hidden])
        q = self._rest(q, slopes, test, rank, see, parts)
        saved = np.empty((self.times.size, q.size))
        terms = np.array([inertia, frame])
        march(
            q, np.zeros(q.size), step, slopes=slopes, test=test, rank=rank, see=see, terms=terms, saved=saved, **parts
        )  # fmt: skip
        return saved @ shapes

    def _rest(
        self, q: np.ndarray, slopes: np.ndarray, test: np.ndarray, rank: int, see: np.ndarray, parts: dict[str, Any]
    ) -> np.ndarray:
        """Solve for the equilibrium by Newton's method with differences."""
        row = np.concatenate([parts["rows"][0][:3], np.zeros(4)])  # no acceleration of the ends at rest
        m = slopes.shape[1]
        fixed = [parts[key] for key in ("mass", "length", "sigma", "stiffness", "load")]
        none = np.zeros(m + 1)
        state = np.full(2, parts["stiffness"] * 1e-3)

        def force(x: np.ndarray) -> np.ndarray:
            f = np.empty(x.size)
            room = np.empty(m), state, np.ones(m), np.empty(m)
            accelerations(x, row, *fixed, slopes, test, none, rank, see, none, *room, f)
            return f

        delta = 1e-6 * np.abs(q).max()
        for _ in range(8):
            base = force(q)
            tangent = np.stack([(force(q + delta * unit) - base) / delta for unit in np.eye(q.size)], axis=1)
            q = q - np.linalg.solve(tangent, base)
        return q
