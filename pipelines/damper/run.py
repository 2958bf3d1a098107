"""Which damper constant at which place of a stay, the damping of five modes, with sag, and how it falls with amplitude.

    python pipelines/damper/run.py [--out out/damper] [--readme] [--quick]

Writes damper.nc and damper.png.  The stay has a viscous damper near its lower end, normal to its chord.  Damping ratios are
those of `cable.frequencies`.  Beside them stands the closed form R a/l kappa / (1 + kappa^2), kappa = c a omega / T, with
frequencies and the factor R of a cable with sag, and with those of a string (R = 1).

"constants": for each place a the constant that is best for the first mode, the one with which the lowest of the ratios of five
modes is largest, and the ratios with it.
"sag": the damper at 2 % with T / (a sqrt(omega_1 omega_5)), from a high tension down; the change by the sag is that from a
weightless stay with the same mean tension.
"amplitude": the stay is released from the shape of a vibration, and `cable.simulate` follows ten cycles; the ratio is that of the
swings.  Constants are in units of T / (a omega) of the mode.  "checks": the same with twice the elements and half the step.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import matplotlib as mpl

mpl.use("Agg")

import numpy as np
import xarray as xr
from _study import command_line, markdown_table, publish

from damper import stay
from damper.figure import draw

HERE = Path(__file__).resolve().parent
#: Places over the length, and that of the other tables.
PLACES, PLACE = (0.01, 0.02, 0.03, 0.04, 0.05), 0.02
#: Tensions at the upper end [N], that of service among them; least and largest of the curve over sag, and number of its points.
TENSIONS, LIMITS, COUNT = (7e6, 5e6, 3e6, 2e6), (1.5e6, 10e6), 25
#: Constants over the closed form's best of a mode, starts over the chord, modes and tensions [N] of the decays.
OVER_BEST, AMPLITUDES, DECAYING, SLACKER = (0.3, 1.0, 3.0), (1e-4, 1e-3, 3e-3, 1e-2), (1, 2), (5e6, 2e6)
#: Constants of the figure [N s/m].
CONSTANTS = np.geomspace(2e4, 3e6, 61)
LAST = stay.MODES


def constants(places: tuple[float, ...]) -> xr.Dataset:
    """Return the best constants over the places, and ratios with the best one for all modes."""
    given = stay.taut()
    first, five = (np.array([stay.best_constant(place, modes) for place in places]) for modes in (1, LAST))
    rule = np.array([stay.rule_of_thumb(place, given, 1, LAST) for place in places])
    of_first, of_five, of_rule = (
        np.array([stay.ratios(place, damper) for place, damper in zip(places, values, strict=True)])
        for values in (first, five, rule)
    )
    constant, one = {"units": "N s m-1"}, {"units": "1"}
    return xr.Dataset(
        {
            "first_mode_constant": ("place", first, constant),
            "first_mode_ratio": ("place", of_first[:, 0], one),
            "constant": ("place", five, constant),
            "ratio": (("place", "mode"), of_five, one),
            "rule_of_thumb": ("place", rule, constant),
            "rule_ratio": ("place", of_rule.min(axis=1), one),
        },
        coords={"place": list(places), "mode": np.arange(1, LAST + 1)},
    )


def sagging(tensions: np.ndarray, dim: str) -> xr.Dataset:
    """Return ratios by the cable and by the closed forms over the tension, each with the constant of the rule for it."""
    found: dict[str, Any] = {
        "cable": [],
        "cable_without_sag": [],
        "closed_form": [],
        "closed_form_without_sag": [],
    }
    parameters = []
    for tension in tensions:
        given = stay.taut(tension)
        damper = stay.rule_of_thumb(PLACE, given, 1, LAST)
        parameters.append(given.sag_parameter)
        found["cable"].append(stay.ratios(PLACE, damper, tension))
        found["cable_without_sag"].append(stay.ratios_without_sag(PLACE, damper, given))
        for name, sag in (("closed_form", True), ("closed_form_without_sag", False)):
            found[name].append(stay.closed_form(PLACE, damper, given, sag=sag))
    own: dict[str, Any] = {f"{dim}_{name}": ((dim, "mode"), values, {"units": "1"}) for name, values in found.items()}
    own[f"{dim}_sag_parameter"] = (dim, parameters, {"units": "1"})
    return xr.Dataset(own, coords={dim: (dim, tensions, {"units": "N"}), "mode": np.arange(1, LAST + 1)})


def over_constants() -> xr.Dataset:
    """Return ratios over the constant in service, by the cable and by the closed form."""
    given = stay.taut()
    return xr.Dataset(
        {
            "curve_cable": (("damper", "mode"), [stay.ratios(PLACE, c) for c in CONSTANTS], {"units": "1"}),
            "curve_closed_form": (
                ("damper", "mode"),
                [stay.closed_form(PLACE, c, given) for c in CONSTANTS],
                {"units": "1"},
            ),
        },
        coords={"damper": ("damper", CONSTANTS, {"units": "N s m-1"}), "mode": np.arange(1, LAST + 1)},
    )


def decays(tensions: tuple[float, ...], amplitudes: tuple[float, ...]) -> xr.Dataset:
    """Return ratio, frequency and range of the tension of decays over tension, mode, constant and amplitude."""
    shape = (len(tensions), len(DECAYING), len(OVER_BEST), len(amplitudes))
    found = np.empty((3, *shape))
    small, change = np.empty(shape[:3]), 0.0
    for i, tension in enumerate(tensions):
        given = stay.taut(tension)
        for j, mode in enumerate(DECAYING):
            for k, factor in enumerate(OVER_BEST):
                damper = factor * stay.rule_of_thumb(PLACE, given, mode, mode)
                small[i, j, k] = stay.ratios(PLACE, damper, tension)[mode - 1]
                for m, amplitude in enumerate(amplitudes):
                    found[:, i, j, k, m] = stay.decay(PLACE, damper, amplitude, mode=mode, tension=tension)
                finer = stay.decay(
                    PLACE, damper, amplitude, mode=mode, tension=tension, step=0.005, elements=2 * stay.ELEMENTS
                )
                change = max(change, abs(finer.ratio / found[0, i, j, k, -1] - 1.0))
    dims = ("decay_tension", "decay_mode", "over_best", "amplitude")
    names = ("decay_ratio", "decay_frequency_ratio", "decay_tension_range")
    return xr.Dataset(
        {
            **{name: (dims, values, {"units": "1"}) for name, values in zip(names, found, strict=True)},
            "small_ratio": (dims[:3], small, {"units": "1"}),
            "refinement": ((), change, {"units": "1", "long_name": "largest relative change of a ratio by refinement"}),
        },
        coords={
            "decay_tension": ("decay_tension", list(tensions), {"units": "N"}),
            "decay_mode": list(DECAYING),
            "over_best": list(OVER_BEST),
            "amplitude": list(amplitudes),
        },
    )


# --- tables -----------------------------------------------------------------------------------------------------------


def kilo(value: float) -> str:
    """Write a constant [N s/m] in kN s/m."""
    return f"{1e-3 * value:.0f}"


def constants_table(result: xr.Dataset) -> str:
    """Write the constants over the place."""
    rows = []
    for place in result.place.values:
        row = result.sel(place=place)
        rows.append(
            [
                f"{100.0 * place:g} %, {place * stay.CHORD:.1f} m",
                kilo(float(row.first_mode_constant)),
                f"{100.0 * float(row.first_mode_ratio):.2f} %",
                kilo(float(row.constant)),
                *(f"{100.0 * value:.2f} %" for value in row.ratio.values),
                kilo(float(row.rule_of_thumb)),
                f"{100.0 * float(row.rule_ratio):.2f} %",
            ]
        )
    head = (
        "damper at",
        "c for mode 1 [kN s/m]",
        "its ζ₁",
        "c for five modes [kN s/m]",
        *(f"ζ{n}" for n in "₁₂₃₄₅"),
        "c by the rule [kN s/m]",
        "its lowest ζ",
    )
    return markdown_table(head, rows)


def sag_table(result: xr.Dataset) -> str:
    """Write ratios with sag by the cable, and how far closed forms are off."""
    rows = []
    for tension in result.tension.values:
        row = result.sel(tension=tension)
        own = row.tension_cable.values
        head = [f"{1e-6 * tension:g}", f"{float(row.tension_sag_parameter):.2f}"]
        rows.append([*head, "ζ by the cable", *(f"{100.0 * value:.3f} %" for value in own)])
        change = 100.0 * (own / row.tension_cable_without_sag.values - 1.0)
        rows.append(["", "", "its change by the sag", *(f"{round(value, 1) + 0.0:+.1f} %" for value in change)])
        for name, label in (("closed_form", "error of the closed form"), ("closed_form_without_sag", "with R = 1")):
            off = 100.0 * (row[f"tension_{name}"].values / own - 1.0)
            rows.append(["", "", label, *(f"{value:+.1f} %" for value in off)])
    return markdown_table(("top tension [MN]", "λ²", "", *(f"mode {n}" for n in range(1, LAST + 1))), rows)


def amplitude_table(result: xr.Dataset) -> str:
    """Write the change of the ratio with the amplitude of the start."""
    rows = []
    for tension in result.decay_tension.values:
        for mode in result.decay_mode.values:
            for factor in result.over_best.values:
                row = result.sel(decay_tension=tension, decay_mode=mode, over_best=factor)
                small = float(row.small_ratio)
                rows.append(
                    [
                        f"{1e-6 * tension:g}",
                        f"{mode}",
                        f"{factor:g}",
                        f"{100.0 * small:.3f} %",
                        *(f"{100.0 * value:+.2f} %" for value in row.decay_ratio.values / small - 1.0),
                        f"{100.0 * (float(row.decay_frequency_ratio[-1]) - 1.0):+.1f} %",
                        f"{100.0 * float(row.decay_tension_range[-1]):.0f} %",
                    ]
                )
    largest = f"{100.0 * float(result.amplitude[-1]):g} %"
    head = (
        "top tension [MN]",
        "mode",
        "c a ω / T",
        "ζ of small vibrations",
        *(f"ζ from {100.0 * value:g} % of the chord" for value in result.amplitude.values),
        f"frequency from {largest}",
        f"range of the tension from {largest}",
    )
    return markdown_table(head, rows)


def checks(result: xr.Dataset) -> str:
    """Say how far the decays are from the ratios of small vibrations, and from finer runs."""
    off = float(np.abs(result.decay_ratio.isel(amplitude=0) / result.small_ratio - 1.0).max())
    return (
        f"From {100.0 * float(result.amplitude[0]):g} % of the chord the decay meets the ratio of small vibrations to "
        f"{100.0 * off:.2g} %. From {100.0 * float(result.amplitude[-1]):g} % its ratio changes by at most "
        f"{100.0 * float(result.refinement):.2g} % with twice the elements and half the step."
    )


def study(*, quick: bool) -> xr.Dataset:
    """Compute everything."""
    places = (PLACE,) if quick else PLACES
    tensions = SLACKER[:1] if quick else TENSIONS
    curve = np.geomspace(*LIMITS, 3 if quick else COUNT)
    parts = [
        constants(places),
        sagging(np.array(tensions), "tension"),
        sagging(curve, "curve_tension"),
        over_constants(),
        decays(SLACKER[:1] if quick else SLACKER, AMPLITUDES[::3] if quick else AMPLITUDES),
    ]
    result = xr.merge(parts, compat="no_conflicts", join="exact")
    result.attrs["title"] = "damping of a stay with a damper"
    return result


def main() -> None:
    """Compute, print, draw."""
    options = command_line(
        __doc__, out="out/damper", readme=True, quick="one place, one tension, two amplitudes"
    ).parse_args()
    result = study(quick=options.quick)
    tables = {
        "constants": constants_table(result),
        "sag": sag_table(result),
        "amplitude": amplitude_table(result),
        "checks": checks(result),
    }
    print("\n\n".join(tables.values()), flush=True)
    publish(
        options.out,
        "damper",
        result,
        draw=lambda path: draw(result, PLACE, path),
        page=HERE if options.readme else None,
        tables=tables,
    )


if __name__ == "__main__":
    main()
