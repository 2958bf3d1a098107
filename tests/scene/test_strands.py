"""The table of strands, and a cable that names one."""

from __future__ import annotations

import csv
import math

import numpy as np
import pytest

import cablepod as cp
from cablepod import examples

ENDS = {"lower": [0.0, 0.0], "upper": [20.0, 50.0]}
INCH, POUND, POUND_FORCE, THOUSAND_FEET = 0.0254, 0.45359237, 4.4482216152605, 304.8


def rows():
    with (examples.data_folder() / "strands.csv").open(newline="", encoding="utf-8") as file:
        return {row["name"]: row for row in csv.DictReader(line for line in file if not line.startswith("#"))}


#: ASTM A475, Table 1, extra high strength: wires, their diameter [in], weight [lb per 1000 ft], breaking strength [lbf].
EXTRA_HIGH_STRENGTH = {
    "3/16": (7, 0.062, 73, 3990), "1/4": (7, 0.080, 121, 6650), "5/16": (7, 0.104, 205, 11200), "3/8": (7, 0.120, 273, 15400),
    "7/16": (7, 0.145, 399, 20800), "1/2": (7, 0.165, 517, 26900), "9/16": (7, 0.188, 671, 35000),
    "5/8": (7, 0.207, 813, 42400), "3/4": (19, 0.150, 1155, 58300),
}  # fmt: skip


@pytest.mark.parametrize("size", EXTRA_HIGH_STRENGTH)
def test_extra_high_strength_is_the_standards_in_si(size):
    wires, diameter, weight, strength = EXTRA_HIGH_STRENGTH[size]
    row = rows()[f"EHS {size} in"]
    numbers = [float(row[name]) for name in ("area_m2", "mass_kg_per_m", "breaking_strength_N")]
    area = wires * math.pi / 4.0 * (diameter * INCH) ** 2
    expected = [area, weight * POUND / THOUSAND_FEET, strength * POUND_FORCE]
    np.testing.assert_allclose(numbers, expected, rtol=5e-5)  # five digits in the table
    # the table of the standard is consistent: steel with some zinc and lay, one grade of wire
    assert 7850.0 < numbers[1] / numbers[0] < 8050.0
    assert 1.15e9 < numbers[2] / numbers[0] < 1.4e9


def test_wire_ropes_follow_the_factors_of_the_standard():
    # EN 12385-4, 6x36 with a steel core: mass W d2 / 100 [kg/m, mm], area C d2 [mm2], force K d2 R / 1000 [kN], R = 1770 MPa
    for row in (row for name, row in rows().items() if name.startswith("6x36")):
        d = 1e3 * float(row["diameter_m"])
        assert float(row["mass_kg_per_m"]) == pytest.approx(0.409 * d**2 / 100.0, rel=5e-5)
        assert float(row["area_m2"]) == pytest.approx(0.460e-6 * d**2, rel=5e-5)
        assert float(row["breaking_strength_N"]) == pytest.approx(0.356 * d**2 * 1770.0, rel=5e-6)


def test_prestressing_strands_have_the_strength_of_their_name():
    for row in (row for name, row in rows().items() if name.startswith("Y1860")):
        assert float(row["breaking_strength_N"]) / float(row["area_m2"]) == pytest.approx(1.860e9, rel=2e-3)  # 1 kN
        assert float(row["mass_kg_per_m"]) / float(row["area_m2"]) == pytest.approx(7810.0, rel=1e-3)  # as prEN 10138


@pytest.mark.parametrize("name", rows())
def test_a_strand_makes_a_usual_scene(name):
    tension = 0.1 * float(rows()[name]["breaking_strength_N"])  # the usual tension of a guy
    numbers = cp.summary(cp.make_scene({"cable": {"strand": name, "top_tension": tension}, "ends": ENDS}))
    row = rows()[name]
    assert float(numbers.utilisation) == pytest.approx(0.1, rel=1e-12)
    assert float(numbers.mass_per_length) == pytest.approx(float(row["mass_kg_per_m"]), rel=1e-12)
    assert float(numbers.axial_stiffness) == pytest.approx(float(row["youngs_modulus_Pa"]) * float(row["area_m2"]))
    assert str(numbers.note.values) == ""
    assert row["source"]


def test_given_keys_stay():
    cable = {"strand": "EHS 1/2 in", "top_tension": 12000.0}
    given = {"youngs_modulus": 1.6e11, "specific_weight": 80000.0, "breaking_strength": 1e5}
    scene = cp.make_scene({"cable": {**cable, **given}, "ends": ENDS})
    assert {key: float(scene[f"cable_{key}"]) for key in given} == given
    assert "cable_density" not in scene
    assert float(scene.cable_area) == float(rows()["EHS 1/2 in"]["area_m2"])
    assert float(scene.cable_diameter) == 0.5 * INCH
    assert str(scene.cable_strand.values) == "EHS 1/2 in"


def test_a_scene_with_a_strand_runs_and_is_archived(tmp_path):
    scene = cp.make_scene(
        {
            "cable": {"strand": "EHS 1/2 in", "top_tension": 12000.0},
            "ends": ENDS,
            "motion": {"upper": {"x": {"kind": "ramp", "amplitude": -0.02, "duration": 1.0}}},
            "time": {"duration": 2.0, "interval": 0.5},
            "chain": {"links": 8},
        }
    )
    modes = cp.condensed.vibration_modes(scene, rank=2)
    run = cp.condensed.simulate(scene, modes)
    assert np.isfinite(run.position).all()
    prepared = cp.condensed.prepare(scene, modes)
    assert np.isfinite(prepared.run().amplitude).all()
    cp.archive.write(scene, tmp_path / "scene.nc")
    again = cp.archive.read(tmp_path / "scene.nc")
    assert cp.chain.rest(again).equals(cp.chain.rest(scene))
    members = cp.ensemble.design(scene, {"cable.top_tension": [1e4, 1.2e4]}, members=3)
    assert np.isfinite(cp.condensed.simulate(members, modes).position).all()


@pytest.mark.parametrize(
    ("name", "match"),
    [
        ("EHS 1/2", r"^cable\.strand: given 'EHS 1/2'; allowed: one of \"EHS 3/16 in\", .*; try: EHS 1/2 in"),
        ("ehs 3/8 in", r"; try: EHS 3/8 in"),
        ("rope", r'"6x36WS-IWRC 1770 24 mm"$'),
        (5, r"^cable\.strand: given 5; allowed: one of"),
        (None, r"^cable\.strand: given None; allowed: one of"),
    ],
)
def test_an_unknown_strand_is_refused(name, match):
    with pytest.raises(cp.SceneError, match=match):
        cp.make_scene({"cable": {"strand": name, "top_tension": 12000.0}, "ends": ENDS})
