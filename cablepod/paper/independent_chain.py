"""Integrate eqs. (1)-(3) independently of the kernels: complex coordinates (Wilson), Runge-Kutta routine of SciPy."""

from __future__ import annotations

import numpy as np
import xarray as xr

from cablepod import chain
from cablepod.discretisation._chain import chain_of
from cablepod.parameters._from_scene import parameters


def simulate(
    scene: xr.Dataset, times: np.ndarray, *, method: str = "DOP853", rtol: float = 1e-10, atol: float = 1e-10
) -> np.ndarray:
    """Integrate a planar chain from rest, with a motion of the upper end along x.

    Parameters
    ----------
    scene
        A scene without loads, damping or an initial table.
    times
        Instants [s], increasing from 0.
    method, rtol, atol
        Options of scipy.integrate.solve_ivp.

    Returns
    -------
    numpy.ndarray
        Positions (time, particle, coordinate) [m].
    """
    from scipy.integrate import solve_ivp  # slow to import

    p = parameters(scene)
    lumped = chain_of(p)
    k, length, mass = lumped.k, lumped.length, lumped.mass[1:-1]
    weight = 1j * p.weight[1] / p.mass
    start = chain.rest(scene)["position"].values @ [1.0, 1.0j]
    free = start.size - 2
    motion = p.motions["upper", "x"]

    def derivative(t: float, real: np.ndarray) -> np.ndarray:
        state = np.ascontiguousarray(real).view(complex)  # some methods take real numbers only
        r = np.concatenate([start[:1], state[:free], start[-1:] + motion(np.array([t]))])
        link = np.diff(r)
        force = k * np.maximum(1.0 - length / np.abs(link), 0.0) * link
        return np.concatenate([state[free:], np.diff(force) / mass + weight]).view(float)

    state = np.concatenate([start[1:-1], np.zeros(free, dtype=complex)])
    run = solve_ivp(derivative, (0.0, times[-1]), state.view(float), method=method, t_eval=times, rtol=rtol, atol=atol)
    moved = np.ascontiguousarray(run.y.T).view(complex)[:, :free].T
    r = np.concatenate([np.full((1, times.size), start[0]), moved, (start[-1] + motion(times))[None]])
    return np.stack([r.real.T, r.imag.T], axis=-1)
