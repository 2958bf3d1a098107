"""Keys of a scene with a mast and its guys: names, units, allowed values."""

from cablepod.parameters._checks import choice, integer, number, point, text
from cablepod.parameters._keys import CABLE, EXPANSION, LENGTH_KEYS, LISTED, Key

#: Keys of the cross-section of a mast.
_SECTION = {
    "bending_stiffness": Key(number(above=0.0), "N m2", "bending stiffness of the mast", required=True),
    "mass": Key(number(above=0.0), "kg m-1", "mass per length of the mast", required=True),
    "drag_area": Key(number(least=0.0), "m", "drag coefficient times width of the mast", default=0.0),
    "diameter": Key(number(above=0.0), "m", "diameter of the mast, or of the members of a lattice, on which ice grows"),
    "member_length": Key(number(above=0.0), "1", "length of the members of a lattice per length of the mast"),
}
MAST = {
    "height": Key(number(above=0.0), "m", "height of the mast, whose foot is at the origin", required=True),
    **_SECTION,
    "base": Key(choice("pinned", "clamped"), None, "foot of the mast", default="pinned"),
    "damping_ratio": Key(number(least=0.0, most=0.5), "1", "damping ratio of the modes of the mast", default=0.01),
    "elements": Key(integer(least=2, most=400), "1", "number of beam elements", default=24),
    "modes": Key(integer(least=1, most=60), "1", "number of modes of the mast in each direction", default=8),
    "thermal_expansion": EXPANSION,
}
MAST_SECTION = {
    "from": Key(number(least=0.0), "m", "height of the lower end of the section", required=True),
    "to": Key(number(above=0.0), "m", "height of the upper end of the section", required=True),
    **{name: Key(key.check, key.units, key.long_name) for name, key in _SECTION.items()},
}
MAST_LOAD = {
    "level": Key(number(above=0.0), "m", "height at which the force acts", required=True),
    "force": Key(point, "N", "force on the mast", required=True),
}
#: Tensions of a guy; its length is found from one of them, or given.
GUY_LENGTH_KEYS = tuple(key for key in LENGTH_KEYS if key != "horizontal_force")
GUY = {
    "cable": Key(text, None, "name of the cable of the guys", required=True),
    "level": Key(number(above=0.0), "m", "height at which the guys are fastened to the mast", required=True),
    "radius": Key(
        number(above=0.0), "m", "distance of the anchors from the axis of the mast, at the height of its foot"
    ),
    "count": Key(integer(least=1, most=24), "1", "number of guys, evenly spaced round the mast"),
    "direction": Key(point, "1", "horizontal direction from the mast to the first anchor"),
    "anchor": Key(point, "m", "anchor of a single guy"),
    **{name: CABLE[name] for name in GUY_LENGTH_KEYS},
    "breaks": Key(number(above=0.0), "s", "time at which the guy breaks"),
    "breaks_number": Key(integer(least=1), "1", "which guy of the table breaks, from 1"),
}
#: Keys of a cable of guys: those of a cable but what determines its length.
GUY_CABLE = {name: key for name, key in CABLE.items() if name not in LENGTH_KEYS}
#: Lists of tables of such a cable, the same for each of its guys.
GUY_LISTED = {name: LISTED[name] for name in ("segment", "attachment")}
#: Tables of a mast that a scene of one cable has too.
SHARED_TABLES = ("time", "chain", "damping", "wind", "wind.turbulence", "ice")
