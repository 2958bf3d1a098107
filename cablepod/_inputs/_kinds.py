"""What public functions are given: kinds of Datasets, and what their variables must be."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple

from cablepod.conventions import ATTRIBUTES, LABELS, UNITS, VARIABLES
from cablepod.parameters._checks import direction, point, points
from cablepod.parameters._key_paths import key_of_variable

Dims = tuple[str, ...]
#: Numbers of each mode, and of each coordinate in layout "separate".
TABLES_OF_MODES = (
    "singular_value", "singular_value_uncertainty", "mode_uncertainty", "proper_orthogonal_value", "energy_share",
    "singular_value_share",
)  # fmt: skip
#: Singular value over the largest of all sets of modes, up to which the snapshots do not move that way but by rounding.
NO_MOTION = 1e-9
#: Dimensions of variables, in their order in the package; a variable may lack some.
DIMS: dict[str, Dims] = {
    **dict.fromkeys(("position", "velocity"), ("time", "particle", "coordinate")),
    "tension": ("time", "link", "particle"),
    "arc_length": ("particle",),
    "link_arc_length": ("link",),
    "time": ("time",),
    "end_position": ("time", "end", "coordinate"),
    "normal_reference": ("coordinate",),
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
#: Attributes that all functions read.
ALWAYS_READ = ("stage", "id", "history_json")


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
    (("gravity", ()), ("ends_lower", ("coordinate",))),
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


# --- variables ------------------------------------------------------------------------------------------------------------


class Rule(NamedTuple):
    """What a variable of the package, or of a kind, must be."""

    units: str | None
    types: str  #: letters of numpy for the types of values that are legal, "" for any
    is_number: bool  #: floats are made of its values
    dims: Dims | None = None  #: in their order; None where no function that takes the kind reads them
    must: frozenset[str] = frozenset()  #: dimensions that it must have
    may: frozenset[str] | None = None  #: those that it may have, None for any
    allowed_dims: Dims = ()  #: in messages


@lru_cache(4096)
def rule_of(kind: Kind, layout: str | None, name: Any) -> Rule | None:
    """Return what a variable must be; None for those that are not of the package and the kind."""
    if kind.is_scene:
        key = key_of_variable(name) if isinstance(name, str) else None
        if key is None:
            return None
        if key.check is direction:  # a word or a vector
            own = ("coordinate",)
            return Rule(key.units, "", False, own, may=frozenset((*own, "member")), allowed_dims=own)
        vector: dict[Any, Dims] = {point: ("coordinate",), points: (f"{name}_point", "coordinate")}
        dims: Dims | None = vector.get(key.check, ())
        units, is_number = key.units, key.units is not None and not key.is_whole
    else:
        units = VARIABLES.get(name, ATTRIBUTES.get(name, (UNITS.get(name),)))[0]
        dims = SEPARATE.get(name) if layout == "separate" else None
        dims = DIMS.get(name, dict(kind.needs).get(name)) if dims is None else dims
        if units is None and dims is None:
            return None
        is_number = dims is not None and name not in LABELS
    is_checked = kind is not ANY and (is_number or (not kind.is_scene and name not in LABELS))
    types = "" if not is_checked else "fiu" if units is not None else "fiub"  # truth values have no units
    if dims is None or not _matters(kind, name):
        return Rule(units, types, is_number)
    must, may = _dims_allowed(kind, layout, name, dims)
    order = dims if may is None else tuple(dim for dim in dims if dim in may)
    return Rule(units, types, is_number, order, frozenset(must), None if may is None else frozenset(may), must or dims)


def _matters(kind: Kind, name: str) -> bool:
    """Tell whether functions that take this kind use a variable: all of scenes and modes, otherwise those that they need."""
    if kind.is_scene or kind.layouts or name == "scene_feature":
        return kind is not ANY
    return name.removesuffix("_out_of_plane") in dict(kind.needs)


def _dims_allowed(kind: Kind, layout: str | None, name: str, own: Dims) -> tuple[Dims, Dims | None]:
    """Return the dimensions that a variable must have, and those that it may have (None for any)."""
    needed = own if name == "scene_feature" else dict(kind.needs).get(name, ())
    if kind.is_scene:
        return own, (*own, "member", *((f"{name}_item", name.rpartition("_")[0] + "_sample") if not own else ()))
    if not kind.layouts:
        return needed, None if kind.further is None else (*own, *kind.further)
    if name.startswith(("mode_shape", "test_function")) and layout != "separate":
        own = own if layout == "vector" else ("mode", "particle")
    elif name.startswith((*TABLES_OF_MODES, "truncation_error")) and layout != "separate":
        own = tuple(dim for dim in own if dim != "coordinate")
    return own, own
