"""Figures: what is drawn is what the Dataset holds, labelled with units, and nothing else of matplotlib is touched."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
import xarray as xr
from drawings import SIGMA, TIME, modes_of, texts, trajectory
from matplotlib import pyplot as plt

from cablepod import plots
from cablepod.errors import SceneError


def reduced_run(separate=True):
    dims = ("time", "coordinate", "mode") if separate else ("time", "mode")
    shape = (4, 2, 3) if separate else (4, 3)
    return xr.Dataset(
        {"amplitude": (dims, np.random.default_rng(3).standard_normal(shape))},
        coords={"time": TIME, "mode": [1, 2, 3], "coordinate": ["x", "y"]},
    )


def comparison(values):
    return xr.Dataset({"error": ("time", np.asarray(values, dtype=float))}, coords={"time": TIME[: len(values)]})


def drawn(ax):
    return {line.get_label(): line.get_xydata() for line in ax.lines}


def styles(ax):
    """What tells lines apart in grey."""
    return [
        (line.get_linestyle(), line.get_marker(), tuple(np.ravel(line._unscaled_dash_pattern[1]))) for line in ax.lines
    ]


# --- shapes ---------------------------------------------------------------------------------------------------------


def test_shapes_draws_the_positions_of_the_wanted_instants():
    chain, reduced = trajectory(), trajectory(sigma=np.linspace(0.0, 1.0, 7), seed=5)
    ax = plots.shapes(chain, reduced, times=[0.1, 0.3])
    assert [line.get_linestyle() == "None" for line in ax.lines] == [True, True, False, False]
    for line, (run, i) in zip(ax.lines, [(chain, 1), (chain, 3), (reduced, 1), (reduced, 3)], strict=True):
        np.testing.assert_array_equal(line.get_xydata(), run.position.values[i])
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("x [m]", "y [m]")
    assert texts(ax) == ["t = 0.1 s", "t = 0.3 s"]
    assert ax.get_legend().get_title().get_text() == "dots: made-up chain\nlines: made-up chain"


def test_shapes_by_default_takes_at_most_five_instants_evenly_spread():
    ax = plots.shapes(trajectory(times=np.linspace(0.0, 10.0, 101)))
    assert texts(ax) == ["t = 0 s", "t = 2.5 s", "t = 5 s", "t = 7.5 s", "t = 10 s"]
    assert len(plots.shapes(trajectory(times=TIME[:2])).lines) == 2


def test_shapes_of_a_single_instant():
    chain = trajectory()
    for one in (chain.isel(time=2), chain.isel(time=[2])):
        (line,) = plots.shapes(one).lines
        np.testing.assert_array_equal(line.get_xydata(), chain.position.values[2])


def test_dimensions_may_come_in_any_order():
    chain = trajectory()
    turned = chain.transpose("coordinate", "particle", "time")
    for a, b in zip(plots.shapes(chain).lines, plots.shapes(turned).lines, strict=True):
        np.testing.assert_array_equal(a.get_xydata(), b.get_xydata())


def test_deflection_is_normal_to_the_chord():
    chain = trajectory()
    ax = plots.shapes(chain, times=[0.2], deflection=True)
    expected = chain.position.values[2] @ [-0.6, 0.8]  # the chord is (8, 6)
    np.testing.assert_array_equal(ax.lines[0].get_xdata(), SIGMA)
    np.testing.assert_allclose(ax.lines[0].get_ydata(), expected, atol=1e-14)  # rounding of positions of size 10
    assert ax.get_xlabel().endswith("[1]")
    assert ax.get_ylabel() == "deflection normal to the chord [m]"


def test_deflection_follows_the_chord_of_the_moment():
    still = trajectory()
    turned, angle = still.copy(deep=True), np.linspace(0.0, 2.0, TIME.size)  # past the vertical
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.moveaxis(np.array([[cos, -sin], [sin, cos]]), 2, 0)
    turned["position"].values[:] = np.einsum("tij,tpj->tpi", turn, still.position.values) + np.array([100.0, -3.0])
    a, b = (plots.shapes(run, deflection=True).lines for run in (still, turned))
    for one, other in zip(a, b, strict=True):
        np.testing.assert_allclose(one.get_ydata(), other.get_ydata(), atol=1e-12)  # positions of size 100


def test_a_sag_is_drawn_downwards_whichever_end_is_on_the_left():
    chain = trajectory()
    chain["position"].values[:, 1:-1, 1] -= 2.0
    mirrored = chain.copy(deep=True)
    mirrored["position"].values[..., 0] *= -1.0
    for run in (chain, mirrored):
        (line,) = plots.shapes(run, times=[0.0], deflection=True).lines
        assert (line.get_ydata()[1:-1] < 0.0).all()


def test_spatial_deflection_is_in_the_plane_of_chord_and_y():
    chain = trajectory(3)
    chain["position"].values[..., 2] *= 0.3
    planar = chain.isel(coordinate=slice(2))
    ax = plots.shapes(chain, deflection=True)
    for one, other in zip(ax.lines, plots.shapes(planar, deflection=True).lines, strict=True):
        np.testing.assert_allclose(one.get_ydata(), other.get_ydata(), atol=1e-14)
    assert "plane of chord and y" in ax.get_legend().get_title().get_text()
    assert "along z" in plots.shapes(chain).get_legend().get_title().get_text()
    upright = chain.copy(deep=True)  # a vertical chord: any plane will do, but it must be one
    upright["position"].values[..., 0] = 0.0
    upright["position"].values[..., 2] *= 0.0
    (line,) = plots.shapes(upright, times=[0.0], deflection=True).lines
    np.testing.assert_array_equal(line.get_ydata(), 0.0)


def test_a_cable_that_moves_across_its_plane_is_drawn_there():
    chain = trajectory(3)
    chain["position"].values[..., 2] *= 3.0
    z = chain.position.values[2, :, 2]
    for draw, words in (
        (plots.shapes, "seen along y"), (partial(plots.shapes, deflection=True), "across the plane of chord and y"),
        (lambda run, times: plots.snapshots(run, run, times=times, magnify=1.0), "seen along y"),
    ):  # fmt: skip
        ax = draw(chain, times=[0.2])
        assert any(np.allclose(line.get_ydata(), z, atol=1e-14) for line in ax.lines)
        assert words in ax.get_legend().get_title().get_text()
        assert ax.get_ylabel() == ("deflection normal to the chord [m]" if "across" in words else "z [m]")


def test_a_long_chain_is_thinned_in_its_dots_only():
    (line,) = plots.shapes(trajectory(sigma=np.linspace(0.0, 1.0, 401)), times=[0.0]).lines
    assert line.get_markevery() == 10
    assert len(line.get_xdata()) == 401


# --- rest -----------------------------------------------------------------------------------------------------------


def test_rest_draws_a_line_and_dots():
    cable, chain = (trajectory(dims, seed=dims).isel(time=0, drop=True) for dims in (2, 3))
    ax = plots.rest(cable, chain)
    line, dots = ax.lines
    np.testing.assert_array_equal(line.get_xydata(), cable.position.values)
    np.testing.assert_array_equal(dots.get_xydata(), chain.position.values[:, :2])
    assert (line.get_marker(), dots.get_linestyle()) == ("None", "None")
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("x [m]", "y [m]")
    assert len(plots.rest(chain).lines) == 1


# --- modes ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("layout", ["separate", "vector"])
def test_modes_draws_each_coordinate(layout):
    modes = modes_of(layout)
    ax = plots.modes(modes, count=2)
    assert set(drawn(ax)) == {f"{c}, mode {i}" for c in "xy" for i in (1, 2)}
    for c in "xy":
        for i in (1, 2):
            expected = modes.mode_shape.sel(coordinate=c, mode=i)
            np.testing.assert_array_equal(drawn(ax)[f"{c}, mode {i}"], np.stack([SIGMA, expected], axis=1))
    assert {line.get_label()[0]: line.get_linestyle() for line in ax.lines} == {"x": "-", "y": "--"}
    assert len(set(styles(ax))) == 4
    assert ax.get_xlabel().endswith("[1]")
    assert ax.get_ylabel().endswith("[1]")


def test_modes_without_coordinates_and_with_other_sets():
    assert list(drawn(plots.modes(modes_of("normal")))) == ["mode 1", "mode 2", "mode 3"]
    assert "out of plane, mode 3" in drawn(plots.modes(modes_of("normal, spatial")))


def test_modes_of_some_coordinates():
    modes = modes_of()
    assert list(drawn(plots.modes(modes.sel(coordinate=["y"]), count=1))) == ["y, mode 1"]
    assert list(drawn(plots.modes(modes.sel(coordinate=["y", "x"]), count=1))) == ["x, mode 1", "y, mode 1"]
    assert list(drawn(plots.singular_values(modes.sel(coordinate=["x"])))) == ["x"]


def test_one_mode_and_more_wanted_than_there_are():
    assert len(plots.modes(modes_of(count=1)).lines) == 2
    assert len(plots.modes(modes_of(), count=50).lines) == 6
    ax = plots.singular_values(modes_of(count=1))
    ax.figure.canvas.draw()
    assert [tick for tick in ax.get_xticks() if 0.9 < tick < 1.1] == [1.0]


@pytest.mark.parametrize("layout", ["separate", "vector"])
def test_singular_values_are_drawn_on_a_logarithmic_axis(layout):
    modes = modes_of(layout)
    ax = plots.singular_values(modes)
    values = np.atleast_2d(modes.singular_value.values)
    assert len(ax.lines) == len(values) == len(set(styles(ax)))
    for line, expected in zip(ax.lines, values, strict=True):
        np.testing.assert_array_equal(line.get_xydata(), np.stack([[1, 2, 3], expected], axis=1))
    assert ax.get_yscale() == "log"
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("number of the mode [1]", "singular value [m]")


def test_singular_values_of_a_coordinate_at_rest_are_left_out():
    modes = modes_of()
    modes["singular_value"].values[1] = 0.0
    ax = plots.singular_values(modes)
    ax.figure.canvas.draw()
    assert texts(ax) == ["x", "y (all zero)"]


# --- over time ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("separate", [True, False])
def test_amplitudes_are_drawn_over_time(separate):
    run = reduced_run(separate)
    ax = plots.amplitudes(run, count=2)
    assert len(ax.lines) == (4 if separate else 2)
    for name, points in drawn(ax).items():
        expected = run.amplitude.sel(mode=int(name[-1]))
        expected = expected.sel(coordinate=name[0]) if separate else expected
        np.testing.assert_array_equal(points, np.stack([TIME, expected], axis=1))
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("time [s]", "amplitude [m]")


def test_amplitudes_of_one_mode_keep_its_number_and_of_one_instant_are_visible():
    assert list(drawn(plots.amplitudes(reduced_run().isel(mode=1)))) == ["x, mode 2", "y, mode 2"]
    for line in plots.amplitudes(reduced_run().isel(time=0)).lines:
        assert len(line.get_xdata()) == 1
        assert line.get_marker() != "None"


def test_errors_are_drawn_in_per_cent():
    ax = plots.error_over_time({"r = 1": comparison([0.0, 0.01, 0.02, 0.03]), "r = 2": comparison([1e-4] * 4)})
    ax.figure.canvas.draw()
    np.testing.assert_array_equal(drawn(ax)["r = 1"][:, 1], [np.nan, 100 * 0.01, 100 * 0.02, 100 * 0.03])
    np.testing.assert_array_equal(drawn(ax)["r = 2"][:, 0], TIME)
    assert ax.get_yscale() == "log"
    assert (ax.get_xlabel(), ax.get_ylabel()[-3:]) == ("time [s]", "[%]")
    assert texts(ax) == ["r = 1", "r = 2"]
    assert len(set(styles(ax))) == 2


def test_errors_that_are_all_zero_make_no_trouble():
    ax = plots.error_over_time({"same": comparison([0.0] * 4)})
    ax.figure.canvas.draw()
    assert texts(ax) == ["same (all zero)"]
    plots.error_over_time({"one instant": comparison([0.1])}).figure.canvas.draw()


# --- axes, and what is refused --------------------------------------------------------------------------------------

ALL = {
    "shapes": lambda **options: plots.shapes(trajectory(), **options),
    "rest": lambda **options: plots.rest(trajectory().isel(time=0, drop=True), **options),
    "modes": lambda **options: plots.modes(modes_of(), **options),
    "singular_values": lambda **options: plots.singular_values(modes_of(), **options),
    "amplitudes": lambda **options: plots.amplitudes(reduced_run(), **options),
    "error_over_time": lambda **options: plots.error_over_time({"a": comparison([1.0, 2.0])}, **options),
}


@pytest.mark.parametrize("name", ALL)
def test_given_axes_are_used_and_returned(name):
    _, ax = plt.subplots(layout="constrained")
    assert ALL[name](ax=ax) is ax
    assert len(plt.get_fignums()) == 1
    assert ax.lines


@pytest.mark.parametrize("name", ALL)
def test_new_axes_show_all_of_their_legend(name):
    figure = ALL[name]().figure
    figure.canvas.draw()
    assert figure.get_layout_engine() is not None
    box = figure.axes[0].get_legend().get_window_extent()
    assert figure.bbox.x0 <= box.x0
    assert box.x1 <= figure.bbox.x1
    assert figure.bbox.y0 <= box.y0


@pytest.mark.parametrize(
    ("draw", "message"),
    [
        (lambda: plots.shapes(modes_of()), "chain: given a Dataset without position; allowed: a trajectory"),
        (lambda: plots.shapes(trajectory(), {"position": 1}), "reduced: given a dict; allowed: a trajectory"),
        (lambda: plots.shapes(trajectory().isel(time=0, drop=True)), "chain: given position .* allowed: .*'time'"),
        (lambda: plots.shapes(trajectory().isel(time=[])), r"chain: time: given \[\]"),
        (lambda: plots.shapes(trajectory().isel(coordinate=0)), "chain: position: given the dimensions .*'coordinate'"),
        (lambda: plots.shapes(trajectory().expand_dims(member=2)), r"2 members.*allowed: one; pick it with \.isel"),
        (lambda: plots.shapes(trajectory(), times=[0.15]), "times: given 0.15; allowed: instants of the chain"),
        (
            lambda: plots.shapes(trajectory(), trajectory(times=TIME[:2]), times=[0.3]),
            "instants of the reduced.* 0.1 s",
        ),
        (lambda: plots.shapes(trajectory(), times=[]), "times: given .*; allowed: a list of at least 1 finite numbers"),
        (lambda: plots.shapes(trajectory(), times=np.zeros(7)), "times: given '7 instants'"),
        (lambda: plots.shapes(trajectory(), trajectory(3)), "reduced: .*the coordinates of the chain"),
        (lambda: plots.shapes(trajectory() * 0.0, deflection=True), "chain: given ends that coincide"),
        (lambda: plots.shapes(trajectory().drop_vars("arc_length"), deflection=True), "chain: .* without arc_length"),
        (lambda: plots.rest(trajectory()), "cable: given position .*'time': 4"),
        (lambda: plots.rest(trajectory().isel(time=0, drop=True), modes_of()), "chain: .* without position"),
        (lambda: plots.modes(trajectory()), "modes: given a Dataset without mode_shape; allowed: modes, from pod"),
        (lambda: plots.modes(modes_of(), count=0), "count: given 0; allowed: a whole number of at least 1"),
        (lambda: plots.singular_values(trajectory()), "modes: given a Dataset without singular_value"),
        (lambda: plots.amplitudes(trajectory()), "run: given a Dataset without amplitude"),
        (lambda: plots.error_over_time({}), "comparisons: given 'nothing'; allowed: a mapping, not empty"),
        (lambda: plots.error_over_time(comparison([1.0])), "comparisons: given 'Dataset'"),
        (lambda: plots.error_over_time({"r = 1": trajectory()}), "r = 1: given a Dataset without error"),
    ],
)
def test_wrong_input_is_refused_before_a_figure_is_made(draw, message):
    with pytest.raises(SceneError, match=message):
        draw()
    assert not plt.get_fignums()


def test_datasets_are_not_modified():
    run = trajectory()
    keep = run.copy(deep=True)
    plots.shapes(run, run, deflection=True)
    xr.testing.assert_identical(run, keep)


def test_shapes_are_drawn_to_one_scale():
    chain, reduced = trajectory(), trajectory(sigma=np.linspace(0.0, 1.0, 7), seed=5)
    assert plots.shapes(chain, reduced).get_aspect() == 1.0
    assert plots.shapes(chain, reduced, deflection=True).get_aspect() == "auto"
