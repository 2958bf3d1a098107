"""Equal inputs give equal ids, different inputs different ones, and a lineage reaches back to the scene."""

from __future__ import annotations

import numpy as np

import cablepod as cp
from cablepod import provenance


def test_ids_follow_what_was_asked_for(soft):
    scene = cp.make_scene(soft)
    run = cp.chain.simulate(scene, step=1e-3)
    again = cp.chain.simulate(cp.make_scene(soft), step=1e-3)
    assert run.attrs["id"] == again.attrs["id"]
    others = [
        cp.chain.simulate(scene, step=5e-4),
        cp.chain.simulate(scene, step=1e-3, links=9),
        cp.chain.simulate(scene, step=1e-3, times=[1.0]),
        cp.chain.simulate(cp.make_scene({**soft, "gravity": 9.8}), step=1e-3),
        cp.chain.simulate(scene.assign(gravity=scene.gravity + 0.01), step=1e-3),
    ]
    ids = {run.attrs["id"], *(other.attrs["id"] for other in others)}
    assert len(ids) == 6


def test_a_scene_changed_by_hand_says_so(soft):
    scene = cp.make_scene(soft)
    run = cp.chain.simulate(scene.assign(gravity=scene.gravity + 0.01), step=1e-3)
    functions = [stage["function"] for stage in provenance.stages_of(run)]
    assert functions == ["make_scene", "changed by hand", "chain.simulate"]


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
