"""Reduced-order models of cable dynamics, from scene to archive, on labelled data.

Sub-packages are loaded when they are first used: importing cablepod costs next to nothing.

.. include:: README.md
"""

from importlib import import_module
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from cablepod.errors import (
    ArchiveError,
    MemberFailedWarning,
    NotConvergedWarning,
    OutOfRangeWarning,
    RunStopped,
    SceneError,
    UnusualSceneWarning,
    VelocityJumpWarning,
)

if TYPE_CHECKING:
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
    from cablepod.cable import summary
    from cablepod.scene import make_scene, read_scene

__version__ = version("cablepod")

__all__ = [
    "ArchiveError",
    "MemberFailedWarning",
    "NotConvergedWarning",
    "OutOfRangeWarning",
    "RunStopped",
    "SceneError",
    "UnusualSceneWarning",
    "VelocityJumpWarning",
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
    "summary",
]


def __getattr__(name: str) -> Any:
    """Load a public sub-package or function at its first use."""
    if name not in __all__:
        raise AttributeError(f"module 'cablepod' has no attribute {name!r}; see dir(cablepod)")
    if name in ("make_scene", "read_scene"):
        found = getattr(import_module("cablepod.scene"), name)
    elif name == "summary":
        found = import_module("cablepod.cable").summary
    else:
        found = import_module(f"cablepod.{name}")
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
