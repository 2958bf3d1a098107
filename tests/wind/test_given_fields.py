"""Fields given by ``wind=`` or a record: all else of [wind] holds, so that the field of a scene changes nothing."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from mast_scenes import small, windy
from suite import slow
from wind_scenes import GUY, KAIMAL, WIND

import cablepod as cp

SHORT = {**GUY, "chain": {"links": 10}, "time": {"duration": 2.0, "interval": 0.1}}
#: All other keys of the wind and the cable that a field leaves to the scene.
OTHERS = {"ice": {"thickness": 0.01}, "cable": {**GUY["cable"], "drag_coefficient": 0.9}}
KINDS = {"steady": WIND, "gusts": KAIMAL, "record": {**WIND, "turbulence": {"record": "field.nc"}}}


def modes():
    return cp.condensed.vibration_modes(cp.make_scene({**SHORT, "wind": WIND}), rank=3)


def chain(scene, wind, **options):
    return cp.chain.simulate(scene, wind=wind, **options).position.values


def cable(scene, wind, **options):
    return cp.cable.simulate(scene, elements=2, wind=wind, **options).position.values


def condensed(scene, wind, **options):
    return cp.condensed.simulate(scene, modes(), step=0.02, wind=wind, outputs=("position",), **options).position.values


def prepared(scene, wind):
    return cp.condensed.prepare(scene, modes(), step=0.02, wind=wind).run(outputs=("position",)).position


def host(scene, wind):
    guy = cp.condensed.prepare(scene, modes(), step=0.02, wind=wind)
    return np.array([guy.step(guy.end_position, 0.0 * guy.end_position, 0.02) for _ in range(100)])


def members(scene, wind):
    scenes = xr.concat([scene.assign(wind_air_density=density) for density in (1.25, 1.0)], dim="member")
    return condensed(scenes.assign_attrs(scene.attrs), wind)[1]


MODELS = {
    "chain": lambda scene, wind: chain(scene, wind, step=1e-3),
    "trapezoidal": lambda scene, wind: chain(scene, wind, step=5e-3, scheme="trapezoidal"),
    "generalized_alpha": lambda scene, wind: chain(scene, wind, step=5e-3, scheme="generalized_alpha"),
    "energy_momentum": lambda scene, wind: chain(scene, wind, step=5e-3, scheme="energy_momentum"),
    "cable": lambda scene, wind: cable(scene, wind, step=1e-2, scheme="trapezoidal"),
    "cable explicit": lambda scene, wind: cable(scene, wind, step=1e-4, scheme="velocity_verlet"),
    "condensed": condensed,
    "exact": lambda scene, wind: condensed(scene, wind, order="exact"),
    "inertial": lambda scene, wind: condensed(scene, wind, order="inertial"),
    "members": members,
    "prepared": prepared,
    "host": host,
}  # fmt: skip
OFTEN = ("chain", "condensed", "host")


@pytest.mark.parametrize("ramp", [0.0, 1.0])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("model", [model if model in OFTEN else slow(model) for model in MODELS])
def test_the_field_of_a_scene_changes_nothing(model, kind, ramp, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    tables = {**SHORT, **OTHERS, "wind": {**KINDS[kind], "air_density": 1.1, "ramp": ramp}}
    if model in ("prepared", "host"):  # which refuse ice
        del tables["ice"]
    if kind == "record":
        cp.wind.field(cp.make_scene({**tables, "wind": KAIMAL})).to_netcdf("field.nc")
    scene = cp.make_scene(tables)
    own, given = (MODELS[model](scene, wind) for wind in (None, cp.wind.field(scene)))
    blown = MODELS[model](scene, cp.wind.field(cp.make_scene({**tables, "wind": {**KAIMAL, "speed": 30.0}})))
    moved = np.abs(blown - own).max()
    # a ramp of 1 s has ten samples of a field, a steady one of the scene 200
    assert np.abs(given - own).max() < (2e-3 if kind == "steady" and ramp else 1e-9) * moved


@pytest.mark.parametrize("kind", ["condensed", slow("chain"), slow("catenary")])
@pytest.mark.parametrize("ramp", [0.0, 1.0])
def test_the_field_of_a_mast_changes_nothing(kind, ramp):
    scene = small(lambda mapping: (windy(mapping), mapping.update(wind={**mapping["wind"], "ramp": ramp})))
    own, given = (cp.mast.simulate(scene, guys=kind, wind=wind) for wind in (None, cp.wind.field(scene)))
    moved = float(abs(own.displacement - own.displacement[0]).max())
    assert float(abs(given.displacement - own.displacement).max()) < 1e-9 * moved


@pytest.mark.parametrize("interval", [1.0, 12.0])
def test_a_ramp_does_not_take_the_instants_of_a_field(interval):
    """A steady field needs two instants; a ramp with its factor at these alone lasted until the second."""
    scene = cp.make_scene({**SHORT, "wind": {**WIND, "ramp": 1.0}, "time": {"duration": 12.0, "interval": 0.1}})
    field = cp.wind.field(scene, times=np.arange(0.0, 12.0 + interval, interval))
    own, given = (condensed(scene, wind) for wind in (None, field))
    assert np.abs(given - own).max() < 2e-3 * np.abs(own - own[0]).max()  # of the ten samples


def test_a_field_of_single_precision_is_rounded_by_no_more():
    """On masts as well, whose guys have the profile of the scene between the points where the mean is that of the scene."""
    scene = small(windy)
    field = cp.wind.field(scene)
    runs = [cp.mast.simulate(scene, wind=wind, times=[0.0, 0.2], step=0.02) for wind in (field, field.astype("f4"))]
    tension = [run.guy_tension for run in runs]
    # 6e-8 of the wind, which makes a part of the tension
    assert float(abs(tension[1] - tension[0]).max()) < 1e-6 * float(tension[0].max())


@pytest.mark.parametrize("model", ["chain", "condensed", "mast"])
def test_members_have_fields_of_their_own(model):
    scene = small(windy) if model == "mast" else cp.make_scene({**SHORT, "wind": KAIMAL})
    scenes = cp.ensemble.design(scene, {"wind.speed": [10.0, 20.0]}, members=2)
    simulate = {
        "chain": lambda wind: cp.chain.simulate(scenes, step=1e-3, wind=wind).position.values,
        "condensed": lambda wind: condensed(scenes, wind),
        "mast": lambda wind: cp.mast.simulate(scenes, wind=wind).displacement.values,
    }[model]
    own, fields = simulate(None), cp.wind.field(scenes)
    np.testing.assert_allclose(simulate(fields), own, rtol=0, atol=1e-9)
    for other in (fields.isel(member=[1, 0]), fields.isel(member=[0])):
        with pytest.raises(cp.SceneError, match=r"^wind: member: given .*; allowed: those of the scene, \[0, 1\]"):
            simulate(other)


def test_of_points_at_one_place_the_nearest_counts():
    scene = cp.make_scene({**SHORT, "wind": KAIMAL})
    field = cp.wind.field(scene).drop_vars("relative_arc_length")
    aside = field.assign(position=field.position + 2.0 * (field.component == "z"), wind=0.5 * field.wind)
    for both in ((aside, field), (field, aside)):
        found = condensed(scene, xr.concat(both, dim="point"))
        np.testing.assert_allclose(found, condensed(scene, field), rtol=0, atol=1e-12)


@pytest.mark.parametrize("mast", [False, True])
def test_positions_are_finite(mast):
    scene = small(windy) if mast else cp.make_scene({**SHORT, "wind": KAIMAL})
    field = cp.wind.field(scene).drop_vars(["relative_arc_length", "guy"], errors="ignore")
    simulate = cp.mast.simulate if mast else cp.chain.simulate
    with pytest.raises(
        cp.SceneError, match=r"^wind: given a position that is not finite; allowed: finite positions \[m\]"
    ):
        simulate(scene, wind=field.assign(position=field.position.where(field.point != 3)))


def test_a_cable_takes_the_field_of_one_guy_of_a_mast():
    storm = cp.wind.field(small(windy))
    scene = cp.make_scene({**SHORT, "wind": WIND})
    with pytest.raises(cp.SceneError, match=r"^wind: given the field of a mast; allowed: .*the points of one guy"):
        condensed(scene, storm)
    condensed(scene, storm.isel(point=storm.guy == 2))
