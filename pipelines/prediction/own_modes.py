"""Compare the error estimate of the condensed model with the error, on bases that users bring.

    python pipelines/prediction/own_modes.py [--out FOLDER] [--scenes COUNT] [--readme] [--quick]

Scenes of the prediction study, each against its chain of 40 links.  Bases, 1 to 8 shapes of each:
"sines": sin(k pi sigma).
"Legendre": sigma (1 - sigma) times the Legendre polynomials of 2 sigma - 1.
"random": combinations of twelve sines with normal weights over the squared number, another draw for each scene.
"POD": each scene's own chain.
"vibration": cp.condensed.vibration_modes of each scene.
"static and vibration": the same with static modes.

Runs have the default step.  Errors and estimates above CUT both count as CUT, as larger estimates are cut there.  A scene counts
as sagging where its deflection at rest exceeds SAG of the chord.  Writes own_modes.nc.
"""

from __future__ import annotations

import sys
import time
import warnings
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import xarray as xr
from _study import command_line, markdown_table, update_tables
from tqdm import tqdm

import cablepod as cp
from cablepod.condensed._estimate import MAX_ERROR as CUT
from cablepod.pod import _normal as pod_normal
from prediction.run import sines
from prediction.scenes import LINKS, Case, cases

HERE = Path(__file__).resolve().parent
BASES = ("sines", "Legendre", "random", "POD", "vibration", "static and vibration")
RANKS = tuple(range(1, 9))
ORDERS = ("leading", "exact")
#: Scenes and seed of the prediction study.
SCENES, SEED = 48, 1974
#: Deflection at rest over the chord above which a scene counts as sagging.
SAG = 0.02
#: Number of sines in a random shape.
RANDOM_SINES = 12
#: Largest factor between estimate and error that counts as right.
FACTOR = 5.0


def basis(shape: np.ndarray) -> xr.Dataset:
    """Return modes of layout "normal" for shapes (mode, particle)."""
    return sines(len(shape)).assign(mode_shape=(("mode", "particle"), shape))


def bases(case: Case, number: int) -> dict[str, xr.Dataset]:
    """Return the bases of a scene; its number decides the random ones."""
    sigma, rank = np.linspace(0.0, 1.0, LINKS + 1), RANKS[-1]
    weight = np.random.default_rng(number).standard_normal((rank, RANDOM_SINES))
    weight /= np.arange(1, RANDOM_SINES + 1) ** 2
    legendre = np.polynomial.legendre.legvander(2.0 * sigma - 1.0, rank - 1).T * sigma * (1.0 - sigma)
    return {
        "sines": sines(rank),
        "Legendre": basis(legendre),
        "random": basis(weight @ sines(RANDOM_SINES)["mode_shape"].values),
        "POD": cp.pod.decompose(case.truth, layout="normal"),
        "vibration": cp.condensed.vibration_modes(case.scene, rank=rank),
        "static and vibration": cp.condensed.vibration_modes(case.scene, rank=rank, static_modes=True),
    }


def sag_of(case: Case) -> float:
    """Return the largest deflection at rest over the chord."""
    position = case.truth["position"].values[:1]
    chord = np.linalg.norm(position[0, -1] - position[0, 0])
    return float(np.abs(pod_normal.deflections(position)[0]).max() / chord)


def error_and_estimate(case: Case, modes: xr.Dataset, rank: int, order: str) -> tuple[float, float]:
    """Return the largest error over time and its estimate, not a number where the model stops or refuses."""
    try:
        run = cp.condensed.simulate(
            case.scene, modes, rank=rank, order=order, times=case.truth["time"].values,
            outputs=("position", "error_estimate"),
        )  # fmt: skip
    except (cp.RunStopped, cp.SceneError):
        return np.nan, np.nan
    return float(cp.compare.errors(run, case.truth)["error_max"]), float(run.attrs["error_estimate"])


def report(
    *, scenes: int = SCENES, seed: int = SEED, duration: float = 125.0,
    ranks: tuple[int, ...] = RANKS, orders: tuple[str, ...] = ORDERS,
) -> xr.Dataset:  # fmt: skip
    """Run all bases; return errors and estimates over (scene, basis, order, rank)."""
    tested = cases(scenes, seed, duration)
    shape = (len(tested), len(BASES), len(orders), len(ranks))
    found, sag = np.full((2, *shape), np.nan), np.empty(len(tested))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", cp.OutOfRangeWarning)
        warnings.simplefilter("ignore", cp.NotConvergedWarning)
        for i, case in enumerate(tqdm(tested, leave=False)):
            sag[i] = sag_of(case)
            modes = bases(case, i)
            for place in np.ndindex(shape[1:]):
                name, order, rank = BASES[place[0]], orders[place[1]], ranks[place[2]]
                if rank <= modes[name].sizes["mode"]:
                    found[:, i, *place] = error_and_estimate(case, modes[name], rank, order)
    place = ("scene", "basis", "order", "rank")
    result = xr.Dataset(
        {"error": (place, found[0]), "error_estimate": (place, found[1]), "sag": ("scene", sag)},
        coords={"basis": list(BASES), "order": list(orders), "rank": list(ranks)},
    )
    names = {
        "error": "largest error over time, over the motion of the chain",
        "error_estimate": "error as the model estimates it, without any truth",
        "sag": "largest deflection at rest over the chord",
    }
    for name in result.variables:
        result[name].attrs.update(units="1", long_name=names.get(str(name), str(name)))
    result.attrs.update(title="Error estimate on bases of users", stage="comparison", seed=seed, duration=duration)
    return result


def ratios(result: xr.Dataset) -> np.ndarray:
    """Return estimates over errors, both cut at CUT, of the runs that have both."""
    error, estimate = (result[name].values.ravel() for name in ("error", "error_estimate"))
    known = np.isfinite(error) & np.isfinite(estimate)
    return np.asarray(np.minimum(estimate[known], CUT) / np.minimum(error[known], CUT))


def within(ratio: np.ndarray) -> float:
    """Return the share of ratios within FACTOR."""
    return float(np.mean(np.abs(np.log(ratio)) <= np.log(FACTOR)))


def table(result: xr.Dataset) -> str:
    """Write the quality of the estimate by basis, for taut and sagging scenes."""
    lines, sags = [], result["sag"].values > SAG
    for name in [*BASES, "all"]:
        part = result if name == "all" else result.sel(basis=name)
        ratio = ratios(part)
        each = [ratios(part.isel(scene=np.flatnonzero(chosen))) for chosen in (~sags, sags)]
        shares = [f"{100.0 * within(values):.1f} %" if values.size else "-" for values in (ratio, *each)]
        spread = np.quantile(ratio, (0.0, 0.5, 1.0))
        lines.append([name, f"{ratio.size}", *shares, " / ".join(f"{value:.2g}" for value in spread)])
    head = ["basis", "runs", "within a factor of 5", "taut", "sagging", "estimate over error: least / median / largest"]
    return markdown_table(head, lines)


def main() -> None:
    """Run, write and print."""
    parser = command_line(__doc__, out="out/prediction", readme=True, quick="three scenes of 10 s, in seconds")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--scenes", type=int, default=SCENES, help="number of scenes")
    given = parser.parse_args()
    begin = time.perf_counter()
    options = {"scenes": 3, "duration": 10.0} if given.quick else {"scenes": given.scenes}
    result = report(seed=given.seed, **options)
    given.out.mkdir(parents=True, exist_ok=True)
    cp.archive.write(result, given.out / "own_modes.nc", overwrite=True)
    written = table(result)
    print(written)
    if given.readme:
        update_tables(HERE / "README.md", {"own_modes": written})
    print(
        f"{int((result['sag'] > SAG).sum())} of {result.sizes['scene']} scenes sag, {time.perf_counter() - begin:.0f} s"
    )


if __name__ == "__main__":
    main()
