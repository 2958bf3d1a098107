"""Define the commands of periodic responses: frequency responses and tongues of instability."""

from __future__ import annotations

import signal
import sys
import tomllib
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from cablepod import archive
from cablepod.archive._figure import write_figure
from cablepod.archive._folder import check_folder, new_results
from cablepod.cli import _arguments, _group, _process
from cablepod.cli._group import say
from cablepod.cli._progress import Bars
from cablepod.errors import RunStopped, SceneError
from cablepod.examples import scene_path
from cablepod.parameters import _checks
from cablepod.parameters._from_scene import parameters
from cablepod.parameters._key_paths import nested
from cablepod.scene._make import _make as make_scene
from cablepod.scene._read import read_scene

#: Files of both commands.
RESPONSE, MODES, MAP = "frequency_response.nc", "modes.nc", "stability_map.nc"
RESPONSE_FIGURES = ("frequency_response.png", "tension.png", "multipliers.png")
MAP_FIGURES = ("growth.png", "response.png")
#: Ratio of the largest amplitude of a map to that of the scene above which it may be in mm: between 1 and 1000.
MUCH = 30.0
#: Maximum number of frequencies, and of amplitudes, of a map: of more the table alone takes hours.
MOST_POINTS = 10_000
#: Number of vibration modes without a file of modes.
RANK = 3


def respond(
    scene: str, out: str, frequency: tuple[float, float], modes: str | None, rank: int, hertz: bool, overwrite: bool,
    verify: bool,
) -> int:  # fmt: skip
    """Follow periodic responses over frequency; write them, print the table of bifurcations."""
    from cablepod import periodic

    _group.import_matplotlib()
    files = RESPONSE, MODES, *RESPONSE_FIGURES
    folder, dataset, chosen = _prepared(scene, out, modes, rank, files, overwrite, verify)
    low, high = _angular(frequency, hertz, dataset)
    with _saying_of_damping(dataset), Bars() as bars:
        bars("frequency response", 0.0)
        compute = partial(periodic.frequency_response, dataset, chosen, frequency=(low, high))
        result, status = _kept(partial(compute, progress=partial(bars, "frequency response")))
    from cablepod import plots

    of_tension = partial(plots.frequency_response, variable="tension_maximum", hertz=hertz)
    drawings = (partial(plots.frequency_response, hertz=hertz), of_tension, plots.multipliers)
    _write(folder, files, (result, chosen), drawings, _response_table(result, hertz))
    return status


def tongues(
    scene: str, out: str, frequency: tuple[float, float], amplitude: float, modes: str | None, rank: int, points: int,
    hertz: bool, overwrite: bool, verify: bool,
) -> int:  # fmt: skip
    """Map the stability over frequency and amplitude; write the map, print the widest tongues."""
    from cablepod import periodic

    _group.import_matplotlib()
    from cablepod import plots

    _checks.integer(least=2, most=MOST_POINTS)("--points", points)
    _checks.number(above=0.0)("--amplitude", amplitude)
    files = MAP, MODES, *MAP_FIGURES
    folder, dataset, chosen = _prepared(scene, out, modes, rank, files, overwrite, verify)
    low, high = _angular(frequency, hertz, dataset)
    if not low < high:
        raise SceneError(f"--frequency: given {frequency[0]:g} {frequency[1]:g}; allowed: the lower one first")
    _note_of_amplitude(amplitude, dataset)
    with _saying_of_damping(dataset), Bars() as bars:
        omega, rising = np.linspace(low, high, points), amplitude * np.arange(1, points + 1) / points
        compute = partial(periodic.stability_map, dataset, chosen, frequency=omega, amplitude=rising)
        result, status = _kept(partial(compute, progress=partial(bars, "stability map")))
    draw = partial(plots.stability_map, hertz=hertz)
    drawings = draw, partial(draw, variable="response")
    _write(folder, files, (result, chosen), drawings, _map_table(result, hertz))
    return status


def _angular(frequency: tuple[float, float], hertz: bool, scene: xr.Dataset) -> tuple[float, float]:
    """Return the range of angular frequencies [rad/s]; say so where that of the scene lies in it as Hz alone."""
    from cablepod.periodic._forcing import periodic_forcing

    low, high = frequency
    in_hertz = 2.0 * np.pi * low, 2.0 * np.pi * high
    omega = periodic_forcing(parameters(scene)).omega
    if hertz:
        return in_hertz
    if not low <= omega <= high and in_hertz[0] <= omega <= in_hertz[1]:
        _group.note(
            f"--frequency: {low:g} to {high:g} rad/s; the forcing of the scene has {omega:.4g} rad/s, "
            f"{omega / (2.0 * np.pi):.4g} Hz; given in Hz? then --hertz"
        )
    return low, high


def _note_of_amplitude(amplitude: float, scene: xr.Dataset) -> None:
    """Say so where the largest amplitude is that of the scene in another unit: hundreds of times larger."""
    from cablepod.periodic._forcing import periodic_forcing

    own = periodic_forcing(parameters(scene))
    if own.units == "m" and amplitude > MUCH * own.amplitude > 0.0:
        _group.note(
            f"--amplitude: up to {amplitude:g} m, {amplitude / own.amplitude:.0f} times that of the scene, {own.amplitude:g} m; "
            f"given in mm? then {1e-3 * amplitude:g}"
        )


def _kept(compute: Callable[[], xr.Dataset]) -> tuple[xr.Dataset, int]:
    """Return a result and status 0, or after Ctrl-C what was computed until then and the status of that."""
    try:
        return compute(), 0
    except RunStopped as error:
        if error.partial is None:
            raise
        return error.partial, _group.fail(str(error), status=_process.STATUS[signal.SIGINT])


def _prepared(
    scene: str, out: str, modes: str | None, rank: int, files: tuple[str, ...], overwrite: bool, verify: bool
) -> tuple[Path, xr.Dataset, xr.Dataset]:
    """Return folder, scene without ramps, and modes, after the checks of all of them; nothing is written."""
    from cablepod import condensed
    from cablepod.periodic._forcing import periodic_forcing

    folder = _arguments.folder(out)
    dataset = _without_ramps(scene_path(scene))
    periodic_forcing(parameters(dataset))  # refuses other forcing
    chosen = archive.read(modes, verify=verify) if modes else condensed.vibration_modes(dataset, rank=rank)
    check_folder(folder, files, overwrite=overwrite, key="--out")
    return folder, dataset, chosen


def _without_ramps(path: str | Path) -> xr.Dataset:
    """Return the scene of a file without the ramps of its motions and loads, which a periodic response has not; say so."""
    scene = read_scene(path)
    keys = [f"{key}.ramp" for key, function in parameters(scene).time_functions().items() if function.ramp]
    if not keys:
        return scene
    _group.note(f"left out: {', '.join(keys)}, as a periodic response has no start")
    tables = nested(tomllib.loads(Path(path).read_text(encoding="utf-8-sig")))
    tables = {key: table for key, table in tables.items() if key != "ensemble"}  # its ranges may name a ramp
    return make_scene(_pruned(tables), Path(path).parent)


def _pruned(table: Any) -> Any:
    """Return tables without their key ramp."""
    if isinstance(table, list):
        return [_pruned(entry) for entry in table]
    if not isinstance(table, dict):
        return table
    return {key: _pruned(value) for key, value in table.items() if key != "ramp"}


@contextmanager
def _saying_of_damping(scene: xr.Dataset) -> Iterator[None]:
    """Say before a long run that there is no damping; the warning after it is left out then."""
    with warnings.catch_warnings():
        p = parameters(scene)
        dampers = any(attachment.damper for attachment in p.attachments)
        if not (p.mass_damping or p.tension_damping or p.damping_ratios or dampers):
            _group.note(
                "damping is zero: responses that are not unstable are neutral, not attracting, and may have so many branches "
                "that it takes minutes; give damping.mass_proportional"
            )
            warnings.filterwarnings("ignore", message="damping is zero")
        yield


def _write(
    folder: Path, files: Sequence[str], datasets: Sequence[xr.Dataset], drawings: Sequence[Any], table: str
) -> None:
    """Write Datasets and figures of the first one into the files, print a table and what was written.

    Beside an older result, which it does not replace, one that was interrupted has a file of another name, without figures.
    """
    incomplete = files[0].replace(".nc", "_incomplete.nc")
    replaced: Sequence[str] = (*files, incomplete)
    if "incomplete" in datasets[0].attrs and (folder / files[0]).exists():
        files, datasets, drawings = (incomplete,), datasets[:1], ()
        replaced = files
    count = len(datasets)
    with new_results(folder, replaced) as new:
        for name, dataset in zip(files[:count], datasets, strict=True):
            archive.write(dataset, new / name)
        for name, draw in zip(files[count:], drawings, strict=True):
            write_figure(draw(datasets[0]).figure, new / name, title=str(datasets[0].attrs["title"]))
    say(table)
    say(f"\n{folder}: {', '.join(files)}")
    sys.stdout.flush()  # not at the end after a signal


def _frequencies(values: np.ndarray, hertz: bool) -> np.ndarray:
    return values / (2.0 * np.pi) if hertz else values


def _response_table(result: xr.Dataset, hertz: bool) -> str:
    """Return branches and bifurcations as text."""
    unit = "Hz" if hertz else "rad/s"
    omega = _frequencies(result["angular_frequency"].values, hertz)
    lines = [str(result.attrs["title"]), "", f"{'branch':<8}{'points':>8}{'periods':>9}{f'from [{unit}]':>14}{f'to [{unit}]':>14}"
             f"{'deflection [m]':>16}{'stable':>9}  ended"]  # fmt: skip
    for number in np.unique(result["branch"].values):
        which = result["branch"].values == number
        part, size = omega[which], result["deflection_maximum"].values[which]
        share = 100.0 * result["stable"].values[which].mean()
        lines.append(
            f"{number:<8}{which.sum():>8}{result['periods'].values[which][0]:>9}{part.min():>14.6g}{part.max():>14.6g}"
            f"{size.max():>16.4g}{share:>7.0f} %  {result.attrs[f'branch_{number}_ended']}"
        )
    lines += ["", "deflection: the largest from its mean over a period"]
    if not result.sizes["bifurcation"]:
        return "\n".join([*lines, "", "no bifurcation in this range"])
    lines += ["", f"{'bifurcation':<18}{'set':<14}{f'at [{unit}]':>14}{'branch':>8}{'leads to':>10}"]
    at = _frequencies(result["bifurcation_angular_frequency"].values, hertz)
    for k in range(result.sizes["bifurcation"]):
        kind, which_set = (str(result[f"bifurcation_{name}"].values[k]).replace("_", " ") for name in ("kind", "set"))
        leads = int(result["leads_to"].values[k])
        lines.append(
            f"{kind:<18}{which_set:<14}{at[k]:>14.8g}{result['bifurcation_branch'].values[k]:>8}{leads or '-':>10}"
        )
    lines += ["", "leads to: branch that begins there, - where none was followed"]
    return "\n".join(lines)


def _map_table(result: xr.Dataset, hertz: bool) -> str:
    """Return shares of stable and other points, and the least amplitude of each kind of instability as text."""
    unit, metre = "Hz" if hertz else "rad/s", result["amplitude"].attrs["units"]
    kinds = result["kind"].values
    lines = [
        str(result.attrs["title"]),
        "",
        f"{'kind':<18}{'share':>8}{f'least amplitude [{metre}]':>22}{f'at [{unit}]':>14}",
    ]
    omega = _frequencies(result["angular_frequency"].values, hertz)
    for kind in np.unique(kinds):
        rows, columns = np.nonzero(kinds == kind)
        line = f"{str(kind).replace('_', ' ') or 'not computed':<18}{100.0 * rows.size / kinds.size:>6.1f} %"
        if kind not in ("", "stable"):
            first = int(np.argmin(rows))
            line += f"{result['amplitude'].values[rows[first]]:>22.4g}{omega[columns[first]]:>14.6g}"
        lines.append(line)
    return "\n".join([*lines, "", f"{result.sizes['edge']} edges of stable regions located"])
