"""What is read is what was written, eagerly or lazily, and how it lies in the file."""

import os
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from results import KINDS, make_ensemble, make_scene, make_trajectory

from cablepod.archive import ArchiveError, describe, read, write


def dtypes(dataset):
    return {name: item.dtype for name, item in dataset.variables.items()}


def is_open(path):
    """Tell whether this process holds `path` open; where that cannot be known, say no."""
    handles = Path("/proc/self/fd")
    names = [os.readlink(item) for item in handles.iterdir() if item.is_symlink()] if handles.is_dir() else []
    return str(path) in names


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_read_is_what_was_written(kind, tmp_path):
    dataset = KINDS[kind]()
    before = dataset.copy(deep=True)
    path = write(dataset, tmp_path / "it.nc")
    assert path == tmp_path / "it.nc"
    xr.testing.assert_identical(dataset, before)
    back = read(path)
    assert dtypes(back) == dtypes(dataset)
    assert {name: item.attrs for name, item in back.variables.items()} == {
        name: item.attrs for name, item in dataset.variables.items()
    }
    assert all(back.attrs[name] == value for name, value in dataset.attrs.items() if name != "history_json")
    xr.testing.assert_identical(
        back.assign_attrs(history_json=""), dataset.assign_attrs({**back.attrs, "history_json": ""})
    )
    assert all(not item.encoding for item in back.variables.values())
    assert not is_open(path)
    assert [item.name for item in tmp_path.iterdir()] == ["it.nc"]


def test_an_eager_read_closes_the_file(tmp_path, monkeypatch):
    path = write(make_trajectory(), tmp_path / "it.nc")
    opened, open_dataset = [], xr.open_dataset

    def note(*args, **options):
        opened.append(open_dataset(*args, **options))
        return opened[-1]

    monkeypatch.setattr(xr, "open_dataset", note)
    for task in (read, describe):
        task(path)
        assert not is_open(path)
    assert len(opened) == 2  # and still referred to, so that nothing else closed it


@pytest.mark.parametrize("kind", KINDS)
def test_a_second_write_changes_nothing(kind, tmp_path, stop_clock):
    first = read(write(KINDS[kind](), tmp_path / "p.nc"))
    stop_clock("2099-01-01T00:00:00Z")
    second = read(write(first, tmp_path / "q.nc"))
    xr.testing.assert_identical(first, second)
    assert dtypes(first) == dtypes(second)


def test_inherited_encodings_and_attributes_of_the_input_stay_out_of_the_file(tmp_path):
    dataset = make_trajectory()
    dataset["position"].encoding = {"dtype": "f4", "scale_factor": 0.1, "_FillValue": -1.0}
    dataset.encoding = {"unlimited_dims": {"time"}}
    before = dataset["position"].encoding.copy()
    back = read(write(dataset, tmp_path / "it.nc"))
    xr.testing.assert_equal(back, dataset)
    assert back["position"].dtype == np.float64
    assert dataset["position"].encoding == before
    netCDF4 = pytest.importorskip("netCDF4")
    with netCDF4.Dataset(tmp_path / "it.nc") as file:
        assert not file.dimensions["time"].isunlimited()


def test_strings_of_any_kind_and_empty_arrays_come_back(tmp_path):
    dataset = xr.Dataset(
        {
            "none": ("nothing", np.zeros(0)),
            "words": ("word", np.array(["Å", "", "catenary "], dtype=object)),
            "pairs": (("word", "side"), [["a", "bb"], ["", "é"], ["x", "y"]]),
        }
    )
    back = read(write(dataset, tmp_path / "it.nc"))
    assert back["words"].dtype.kind == "U"
    assert back["words"].values.tolist() == ["Å", "", "catenary "]
    xr.testing.assert_identical(back.drop_attrs(), dataset)


def test_time_stays_in_elapsed_seconds(tmp_path):
    dataset = make_trajectory()
    # xarray knows this spelling as a unit of time spans, and "s" only in some versions
    dataset["duration"] = xr.DataArray(124.0, attrs={"units": "seconds", "long_name": "length of the run"})
    dataset["instant"] = xr.DataArray(0.0, attrs={"units": "s since 2030-01-01", "long_name": "clock at the start"})
    back = read(write(dataset, tmp_path / "it.nc"))
    assert back["time"].dtype == np.float64
    assert back["instant"].dtype == np.float64
    assert back["duration"].dtype == np.float64
    assert back["time"].attrs["units"] == "s"


def test_a_lazy_read_gives_the_same_values_in_chunks(tmp_path):
    dataset = make_ensemble()
    dask = pytest.importorskip("dask.array")
    path = write(dataset, tmp_path / "it.nc")
    with read(path, chunks={"time": 5}) as lazy:
        assert isinstance(lazy["position"].data, dask.Array)
        assert lazy["position"].chunks[1] == (5, 5, 5, 5)
        assert lazy["motion_upper_x_kind"].dtype == dataset["motion_upper_x_kind"].dtype
        xr.testing.assert_identical(lazy.compute(), read(path))
        # its way back to a file, which needs no more memory than a chunk
        first = write(lazy.isel(member=0, time=0, particle=0, coordinate=0), tmp_path / "first.nc")  # has lazy scalars
        assert float(read(first).position) == float(dataset.position[0, 0, 0, 0])
        again = write(lazy, tmp_path / "again.nc")
    assert not is_open(path)
    xr.testing.assert_identical(read(again), read(path))


def test_a_lazy_read_without_dask_says_so(tmp_path, monkeypatch):
    path = write(make_scene(), tmp_path / "it.nc")
    monkeypatch.setitem(sys.modules, "dask", None)  # as if it were not installed
    with pytest.raises(ArchiveError, match="needs dask; install it, or read without chunks"):
        read(path, chunks={})


def encodings(dataset, path):
    """How the variables of a dataset lie in its file."""
    with xr.open_dataset(write(dataset, path), decode_times=False) as file:
        return {name: variable.encoding for name, variable in file.variables.items()}


def test_large_float_arrays_are_compressed_in_complete_rows_of_particles(tmp_path):
    encoding = encodings(make_trajectory(times=3000, particles=41), tmp_path / "it.nc")
    position = encoding["position"]
    assert (position["zlib"], position["complevel"], position["shuffle"]) == (True, 4, True)
    # about 1 MB, counted in whole rows
    assert position["chunksizes"] == (2**20 // (41 * 2 * 8), 41, 2)
    assert not encoding["tension_maximum"]["zlib"]
    assert (encoding["coordinate"]["dtype"], encoding["coordinate"]["char_dim_name"]) == ("S1", "coordinate_characters")


def test_chunks_are_cut_along_member_only_when_all_times_fit(tmp_path):
    shape = (64, 100, 41, 2)  # 65.6 kB a member
    ensemble = xr.Dataset({"position": (("member", "time", "particle", "coordinate"), np.zeros(shape))})
    assert encodings(ensemble, tmp_path / "it.nc")["position"]["chunksizes"] == (15, 100, 41, 2)
    modes = xr.Dataset({"mode_shape": (("mode", "particle"), np.zeros((60, 4000)))})
    assert encodings(modes, tmp_path / "modes.nc")["mode_shape"]["chunksizes"] == (60, 4000)


def test_fill_values_are_declared_only_where_data_have_gaps(tmp_path):
    def filled(dataset, name):
        return {key for key, item in encodings(dataset, tmp_path / f"{name}.nc").items() if "_FillValue" in item}

    assert filled(make_ensemble(), "ensemble") == {"position"}
    gap = xr.Dataset({"a": ("m", [1.0, np.nan])}, {"cable_top_tension": ("m", [np.nan, 2.0])})
    assert filled(gap, "gap") == {"a"}
    assert np.isnan(encodings(gap, tmp_path / "again.nc")["a"]["_FillValue"])
    if find_spec("dask"):  # what a lazy variable holds is not known before it is computed
        assert "position" in filled(make_trajectory().chunk(), "lazy")


@pytest.mark.parametrize("value", ["", "é", 3, 2.5, np.float32(1.5), [1, 2], (0.5, 1.0), np.arange(3), ["a", "b"]])
def test_attributes_that_netcdf_can_hold_come_back(value, tmp_path):
    scene = make_scene().assign_attrs(note=value)
    scene["gravity"].attrs["note"] = value
    back = read(write(scene, tmp_path / "it.nc"))
    xr.testing.assert_identical(back, scene.assign_attrs({**back.attrs, "note": value}))
