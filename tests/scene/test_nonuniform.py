"""Segments of a cable and attachments: keys, refusals, parameters of scenes and of members."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import xarray as xr
from mast_scenes import small
from scene_files import GUY, MASS

import cablepod as cp
from cablepod.errors import SceneError

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
    ([{"arc_length": 0.5, "mas": 1.0}], "attachment.1.mas: unknown key"),
    ([{"arc_length": 1.0, "drag_area": 1.0}], "attachment.1.arc_length: given 1.0"),
    ({"arc_length": 0.5}, "attachment: given"),
]
#: Of a planar cable, or of one of this length.
REFUSED_HERE = [
    ([{"arc_length": 0.5, "damper": 1.0, "direction": [0.0, 0.0]}], "attachment.1.direction: given [0.0, 0.0]"),
    (
        [{"arc_length": 0.5, "damper": 1.0, "direction": [0.0, 0.0, 1.0]}],
        "attachment.1.direction: given 3 numbers; allowed: 2",
    ),
    ([MASS, {"distance_from_upper": 61.156 / 2, "mass": 1.0}], "attachment.2.distance_from_upper: given 30.578"),
]


@pytest.mark.parametrize(
    ("kind", "tables", "message"),
    [("segment", *row) for row in SEGMENTS_REFUSED] + [("attachment", *row) for row in ATTACHMENTS_REFUSED],
)
def test_they_are_refused_by_key_on_a_cable_and_on_the_guys_of_a_mast(kind: str, tables: Any, message: str) -> None:
    with pytest.raises(SceneError) as error:
        cp.make_scene({**GUY, kind: tables})
    assert str(error.value).startswith(message)
    with pytest.raises(SceneError) as error:
        small(lambda mapping: mapping["cables"]["guy"].update({kind: tables}))
    assert str(error.value).startswith(f"cables.guy.{message}")


@pytest.mark.parametrize(("tables", "message"), REFUSED_HERE)
def test_attachments_of_a_planar_cable_are_refused_by_key(tables: Any, message: str) -> None:
    with pytest.raises(SceneError) as error:
        cp.make_scene({**GUY, "attachment": tables})
    assert str(error.value).startswith(message)


def of_links(scene: Any) -> tuple[np.ndarray, np.ndarray]:
    """Axial stiffness [N] of each link and mass [kg] of each inner particle, from the chain at rest."""
    rest = cp.chain.rest(scene)
    reach = np.diff(rest.position, axis=0)
    length = np.linalg.norm(reach, axis=1)
    tension = rest.tension.values
    return tension / (length / np.diff(rest.arc_length) - 1.0), np.diff(tension * reach[:, 1] / length) / 9.81


#: Rounding of positions over the strain, 1e-3, and of tensions over the weight of a particle, 4e-3.
RTOL = 1e-10
LINK = 61.156 / 10


def test_segment_has_the_keys_of_the_cable_that_it_leaves_out() -> None:
    heavier = {"from": 0.4, "specific_weight": 2 * 8000.0 * 9.81, "area": 2.5e-4, "strand": "EHS 1/2 in"}
    scene = cp.make_scene({**GUY, "segment": [{"to": 0.4}, heavier]})
    stiffness, mass = of_links(scene)
    strand = float(cp.make_scene({**GUY, "cable": {"strand": "EHS 1/2 in", "top_tension": 1e4}}).cable_youngs_modulus)
    np.testing.assert_allclose(stiffness, [2e7] * 4 + [2.5e-4 * strand] * 6, rtol=RTOL)
    # the own weight in place of the density of strand and cable
    np.testing.assert_allclose(mass / LINK, [1.0] * 3 + [2.5] + [4.0] * 5, rtol=RTOL)
    numbers = cp.summary(scene)
    assert float(numbers.mass_per_length) == pytest.approx(0.4 * 1.0 + 0.6 * 4.0, rel=1e-15)
    assert float(numbers.weight_per_length) == pytest.approx(9.81 * 2.8, rel=1e-15)
    assert 1.0 / float(numbers.axial_stiffness) == pytest.approx(0.4 / 2e7 + 0.6 / (2.5e-4 * strand), rel=1e-15)
    assert float(numbers.breaking_strength) == pytest.approx(26900 * 4.4482216152605, rel=5e-5)  # of the strand, in lbf
    assert float(numbers.utilisation) == pytest.approx(float(numbers.tension_upper / numbers.breaking_strength))


def test_segment_by_stiffness_and_mass_per_length() -> None:
    segments = [{"to": 0.4, "axial_stiffness": 3e7}, {"mass_per_length": 2.5}]
    stiffness, mass = of_links(cp.make_scene({**GUY, "segment": segments}))
    np.testing.assert_allclose(stiffness, [3e7] * 4 + [2e7] * 6, rtol=RTOL)
    np.testing.assert_allclose(mass / LINK, [1.0] * 3 + [1.75] + [2.5] * 5, rtol=RTOL)


def test_segments_stand_in_any_order_and_equal_ones_are_none() -> None:
    first, second = {"from": 0.0, "to": 0.4}, {"from": 0.4, "to": 1.0, "area": 2e-4}
    turned = of_links(cp.make_scene({**GUY, "segment": [second, first]}))[0]
    np.testing.assert_allclose(turned, [2e7] * 4 + [3.2e7] * 6, rtol=RTOL)
    wind = {"speed": 20.0, "direction": [1.0, 0.0], "ground": -1.0}  # so that drag counts too
    uniform, equal = (
        cp.chain.rest(cp.make_scene({**GUY, "wind": wind, "segment": parts}))
        for parts in ([], [first, {**second, "area": GUY["cable"]["area"]}])
    )
    assert equal.drop_attrs().identical(uniform.drop_attrs())
    # no model sees them: this one refuses those that differ
    longer = {**GUY, "cable": {**GUY["cable"], "unstretched_length": 62.0}}
    cp.rigid.rest(cp.make_scene({**longer, "segment": [first, {"from": 0.4}]}))


def test_places_of_attached_masses() -> None:
    tables = [MASS, {"distance_from_lower": 6.1156, "mass": 20.0}, {"distance_from_upper": 6.1156, "mass": 30.0}]
    mass = of_links(cp.make_scene({**GUY, "attachment": tables}))[1]
    np.testing.assert_allclose(mass - LINK, [20.0, 0, 0, 0, 60.0, 0, 0, 0, 30.0], rtol=0, atol=LINK * 1e-9)


def test_place_and_size_vary_over_members() -> None:
    damper = {"arc_length": 0.5, "mass": 60.0, "damper": 3.0, "direction": [0.0, 1.0]}
    tables = {"segment": [{"to": 0.4, "area": 2e-4}, {}], "attachment": [damper]}
    values = {
        "segment.1.to": [0.3, 0.6],
        "segment.1.area": [2e-4, 3e-4],
        "attachment.1.mass": [10.0, 20.0],
        "attachment.1.arc_length": [0.1, 0.2],
        "attachment.1.direction.x": [0.0, 1.0],
    }
    members = cp.ensemble.design(cp.make_scene({**GUY, **tables}), values, members=2, sampling="list")
    together = cp.cable.frequencies(members, count=2)
    for member in range(2):
        to, area, mass, place, x = (row[member] for row in values.values())
        changed = {**damper, "mass": mass, "arc_length": place, "direction": [x, 1.0]}
        single = cp.make_scene({**GUY, "segment": [{"to": to, "area": area}, {}], "attachment": [changed]})
        np.testing.assert_array_equal(
            np.concatenate(of_links(members.isel(member=member))), np.concatenate(of_links(single))
        )
        alone = cp.cable.frequencies(single, count=2)
        for name in ("angular_frequency", "damping_ratio"):
            np.testing.assert_allclose(together[name][member], alone[name], rtol=1e-9)


def test_scene_file_and_archive_keep_the_tables(tmp_path: Any) -> None:
    damper = {"distance_from_upper": 3.0, "damper": 50.0, "direction": "normal"}
    scene = cp.make_scene({**GUY, "segment": [{"to": 0.4, "area": 2e-4}, {}], "attachment": [MASS, damper]})
    cp.archive.write(scene, tmp_path / "scene.nc")
    again = cp.archive.read(tmp_path / "scene.nc")
    xr.testing.assert_identical(again.drop_attrs(), scene.drop_attrs())
    np.testing.assert_array_equal(np.concatenate(of_links(again)), np.concatenate(of_links(scene)))
    by_path = {"segment.1.to": 0.4, "segment.1.area": 2e-4, "segment.2.to": 1.0}
    by_path |= {"attachment.1.arc_length": 0.5, "attachment.1.mass": 60.0}
    by_path |= {f"attachment.2.{name}": value for name, value in damper.items()}
    assert cp.make_scene({**GUY, **by_path}).id == scene.id


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
    scene = cp.make_scene({**GUY, **lists})
    left = scene.drop_vars([name for name in scene.data_vars if str(name).startswith(lost)])
    with pytest.raises(SceneError, match=message):
        cp.catenary.rest(left)
    more = scene.rename({name: str(name).replace("_2_", "_7_") for name in scene.data_vars if "_2_" in str(name)})
    with pytest.raises(SceneError, match="allowed: tables numbered from 1"):
        cp.catenary.rest(more)
