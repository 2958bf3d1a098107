"""What no result of a public function shows: keys of the schema, what is kept between calls, numbers of parts of a cable."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scene_files import GUY, MASS
from scenes import SOFT

import cablepod as cp
from cablepod.parameters import _keys, _scene_values
from cablepod.parameters._from_scene import Members, SceneContent, parameters
from cablepod.parameters._nonuniform import attachment_fractions
from cablepod.scene import _warnings
from cablepod.scene._warnings import warn_of_unusual, warn_once


def test_a_load_of_nothing_is_absent(soft):
    soft["load"] = {"uniform": [0.0, 0.0]}
    soft["point_load"] = [{"arc_length": 0.5, "force": [0.0, 0.0]}]
    p = parameters(cp.make_scene(soft))
    assert p.load is None
    assert p.point_loads == ()


def test_every_key_of_the_schema_has_a_long_name_and_units_unless_a_text_or_truth():
    tables = [_keys.TOP, *_keys.TABLES.values(), _keys.POINT_LOAD, _keys.ENSEMBLE]
    tables += [keys for units in ("m", "1") for keys in _keys.time_function_keys(units).values()]
    texts = {"title", "free", "sampling", "path", "strand", "strand_table", "profile", "spectrum", "exact_mean"}
    texts |= {"record", "record_sha256"}
    for keys in tables:
        for name, key in keys.items():
            assert key.long_name
            assert (key.units is None) == (name in texts), name


def test_most_values_are_checked_once(monkeypatch):
    scene = cp.make_scene(SOFT)
    Members(scene)
    monkeypatch.setattr(_scene_values, "key_at", None)
    Members(scene.copy(deep=True))


def test_a_function_of_several_models_warns_once():
    scene = cp.make_scene({**GUY, "cable": {**GUY["cable"], "density": 8.0}})
    options = {"times": [0.0, 0.01], "step": 1e-6}

    @warn_once
    def both():
        cp.chain.simulate(scene, **options)
        cp.cable.simulate(scene, elements=4, **options)

    for function in (both, both, lambda: cp.chain.simulate(scene, **options)):
        with pytest.warns(cp.UnusualSceneWarning, match=r"^cable\.density") as caught:
            function()
        assert len(caught) == 1


def test_the_notes_of_a_known_scene_are_not_computed_again(monkeypatch):
    p = SceneContent.of(cp.make_scene(SOFT)).parameters()
    warn_of_unusual(p)
    monkeypatch.setattr(_warnings, "notes_of", None)
    warn_of_unusual(SceneContent.of(cp.make_scene(SOFT)).parameters())


def test_ice_grows_on_each_segment_by_its_diameter() -> None:
    ice = {"thickness": 0.01, "density": 700.0}
    segments = [{"to": 0.4}, {"diameter": 0.03}]
    p = parameters(cp.make_scene({**GUY, "segment": segments, "ice": ice, "attachment": [MASS]}))
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
    p = parameters(cp.make_scene({**GUY, "attachment": tables}))
    np.testing.assert_allclose(attachment_fractions(p, 61.156), [0.5, 0.1, 0.9], rtol=1e-14)
    normal, given = p.attachments[1].direction, p.attachments[2].direction
    assert normal is not None
    assert given is not None
    np.testing.assert_allclose(normal, np.array([-57.7, 20.4]) / math.hypot(57.7, 20.4), rtol=1e-14)
    np.testing.assert_allclose(given, [0.6, 0.8], rtol=1e-15)
    upright = {**GUY, "ends": {"lower": [0.0, 0.0], "upper": [0.0, 57.7]}}
    with pytest.raises(cp.SceneError, match=r"^attachment\.1\.direction: given 'normal'"):
        cp.make_scene({**upright, "attachment": [{"arc_length": 0.5, **damper}]})


def test_free_end_bears_an_attachment() -> None:
    free = {**GUY, "ends": {**GUY["ends"], "free": "upper"}, "attachment": [{"arc_length": 1.0, "mass": 3.0}]}
    assert attachment_fractions(parameters(cp.make_scene(free)), 61.156).tolist() == [1.0]
