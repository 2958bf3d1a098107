"""A flipped bit in any file of an ensemble is seen when the ensemble is opened or its values are read."""

from __future__ import annotations

import numpy as np
import pytest
from damage import flipped

import cablepod as cp


@pytest.mark.parametrize("name", ["batch_0000.nc", "scenes.nc", "manifest.json"])
@pytest.mark.parametrize("flips", [15, pytest.param(500, marks=pytest.mark.slow)])
@pytest.mark.usefixtures("without_search")
def test_a_flipped_bit_is_seen(name, flips, copied):
    content = (copied / name).read_bytes()
    for seed in range(flips):
        (copied / name).write_bytes(flipped(content, seed))
        with pytest.raises(cp.ArchiveError):
            cp.archive.open_ensemble(copied).load()
    (copied / name).write_bytes(content)
    cp.archive.open_ensemble(copied).load()


@pytest.mark.parametrize(
    ("old", "new"), [('"crc32"', '"brc32"'), ('"batch": 4, ', '"batch":4, ')], ids=["name of the checksum", "form"]
)
def test_a_changed_manifest_is_seen_though_its_values_are_the_same(old, new, copied):
    text = (copied / "manifest.json").read_text()
    assert old in text
    (copied / "manifest.json").write_text(text.replace(old, new))
    with pytest.raises(cp.ArchiveError, match=r"manifest\.json: changed since it was written"):
        cp.archive.open_ensemble(copied)


def test_an_edit_is_named_when_it_is_read_and_taken_on_demand(finished, copied, request):
    netCDF4 = pytest.importorskip("netCDF4")
    with netCDF4.Dataset(copied / "batch_0001.nc", "r+") as file:
        file.variables["position"][0, 0] = 0.0
    with pytest.raises(cp.ArchiveError, match=r"batch_0001\.nc: is damaged or edited.*verify=False"):
        cp.archive.open_ensemble(copied)
    edited = cp.archive.open_ensemble(copied, verify=False)
    assert not edited["position"][4, 0].values.any()
    # with the size that it had, as after an edit in place of a large file: seen in the pass over its values
    request.getfixturevalue("large_files")
    seal = (finished / "batch_0001.nc").read_bytes()[(copied / "batch_0001.nc").stat().st_size :]
    with (copied / "batch_0001.nc").open("ab") as file:
        file.write(seal)
    opened = cp.archive.open_ensemble(copied)
    np.testing.assert_array_equal(opened["position"][:4], cp.archive.open_ensemble(finished)["position"][:4])
    with pytest.raises(cp.ArchiveError, match=r"batch_0001\.nc: changed since it was written: position;"):
        opened["position"][4].load()
