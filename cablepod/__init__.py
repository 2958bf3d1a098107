"""Reduced-order models of cable dynamics, from scene to archive, on labelled data.

Sub-packages are loaded when they are first used: importing cablepod costs next to nothing.

.. include:: README.md
"""

TYPE_CHECKING = False  #: as of :mod:`typing`, whose import the command would wait for
if TYPE_CHECKING:
    from typing import Any

    from cablepod import (
        archive,
        cable,
        catenary,
        chain,
        compare,
        condensed,
        ensemble,
        extremes,
        fatigue,
        galerkin,
        mast,
        periodic,
        plots,
        pod,
        rigid,
        study,
        wind,
    )
    from cablepod._caches import clear_caches
    from cablepod.errors import (
        ArchiveError,
        CoarseWarning,
        MemberFailedWarning,
        NotConvergedWarning,
        OutOfRangeWarning,
        RunStopped,
        SceneError,
        UnusualSceneWarning,
        VelocityJumpWarning,
        WorkersWarning,
    )
    from cablepod.pod._own import modes, snapshots
    from cablepod.scene import make_scene, read_scene
    from cablepod.study import summary

    __version__: str

__all__ = [
    "ArchiveError",
    "CoarseWarning",
    "MemberFailedWarning",
    "NotConvergedWarning",
    "OutOfRangeWarning",
    "RunStopped",
    "SceneError",
    "UnusualSceneWarning",
    "VelocityJumpWarning",
    "WorkersWarning",
    "archive",
    "cable",
    "catenary",
    "chain",
    "clear_caches",
    "compare",
    "condensed",
    "ensemble",
    "extremes",
    "fatigue",
    "galerkin",
    "make_scene",
    "mast",
    "modes",
    "periodic",
    "plots",
    "pod",
    "read_scene",
    "rigid",
    "snapshots",
    "study",
    "summary",
    "wind",
]


#: Modules of the public names that are no sub-packages.
_HOMES = {
    "clear_caches": "_caches",
    "make_scene": "scene",
    "modes": "pod._own",
    "read_scene": "scene",
    "snapshots": "pod._own",
    "summary": "study",
}


def __getattr__(name: str) -> "Any":
    """Load a public sub-package, function or error at its first use."""
    from importlib import import_module, metadata

    found: Any
    if name == "__version__":
        found = metadata.version("cablepod")
    elif name not in (*__all__, "errors"):
        raise AttributeError(f"module 'cablepod' has no attribute {name!r}; see dir(cablepod)")
    elif name in _HOMES or name[:1].isupper():
        found = getattr(import_module(f"cablepod.{_HOMES.get(name, 'errors')}"), name)
    else:
        found = import_module(f"cablepod.{name}")
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
