"""Scenes that start from a vibration mode about rest, and the damping ratio of their decay by its logarithmic decrement."""

from __future__ import annotations

import numpy as np
import xarray as xr
from scipy.optimize import curve_fit

import cablepod as cp

LENGTH, TENSION, MASS, STIFFNESS = 50.0, 20000.0, 1.0, 2.0e7
#: A guy whose first symmetric mode stretches it.
GUY = {
    "cable": {"youngs_modulus": 1.6e11, "area": 1.25e-4, "density": 8000.0, "top_tension": 3000.0},
    "ends": {"lower": [0.0, 0.0], "upper": [40.0, 50.0]},
}


def string_from_mode(mode, damping, *, links=40, amplitude=1e-3, lift=0.0, duration=1.0, turned=None):
    """Make a taut string without weight that starts from a mode, whose ends are lifted; returns it with the shape.

    It is a string in space where the plane of the mode is `turned` by an angle [rad] from that of x and y.
    """
    sigma = np.linspace(0.0, 1.0, links + 1)
    shape = np.stack([0.0 * sigma, np.sin(mode * np.pi * sigma)], axis=1)
    points = np.stack([LENGTH * sigma, 0.0 * sigma], axis=1) + amplitude / mode * shape
    points[[0, -1], 1] = 0.0
    scene = {
        "gravity": 0.0,
        "cable": {"youngs_modulus": STIFFNESS, "area": 1.0, "density": MASS, "top_tension": TENSION},
        "ends": {"lower": [0.0, 0.0], "upper": [LENGTH, 0.0]},
        "chain": {"links": links},
        "initial": {"points": points.tolist()},
        "damping": damping,
        "time": {"duration": duration, "interval": 0.01 * duration},
    }
    if lift:
        path = {"kind": "ramp", "amplitude": lift, "duration": duration}
        scene["motion"] = {"lower": {"y": path}, "upper": {"y": path}}
    if turned is not None:
        turn = np.array([[1.0, 0.0, 0.0], [0.0, np.cos(turned), np.sin(turned)]])
        scene["ends"] = {"lower": [0.0, 0.0, 0.0], "upper": [LENGTH, 0.0, 0.0]}
        scene["initial"] = {"points": (points @ turn).tolist()}
        shape = shape @ turn
    return cp.make_scene(scene), shape


def guy_from_mode(mode, damping, *, links=40, amplitude=1e-3, duration=2.0):
    """Make a sagging guy that starts from a mode of the continuous cable about rest; returns it with the shape."""
    tables = {**GUY, "chain": {"links": links}, "time": {"duration": duration, "interval": 0.02}, "damping": damping}
    scene = cp.make_scene(tables)
    shape = cp.cable.frequencies(scene, count=mode).mode_shape.values[mode - 1]
    rest = cp.chain.simulate(scene.drop_vars([name for name in scene.data_vars if "damping" in name]), times=[0.0])
    points = rest.position.values[0] + amplitude * shape / np.abs(shape).max()
    return cp.make_scene({**tables, "initial": {"points": points.tolist()}}), shape


def deflection_of(run: xr.Dataset) -> float:
    """Return the largest distance of a particle from the line between the ends [m]."""
    sigma = np.linspace(0.0, 1.0, run.sizes["particle"])[:, None]
    position = run.position.values
    line = (1.0 - sigma) * position[:, :1] + sigma * position[:, -1:]
    return float(np.abs(position - line)[..., 1].max())


def amplitude_of(run: xr.Dataset, shape: np.ndarray) -> np.ndarray:
    """Return the part of the motion along a shape (particle, coordinate) over its maximum (time,)."""
    position = run.position.values
    amplitude = np.einsum("tpc,pc->t", position - position.mean(axis=0), shape)
    return amplitude / np.abs(amplitude).max()


def decay_of(run: xr.Dataset, shape: np.ndarray) -> tuple[float, float]:
    """Fit rate of decay [1/s] and angular frequency [rad/s] to the part of the motion along a shape (particle, coordinate)."""
    time, amplitude = run.time.values - float(run.time[0]), amplitude_of(run, shape)

    def damped(t, rate, omega, c, s, rest):
        return np.exp(-rate * t) * (c * np.cos(omega * t) + s * np.sin(omega * t)) + rest

    spectrum = np.abs(np.fft.rfft(amplitude * np.hanning(amplitude.size), 16 * amplitude.size))
    guess = 2 * np.pi * np.argmax(spectrum) / (16 * amplitude.size * (time[1] - time[0]))
    rate, omega = curve_fit(damped, time, amplitude, p0=(0.02 * guess, guess, 1.0, 0.0, 0.0))[0][:2]
    return float(rate), float(omega)


def ratio_of(run: xr.Dataset, shape: np.ndarray) -> float:
    """Fit the damping ratio to the decay of the part of the motion along a shape (particle, coordinate)."""
    rate, omega = decay_of(run, shape)
    return rate / float(np.hypot(rate, omega))
