"""Figures of gusts, spectra and cycles: what is drawn is what the data hold."""

from __future__ import annotations

import numpy as np
import pytest
import xarray as xr
from matplotlib import pyplot as plt
from matplotlib.collections import LineCollection

import cablepod as cp
from cablepod import plots

TIME = np.arange(0.0, 100.0, 0.05)


def field(heights=(0.0, 10.0, 20.0)):
    """Three points at two instants, weak wind along x, strong wind along z."""
    velocity = np.arange(18.0).reshape(2, 3, 3) * np.array([0.1, 0.0, 1.0])
    position = np.column_stack([np.zeros(3), heights, np.zeros(3)])
    return xr.Dataset(
        {"wind": (("time", "point", "component"), velocity), "position": (("point", "component"), position)},
        coords={
            "time": [0.0, 1.0],
            "point": [1, 2, 3],
            "component": list("xyz"),
            "relative_arc_length": ("point", [0.0, 0.5, 1.0]),
        },
    )


def series(values, time=TIME, **attrs):
    return xr.DataArray(values, dims="time", coords={"time": time}, name="tension", attrs={"units": "N", **attrs})


def test_a_field_is_drawn_over_time_and_height():
    ax = plots.wind_field(field())
    drawn = np.asarray(ax.collections[0].get_array()).reshape(3, 2)
    assert np.array_equal(drawn, field().wind.sel(component="z").transpose("point", "time"))
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("time [s]", "height y [m]")
    assert ax.figure.axes[-1].get_ylabel() == "velocity of the air along z [m/s]"
    assert ax.get_ylim() == pytest.approx((-5.0, 25.0))
    along = plots.wind_field(field(), component="x")
    assert np.asarray(along.collections[0].get_array()).max() == pytest.approx(1.5)
    assert plots.wind_field(field((5.0, 5.0, 5.0))).get_ylabel() == plots.SIGMA


def test_spectra_peak_at_their_frequencies():
    response = series(15000.0 + 3.0 * np.sin(2 * np.pi * 1.2 * TIME), long_name="tension")
    forcing = series(np.sin(2 * np.pi * 0.3 * TIME) + 0.01 * np.cos(2 * np.pi * 4.0 * TIME), long_name="wind")
    ax = plots.spectra(response, forcing, segments=4)
    lines = {line.get_label(): line.get_data() for line in ax.get_lines()}
    for name, frequency in (("tension", 1.2), ("wind", 0.3)):
        n, density = lines[name]
        assert n[density.argmax()] == pytest.approx(frequency, abs=0.0125)  # half a line of the spectrum
    assert (ax.get_xscale(), ax.get_yscale()) == ("log", "log")
    assert ax.get_xlabel() == "frequency n [Hz]"
    noise = series(np.random.default_rng(0).standard_normal(TIME.size))
    n, density = plots.spectra(noise, forcing).get_lines()[0].get_data()
    assert np.trapezoid(density / n, n) == pytest.approx(1.0, abs=0.1)  # the area of S(n) is the variance


def test_cycles_are_bars_of_their_ranges():
    tension = series([-2.0, 1.0, -3.0, 5.0, -1.0, 3.0, -4.0, 4.0, -2.0], np.arange(9.0), long_name="force")
    cycles = cp.fatigue.ranges(tension)  # ASTM E1049, figure 6
    ax = plots.tension_cycles(tension, cycles)
    assert ax.get_ylabel() == "force [N]"
    parts = {part.get_label(): part.get_segments() for part in ax.collections if isinstance(part, LineCollection)}
    heights = {name: sorted(float(np.ptp(bar[:, 1])) for bar in bars) for name, bars in parts.items()}
    assert heights == {"whole cycles": [4.0], "half cycles": [3.0, 4.0, 6.0, 8.0, 8.0, 9.0]}
    assert [bar[0].tolist() for bar in parts["whole cycles"]] == [[4.0, -1.0]]
    few = plots.tension_cycles(tension, cycles, count=1)
    assert [part.get_segments()[0][:, 1].tolist() for part in few.collections if isinstance(part, LineCollection)] == [
        [5.0, -4.0]
    ]


def test_colours_of_cycles_have_the_units_of_the_series():
    for units, size in (("N", 1e4), ("kN", 10.0), ("MPa", 200.0)):
        tension = series(size * np.sin(TIME), long_name="force").assign_attrs(units=units)
        axis, bar = plots.tension_cycles(tension, cp.fatigue.ranges(tension)).figure.axes
        shown = "kN" if units == "N" else units
        assert (axis.get_ylabel(), bar.get_ylabel()) == (f"force [{shown}]", f"range of the cycle [{shown}]")


def test_real_gusts_are_drawn():
    guy = {
        "cable": {"strand": "EHS 1/2 in", "top_tension": 15000.0, "diameter": 0.0127},
        "ends": {"lower": [0.0, 0.0, 0.0], "upper": [20.4, 57.7, 0.0]},
        "chain": {"links": 20},
        "wind": {"speed": 25.0, "direction": [1.0, 0.0, 0.0], "turbulence": {"spectrum": "kaimal"}},
        "time": {"duration": 20.0, "interval": 0.1},
    }
    scene = cp.make_scene(guy)
    wind = cp.wind.field(scene)
    run = cp.condensed.simulate(scene, cp.condensed.vibration_modes(scene, rank=4), outputs=("tension",))
    top = run.tension.isel(link=-1)
    assert plots.wind_field(wind).get_ylabel() == "height y [m]"
    labels = [
        line.get_label() for line in plots.spectra(top, wind.wind.isel(point=-1, component=0), segments=2).get_lines()
    ]
    assert labels[1] == f"velocity of the air, point {int(wind.point[-1])}, component x"
    assert len(plots.tension_cycles(top, cp.fatigue.ranges(top)).collections) == 2
    plt.gcf().canvas.draw()


SINE = series(np.sin(TIME))
WRONG = {
    "no field": (lambda: plots.wind_field(SINE.to_dataset()), "^wind: given a Dataset"),
    "one instant": (lambda: plots.wind_field(field().isel(time=[0])), "^wind: given .*two instants and two points"),
    "component": (lambda: plots.wind_field(field(), component="u"), "^component: given 'u'"),
    "level points": (
        lambda: plots.wind_field(field((1.0, 1.0, 1.0)).drop_vars("relative_arc_length")),
        "^wind: given points whose heights do not rise",
    ),
    "no series": (lambda: plots.spectra(3, SINE), "^response: given 'int'; allowed: a DataArray"),
    "Dataset": (lambda: plots.spectra(SINE, SINE.to_dataset()), "^forcing: given 'Dataset'; allowed: a DataArray"),
    "two dimensions": (lambda: plots.spectra(SINE.expand_dims(link=2), SINE), "^response: given "),
    "uneven": (lambda: plots.spectra(SINE[[0, 1, *range(3, 99)]], SINE), "^response: given instants at unequal intervals"),
    "falling": (lambda: plots.spectra(SINE[::-1], SINE), "^response: given instants that do not rise"),
    "milliseconds": (
        lambda: plots.spectra(SINE.assign_coords(time=SINE.time.assign_attrs(units="ms")), SINE),
        "^response: time: given units 'ms'; allowed: s",
    ),
    "nan": (lambda: plots.spectra(series(np.nan * TIME), SINE), "^response: given values that are not finite"),
    "constant": (lambda: plots.spectra(SINE, series(0.0 * TIME + 3.0)), "^forcing: given a constant series"),
    "segments": (lambda: plots.spectra(SINE, SINE, segments=1000), "^segments: given 1000; allowed: at most 499"),
    "no segments": (lambda: plots.spectra(SINE, SINE, segments=0), "^segments: given 0"),
    "other cycles": (lambda: plots.tension_cycles(SINE, cp.fatigue.ranges(2.0 * SINE)), "^cycles: given those of another series"),
    "no cycles": (lambda: plots.tension_cycles(SINE, field()), "^cycles: given a Dataset without cycle_range"),
    "count": (lambda: plots.tension_cycles(SINE, cp.fatigue.ranges(SINE), count=0), "^count: given 0"),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_wrong_data_are_refused(name):
    call, message = WRONG[name]
    with pytest.raises(cp.SceneError, match=message):
        call()
    assert not plt.get_fignums()
