"""The vocabulary: dimensions and their labels, names, units and long names of variables and attributes."""

from __future__ import annotations

import math
from collections.abc import Container, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import numpy as np

COORDINATES = ("x", "y", "z")
ENDS = ("lower", "upper")
#: Similarity numbers, at rest in still air or maxima over time; T is the mean tension of the ends there, L the length:
#: "irvine_parameter": (q_n L / T)^2 K / T, q_n the load per length normal to the chord: softening of the cable by its sag;
#: "pull_along": q_t L / T, tension increase along the cable by the load along the chord;
#: "end_motion": change of the distance of the ends over the elastic stretch T L / K;
#: "end_acceleration": mu L a / T, a the largest acceleration of either end normal to the chord;
#: "frequency": 2 pi over the shortest time scale of ends and loads, over the first transverse frequency pi / L sqrt(T / mu);
#: "other_loads": point loads and change of the uniform load, over T.
FEATURES = ("irvine_parameter", "pull_along", "end_motion", "end_acceleration", "frequency", "other_loads")
#: Labels of dimensions in their order; those of modes (None) are whole numbers and rise.
LABELS: dict[Any, list[str] | None] = {
    "coordinate": list(COORDINATES),
    "end": list(ENDS),
    "bound": ["least", "largest"],
    "feature": list(FEATURES),
    "mode": None,
}
#: Dimensions whose labels have an order.
ORDERED = (*LABELS, "time")
OUTPUTS = ("position", "velocity", "tension", "tension_extremes", "tension_peaks", "tension_mean", "tension_rms")
#: Values of ``air``, which says in which air a result is at rest: without wind, and for members that differ in it.
STILL_AIR, AIR_OF_EACH = "still air", "that of each member: its mean wind, or still air without wind or with a ramp"
#: Endings of numbers at rest where the scene has wind, and in which air they are; those without an ending are at rest in the air
#: of the scene.
ENDINGS_OF_AIR = {
    "": "in the mean wind, with a ramp in still air",
    "_still_air": "in still air",
    "_mean_wind": "in the mean wind",
}
#: Value of ``failure`` where Ctrl-C came before the point or the member was computed; also the end of a branch.
INTERRUPTED = "interrupted"
#: Name -> (units, long name) of results; :mod:`cablepod.parameters._keys` has the parameters of scenes.
VARIABLES: dict[str, tuple[str, str]] = {
    # coordinates
    "time": ("s", "time since the start of the run"),
    "coordinate": ("1", "axis of the position, y pointing up"),
    "arc_length": ("m", "unstretched arc length from the lower end"),
    "link_arc_length": ("m", "unstretched arc length from the lower end to the middle of the link"),
    "particle_mass": ("kg", "mass of the particle"),
    "link_number": ("1", "number of the link, 1 at the lower end"),
    "mode": ("1", "number of the mode, from 1, by falling singular value"),
    "end": ("1", "end of the cable"),
    "member": ("1", "number of the member of an ensemble"),
    # statics
    "position": ("m", "position"),
    "tension": ("N", "tension"),
    "unstretched_length": ("m", "unstretched length of the cable"),
    "stretched_length": ("m", "stretched length of the cable"),
    "horizontal_force": ("N", "component of the tension normal to the total load, constant along the cable"),
    "tension_lower": ("N", "tension at the lower end"),
    "tension_upper": ("N", "tension at the upper end"),
    "residual": ("N", "largest unbalanced force on a free particle"),
    # trajectories
    "velocity": ("m s-1", "velocity"),
    "tension_minimum": (
        "N",
        "smallest tension of the link over all steps of the run, not at output times between them",
    ),
    "tension_maximum": ("N", "largest tension of the link over all steps of the run, not at output times between them"),
    "tension_mean": ("N", "time mean of the tension of the link"),
    "tension_rms": ("N", "root mean square of the tension of the link over time"),
    "tension_minimum_time": ("s", "time of the smallest tension of all links"),
    "tension_maximum_time": ("s", "time of the largest tension of all links"),
    "tension_minimum_arc_length": (
        "m",
        "unstretched arc length from the lower end to the link of the smallest tension",
    ),
    "tension_maximum_arc_length": ("m", "unstretched arc length from the lower end to the link of the largest tension"),
    "end_position": ("m", "position of the ends"),
    "normal_reference": ("1", "direction that the first normals of the chord refer to"),
    "amplitude": ("m", "amplitude of the mode"),
    # small vibrations
    "angular_frequency": ("rad s-1", "angular frequency of small vibrations about rest"),
    "out_of_plane_share": ("1", "share of the mean square of the shape normal to the plane of chord and load"),
    # modes
    "mode_shape": ("1", "Karhunen-Loeve mode, of unit norm in the inner product of the decomposition"),
    "singular_value": ("m", "singular value of the snapshot matrix, centred and lifted unless of deflections"),
    "singular_value_uncertainty": ("m", "estimate of the error of the singular value on the route taken"),
    "mode_uncertainty": ("rad", "estimate of the angle by which that error may turn the mode"),
    "truncation_error": ("1", "root of the share of the energy that the modes do not hold"),
    "proper_orthogonal_value": (
        "m2",
        "proper orthogonal value, the squared singular value over the number of snapshots",
    ),
    "energy_share": ("1", "squared singular value over the sum of all squares"),
    "singular_value_share": ("1", "singular value over the sum of all singular values"),
    "mean": ("m", "time mean of the lifted position"),
    # training scenes
    "feature": ("1", "number without dimension that decides how a scene moves"),
    "bound": ("1", "least or largest of the training scenes"),
    "scene_feature": ("1", "numbers without dimension that decide how the scene moves"),
    "training_range": ("1", "least and largest of these numbers over the training scenes"),
    # comparison
    "error": ("1", "rms distance over the particles, over the largest rms displacement of the truth"),
    "error_max": ("1", "largest error over time"),
    "error_rms": ("1", "root mean square of the error over time"),
    "displacement_scale": ("m", "length by which the error is divided"),
}
#: Name -> (units, long name) of numeric attributes, which become variables along ``member`` where members differ.
ATTRIBUTES: dict[str, tuple[str, str]] = {
    # steps and errors
    "step": ("s", "time step"),
    "step_limit": ("s", "largest stable time step"),
    "shortest_time_scale": ("s", "shortest time scale of the motion of the ends and of the loads"),
    "number_of_steps": ("1", "number of time steps"),
    "steps_cut": ("1", "number of steps divided into substeps"),
    "newton_iterations": ("1", "number of Newton iterations"),
    "spectral_radius": ("1", "spectral radius of the scheme at high frequencies"),
    "error_estimate": (
        "1",
        "estimated largest error over time as a fraction of the motion; of masts the rms error of a guy's tension over its "
        "standard deviation",
    ),
    "time_error_estimate": ("1", "estimated error of the time step as a fraction of the motion"),
    "tension_time_error_estimate": (
        "1",
        "estimated error of the tensions by the time step as a fraction of their range",
    ),
    "space_error_estimate": ("1", "estimated error of the links or elements as a fraction of the motion"),
    "elements": ("1", "number of elements"),
    "element_order": ("1", "polynomial order of the elements"),
    "rank": ("1", "number of modes"),
    "window_start": ("s", "start of the window of extremes and means"),
    "window_end": ("s", "end of the window of extremes and means"),
    # frequencies
    "highest_angular_frequency": ("rad s-1", "bound of all angular frequencies"),
    "first_axial_frequency": ("rad s-1", "first axial angular frequency"),
    "forcing_over_axial_frequency": ("1", "angular frequency of the forcing over the first axial one"),
    "largest_turn_rate": ("rad s-1", "largest rotation rate of a link"),
    # energies
    "energy_excess": ("1", "largest ratio of the strain energy to the energy that the forcing can supply"),
    "energy_defect": ("1", "largest unexplained energy over the largest exchanged energy"),
    "energy_drift": ("1", "largest imbalance of energy over the exchanged energy"),
    "energy_exchanged": ("J", "largest exchanged energy"),
    # forces and stretches
    "smallest_tension": ("N", "smallest tension at the output times"),
    "links_in_compression": ("1", "number of links in compression at an output time"),
    "first_compression": ("s", "first output time with a link in compression"),
    "smallest_chordwise_force": ("N", "smallest chordwise force"),
    "time_of_smallest_force": ("s", "time of the smallest chordwise force"),
    "smallest_stretch": ("1", "smallest stretch"),
    "smallest_stretch_time": ("s", "time of the smallest stretch"),
    "smallest_stretch_arc_length": ("m", "unstretched arc length of the smallest stretch"),
    "largest_stretch": ("1", "largest stretch"),
    "tension_above_linear_law": ("1", "tension at the largest stretch over that of the linear law, less 1"),
    "first_slack_time": ("s", "first time with a stretch below 1"),
    "first_slack_arc_length": ("m", "unstretched arc length of the first stretch below 1"),
    "length_error": ("1", "largest relative error of a link length"),
    # validity
    "energy_share_kept": ("1", "share of the energy of the snapshots in the modes of the model"),
    "outside_training": ("1", "distance from the training range, 0 inside"),
    # start
    "start_jolt_speed": ("m s-1", "jump of speed of the ends at the start"),
    "start_jolt_tension": ("N", "tension of the axial wave from the jump of speed"),
    "start_jolt_energy": ("J", "energy of the axial wave from the jump of speed"),
    **{
        f"motion_{end}_{axis}_offset": ("m", f"motion of the {end} end along {axis} at t = 0, subtracted")
        for end in ENDS
        for axis in COORDINATES
    },
}
VARIABLES |= {
    f"{name}_out_of_plane": (VARIABLES[name][0], f"{VARIABLES[name][1]}, out of the plane of chord and vertical")
    for name in (
        "amplitude", "mode_shape", "singular_value", "singular_value_uncertainty", "mode_uncertainty",
        "truncation_error", "proper_orthogonal_value", "energy_share", "singular_value_share", "angular_frequency",
    )
}  # fmt: skip
#: Units of further results, of masts, periodic responses and the wind; their sub-packages have the long names.
UNITS: dict[str, str] = {
    **dict.fromkeys(
        (
            "amplitude_of_mode", "amplitude_of_mode_out_of_plane", "anchor", "bifurcation_deflection_maximum",
            "deflection_maximum", "displacement", "displacement_maximum", "displacement_mean", "displacement_minimum",
            "displacement_std", "edge_amplitude", "guy_length", "guy_level", "guy_position", "level", "node_height", "response",
        ), "m",
    ),
    **dict.fromkeys(
        (
            "axial_force", "end_force", "guy_force", "guy_tension", "guy_tension_anchor", "guy_tension_maximum",
            "guy_tension_mean", "guy_tension_minimum", "guy_tension_std",
        ), "N",
    ),
    **dict.fromkeys(("bending_moment", "bending_moment_maximum", "bending_moment_minimum"), "N m"),
    **dict.fromkeys(
        (
            "displacement_maximum_time", "displacement_minimum_time", "guy_tension_maximum_time",
            "guy_tension_minimum_time",
        ), "s",
    ),
    **dict.fromkeys(("bifurcation_angular_frequency", "edge_angular_frequency"), "rad s-1"),
    **dict.fromkeys(("growth", "growth_in_plane", "growth_out_of_plane"), "s-1"),
    **dict.fromkeys(("mean_wind", "wind"), "m s-1"),
}  # fmt: skip


def attribute_labels(name: str) -> dict[str, str]:
    """Return units and long name of an attribute that becomes a variable along ``member``."""
    units, long_name = ATTRIBUTES.get(name, ("1", name.replace("_", " ")))
    return {"units": units, "long_name": long_name}


def names_in_air(names: Mapping[str, tuple[str, str]], present: Container[Any]) -> dict[str, tuple[str, str]]:
    """Return units and long names of those numbers at rest that are present, with the air in which they are in wind."""
    named = {name: given for name, given in names.items() if name in present}
    for name, (units, text) in list(named.items()):
        endings = {ending: air for ending, air in ENDINGS_OF_AIR.items() if f"{name}{ending}" in present}
        if len(endings) > 1:
            named |= {f"{name}{ending}": (units, f"{text}, {air}") for ending, air in endings.items()}
    return named


def is_in_order(name: str, labels: Any) -> bool:
    """Tell whether labels of a dimension are those of the package in their order, or instants finite and rising.

    Labels are an array, or an index of pandas.
    """
    own = LABELS.get(name)
    if own is not None:
        return labels.size > 1 and labels.tolist() == own[: labels.size]
    numbers = "fiu" if name == "time" else "iu"
    if labels.dtype.kind not in numbers or not labels.size or labels.ndim > 1:
        return False
    return math.isfinite(labels[0]) and math.isfinite(labels[-1]) and is_rising(labels)


def is_rising(values: np.ndarray) -> bool:
    """Tell whether each number of an array exceeds the one before."""
    return 0 not in (values[1:] > values[:-1]).tobytes()  # the method ``all`` takes five times as long
