"""Labels of the results of a mast, fatigue ranges of its guys."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
import xarray as xr

from cablepod import fatigue
from cablepod.conventions import COORDINATES, ENDS, label, shared_coordinates
from cablepod.errors import SceneError
from cablepod.fatigue._cycles import EXPONENT, FREQUENCY, warn_of_cut_cycles
from cablepod.integrate._request import check_outputs
from cablepod.integrate._window import within
from cablepod.mast._beam import Beam
from cablepod.mast._model import ModalMast
from cablepod.mast._request import MastTrajectory, times_of_breaks
from cablepod.mast._sections import ENVELOPES, NEED_FORCES, OVER_TIME, Forces, envelopes, over_time, spatial
from cablepod.parameters._mast import MastParameters
from cablepod.parameters._utilisation import utilisation_of

#: Variables of a scene that are heights of levels.
LEVEL_KEYS = re.compile(r"mast_height|guy_\d+_level")
#: Outputs over levels.
AT_LEVELS = {"displacement", "extremes", ENVELOPES}
#: Outputs of a run.
OUTPUTS = (
    "displacement", "guy_tension", "guy_force", "guy_position", *OVER_TIME, "extremes", ENVELOPES, "energy", "error_estimate"
)  # fmt: skip
#: Name -> (units, long name) of the variables of a mast.
NAMES: dict[str, tuple[str, str]] = {
    "level": ("m", "height of the level: of guys, and the top"),
    "node": ("1", "number of the node of the mast, 0 at the foot"),
    "node_height": ("m", "height of the node"),
    "guy": ("1", "number of the guy, table by table"),
    "guy_level": ("m", "height at which the guy is fastened to the mast"),
    "guy_breaks": ("s", "time at which the guy breaks, infinite where it does not"),
    "table": ("1", "number of the table of the guy in the scene"),
    "anchor": ("m", "position of the anchor"),
    "displacement": ("m", "displacement of the mast from its straight state"),
    "guy_tension": ("N", "tension of the guy at the mast"),
    "guy_tension_anchor": ("N", "tension of the guy at its anchor"),
    "guy_force": ("N", "force of the guy on the mast"),
    "guy_position": ("m", "position of the point of the guy"),
    "point": ("1", "number of the point, 0 at the anchor"),
    "guy_length": ("m", "unstretched length of the guy"),
    "bending_moment": ("N m", "bending moment EI d2u/dy2 of the mast for displacements along the coordinate"),
    "element": ("1", "number of the element of the mast, 0 at the foot"),
    "end": ("1", "end of the element of the mast"),
    "element_bottom": ("m", "height of the lower end of the element"),
    "element_top": ("m", "height of the upper end of the element"),
    "shear_force": ("N", "horizontal force of the mast above on the mast below, at the end of the element"),
    "axial_compression": ("N", "axial force at the lower end of the element, compression positive"),
    "foot_force": ("N", "force of the mast on its foundation"),
    "anchor_force": ("N", "force of the guy on its anchor"),
    "axial_force": ("N", "axial force of the mast, compression positive, mean of both sides of the node"),
    "buckling_factor": ("1", "factor of the axial force at which the mast buckles, the stiffness of the guys kept"),
    "buckling_factor_after_break": (
        "1",
        "the same for the mast without the guys that break, nan where it then has no rest or falls",
    ),
    "angular_frequency": ("rad s-1", "angular frequency of small vibrations about rest"),
    "mode_shape": ("1", "displacement of the mast in the mode, of unit largest value of mast or guys"),
    "mast_share": ("1", "share of the mast in the kinetic energy of the mode"),
    "guy_share": ("1", "share of the guy in the kinetic energy of the mode"),
    "energy": ("J", "kinetic and potential energy less that at rest"),
    "utilisation": ("1", "largest tension over breaking strength"),
}
for _name in ("displacement", "guy_tension", "bending_moment"):
    for _what, _text in (
        ("minimum", "least"),
        ("maximum", "largest"),
        ("mean", "mean of the"),
        ("std", "standard deviation of the"),
    ):
        _of = "at the output times" if _name == "bending_moment" else "over all steps"
        NAMES[f"{_name}_{_what}"] = (NAMES[_name][0], f"{_text} {NAMES[_name][1]}, {_of}")
    for _what in ("minimum", "maximum"):
        NAMES[f"{_name}_{_what}_time"] = ("s", f"time of the {NAMES[f'{_name}_{_what}'][1]}")
for _name in ("axial_compression", "foot_force", "anchor_force"):
    for _what, _text in (("minimum", "least"), ("maximum", "largest")):
        NAMES[f"{_name}_{_what}"] = (NAMES[_name][0], f"{_text} {NAMES[_name][1]}, at the output times")
for _name in ("displacement", "bending_moment", "shear_force", "anchor_force"):
    _of = ", along an axis over all steps" if _name == "displacement" else ""
    NAMES[f"{_name}_largest"] = (
        NAMES[_name][0],
        f"largest magnitude of the {NAMES[_name][1]}, at the output times{_of}",
    )
for _name in ("foot_force", "anchor_force"):
    NAMES[f"{_name}_horizontal_largest"] = (
        "N", f"largest magnitude of the horizontal {NAMES[_name][1]}, at the output times"
    )  # fmt: skip
NAMES["guy_axial_force_minimum"] = (
    "N", "least force of the guy over the run, negative or 0 where it is slack: chordwise (condensed), of its links (chain)"
)  # fmt: skip


def dataset(p: MastParameters, variables: Mapping[str, Any], coordinates: Mapping[str, Any]) -> xr.Dataset:
    """Return a labelled Dataset with the coordinates of the guys."""
    result = xr.Dataset(dict(variables), coords=shared_coordinates(_with_guys(p, variables, coordinates)))
    return label(result, **{name: NAMES[name] for name in NAMES if name in result.variables})


def _with_guys(p: MastParameters, variables: Mapping[str, Any], coordinates: Mapping[str, Any]) -> dict[str, Any]:
    """Return the coordinates with those of the axes and of the guys."""
    used = {dim for dims, _ in variables.values() for dim in dims}
    coords: dict[str, Any] = {name: value for name, value in coordinates.items()}
    if "level" in coords:
        coords["level"] = p.given_heights(coords["level"])
    for name in ("node_height", "element_bottom", "element_top"):
        if name in coords:
            dim, heights = coords[name]
            coords[name] = (dim, p.given_heights(heights))
    if "coordinate" in used:
        coords["coordinate"] = list(COORDINATES)
    if "end" in used:
        coords["end"] = list(ENDS)
    if "guy" in used and p.guys:
        coords["guy"] = np.arange(1, len(p.guys) + 1)
        coords["guy_level"] = ("guy", p.given_heights(np.array([guy.level for guy in p.guys])))
        coords["table"] = ("guy", np.array([guy.table for guy in p.guys]))
        if any(guy.breaks is not None for guy in p.guys):
            coords["guy_breaks"] = ("guy", times_of_breaks(p))
    return coords


def nodes_of(beam: Beam) -> dict[str, Any]:
    """Return the coordinates of nodes and elements of the mast."""
    return {
        "node": np.arange(beam.height.size), "node_height": ("node", beam.height), "element": np.arange(beam.length.size),
        "element_bottom": ("element", beam.height[:-1]), "element_top": ("element", beam.height[1:]),
    }  # fmt: skip


def check_levels(scene: xr.Dataset, outputs: tuple[str, ...]) -> None:
    """Refuse members whose levels differ where these label a dimension of an output, before any of them runs.

    Raises
    ------
    SceneError
        Names the key of the height; and for other outputs than those of a run.
    """
    if not AT_LEVELS & set(check_outputs(outputs, OUTPUTS)):
        return
    for name, variable in scene.variables.items():
        if LEVEL_KEYS.fullmatch(str(name)) and "member" in variable.dims:
            low, high = float(np.nanmin(variable.values)), float(np.nanmax(variable.values))
            if low < high:
                raise SceneError(
                    f"{str(name).replace('_', '.')}: given {low:g} to {high:g} m along member; allowed: one height, as it labels "
                    "displacements and their extremes; try: a call for each member, scene.isel(member=0), or mast.simulate with "
                    'other outputs, such as "guy_tension" and "bending_moment"'
                )


def seen_from(rows: np.ndarray, modal: np.ndarray) -> np.ndarray:
    """Return values at places in x and z (outputs, places, 2), for rows (places, 2, modes) and coordinates (outputs, modes)."""
    return (modal @ rows.reshape(-1, rows.shape[-1]).T).reshape(-1, *rows.shape[:2])


def trajectory(mast: ModalMast, run: MastTrajectory, outputs: tuple[str, ...], guys: str) -> xr.Dataset:
    """Return a run with guys of a kind as a Dataset, up to where it was computed."""
    request, n = run.request, run.completed
    variables: dict[str, Any] = {}
    coords: dict[str, Any] = {"time": request.times[:n], "level": mast.heights}
    moved = mast.level_rest + seen_from(mast.level_rows, run.modal[:n])
    if "displacement" in outputs:
        variables["displacement"] = (("time", "level", "coordinate"), spatial(moved))
    if "guy_tension" in outputs:
        variables["guy_tension"] = (("time", "guy"), run.tension[:n])
    if "guy_force" in outputs:
        variables["guy_force"] = (("time", "guy", "coordinate"), run.force[:n])
    if run.guy_position is not None:
        variables["guy_position"] = (("time", "guy", "point", "coordinate"), run.guy_position[:n])
        coords["point"] = np.arange(run.guy_position.shape[2])
    if NEED_FORCES & set(outputs):
        # else those of the elements are not computed
        shear = bool({"shear_force", "foot_force", ENVELOPES} & set(outputs))
        variables |= _forces(Forces(mast, run, shear=shear), outputs, moved, guys)
        used = {dim for dims, _ in variables.values() for dim in dims}
        coords |= {name: value for name, value in nodes_of(mast.rest.beam).items() if name.split("_")[0] in used}
    if "extremes" in outputs and not run.status:
        variables |= _extremes(mast, run)
    if run.energy is not None:
        variables["energy"] = (("time",), run.energy[:n])
    if not any("time" in dims for dims, _ in variables.values()):
        coords.pop("time")
    if not any("level" in dims for dims, _ in variables.values()):
        coords.pop("level")
    return dataset(mast.rest.p, variables, coords)


def _forces(forces: Forces, outputs: tuple[str, ...], moved: np.ndarray, guys: str) -> dict[str, Any]:
    """Return section forces and reactions over time, and their extremes and envelopes over the outputs of the window."""
    run = forces.run
    counted = within(run.request.times[: run.completed], run.request.window)
    variables = over_time(forces, outputs)
    if "extremes" in outputs and counted.any():
        of_window = forces.bending_moment[counted]
        for name, values in (("minimum", of_window.min(axis=0)), ("maximum", of_window.max(axis=0))):
            variables[f"bending_moment_{name}"] = (("node", "coordinate"), spatial(values))
    if ENVELOPES in outputs and counted.any() and not run.status:
        variables |= envelopes(forces, moved, counted, guys)
    return variables


def _extremes(mast: ModalMast, run: MastTrajectory) -> dict[str, Any]:
    """Return extremes, means and standard deviations over all steps of the window."""
    step, count, result = run.request.step, run.counted, {}
    for name, dims, found in (
        ("displacement", ("level", "coordinate"), run.of_levels),
        ("guy_tension", ("guy",), run.of_tensions),
    ):
        if not found.least.size:
            continue
        mean = found.total / count
        std = np.sqrt(np.maximum(found.squares / count - mean * mean, 0.0))
        values = {
            "minimum": found.least, "maximum": found.largest, "mean": mean, "std": std,
            "minimum_time": found.least_step * step, "maximum_time": found.largest_step * step,
        }  # fmt: skip
        for what, numbers in values.items():
            result[f"{name}_{what}"] = (dims, spatial(numbers) if dims[-1] == "coordinate" else numbers)
    used = utilisation_of((guy.p for guy in mast.rest.p.guys), run.of_tensions.largest)
    return result if used is None else result | {"utilisation": (("guy",), used)}


def guy_fatigue(motion: xr.Dataset, window: tuple[float, float] | None = None) -> xr.DataArray | None:
    """Return the equivalent range of the tension of each guy [N], over a run or its window; None without guys or two instants.

    Parameters
    ----------
    motion
        Result of :func:`cablepod.mast.simulate` with the output "guy_tension", with or without ``member``.
    window
        Start and end [s] of the part that counts.
    """
    if "guy_tension" not in motion or not motion.sizes["guy"]:
        return None
    tension = motion["guy_tension"]
    if window is not None:
        tension = tension.isel(time=within(tension["time"].values, window))
    if tension.sizes["time"] < 2:
        return None
    warn_of_cut_cycles(tension, EXPONENT, "the fatigue range")
    return fatigue.equivalent(tension, exponent=EXPONENT, frequency=FREQUENCY).assign_attrs(
        units="N", long_name=f"equivalent tension range of the guy, exponent {EXPONENT:g}, one cycle in a second"
    )
