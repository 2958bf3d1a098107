"""Every public function with every kind of wrong argument: one clear error, never a raw one, and nothing accepted in silence."""

from __future__ import annotations

import datetime
import inspect
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
import pytest
import xarray as xr
from public_calls import CALLS, datasets, function_of, public_functions

mpl.use("Agg")

import cablepod as cp

#: Errors that speak to the user.
CLEAR = (cp.SceneError, cp.ArchiveError)


#: Functions whose first argument is no Dataset.
OTHERS = {
    "archive.open_ensemble", "archive.read", "catenary.solve", "clear_caches", "extremes.peaks", "fatigue.damage",
    "fatigue.equivalent", "fatigue.ranges", "make_scene", "modes", "plots.spectra", "plots.tension_cycles",
    "read_scene", "snapshots",
}  # fmt: skip
#: What stands in the place of a Dataset.
WRONG: dict[str, Any] = {
    "None": None,
    "path": Path("missing.nc"),
    "text": "scene.toml",
    "number": 3,
    "array": np.zeros((3, 2)),
    "list": [1.0, 2.0],
    "empty list": [],
    "mapping": {"a": 1},
    "date": datetime.date(2020, 1, 1),
    "empty Dataset": xr.Dataset(),
    "DataArray": xr.DataArray([1.0, 2.0]),
    "other Dataset": xr.Dataset({"position": ("x", [1.0, 2.0])}, attrs={"stage": "trajectory"}),
    "class": xr.Dataset,
}
#: Options of any function, each with wrong values.
OPTIONS: dict[str, tuple[Any, ...]] = {
    "rank": (0, -1, 1.5, "two", [1], type, np.zeros(2)),
    "times": ("now", -1.0, [np.nan], [[0.0]], [], object(), 10**400),
    "step": (0.0, -1.0, np.nan, "small", [1e-3], np.array([1.0, 2.0]), 10**400),
    "tolerance": (0.0, -1.0, np.nan, "small", [1e-3], np.inf),
    "outputs": ("positions", 3, ["position", None], [["position"]], ("bogus",), {"a": 1}, np.zeros(2)),
    "law": (3, None, "bogus", ["linear"], np.array(["linear", "green"])),
    "scheme": (3, "bogus", ["trapezoidal"], np.array(["a", "b"])),
    "order": ("bogus", 2.5, ["leading"], np.array(["a", "b"])),
    "links": (0, -3, 1.5, "many", [[1]], np.zeros(3)),
    "count": (0, 1.5, "two", None, [2]),
    "points": ("many", -2, [np.nan], object()),
    "layout": (None, "bogus", ["normal"], 3),
    "quadrature": (1, "many", 2.5, [3]),
    "members": (0, "two", 1.5, [2]),
    "batch": (0, "two", 1.5, None),
    "model": ("bogus", None, 3, ["chain"]),
    "path": (None, 3, b"a", ["a"]),
    "ranks": (0, "two", [1.5], None, [[1]]),
    "sampling": ("bogus", 3, ["grid"], np.array(["grid", "list"])),
    "temperatures": ([[1.0], [1.0, 2.0]], "hot", [], [True], xr.Dataset(), xr.DataArray([290.0], attrs={"units": "K"})),
    "at": ([[0.1], [0.1, 0.2]], "middle", 1.5, [], xr.Dataset()),
    "variable": (None, 3, "bogus", ["error"], np.array(["error"]), xr.Dataset()),
    "progress": (0, "bar", [print], True),
    **dict.fromkeys(
        (
            "overwrite",
            "verify",
            "incomplete",
            "center",
            "static_modes",
            "deflection",
            "hertz",
            "contours",
            "out_of_plane",
        ),
        ("no", None, 0, 1.0, [True], np.array([True, False])),
    ),
}
#: Whole numbers, of calls that are given them.
WHOLE = {
    "cable.frequencies": {"count": 2}, "chain.simulate": {"links": 4}, "condensed.simulate": {"rank": 2},
    "condensed.vibration_modes": {"rank": 2}, "ensemble.design": {"members": 2, "seed": 1}, "galerkin.simulate": {"rank": 2},
    "mast.frequencies": {"count": 4, "rank": 2}, "periodic.orbit": {"rank": 1, "periods": 1, "harmonics": 20},
    "pod.decompose": {"rank": 2},
}  # fmt: skip


def wrong_datasets() -> list[tuple[str, int, str]]:
    """Function, place of the argument, and what is wrong."""
    stages = ("scene", "rest", "chain", "modes", "normal modes", "comparison", "frequencies")
    kinds = [*WRONG, *(f"stage {stage}" for stage in stages)]
    return [(name, place, kind) for name, (own, _) in CALLS.items() for place in range(len(own)) for kind in kinds]


def taken(name: str, place: int, kind: str) -> bool:
    """Whether a Dataset of that stage, or that kind, is a valid argument."""
    stage, own = kind.removeprefix("stage "), CALLS[name][0][place]
    trajectories = {"chain", "condensed"}
    if name in ("archive.describe", "archive.write", "plots.report") and (
        kind.startswith("stage") or kind.endswith("Dataset")
    ):
        return True  # any Dataset; what cannot be kept has a message of its own
    if name in ("plots.modes", "plots.singular_values") and stage in ("modes", "normal modes", "frequencies"):
        return True
    if (kind == "None" and place == 1 and name.startswith("plots.")) or (stage == own or {stage, own} <= trajectories):
        return True
    return (name, stage) in {("plots.rest", "rest"), ("pod.project", "normal modes"), ("pod.at_times", "comparison")}


def call(name: str, arguments: list[Any], options: dict[str, Any]) -> str | None:
    """Call; return what went wrong, None after a clear error."""
    try:
        result = function_of(name)(*arguments, **options)
        if inspect.isgenerator(result):
            next(result)
    except CLEAR as error:
        return None if len(str(error)) > 10 and "\n" not in str(error) else f"unclear: {error}"
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return "accepted"


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    yield
    mpl.pyplot.close("all") if hasattr(mpl, "pyplot") else None


def test_every_public_function_is_here():
    assert set(public_functions()) == set(CALLS) | OTHERS


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", CALLS)
def test_wrong_datasets_have_one_clear_error(name):
    raw = []
    for function, place, kind in wrong_datasets():
        if function == name and not taken(name, place, kind):
            arguments = [datasets()[stage] for stage in CALLS[name][0]]
            arguments[place] = WRONG[kind] if kind in WRONG else datasets()[kind.removeprefix("stage ")]
            if (fault := call(name, arguments, CALLS[name][1])) is not None:
                raw.append(f"{name}, argument {place + 1} {kind}: {fault}")
    assert not raw, "\n".join(raw)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", WHOLE)
def test_whole_numbers_of_numpy_are_those_of_python(name):
    stages, options = CALLS[name]
    expected, *others = [
        function_of(name)(
            *(datasets()[stage] for stage in stages), **options | {k: of(v) for k, v in WHOLE[name].items()}
        )
        for of in (int, np.int8, np.uint64, np.array)
    ]
    for result in others:
        xr.testing.assert_equal(result, expected)
        assert result.attrs["id"] == expected.attrs["id"]


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", CALLS)
def test_wrong_options_have_one_clear_error(name):
    raw = []
    for option in inspect.signature(function_of(name)).parameters:
        for value in OPTIONS.get(option, ()):
            arguments = [datasets()[stage] for stage in CALLS[name][0]]
            if (fault := call(name, arguments, CALLS[name][1] | {option: value})) is not None:
                raw.append(f"{name}({option}={value!r:.60}): {fault:.300}")
    assert not raw, "\n".join(raw)
