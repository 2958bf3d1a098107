"""Datasets at the border of the package: read by their labels, in the order and the units of the package, or refused.

Every public function passes the Datasets that it is given through :func:`taken`.  Behind it variables, labels and particles have
one order and one kind of memory, so that no function depends on the order in which they were given.  Values of scenes and modes
are checked here; those of snapshots, which may be many and on a disk, in the pass that uses them.

.. include:: README.md
"""

from cablepod._inputs._kinds import (
    AMPLITUDES,
    ANY,
    FIELD_MODES,
    MAPPED,
    MODES,
    MOTION,
    NO_MOTION,
    NORMAL_MODES,
    PREPARED,
    SCENE,
    SNAPSHOTS,
    TIMED,
    TRAJECTORY,
    WITH_PLACES,
    Kind,
    drawn_kind,
)
from cablepod._inputs._labels import ROUNDING
from cablepod._inputs._taken import check_ends, check_times, check_units, floats, numbers_in, powers, several, taken

__all__ = [
    "AMPLITUDES",
    "ANY",
    "FIELD_MODES",
    "MAPPED",
    "MODES",
    "MOTION",
    "NORMAL_MODES",
    "NO_MOTION",
    "PREPARED",
    "ROUNDING",
    "SCENE",
    "SNAPSHOTS",
    "TIMED",
    "TRAJECTORY",
    "WITH_PLACES",
    "Kind",
    "check_ends",
    "check_times",
    "check_units",
    "drawn_kind",
    "floats",
    "numbers_in",
    "powers",
    "several",
    "taken",
]
