"""Draw figures of Datasets on matplotlib axes.

Functions take a Dataset and axes, and return the axes; without `ax` they make a new figure.  Nothing is shown or saved, and no
global option of matplotlib changes.  Curves differ in line style or marker as well as in colour (Okabe and Ito's palette), and
maps go from dark to light, so that they can be read in grey.  The legend stands to the right of the axes: figures with
``layout="constrained"`` make room for it.  :func:`animate` returns an :class:`Animation`.
"""

from cablepod.plots._animation import Animation, animate
from cablepod.plots._cables import phase_portraits, rest, shapes, snapshots, tension
from cablepod.plots._maps import parameter_map, stability
from cablepod.plots._modes import amplitudes, modes, singular_values
from cablepod.plots._reports import error_against_run_time, error_over_time
from cablepod.plots._style import COLOURS, LINES, MARKERS, SIGMA

__all__ = [
    "COLOURS",
    "LINES",
    "MARKERS",
    "SIGMA",
    "Animation",
    "amplitudes",
    "animate",
    "error_against_run_time",
    "error_over_time",
    "modes",
    "parameter_map",
    "phase_portraits",
    "rest",
    "shapes",
    "singular_values",
    "snapshots",
    "stability",
    "tension",
]
