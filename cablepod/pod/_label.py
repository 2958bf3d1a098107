"""Modes as a labelled Dataset."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from cablepod import provenance
from cablepod.conventions import label
from cablepod.errors import SceneError, scene_error
from cablepod.parameters._checks import integer, number
from cablepod.pod import _decompositions as decompositions
from cablepod.pod import _normal as pod_normal
from cablepod.pod._snapshots import arc_length_of
from cablepod.pod._training_range import add_training_range

LAYOUTS = ("separate", "vector", "normal")
METHODS = tuple(decompositions.ROUTES)
WEIGHTS = (None, "length", "mass")
#: Snapshots in chunks from which on two threads count them; the number is the same on every machine, and so are the bits.
SHARED = 20_000


def check_options(layout: str, method: str, weights: str | None, rank: int | None, energy: float | None) -> None:
    """Refuse options of a decomposition that cannot be."""
    for key, value, allowed in (
        ("layout", layout, LAYOUTS),
        ("method", method, METHODS),
        ("weights", weights, WEIGHTS),
    ):
        if value not in allowed:
            raise scene_error(key, value, "one of " + ", ".join(repr(item) for item in allowed))
    if rank is not None and energy is not None:
        raise scene_error("rank and energy", (rank, energy), "one of them")


def labelled(
    fields: list[np.ndarray],
    values: np.ndarray,
    unsure: np.ndarray,
    lost: np.ndarray,
    mean: np.ndarray,
    samples: int,
    *,
    choice: tuple[int | None, float | None],
    options: dict[str, Any],
    algorithm: str,
    like: xr.Dataset,
    inputs: list[xr.Dataset],
    function: str = "pod.decompose",
    trained: np.ndarray | None = None,
) -> xr.Dataset:
    """Label modes (mode, inner particle, dims) of each matrix, their singular values (matrix, mode) and what was `lost` [m]."""
    # squares of any size of snapshots stay within the range
    unit = np.exp2(np.frexp(np.maximum(values.max(axis=1), lost))[1].astype(float))[:, None]
    squares, outside = (values / unit) ** 2, (lost[:, None] / unit) ** 2
    kept = _count(squares, outside, choice[0], choice[1], samples - bool(options["center"]))
    layout = options["layout"]
    shapes = [np.pad(_fix_sign(field[:kept]), ((0, 0), (1, 1), (0, 0))) for field in fields]

    def share(part: np.ndarray, rest: np.ndarray | float = 0.0) -> np.ndarray:
        total = part.sum(axis=1, keepdims=True) + rest
        return np.divide(part, total, out=np.zeros_like(part), where=total > 0)

    total = squares.sum(axis=1, keepdims=True) + outside
    left_out = squares[:, kept:].sum(axis=1, keepdims=True) + outside
    truncation = np.sqrt(np.divide(left_out, total, out=np.zeros_like(total), where=total > 0))[:, 0]
    angle = decompositions.mode_angles(values, unsure)
    arc_length = arc_length_of(like)
    with np.errstate(over="ignore", under="ignore"):
        proper = values**2 / samples
    tables = {
        "singular_value": values,
        "singular_value_uncertainty": unsure,
        "mode_uncertainty": angle,
        "proper_orthogonal_value": proper,
        "energy_share": share(squares, outside),
        "singular_value_share": share(values / unit),
    }
    shape = shapes[0][None] if layout == "vector" else np.stack([item[:, :, 0] for item in shapes])
    shape_dims = ("mode", "particle", "coordinate") if layout == "vector" else ("mode", "particle")
    variables: dict[str, Any] = {}
    # separate modes stand along a dimension, modes in and out of the plane under names of their own
    lead = ("coordinate",) if layout == "separate" else ()
    for place, suffix in enumerate(pod_normal.SETS[: len(values)] if layout == "normal" else ("",)):
        pick = slice(None) if lead else place
        variables[f"mode_shape{suffix}"] = ((*lead, *shape_dims), shape[pick])
        variables |= {f"{name}{suffix}": ((*lead, "mode"), table[:, :kept][pick]) for name, table in tables.items()}
        variables[f"truncation_error{suffix}"] = (lead, truncation[pick])
    if layout != "normal":
        variables["mean"] = (("particle", "coordinate"), mean)
    variables["unstretched_length"] = ((), arc_length[-1])
    result = xr.Dataset(
        variables,
        coords={
            "mode": np.arange(1, kept + 1),
            "coordinate": like["coordinate"].values,
            "arc_length": ("particle", arc_length),
        },
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
    )
    parameters: dict[str, Any] = {"rank": kept, **options, "snapshots": samples}
    return provenance.record(result, function=function, parameters=parameters, inputs=inputs)


def _count(squares: np.ndarray, outside: np.ndarray, rank: int | None, energy: float | None, most: int) -> int:
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
    for own, rest in zip(squares, outside[:, 0], strict=True):
        if own.sum() > 0.0:
            gathered = np.cumsum(own) / (own.sum() + rest)
            needed = max(needed, int(np.searchsorted(gathered, energy * (1.0 - 1e-15))) + 1)
    return min(needed, most)


def _fix_sign(field: np.ndarray) -> np.ndarray:
    """Turn each mode (modes, particles, dims) so that its first entry of at least half the largest size is positive."""
    flat = field.reshape(len(field), -1)
    size = np.abs(flat)
    first = np.argmax(size >= 0.5 * size.max(axis=1, keepdims=True), axis=1)
    sign = np.where(flat[np.arange(len(flat)), first] < 0.0, -1.0, 1.0)
    return field * sign[:, None, None]
