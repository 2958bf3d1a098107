"""Equal inputs give equal ids, different inputs different ones, and a lineage reaches back to the scene."""

from __future__ import annotations

import copy
import html
import json
import pickle
import re

import numpy as np
import pytest
import xarray as xr
from histories import functions_of
from xarray.core import formatting as xr_formatting

import cablepod as cp
from cablepod import provenance


def test_ids_follow_what_was_asked_for(soft):
    scene = cp.make_scene(soft)

    def run(scene=scene, **options):
        return cp.chain.simulate(scene, **{"times": [0.1]} | options)

    changed = run(scene.assign(gravity=scene.gravity + 0.01), step=1e-3)
    runs = [
        run(),
        *(
            run(**{key: value})
            for key, value in (("tolerance", 1e-4), ("tolerance", 1e-5), ("step", 1e-3), ("step", 5e-4))
        ),
        *(run(step=1e-3, links=links) for links in (8, 9)),
        run(step=1e-3, times=[1.0]),
        run(cp.make_scene({**soft, "gravity": 9.8}), step=1e-3),
        changed,
    ]
    assert len({one.attrs["id"] for one in runs}) == len(runs)
    assert run(cp.make_scene(soft), step=1e-3).attrs["id"] == run(step=1e-3).attrs["id"]
    assert functions_of(changed) == ["make_scene", "changed outside the package", "chain.simulate"]


def test_the_lineage_of_a_reduced_model_reaches_its_scene(soft):
    scene = cp.make_scene(soft)
    run = cp.chain.simulate(scene, step=1e-3)
    modes = cp.pod.decompose(run, rank=2)
    reduced = cp.galerkin.simulate(scene, modes, step=1e-3)
    error = cp.compare.errors(reduced, run)
    stages = {stage["id"]: stage for stage in provenance.stages_of(error)}
    assert [stage["function"] for stage in stages.values()] == [
        "make_scene", "chain.simulate", "pod.decompose", "galerkin.simulate", "compare.errors",
    ]  # fmt: skip
    assert all(parent in stages for stage in stages.values() for parent in stage["inputs"])
    assert stages[reduced.attrs["id"]]["parameters"]["rank"] == 2


def test_long_arrays_are_kept_as_digests():
    squares = np.arange(5000.0) ** 2
    short, long = provenance.to_json(np.arange(3.0)), provenance.to_json(squares)
    assert short == [0.0, 1.0, 2.0]
    assert long["shape"] == [5000]
    assert provenance.to_json(squares.tolist()) == long


def test_results_lead_with_what_they_are(soft):
    scene = cp.make_scene(soft)
    run = cp.chain.simulate(scene, tolerance=1e-4)
    assert list(run.attrs)[:2] == ["title", "stage"]
    assert list(run.attrs)[-2:] == ["id", "history_json"]
    assert list(run.attrs).index("scheme") < list(run.attrs).index("step") < 6
    text = repr(run).split("Attributes:")[1]
    assert text.index("title") < text.index("step:") < text.index("time_error_estimate")


def test_reprs_show_an_abstract_of_a_history(soft, tmp_path):
    ranges = {"ensemble": {"members": 4, "ranges": {"gravity": [9.7, 9.8], "cable.density": [900.0, 1000.0]}}}
    scene = cp.make_scene({**soft, **ranges})
    rest = cp.catenary.rest(scene)
    cp.archive.write(rest, tmp_path / "rest.nc")
    for dataset in (rest, cp.archive.read(tmp_path / "rest.nc"), scene, scene.copy(deep=True)):
        functions = functions_of(dataset)
        said = f"{len(functions)} stage{'s' * (len(functions) > 1)} up to {functions[-1]}, see archive.describe"
        pages = (
            html.unescape(dataset._repr_html_()),
            "\n".join(xr_formatting.summarize_attr(*a) for a in dataset.attrs.items()),
        )
        for page in pages:
            assert said in page
            assert '"function"' not in page
            assert "make_scene(" not in page
        assert ("table of members, ranges" in pages[0]) == ("ensemble_json" in dataset.attrs)


def test_an_abridged_attribute_is_the_whole_text_for_all_others(soft, tmp_path):
    rest = cp.catenary.rest(cp.make_scene(soft))
    found = rest.attrs["history_json"]
    plain = "".join(found)
    assert (type(found), type(plain)) == (provenance.Abridged, str)
    assert len(plain) > 3 * len(found.abstract)
    copies = [
        pickle.loads(pickle.dumps(found)),
        copy.deepcopy(found),
        np.array(found).item(),
        json.loads(json.dumps(found)),
    ]
    assert [str(found), f"{found}", "%s" % found, format(found), *copies] == [plain] * 8  # noqa: UP031
    assert (repr(found), hash(found)) == (repr(plain), hash(plain))
    assert json.loads(found) == json.loads(plain)
    dask = pytest.importorskip("dask.base")
    assert dask.tokenize(found) == dask.tokenize(plain)
    for form in ("NETCDF4", "NETCDF3_CLASSIC"):
        rest.to_netcdf(tmp_path / "it.nc", format=form)
        with xr.open_dataset(tmp_path / "it.nc") as opened:
            assert opened.attrs["history_json"] == plain


def test_a_text_of_another_origin_is_shown_by_its_lines():
    assert provenance.Abridged("short").abstract == "short"
    for text in ("a line\n" * 40, json.dumps(["x"] * 100), json.dumps([{"id": "x"}] * 100)):
        assert re.fullmatch(r"<\d+ lines, see archive.describe>", provenance.Abridged(text).abstract)
