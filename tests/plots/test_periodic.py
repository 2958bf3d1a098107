"""Figures of periodic responses: what is drawn is what the Dataset holds."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr

from cablepod import plots
from cablepod.errors import SceneError


def response():
    """Two branches: one that is unstable in its middle, one of two periods."""
    omega = np.array([1.0, 2.0, 3.0, 4.0, 2.5, 3.5])
    stable = np.array([True, False, False, True, True, True])
    return xr.Dataset(
        {
            "angular_frequency": ("point", omega),
            "branch": ("point", [1, 1, 1, 1, 2, 2]),
            "deflection_maximum": ("point", omega**2),
            "stable": ("point", stable),
            "periods": ("point", [1, 1, 1, 1, 2, 2]),
            "bifurcation_kind": ("bifurcation", ["fold", "period_doubling"]),
            "bifurcation_angular_frequency": ("bifurcation", [1.5, 2.5]),
            "bifurcation_deflection_maximum": ("bifurcation", [2.0, 6.0]),
            "multiplier_real": (("point", "multiplier"), np.tile([0.5, -1.2], (6, 1))),
            "multiplier_imag": (("point", "multiplier"), np.zeros((6, 2))),
        },
        coords={"point": np.arange(1, 7)},
    )


def lines(ax, style):
    return [line.get_xdata() for line in ax.get_lines() if line.get_linestyle() == style and len(line.get_xdata()) > 1]


def test_unstable_parts_of_branches_are_dashed():
    ax = plots.frequency_response(response())
    # a part goes on to the first point of the next one, so that the branch has no gap
    assert [list(x) for x in lines(ax, "-")] == [[1.0, 2.0], [2.5, 3.5]]
    assert [list(x) for x in lines(ax, "--")] == [[2.0, 3.0, 4.0]]
    texts = [text.get_text() for text in ax.get_legend().get_texts()]
    assert texts == ["branch 1", "branch 2, 2 periods", "fold", "period doubling", "unstable"]
    marks = {line.get_label(): (*line.get_xdata(), *line.get_ydata()) for line in ax.get_lines()}
    assert marks["fold"] == (1.5, 2.0)


def test_lines_of_many_branches_differ_and_those_of_backbones_have_names():
    many = response().isel(point=np.tile([0, 1], 14)).assign(branch=("point", np.repeat(np.arange(14), 2)))
    ax = plots.frequency_response(many)
    drawn = {
        (line.get_color(), line.get_linewidth()) for line in ax.get_lines() if list(line.get_xdata()) == [1.0, 2.0]
    }
    assert len(drawn) == 14
    free = xr.Dataset({"angular_frequency": ("point", [6.0, 6.1]), "amplitude": ("point", [0.0, 0.1])})
    free.attrs |= {"title": "guy: backbone", "motion": "planar"}
    ax = plots.backbone(*(free.assign_attrs(mode=mode) for mode in (1, 2)))
    texts = [text.get_text().replace("\n", " ") for text in ax.get_legend().get_texts()]
    assert texts == ["guy: backbone, mode 1, planar", "guy: backbone, mode 2, planar"]


def test_frequencies_in_hertz_and_the_tension_of_all_links():
    given = response()
    given["tension_maximum"] = (
        ("point", "link"),
        np.stack([np.arange(6.0), 10.0 - np.arange(6.0)], axis=1),
        {"units": "N"},
    )
    given["tension_maximum"].attrs["long_name"] = "largest tension of the link over a period"
    ax = plots.frequency_response(given, variable="tension_maximum", hertz=True)
    assert list(ax.get_lines()[0].get_ydata()) == [10.0, 9.0]
    np.testing.assert_allclose(ax.get_lines()[0].get_xdata(), np.array([1.0, 2.0]) / (2.0 * np.pi))
    assert ax.get_xlabel() == "frequency of the forcing [Hz]"
    assert ax.get_ylabel() == "largest tension anywhere over a period [N]"
    marks = {line.get_label(): line.get_xdata() for line in plots.frequency_response(given, hertz=True).get_lines()}
    assert marks["fold"] == pytest.approx(1.5 / (2.0 * np.pi))
    ax = plots.stability_map(stability(), hertz=True)
    (edges,) = [line for line in ax.get_lines() if line.get_label() == "edge, in plane"]
    np.testing.assert_allclose(edges.get_xdata(), np.array([1.5, 2.5]) / (2.0 * np.pi))
    assert ax.get_xlabel() == "frequency of the forcing [Hz]"
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["stable", "edge, in plane"]
    ax.figure.canvas.draw()
    assert not ax.get_legend().get_window_extent().overlaps(ax.get_window_extent())  # hides no edge


def test_multipliers_outside_of_the_circle_are_told_apart():
    ax = plots.multipliers(response().isel(point=0))
    found = {line.get_label(): list(line.get_xdata()) for line in ax.get_lines()}
    assert found["inside or on the circle"] == [0.5]
    assert found["outside: unstable"] == [-1.2]


def stability(missing=False):
    growth = np.array([[-1.0, 2.0, -1.0], [3.0, np.nan if missing else 4.0, -1.0]])
    return xr.Dataset(
        {
            "growth_in_plane": (("amplitude", "angular_frequency"), growth),
            "response": (("amplitude", "angular_frequency"), np.abs(growth)),
            "edge_angular_frequency": ("edge", [1.5, 2.5]),
            "edge_amplitude": ("edge", [0.1, 0.1]),
            "edge_set": ("edge", ["in_plane", "in_plane"]),
        },
        coords={"amplitude": [0.1, 0.2], "angular_frequency": [1.0, 2.0, 3.0]},
    )


def test_a_map_shows_growth_edges_and_what_is_missing():
    ax = plots.stability_map(stability(missing=True))
    drawn = ax.collections[0].get_array()
    assert drawn.compressed().tolist() == [2.0, 3.0]  # decay is left blank
    found = {line.get_label(): list(line.get_xdata()) for line in ax.get_lines()}
    assert found["edge, in plane"] == [1.5, 2.5]
    assert found["no response"] == [2.0]
    neutral = stability()
    neutral["growth_in_plane"].values[0] = [3e-14, 2.0, 1e-13]  # without damping
    assert plots.stability_map(neutral).collections[0].get_array().compressed().tolist() == [2.0, 3.0, 4.0]
    assert plots.stability_map(stability(), variable="response").collections[0].get_array().count() == 6


def test_backbones_and_orbits():
    free = xr.Dataset(
        {"angular_frequency": ("point", [1.0, 1.1]), "amplitude": ("point", [0.1, 0.2])}, attrs={"title": "free"}
    )
    ax = plots.backbone(free)
    assert list(ax.get_lines()[0].get_xdata()) == [1.0, 1.1]
    assert list(plots.frequency_response(response(), backbone=free).get_lines()[0].get_ydata()) == [0.1, 0.2]
    time = np.linspace(0.0, 1.0, 65)
    place = np.zeros((65, 3, 3))
    place[:, 2, 0] = 2.0
    place[:, 1] = np.stack([np.ones(65), 0.1 * np.cos(2 * np.pi * time), 0.2 * np.sin(2 * np.pi * time)], axis=1)
    orbit = xr.Dataset(
        {"position": (("time", "particle", "coordinate"), place), "multiplier_real": ("multiplier", [0.5])},
        coords={"time": time, "coordinate": list("xyz"), "arc_length": ("particle", [0.0, 1.0, 2.0])},
    )
    line = plots.orbit(orbit).get_lines()[0]
    assert np.abs(line.get_xdata()).max() == pytest.approx(0.2)
    assert np.abs(line.get_ydata()).max() == pytest.approx(0.1)
    moving = plots.animate_orbit(orbit, frames=16)
    assert moving.times.size == 16
    drawn = moving.show_frame(4).get_lines()[-1]  # a quarter of the period
    assert drawn.get_xdata() == pytest.approx([0.0, 0.2, 0.0], abs=1e-12)
    assert drawn.get_ydata() == pytest.approx([0.0, 0.0, 0.0], abs=1e-12)
    plane = orbit.isel(coordinate=[0, 1])
    line = plots.orbit(plane).get_lines()[0]
    assert np.abs(line.get_ydata()).max() == pytest.approx(0.2 * np.pi, rel=1e-2)  # differences over 64 instants
    assert line.get_ydata()[[0, -1]] == pytest.approx(0.0, abs=1e-12)  # as between all others, round the period


@pytest.mark.parametrize(
    ("draw", "message"),
    [
        (lambda: plots.frequency_response(stability()), "^response: "),
        (lambda: plots.stability_map(response()), "result: given a Dataset without growth_in_plane"),
        (lambda: plots.backbone(), "backbones: given none"),
        (lambda: plots.orbit(), "orbits: given none"),
        (lambda: plots.orbit(response()), "^orbits: "),
        (lambda: plots.animate_orbit(response()), "^orbit: "),
        (lambda: plots.orbit(response(), sigma=50.0), r"^sigma: given 50\.0; allowed: "),
        (lambda: plots.frequency_response(response(), variable=None), "^variable: given None; allowed: a text"),
        (lambda: plots.stability_map(response(), variable=[]), r"^variable: given \[\]; allowed: a text"),
        (lambda: plots.multipliers(stability()), "result: given a Dataset without multiplier_real"),
    ],
)
def test_other_datasets_are_refused(draw, message):
    with pytest.raises(SceneError, match=message):
        draw()
