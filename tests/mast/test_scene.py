"""The tables of a mast: Dataset, key paths, archive, and one clear error for each mistake."""

from __future__ import annotations

import copy

import numpy as np
import pytest
from mast_scenes import SMALL, WIND, small
from scene_files import put

import cablepod as cp
from cablepod import examples
from cablepod.errors import SceneError


def test_shipped_masts_are_read():
    rest = cp.mast.rest(examples.scene("mast120"))
    assert rest.guy_level.values.tolist() == [40.0] * 3 + [80.0] * 3 + [115.0] * 3
    assert rest.table.values.tolist() == [1] * 3 + [2] * 3 + [3] * 3
    anchors = rest.anchor.values
    np.testing.assert_allclose(np.hypot(anchors[:, 0], anchors[:, 2]), [50.0] * 3 + [80.0] * 6, rtol=1e-14)
    np.testing.assert_allclose(anchors[0], [-50.0, 0.0, 0.0], atol=1e-12)
    assert np.abs(anchors.reshape(3, 3, 3).sum(axis=1)).max() < 1e-12  # evenly round the mast
    assert str(examples.scene("mast30").mast_base.values) == "pinned"


def test_key_paths_have_two_forms():
    nested = small()
    dotted = {key: value for key, value in SMALL.items() if key not in ("mast", "guy")}
    dotted |= {f"mast.{key}": value for key, value in SMALL["mast"].items() if key != "load"}
    dotted |= {f"mast.load.1.{key}": value for key, value in SMALL["mast"]["load"][0].items()}
    dotted |= {f"guy.1.{key}": value for key, value in SMALL["guy"][0].items()}
    assert cp.make_scene(dotted).identical(nested)


def test_sections_override_the_mast():
    # one section with its own stiffness is three that say all
    bounds, stiffness = (0.0, 10.0, 20.0, 30.0), (4e6, 8e6, 4e6)
    every = [
        {"from": low, "to": high, "bending_stiffness": each, "mass": 20.0}
        for low, high, each in zip(bounds, bounds[1:], stiffness, strict=False)
    ]
    middle, all_three, none = (
        cp.mast.frequencies(
            cp.make_scene(put(copy.deepcopy(SMALL), "mast.section", sections)), count=4
        ).angular_frequency
        for sections in ([{"from": 10.0, "to": 20.0, "bending_stiffness": 8e6}], every, [])
    )
    np.testing.assert_array_equal(middle, all_three)
    assert float(abs(middle / none - 1.0).max()) > 1e-3


def test_archive_keeps_a_scene(tmp_path):
    scene = small()
    cp.archive.write(scene, tmp_path / "mast.nc")
    read = cp.archive.read(tmp_path / "mast.nc")
    assert read.drop_attrs().identical(scene.drop_attrs())
    assert cp.mast.rest(read).guy_tension.equals(cp.mast.rest(scene).guy_tension)


def test_ranges_vary_guys():
    scene = small()
    members = cp.ensemble.design(scene, {"guy.1.top_tension": [4000.0, 6000.0]}, members=3, sampling="grid")
    result = cp.mast.rest(members)
    np.testing.assert_allclose(result.guy_tension.isel(guy=0), [4000.0, 5000.0, 6000.0], rtol=1e-9)
    assert "guy_1_top_tension" in result.coords


GUY = SMALL["guy"][0]
ANCHORED = {"cable": "guy", "level": 28.0, "top_tension": 5000.0}


@pytest.mark.parametrize(
    ("path", "value", "key"),
    [
        ("guy.1.level", 31.0, ""),
        ("guy", [{**ANCHORED, "anchor": [0.0, 5.0, 0.0]}], "guy.1.anchor"),
        ("guy", [{**ANCHORED, "anchor": [20.0, 29.0, 0.0]}], "guy.1.anchor"),
        ("guy", [GUY, GUY], "guy.2.level"),
        ("guy", [GUY, {**GUY, "count": 1}], "guy.2.level"),
        ("guy.1.cable", "gyu", ""),
        ("guy", [], ""),
        ("guy.1.top_tension", 20.0, ""),
        ("guy.1.bottom_tension", 5000.0, "guy.1"),
        ("guy.1.top_tension", None, "guy.1"),
        ("guy.1.radius", None, ""),
        ("guy.1.direction", [0.0, 1.0, 0.0], ""),
        ("guy.1.lenght", 1.0, ""),
        ("cables.guy.top_tension", 5000.0, ""),
        ("cables.guy.area", -1.0, ""),
        ("cables.guy.density", 1e30, ""),
        ("mast.base", "free", ""),
        ("mast.heigth", 3.0, ""),
        ("mast.load.1.force", [1.0, 2.0, 3.0], ""),
        ("mast.load.1.level", 99.0, ""),
        ("mast.section", [{"from": 20.0, "to": 10.0}], "mast.section.1.to"),
        (
            "mast.section",
            [{"from": 10.0, "to": 10.008}],
            "mast.section.1.to",
        ),
        ("mast.section", [{"from": 0.0, "to": 10.0}, {"from": 5.0, "to": 15.0}], "mast.section.2.from"),
        ("cable", {"area": 1.0}, ""),
        ("damping.link_viscosity", 1e-3, ""),
        ("wind", {**WIND, "direction": [1.0, 0.0]}, "wind.direction"),
        ("mast", None, ""),
    ],
)
def test_mistakes_are_refused_by_key(path, value, key):
    with pytest.raises(SceneError, match=rf"^{(key or path).replace('.', '[.]')}: .*(allowed|missing)"):
        small(lambda mapping: put(mapping, path, value))


def test_the_record_of_a_load_covers_the_run(tmp_path):
    # a spline beyond its last sample left the finite numbers of a run, or gave numbers of no meaning
    record = tmp_path / "record.csv"
    record.write_text("time,value\n" + "".join(f"{0.5 * k},{k % 3}\n" for k in range(8)), encoding="utf-8")
    load = {"level": 30.0, "force": [100.0, 0.0, 0.0], "kind": "file", "path": str(record)}
    message = r"^mast\.load\.1\.path: the record is too short, from 0 s to 3\.5 s; allowed: .* from 0 s to 4 s$"
    with pytest.raises(SceneError, match=message):
        small(lambda mapping: put(mapping, "mast.load", [load]))
    shorter = small(lambda mapping: (put(mapping, "mast.load", [load]), put(mapping, "time.duration", 3.0)))
    with pytest.raises(SceneError, match=message):
        cp.mast.simulate(shorter, times=np.linspace(0.0, 4.0, 101))


def test_wind_needs_a_diameter():
    with pytest.raises(SceneError, match=r"^cables\.guy\.diameter: missing"):
        small(lambda mapping: (put(mapping, "wind", WIND), put(mapping, "cables.guy.diameter", None)))


def test_a_mast_is_no_cable_and_the_other_way_round():
    with pytest.raises(SceneError, match=r"^mast: .*try: mast\.simulate"):
        cp.chain.simulate(small())
    with pytest.raises(SceneError, match=r"^cable: .*try: chain\.simulate"):
        cp.mast.simulate(examples.scene("example2"))
