"""Reduced-order models of cable dynamics, from scene to archive, on labelled data."""

from importlib.metadata import version

from cablepod import (
    archive,
    cable,
    catenary,
    chain,
    compare,
    condensed,
    ensemble,
    galerkin,
    oblique,
    plots,
    pod,
    rigid,
    study,
)
from cablepod.archive import ArchiveError
from cablepod.errors import MemberFailedWarning, NotConvergedWarning, OutOfRangeWarning, RunStopped, SceneError
from cablepod.scene import make_scene, read_scene

__version__ = version("cablepod")

__all__ = [
    "ArchiveError",
    "MemberFailedWarning",
    "NotConvergedWarning",
    "OutOfRangeWarning",
    "RunStopped",
    "SceneError",
    "archive",
    "cable",
    "catenary",
    "chain",
    "compare",
    "condensed",
    "ensemble",
    "galerkin",
    "make_scene",
    "oblique",
    "plots",
    "pod",
    "read_scene",
    "rigid",
    "study",
]
