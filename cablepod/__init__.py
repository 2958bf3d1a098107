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
from cablepod.members import MemberFailedWarning
from cablepod.scene import make_scene, read_scene
from cablepod.schema import SceneError
from cablepod.stepping import NotConvergedWarning, RunStopped
from cablepod.trust import OutOfRangeWarning

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
