"""Tables of a page: numbers of Datasets in units for people, keys of a scene as they were given, rows of a caller."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod.conventions import ENDINGS_OF_AIR, digits, is_in_memory, printed, printed_unit, unit_text
from cablepod.errors import SceneError, scene_error
from cablepod.parameters._key_paths import dotted, key_of_variable, variable_name
from cablepod.parameters._keys import CABLE, DRAG_COEFFICIENT
from cablepod.plots._page_html import NOTHING, Table
from cablepod.plots._style import OVER_PLACES

#: Maximum number of rows of a table; larger variables are told by their least, mean and largest value.
MAX_ROWS = 60
#: Size of a variable in a file or of dask above which it is not read [bytes].
MAX_READ = 200_000_000
#: Dimensions of instants, places of a mesh and single storms, which are too many for a table.
OF_MESH = ("time", "particle", "link", "node", "point", "element", "storm")
#: Dimensions that are columns of a table, not rows.
ACROSS = ("coordinate", "end")
#: Variables that no reader asks for: of training, of shapes, and what figures and other parts of the page show.
LEFT_OUT = re.compile(
    r"position|velocity|scene_feature|training_range|displacement_scale|mean|mode_shape.*|proper_orthogonal_value.*|mode_uncertainty.*|"
    r"singular_value_(uncertainty|share).*|truncation_error.*|guy_share|note|failure|end_position|table|"
    r"highest_angular_frequency|step_limit|shortest_time_scale|spectral_radius|newton_iterations|energy_(excess|defect|drift)"
)
#: Ratios that are printed in per cent.
PERCENT = re.compile(
    r"(error(_(max|rms|estimate))?|.*_error_estimate|utilisation.*|strain|.*_over_chord|energy_share.*|mast_share)"
    rf"({'|'.join(ENDINGS_OF_AIR)})"
)
#: Units of quantities that are zero up to rounding below a size.
ROUNDED, ROUNDING = ("m", "N", "N m", "s", "%"), 1e-12
#: Units of forces, moments and places, which are zero up to rounding below a share of the largest value of their variable.
OF_VECTORS, ROUNDING_SHARE = ("m", "N", "N m"), 1e-9
#: Heading of a column of a caller: text and units.
HEADING = re.compile(r"(.*?)\s*\[([^\[\]]*)\]")
#: Units that people write and their forms in :data:`cablepod.conventions.VARIABLES`.
SAME_UNITS = {"m/s": "m s-1", "rad/s": "rad s-1"}
#: Key path of the diameter of a cable.
OF_DIAMETER = re.compile(r"(cable|cables\.[^.]+)\.diameter")
#: Maximum number of values of a list that are echoed one by one.
MAX_LIST = 6


class Column(NamedTuple):
    """Heading, SI units and values of a column; units are None for texts."""

    name: str
    units: str | None
    values: np.ndarray


# --- numbers --------------------------------------------------------------------------------------------------------------


def once(results: Mapping[str, xr.Dataset]) -> dict[str, xr.Dataset]:
    """Return results without what another one has too: single numbers stay in the first, columns of tables in the last one.

    Studies repeat the length of the cable in each result, and have tables of what a run tells.
    """
    kept: dict[tuple[Any, ...], str] = {}
    content: dict[tuple[str, Any], tuple[Any, ...]] = {}
    for result, dataset in results.items():
        for name in dataset.data_vars:
            variable = dataset.variables[name]
            if variable.dtype.kind in "iufb" and (not variable.ndim or is_tabulated(variable)):
                key = content[result, name] = (name, variable.dims, variable.values.tobytes())
                if variable.ndim or key not in kept:
                    kept[key] = result
    return {
        result: dataset.drop_vars([name for (of, name), key in content.items() if of == result and kept[key] != result])
        for result, dataset in results.items()
    }


def scalars_of(dataset: xr.Dataset) -> Table | None:
    """Return the numbers and texts of a Dataset that have no dimension, one a row; None without any."""
    rows = []
    for name, variable in _shown(dataset):
        if variable.ndim:
            continue
        value = variable.values.item()
        if isinstance(value, str):
            shown = value
        elif not math.isfinite(float(value)):
            continue  # what a scene has not, such as a breaking strength
        else:
            shown = number(float(value), units_of(name, variable))
        if shown:
            rows.append([long_name(name, variable), shown])
    return Table(["quantity", "value"], rows) if rows else None


def tables_of(dataset: xr.Dataset) -> Iterator[Table]:
    """Yield a table for each set of short dimensions, such as guys or modes, with a column for each variable over it."""
    groups: dict[tuple[str, ...], list[tuple[str, xr.Variable]]] = {}
    for name, variable in _shown(dataset):
        if is_tabulated(variable):
            groups.setdefault(_rows_of(variable), []).append((name, variable))
    for dims, members in groups.items():
        columns = list(itertools.chain.from_iterable(_columns(dataset, name, variable) for name, variable in members))
        if dims == ("member",):
            columns += _extremes(dataset)
        yield _table([*_labels(dataset, dims), *columns], fixed=len(dims))


def ranges_of(dataset: xr.Dataset) -> Table | None:
    """Return least, mean and largest value of each variable that is too long for a table; None without any."""
    rows = []
    for name, variable in _shown(dataset):
        if not variable.ndim or is_tabulated(variable) or variable.dtype.kind not in "iuf" or not variable.size:
            continue
        sizes = ", ".join(f"{dim} {size}" for dim, size in variable.sizes.items())
        if variable.nbytes > MAX_READ and not is_in_memory(variable):
            rows.append([long_name(name, variable), sizes, "not read", "", ""])
            continue
        values = without_rounding(np.asarray(variable.values, dtype=float), units_of(name, variable))
        values = values[np.isfinite(values)]
        if not values.size:
            continue
        units = units_of(name, variable)
        if units in ROUNDED:
            values = np.where(np.abs(values) < ROUNDING, 0.0, values)
        least, mean, most = float(values.min()), float(values.mean()), float(values.max())
        factor, unit = printed_unit(units, max(abs(least), abs(most)))
        texts = [digits(factor * value, 5) for value in (least, mean, most)]
        rows.append([f"{long_name(name, variable)} {_bracket(unit)}".rstrip(), sizes, *texts])
    return Table(["quantity", "size", "least", "mean", "largest"], rows, fixed=2) if rows else None


def is_tabulated(variable: xr.Variable) -> bool:
    """Tell whether a variable is a column of a table."""
    dims = _rows_of(variable)
    if not variable.ndim or any(dim in OF_MESH for dim in dims):
        return False
    return variable.size > 0 and math.prod(variable.sizes[dim] for dim in dims) <= MAX_ROWS


def _rows_of(variable: xr.Variable) -> tuple[str, ...]:
    """Return the dimensions that are rows of a table: all but :data:`ACROSS`, or these where there is no other one."""
    return tuple(str(dim) for dim in variable.dims if dim not in ACROSS) or tuple(map(str, variable.dims))


def _shown(dataset: xr.Dataset) -> Iterator[tuple[str, xr.Variable]]:
    """Yield the variables that a reader asks for; of numbers at rest in wind those in still air and in the mean wind alone."""
    _, *airs = ENDINGS_OF_AIR
    for name in dataset.data_vars:
        variable, given = dataset.variables[name], str(name)
        if all(f"{given}{air}" in dataset for air in airs):
            continue  # the same as one of these: the heading says which
        in_hertz = given.removeprefix("angular_") if given.startswith("angular_") else f"{given}_hertz"
        if not LEFT_OUT.fullmatch(given) and in_hertz not in dataset and variable.dtype.kind in "iufbUO":
            yield given, variable


def _labels(dataset: xr.Dataset, dims: Sequence[str]) -> list[Column]:
    """Return the columns that name a row: labels of its dimensions, then other coordinates of them."""
    shape = [dataset.sizes[dim] for dim in dims]
    places = np.indices(shape).reshape(len(dims), -1)
    columns = []
    for dim, place in zip(dims, places, strict=True):
        if dim in dataset.coords:
            variable = dataset.variables[dim]
            columns.append(Column(dim, units_of(dim, variable), variable.values[place]))
        else:
            columns.append(Column(dim, "1", place + 1))
    for name in dataset.coords:
        variable = dataset.variables[name]
        if name not in dims and variable.dims and set(variable.dims) <= set(dims) and not LEFT_OUT.fullmatch(str(name)):
            at = tuple(places[dims.index(str(dim))] for dim in variable.dims)
            columns.append(Column(str(name), units_of(str(name), variable), variable.values[at]))
    return columns


def _extremes(dataset: xr.Dataset) -> Iterator[Column]:
    """Yield the extreme of each member over its links or guys."""
    for name, (place, extreme) in OVER_PLACES.items():
        if name in dataset and set(dataset[name].dims) == {"member", place} and dataset[name].dtype.kind == "f":
            variable = dataset.variables[name].transpose("member", place)
            yield Column(f"{name} of all {place}s", units_of(name, variable), extreme(variable.values, axis=1))


def _columns(dataset: xr.Dataset, name: str, variable: xr.Variable) -> Iterator[Column]:
    """Yield a column of a variable, or one for each of its coordinates or ends."""
    rows = _rows_of(variable)
    across = [dim for dim in variable.dims if dim not in rows]
    values = variable.transpose(*across, *rows).values
    units = units_of(name, variable)
    values = without_rounding(values, units) if values.dtype.kind == "f" else values
    labels = [
        dataset[dim].values.tolist() if dim in dataset.coords else range(1, variable.sizes[dim] + 1) for dim in across
    ]
    for place in itertools.product(*(range(variable.sizes[dim]) for dim in across)):
        words = [str(label[i]) for label, i in zip(labels, place, strict=True)]
        yield Column(" ".join([name, *words]), units, values[place].reshape(-1))


def without_rounding(values: np.ndarray, units: str) -> np.ndarray:
    """Return the values of a variable with 0 in place of rounding, such as of a component across all loads."""
    if units not in OF_VECTORS:
        return values
    sizes = np.abs(values)
    return np.where(sizes < ROUNDING_SHARE * sizes[np.isfinite(sizes)].max(initial=0.0), 0.0, values)


def units_of(name: str, variable: xr.Variable) -> str:
    """Return the SI units of a variable, "%" for ratios that are printed in per cent."""
    units = str(variable.attrs.get("units", "1"))
    return "%" if units == "1" and PERCENT.fullmatch(name) else units


def long_name(name: str, variable: xr.Variable) -> str:
    """Return the long name of a variable, or its name."""
    return str(variable.attrs.get("long_name") or name.replace("_", " "))


def number(value: float, units: str) -> str:
    """Return a quantity in SI units as text, in units for people."""
    shown = printed(value, units)
    _, unit = printed_unit(units, value)
    return f"{shown.removesuffix(unit).rstrip()} {unit_text(unit)}".rstrip() if unit else shown


def _table(columns: Sequence[Column], *, fixed: int = 1) -> Table:
    """Return a table of columns, each in one unit for people."""
    head, cells = [], []
    for column in columns:
        shown, unit = _cells(column)
        name = column.name.replace("_", " ")
        head.append(
            f"{name.replace('angular frequency', 'frequency') if unit == 'Hz' else name} {_bracket(unit)}".rstrip()
        )
        cells.append(shown)
    return Table(head, list(zip(*cells, strict=True)), fixed)


def _cells(column: Column) -> tuple[list[str], str]:
    """Return the texts of a column, and the unit of its heading."""
    values = column.values
    if values.dtype.kind in "UO":
        return [str(value) if value is not None and str(value) else NOTHING for value in values.tolist()], ""
    if values.dtype.kind == "b":
        return ["yes" if value else "no" for value in values.tolist()], ""
    if column.units in ROUNDED and values.dtype.kind == "f":
        values = np.where(np.abs(values) < ROUNDING, 0.0, values)
    sizes = np.abs(np.asarray(values, dtype=float))
    factor, unit = printed_unit(column.units or "1", float(sizes[np.isfinite(sizes)].max(initial=0.0)))
    if values.dtype.kind in "iu" and factor == 1.0:
        return [str(value) for value in values.tolist()], unit
    return [digits(factor * value, 5) if math.isfinite(value) else NOTHING for value in values.tolist()], unit


def _bracket(unit: str) -> str:
    return f"[{text}]" if (text := unit_text(unit)) else ""


# --- rows of a caller -------------------------------------------------------------------------------------------------------


def checked_tables(given: Any) -> dict[str, list[dict[str, Any]]]:
    """Return the tables of a caller by their heading, or refuse them."""
    allowed = 'a mapping from headings to rows, each a mapping from headings such as "peak [N]" to numbers and texts'
    if given is None:
        return {}
    if not isinstance(given, Mapping):
        raise scene_error("tables", given, allowed)
    for heading, rows in given.items():
        is_list = isinstance(rows, Sequence) and not isinstance(rows, str)
        if not isinstance(heading, str) or not is_list or not all(isinstance(row, Mapping) for row in rows):
            raise SceneError(f"tables: given {type(rows).__name__} of {heading!r}; allowed: {allowed}")
    return {
        heading: [{str(name): value for name, value in row.items()} for row in rows] for heading, rows in given.items()
    }


def table_of_rows(rows: Iterable[Mapping[str, Any]]) -> Table | None:
    """Return a table of rows whose headings end with their SI units, such as "peak [N]"; None without rows."""
    rows = list(rows)
    columns = []
    for heading in dict.fromkeys(name for row in rows for name in row):
        found = HEADING.fullmatch(heading)
        name, units = (found[1], SAME_UNITS.get(found[2], found[2])) if found else (heading, "1")
        values = [row.get(heading) for row in rows]
        is_number = [isinstance(value, int | float | np.number) and not isinstance(value, bool) for value in values]
        if any(is_number) and all(plain or value is None for plain, value in zip(is_number, values, strict=True)):
            whole = all(isinstance(value, int | np.integer) for value in values)
            numbers = [math.nan if value is None else float(value) for value in values]
            array = np.array(values, dtype=int) if whole else np.array(numbers)
            columns.append(Column(name, "%" if units == "1" and "utilisation" in name else units, array))
        else:
            texts = ["" if value is None else str(value) for value in values]
            columns.append(Column(heading, None, np.array(texts, dtype=object)))
    return _table(columns) if columns else None


# --- input ------------------------------------------------------------------------------------------------------------------


def input_of(scene: xr.Dataset) -> Table:
    """Return the keys of a scene with their values and SI units as they were given."""
    rows = []
    for name in scene.data_vars:
        variable = scene.variables[name]
        shown = (_of_members if "member" in variable.dims else as_given)(variable.values.tolist())
        units = unit_text(str(variable.attrs.get("units", "1")))
        rows.append([dotted(str(name)), shown, units, long_name(str(name), variable)])
    return _table_of_keys(rows)


def stages_of(dataset: xr.Dataset) -> list[dict[str, Any]]:
    """Return the stages of a history; none of one that was changed by hand, which tells nothing."""
    try:
        return list(provenance.stages_of(dataset))
    except ValueError:
        return []


def stage_of_scene(dataset: xr.Dataset) -> dict[str, Any] | None:
    """Return the stage of a history that made the scene; None without one."""
    return next((stage for stage in stages_of(dataset) if isinstance(stage["parameters"].get("scene"), dict)), None)


def input_from_history(dataset: xr.Dataset) -> Table | None:
    """Return the keys of the scene that a history tells, with the ranges of those that members vary; None without one."""
    stage = stage_of_scene(dataset)
    if stage is None:
        return None
    shown = {path: as_given(value) for path, value in _paths(stage["parameters"]["scene"])}
    for name, varied in dataset.coords.items():
        if varied.dims == ("member",) and dotted(str(name)) != name:
            shown[dotted(str(name))] = _of_members(varied.values)
    rows = []
    for path, text in shown.items():
        key = key_of_variable(variable_name(path))
        units = "" if key is None or key.units is None else unit_text(key.units)
        rows.append([path, text, units, "" if key is None else key.long_name])
    return _table_of_keys(rows)


def _table_of_keys(rows: list[list[str]]) -> Table:
    """Return the table of keys, with the drag coefficients that a scene with wind leaves out."""
    paths = {path for path, *_ in rows}
    cables = [found[1] for path in sorted(paths) if (found := OF_DIAMETER.fullmatch(path))]
    for cable in cables if any(path.startswith("wind.") for path in paths) else ():
        if (path := f"{cable}.drag_coefficient") not in paths:
            rows = [*rows, [path, f"{DRAG_COEFFICIENT:g}", "", CABLE["drag_coefficient"].long_name]]
    return Table(["key", "value", "unit", "meaning"], rows, fixed=4)


def _paths(table: Mapping[str, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the paths and values of nested tables, and of lists of tables."""
    for name, value in table.items():
        path = f"{above}.{name}" if above else str(name)
        if isinstance(value, Mapping):
            yield from _paths(value, path)
        elif isinstance(value, list) and value and all(isinstance(item, Mapping) for item in value):
            for place, item in enumerate(value, 1):
                yield from _paths(item, f"{path}.{place}")
        elif path != "title":
            yield path, value


def as_given(value: Any) -> str:
    """Return a value as it was given; of a long list its number of values, least and largest."""
    if isinstance(value, list):
        flat = np.array(value)
        if flat.size > MAX_LIST and flat.dtype.kind in "iuf":
            return _range(flat)
        return "(" + ", ".join(as_given(item) for item in value) + ")"
    if isinstance(value, float):
        return f"{value:.10g}"
    return str(value) if str(value) else NOTHING


def _of_members(values: Any) -> str:
    """Return the range of the numbers of members, or their different words."""
    different = np.unique(values)
    return _range(different) if different.dtype.kind in "iuf" else as_given(different.tolist())


def _range(values: np.ndarray) -> str:
    """Return number, least and largest of values."""
    finite = values[np.isfinite(values)]
    if not finite.size:
        return NOTHING
    return f"{finite.min():.10g} to {finite.max():.10g}, {values.size} values"
