"""Checks of options, the number of modes, and labelled Datasets of modes and amplitudes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod._inputs import NO_MOTION, floats
from cablepod.conventions import ENDS, label, shared_coordinates
from cablepod.discretisation._laws import law_of
from cablepod.errors import SceneError, did_you_mean, scene_error
from cablepod.parameters._checks import integer, number
from cablepod.pod import _normal as pod_normal
from cablepod.pod import _svd_methods as svd_methods
from cablepod.pod._snapshots import MASS, arc_length_of, masses_of, weight_roots
from cablepod.pod._training_range import add_training_range

LAYOUTS = ("separate", "vector", "normal")
METHODS = tuple(svd_methods.ROUTES)
WEIGHTS = (None, "length", "mass")


def check_options(layout: str, method: str, weights: str | None, rank: int | None, energy: float | None) -> None:
    """Refuse invalid options of a decomposition."""
    for key, value, allowed in (
        ("layout", layout, LAYOUTS),
        ("method", method, METHODS),
        ("weights", weights, WEIGHTS),
    ):
        if not isinstance(value, str | None) or value not in allowed:  # an array has no truth value
            raise scene_error(
                key, value, "one of " + ", ".join(map(repr, allowed)) + did_you_mean(value, filter(None, allowed))
            )
    if rank is not None and energy is not None:
        raise scene_error("rank and energy", (rank, energy), "one of them")


def fractions(parts: np.ndarray, outside: np.ndarray | float = 0.0) -> np.ndarray:
    """Return parts (matrix, mode) divided by their sum plus `outside`, zero for a zero sum."""
    total = parts.sum(axis=1, keepdims=True) + outside
    return np.divide(parts, total, out=np.zeros_like(parts), where=total > 0)


def choose_rank(squares: np.ndarray, outside: np.ndarray, rank: int | None, energy: float | None, most: int) -> int:
    """Return the number of modes to keep, at most `most`, from squared singular values (matrix, mode)."""
    most = min(squares.shape[1], most)
    if most < 1:
        raise SceneError("snapshots: given one instant; allowed: at least two, because the time mean is taken off")
    if rank is not None:
        integer(least=1)("rank", rank)
        if rank > most:
            raise scene_error("rank", rank, f"at most {most}, as many as particles and snapshots give")
        return int(rank)
    if energy is None:
        return most
    number(above=0.0, most=1.0)("energy", energy)
    needed = 1
    for row, rest in zip(squares, outside[:, 0], strict=True):
        cumulative = np.cumsum(row) / (row.sum() + rest)
        needed = max(needed, int(np.searchsorted(cumulative, energy * (1.0 - 1e-15))) + 1)
    return min(needed, most)


def labelled(
    vectors: list[np.ndarray],
    values: np.ndarray,
    errors: np.ndarray,
    discarded: np.ndarray,
    means: list[np.ndarray],
    samples: int,
    *,
    choice: tuple[int | None, float | None],
    options: dict[str, Any],
    algorithm: str,
    like: xr.Dataset,
    inputs: Sequence[xr.Dataset | provenance.Input],
    function: str = "pod.decompose",
    trained: np.ndarray | None = None,
    reference: np.ndarray | None = None,
) -> xr.Dataset:
    """Return the labelled Dataset of modes, with all derived quantities.

    Parameters
    ----------
    vectors
        Left singular vectors (feature, mode) of each data matrix, whose features are those of :func:`read_rows`.
    values, errors
        Singular values and estimates of their errors (matrix, mode) [m].
    discarded
        Norm of the part of each matrix outside the basis (matrix) [m].
    means
        Time mean of the rows of each matrix (feature,) [m].
    samples
        Number of snapshots.
    choice
        Options ``rank`` and ``energy``.
    options
        All other options of the decomposition.
    algorithm
        Attribute of the result.
    like
        Dataset with the coordinates and the title.
    inputs, function
        For the history.
    trained
        Range of the training scenes (2, features), if known.
    reference
        Axis that the normals of layout "normal" refer to.
    """
    # a power of two as unit: squares neither underflow nor overflow
    unit = np.exp2(np.frexp(np.maximum(values.max(axis=1), discarded))[1].astype(float))[:, None]
    squares, outside = (values / unit) ** 2, (discarded[:, None] / unit) ** 2
    # the energy of a set along which nothing moves is rounding
    moving = values[:, 0] > NO_MOTION * values.max()
    kept = choose_rank(squares[moving], outside[moving], *choice, samples - bool(options["center"]))
    layout, root = options["layout"], weight_roots(like, options["weights"])

    def at_particles(rows: np.ndarray) -> np.ndarray:
        """Return rows of features as fields (rows, particle, dims), without the weights."""
        fields = rows.reshape(len(rows), -1, root.size).transpose(0, 2, 1) / root[:, None]
        return np.pad(fields, ((0, 0), (1, 1), (0, 0)))

    shapes = [fix_sign(at_particles(columns.T[:kept])) for columns in vectors]

    total = squares.sum(axis=1, keepdims=True) + outside
    truncated = squares[:, kept:].sum(axis=1, keepdims=True) + outside
    truncation = np.sqrt(np.divide(truncated, total, out=np.zeros_like(total), where=total > 0))[:, 0]
    arc_length, mass = arc_length_of(like), masses_of(like) if options["weights"] == "mass" else None
    with np.errstate(over="ignore", under="ignore"):
        proper = values**2 / samples
    tables = {
        "singular_value": values,
        "singular_value_uncertainty": errors,
        "mode_uncertainty": svd_methods.mode_angles(values, errors),
        "proper_orthogonal_value": proper,
        "energy_share": fractions(squares, outside),
        "singular_value_share": fractions(values / unit),
    }
    variables = _variables(layout, shapes, {name: table[:, :kept] for name, table in tables.items()}, truncation)
    if layout != "normal":
        variables["mean"] = (("particle", "coordinate"), at_particles(np.concatenate(means)[None])[0])
    variables |= {"unstretched_length": ((), arc_length[-1]), **pod_normal.reference_variable(reference)}
    # views of the tables of all modes would keep these in memory, and take longer to check
    result = xr.Dataset(
        {name: (dims, floats(array)) for name, (dims, array) in variables.items()},
        coords=shared_coordinates(
            {
                "mode": np.arange(1, kept + 1),
                "coordinate": like["coordinate"].values,
                "arc_length": ("particle", arc_length),
                **({MASS: ("particle", mass)} if mass is not None else {}),
            }
        ),
    )
    label(add_training_range(result, trained))
    result.attrs.update(
        title=f"{like.attrs.get('title', 'snapshots')}: Karhunen-Loeve modes",
        stage="modes",
        layout=layout,
        method=options["method"],
        algorithm=algorithm,
        weights=str(options["weights"]),
        number_of_snapshots=samples,
        **({} if law_of(like.attrs) is None else {"law": law_of(like.attrs)}),
    )
    rank, energy = choice
    parameters: dict[str, Any] = {"rank": kept, **options, "snapshots": samples}
    parameters |= {} if energy is None else {"energy": energy}
    chosen = provenance.defaulted_options(rank=rank)
    return provenance.record(result, function=function, parameters=parameters, inputs=inputs, chosen=chosen)


def _variables(
    layout: str, shapes: list[np.ndarray], tables: dict[str, np.ndarray], truncation: np.ndarray
) -> dict[str, Any]:
    """Return the variables of a layout, name -> (dimensions, values).

    `shapes` are the modes (mode, particle, dims) of each matrix, `tables` have (matrix, mode), `truncation` has (matrix).
    """
    shape = shapes[0][None] if layout == "vector" else np.stack([modes[:, :, 0] for modes in shapes])
    shape_dims = ("mode", "particle", "coordinate") if layout == "vector" else ("mode", "particle")
    variables: dict[str, Any] = {}
    # "separate" has a dimension coordinate, "normal" one variable for each normal
    lead = ("coordinate",) if layout == "separate" else ()
    for index, suffix in enumerate(pod_normal.SETS[: len(shapes)] if layout == "normal" else ("",)):
        pick = slice(None) if lead else index
        variables[f"mode_shape{suffix}"] = ((*lead, *shape_dims), shape[pick])
        variables |= {f"{name}{suffix}": ((*lead, "mode"), table[pick]) for name, table in tables.items()}
        variables[f"truncation_error{suffix}"] = (lead, truncation[pick])
    return variables


def amplitude_dataset(
    variables: dict[str, tuple[tuple[str, ...], np.ndarray]], ends: np.ndarray, time: np.ndarray, modes: xr.Dataset
) -> xr.Dataset:
    """Label amplitudes, name -> (dimensions, values [m]), and positions of the ends (time, 2, coordinate) [m]."""
    rank = variables["amplitude"][1].shape[-1]
    result = xr.Dataset(
        {**variables, "end_position": (("time", "end", "coordinate"), floats(ends))},
        coords=shared_coordinates(
            {
                "time": time,
                "mode": modes["mode"].values[:rank],
                "coordinate": modes["coordinate"].values,
                "end": list(ENDS),
            }
        ),
    )
    return label(result)


def fix_sign(field: np.ndarray) -> np.ndarray:
    """Choose the signs of modes (mode, particle, dims).

    The first entry of at least half the maximum is positive.
    """
    flat = field.reshape(len(field), -1)
    magnitude = np.abs(flat)
    first = np.argmax(magnitude >= 0.5 * magnitude.max(axis=1, keepdims=True), axis=1)
    sign = np.where(flat[np.arange(len(flat)), first] < 0.0, -1.0, 1.0)
    return field * sign[:, None, None]
