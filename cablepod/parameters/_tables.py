"""Tables of a scene: where each stands, and its keys.  The variable of a key has the key path with ``_`` for ``.``."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from difflib import get_close_matches
from functools import lru_cache
from itertools import chain, product
from typing import Any, NamedTuple

from cablepod.conventions import COORDINATES, ENDS
from cablepod.parameters._checks import direction, number, numbers_list, point, text
from cablepod.parameters._keys import ENSEMBLE, FREQUENCY, LISTED, TABLES, TOP, Key, time_function_keys
from cablepod.parameters._mast_keys import GUY, GUY_CABLE, GUY_LISTED, MAST, MAST_LOAD, MAST_SECTION, SHARED_TABLES

#: Parts of the path of a table that stand for any end, axis, number from 1, name.
END, AXIS, NUMBER, NAME = "END", "AXIS", "NUMBER", "NAME"
PATTERNS = {END: "|".join(ENDS), AXIS: "|".join(COORDINATES), NUMBER: r"[1-9]\d*", NAME: r"\w+"}
#: Likeness of a name and that of a variable above which it is taken for a spelling error.
LEAST_LIKENESS = 0.85
#: Kinds of scenes.
OF_CABLE, OF_MAST = "one cable", "a mast"


class Table(NamedTuple):
    """A table of a scene."""

    path: tuple[str, ...]  #: parts of its key path
    keys: Mapping[str, Key]
    factor: str | None = None  #: units of the time function that it may hold
    of: tuple[str, ...] = (OF_CABLE, OF_MAST)  #: scenes that may have it

    @property
    def all_keys(self) -> dict[str, Key]:
        """Own keys, and those of the variables of a time function of any kind."""
        if self.factor is None:
            return dict(self.keys)
        of_kinds = chain.from_iterable(keys.items() for keys in time_function_keys(self.factor).values())
        record = {"time": Key(numbers_list(), "s", "instants of the record")}
        record |= {"value": Key(numbers_list(), self.factor, "values of the record")}
        return {**dict(of_kinds), **self.keys, "kind": Key(text, None, "kind"), **record}


_ONE, _MAST = (OF_CABLE,), (OF_MAST,)
ALL_TABLES = (
    Table((), TOP),
    *(
        Table(tuple(name.split(".")), keys, "1" if name == "load" else None, (*_ONE, *_MAST * (name in SHARED_TABLES)))
        for name, keys in TABLES.items()
    ),
    Table(("motion", END, AXIS), {}, "m", _ONE),
    *(Table((name, NUMBER), keys, "1" if name == "point_load" else None, _ONE) for name, keys in LISTED.items()),
    Table(("guy", NUMBER), GUY, of=_MAST),
    Table(("mast", "section", NUMBER), MAST_SECTION, of=_MAST),
    Table(("mast", "load", NUMBER), MAST_LOAD, "1", _MAST),
    Table(("mast",), MAST, of=_MAST),
    *(Table(("cables", NAME, name, NUMBER), keys, of=_MAST) for name, keys in GUY_LISTED.items()),
    Table(("cables", NAME), GUY_CABLE, of=_MAST),
    Table(("ensemble",), ENSEMBLE, of=()),
)
#: Paths of tables that are lists.
LISTS = tuple(table.path[:-1] for table in ALL_TABLES if table.path[-1:] == (NUMBER,))


def is_like(parts: Iterable[Any], path: tuple[str, ...]) -> bool:
    """Tell whether the parts of a key path are those of a `path`, in which words of :data:`PATTERNS` stand for others."""
    given = tuple(parts)
    return len(given) == len(path) and all(
        part == own or (own in PATTERNS and isinstance(part, str) and re.fullmatch(PATTERNS[own], part) is not None)
        for part, own in zip(given, path, strict=True)
    )


@lru_cache(1024)
def table_of(parts: tuple[str, ...]) -> Table | None:
    """Return the table at the parts of a key path; None for other paths."""
    return next((table for table in ALL_TABLES if is_like(parts, table.path)), None)


class Place(NamedTuple):
    """Where the value of a variable of a scene Dataset stands."""

    table: tuple[str, ...]  #: parts of the path of its table
    name: str  #: of the key
    axis: str  #: of a component of a vector, else empty
    key: Key  #: of a component that of a number
    of: tuple[str, ...]  #: scenes that may have it

    @property
    def path(self) -> str:
        """Key path."""
        return ".".join((*self.table, self.name, *([self.axis] if self.axis else [])))


@lru_cache(1024)
def place_of_variable(variable: str) -> Place | None:
    """Return where the value of a variable of a scene Dataset stands; None for other names."""
    for table in ALL_TABLES:
        if not table.path:
            names: dict[str, tuple[str, str]] = {name: (name, "") for name in TOP}
        elif not variable.startswith(f"{table.path[0]}_"):
            continue
        else:
            names = dict(_names_in(table))
        parts = "_".join(f"({PATTERNS.get(part, part)})" for part in table.path)
        found = re.fullmatch(f"{parts}{'_' if parts else ''}({'|'.join(names)})", variable)
        if found:
            *above, last = found.groups()
            name, axis = names[last]
            if name == FREQUENCY:  # given in files only, in place of that of a variable
                return Place(tuple(above), name, axis, Key(number(), "Hz", name), ())
            key = table.all_keys[name]
            return Place(tuple(above), name, axis, replace(key, check=number()) if axis else key, table.of)
    return None


def _names_in(table: Table) -> Iterator[tuple[str, tuple[str, str]]]:
    """Yield the end of the name of each variable of a table, with key and axis."""
    for name, key in table.all_keys.items():
        yield name, (name, "")
        if key.check in (point, direction):
            yield from ((f"{name}_{axis}", (name, axis)) for axis in COORDINATES)
    if table.factor is not None:
        yield FREQUENCY, (FREQUENCY, "")  # for messages: no variable has it


@lru_cache(1024)
def misspelt(variable: str, of: str) -> str:
    """Return what to try in place of a variable that is none of a scene of a kind, but is named as one; empty for all others.

    The names that begin as those of a table are the package's, so that a key that is spelt wrong is not taken for a variable of
    the user's own.
    """
    place = place_of_variable(variable)
    if place is not None and of in place.of:
        return ""
    number = re.search(r"\d+", variable)
    known = [name.replace("1", number[0] if number else "1") for name in _variables_of(of)]
    if similar := get_close_matches(variable, known, n=1, cutoff=LEAST_LIKENESS):
        return similar[0]
    is_of_table = variable.startswith(tuple(f"{table.path[0]}_" for table in ALL_TABLES if table.path))
    return "another name, a coordinate or an attribute for what is your own" if is_of_table else ""


def _variables_of(of: str) -> Iterator[str]:
    """Yield the names of the variables of a kind of scene, the first of lists, but those of cables with a name."""
    for table in ALL_TABLES:
        if of in table.of and NAME not in table.path:
            choices = [PATTERNS[part].split("|") if part in (END, AXIS) else [part] for part in table.path]
            for parts in product(*choices):
                yield from ("_".join((*parts, name)).replace(NUMBER, "1") for name in table.all_keys)


def key_at(path: str, kind: str | None) -> Key | None:
    """Return the key at a path; of a time function that of its `kind`."""
    *above, name = path.split(".")
    table = table_of(tuple(above))
    if table is None or not table.of:
        return None
    of_kind = time_function_keys(table.factor).get(kind, {}) if table.factor is not None and kind is not None else {}
    return {**table.keys, **of_kind}.get(name)
