"""Members of a scene with a mast: each is its single run, whatever runs beside it."""

from __future__ import annotations

import numpy as np
import pytest
from mast_scenes import small, windy
from scene_files import put

import cablepod as cp
from cablepod.errors import MemberFailedWarning, OutOfRangeWarning, SceneError

OUTPUTS = ("displacement", "guy_tension", "guy_force", "bending_moment", "extremes")


def varied(scene, **values):
    """The scene with values along ``member``."""
    return scene.assign({name: (("member", *scene[name].dims), np.asarray(column)) for name, column in values.items()})


def check_single(both, scene, **options):
    """Each member is its single run."""
    for i in range(scene.sizes["member"]):
        single = cp.mast.simulate(scene.isel(member=i, drop=True), **options)
        for name in single.data_vars:
            if name.startswith("displacement") and name.endswith("time"):
                continue
            own, alone = both[name].isel(member=i).values, single[name].values
            alike = [
                single[other]
                for other in single.data_vars
                if single[other].attrs["units"] == single[name].attrs["units"]
            ]
            scale = max(float(np.abs(values).max()) for values in alike)
            np.testing.assert_allclose(own, alone, rtol=0.0, atol=1e-9 * scale, err_msg=name)
        for name in ("step", "number_of_steps", "smallest_chordwise_force", "time_of_smallest_chordwise_force"):
            own = both[name].isel(member=i) if name in both else both.attrs[name]
            assert float(own) == pytest.approx(single.attrs[name], rel=1e-9), name
        for name in ("rank", "guys", "scheme", "title"):
            assert both.attrs[name] == single.attrs[name], name


def test_members_of_other_tensions_are_single_runs():
    scene = varied(small(), guy_1_top_tension=np.linspace(4500.0, 5500.0, 5), mast_drag_area=np.linspace(0.0, 1.0, 5))
    both = cp.mast.simulate(scene, outputs=OUTPUTS, step=0.02)
    check_single(both, scene, outputs=OUTPUTS, step=0.02)


@pytest.mark.slow
def test_members_of_other_winds_ice_and_loads_are_single_runs():
    scene = small(lambda each: (windy(each), put(each, "ice", {"thickness": 0.0}), put(each, "mast.diameter", 0.05)))
    scene = varied(
        scene,
        guy_1_top_tension=[4500.0, 5000.0, 5500.0, 5000.0, 5200.0, 4800.0],
        wind_direction=[[1.0, 0.0, 0.0]] * 2 + [[0.6, 0.0, 0.8]] * 2 + [[1.0, 0.0, 0.0]] * 2,
        wind_turbulence_seed=[3, 3, 3, 3, 4, 4],
        ice_thickness=[0.0, 0.01, 0.0, 0.01, 0.0, 0.005],
    )
    both = cp.mast.simulate(scene, outputs=OUTPUTS)
    check_single(both, scene, outputs=OUTPUTS)
    assert float(both.guy_tension_maximum.std("member").min()) > 0.0


@pytest.mark.parametrize("tension", [20.0, np.nan])  # too small; of a member that lacks the key
def test_a_member_that_fails_leaves_the_others_alone(tension):
    scene = varied(small(), guy_1_top_tension=[4500.0, tension, 5500.0], mast_damping_ratio=[0.01, 0.01, 0.02])
    with pytest.warns(MemberFailedWarning, match=r"member 1: guy\.1"):
        both = cp.mast.simulate(scene, step=0.02)
    assert np.isnan(both.guy_tension.isel(member=1)).all()
    assert str(both.failure.values[1]).startswith("guy.1")
    check_single(both.isel(member=[0, 2]), scene.isel(member=[0, 2]), step=0.02)


def test_a_member_that_diverges_says_so_as_alone():
    force = np.array([[1000.0, 0.0, 400.0], [1e9, 0.0, 0.0], [900.0, 0.0, 0.0]])
    scene = varied(small(), mast_load_1_force=force)
    with pytest.warns(MemberFailedWarning, match=r"member 1: the mast .* at [0-9.]+ s"):
        both = cp.mast.simulate(scene, step=0.02)
    check_single(both.isel(member=[0, 2]), scene.isel(member=[0, 2]), step=0.02)


def test_slack_members_warn():
    force = np.array([[5000.0, 0.0, 0.0], [100.0, 0.0, 0.0]])
    scene = varied(small(lambda mapping: mapping["mast"].update(damping_ratio=0.05)), mast_load_1_force=force)
    with pytest.warns(OutOfRangeWarning, match=r"guy\.1: .*slack"):
        both = cp.mast.simulate(scene, step=0.02)
    assert float(both.smallest_chordwise_force[0]) < 0.0 < float(both.smallest_chordwise_force[1])


def test_members_of_other_levels_are_refused_before_they_run():
    """Levels label the displacements, of which one result cannot have several; they were refused after the last member."""
    scene, seen = varied(small(), guy_1_level=[27.0, 28.0]), []
    with pytest.raises(SceneError, match=r"^guy\.1\.level: .*allowed"):
        cp.mast.simulate(scene, progress=seen.append)
    assert not seen
    with pytest.raises(SceneError, match=r"^guy\.1\.level: .*allowed"):
        cp.mast.rest(scene)
    both = cp.mast.simulate(scene, outputs=("guy_tension",), times=[0.0, 0.1])
    assert both.guy_level.values.tolist() == [[27.0] * 3, [28.0] * 3]


def test_wrong_options_are_refused_by_key():
    scene = varied(small(), guy_1_top_tension=[4800.0, 5200.0])
    for key, options in (("outputs", {"outputs": 3}), ("step", {"step": 0.013}), ("rank", {"rank": 0})):
        with pytest.raises(SceneError, match=rf"^{key}: .*allowed"):
            cp.mast.simulate(scene, **options)
