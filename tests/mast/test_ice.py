"""Ice on a mast: mass, weight and drag of the beam beside those of the guys."""

from __future__ import annotations

import numpy as np
import pytest
from mast_scenes import SMALL, WIND, small

import cablepod as cp

THICKNESS, DENSITY = 0.02, 800.0


def steady(mapping):
    mapping["wind"] = {**WIND, "direction": [0.6, 0.0, 0.8]}
    del mapping["wind"]["turbulence"]
    del mapping["mast"]["load"]
    mapping["mast"] |= {"drag_area": 0.3, "diameter": 0.05, "member_length": 6.0}
    mapping["mast"]["section"] = [
        {"from": 0.0, "to": 10.0, "mass": 30.0, "drag_area": 0.6, "diameter": 0.4, "member_length": 1.0}
    ]


def test_a_mast_with_ice_is_the_same_mast_with_its_mass_and_width_by_hand():
    def iced(mapping):
        steady(mapping)
        mapping["ice"] = {"thickness": THICKNESS, "density": DENSITY}

    found = cp.mast.rest(small(iced))

    def by_hand(mapping):
        steady(mapping)
        for table, diameter, members in ((mapping["mast"], 0.05, 6.0), (mapping["mast"]["section"][0], 0.4, 1.0)):
            ring = 0.25 * np.pi * ((diameter + 2.0 * THICKNESS) ** 2 - diameter**2)
            table["mass"] += members * DENSITY * ring
            table["drag_area"] *= (diameter + 2.0 * THICKNESS) / diameter
        cable = mapping["cables"]["guy"]
        ring = 0.25 * np.pi * ((cable["diameter"] + 2.0 * THICKNESS) ** 2 - cable["diameter"] ** 2)
        cable["density"] += DENSITY * ring / cable["area"]
        cable["diameter"] += 2.0 * THICKNESS
        del mapping["guy"][0]["top_tension"]
        mapping["guy"][0]["unstretched_length"] = float(found.guy_length[0])

    wanted, bare = cp.mast.rest(small(by_hand)), cp.mast.rest(small(steady))
    for name in ("displacement", "guy_tension", "bending_moment", "axial_compression", "foot_force"):
        scale = float(abs(wanted[name]).max())
        np.testing.assert_allclose(found[name], wanted[name], rtol=0.0, atol=1e-9 * scale, err_msg=name)
        assert float(abs(found[name] - bare[name]).max()) > 0.02 * scale, name
    modes = [cp.mast.frequencies(small(change), count=4).angular_frequency for change in (iced, by_hand, steady)]
    np.testing.assert_allclose(modes[0], modes[1], rtol=1e-9)
    assert float(modes[0][0]) < 0.99 * float(modes[2][0])


def test_ice_on_a_mast_without_diameter_is_refused_by_key():
    with pytest.raises(cp.SceneError, match=r"^mast\.diameter: missing; allowed: a diameter"):
        small(lambda mapping: mapping.update(ice={"thickness": 0.01}))
    assert "ice_thickness" in small(lambda mapping: mapping.update(ice={"thickness": 0.0}))
    with pytest.raises(cp.SceneError, match=r"^ranges\.ice\.thickness: .*mast\.diameter: missing"):
        cp.ensemble.design(small(), {"ice.thickness": [0.0, 0.01]}, members=2)
    with pytest.raises(cp.SceneError, match=r"^mast\.diameter: given 0\.0"):
        small(lambda mapping: mapping["mast"].update(diameter=0.0))
    with pytest.raises(cp.SceneError, match=r"^mast\.section\.1\.member_length: given -1\.0"):
        small(lambda mapping: mapping["mast"].update(section=[{"from": 0.0, "to": 5.0, "member_length": -1.0}]))


def test_without_ice_a_diameter_changes_nothing():
    plain, wide = small(), small(lambda mapping: mapping["mast"].update(diameter=0.1, member_length=3.0))
    assert "mast_diameter" in wide
    assert "mast_diameter" not in plain
    assert SMALL["mast"].get("diameter") is None
    np.testing.assert_array_equal(cp.mast.rest(plain).guy_tension, cp.mast.rest(wide).guy_tension)
    np.testing.assert_array_equal(
        cp.mast.frequencies(plain, count=4).angular_frequency, cp.mast.frequencies(wide, count=4).angular_frequency
    )
