"""The numbers printed in the paper, as they are kept beside the scenes."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import DATA

import cablepod as cp


def table(name: str) -> dict[str, np.ndarray]:
    lines = [line for line in (DATA / name).read_text().splitlines() if not line.startswith("#")]
    header, *rows = [line.split(",") for line in lines]
    assert len(set(header)) == len(header)
    assert all(len(row) == len(header) for row in rows)
    return {key: np.array([row[i] for row in rows]) for i, key in enumerate(header)}


def numbers(name: str) -> dict[str, np.ndarray]:
    return {key: np.array([float(item or "nan") for item in column]) for key, column in table(name).items()}


def guy(scenes, **cable):
    """Example 1 with another cable: its rest."""
    import tomllib

    mapping = tomllib.loads((scenes / "example1.toml").read_text())
    mapping["cable"] |= cable
    return cp.catenary.rest(cp.make_scene(mapping), points=2001)


def test_every_table_names_its_source_and_is_told_of(scenes):
    told = (DATA / "README.md").read_text()
    paths = sorted(DATA.glob("*.csv"))
    assert [path.stem for path in paths] == [
        "auto07p", "energy_shares", "examples", "starts", "strands", "table1", "table2",
    ]  # fmt: skip
    assert all(path.name in told for path in paths)
    for path in (
        path for path in paths if path.stem not in ("strands", "auto07p")
    ):  # a source for each row; another program
        assert path.read_text().startswith("# ")
        assert "Escalante" in path.read_text().splitlines()[0]
        assert path.name in told


def test_table_1_is_the_guy_but_for_its_soft_rows(scenes):
    printed = numbers("table1.csv")
    np.testing.assert_array_equal(printed["top_tension_N"], printed["stress_kgf_per_cm2"] * 1.25 * 10)
    for i, tension in enumerate(printed["top_tension_N"]):
        rest = guy(scenes, top_tension=tension)
        assert float(rest["stretched_length"]) == pytest.approx(printed["stretched_length_m"][i], abs=1.5e-4)
        elongation = printed["stretched_length_m"][i] - printed["unstretched_length_m"][i]
        assert elongation == pytest.approx(printed["elongation_m"][i], abs=5.1e-4)
        # eq. (16): the inextensible shape (a cable as stiff as allowed), shortened by its tension over K
        stiff = guy(scenes, top_tension=tension, youngs_modulus=1e17)
        assert np.floor(float(stiff["tension_lower"])) == printed["bottom_tension_N"][i]  # the print cuts digits off
        shortening = float(np.trapezoid(stiff["tension"], stiff["arc_length"])) / (2e7 if i == 0 else 2e5)
        unstretched = float(stiff["unstretched_length"]) - shortening
        assert unstretched == pytest.approx(printed["unstretched_length_m"][i], abs=1.5e-4)


def test_table_2_belongs_to_its_sums():
    printed, text = numbers("table2.csv"), table("energy_shares.csv")
    assert list(text["quantity"]) == ["sum_of_singular_values", "cumulative_share"]
    assert list(text["horizontal"]) == ["7.1486", "85.66"]
    assert list(text["vertical"]) == ["2.516", "85.70"]
    np.testing.assert_array_equal(printed["mode"], np.arange(1, 6))
    for axis, total in (("x", 7.1486), ("y", 2.5136)):  # for y the text prints 2.516, see README.md
        shares = 100 * np.cumsum(printed[f"singular_value_{axis}_m"]) / total
        np.testing.assert_allclose(shares, printed[f"cumulative_share_{axis}_percent"], rtol=0, atol=0.011)


def test_the_printed_data_are_those_of_the_scenes(scenes):
    printed, first = numbers("examples.csv"), numbers("table1.csv")
    for i, number in enumerate(printed["example"].astype(int)):
        scene = cp.read_scene(scenes / f"example{number}.toml")
        assert scene.cable_top_tension == printed["top_tension_N"][i]
        assert (scene.motion_upper_x_kind, scene.motion_upper_x_amplitude) == ("one_minus_cosine", -0.07)
        assert scene.motion_upper_x_angular_frequency == printed["angular_frequency_rad_per_s"][i]
        load = scene.get("load_uniform", np.zeros(2))
        weight = scene.cable_specific_weight * scene.cable_area
        np.testing.assert_allclose(load, [printed["load_ratio"][i] * float(weight), 0.0], rtol=1e-14)
        # the printed lengths are those of Table 1, but Examples 3 and 4 have each other's
        row = list(first["unstretched_length_m"]).index(printed["printed_unstretched_length_m"][i])
        assert first["top_tension_N"][row] == {2: 15000, 3: 7500, 4: 3750}[number]
    assert printed["masses"][0] + 1 == scene.chain_links
    assert printed["instants"][0] == round(float(scene.time_duration / scene.time_interval)) + 1


def test_what_the_readme_computes(scenes):
    import tomllib

    softer = guy(scenes, top_tension=1.59e6)
    assert float(softer["unstretched_length"]) == pytest.approx(56.6972, abs=0.02)
    mapping = tomllib.loads((scenes / "example4.toml").read_text())
    mapping["load"]["uniform"][0] *= -1
    rest = cp.catenary.rest(cp.make_scene(mapping))
    assert float(rest["unstretched_length"]) == pytest.approx(61.200083, abs=5e-7)
