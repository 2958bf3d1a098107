"""Measure errors of trained test functions near the scenes of training, and far away.

    python pipelines/prediction/trained_reach.py [--out FOLDER] [--readme] [--quick]

Writes trained_reach.nc.  Around Example 3, tension, size and frequency of the motion are each changed by up to a relative reach.
Test functions are trained on Example 3 alone, and on it and the eight corners of the reach, and tested on scenes drawn between.
Those trained on Example 3 alone are tested on scenes far away too, the guys of prediction/run.py.  For every test scene: the
maximum error over time of the condensed model with the modes as test functions and with trained ones, and the projection error
of the modes, over the motion.  The truth is the chain of 40 links.
"""

from __future__ import annotations

import itertools
import sys
import time
import warnings
from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import xarray as xr
from _study import command_line, markdown_table, percent, update_tables
from tqdm import tqdm

import cablepod as cp
from cablepod import examples as shipped
from prediction.run import projection_error
from prediction.scenes import LINKS, Case, cases

HERE = Path(__file__).resolve().parent
#: Orders and numbers of modes.
MODELS = (("leading", 3), ("leading", 4))
REACHES = (0.05, 0.2)
TESTED, SEED, FAR_SEED = 12, 5, 1974
KINDS = ("projection", "modes", "trained")


class Near(Case):
    """Example 3 with other tension, size and frequency of the motion."""

    def __init__(self, parts: tuple[float, ...], duration: float) -> None:
        super().__init__({"tension": parts[0], "size": parts[1], "frequency": parts[2]}, duration)

    @cached_property
    def scene(self) -> xr.Dataset:
        """The scene."""
        given = shipped.scene("example3")
        named = {
            "cable_top_tension": "tension", "motion_upper_x_amplitude": "size", "motion_upper_x_angular_frequency": "frequency",
        }  # fmt: skip
        changed = {name: given[name] * self.values[key] for name, key in named.items()}
        return given.assign({**changed, "time_duration": self.duration, "time_interval": 0.1})


def error(case: Case, modes: xr.Dataset, rank: int, order: str) -> float:
    """Return the maximum error over time, infinite if the model stops or refuses."""
    try:
        run = cp.condensed.simulate(
            case.scene, modes, rank=rank, order=order, times=case.truth["time"].values, tolerance=1e-5,
            outputs=("position",),
        )  # fmt: skip
    except (cp.RunStopped, cp.SceneError):
        return np.inf
    return float(cp.compare.errors(run, case.truth)["error_max"])


def train(
    samples: list[Near], tested: list[Case], models: tuple[tuple[str, int], ...], progress: Callable[..., Any]
) -> np.ndarray:
    """Train on samples and return the errors (model, test scene, kind)."""
    modes = cp.pod.decompose([item.truth for item in samples], layout="normal", rank=max(rank for _, rank in models))
    result = np.empty((len(models), len(tested), len(KINDS)))
    for i, (order, rank) in enumerate(progress(models)):
        scenes, runs = [item.scene for item in samples], [item.truth for item in samples]
        trained = cp.oblique.train(scenes, runs, modes, rank=rank, order=order)
        for j, case in enumerate(tested):
            result[i, j] = (
                projection_error(case, modes, rank),
                error(case, modes, rank, order),
                error(case, trained, rank, order),
            )
    return result


def report(
    *,
    models: tuple[tuple[str, int], ...] = MODELS,
    tested: int = TESTED,
    duration: float = 125.0,
    progress: Callable[..., Any] = iter,
) -> xr.Dataset:
    """Train and test; return a Dataset over (where, model, scene, kind)."""
    random = np.random.default_rng(SEED)
    centre = Near((1.0, 1.0, 1.0), duration)
    found, names = [], []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", cp.OutOfRangeWarning)
        warnings.simplefilter("ignore", cp.NotConvergedWarning)  # far away some motions are chaotic
        for reach in REACHES:
            near: list[Case] = [Near(tuple(1.0 + reach * random.uniform(-1, 1, 3)), duration) for _ in range(tested)]
            corners = [
                Near(tuple(1.0 + reach * np.array(sign)), duration) for sign in itertools.product((-1, 1), repeat=3)
            ]
            for samples in ([centre], [centre, *corners]):
                found.append(train(samples, near, models, progress))
                names.append(f"within {100 * reach:.0f} %, trained on {len(samples)}")
        far = [case for case in cases(2 * tested, FAR_SEED, duration) if not case.apart]
        far_errors = train([centre], far, models, progress)
    result = xr.Dataset(
        {
            "error": (("where", "model", "scene", "kind"), np.array(found)),
            "far_error": (("model", "far_scene", "kind"), far_errors),
        },
        coords={"where": names, "model": [f"{order}, r = {rank}" for order, rank in models], "kind": list(KINDS)},
    )
    for name in result.variables:
        result[name].attrs["units"] = "1"
        result[name].attrs["long_name"] = (
            "largest error over time, over the motion" if "error" in str(name) else str(name)
        )
    result.attrs.update(title="Reach of trained test functions", stage="comparison", duration=duration, links=LINKS)
    return result


def table(result: xr.Dataset) -> str:
    """Write median and maximum errors, and the number of gains by training."""
    lines = []
    parts = [(str(name), result["error"].sel(where=name).values) for name in result["where"].values]
    for name, values in [*parts, ("far away, trained on 1", result["far_error"].values)]:
        for model, own in zip(result["model"].values, values, strict=True):
            cells = [f"{percent(np.median(own[:, k]))}, {percent(own[:, k].max())}" for k in range(len(KINDS))]
            lines.append([name, str(model), *cells, f"{int((own[:, 2] < own[:, 1]).sum())} of {len(own)}"])
    head = ["scenes", "model", *(f"{kind}, median, largest" for kind in KINDS), "training gains"]
    return markdown_table(head, lines)


def main() -> None:
    """Train, test, write and print."""
    quick = "one model, two scenes of 10 s each"
    given = command_line(__doc__, out="out/trained_reach", readme=True, quick=quick).parse_args()
    begin = time.perf_counter()
    options: dict[str, Any] = {"models": (("leading", 2),), "tested": 2, "duration": 10.0} if given.quick else {}
    result = report(progress=tqdm, **options)
    given.out.mkdir(parents=True, exist_ok=True)
    cp.archive.write(result, given.out / "trained_reach.nc", overwrite=True)
    if given.readme:
        update_tables(HERE / "README.md", {"trained_reach": table(result)})
    print(table(result))
    print(f"{time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
