"""Segments and attachments of the cables of guys: a rigid mast against single cables, equilibrium, refusals, members."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest
from mast_scenes import INSULATOR, SMALL, THINGS, WIND, small

import cablepod as cp
from cablepod.errors import SceneError

#: A mast that does not move.
RIGID = {"height": 30.0, "bending_stiffness": 1e14, "mass": 1e6, "base": "clamped", "elements": 8, "modes": 2}


def tables(things: dict[str, Any], *, mast: dict[str, Any] | None = None, **others: Any) -> dict[str, Any]:
    """Tables of the small mast with things on its guys."""
    result = copy.deepcopy(SMALL)
    result["cables"]["guy"] |= copy.deepcopy(things)
    if mast is not None:
        result["mast"] = dict(mast)
    return result | copy.deepcopy(others)


def single(of_mast: dict[str, Any], anchor: Any) -> Any:
    """The scene of one guy of a mast alone, from its anchor to the straight mast."""
    guy, cable = of_mast["guy"][0], dict(of_mast["cables"]["guy"])
    lists = {name: cable.pop(name) for name in ("segment", "attachment") if name in cable}
    shared = {
        name: of_mast[name] for name in ("temperature", "wind", "ice", "damping", "time", "chain") if name in of_mast
    }
    ends = {"lower": np.asarray(anchor).tolist(), "upper": [0.0, guy["level"], 0.0]}
    return cp.make_scene({"cable": {**cable, "top_tension": guy["top_tension"]}, "ends": ends, **lists, **shared})


# --- the scene ----------------------------------------------------------------------------------------------------------


def test_key_paths_have_two_forms() -> None:
    nested = tables(THINGS)
    dotted = {name: table for name, table in nested.items() if name != "cables"}
    for name, value in nested["cables"]["guy"].items():
        if name not in THINGS:
            dotted[f"cables.guy.{name}"] = value
            continue
        for number, table in enumerate(value, start=1):
            dotted |= {f"cables.guy.{name}.{number}.{key}": entry for key, entry in table.items()}
    dotted["cables.guy.segment.2.to"] = 1.0  # a table without keys has no paths
    assert cp.make_scene(dotted).identical(cp.make_scene(nested))


def test_variables_are_those_of_the_tables(tmp_path: Any) -> None:
    scene = cp.make_scene(tables(THINGS))
    assert float(scene.cables_guy_attachment_1_mass) == 15.0
    assert scene.cables_guy_attachment_1_mass.units == "kg"
    assert float(scene.cables_guy_segment_2_to) == 1.0
    cp.archive.write(scene, tmp_path / "mast.nc")
    read = cp.archive.read(tmp_path / "mast.nc")
    assert read.drop_attrs().identical(scene.drop_attrs())
    assert cp.mast.rest(read).guy_tension.equals(cp.mast.rest(scene).guy_tension)


#: Beside what a single cable refuses, see scene/test_nonuniform.py.
REFUSED = [
    ({"attachment": [{"distance_from_lower": 40.0, "mass": 1.0}]}, "cables.guy.attachment.1.distance_from_lower: given 40.0"),
    (
        {"attachment": [{"arc_length": 0.5, "spring": 1.0, "direction": [1.0, 0.0]}]},
        "cables.guy.attachment.1.direction: given 2 numbers; allowed: 3 numbers",
    ),
    (
        {"attachment": [{"arc_length": 0.5, "mass": 1.0}, {"arc_length": 0.5, "mass": 2.0}]},
        "cables.guy.attachment.2.arc_length: given 0.5; allowed: another place than that of cables.guy.attachment.1",
    ),
    ({"attachments": []}, "cables.guy.attachments: unknown key"),
]  # fmt: skip


@pytest.mark.parametrize(("things", "message"), REFUSED)
def test_they_are_refused_by_key(things: dict[str, Any], message: str) -> None:
    with pytest.raises(SceneError) as error:
        cp.make_scene(tables(things))
    assert str(error.value).startswith(message)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("attachment_1_mass", -1.0, r"attachment\.1\.mass: given -1\.0"),
        ("attachment_1_distance_from_lower", 50.0, r"attachment\.1\.distance_from_lower: given 50\.0"),
        ("attachment_2_distance_from_upper", 50.0, r"attachment\.2\.distance_from_upper: given 50\.0"),
        ("segment_1_to", 1.2, r"segment\.1\.to: given 1\.2"),
        ("segment_2_to", 0.9, r"segment\.2\.to: given 0\.9"),
    ],
)
def test_scenes_that_were_changed_by_hand_are_checked(name: str, value: float, message: str) -> None:
    scene = cp.make_scene(tables(THINGS))
    changed = scene.assign({f"cables_guy_{name}": scene[f"cables_guy_{name}"].copy(data=value)})
    for call in (cp.mast.rest, cp.mast.simulate):
        with pytest.raises(SceneError, match=rf"^cables\.guy\.{message}"):
            call(changed)


def test_nan_is_no_place_of_an_attachment() -> None:
    scene = cp.make_scene(tables(THINGS)).assign(cables_guy_attachment_2_distance_from_upper=np.nan)
    with pytest.raises(
        SceneError, match=r"^scene: cables_guy_attachment_2_distance_from_upper: given nan; allowed: a finite"
    ):
        cp.mast.rest(scene)


def test_lists_of_a_single_cable_are_those_of_a_cable_here() -> None:
    for name in ("segment", "attachment"):
        with pytest.raises(SceneError, match=rf"^{name}: unknown key .* try: cables\.NAME\.{name}$"):
            cp.make_scene(tables({}) | {name: THINGS[name]})


def test_a_cable_without_guys_has_none() -> None:
    spare = {**SMALL["cables"]["guy"], "attachment": [INSULATOR]}
    with pytest.raises(SceneError, match=r"^cables\.spare\.attachment\.1: given for a cable that no guy has"):
        cp.make_scene(tables({}) | {"cables": {**SMALL["cables"], "spare": spare}})


def test_names_of_cables_are_no_paths_of_lists() -> None:
    cable = SMALL["cables"]["guy"]
    with pytest.raises(SceneError, match=r"^cables\.guy_segment_1: given"):
        cp.make_scene(tables({}) | {"cables": {"guy": cable, "guy_segment_1": cable}})


@pytest.mark.parametrize("guys", ["condensed", "catenary"])
def test_other_kinds_of_guys_refuse_them(guys: str) -> None:
    scene = cp.make_scene(tables({"attachment": [INSULATOR]}))
    with pytest.raises(SceneError, match=rf'^cables\.guy\.attachment\.1: given; allowed: none with guys "{guys}"'):
        cp.mast.simulate(scene, guys=guys)
    with pytest.raises(SceneError, match=r"^cables\.guy\.segment\.1: given"):
        cp.mast.frequencies(cp.make_scene(tables({"segment": [{}]})), guys="condensed")
    with pytest.raises(SceneError, match=r"^rank: given .* as a guy has cables\.guy\.attachment\.1"):
        cp.mast.simulate(scene, rank=4)


def test_too_few_links_are_refused() -> None:
    scene = cp.make_scene(tables(THINGS, chain={"links": 2}))
    with pytest.raises(SceneError, match=r"^chain\.links: given 2; allowed: at least 3"):
        cp.mast.simulate(scene)
    with pytest.raises(SceneError, match=r"^links: given 2; allowed: at least 3"):
        cp.mast.simulate(cp.make_scene(tables(THINGS)), links=2)


# --- rest ---------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("others", [{}, {"ice": {"thickness": 0.01}}, {"temperature": -30.0}])
def test_guys_of_a_rigid_mast_at_rest_are_single_cables(others: dict[str, Any]) -> None:
    parts = [{**THINGS["segment"][0], "thermal_expansion": 2.3e-5}, {}]
    mast = {**RIGID, "diameter": 0.1, "thermal_expansion": 0.0}
    of_mast = tables({**THINGS, "segment": parts, "thermal_expansion": 1.2e-5}, mast=mast, **others)
    rest = cp.mast.rest(cp.make_scene(of_mast))
    for g in range(3):
        cable = cp.catenary.rest(single(of_mast, rest.anchor[g]))
        # the deflection of the mast changes the guys by 1e-9
        np.testing.assert_allclose(rest.guy_tension[g], cable.tension_upper, rtol=1e-8)
        np.testing.assert_allclose(rest.guy_tension_anchor[g], cable.tension_lower, rtol=1e-8)
        np.testing.assert_allclose(rest.guy_length[g], cable.unstretched_length, rtol=1e-13)


def test_mean_drag_is_that_of_segments_and_attachments() -> None:
    of_mast = tables(THINGS, mast=RIGID, wind=WIND)
    scene = cp.make_scene(of_mast)
    rest = cp.mast.rest(scene)
    for g in range(2):
        ends = []
        for links in (80, 160):
            tension = cp.chain.rest(single(of_mast, rest.anchor[g]), links=links).tension.values
            ends.append(tension[[-1, 0]])  # half a link from the ends: an error of first order
        limit = 2.0 * ends[1] - ends[0]
        found = [rest.guy_tension[g], rest.guy_tension_anchor[g]]
        np.testing.assert_allclose(found, limit, rtol=1e-4)  # the profile between points of the chain's air: 5e-5
    bare = cp.mast.rest(cp.make_scene(tables({**THINGS, "attachment": []}, mast=RIGID, wind=WIND)))
    assert np.abs(rest.guy_tension / bare.guy_tension - 1.0).max() > 0.01  # what is compared is not small


def test_equal_segments_and_masses_of_zero_are_none() -> None:
    none = {"segment": [{"to": 0.4}, {}], "attachment": [{"arc_length": 0.5, "mass": 0.0}]}
    results = []
    for things in ({}, none):
        scene = cp.make_scene(tables(things, wind=WIND, time={"duration": 0.4, "interval": 0.04}))
        outputs = ("displacement", "guy_tension", "guy_force")
        results.append((cp.mast.rest(scene), cp.mast.simulate(scene, guys="chain", outputs=outputs)))
    for own, other in zip(*results, strict=True):
        for name in ("guy_tension", "guy_force", "displacement"):
            size = float(np.abs(own[name]).max())
            np.testing.assert_allclose(other[name], own[name], rtol=0.0, atol=1e-12 * size)


def test_loads_and_reactions_are_in_equilibrium() -> None:
    heavy = {"segment": THINGS["segment"], "attachment": [{"distance_from_upper": 4.0, "mass": 40.0}, INSULATOR]}
    scene = cp.make_scene(
        tables(heavy, mast={**SMALL["mast"], "load": [{"level": 30.0, "force": [900.0, 0.0, 400.0]}]})
    )
    rest = cp.mast.rest(scene)
    guys = float((rest.guy_length * 3.8e-5 * (0.3 * 5000.0 + 0.7 * 8000.0) + 40.0 + 15.0).sum())
    weight = 9.81 * (20.0 * 30.0 + guys)
    total = rest.foot_force + rest.anchor_force.sum("guy")
    np.testing.assert_allclose(total, [900.0, -weight, 400.0], atol=1e-6 * weight)
    # each guy carries its own weight
    own = (rest.guy_force + rest.anchor_force).values
    np.testing.assert_allclose(own[:, 1], -9.81 * guys / 3.0, rtol=1e-9)
    assert np.abs(own[:, [0, 2]]).max() < 1e-6


# --- small vibrations ---------------------------------------------------------------------------------------------------


def test_frequencies_of_guys_of_a_rigid_mast_are_those_of_cables() -> None:
    springs = [INSULATOR, {"distance_from_upper": 10.0, "spring": 300.0, "direction": "normal"}]
    of_mast = tables({**THINGS, "attachment": springs}, mast=RIGID, chain={"links": 40})
    scene = cp.make_scene(of_mast)
    found = cp.mast.frequencies(scene, count=18)
    of_cable = cp.cable.frequencies(single(of_mast, cp.mast.rest(scene).anchor[0]), count=6, law="linear")
    assert found.attrs["guys"] == "chain"
    expected = np.repeat(of_cable.angular_frequency, 3)
    np.testing.assert_allclose(found.angular_frequency, expected, rtol=2e-4)  # 40 links


def test_frequencies_of_chains_are_those_of_condensed_guys() -> None:
    scene = small()
    found = [cp.mast.frequencies(scene, guys=guys, count=10).angular_frequency for guys in ("chain", "condensed")]
    np.testing.assert_allclose(found[0], found[1], rtol=5e-4)  # order "leading" of condensed guys


def test_given_tensions_hold_at_the_reference_temperature_of_guys_and_mast() -> None:
    mast = {**SMALL["mast"], "thermal_expansion": 1.2e-5}
    of_mast = tables({**THINGS, "thermal_expansion": 2.3e-5}, mast=mast, temperature=-40.0)
    rest = cp.mast.rest(cp.make_scene(of_mast))
    cable = cp.catenary.rest(single(of_mast, rest.anchor[0]))
    np.testing.assert_allclose(rest.guy_length[0], cable.unstretched_length, rtol=1e-13)
    assert float(np.abs(rest.guy_tension[0] / cable.tension_upper - 1.0)) > 0.01  # the mast is shorter and leans


# --- storms -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("things", [{}, THINGS])
def test_guys_of_a_rigid_mast_in_gusts_are_chains(things: dict[str, Any]) -> None:
    of_mast = tables(things, mast=RIGID, wind=WIND, time={"duration": 10.0, "interval": 0.05})
    scene = cp.make_scene(of_mast)
    rest, field = cp.mast.rest(scene), cp.wind.field(scene)
    run = cp.mast.simulate(scene, guys="chain", links=24, outputs=("displacement", "guy_tension", "anchor_force"))
    assert float(np.abs(run.displacement).max()) < 1e-6
    for g in range(2):
        own = field.isel(point=np.flatnonzero(field.guy.values == g + 1))
        chain = cp.chain.simulate(
            single(of_mast, rest.anchor[g]), wind=own, links=24, times=run.time.values, outputs=("tension",)
        )
        tension, on_mast = chain.tension.isel(link=-1).values, run.guy_tension.isel(guy=g).values
        difference = (on_mast - on_mast.mean()) - (tension - tension.mean())
        # half a link carries wind and weight at the mast: 0.2 to 0.6 %, half of that with 48 links; the viscosity of the links
        # damps axial vibrations of the insulator, 0.8 %, of which 0.3 % are left with a tenth of it; things change std by 50 %
        assert difference.std() < 0.01 * tension.std()
        assert abs(on_mast.mean() - tension.mean()) < 5e-4 * tension.mean()
        # forces on anchors follow from those on the mast as if the guy moved symmetrically: 10 % with things, 1 % without
        at_anchor, found = chain.tension.isel(link=0).values, np.linalg.norm(run.anchor_force.isel(guy=g), axis=-1)
        assert (found - at_anchor).std() < (0.12 if things else 0.02) * at_anchor.std()
        assert abs(found.max() / at_anchor.max() - 1.0) < 2e-3


def test_members_vary_mass_and_place() -> None:
    scene = cp.make_scene(tables({"attachment": [INSULATOR]}, time={"duration": 0.2, "interval": 0.1}))
    ranges = {"cables.guy.attachment.1.mass": [0.0, 30.0], "cables.guy.attachment.1.distance_from_lower": [4.0, 8.0]}
    members = cp.ensemble.design(scene, ranges, members=4, sampling="grid")
    rest, run = cp.mast.rest(members), cp.mast.simulate(members)
    assert run.attrs["guys"] == "chain"  # of the members without a mass too
    for k in range(4):
        place, mass = (float(rest[f"cables_guy_attachment_1_{name}"][k]) for name in ("distance_from_lower", "mass"))
        one = cp.make_scene(tables({"attachment": [{**INSULATOR, "mass": mass, "distance_from_lower": place}]}))
        np.testing.assert_allclose(
            rest.guy_tension_anchor.isel(member=k), cp.mast.rest(one).guy_tension_anchor, rtol=1e-12
        )
    assert np.ptp(rest.guy_tension_anchor.values) > 50.0


def test_a_range_beyond_the_cable_is_refused() -> None:
    ensemble = {"members": 2, "ranges": {"cables.guy.attachment.1.distance_from_lower": [4.0, 50.0]}}
    with pytest.raises(SceneError, match=r"^ensemble\.ranges\.cables\.guy\.attachment\.1\.distance_from_lower: given"):
        cp.make_scene(tables({"attachment": [INSULATOR]}, ensemble=ensemble))


def test_a_mass_without_effect_changes_no_motion_with_a_rupture() -> None:
    levels = [{**SMALL["guy"][0], "level": 14.0, "breaks": 0.30005, "breaks_number": 2}, SMALL["guy"][0]]
    runs = []
    for things in ({}, {"attachment": [{"arc_length": 0.5, "mass": 1e-9, "drag_area": 1e-12}]}):
        # a tenth of a second later the loose guys go slack, where rounding grows
        scene = cp.make_scene(tables(things, guy=levels, time={"duration": 0.4, "interval": 0.02}))
        runs.append(cp.mast.simulate(scene, guys="chain").guy_tension)
    assert (runs[1].isel(guy=1)[runs[1].time > 0.31] == 0.0).all()
    # N: rounding of the rest, 1e-11 of the stiffness of a link
    np.testing.assert_allclose(runs[1], runs[0], rtol=0.0, atol=1e-5)


def steady(mapping: dict[str, Any], speed: float) -> Any:
    """A scene in steady wind, without loads of the mast."""
    mapping["mast"] = {name: value for name, value in mapping["mast"].items() if name != "load"}
    wind = {"speed": speed, "direction": WIND["direction"]}
    return cp.make_scene(mapping | {"wind": wind, "time": {"duration": 0.6, "interval": 0.02}})


def test_nothing_moves_in_steady_wind() -> None:
    run = cp.mast.simulate(steady(tables(THINGS, mast={**SMALL["mast"], "drag_area": 0.3}), 25.0))
    assert float(np.ptp(run.displacement.values, axis=0).max()) < 1e-9
    np.testing.assert_allclose(run.guy_tension, run.guy_tension[[0] * run.sizes["time"]], rtol=1e-7)


def test_steps_follow_the_drag_on_light_particles() -> None:
    light = {"density": 800.0, "youngs_modulus": 1e10, "attachment": [{"arc_length": 0.5, "drag_area": 8.0}]}
    run = cp.mast.simulate(steady(tables(light), 15.0))
    np.testing.assert_allclose(run.guy_tension, run.guy_tension[[0] * run.sizes["time"]], rtol=1e-6)


@pytest.mark.slow
def test_run_and_design_take_them(tmp_path: Any) -> None:
    scene = cp.make_scene(tables({"attachment": [INSULATOR]}, wind=WIND, time={"duration": 2.0, "interval": 0.1}))
    study = cp.study.run(scene, tmp_path / "run")
    assert study["motion"].attrs["guys"] == "chain"
    table = cp.study.design(scene, directions=[0.0, 3.0], speeds=[10.0, 15.0], storms=1)
    assert np.isfinite(table.guy_tension_peak).all()
    with_none = cp.study.design(cp.make_scene(tables({}, wind=WIND, time={"duration": 2.0, "interval": 0.1})),
                                directions=[0.0, 3.0], speeds=[10.0, 15.0], storms=1)  # fmt: skip
    assert float(np.abs(table.guy_tension_peak / with_none.guy_tension_peak - 1.0).max()) > 1e-3
