"""Public function: stability over frequency and amplitude of the forcing."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import xarray as xr

from cablepod._inputs import NORMAL_MODES, SCENE, check_units, taken
from cablepod._resources import check_bytes
from cablepod.conventions import INTERRUPTED
from cablepod.errors import scene_error
from cablepod.parameters._checks import numbers_list
from cablepod.periodic import _output as output
from cablepod.periodic._map import HARMONICS, MapResult, compute_map
from cablepod.periodic._map_general import compute_general_map
from cablepod.periodic._members import each_member, model_of
from cablepod.periodic._model import PeriodicModel
from cablepod.periodic._solve import IN_PLANE, OUT_OF_PLANE

#: Names of the kinds of growth, by their numbers in ``_kernels_map``; those above one by the set of coordinates.
KINDS = (
    ("stable", "fold", "period_doubling", "torus", "none"),
    ("stable", "pitchfork", "period_doubling", "torus", "none"),
)
#: Numbers of all tables of an amplitude, for a pair of coordinates: three tables, four steps to a sample.
SAMPLES = 3 * 4 * (4 * HARMONICS + 4)
NO_ORBIT = "no periodic response found from rest or from smaller amplitudes"


def stability_map(
    scene: xr.Dataset,
    modes: xr.Dataset,
    *,
    frequency: Any,
    amplitude: Any,
    rank: int | None = None,
    out_of_plane: bool = True,
    progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Map the stability of periodic responses over frequency and amplitude of the forcing.

    Parameters
    ----------
    scene, modes
        As in :func:`orbit`.
    frequency
        Angular frequencies of the forcing [rad/s], increasing, in place of the scene's.
    amplitude
        Amplitudes of the forcing, increasing: of the largest motion [m], in place of the scene's.  All other motions and factors
        keep their ratio to it.  Without motions: of the largest factor of a load.
    rank
        Number of modes of each deflection; all by default.
    out_of_plane
        Whether disturbances out of the plane are judged in a planar scene.
    progress
        Callback receiving the completed fraction, which never falls and ends at 1.

    Returns
    -------
    xarray.Dataset
        ``growth_in_plane``, ``growth_out_of_plane (amplitude, angular_frequency)`` [1/s]: rates of the fastest disturbances
        of the response that grows from rest with the amplitude; ``response`` [m], its largest deflection from the mean; ``kind``
        ("stable", "fold", "pitchfork", "period_doubling", "torus", "none"), what the fastest disturbance does; ``failure``, why a
        point has no response, else empty; ``smallest_chordwise_force`` [N].  Along ``edge``: ``edge_angular_frequency`` [rad/s],
        ``edge_amplitude``, ``edge_set`` and ``edge_kind`` of the changes of stability between neighbouring frequencies, but for
        those where the response jumps.  With ``member`` edges of all members lie along one dimension each, filled with nan.

    Raises
    ------
    SceneError
        For a scene, modes or options that it does not support; the key is named.
    RunStopped
        On Ctrl-C; `partial` has the columns that were finished, else nan, no kind, and the ``failure`` "interrupted".

    Warns
    -----
    OutOfRangeWarning
        As :func:`orbit`.

    Notes
    -----
    Before the first amplitude the response grows in as many steps as it needs.  Where it folds back, another one is looked for
    from rest, and from the last one made larger and moved by parts of a period.

    With damping by the tension, by ratios or by dampers a point takes some milliseconds instead of a tenth of one.
    """
    scene, modes = taken("scene", scene, SCENE), taken("modes", modes, NORMAL_MODES)
    omegas, amplitudes = _grid("frequency", frequency), _grid("amplitude", amplitude)

    def one(scene: xr.Dataset, progress: Callable[[float], None]) -> xr.Dataset:
        model, _ = model_of(scene, modes, rank=rank, order="leading", out_of_plane=out_of_plane)
        check_units("amplitude", amplitude, model.forcing.units)
        if not model.forcing.amplitude:
            raise scene_error("amplitude", 0.0, "a scene with an amplitude other than 0, which is scaled")
        size = 8.0 * amplitudes.size * (omegas.size * (12 + 2 * HARMONICS) + SAMPLES * model.size) * model.size
        check_bytes(size, "frequency and amplitude", f"{omegas.size} x {amplitudes.size} points, {size / 1e9:.3g} GB")
        factors = amplitudes / model.forcing.amplitude
        models = [model.with_amplitude(float(factor)) for factor in factors]
        compute = compute_general_map if model.is_damped_beside_mass else compute_map
        found = MapResult.empty((amplitudes.size, omegas.size))
        try:
            compute(model, models, omegas, amplitudes, found, progress)
        except KeyboardInterrupt:
            if not found.finished.any():
                raise  # nothing to keep
            return labelled(model, found, omegas, amplitudes).assign_attrs(incomplete=1)
        result = labelled(model, found, omegas, amplitudes)
        output.warn_of_result(result.attrs, model.undamped)
        return result

    result = each_member(scene, one, progress)
    parameters = {
        "frequency": omegas, "amplitude": amplitudes, "rank": rank, "out_of_plane": bool(out_of_plane),
    }  # fmt: skip
    finished = f"{int((result['failure'] != INTERRUPTED).sum())} of {result['failure'].size} points"
    kept = finished if "incomplete" in result.attrs else ""
    return output.record(result, "periodic.stability_map", scene, modes, parameters, kept=kept)


def _grid(key: str, given: Any) -> np.ndarray:
    """Check increasing positive numbers."""
    if key == "frequency":
        check_units(key, given, "rad s-1")
    values = given.values if isinstance(given, xr.DataArray) else given
    array = np.array(numbers_list(above=0.0)(key, values))
    if (np.diff(array) <= 0.0).any():
        raise scene_error(key, given, "increasing numbers")
    return array


def labelled(model: PeriodicModel, found: MapResult, omegas: np.ndarray, amplitudes: np.ndarray) -> xr.Dataset:
    """Return a map as a Dataset."""
    grid = ("amplitude", "angular_frequency")
    sets = 2 if model.is_planar and model.size > model.n_in_plane else 1
    words = np.array(KINDS)
    fastest = np.zeros(found.response.shape, dtype=int)
    if sets == 2:
        growth = np.where(np.isnan(found.growth), -np.inf, found.growth)
        fastest = np.where(growth[1] > growth[0], 1, 0)
    number = np.take_along_axis(found.kind, fastest[None], axis=0)[0]
    # without those beside columns that an interrupted map lacks
    edges = [
        (omega, a, k, kind)
        for (k, a, f), (omega, kind) in sorted(found.edges.items())
        if found.finished[a, f : f + 2].all()
    ]
    variables: dict[str, Any] = {"growth_in_plane": (grid, found.growth[0])}
    if sets == 2:
        variables["growth_out_of_plane"] = (grid, found.growth[1])
    variables |= {
        "response": (grid, found.response),
        "kind": (grid, np.where(found.finished, words[fastest, number], "")),
        "failure": (grid, np.where(found.finished, np.where(np.isnan(found.response), NO_ORBIT, ""), INTERRUPTED)),
        "smallest_chordwise_force": (grid, found.smallest_force),
        "edge_angular_frequency": (("edge",), np.array([edge[0] for edge in edges])),
        "edge_amplitude": (("edge",), np.array([amplitudes[edge[1]] for edge in edges])),
        "edge_set": (("edge",), np.array([(IN_PLANE, OUT_OF_PLANE)[edge[2]] for edge in edges], dtype="U12")),
        "edge_kind": (("edge",), np.array([KINDS[edge[2]][edge[3]] for edge in edges], dtype="U15")),
    }
    units = model.forcing.units
    text = "amplitude of the largest motion" if units == "m" else "amplitude of the largest factor of a load"
    names = {
        "amplitude": (units, text),
        "growth_in_plane": ("s-1", "growth rate of the fastest disturbance in the plane"),
        "growth_out_of_plane": ("s-1", "growth rate of the fastest disturbance out of the plane"),
        "response": ("m", "largest deflection normal to the chord, from its mean over a period"),
        "kind": ("1", "what the fastest disturbance does"),
        "failure": ("1", "why the point has no response"),
        "edge": ("1", "number of the edge, from 1"),
        "edge_angular_frequency": ("rad s-1", "angular frequency of the forcing at the edge of a stable region"),
        "edge_amplitude": (units, f"{text} at the edge"),
        "edge_set": ("1", "coordinates of the disturbance"),
        "edge_kind": ("1", "what the disturbance does"),
    }
    coords = {"amplitude": amplitudes, "angular_frequency": omegas, "edge": np.arange(1, len(edges) + 1)}
    result = output.dataset(model, variables, coords, **names)
    least = found.smallest_force[np.isfinite(found.smallest_force)]
    result.attrs.update(
        smallest_chordwise_force=float(least.min(initial=np.inf)), **output.axial_attributes(model, float(omegas[-1]))
    )
    return result
