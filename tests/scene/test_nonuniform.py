"""Segments of a cable and attachments: keys, refusals, parameters of scenes and of members."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import cablepod as cp
from cablepod.errors import SceneError
from cablepod.parameters._from_scene import Members, parameters
from cablepod.parameters._nonuniform import attachment_fractions

CABLE = {"youngs_modulus": 1.6e11, "area": 1.25e-4, "density": 8000.0, "unstretched_length": 61.156, "diameter": 0.014}
BASE: dict[str, Any] = {
    "cable": CABLE,
    "ends": {"lower": [0.0, 0.0], "upper": [20.4, 57.7]},
    "chain": {"links": 10},
    "time": {"duration": 1.0, "interval": 0.1},
}
MASS = {"arc_length": 0.5, "mass": 60.0}
SEGMENTS_REFUSED = [
    ([{"from": 0, "to": 0.4}, {"from": 0.5, "to": 1}], "segment.2.from: given 0.5"),
    ([{"from": 0, "to": 0.4}, {"from": 0.3, "to": 1}], "segment.2.from: given 0.3"),
    ([{"from": 0.1, "to": 1}], "segment.1.from: given 0.1"),
    ([{"from": 0, "to": 0.9}], "segment.1.to: given 0.9"),
    ([{"from": 0.4, "to": 1}, {"from": 0, "to": 0.4}, {"from": 0.2, "to": 0.3}], "segment.3.from: given 0.2"),
    ([{"from": 0.5, "to": 0.5}, {"from": 0.5, "to": 1}], "segment.1.to: given 0.5"),
    ([{"from": 0.0}, {"from": 0.5, "to": 1}], "segment.1.to: missing"),
    ([{"to": 1, "area": -1e-4}], "segment.1.area: given -0.0001"),
    ([{"to": 1, "top_tension": 1e4}], "segment.1.top_tension: given"),
    ([{"to": 1, "aera": 1e-4}], "segment.1.aera: unknown key"),
    ([{"to": 1, "density": 8e3, "specific_weight": 8e4}], "segment.1: given"),
    ([{"to": 1, "axial_stiffness": 2e7, "youngs_modulus": 1e11}], "segment.1: given"),
    ([{"to": 1, "sag": 0.3}], "segment.1.sag: given"),
    ([{"to": 1, "area": 1e20}], "segment.1.youngs_modulus: given"),
    ([{"to": 1, "strand": "EHS"}], "segment.1.strand: given 'EHS'"),
    ({"to": 1}, "segment: given"),
]
ATTACHMENTS_REFUSED = [
    ([{"arc_length": 0.0, "mass": 1.0}], "attachment.1.arc_length: given 0.0"),
    ([{"arc_length": 1.0, "mass": 1.0}], "attachment.1.arc_length: given 1.0"),
    ([{"distance_from_upper": 61.156, "mass": 1.0}], "attachment.1.distance_from_upper: given 61.156"),
    ([{"distance_from_lower": 62.0, "mass": 1.0}], "attachment.1.distance_from_lower: given 62.0"),
    ([{"arc_length": 0.5, "distance_from_lower": 1.0, "mass": 1.0}], "attachment.1: given arc_length = 0.5 and"),
    ([{"mass": 1.0}], "attachment.1: given none"),
    ([{"arc_length": 0.5}], "attachment.1: given none of mass"),
    ([{"arc_length": 0.5, "mass": -1.0}], "attachment.1.mass: given -1.0"),
    ([{"arc_length": 0.5, "drag_area": -1.0}], "attachment.1.drag_area: given -1.0"),
    ([{"arc_length": 0.5, "damper": -1.0, "direction": "normal"}], "attachment.1.damper: given -1.0"),
    ([{"arc_length": 0.5, "damper": 1.0}], "attachment.1.direction: missing"),
    ([{"arc_length": 0.5, "spring": 1.0}], "attachment.1.direction: missing"),
    ([{"arc_length": 0.5, "damper": 1.0, "direction": "across"}], "attachment.1.direction: given 'across'"),
    ([{"arc_length": 0.5, "damper": 1.0, "direction": [0.0, 0.0]}], "attachment.1.direction: given [0.0, 0.0]"),
    (
        [{"arc_length": 0.5, "damper": 1.0, "direction": [0.0, 0.0, 1.0]}],
        "attachment.1.direction: given 3 numbers; allowed: 2",
    ),
    ([MASS, {"distance_from_upper": 61.156 / 2, "mass": 1.0}], "attachment.2.distance_from_upper: given 30.578"),
]


@pytest.mark.parametrize(("tables", "message"), SEGMENTS_REFUSED)
def test_segments_are_refused_by_key(tables: Any, message: str) -> None:
    with pytest.raises(SceneError) as error:
        cp.make_scene({**BASE, "segment": tables})
    assert str(error.value).startswith(message)


@pytest.mark.parametrize(("tables", "message"), ATTACHMENTS_REFUSED)
def test_attachments_are_refused_by_key(tables: Any, message: str) -> None:
    with pytest.raises(SceneError) as error:
        cp.make_scene({**BASE, "attachment": tables})
    assert str(error.value).startswith(message)


def test_segment_has_the_keys_of_the_cable_that_it_leaves_out() -> None:
    heavier = {"from": 0.4, "specific_weight": 2 * 8000.0 * 9.81, "area": 2.5e-4, "strand": "EHS 1/2 in"}
    p = parameters(cp.make_scene({**BASE, "segment": [{"to": 0.4}, heavier]}))
    lower, upper = p.segments
    assert (lower.start, lower.end, upper.start, upper.end) == (0.0, 0.4, 0.4, 1.0)
    assert (lower.mass, lower.stiffness) == (1.0, 2e7)
    assert upper.mass == pytest.approx(4.0, rel=1e-15)  # the own weight in place of the density of strand and cable
    assert upper.breaking_strength is not None
    assert lower.breaking_strength is None
    assert p.mass == pytest.approx(0.4 * 1.0 + 0.6 * 4.0, rel=1e-15)
    assert p.weight[1] == pytest.approx(-9.81 * p.mass, rel=1e-15)
    assert p.area is None  # tension over area is no stress of the whole
    assert p.breaking_strength == upper.breaking_strength
    assert 1.0 / p.stiffness == pytest.approx(0.4 / lower.stiffness + 0.6 / upper.stiffness, rel=1e-15)


def test_segment_by_stiffness_and_mass_per_length() -> None:
    segments = [{"to": 0.4, "axial_stiffness": 3e7}, {"mass_per_length": 2.5}]
    p = parameters(cp.make_scene({**BASE, "segment": segments}))
    assert [segment.stiffness for segment in p.segments] == [3e7, 2e7]
    assert [segment.mass for segment in p.segments] == [1.0, 2.5]


def test_segments_stand_in_any_order_and_equal_ones_are_none() -> None:
    first, second = {"from": 0.0, "to": 0.4}, {"from": 0.4, "to": 1.0, "area": 2e-4}
    turned = parameters(cp.make_scene({**BASE, "segment": [second, first]}))
    assert [segment.stiffness for segment in turned.segments] == [2e7, 3.2e7]
    equal = parameters(cp.make_scene({**BASE, "segment": [first, {**second, "area": CABLE["area"]}]}))
    assert equal.segments == ()
    assert (equal.mass, equal.stiffness) == (1.0, 2e7)


def test_ice_grows_on_each_segment_by_its_diameter() -> None:
    ice = {"thickness": 0.01, "density": 700.0}
    segments = [{"to": 0.4}, {"diameter": 0.03}]
    p = parameters(cp.make_scene({**BASE, "segment": segments, "ice": ice, "attachment": [MASS]}))
    for segment, diameter in zip(p.segments, (0.014, 0.03), strict=True):
        assert segment.mass == pytest.approx(1.0 + 700.0 * math.pi * 0.01 * (diameter + 0.01), rel=1e-14)
        assert segment.diameter == pytest.approx(diameter + 0.02, rel=1e-14)
    assert p.bare is not None
    assert [segment.mass for segment in p.bare.segments] == [1.0, 1.0]
    assert [attachment.mass for attachment in p.bare.attachments] == [60.0]


def test_places_and_directions_of_attachments() -> None:
    damper = {"damper": 50.0, "direction": "normal"}
    tables = [
        MASS,
        {"distance_from_lower": 6.1156, **damper},
        {"distance_from_upper": 6.1156, "spring": 2.0, "direction": [3.0, 4.0]},
    ]
    p = parameters(cp.make_scene({**BASE, "attachment": tables}))
    np.testing.assert_allclose(attachment_fractions(p, 61.156), [0.5, 0.1, 0.9], rtol=1e-14)
    normal, given = p.attachments[1].direction, p.attachments[2].direction
    assert normal is not None
    assert given is not None
    np.testing.assert_allclose(normal, np.array([-57.7, 20.4]) / math.hypot(57.7, 20.4), rtol=1e-14)
    np.testing.assert_allclose(given, [0.6, 0.8], rtol=1e-15)
    upright = {**BASE, "ends": {"lower": [0.0, 0.0], "upper": [0.0, 57.7]}}
    with pytest.raises(SceneError, match=r"^attachment\.1\.direction: given 'normal'"):
        cp.make_scene({**upright, "attachment": [{"arc_length": 0.5, **damper}]})


def test_free_end_bears_an_attachment() -> None:
    free = {**BASE, "ends": {**BASE["ends"], "free": "upper"}, "attachment": [{"arc_length": 1.0, "mass": 3.0}]}
    assert attachment_fractions(parameters(cp.make_scene(free)), 61.156).tolist() == [1.0]


def test_place_and_size_vary_over_members() -> None:
    damper = {"arc_length": 0.5, "mass": 60.0, "damper": 3.0, "direction": [0.0, 1.0]}
    scene = cp.make_scene({**BASE, "segment": [{"to": 0.4, "area": 2e-4}, {}], "attachment": [damper]})
    values = {
        "segment.1.to": [0.3, 0.6],
        "segment.1.area": [2e-4, 3e-4],
        "attachment.1.mass": [10.0, 20.0],
        "attachment.1.arc_length": [0.1, 0.2],
        "attachment.1.direction.x": [0.0, 1.0],
    }
    members = Members(cp.ensemble.design(scene, values, members=2, sampling="list"))
    assert not members.can_be_stacked
    for member, p in enumerate(members):
        assert [segment.start for segment in p.segments] == [0.0, values["segment.1.to"][member]]
        assert p.segments[0].area == values["segment.1.area"][member]
        (attachment,) = p.attachments
        assert (attachment.mass, attachment.place) == (values["attachment.1.mass"][member], [0.1, 0.2][member])
        np.testing.assert_allclose(attachment.direction, [[0.0, 1.0], [math.sqrt(0.5)] * 2][member], rtol=1e-15)


def test_scene_file_and_archive_keep_the_tables(tmp_path: Any) -> None:
    damper = {"distance_from_upper": 3.0, "damper": 50.0, "direction": "normal"}
    scene = cp.make_scene({**BASE, "segment": [{"to": 0.4, "area": 2e-4}, {}], "attachment": [MASS, damper]})
    cp.archive.write(scene, tmp_path / "scene.nc")
    p, again = parameters(scene), parameters(cp.archive.read(tmp_path / "scene.nc"))
    assert [segment.stiffness for segment in again.segments] == [segment.stiffness for segment in p.segments]
    assert [attachment.place for attachment in again.attachments] == [0.5, 3.0]
    by_path = {"segment.1.to": 0.4, "segment.1.area": 2e-4, "segment.2.to": 1.0}
    by_path |= {"attachment.1.arc_length": 0.5, "attachment.1.mass": 60.0}
    by_path |= {f"attachment.2.{name}": value for name, value in damper.items()}
    assert cp.make_scene({**BASE, **by_path}).id == scene.id


@pytest.mark.parametrize(
    ("lost", "message"),
    [
        ("attachment_1_", r"^attachment\.2: given without attachment\.1; allowed: tables numbered from 1"),
        ("segment_1_", r"^segment\.2: given without segment\.1; allowed: tables numbered from 1"),
        ("point_load_1_", r"^point_load\.2: given without point_load\.1; allowed: tables numbered from 1"),
    ],
)
def test_a_dataset_that_lost_one_of_several_tables_is_refused(lost: str, message: str) -> None:
    lists = {
        "segment": [{"to": 0.4, "area": 2e-4}, {}],
        "attachment": [MASS, {"arc_length": 0.2, "mass": 5.0}],
        "point_load": [{"arc_length": place, "force": [0.0, -9.0]} for place in (0.3, 0.6)],
    }
    scene = cp.make_scene({**BASE, **lists})
    left = scene.drop_vars([name for name in scene.data_vars if str(name).startswith(lost)])
    with pytest.raises(SceneError, match=message):
        cp.catenary.rest(left)
    more = scene.rename({name: str(name).replace("_2_", "_7_") for name in scene.data_vars if "_2_" in str(name)})
    with pytest.raises(SceneError, match="allowed: tables numbered from 1"):
        cp.catenary.rest(more)
