"""Reduced-order models of cable dynamics, from scene to archive, on labelled data."""

from cablepod import catenary, chain, compare, galerkin, pod
from cablepod.scene import make_scene, read_scene
from cablepod.schema import SceneError
from cablepod.stepping import NotConvergedWarning, RunStopped

__all__ = [
    "NotConvergedWarning",
    "RunStopped",
    "SceneError",
    "catenary",
    "chain",
    "compare",
    "galerkin",
    "make_scene",
    "pod",
    "read_scene",
]
