"""Scene file or Python values -> scene Dataset; every check of what a user gives.

A scene is a Dataset whose variables are the keys of the scene file with ``_`` for ``.`` (``cable.area`` is the variable
``cable_area`` [m2]); what the scene lacks is absent.  :func:`parameters` turns it into the plain numbers that the science
modules compute with.
"""

from __future__ import annotations

import itertools
import json
import os
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from cablepod import provenance, schema
from cablepod.conventions import COORDINATES, ENDS, label
from cablepod.motion import TimeFunction
from cablepod.schema import SceneError, refuse

LARGEST_FILE = 64 * 2**20  # bytes; a scene or record beyond this is a mistake


@dataclass(frozen=True)
class PointLoad:
    """A force on one place of the cable: `fraction` of the unstretched length, `force` (dims,) [N], factor of time."""

    fraction: float
    force: np.ndarray
    factor: TimeFunction | None


@dataclass(frozen=True)
class Parameters:
    """A scene as plain numbers, SI units; None stands for a term that the scene lacks."""

    stiffness: float  #: axial stiffness K [N]
    mass: float  #: mass per unstretched length [kg/m]
    weight: np.ndarray  #: weight per unstretched length (dims,) [N/m]
    lower: np.ndarray  #: lower end at rest (dims,) [m]
    upper: np.ndarray  #: upper end at rest (dims,) [m]
    free: str | None  #: the end that moves freely
    motions: Mapping[tuple[str, str], TimeFunction]  #: (end, axis) -> displacement [m]
    load: np.ndarray | None  #: uniform load beside the weight (dims,) [N/m]
    load_factor: TimeFunction | None
    point_loads: tuple[PointLoad, ...]
    length_key: str  #: which of schema.LENGTH_KEYS is given
    length_value: float
    duration: float | None
    interval: float | None
    links: int | None
    link_lengths: np.ndarray | None  #: relative, (links,)
    initial: Mapping[str, Any]  #: what the [initial] table has
    mass_damping: float | None  #: [1/s]
    link_viscosity: float | None  #: [s]

    @property
    def dims(self) -> int:
        """Two for a planar scene, three for a spatial one."""
        return self.lower.size

    def load_at(self, time: float) -> np.ndarray:
        """Weight and uniform load together at `time` [s], (dims,) [N/m]."""
        if self.load is None:
            return self.weight
        factor = 1.0 if self.load_factor is None else float(self.load_factor(time))
        return self.weight + factor * self.load

    def times(self) -> np.ndarray:
        """Instants of the snapshots [s]: 0, interval, ... up to the duration."""
        if self.duration is None or self.interval is None:
            raise SceneError(
                "time: missing; allowed: a table with duration [s] and interval [s], or the argument times"
            )
        return self.interval * np.arange(_count_instants(self.duration, self.interval))

    def end_positions(self, time: np.ndarray, derivative: int = 0) -> np.ndarray:
        """Positions of both ends, or their first or second rate, as the scene prescribes them: (time, end, dims) [m]."""
        time = np.asarray(time, dtype=float)
        result = np.zeros((time.size, 2, self.dims))
        if derivative == 0:
            result += np.stack([self.lower, self.upper])
        for (end, axis), function in self.motions.items():
            result[:, ENDS.index(end), COORDINATES.index(axis)] += function(time, derivative)
        return result

    def check_reach(self, time: float) -> None:
        """Refuse an instant [s] beyond the end of a record."""
        named: dict[str, TimeFunction | None] = {
            f"motion.{end}.{axis}": item for (end, axis), item in self.motions.items()
        }
        named["load"] = self.load_factor
        named |= {f"point_load.{index}": load.factor for index, load in enumerate(self.point_loads, start=1)}
        for key, function in named.items():
            if function is not None and time > function.end * (1.0 + 1e-12):
                raise SceneError(
                    f"{key}.path: the record ends at {function.end:g} s, before the last instant asked for; "
                    f"allowed: one that reaches {time:g} s"
                )


def _count_instants(duration: float, interval: float) -> int:
    # a duration that is a multiple of the interval but for rounding ends with a snapshot
    return int(np.floor(duration / interval * (1.0 + 1e-12))) + 1


def read_scene(path: str | os.PathLike[str]) -> xr.Dataset:
    """Read a scene from a TOML file.

    Parameters
    ----------
    path
        The scene file; records that it names are looked for relative to its folder.

    Returns
    -------
    xarray.Dataset
        The scene, see :func:`make_scene`.

    Raises
    ------
    SceneError
        For a file that cannot be read or is no TOML, and for all that :func:`make_scene` refuses.
    """
    path = Path(path)
    content = _read_text(path, "scene file")
    if not content.strip():
        raise SceneError(f"{path}: the scene file is empty; allowed: TOML with at least [cable] and [ends]")
    try:
        mapping = tomllib.loads(content)
    except tomllib.TOMLDecodeError as error:
        raise SceneError(f"{path}: not a TOML file: {error}") from None
    except RecursionError:
        raise SceneError(f"{path}: not a scene: its values are nested too deeply") from None
    try:
        return _make(mapping, path.parent)
    except SceneError as error:
        raise SceneError(f"{path}: {error}") from None


def make_scene(mapping: Mapping[str, Any]) -> xr.Dataset:
    """Make a scene from nested Python values with the keys of the scene file.

    Parameters
    ----------
    mapping
        Tables as mappings, vectors as sequences, SI units.  Not modified.

    Returns
    -------
    xarray.Dataset
        One variable for each key, named by its path with ``_`` for ``.``, with units.

    Raises
    ------
    SceneError
        For unknown or missing keys, two ways to give the length, values, signs and sizes that cannot be, a tension below
        the least possible, and an output that would not fit in memory.  The message names the key, what was given and
        what is allowed.
    """
    return _make(mapping, Path())


def _read_text(path: Path, what: str) -> str:
    try:
        if path.is_dir():
            raise SceneError(f"{path}: is a folder; allowed: a {what}")
        if path.stat().st_size > LARGEST_FILE:
            raise SceneError(f"{path}: larger than {LARGEST_FILE // 2**20} MiB; allowed: a {what}")
        return path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError:
        raise SceneError(f"{path}: binary or not UTF-8; allowed: a {what} in text form") from None
    except (OSError, ValueError) as error:
        if isinstance(error, SceneError):
            raise
        reason = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise SceneError(f"{path}: cannot read the {what}: {reason}") from None


# --- checks ---------------------------------------------------------------------------------------------------------


def _make(mapping: Mapping[str, Any], folder: Path) -> xr.Dataset:
    tree = _check(mapping, folder)
    scene = _to_dataset(tree)
    scene.attrs["title"] = tree.get("title", "untitled scene")
    scene.attrs["stage"] = "scene"
    if "ensemble" in tree:
        scene.attrs["ensemble_json"] = json.dumps(tree["ensemble"], sort_keys=True)
    provenance.seal(provenance.record(scene, function="make_scene", parameters={"scene": tree}))
    p = parameters(scene)
    _check_statics(p)
    if p.duration is not None and p.interval is not None and p.links is not None:
        check_memory(_count_instants(p.duration, p.interval), p.links, p.dims, key="chain.links and time.interval")
    return scene


def _check(mapping: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Check all tables; returns the same tree with defaults filled in and records read."""
    if not isinstance(mapping, Mapping):
        raise refuse("scene", mapping, "a mapping with the tables of a scene")
    allowed = [*schema.TOP, *schema.TABLES, *schema.OTHER_TABLES]
    for name in mapping:
        if name not in allowed:
            raise SceneError(f"{name}: unknown key or table; allowed: {', '.join(allowed)}")
    for name in ("cable", "ends"):
        if name not in mapping:
            raise SceneError(f"{name}: missing; allowed: a table with the keys {', '.join(schema.TABLES[name])}")
    tree = schema.check_table("", {key: mapping[key] for key in mapping if key in schema.TOP}, schema.TOP)
    for name, keys in schema.TABLES.items():
        if name not in mapping:
            continue
        table = mapping[name]
        if name == "load" and isinstance(table, Mapping):
            table, factor = _split_factor("load", table, keys, folder)
            tree["load"] = {**schema.check_table("load", table, keys), **factor}
        else:
            tree[name] = schema.check_table(name, table, keys)
    dims = _check_ends(tree)
    _check_cable(tree)
    _check_chain(tree)
    _check_initial(tree, dims)
    if "time" in tree:
        _check_time(tree["time"], "load" in tree, dims)
    if "load" in tree:
        _check_vector("load.uniform", tree["load"]["uniform"], dims)
    if "motion" in mapping:
        tree["motion"] = _check_motion(mapping["motion"], dims, tree["ends"].get("free"), folder)
    if "point_load" in mapping:
        tree["point_load"] = _check_point_loads(mapping["point_load"], dims, folder)
    if "ensemble" in mapping:
        tree["ensemble"] = _check_ensemble(mapping["ensemble"], tree)
    _check_records(tree)
    return tree


def _check_vector(key: str, value: list[float], dims: int) -> None:
    if len(value) != dims:
        raise refuse(key, value, f"{dims} numbers, as many as ends.lower has")


def _check_ends(tree: dict[str, Any]) -> int:
    lower, upper = tree["ends"]["lower"], tree["ends"]["upper"]
    if len(lower) != len(upper):
        raise refuse("ends.upper", upper, f"{len(lower)} numbers, as many as ends.lower has")
    if lower == upper:
        raise refuse("ends.upper", upper, "a point other than ends.lower, because ends that coincide span no cable")
    chord = float(np.linalg.norm(np.subtract(upper, lower)))
    if not 1e-6 <= chord <= 1e9:
        raise refuse("ends.upper", upper, f"a chord from 1e-6 m to 1e9 m (it is {chord:g} m)")
    return len(lower)


def _check_cable(tree: dict[str, Any]) -> None:
    cable = tree["cable"]
    schema.exactly_one("cable", cable, schema.LENGTH_KEYS)
    kind = schema.exactly_one("cable", cable, ("specific_weight", "density"))
    if kind == "specific_weight" and tree["gravity"] == 0.0:
        raise refuse(
            "cable.specific_weight", cable[kind], "cable.density instead, because without gravity it gives no mass"
        )
    stiffness = cable["youngs_modulus"] * cable["area"]
    if not 1e-6 <= stiffness <= 1e18:
        raise refuse(
            "cable.youngs_modulus", cable["youngs_modulus"], f"an axial stiffness of 1e-6 to 1e18 N ({stiffness:g})"
        )
    weight = cable[kind] * cable["area"] * (1.0 if kind == "specific_weight" else max(tree["gravity"], 1.0))
    if not 1e-15 <= weight <= 1e15:
        raise refuse(f"cable.{kind}", cable[kind], f"a weight of 1e-15 to 1e15 N/m ({weight:g})")


def _check_chain(tree: dict[str, Any]) -> None:
    if "chain" not in tree:
        return
    chain = tree["chain"]
    if "links" not in chain and "link_lengths" not in chain:
        raise SceneError("chain.links: missing; allowed: a whole number of at least 2, or chain.link_lengths")
    lengths = chain.get("link_lengths")
    if lengths is not None:
        if chain.setdefault("links", len(lengths)) != len(lengths):
            raise refuse("chain.link_lengths", lengths, f"{chain['links']} numbers, as many as chain.links says")
        if max(lengths) / min(lengths) > 1e6:
            raise refuse("chain.link_lengths", lengths, "lengths that differ by a factor of at most 1e6")


def _check_initial(tree: dict[str, Any], dims: int) -> None:
    if "initial" not in tree:
        return
    initial = tree["initial"]
    if schema.exactly_one("initial", initial, tuple(schema.INITIAL)) != "points":
        return
    line = initial["points"]
    for index, item in enumerate(line):
        _check_vector(f"initial.points[{index}]", item, dims)
    chord = float(np.linalg.norm(np.subtract(tree["ends"]["upper"], tree["ends"]["lower"])))
    for end, item in zip(ENDS, (line[0], line[-1]), strict=True):
        held = tree["ends"][end]
        if end != tree["ends"].get("free") and np.linalg.norm(np.subtract(item, held)) > 1e-9 * chord:
            raise refuse("initial.points", item, f"a line that begins and ends at the held ends (ends.{end} is {held})")
    if not any(np.linalg.norm(np.subtract(a, b)) > 0 for a, b in itertools.pairwise(line)):
        raise refuse("initial.points", line, "a line of some length")


def _check_time(table: dict[str, Any], loaded: bool, dims: int) -> None:
    if table["interval"] > table["duration"]:
        raise refuse("time.interval", table["interval"], f"at most time.duration, {table['duration']:g} s")
    if table["duration"] / table["interval"] > 1e12:
        raise refuse(
            "time.interval", table["interval"], f"an interval that {table['duration']:g} s holds at most 1e12 times"
        )


def _split_factor(
    prefix: str, table: Mapping[str, Any], keys: Mapping[str, schema.Key], folder: Path
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Split a load's table into its own keys and those of its time factor, the latter checked."""
    own = {name: value for name, value in table.items() if name in keys}
    rest = {name: value for name, value in table.items() if name not in keys}
    factor_keys = {"kind", *(name for kind in schema.time_function_keys("1").values() for name in kind)}
    for name in rest:
        if name not in factor_keys:
            raise SceneError(f"{prefix}.{name}: unknown key; allowed: {', '.join([*keys, 'kind (of a time factor)'])}")
    if not rest:
        return own, {}
    return own, _check_time_function(prefix, rest, "1", folder)


def _check_time_function(prefix: str, table: Any, units: str, folder: Path) -> dict[str, Any]:
    kinds = schema.time_function_keys(units)
    if not isinstance(table, Mapping):
        raise refuse(prefix, table, "a table with the key kind")
    if "kind" not in table:
        raise SceneError(f"{prefix}.kind: missing; allowed: one of {', '.join(kinds)}")
    kind = schema.choice(*kinds)(f"{prefix}.kind", table["kind"])
    values = {name: value for name, value in table.items() if name != "kind"}
    checked = schema.check_table(prefix, values, kinds[kind])
    if kind == "file":
        checked.update(_read_record(f"{prefix}.path", folder / checked["path"]))
    return {"kind": kind, **checked}


def _check_motion(table: Any, dims: int, free: str | None, folder: Path) -> dict[str, Any]:
    if not isinstance(table, Mapping):
        raise refuse("motion", table, "tables motion.lower.x, motion.upper.y and so on")
    axes = COORDINATES[:dims]
    checked: dict[str, Any] = {}
    for end, of_end in table.items():
        if end not in ENDS:
            raise SceneError(f"motion.{end}: unknown key; allowed: {', '.join(ENDS)}")
        if not isinstance(of_end, Mapping):
            raise refuse(f"motion.{end}", of_end, f"tables motion.{end}.x and so on")
        if end == free and of_end:
            raise refuse(f"motion.{end}", dict(of_end), f"no motion of the end that ends.free names ({free})")
        checked[end] = {}
        for axis, function in of_end.items():
            if axis not in axes:
                raise SceneError(f"motion.{end}.{axis}: unknown axis; allowed: {', '.join(axes)}")
            checked[end][axis] = _check_time_function(f"motion.{end}.{axis}", function, "m", folder)
    return checked


def _check_point_loads(loads: Any, dims: int, folder: Path) -> list[dict[str, Any]]:
    if not isinstance(loads, list | tuple):
        raise refuse("point_load", loads, "an array of tables, [[point_load]]")
    checked = []
    for index, table in enumerate(loads, start=1):
        prefix = f"point_load.{index}"
        if not isinstance(table, Mapping):
            raise refuse(prefix, table, "a table with the keys arc_length and force")
        own, factor = _split_factor(prefix, table, schema.POINT_LOAD, folder)
        item = {**schema.check_table(prefix, own, schema.POINT_LOAD), **factor}
        _check_vector(f"{prefix}.force", item["force"], dims)
        checked.append(item)
    return checked


def _check_ensemble(table: Any, tree: dict[str, Any]) -> dict[str, Any]:
    if not isinstance(table, Mapping):
        raise refuse("ensemble", table, "a table with the keys " + ", ".join([*schema.ENSEMBLE, "ranges"]))
    checked = schema.check_table(
        "ensemble", {key: value for key, value in table.items() if key != "ranges"}, schema.ENSEMBLE
    )
    ranges = table.get("ranges")
    if not isinstance(ranges, Mapping) or not ranges:
        raise refuse("ensemble.ranges", ranges, "a table from key paths to [low, high]")
    checked["ranges"] = {}
    for path, bounds in ranges.items():
        key = f"ensemble.ranges.{path}"
        value: Any = tree
        for part in str(path).split("."):
            value = value.get(part) if isinstance(value, Mapping) else None
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise SceneError(f"{key}: unknown key path; allowed: the path of a number that this scene has")
        low_high = schema.numbers_list(least_length=2)(key, bounds)
        if len(low_high) != 2 or low_high[0] >= low_high[1]:
            raise refuse(key, bounds, "[low, high] with low < high")
        checked["ranges"][path] = low_high
    return checked


def _read_record(key: str, path: Path) -> dict[str, list[float]]:
    """Read the CSV file of a record: a column `time` [s] and one value column."""
    try:
        content = _read_text(path, "record, a CSV file with the columns time and one value")
    except SceneError as error:
        raise SceneError(f"{key}: {error}") from None
    rows = [line.split(",") for line in content.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    allowed = "a CSV file with a header (time and one value column) and at least 4 rows of numbers"
    if not rows:
        raise SceneError(f"{key}: {path} is empty; allowed: {allowed}")
    header = [name.strip() for name in rows[0]]
    if len(header) != 2 or "time" not in header:
        raise SceneError(f"{key}: {path} has the columns {', '.join(header)[:80]}; allowed: {allowed}")
    table = []
    for number, row in enumerate(rows[1:], start=1):
        try:
            values = [float(item) for item in row]
        except ValueError:
            values = []
        if len(values) != 2 or not np.isfinite(values).all():
            raise SceneError(
                f"{key}: {path} has a gap: row {number} holds {','.join(row)[:60]!r}; allowed: two finite numbers"
            )
        table.append(values)
    if len(table) < 4:
        raise SceneError(f"{key}: {path} is too short: {len(table)} rows; allowed: {allowed}")
    column = np.array(table)
    time, value = column[:, header.index("time")], column[:, 1 - header.index("time")]
    step = np.diff(time)
    if (step <= 0).any():
        where = int(np.argmax(step <= 0))
        raise SceneError(
            f"{key}: {path} is unsorted: time {time[where + 1]:g} s follows {time[where]:g} s; allowed: rising"
        )
    if step.max() > 10.0 * np.median(step):
        where = int(np.argmax(step))
        raise SceneError(
            f"{key}: {path} has a gap of {step.max():g} s after {time[where]:g} s; "
            f"allowed: at most ten times the median spacing, {np.median(step):g} s"
        )
    return {"time": time.tolist(), "value": value.tolist()}


def _check_records(tree: dict[str, Any]) -> None:
    """Refuse records that do not cover the run."""
    tables = [(f"motion.{end}.{axis}", t) for end, axes in tree.get("motion", {}).items() for axis, t in axes.items()]
    tables += [("load", tree["load"])] if "load" in tree else []
    tables += [(f"point_load.{index}", item) for index, item in enumerate(tree.get("point_load", []), start=1)]
    duration = tree.get("time", {}).get("duration", 0.0)
    for prefix, table in tables:
        if table.get("kind") != "file":
            continue
        first, last = table["time"][0], table["time"][-1]
        if first > 0.0 or last < duration * (1.0 - 1e-12):
            raise SceneError(
                f"{prefix}.path: the record is too short, from {first:g} s to {last:g} s; "
                f"allowed: one that covers the run, from 0 s to {duration:g} s"
            )


def _check_statics(p: Parameters) -> None:
    """Refuse a tension below the least possible and a weightless slack cable, before anything runs."""
    solve_statics(p, p.length_key, p.length_value, prefix="cable")
    for key in ("top_tension", "unstretched_length"):
        if key in p.initial:
            solve_statics(p, key, p.initial[key], prefix="initial")


def solve_statics(p: Parameters, key: str, value: float, *, prefix: str = "cable") -> np.ndarray:
    """Solve the elastic catenary of a scene for one given quantity.

    Parameters
    ----------
    p
        The scene's parameters; weight and uniform load at time 0 act.
    key, value
        One of ``schema.LENGTH_KEYS`` and its value [N or m].
    prefix
        The table named in an error.

    Returns
    -------
    numpy.ndarray
        (6,) as in ``kernels.catenary.COLUMNS``; nan for a weightless slack cable that starts from given points, which
        needs no rest.

    Raises
    ------
    SceneError
        Where no such cable exists; the message names the least possible tension.
    """
    from cablepod.kernels import catenary as kernel  # numba is imported only to compute

    a, b, c, q, _, _ = load_plane(p)
    out = np.empty(6)
    kind = (kernel.UPPER_TENSION, kernel.LOWER_TENSION, kernel.HORIZONTAL_FORCE, kernel.LENGTH)[
        schema.LENGTH_KEYS.index(key)
    ]
    status = kernel.solve(a, b, c, q, p.stiffness, kind, value, out)
    if status == kernel.FOUND:
        return out
    name = f"{prefix}.{key}"
    if status == kernel.BELOW_LEAST_TENSION:
        least = kernel.least_tension(a, b, c, q, p.stiffness, 1.0 if kind == kernel.UPPER_TENSION else -1.0)
        raise refuse(name, value, f"at least {max(least, 0.0):.6g} N, below which no cable between these ends has it")
    if status == kernel.SLACK_WEIGHTLESS:
        if "points" in p.initial and prefix == "cable":
            out[0] = value
            return out
        raise refuse(
            name, value, f"at most the chord, {c:.12g} m, because a slack cable without load has no shape at rest"
        )
    if status == kernel.VERTICAL_WITH_FORCE:
        raise refuse(
            name, value, "another way to give the length, because a cable along the load has no force across it"
        )
    raise refuse(name, value, "a value for which the catenary can be computed in double precision")


def load_plane(p: Parameters) -> tuple[float, float, float, float, np.ndarray, np.ndarray]:
    """Span across the total load, rise against it, chord [m], load [N/m], and the unit vectors across and against it."""
    chord = p.end_positions(np.zeros(1))[0]
    chord = chord[1] - chord[0]
    load = p.load_at(0.0)
    q = _norm(load)
    against = -load / q if q > 0.0 else np.eye(p.dims)[1]
    if q > 0.0 and np.count_nonzero(load) == 1:
        against = np.sign(against)  # exactly an axis
    b = float(chord @ against)
    across = chord - b * against
    across = across - (across @ against) * against  # once more: the first difference may have cancelled
    a = _norm(across)
    c = _norm(chord)
    if a <= 1e-15 * c:
        return 0.0, float(np.copysign(c, b)), c, q, np.zeros(p.dims), against
    return a, b, c, q, across / a, against


def _norm(vector: np.ndarray) -> float:
    # hypot is right to the last digit or two and, unlike BLAS, gives planar and spatial scenes the same bits
    return float(np.hypot.reduce(vector))


# --- Dataset and back -----------------------------------------------------------------------------------------------


def _to_dataset(tree: dict[str, Any]) -> xr.Dataset:
    dims = len(tree["ends"]["lower"])
    variables: dict[str, Any] = {}

    def add(name: str, value: Any, key: schema.Key) -> None:
        attrs = {"long_name": key.long_name} | ({"units": key.units} if key.units else {})
        array = np.asarray(value)
        if array.ndim == 0:
            variables[name] = ((), array, attrs)
        elif array.ndim == 2:
            variables[name] = ((f"{name}_point", "coordinate"), array.astype(float), attrs)
        else:
            variables[name] = (
                ("coordinate",) if key.check is schema.point else (name + "_item",),
                array.astype(float),
                attrs,
            )

    def add_factor(prefix: str, table: Mapping[str, Any], units: str, what: str) -> None:
        if "kind" not in table:
            return
        variables[f"{prefix}_kind"] = ((), np.asarray(table["kind"]), {"long_name": f"kind of time function, {what}"})
        keys = schema.time_function_keys(units)[table["kind"]]
        for name, key in keys.items():
            add(f"{prefix}_{name}", table[name], schema.Key(key.check, key.units, f"{key.long_name}, {what}"))
        if table["kind"] == "file":
            sample = f"{prefix}_sample"
            record = {"time": ("s", "time of the record"), "value": (units, "value of the record")}
            for name, (unit, long_name) in record.items():
                attrs = {"units": unit, "long_name": f"{long_name}, {what}"}
                variables[f"{prefix}_{name}"] = ((sample,), np.array(table[name]), attrs)

    add("gravity", tree["gravity"], schema.TOP["gravity"])
    for table, keys in schema.TABLES.items():
        for name, value in tree.get(table, {}).items():
            if name in keys:
                add(f"{table}_{name}", value, keys[name])
    add_factor("load", tree.get("load", {}), "1", "factor of the uniform load")
    for end, axes in tree.get("motion", {}).items():
        for axis, function in axes.items():
            add_factor(f"motion_{end}_{axis}", function, "m", f"displacement of the {end} end along {axis}")
    for index, item in enumerate(tree.get("point_load", []), start=1):
        for name, key in schema.POINT_LOAD.items():
            add(f"point_load_{index}_{name}", item[name], key)
        add_factor(f"point_load_{index}", item, "1", f"factor of point load {index}")
    scene = xr.Dataset(variables, coords={"coordinate": list(COORDINATES[:dims])})
    label(scene[["coordinate"]])
    return scene


def parameters(scene: xr.Dataset) -> Parameters:
    """Return the plain numbers of a scene.

    Raises
    ------
    SceneError
        Where `scene` is not a scene, or one with several members.
    """
    members = parameters_of_members(scene)
    if "member" in scene.dims:
        raise SceneError("scene: given several members; allowed: one, scene.isel(member=0)")
    return members[0]


def parameters_of_members(scene: xr.Dataset) -> list[Parameters]:
    """Return the plain numbers of each member of a scene, a list of one where there is no dimension ``member``.

    Raises
    ------
    SceneError
        Where `scene` is not a scene.
    """
    if not isinstance(scene, xr.Dataset) or "cable_youngs_modulus" not in scene or "ends_lower" not in scene:
        raise SceneError(
            "scene: given no Dataset with cable_youngs_modulus and ends_lower; allowed: what make_scene gives"
        )
    fixed, varied = {}, {}
    for name, variable in scene.variables.items():
        if "member" in variable.dims:
            varied[str(name)] = variable.transpose("member", ...).values
        else:
            fixed[str(name)] = variable.values[()]
    count = scene.sizes.get("member", 1)
    return [_parameters({**fixed, **{name: item[i] for name, item in varied.items()}}) for i in range(count)]


def _parameters(value: Mapping[str, Any]) -> Parameters:

    def number(name: str) -> float | None:
        return float(value[name]) if name in value else None

    def function(prefix: str) -> TimeFunction | None:
        if f"{prefix}_kind" not in value:
            return None
        kind = str(value[f"{prefix}_kind"])
        names = ("time", "value") if kind == "file" else tuple(schema.time_function_keys("1")[kind])
        return TimeFunction(kind, {name: value[f"{prefix}_{name}"] for name in names})

    dims = len(value["ends_lower"])
    gravity, area = float(value["gravity"]), float(value["cable_area"])
    if "cable_density" in value:
        mass = float(value["cable_density"]) * area
        weight = mass * gravity
    else:
        weight = float(value["cable_specific_weight"]) * area
        mass = weight / gravity
    length_key = next(key for key in schema.LENGTH_KEYS if f"cable_{key}" in value)
    motions = {(end, axis): function(f"motion_{end}_{axis}") for end in ENDS for axis in COORDINATES[:dims]}
    loads: list[PointLoad] = []
    while (prefix := f"point_load_{len(loads) + 1}") + "_force" in value:
        loads.append(PointLoad(float(value[prefix + "_arc_length"]), value[prefix + "_force"], function(prefix)))
    return Parameters(
        stiffness=float(value["cable_youngs_modulus"]) * area,
        mass=mass,
        weight=np.array([0.0, -weight, 0.0][:dims]),
        lower=value["ends_lower"],
        upper=value["ends_upper"],
        free=str(value["ends_free"]) if "ends_free" in value else None,
        motions={key: item for key, item in motions.items() if item is not None},
        load=value["load_uniform"] if np.any(value.get("load_uniform", 0.0)) else None,
        load_factor=function("load"),
        point_loads=tuple(load for load in loads if np.any(load.force)),
        length_key=length_key,
        length_value=float(value[f"cable_{length_key}"]),
        duration=number("time_duration"),
        interval=number("time_interval"),
        links=int(value["chain_links"]) if "chain_links" in value else None,
        link_lengths=value.get("chain_link_lengths"),
        initial={key: value[f"initial_{key}"] for key in schema.INITIAL if f"initial_{key}" in value},
        mass_damping=number("damping_mass_proportional") or None,
        link_viscosity=number("damping_link_viscosity") or None,
    )


def check_memory(instants: int, links: int, dims: int, *, key: str, variables: int = 1) -> None:
    """Refuse an output that would not fit in memory.

    Raises
    ------
    SceneError
        Naming what is needed and what the machine has.
    """
    needed = 8.0 * dims * variables * (float(instants) * (links + 1) + 20.0 * links)
    try:
        memory = float(os.sysconf("SC_PAGE_SIZE")) * float(os.sysconf("SC_PHYS_PAGES"))
    except (AttributeError, OSError, ValueError):  # a system that does not tell
        memory = 16e9
    if needed > 0.5 * memory:
        raise SceneError(
            f"{key}: given {links} links and {instants} instants, {needed / 1e9:.3g} GB of output; "
            f"allowed: half of this machine's memory, {0.5 * memory / 1e9:.3g} GB"
        )
