"""Record of a stage in the history of its result: function, options, inputs, content.

Version and commit are added where a result is written, by ``archive/_program.py``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING, Any

from cablepod.provenance._abridged import Abridged
from cablepod.provenance._content import content_of
from cablepod.provenance._inputs import Input, identified, input_of
from cablepod.provenance._stages import SORTED, merged_stages
from cablepod.provenance._values import to_json

if TYPE_CHECKING:
    import xarray as xr

#: First attributes of a result, in this order (xarray prints the first six).
ATTRS_FIRST = (
    "title", "stage", "incomplete", "scheme", "formulation", "step", "error_estimate", "time_error_estimate",
    "space_error_estimate", "model", "number_of_steps",
)  # fmt: skip
_UNRECORDED: ContextVar[bool] = ContextVar("unrecorded", default=False)


@contextmanager
def unrecorded() -> Iterator[None]:
    """Make :func:`record` write no history, for parts of a result that is recorded as a whole."""
    token = _UNRECORDED.set(True)
    try:
        yield
    finally:
        _UNRECORDED.reset(token)


def public_name(function: Callable[..., Any]) -> str:
    """Return the public name of a function, such as ``"chain.simulate"``, without private modules."""
    package = [part for part in function.__module__.split(".")[1:] if not part.startswith("_")]
    return ".".join([*package, function.__name__])


def defaulted_options(**options: Any) -> list[str]:
    """Return the names of options that are None, which the function chooses itself."""
    return [name for name, value in options.items() if value is None]


def record(
    result: xr.Dataset,
    *,
    function: str,
    parameters: Mapping[str, Any],
    inputs: Sequence[xr.Dataset | Input] = (),
    chosen: Sequence[str] = (),
    scene_digest: str | None = None,
    identity: Mapping[str, Any] | None = None,
) -> xr.Dataset:
    """Append a stage to the history of `result` and set its ``id``, in place; return `result`.

    It is the last thing that a stage does: variables and attributes that are set later are changes from outside.

    Parameters
    ----------
    result
        Result of the stage; its ``history_json`` and ``id`` are replaced.
    function
        Public name of the stage, such as ``"chain.simulate"``.
    parameters
        All options of the call with defaults filled in, nothing that depends on clock or machine.
    inputs
        Input datasets, or what :func:`input_of` gave of them; their histories are merged in order, each stage once.
    chosen
        Names of parameters that the function chose itself, see :func:`defaulted_options`, and that may follow from computed
        numbers.  A lineage script omits them; they are not part of the ``id``.
    scene_digest
        Result of :func:`digest` for the first input, where the caller knows it.
    identity
        What the ``id`` follows from in place of `parameters`, where these name files, whose content and not whose place counts.

    Returns
    -------
    xarray.Dataset
        `result`.
    """
    attrs = {name: value for name, value in result.attrs.items() if name not in ("id", "history_json")}
    result.attrs = in_order(attrs)
    if _UNRECORDED.get():
        return result
    resolved = {key: to_json(value) for key, value in parameters.items()}
    taken = [
        given if isinstance(given, Input) else input_of(given, scene_digest=None if i else scene_digest)
        for i, given in enumerate(inputs)
    ]
    asked = resolved if identity is None else {key: to_json(value) for key, value in identity.items()}
    asked = {key: value for key, value in asked.items() if key not in chosen}
    identifier = identified(function, asked, [given.key for given in taken])
    stages = merged_stages(given.history for given in taken)
    stage: dict[str, Any] = {
        "id": identifier, "function": function, "parameters": resolved, "inputs": [given.id for given in taken],
        "input_hashes": [given.hash for given in taken], "content": content_of(result),
    }  # fmt: skip
    stages[identifier] = SORTED.encode(stage | ({"chosen": sorted(chosen)} if chosen else {}))
    result.attrs |= {"id": identifier, "history_json": Abridged(f"[{', '.join(stages.values())}]")}
    return result


def in_order(attrs: Mapping[str, Any]) -> dict[str, Any]:
    """Return attributes sorted, those of :data:`ATTRS_FIRST` first."""
    first = [name for name in ATTRS_FIRST if name in attrs]
    return {name: attrs[name] for name in (*first, *(name for name in attrs if name not in first))}
