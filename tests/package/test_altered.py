"""Altered Datasets in every public function: what is legal gives the same bits, and all else one clear message."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
import pytest
import xarray as xr
from altered import ALTERATIONS, SLOW, VARIANTS, Attempt, altered, attempts, contents, each, fault, run
from odd_options import SIMULATE, calls
from odd_options import fault as fault_of_options
from public_calls import CALLS, datasets, function_of

mpl.use("Agg")

import cablepod as cp
from cablepod.plots import _style

#: Altered calls of a quick test and of all, odd options of each function in both.
QUICK, ALL, QUICK_OPTIONS, ALL_OPTIONS = 70, 3500, 60, 800
# whichever test comes first makes the Datasets
pytestmark = pytest.mark.filterwarnings("ignore::cablepod.OutOfRangeWarning")


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def faults(count: int, seed: int) -> list[str]:
    """Altered calls that do not end as they should, one a line."""
    found = ((attempt, fault(attempt)) for attempt in attempts(count, seed))
    return [f"{attempt}: {text:.300}" for attempt, text in found if text is not None]


@pytest.mark.filterwarnings("ignore")
def test_a_sample_of_altered_calls():
    found = faults(QUICK, seed=21)
    assert not found, "\n".join(found)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("seed", range(7))
def test_all_altered_calls(seed):
    found = faults(ALL // 7, seed=2100 + seed)
    assert not found, "\n".join(found)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", sorted({name.partition("/")[0] for name in VARIANTS} - {*SLOW}))
def test_each_variable_dimension_and_attribute_altered(name):
    """What a call reads, but no table of its kind names, is found for certain, where a sample finds it by luck."""
    calls = [one for one in VARIANTS if one.partition("/")[0] == name]
    found = [
        f"{attempt}: {text:.300}" for one in calls for attempt in each(one) if (text := fault(attempt)) is not None
    ]
    assert not found, "\n".join(found)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", SIMULATE)
def test_a_sample_of_odd_options(name):
    found = [f"{call}: {text:.300}" for call in calls(name, QUICK_OPTIONS, seed=9) if (text := fault_of_options(call))]
    assert not found, "\n".join(found)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", SIMULATE)
def test_all_odd_options(name):
    found = [f"{call}: {text:.300}" for call in calls(name, ALL_OPTIONS, seed=10) if (text := fault_of_options(call))]
    assert not found, "\n".join(found)


def test_every_function_is_altered_and_every_alteration_applies():
    left_out = {"plots.error_against_run_time", "study.run"}
    assert {name.partition("/")[0] for name in VARIANTS} == set(CALLS) - left_out
    applies = set()
    for name, (stages, _) in VARIANTS.items():
        for place in range(len(stages)):
            for kind in set(ALTERATIONS) - applies:
                tries = [Attempt(name, spatial, place, kind, 1) for spatial in (False, True)]
                applies |= {kind} if any(altered(attempt) is not None for attempt in tries) else set()
    assert applies == set(ALTERATIONS)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(
    "attempt",
    [
        Attempt("archive.write/scene", True, 0, "attribute: array", 120101976),
        Attempt("mast.simulate", True, 0, "kinds: dates", 35298673),
        Attempt("plots.bending_moments", False, 0, "kinds: dates", 456008182),
        Attempt("plots.parameter_map", False, 0, "units: kN", 964986768),
        Attempt("plots.animate_orbit", True, 0, "dimension_picked", 10866384),
        Attempt("plots.parameter_map", True, 0, "kinds: half", 949190542),
        Attempt("mast.frequencies", True, 0, "variable_dropped", 159403329),
        Attempt("plots.frequency_response", True, 0, "kinds: half", 248768550),
        Attempt("plots.animate", False, 0, "dimension_picked", -5),
        Attempt("plots.bending_moments", False, 0, "variable_dropped", -3),
        Attempt("plots.frequency_response", True, 0, "units: km", -6),
        Attempt("plots.animate_orbit", False, 0, "values: nan", -7),
        Attempt("plots.animate_mast", True, 0, "values: nan", -1),
        Attempt("archive.write", False, 0, "attribute: array", -5),
        Attempt("compare.errors", True, 0, "dimension_added", -5),
        Attempt("plots.backbone", True, 0, "attribute_dropped", -9),
        Attempt("plots.shapes/deflection", True, 1, "arrays: Fortran order", 943869933),
        Attempt("pod.project/normal", True, 1, "variable_dropped", -9),
        Attempt("pod.reconstruct/normal", True, 0, "variable_dropped", -2),
        Attempt("pod.reconstruct/normal", True, 0, "variable_mean", -2),
        Attempt("pod.reconstruct/normal", True, 1, "dimension_cut", -4),
        Attempt("condensed.simulate", True, 1, "variable_dropped", -6),
        Attempt("galerkin.simulate", False, 1, "variable_dropped", -5),
        Attempt("galerkin.simulate", False, 1, "variable_dropped", -7),
        Attempt("plots.parameter_map", False, 0, "emptied: particle", 0),
        Attempt("ensemble.batches", False, 0, "emptied: member", 0),
        Attempt("plots.animate_mast", False, 0, "shuffled: level", 2),
        Attempt("plots.error_over_time", False, 0, "float32", 2),
        Attempt("plots.bending_moments", False, 0, "shuffled: node", 2),
        Attempt("plots.mast_shapes", False, 0, "shuffled: node", 2),
    ],
    ids=lambda attempt: attempt.name,
)
def test_what_was_found_stays_mended(attempt):
    assert fault(attempt) is None


def test_a_reordered_run_is_projected_by_its_labels():
    run, modes = datasets()["chain"], datasets()["modes"]
    expected = contents(cp.pod.project(run, modes))
    assert contents(cp.pod.project(run.isel(coordinate=[1, 0]), modes)) == expected
    assert contents(cp.pod.project(run.isel(particle=slice(None, None, -1)), modes)) == expected
    assert contents(cp.pod.project(run, modes.isel(coordinate=[1, 0], mode=[2, 0, 1]))) == expected


def test_units_may_be_written_otherwise_but_are_the_same():
    run = datasets()["chain"].copy()
    expected = contents(cp.pod.decompose(run))
    for units in ("meter", "m1", "m"):
        run["position"].attrs["units"] = units
        assert contents(cp.pod.decompose(run)) == expected


def test_lazy_snapshots_in_any_chunks_have_the_modes_of_those_in_memory():
    run = datasets()["chain"]
    expected = contents(cp.pod.decompose(run))
    for chunks in ({"time": 1}, {"time": 4, "particle": 3}, {"coordinate": 1}):
        lazy = run.chunk(chunks)
        assert contents(cp.pod.decompose(lazy)) == expected
        assert lazy["position"].chunks is not None  # the Dataset of the caller stays lazy


@pytest.mark.parametrize("spatial", [False, True], ids=["plane", "space"])
def test_units_of_every_result_are_known(spatial):
    """Otherwise units that are not the package's would be taken as they come.

    ``sag`` and ``frequency`` are names that others use for other things; a stringing table is drawn with the units
    that stand in it.
    """
    from cablepod.conventions import ATTRIBUTES, UNITS, VARIABLES

    known = {name: units for name, (units, _) in (ATTRIBUTES | VARIABLES).items()} | UNITS
    scenes = [dataset for dataset in datasets(spatial).values() if dataset.attrs.get("stage") in ("scene", "scenes")]
    of_scene = {str(name) for dataset in scenes for name in dataset.variables}
    for stage, dataset in datasets(spatial).items():
        if stage == "prepared" or dataset.attrs.get("stage") in ("scene", "scenes"):
            continue  # the first is checked as a whole, the second have keys
        units = {str(name): variable.attrs.get("units", "1") for name, variable in dataset.variables.items()}
        own_units = {"sag", "frequency", "temperature"} if "temperature" in dataset.dims else set()
        assert {
            name: own
            for name, own in units.items()
            if own not in (known.get(name), "1") and name not in of_scene | own_units
        } == {}


#: Functions whose results are not among the Datasets of all stages.
OTHERS = (
    "cable.rest", "cable.summary", "ensemble.batches", "ensemble.run", "galerkin.simulate", "mast.rest", "mast.summary",
    "pod.at_times", "pod.reconstruct", "rigid.simulate", "study.design", "summary",
)  # fmt: skip


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("part", ["planar", "spatial", *OTHERS])
def test_every_variable_has_units_and_a_long_name(part):
    """Texts have the units "1".  Dimensions have their labels."""
    if part in OTHERS:
        stages, options = CALLS[part]
        result = function_of(part)(*(datasets()[stage] for stage in stages), **options)
        found = {part: next(result) if part == "ensemble.batches" else result}
    else:
        found = datasets(part == "spatial")
    lacking = {
        f"{stage}: {name}": attribute
        for stage, dataset in found.items()
        for name, variable in dataset.variables.items()
        for attribute in ("units", "long_name")
        if not variable.attrs.get(attribute)
    }
    lacking |= {
        f"{stage}: {dim}": "labels"
        for stage, dataset in found.items()
        for dim in {"coordinate", "end", "guy", "mode", "time"}.intersection(dataset.dims)
        if dim not in dataset.coords
    }
    assert lacking == {}
    of_texts = {
        v.attrs["units"] for dataset in found.values() for v in dataset.variables.values() if v.dtype.kind in "UO"
    }
    assert of_texts <= {"1"}


def test_what_altered_calls_found_is_refused():
    periodic = datasets(True)["normal modes"]
    with pytest.raises(
        cp.SceneError, match="modes: given a Dataset without singular_value_out_of_plane; allowed: modes"
    ):
        cp.condensed.simulate(datasets(True)["scene"], periodic.drop_vars("singular_value_out_of_plane"), step=1e-2)
    orbit = xr.Dataset({f"multiplier_{part}": ("multiplier", np.array([0.5, 1.0j])) for part in ("real", "imag")})
    with pytest.raises(
        cp.SceneError, match="result: multiplier_real: given values of type complex128; allowed: finite"
    ):
        cp.plots.multipliers(orbit)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", ["mast.frequencies", "wind.field"])
def test_a_scene_that_lacks_a_variable_is_refused_or_complete(name):
    stage = VARIANTS[name][0][0]
    for variable in datasets(True)[stage].variables:
        # clear errors are returned, others raised
        outcome = run(name, [datasets(True)[stage].drop_vars(variable)])
        assert not isinstance(outcome, Exception) or len(str(outcome)) > 10, variable


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", ["displacement", "guy_position", "guy_tension", "level"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_mast_that_is_not_finite_is_refused(name, value):
    run = datasets()["mast motion"].copy(deep=True)
    if name == "level":
        run = run.assign_coords(level=("level", [*run["level"].values[:-1], value], run["level"].attrs))
    else:
        run[name].values.flat[-1] = value
    with pytest.raises(cp.SceneError, match=f"^run: .*{name}.* finite"):
        cp.plots.animate_mast(run, frames=2)


def test_a_guy_that_broke_is_drawn_until_then():
    run = datasets()["mast motion"].copy(deep=True)
    run["guy_position"][1:, 0] = np.nan
    movie = cp.plots.animate_mast(run, frames=2)
    guys = [line for line in movie.show_frame(0).lines if (line.get_linewidth(), line.get_linestyle()) == (1.5, "-")]
    assert all(np.isfinite(guy.get_xdata()).all() for guy in guys)
    movie.show_frame(1)
    assert [bool(np.isfinite(guy.get_xdata()).all()) for guy in guys] == [False] + [True] * (len(guys) - 1)


def test_a_legal_alteration_with_another_result_is_seen(monkeypatch):
    """A Dataset that was compared with the word "other" was true, so that no such result was compared."""
    attempt = Attempt("plots.bending_moments", False, 0, "shuffled: node", 2)
    monkeypatch.setattr(_style, "take", lambda key, dataset, name, dims, allowed: dataset[name].transpose(..., *dims))
    assert fault(attempt) == "silent: another result"
