"""A model of a user's own in ensembles and studies: the same as by hand, and refused where it cannot be called."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

import cablepod as cp
from cablepod import examples
from cablepod.errors import SceneError

LINKS = 10


def straight(scene, modes=None, *, rank=1, times=None, factor=1.0, progress=None):
    """Particles on the straight line between the ends, which a factor moves away from it."""
    if float(scene.cable_top_tension) > 17e3:
        raise cp.RunStopped("too taut")
    at = cp.chain.simulate(scene, links=LINKS, scheme="trapezoidal", step=0.01, times=times, outputs=("position",))
    ends = at.position.isel(particle=[0, -1]).values
    place = np.linspace(0.0, 1.0, LINKS + 1)[:, None]
    line = (1.0 - place) * ends[:, :1] + place * ends[:, 1:]
    line[:, 1:-1] *= factor
    return cp.snapshots(xr.DataArray(line, at.position.coords, at.position.dims), scene=scene)


def of_two_schemes(scene, modes=None, *, times=None, progress=None):
    """A chain whose scheme follows from its tension."""
    if (tension := float(scene.cable_top_tension)) > 17e3:
        raise cp.RunStopped("too taut")
    scheme = "trapezoidal" if tension > 14e3 else "velocity_verlet"
    return cp.chain.simulate(scene, links=LINKS, scheme=scheme, step=5e-4, times=times)


def no_dataset(scene, modes=None, *, rank=1, times=None, progress=None):
    return 3


def no_progress(scene, modes=None, *, times=None):
    return None


def no_rank(scene, modes=None, *, times=None, progress=None):
    return None


def no_modes(scene, *, rank=1, times=None, progress=None):
    return None


@pytest.fixture
def scene():
    return examples.scene("example2").assign(time_duration=10.0)


def test_members_are_what_the_function_gives(scene, tmp_path):
    scenes = cp.ensemble.design(scene, {"cable.top_tension": [12e3, 18e3, 4]})
    with pytest.warns(cp.MemberFailedWarning):
        runs = cp.ensemble.run(scenes, tmp_path / "it", model=straight, factor=1.1, batch=2)
    assert runs.failure.values.tolist()[:3] == ["", "", ""]
    assert runs.failure.values[3] == "too taut"
    for i in range(3):
        alone = straight(scenes.isel(member=i, drop=True), factor=1.1)
        np.testing.assert_array_equal(runs.position.isel(member=i), alone.position)
    assert np.isnan(runs.position.isel(member=3)).all()
    written = [path.stat().st_mtime_ns for path in sorted((tmp_path / "it").glob("batch_*"))]
    with pytest.warns(cp.MemberFailedWarning):  # the failed member is not tried again
        by_name = cp.ensemble.run(scenes, tmp_path / "it", model=f"{__name__}:straight", factor=1.1, batch=2)
    assert by_name.attrs["id"] == runs.attrs["id"]
    assert [path.stat().st_mtime_ns for path in sorted((tmp_path / "it").glob("batch_*"))] == written


@pytest.mark.parametrize("batch", [1, 2, 3, 6])
def test_schemes_that_differ_are_told_by_member(scene, tmp_path, batch):
    tensions = [18e3, 12e3, 13e3, 15e3, 12e3, 18e3]
    scenes = cp.ensemble.design(scene, {"cable.top_tension": tensions}, members=6, sampling="list")
    with pytest.warns(cp.MemberFailedWarning):
        runs = cp.ensemble.run(scenes, tmp_path / "it", model=of_two_schemes, batch=batch, times=[0.0, 0.5])
    explicit, implicit = "velocity_verlet", "trapezoidal"
    assert runs["scheme"].values.tolist() == ["", explicit, explicit, implicit, explicit, ""]
    assert "scheme" not in runs.attrs
    assert runs.attrs["law"] == "linear"


def test_a_study_compares_it(scene):
    study = cp.study.run(scene, ranks=(1, 2), models=("condensed", straight))
    compared = study["comparison"]
    assert compared["model"].values.tolist() == ["condensed", "straight"]
    alone = straight(scene, times=study["chain"]["time"].values)
    expected = cp.compare.errors(alone, study["chain"].to_dataset()).error_max
    np.testing.assert_array_equal(compared["error_max"].sel(model="straight"), [float(expected)] * 2)
    assert np.isnan(compared["error_estimate"].sel(model="straight")).all()
    assert (compared["call_time"].sel(model="straight") > 0.0).all()
    assert not study.attrs["left_out"]


def test_a_function_of_the_package_is_the_model_of_its_name(scene, tmp_path):
    scenes = cp.ensemble.design(scene, {"cable.top_tension": [12e3, 14e3]}, members=2)
    by_name, by_function = (
        next(iter(cp.ensemble.batches(scenes, model=model, scheme="trapezoidal", step=0.01)))
        for model in ("chain", cp.chain.simulate)
    )
    assert by_name.attrs["id"] == by_function.attrs["id"]


@pytest.mark.parametrize(
    ("model", "words"),
    [
        ("nowhere:model", "nowhere:model.*cannot be imported"),
        (f"{__name__}:nothing", "cannot be imported"),
        (f"{__name__}:LINKS", "a int; allowed: a function"),
        (lambda scene, modes: None, "cannot be imported.*top of a module"),
        (no_progress, "no_progress.*allowed: a function.*progress=None"),
        (no_modes, "no_modes.*allowed: a function"),
        (no_dataset, "gave a int; allowed: a trajectory Dataset"),
        (7, "given 7; allowed: one of"),
        ("chian", "try: chain"),
    ],
)  # fmt: skip
def test_what_is_no_model_is_refused(scene, tmp_path, model, words):
    scenes = cp.ensemble.design(scene, {"cable.top_tension": [12e3, 14e3]}, members=2)
    with pytest.raises(SceneError, match=rf"^model: .*{words}"):
        cp.ensemble.run(scenes, tmp_path / "it", model=model)
    assert not (tmp_path / "it").exists()


def test_a_study_refuses_other_models(scene):
    for models, words in (
        ("condensed", "models: given 'condensed'"),
        (["chain"], 'model: given \'chain\'; allowed: one of "condensed", "galerkin"'),
        ([no_rank], "without the option rank"),
        (["condensed", f"{__name__}:condensed"], "two of the name condensed"),
    ):
        with pytest.raises(SceneError, match=words):
            cp.study.run(scene, models=models)


condensed = straight
