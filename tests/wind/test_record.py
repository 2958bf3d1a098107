"""Records of wind: read by the scene, kept by path and content hash, used by every model as a given field."""

from __future__ import annotations

import hashlib
import warnings

import numpy as np
import pytest
import xarray as xr
from wind_scenes import GUY, KAIMAL, WIND

import cablepod as cp

#: A short run of a guy in gusts.
SHORT = {**GUY, "chain": {"links": 10}, "time": {"duration": 2.0, "interval": 0.1}}
TOML = """
[cable]
youngs_modulus = 1.6e11
area = 1.25e-4
density = 8000.0
top_tension = 15000.0
diameter = 0.016
[ends]
lower = [0.0, 0.0, 0.0]
upper = [20.4, 57.7, 0.0]
[chain]
links = 10
[time]
duration = 2.0
interval = 0.1
[wind]
speed = 25.0
direction = [1.0, 0.0, 0.0]
[wind.turbulence]
record = "records/field.nc"
"""


@pytest.fixture(autouse=True)
def _elsewhere(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def gusts():
    """The field of the guy in Kaimal turbulence."""
    return cp.wind.field(cp.make_scene({**SHORT, "wind": KAIMAL}))


def with_record(path="field.nc", **wind):
    return {**SHORT, "wind": {**WIND, **wind, "turbulence": {"record": str(path)}}}


def test_a_record_is_the_field_of_every_model(gusts, tmp_path):
    (tmp_path / "records").mkdir()
    path = tmp_path / "records" / "field.nc"
    cp.archive.write(gusts, path)
    (tmp_path / "guy.toml").write_text(TOML)
    scene, steady = cp.read_scene(tmp_path / "guy.toml"), cp.make_scene({**SHORT, "wind": WIND})
    assert str(scene.wind_turbulence_record.values) == str(path)
    assert str(scene.wind_turbulence_record_sha256.values) == hashlib.sha256(path.read_bytes()).hexdigest()
    modes = cp.condensed.vibration_modes(steady, rank=4)
    for simulate in (
        lambda scene, **wind: cp.chain.simulate(scene, step=2e-4, **wind),
        lambda scene, **wind: cp.condensed.simulate(scene, modes, step=0.02, outputs=("position",), **wind),
    ):
        given, recorded, still = simulate(steady, wind=gusts), simulate(scene), simulate(steady)
        assert np.array_equal(given.position, recorded.position)
        assert float(abs(given.position - still.position).max()) > 1e-4
    assert cp.wind.field(scene).wind.values == pytest.approx(gusts.wind.values, abs=1e-12)
    assert cp.wind.field(scene).attrs["spectrum"] == "record"
    assert cp.chain.rest(scene).position.values == pytest.approx(cp.chain.rest(steady).position.values, abs=1e-12)


def test_a_ramp_starts_a_record_in_still_air(gusts):
    gusts.to_netcdf("field.nc")
    scene = cp.make_scene(with_record(ramp=1.0))
    run = cp.chain.simulate(scene, step=2e-4)
    still = cp.chain.rest(cp.make_scene(SHORT)).position
    assert run.position.isel(time=0).values == pytest.approx(still.values, abs=1e-9)
    assert float(abs(run.position.isel(time=-1) - still).max()) > 1e-3


def test_points_by_position_and_uneven_instants(gusts):
    time = gusts.time.values[gusts.time.values != 0.5]
    sigma = gusts.relative_arc_length.values
    every_fourth = np.searchsorted(sigma, np.linspace(1.0, 0.0, 11) - 1e-9)
    gusts.drop_vars(["relative_arc_length", "mean_wind"]).sel(time=time).isel(point=every_fourth).to_netcdf("field.nc")
    found = cp.wind.field(cp.make_scene(with_record()))
    same, other = (field.wind.sel(time=time).isel(point=every_fourth[::5]).values for field in (gusts, found))
    assert other == pytest.approx(same, abs=1e-9)  # an instant is missing: the others keep their values
    middle = every_fourth[5]
    between = found.wind.sel(time=0.5, method="nearest").isel(point=middle).values
    expected = 0.5 * (gusts.wind.isel(point=middle)[4] + gusts.wind.isel(point=middle)[6]).values
    assert between == pytest.approx(expected, abs=1e-9)
    assert found.mean_wind.isel(point=middle).values == pytest.approx(
        gusts.wind.isel(point=middle).sel(time=time).mean("time").values, abs=1e-9
    )


def spoilt(field, **changes):
    """A field with other values of variables."""
    return field.assign(
        {name: (field[name].dims, np.array(value(field[name].values))) for name, value in changes.items()}
    )


def at(place, value):
    def change(values):
        values = values.copy()
        values[place] = value
        return values

    return change


BAD = {
    "short": (lambda f: f.isel(time=slice(0, 10)), r"too short, from 0 s to 0\.9 s; allowed: .* from 0 s to 2 s"),
    "late": (lambda f: f.isel(time=slice(3, None)), r"too short, from 0\.3 s to 2 s"),
    "one instant": (lambda f: f.isel(time=[0]), r"allowed: at least two rising instants"),
    "no instants": (lambda f: f.isel(time=slice(0, 0)), r"allowed: at least two rising instants"),
    "no points": (lambda f: f.isel(point=slice(0, 0)), r"0 points\); allowed: .* and a point"),
    "unsorted": (lambda f: f.isel(time=[0, 2, 1, *range(3, 21)]), r"instants that do not rise.*; allowed: at least two rising"),
    "gap": (lambda f: f.isel(time=[0, 1, 2, *range(14, 21)]), r"gap of 1\.2 s after 0\.2 s; allowed: at most ten times the"),
    "nan": (lambda f: spoilt(f, wind=at((3, 4, 0), np.nan)), r"not finite; allowed: finite velocities"),
    "infinity": (lambda f: spoilt(f, wind=at((3, 4, 0), np.inf)), r"not finite; allowed: finite velocities"),
    "nan in mean": (lambda f: spoilt(f, mean_wind=at((4, 0), np.nan)), r"mean_wind that is not finite"),
    "far": (
        lambda f: spoilt(f.drop_vars("relative_arc_length"), position=lambda x: x + 100.0),
        r"no point near the cable \(the nearest is .* m away\); allowed: points within 6\.1",
    ),
    "outside": (lambda f: spoilt(f, relative_arc_length=at(0, -0.5)), r"relative_arc_length outside of the cable"),
    "no places": (lambda f: f.drop_vars(["relative_arc_length", "position"]), r"without position; allowed"),
    "no wind": (lambda f: f.drop_vars("wind"), r"without wind; allowed: a field, such as that of wind\.field"),
    "planar": (lambda f: f.isel(component=[0, 1]), r"given the components x, y; allowed: x, y, z"),
    "hours": (lambda f: f.assign_coords(time=f.time.assign_attrs(units="hours")), r"time: given units 'hours'; allowed: s"),
    "knots": (lambda f: f.assign(wind=f.wind.assign_attrs(units="knots")), r"wind: given units 'knots'; allowed: m s-1"),
    "millimetres": (
        lambda f: f.assign(position=f.position.assign_attrs(units="mm")), r"position: given units 'mm'; allowed: m"
    ),
    "per cent": (
        lambda f: f.assign_coords(relative_arc_length=f.relative_arc_length.assign_attrs(units="%")),
        r"relative_arc_length: given units '%'; allowed: 1",
    ),
    "components of points": (
        lambda f: f.drop_vars("component").assign_coords(component=("point", f.point.values)), r"component over"
    ),
    "texts": (lambda f: f.assign(wind=f.wind.astype(str)), r"given wind .* of type .*; allowed: numbers over"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_a_bad_record_and_a_bad_field_are_named(name, gusts):
    change, message = BAD[name]
    bad = change(gusts)
    bad.to_netcdf("field.nc")
    with pytest.raises(cp.SceneError, match=rf"^wind\.turbulence\.record: .*field\.nc.*{message}"):
        cp.make_scene(with_record())
    refuse_field(bad, message)


def refuse_field(field, message):
    """Hold that models refuse a given field."""
    scene = cp.make_scene({**SHORT, "wind": KAIMAL})
    modes = cp.condensed.vibration_modes(scene, rank=4)
    for call in (
        lambda: cp.chain.simulate(scene, step=2e-4, wind=field),
        lambda: cp.condensed.simulate(scene, modes, step=0.02, wind=field),
    ):
        with pytest.raises(cp.SceneError, match=rf"^wind: .*{message}") as refused:
            call()
        assert "; allowed: " in str(refused.value)


def test_a_path_is_no_field():
    refuse_field("wind.nc", "given a str")


@pytest.mark.parametrize(
    ("content", "message"),
    [(None, "cannot be read: No such file"), (b"", "is empty; allowed"), (b"time,wind\n0,1\n", "is no netCDF file, or damaged")],
)  # fmt: skip
def test_a_file_that_is_no_record(content, message, tmp_path):
    if content is not None:
        (tmp_path / "field.nc").write_bytes(content)
    with pytest.raises(cp.SceneError, match=rf"^wind\.turbulence\.record: .*field\.nc.*{message}"):
        cp.make_scene(with_record())


def test_a_truncated_file_and_a_folder(gusts, tmp_path):
    gusts.to_netcdf("field.nc")
    whole = (tmp_path / "field.nc").read_bytes()
    (tmp_path / "field.nc").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(cp.SceneError, match=r"^wind\.turbulence\.record: .*is no netCDF file, or damaged"):
        cp.make_scene(with_record())
    with pytest.raises(cp.SceneError, match=r"^wind\.turbulence\.record: .*is a folder"):
        cp.make_scene(with_record(tmp_path))


def test_a_record_is_opened_as_it_was(gusts, tmp_path):
    gusts.to_netcdf("field.nc")
    scene = cp.make_scene(with_record())
    spoilt(gusts, wind=lambda x: 2.0 * x).to_netcdf("other.nc")
    (tmp_path / "other.nc").replace(tmp_path / "field.nc")
    cp.clear_caches()  # as in another process
    with pytest.raises(cp.SceneError, match=r"^wind\.turbulence\.record: .* has changed since the scene was made"):
        cp.wind.field(scene)
    pinned = with_record()
    pinned["wind"]["turbulence"]["record_sha256"] = "0" * 64
    with pytest.raises(cp.SceneError, match=r"^wind\.turbulence\.record_sha256: given .*; allowed: that of "):
        cp.make_scene(pinned)


@pytest.mark.parametrize(
    ("turbulence", "key"),
    [
        ({"record": "field.nc", "spectrum": "kaimal"}, "spectrum"),
        ({"record": "field.nc", "seed": 3}, "seed"),
        ({"record": 3}, "record"),
        ({"record": ""}, "record"),
        ({"record_sha256": "0"}, "record_sha256"),
        ({"record": "field.nc", "recrd": 3}, "recrd"),
    ],
)
def test_keys_beside_a_record(turbulence, key):
    with pytest.raises(cp.SceneError, match=rf"^wind\.turbulence\.{key}: .*allowed: "):
        cp.make_scene({**SHORT, "wind": {**WIND, "turbulence": turbulence}})


def test_seed_and_points_do_not_choose_from_a_record(gusts):
    gusts.to_netcdf("field.nc")
    scene = cp.make_scene(with_record())
    for key, value in (("seed", 3), ("points", [[0.0, 10.0, 0.0]])):
        with pytest.raises(cp.SceneError, match=rf"^{key}: given .*; allowed: none with wind\.turbulence\.record"):
            cp.wind.field(scene, **{key: value})
    with pytest.raises(cp.SceneError, match=r"too short, from 0 s to 2 s; .* to 3 s$"):
        cp.wind.field(scene, times=[0.0, 3.0])


def test_a_mean_wind_other_than_the_scenes_is_said(gusts):
    gusts.to_netcdf("field.nc")
    with pytest.warns(UserWarning, match=r"^wind\.speed, wind\.direction: .* the record is used; change wind"):
        cp.wind.field(cp.make_scene(with_record(speed=10.0)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        cp.wind.field(cp.make_scene(with_record()))


def test_members_share_a_record(gusts):
    gusts.to_netcdf("field.nc")
    members = cp.ensemble.design(cp.make_scene(with_record()), {"cable.top_tension": [14000.0, 16000.0]}, members=2)
    fields = cp.wind.field(members)
    assert fields.sizes["member"] == 2
    assert fields.wind.isel(member=0).values == pytest.approx(gusts.wind.values, abs=1e-12)
    assert isinstance(fields, xr.Dataset)


def test_the_place_of_a_record_is_no_part_of_the_id(gusts, tmp_path):
    scenes = []
    for folder in ("here", "there"):
        (tmp_path / folder).mkdir()
        gusts.to_netcdf(tmp_path / folder / "field.nc")
        scenes.append(cp.make_scene(with_record(tmp_path / folder / "field.nc")))
    content = {str(scene.wind_turbulence_record_sha256.values) for scene in scenes}
    assert len(content) == 1
    assert scenes[0].attrs["id"] == scenes[1].attrs["id"]
    assert str(scenes[0].wind_turbulence_record.values) != str(scenes[1].wind_turbulence_record.values)
    gusts.assign(wind=2.0 * gusts.wind).to_netcdf(tmp_path / "other.nc")
    assert cp.make_scene(with_record(tmp_path / "other.nc")).attrs["id"] != scenes[0].attrs["id"]
