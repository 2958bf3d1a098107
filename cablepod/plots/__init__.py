"""Figures: Dataset and axes in, axes out.

.. include:: README.md
"""

from cablepod.plots._animation import Animation, animate
from cablepod.plots._cables import end_tensions, phase_portraits, rest, shapes, snapshots, tension
from cablepod.plots._maps import parameter_map
from cablepod.plots._mast import bending_moments, guy_tensions, mast_shapes
from cablepod.plots._mast_animation import animate_mast
from cablepod.plots._modes import amplitudes, modes, singular_values
from cablepod.plots._orbits import animate_orbit, orbit
from cablepod.plots._page import report
from cablepod.plots._periodic import backbone, frequency_response, multipliers, stability_map
from cablepod.plots._reports import error_against_run_time, error_over_time
from cablepod.plots._stringing import stringing
from cablepod.plots._style import COLOURS, LINES, MARKERS, SIGMA
from cablepod.plots._wind import spectra, tension_cycles, wind_field

__all__ = [
    "COLOURS",
    "LINES",
    "MARKERS",
    "SIGMA",
    "Animation",
    "amplitudes",
    "animate",
    "animate_mast",
    "animate_orbit",
    "backbone",
    "bending_moments",
    "end_tensions",
    "error_against_run_time",
    "error_over_time",
    "frequency_response",
    "guy_tensions",
    "mast_shapes",
    "modes",
    "multipliers",
    "orbit",
    "parameter_map",
    "phase_portraits",
    "report",
    "rest",
    "shapes",
    "singular_values",
    "snapshots",
    "spectra",
    "stability_map",
    "stringing",
    "tension",
    "tension_cycles",
    "wind_field",
]
