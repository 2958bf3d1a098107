"""A table of strands of one's own: what it gives, and what is refused."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from mast_scenes import small

import cablepod as cp
from cablepod import examples

ENDS = {"lower": [0.0, 0.0], "upper": [20.0, 50.0]}
TABLE = """# from the maker's sheet
name,diameter_m,mass_kg_per_m,axial_stiffness_N,breaking_strength_N,area_m2,source
Rope 16,0.016,1.05,1.6e7,2.1e5,,sheet 7
"Rope 20, galvanised",0.020,1.63,2.5e7,3.3e5,1.6e-4,sheet 8
"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "ropes.csv").write_text(TABLE)
    return tmp_path


def scene(folder, **cable):
    table = {"strand_table": str(folder / "ropes.csv"), "top_tension": 12000.0, **cable}
    return cp.make_scene({"cable": table, "ends": ENDS})


def test_a_row_gives_the_keys_of_the_cable(folder):
    found = scene(folder, strand="Rope 16")
    expected = {"diameter": 0.016, "mass_per_length": 1.05, "axial_stiffness": 1.6e7, "breaking_strength": 2.1e5}
    assert {key: float(found[f"cable_{key}"]) for key in expected} == expected
    assert "cable_area" not in found
    assert str(found["cable_strand"].values) == "Rope 16"
    assert float(scene(folder, strand="Rope 20, galvanised")["cable_area"]) == 1.6e-4


def test_the_path_is_that_beside_the_scene_and_no_part_of_the_id(folder, tmp_path, monkeypatch):
    text = '[cable]\nstrand_table = "ropes.csv"\nstrand = "Rope 16"\ntop_tension = 12000.0\n'
    (folder / "guy.toml").write_text(text + "[ends]\nlower = [0.0, 0.0]\nupper = [20.0, 50.0]\n")
    monkeypatch.chdir("/")
    one = cp.read_scene(folder / "guy.toml")
    other = folder / "elsewhere"
    other.mkdir()
    for name in ("guy.toml", "ropes.csv"):
        shutil.copy(folder / name, other)
    assert cp.read_scene(other / "guy.toml").attrs["id"] == one.attrs["id"]
    (other / "ropes.csv").write_text(TABLE.replace("1.05", "1.06"))
    assert cp.read_scene(other / "guy.toml").attrs["id"] != one.attrs["id"]
    cp.archive.write(one, tmp_path / "scene.nc")
    again = cp.archive.read(tmp_path / "scene.nc")
    (folder / "ropes.csv").unlink()  # the numbers are in the scene
    assert cp.catenary.rest(again).equals(cp.catenary.rest(one))
    members = cp.ensemble.design(again, {"cable.top_tension": [1e4, 1.2e4, 2], "cable.mass_per_length": [1.0, 1.1, 2]})
    assert np.isfinite(cp.catenary.rest(members)["unstretched_length"]).all()


def test_given_keys_stay_in_place_of_those_of_the_strand(folder):
    found = scene(folder, strand="Rope 20, galvanised", youngs_modulus=1.5e11, density=9000.0, diameter=0.03)
    assert not {"cable_axial_stiffness", "cable_mass_per_length"} & set(found.data_vars)
    assert float(found["cable_diameter"]) == 0.03


def test_the_shipped_table_is_a_table_too(tmp_path):
    shutil.copy(examples.data_folder() / "strands.csv", tmp_path / "ropes.csv")
    own = cp.summary(scene(tmp_path, strand="EHS 1/2 in"))
    shipped = cp.summary(cp.make_scene({"cable": {"strand": "EHS 1/2 in", "top_tension": 12000.0}, "ends": ENDS}))
    listed: list[str] = []
    for name in ("mass_per_length", "axial_stiffness", "stress", "unstretched_length"):
        assert float(own[name]) == pytest.approx(float(shipped[name]), rel=1e-14)
    for folder in ({}, {"strand_table": str(tmp_path / "ropes.csv")}):  # the same strands are listed
        with pytest.raises(cp.SceneError) as error:
            cp.make_scene({"cable": {"strand": "none", "top_tension": 12000.0, **folder}, "ends": ENDS})
        listed.append(str(error.value).split("allowed: ")[1])
    assert listed[0] == listed[1]


def test_guys_of_a_mast_take_it(folder):
    cable = {"strand": "Rope 16", "strand_table": str(folder / "ropes.csv")}
    scene = small(lambda mapping: mapping["cables"].update(guy=cable))
    assert float(scene["cables_guy_mass_per_length"]) == 1.05
    with pytest.raises(cp.SceneError, match=r"^cables\.guy\.strand: given 'Rope 61'; allowed: one of .*; try: Rope 16"):
        small(lambda mapping: mapping["cables"].update(guy={**cable, "strand": "Rope 61"}))


@pytest.mark.parametrize(
    ("table", "cable", "message"),
    [
        (TABLE, {"strand": "Rope 17"}, r'^cable\.strand: given \'Rope 17\'; allowed: one of "Rope 16", .*; try: Rope 16'),
        (TABLE, {}, r'^cable\.strand: missing beside cable\.strand_table; allowed: one of "Rope 16", "Rope 20, galvanised"$'),
        (TABLE, {"strand_table": 5}, r"^cable\.strand_table: given 5; allowed: "),
        (TABLE, {"strand_table": "/no/such.csv"}, r"^cable\.strand_table: /no/such\.csv: cannot be read: No such file"),
        (TABLE.replace("1.05", "heavy"), {}, r"ropes\.csv, row 1, column mass_kg_per_m: given 'heavy'; allowed: a number, or"),
        (
            TABLE.replace("2.5e7", "-2.5e7"),
            {},
            r"row 2, column axial_stiffness_N: given -25000000\.0; allowed: a finite .* above",
        ),
        (TABLE.replace("mass_kg_per_m", "mass_kg/m"), {}, r"has the column 'mass_kg/m', unknown; .*; try: mass_kg_per_m"),
        (TABLE.replace("area_m2", "diameter_m"), {}, r"ropes\.csv: has the column 'diameter_m', twice; allowed: "),
        (
            TABLE.replace("name,", "rope,"),
            {},
            r"ropes\.csv: has the column 'rope', unknown; allowed: a CSV file with the columns",
        ),
        (TABLE.replace("sheet 7", "sheet 7,8"), {}, r"ropes\.csv, row 1: given 8 cells; allowed: 7, as the header has$"),
        (TABLE.replace('"Rope 20, galvanised"', "Rope 16"), {}, r"row 2, column name: given 'Rope 16'; allowed: a name, another"),
        (TABLE.splitlines()[1], {}, r"ropes\.csv: has no rows; allowed: "),
        ("", {}, r"ropes\.csv: has no column name; allowed: "),
        (TABLE.replace('galvanised"', "galvanised"), {}, r"ropes\.csv: is broken: unexpected end of data; allowed: "),
        ("a\0b", {}, r"ropes\.csv"),
    ],
)  # fmt: skip
def test_broken_tables_and_unknown_strands_are_refused(tmp_path, table, cable, message):
    (tmp_path / "ropes.csv").write_text(table)
    with pytest.raises(cp.SceneError, match=message):
        scene(tmp_path, **cable)


def test_a_strand_that_lacks_what_a_cable_needs(folder):
    (folder / "ropes.csv").write_text(TABLE.replace("1.6e7", ""))
    with pytest.raises(cp.SceneError, match=r"^cable\.youngs_modulus: missing; allowed: Young's modulus"):
        scene(folder, strand="Rope 16")
