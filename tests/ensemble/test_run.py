"""Running an ensemble in any way gives the same bits; failing members, progress, warnings, options."""

from __future__ import annotations

import json
import warnings

import numpy as np
import pytest
import xarray as xr
from scenes import ENSEMBLE_STEP, full_modes

import cablepod as cp
from cablepod import _resources, provenance


def test_an_ensemble_is_what_one_call_gives(finished, scenes_of):
    scenes = scenes_of()
    whole = cp.archive.open_ensemble(finished)
    direct = cp.chain.simulate(scenes, step=ENSEMBLE_STEP)
    for name in ("position", "arc_length", "unstretched_length", "energy_excess", "time", "cable_top_tension"):
        np.testing.assert_array_equal(whole[name], direct[name], err_msg=name)
        assert whole[name].attrs == direct[name].attrs, name
    assert (whole["step"] == ENSEMBLE_STEP).all()
    assert whole["step"].attrs["units"] == "s"
    assert set(direct.coords) <= set(whole.coords)
    assert whole.attrs["law"] == "linear"
    assert sorted(path.name for path in finished.iterdir() if path.name[0] != ".") == [
        *(f"batch_000{i}.nc" for i in range(3)), "manifest.json", "scenes.nc",
    ]  # fmt: skip


@pytest.mark.parametrize("workers", [1, 3])
def test_any_number_of_workers_gives_the_same_bits(finished, scenes_of, tmp_path, workers):
    again = cp.ensemble.run(scenes_of(), tmp_path / "it", batch=4, step=ENSEMBLE_STEP, workers=workers)
    whole = cp.archive.open_ensemble(finished)
    assert again.attrs["id"] == whole.attrs["id"]
    xr.testing.assert_equal(again.compute(), whole.compute())
    for number in range(3):
        one, other = (cp.archive.read(folder / f"batch_000{number}.nc") for folder in (finished, tmp_path / "it"))
        assert one.attrs["id"] == other.attrs["id"]
        hashes = [json.loads(item.attrs["history_json"])[-1]["content"]["hash"] for item in (one, other)]
        assert hashes[0] == hashes[1]


@pytest.mark.slow  # a reduced model of all modes, compiled for itself; test_models.py has quick ones
def test_reduced_models_run_too(soft, tmp_path, scenes_of):
    modes = full_modes()
    scenes = scenes_of(5, ranges={"cable.top_tension": [200.0, 300.0], "motion.upper.x.amplitude": [-0.05, 0.01]})
    options = {"rank": 2, "step": 2e-3, "outputs": ("position",)}
    run = cp.ensemble.run(scenes, tmp_path / "it", model="condensed", modes=modes, batch=5, **options)
    np.testing.assert_array_equal(run.position, cp.condensed.simulate(scenes, modes, **options).position)
    assert (tmp_path / "it" / "modes.nc").exists()
    assert modes.attrs["id"] in json.loads(run.attrs["history_json"])[-1]["inputs"]
    other = modes.assign(mode_shape=2.0 * modes["mode_shape"])
    with pytest.raises(cp.ArchiveError, match="holds another ensemble: the modes was"):
        cp.ensemble.run(scenes, tmp_path / "it", model="condensed", modes=other, batch=5, **options)


def test_failing_members_are_marked_and_stop_nobody_else(scenes_of, slackened, tmp_path, described):
    scenes = scenes_of(9)
    bad = slackened(scenes, [0, 1, 2, 4])  # one batch fails as a whole
    with pytest.warns(
        cp.MemberFailedWarning, match=r"4 of 9 members failed .* member 0: cable\.top_tension: given 1\.0"
    ):
        run = cp.ensemble.run(bad, tmp_path / "it", batch=3, step=ENSEMBLE_STEP)
    good = [3, 5, 6, 7, 8]
    np.testing.assert_array_equal(np.flatnonzero(run["failure"] == ""), good)
    assert np.isnan(run["position"][[0, 1, 2, 4]]).all()
    assert np.isnan(run["step"][[0, 1, 2, 4]]).all()
    np.testing.assert_array_equal(run["position"][good], cp.chain.simulate(scenes, step=ENSEMBLE_STEP).position[good])
    assert "failed    4" in described(tmp_path / "it")
    assert "cable.top_tension: given 1.0" in described(tmp_path / "it")
    stage = [item["function"] for item in json.loads(run.attrs["history_json"])]
    assert stage == ["make_scene", "ensemble.design", "changed outside the package", "ensemble.run"]


def test_batches_in_memory_warn_of_failing_members_too(scenes_of, slackened):
    bad = slackened(scenes_of(9), [1, 2, 4])
    with pytest.warns(
        cp.MemberFailedWarning, match=r"^3 of 9 members failed .* member 1: cable\.top_tension: given 1\.0"
    ) as caught:
        parts = list(cp.ensemble.batches(bad, batch=3, step=ENSEMBLE_STEP))
    assert number_of(cp.MemberFailedWarning, caught) == 1
    failures = np.concatenate([part["failure"] for part in parts])
    np.testing.assert_array_equal(np.flatnonzero(failures != ""), [1, 2, 4])


def test_all_members_may_fail(scenes_of, slackened, tmp_path):
    with pytest.warns(cp.MemberFailedWarning, match="3 of 3 members failed"):
        run = cp.ensemble.run(slackened(scenes_of(3), slice(None)), tmp_path / "it", step=ENSEMBLE_STEP)
    assert (run["failure"] != "").all()
    assert "position" not in run


def test_a_condensed_model_whose_first_member_fails(scenes_of, slackened, tmp_path):
    modes = full_modes()
    bad = slackened(scenes_of(4, ranges={"cable.top_tension": [200.0, 300.0]}), 0)
    options = {"rank": 4, "step": 2e-3, "outputs": ("position",)}
    with pytest.warns(cp.MemberFailedWarning, match="1 of 4 members failed"):
        run = cp.ensemble.run(bad, tmp_path / "it", model="condensed", modes=modes, **options)
    rest = cp.condensed.simulate(bad.isel(member=slice(1, None)), modes, **options)
    np.testing.assert_array_equal(run.position[1:], rest.position)
    assert np.isnan(run.position[0]).all()


def test_batches_are_handed_over_in_order_and_not_kept(scenes_of, finished):
    whole, seen = cp.archive.open_ensemble(finished).compute(), []
    parts = list(cp.ensemble.batches(scenes_of(), batch=4, step=ENSEMBLE_STEP, progress=seen.append))
    assert [part.sizes["member"] for part in parts] == [4, 4, 2]
    np.testing.assert_array_equal(np.concatenate([part["position"] for part in parts]), whole["position"])
    assert [part["member"].values[0] for part in parts] == [0, 4, 8]
    assert seen[-1] == 1.0
    assert len({part.attrs["id"] for part in parts}) == 3
    # who stops taking them stops the work
    generator = cp.ensemble.batches(scenes_of(), batch=1, step=ENSEMBLE_STEP)
    next(generator)
    generator.close()


def test_progress_counts_all_members(scenes_of, tmp_path):
    seen = []
    cp.ensemble.run(scenes_of(), tmp_path / "it", batch=3, step=ENSEMBLE_STEP, progress=seen.append)
    assert seen == sorted(seen)
    assert (seen[0], seen[-1]) == (0.0, 1.0)
    assert len(seen) > 4
    (tmp_path / "it" / "batch_0001.nc").unlink()
    seen.clear()
    cp.ensemble.run(scenes_of(), tmp_path / "it", batch=3, step=ENSEMBLE_STEP, progress=seen.append)
    assert seen[0] == pytest.approx(0.7)
    assert seen[-1] == 1.0


def test_other_warnings_come_once(soft, scenes_of, tmp_path, monkeypatch):
    of_chain = cp.chain.simulate

    def noisy(scenes, *, step=None, times=None, progress=None):
        for member in scenes["member"].values.tolist() if "member" in scenes.dims else []:
            warnings.warn(f"member {member} is odd", RuntimeWarning, stacklevel=1)
        return of_chain(scenes, step=step, times=times)

    monkeypatch.setattr(cp.chain, "simulate", noisy)
    with pytest.warns(RuntimeWarning, match=r"member \d is odd \(and 9 more such warnings in 10 members\)") as caught:
        list(cp.ensemble.batches(scenes_of(), batch=4, step=ENSEMBLE_STEP))
    assert number_of(RuntimeWarning, caught) == 1


def test_members_that_have_not_converged_are_counted_and_the_worst_named(scenes_of, tmp_path, monkeypatch, described):
    of_motion = np.array([1.02e-4, 5e-5, 0.4, 1e-5, 2e-5, 9e-5, 3e-5, 0.0, 0.0, 0.0])
    of_tension = np.array([0.034, 5e-5, 0.2, 1e-5, 1e-5, 0.9, 3e-5, 0.0, 0.0, 0.0])

    of_chain = cp.chain.simulate

    def doubtful(scenes, *, step=None, tolerance=None, times=None, progress=None):
        if "member" not in scenes.dims:
            return of_chain(scenes, step=ENSEMBLE_STEP, times=times, outputs=("tension_extremes",))
        text = "not converged in time: an error of 0.000102 of the motion is left"
        warnings.warn(text, cp.NotConvergedWarning, stacklevel=1)
        run = of_chain(scenes, step=ENSEMBLE_STEP, times=times, outputs=("tension_extremes",))
        which = scenes["member"].values
        return run.assign(
            time_error_estimate=("member", of_motion[which]), tension_time_error_estimate=("member", of_tension[which])
        )

    monkeypatch.setattr(cp.chain, "simulate", doubtful)
    said = (
        r"^3 of 10 members .* above 0\.0001; the worst: member 2 has an error of 0\.4 of the motion and of 0\.2 of the range of "
        r"its tensions; member 5 has an error of 9e-05 of the motion and of 0\.9 of the range"
    )
    with pytest.warns(cp.NotConvergedWarning, match=said) as caught:
        run = cp.ensemble.run(scenes_of(), tmp_path / "it", batch=4)
    assert number_of(cp.NotConvergedWarning, caught) == 1
    with pytest.warns(cp.NotConvergedWarning, match=said) as caught:
        list(cp.ensemble.batches(scenes_of(), batch=4))
    assert number_of(cp.NotConvergedWarning, caught) == 1
    assert run.attrs["accepted_time_error"] == 1e-4
    lines = described(tmp_path / "it").splitlines()
    place = lines.index("not converged  3, with an estimated time error above 0.0001")
    assert [line.partition(":")[0] for line in lines[place + 1 : place + 4]] == [
        "  member 5",
        "  member 2",
        "  member 0",
    ]
    peaks = run["tension_maximum"].max("link").values
    assert lines[place + 4].startswith(f"largest tension  {peaks.max():.5g} N, in member {peaks.argmax()}")
    with pytest.warns(cp.NotConvergedWarning, match=said):  # the same call, which has nothing to compute
        cp.ensemble.run(scenes_of(), tmp_path / "it", batch=4)
    with warnings.catch_warnings():  # a tolerance that all meet
        warnings.simplefilter("error", cp.NotConvergedWarning)
        warnings.filterwarnings("ignore", "not converged in time: ", cp.NotConvergedWarning)
        list(cp.ensemble.batches(scenes_of(), batch=4, tolerance=0.999))


OPTIONS = [
    ({"stepp": 1}, r"^option stepp: given 1; allowed: an option of model \"chain\": links, times, law"),
    ({"step": "x"}, r"^step: given 'x'; allowed: a finite number above 0"),
    ({"step": 1.0}, r"^step: given 1 s; allowed: below the stability limit"),
    ({"outputs": ("force",)}, r"^outputs: given 'force'; allowed: some of position"),
    ({"scheme": "euler"}, r"^scheme: given 'euler'"),
    ({"times": [1.0, 0.0]}, r"^times: given .*; allowed: finite, rising instants"),
    ({"times": max}, r"^times: given .*; allowed: a number, a text or a list of them"),
    ({"model": "beam"}, r"^model: given 'beam'; allowed: one of \"chain\", \"cable\""),
    ({"model": "galerkin"}, r"^modes: given None; allowed: the Dataset of modes"),
    ({"modes": xr.Dataset()}, r"^modes: given 'a value'; allowed: none for model \"chain\""),
    ({"batch": 0}, r"^batch: given 0; allowed: a whole number of at least 1"),
    ({"workers": 0}, r"^workers: given 0; allowed: a whole number of at least 1"),
    ({"scheduler": "threads"}, r"^scheduler: given 'threads'; allowed: None \(threads\), \"processes\", the address"),
]


@pytest.mark.parametrize(("options", "match"), OPTIONS, ids=[str(next(iter(item[0].items())))[:20] for item in OPTIONS])
def test_options_are_checked_before_anything_runs(finished, scenes_of, tmp_path, options, match):
    for run in (
        lambda: cp.ensemble.run(scenes_of(), tmp_path / "it", **options),
        lambda: cp.ensemble.run(scenes_of(), finished, **{"batch": 4, "step": ENSEMBLE_STEP, **options}),
        lambda: cp.ensemble.batches(scenes_of(), **options),
    ):
        with pytest.raises(cp.SceneError, match=match):
            run()
    assert not (tmp_path / "it").exists()


def test_batches_beyond_memory_are_refused_as_they_run_at_a_time(scenes_of, tmp_path, monkeypatch):
    scenes, options = scenes_of(12), {"step": 1e-3, "times": np.linspace(0.0, 0.1, 101)}
    size = cp.chain.simulate(scenes.isel(member=0), outputs=("position", "tension_extremes"), **options).nbytes
    monkeypatch.setattr(_resources, "memory", lambda: 2 * 10 * size)  # a run of one member needs 8
    for batch, workers, given in ((12, 2, "1 x 12"), (6, 2, "2 x 6")):
        with pytest.raises(cp.SceneError, match=f"^batch: given {given} members at a time, .*; allowed: half of this"):
            cp.ensemble.run(scenes, tmp_path / "it", batch=batch, workers=workers, **options)
        with pytest.raises(cp.SceneError, match=f"^batch: given {given} members at a time"):
            cp.ensemble.batches(scenes, batch=batch, workers=workers, **options)
    assert not (tmp_path / "it").exists()
    cp.ensemble.run(scenes, tmp_path / "it", batch=6, workers=1, **options)


def test_scenes_that_give_no_single_array_are_refused(scenes_of, soft, tmp_path):
    links = scenes_of(3, sampling="list", ranges={"chain.links": [4, 6, 5]})
    with pytest.raises(
        cp.SceneError, match=r"^chain\.links: given 'different values'; allowed: one value .* the option links$"
    ):
        cp.ensemble.run(links, tmp_path / "it", step=ENSEMBLE_STEP)
    assert cp.ensemble.run(links, tmp_path / "it", step=ENSEMBLE_STEP, links=4).sizes["particle"] == 5
    for wrong in (cp.make_scene(soft), None, links.isel(member=slice(0, 0))):
        with pytest.raises(cp.SceneError, match=r"^scenes: given (no |a NoneType)"):
            cp.ensemble.run(wrong, tmp_path / "other")


@pytest.mark.parametrize("names", [["a", "b", "c"], [0.2, 0.7, 1.2], [1, 1, 2]], ids=["words", "parts", "twice"])
def test_members_are_told_by_different_whole_numbers(scenes_of, tmp_path, names):
    scenes = scenes_of(3).assign_coords(member=names)
    for run in (lambda: cp.ensemble.run(scenes, tmp_path / "it"), lambda: cp.ensemble.batches(scenes)):
        with pytest.raises(cp.SceneError, match=r"^scenes: member: given .*; allowed: different whole numbers"):
            run()
    assert not (tmp_path / "it").exists()


@pytest.mark.filterwarnings("ignore::cablepod.errors.OutOfRangeWarning")  # two modes of a chain in a short run
def test_modes_made_again_with_other_rounding_go_on_with_an_ensemble(tmp_path, soft, monkeypatch):
    scene = cp.make_scene(soft)
    modes = cp.pod.decompose(cp.chain.simulate(scene, step=1e-3, times=np.arange(21) / 10), rank=2, layout="normal")
    rounded = modes.assign(mode_shape=modes.mode_shape.copy(data=modes.mode_shape.values * (1.0 + 1e-15)))
    stages = json.loads(modes.attrs["history_json"])
    stages[-1]["content"] = provenance.content_of(rounded)  # as its own stage made it, on another machine
    rounded.attrs["history_json"] = json.dumps(stages)
    scenes = cp.ensemble.design(scene, {"gravity": [9.7, 9.9]}, members=2)
    ids = [
        cp.ensemble.run(scenes, tmp_path / "runs", model="condensed", modes=given, times=[0.1]).attrs["id"]
        for given in (modes, rounded)
    ]
    assert ids[0] == ids[1]


def number_of(category, caught):
    """Return the number of warnings of a category; that of too few links comes beside it, once too."""
    categories = [item.category for item in caught]
    assert len(categories) == len(set(categories))
    return categories.count(category)
