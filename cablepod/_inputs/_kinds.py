"""What public functions are given: kinds of Datasets, and the dimensions of variables."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

Dims = tuple[str, ...]
#: Numbers of each mode, and of each coordinate in layout "separate".
TABLES_OF_MODES = (
    "singular_value", "singular_value_uncertainty", "mode_uncertainty", "proper_orthogonal_value", "energy_share",
    "singular_value_share",
)  # fmt: skip
#: Dimensions of variables, in their order in the package; a variable may lack some.
DIMS: dict[str, Dims] = {
    **dict.fromkeys(("position", "velocity"), ("time", "particle", "coordinate")),
    "tension": ("time", "link", "particle"),
    "arc_length": ("particle",),
    "link_arc_length": ("link",),
    "time": ("time",),
    "end_position": ("time", "end", "coordinate"),
    "scene_feature": ("feature",),
    "mean": ("particle", "coordinate"),
    "training_range": ("bound", "feature"),
    "unstretched_length": (),
    **{
        f"{name}{suffix}": dims
        for suffix in ("", "_out_of_plane")
        for name, dims in {
            "amplitude": ("time", "coordinate", "mode"),
            "mode_shape": ("mode", "particle", "coordinate"),
            "angular_frequency": ("mode",),
            **dict.fromkeys(TABLES_OF_MODES, ("coordinate", "mode")),
            "truncation_error": ("coordinate",),
        }.items()
    },
}
#: The same in modes of layout "separate".
SEPARATE: dict[str, Dims] = {"mode_shape": ("coordinate", "mode", "particle")}
#: Variables that are checked and made floats also of large Datasets.
PLACES = ("time", "arc_length", "link_arc_length")


@dataclass(frozen=True, eq=False)
class Kind:
    """What an argument may be."""

    allowed: str  #: in the words of messages
    needs: tuple[tuple[str, Dims], ...] = ()  #: variables that must be there, with dimensions that they must have
    stages: tuple[str, ...] = ()  #: that the attribute ``stage`` may name, where it is there
    layouts: tuple[str, ...] = ()  #: of modes
    further: Dims | None = ()  #: dimensions that variables may have beside those of the package, None for any
    is_scene: bool = False
    instead: tuple[str, str] | None = None  #: variable of a scene of another kind, and the message that refuses it
    is_small: bool = True  #: values are checked and copied here, not where they are used
    reads: Dims | None = None  #: all variables that the functions read, None for any; others are not looked at
    own: str = ""  #: remedy for data of another program
    some: bool = False  #: a single coordinate may be left of those, as after a selection, where they are not needed


SCENE = Kind(
    "what make_scene gives",
    tuple((name, ()) for name in ("gravity", "cable_youngs_modulus", "cable_area"))
    + tuple((name, ("coordinate",)) for name in ("ends_lower", "ends_upper")),
    stages=("scene", "scenes"),
    further=("member",),
    is_scene=True,
    instead=("mast_height", "mast: given a scene with a mast; allowed: one with [cable], [ends]; try: mast.simulate"),
)
_ARC: tuple[tuple[str, Dims], ...] = (("arc_length", ("particle",)),)
_PLACES: tuple[tuple[str, Dims], ...] = (("position", ("time", "particle", "coordinate")), *_ARC)
#: What makes Datasets of arrays.
OWN_SNAPSHOTS = "cp.snapshots(position, scene=scene) with positions (time, particle, coordinate) [m] of another program"
OWN_MODES = "cp.modes(shapes, scene=scene) with shapes (mode, particle) of another program"
OWN_FIELD_MODES = (
    'cp.modes(shapes, layout="separate", scene=scene) with shapes (coordinate, mode, particle) of another program'
)
SNAPSHOTS = Kind("a trajectory", _PLACES, ("trajectory", "rest"), further=None, is_small=False, own=OWN_SNAPSHOTS)
TRAJECTORY = replace(SNAPSHOTS, needs=(*_PLACES, ("time", ("time",))), own=f"{OWN_SNAPSHOTS}, times=times")
#: Of which the positions alone are read.
MOTION = replace(TRAJECTORY, reads=("position", "arc_length", "time", "coordinate", "unstretched_length"))
TIMED = Kind("a Dataset with instants, from a simulate", (("time", ("time",)),), further=None, is_small=False)
AMPLITUDES = Kind(
    "amplitudes of pod.project or a reduced model",
    (("amplitude", ("time", "mode")), ("end_position", ("time", "end", "coordinate")), ("time", ("time",))),
    ("amplitudes", "trajectory"),
)
_SHAPES: tuple[tuple[str, Dims], ...] = (("mode_shape", ("mode", "particle")), *_ARC, ("coordinate", ("coordinate",)))
MODES = Kind("modes of pod.decompose", _SHAPES, ("modes",), ("separate", "vector", "normal"), own=OWN_MODES)
FIELD_MODES = Kind(
    "modes of pod.decompose with one of the layouts ('separate', 'vector')", _SHAPES, ("modes",), ("separate", "vector"),
    own=OWN_FIELD_MODES,
)  # fmt: skip
NORMAL_MODES = Kind(
    'modes of the deflection normal to the chord, pod.decompose(snapshots, layout="normal")', _SHAPES, ("modes",), ("normal",),
    own=OWN_MODES,
)  # fmt: skip
PREPARED = Kind("a prepared model, as PreparedModel.dataset() gives it", stages=("prepared model",), further=None)
WITH_PLACES = Kind("one with arc_length (particle)", _ARC, further=None, is_small=False, some=True)
MAPPED = Kind("results with the variable and both parameters", further=None, is_small=False)
ANY = Kind("a Dataset of this package", further=None, is_small=False)


@lru_cache
def drawn_kind(name: str, dims: Dims, allowed: str) -> Kind:
    """Return the kind of a Dataset of which one variable is drawn; an instant, modes or coordinates may have been picked."""
    needed = tuple(dim for dim in dims if dim not in ("time", "mode"))
    own = {"position": OWN_SNAPSHOTS, "mode_shape": OWN_MODES}.get(name, "")
    return Kind(allowed, ((name, needed),), further=None, is_small=False, own=own, some="coordinate" not in dims)
