"""The command ``cablepod``: the main job on one scene, and what a file is."""

from __future__ import annotations

import argparse
import os
import sys
import time
import tomllib
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from cablepod import archive, catenary, chain, compare, ensemble, first_steps, galerkin, lineage, pod
from cablepod.archive_ensemble import MANIFEST, describe_ensemble
from cablepod.links import chain_of
from cablepod.parameters import parameters
from cablepod.scene import read_scene
from cablepod.schema import SceneError
from cablepod.shipped import scene_path, scenes
from cablepod.stepping import DEFAULT_TOLERANCE, RunStopped
from cablepod.whole import whole_file

#: Reports compare at every 0.1 s; longer runs at as many instants as 200 s have.
REPORT_INTERVAL, REPORT_INSTANTS = 0.1, 2000
#: Time error of reduced models in reports, where it stands beside larger ones.
REDUCED_TOLERANCE = 1e-5


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns its exit status, 0 or not 0 with one line on stderr."""
    parser = _parser()
    options = parser.parse_args(arguments)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("always")
            warnings.showwarning = _note  # put back on leaving
            return options.run(options)
    except (SceneError, archive.ArchiveError, RunStopped) as error:
        return _fail(str(error))
    except KeyboardInterrupt:
        return _fail("interrupted; every file that was written is whole, --overwrite begins anew", status=130)
    except BrokenPipeError:  # the reader of our output, such as head, has gone
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except MemoryError:
        return _fail("out of memory; try fewer links, instants or modes")
    except OSError as error:
        return _fail(f"{error.filename or 'a file could not be written'}: {error.strerror or error}")


def _note(message: Warning | str, *_: object, **__: object) -> None:
    """Show a warning as one line, without the place in the code that a user of the command has no use for."""
    print("cablepod: note: " + " ".join(str(message).split()), file=sys.stderr)


def _fail(message: str, status: int = 2) -> int:
    print("cablepod: " + " ".join(message.split()), file=sys.stderr)
    return status


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="cablepod",
        description="Reduced-order models of cable dynamics.",
        epilog="begin with: cablepod new guy.toml, or cablepod examples; cablepod COMMAND --help has examples of each",
    )
    parser.add_argument("--version", action="version", version=f"cablepod {version('cablepod')}")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    run = commands.add_parser(
        "run",
        help="simulate one scene: rest, chain, modes, reduced models and their errors",
        description="Rest, snapshots of the chain, modes, reduced models, their errors and run times, figures; all archived.",
    )
    run.add_argument("scene", metavar="SCENE.toml", help="scene file, or a shipped scene: " + ", ".join(scenes()))
    run.add_argument("--out", required=True, metavar="DIR", help="folder for netCDF files and figures; made if missing")
    run.add_argument(
        "--ranks",
        default="1,2,3,4",
        metavar="R,R",
        help="modes of each coordinate to try, 20 at most (default 1,2,3,4)",
    )
    run.add_argument("--overwrite", action="store_true", help="replace results that are already in DIR")
    run.set_defaults(run=_run)
    paper = commands.add_parser(
        "paper",
        help="set every table and figure of the paper beside our own",
        description="Table 1, Table 2, Examples 1 to 4, Figures 4 to 9, the routes to the modes and the range of validity of the "
        "chain's basis: a netCDF file, figures and one page, paper.md.",
    )
    paper.add_argument("--out", required=True, metavar="DIR", help="folder for the report; made if missing")
    paper.add_argument(
        "--small",
        action="store_true",
        help="a trial, in a quarter of the time: fewer modes, routes, tensions and stiffnesses",
    )
    paper.add_argument("--overwrite", action="store_true", help="replace a report that is already in DIR")
    paper.set_defaults(run=_paper)
    _add_ensemble(commands.add_parser("ensemble", help="simulate all members of a scene with a table [ensemble]"))
    info = commands.add_parser(
        "info",
        help="what a file holds and how it was made",
        description="What each netCDF file or an ensemble holds, its units, and how it was made.",
    )
    info.add_argument("path", metavar="PATH", help="a netCDF file of this package, a folder of them, or of an ensemble")
    info.add_argument(
        "--lineage",
        action="store_true",
        help="list all that a file comes from, as a Python file that makes it again from its scenes",
    )
    info.set_defaults(run=_info)
    first_steps.add_commands(commands)
    first_steps.add_examples(commands)
    return parser


def _add_ensemble(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Every member simulated, in batches, each a netCDF file. After Ctrl-C or a crash the same command goes on."
    )
    parser.add_argument("scene", metavar="SCENE.toml", help="scene file with a table [ensemble]")
    parser.add_argument("--out", required=True, metavar="DIR", help="folder of the ensemble; made if missing")
    parser.add_argument("--model", default="chain", help="chain (the default), cable, rigid, galerkin, condensed")
    parser.add_argument("--modes", metavar="FILE", help="netCDF file of modes, for galerkin and condensed")
    parser.add_argument(
        "--option",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="an option of the model, its value as in the scene file: step=1e-3, outputs=['tension']; may be repeated",
    )
    parser.add_argument(
        "--scheduler", metavar="ADDRESS", help='of a dask scheduler, or "processes" of this machine (default: threads)'
    )
    parser.add_argument("--workers", type=int, metavar="N", help="threads or processes (default: as many as cores)")
    parser.add_argument("--overwrite", action="store_true", help="replace another ensemble in DIR, and damaged files")
    parser.set_defaults(run=_ensemble)


def _ensemble(options: argparse.Namespace) -> int:
    out = _folder(options.out)
    scene = read_scene(scene_path(options.scene))
    if "ensemble_json" not in scene.attrs:
        raise SceneError(f"ensemble: missing in {options.scene}; allowed: a table with members and ensemble.ranges")
    modes = archive.read(options.modes) if options.modes else None
    scenes = ensemble.design(scene)
    print(scenes.attrs["title"])
    try:
        with _member_bar(options.model, scenes.sizes["member"]) as progress:
            ensemble.run(
                scenes,
                out,
                model=options.model,
                modes=modes,
                scheduler=options.scheduler,
                workers=options.workers,
                overwrite=options.overwrite,
                progress=progress,
                **dict(_model_option(text) for text in options.option),
            )
    except KeyboardInterrupt:
        return _fail(
            "interrupted; every file that was written is whole, the same command goes on where it stopped", status=130
        )
    print(describe_ensemble(out))
    return 0


def _model_option(text: str) -> tuple[str, Any]:
    name, _, value = text.partition("=")
    try:
        return name.strip(), tomllib.loads(f"value = {value}")["value"]
    except ValueError:
        if value and name.strip():
            return name.strip(), value  # a bare word
    raise SceneError(f"--option: given {text!r}; allowed: NAME=VALUE, such as step=1e-3")


@contextmanager
def _member_bar(label: str, members: int) -> Iterator[Callable[[float], None]]:
    from tqdm import tqdm  # only the command shows bars

    with tqdm(
        total=members,
        desc=label,
        unit="member",
        disable=None,
        leave=False,
        bar_format="{desc}: {n:.0f}/{total} {bar} {elapsed}, {rate_fmt}, {remaining} left",
    ) as bar:
        begun = False

        def progress(part: float) -> None:
            nonlocal begun
            if not begun:  # what an earlier run did says nothing of the rate
                begun, bar.initial, bar.n = True, part * members, part * members
            bar.update(part * members - bar.n)

        yield progress


def _info(options: argparse.Namespace) -> int:
    path = Path(options.path)
    if options.lineage:
        if (path / MANIFEST).exists():
            print(lineage.script(archive.open_ensemble(path, incomplete=True)), end="")
            return 0
        if path.is_dir():
            raise archive.ArchiveError(f"--lineage: given {path}, a folder; allowed: one file")
        print(lineage.script(archive.read(path, chunks={})), end="")
        return 0
    if not path.is_dir():
        print(archive.describe(path))
        return 0
    if (path / MANIFEST).exists():
        print(describe_ensemble(path))
        return 0
    files = sorted(path.glob("*.nc"))
    if not files:
        raise archive.ArchiveError(
            f"{path}: a folder without netCDF files; allowed: a file or a folder that cablepod wrote"
        )
    print("\n\n".join(archive.describe(file) for file in files))
    return 0


def _paper(options: argparse.Namespace) -> int:
    _plain_figures()
    from cablepod.paper import report, sections  # only this command needs scipy's solvers and all of the package

    out = _folder(options.out)
    _prepare(out, report.FILES, overwrite=options.overwrite)
    with _bar("the paper") as progress:
        _, rows = report.write(out, size=sections.SMALL if options.small else sections.FULL, progress=progress)
    for what, _, ours, printed in rows:
        print(f"{what}\n    ours   {ours}\n    paper  {printed}".replace("`", ""))
    print(f"\n{out / report.PAGE}, {report.DATASET} and {len(report.FIGURES)} figures beside it")
    return 0


# --- the main job ---------------------------------------------------------------------------------------------------


def _run(options: argparse.Namespace) -> int:
    out = _folder(options.out)
    ranks = _ranks(options.ranks)
    scene = read_scene(scene_path(options.scene))
    p = parameters(scene)
    snapshots_at = p.times()  # refuses a scene without [time] before anything runs
    chain_of(p)
    if p.free is not None:
        raise SceneError("ends.free: given a free end; allowed: two held ends, because the reduced model lifts by both")
    if p.link_viscosity is not None:
        raise SceneError(
            f"damping.link_viscosity: given {p.link_viscosity:g}; allowed: none, because the reduced model has no viscous links; "
            "mass_proportional is possible, and chain.simulate does both"
        )
    names = ["scene", "catenary", "chain_rest", "chain", "modes", "comparison", *(f"galerkin_r{r}" for r in ranks)]
    _prepare(out, [f"{name}.nc" for name in names], overwrite=options.overwrite)

    def keep(name: str, dataset: xr.Dataset) -> None:
        archive.write(dataset, out / f"{name}.nc", overwrite=True)
        print(f"  {out / name}.nc")

    print(f"{scene.attrs['title']}")
    if "ensemble_json" in scene.attrs:
        print("  note: the [ensemble] table is left aside; this command runs the scene itself")
    keep("scene", scene)
    keep("catenary", catenary.rest(scene))
    keep("chain_rest", chain.rest(scene))
    report_at = _report_times(snapshots_at)
    with _stopping(keep, "chain"), _bar("chain") as progress:
        truth, seconds = _timed(
            chain.simulate, scene, times=report_at, outputs=("position", "tension"), progress=progress
        )
    keep("chain", truth)
    snapshots = truth if report_at.size == snapshots_at.size else pod.at_times(truth, times=snapshots_at)
    modes = pod.decompose(snapshots, rank=min(20, snapshots.sizes["particle"] - 2, snapshots.sizes["time"] - 1))
    keep("modes", modes)
    rows: list[Row] = [("elastic chain", "", truth, seconds, None)]
    for r in ranks:
        if r > modes.sizes["mode"]:
            print(f"  note: only {modes.sizes['mode']} modes, r = {r} left out")
            continue
        with _stopping(keep, f"galerkin_r{r}"), _bar(f"Galerkin r = {r}") as progress:
            reduced, seconds = _timed(
                galerkin.simulate, scene, modes, rank=r, times=report_at, tolerance=REDUCED_TOLERANCE, progress=progress
            )
        keep(f"galerkin_r{r}", reduced)
        rows.append(("Galerkin", str(r), reduced, seconds, compare.errors(reduced, truth)))
    table = _table(rows)
    keep("comparison", table)
    for figure in _figures(out, truth, modes, rows):
        print(f"  {figure}")
    print(_text(rows))
    print(_values(modes))
    return 0


def _ranks(text: str) -> list[int]:
    try:
        ranks = sorted({int(item) for item in text.split(",")})
    except ValueError:
        ranks = []
    if not ranks or ranks[0] < 1:
        raise SceneError(f"--ranks: given {text!r}; allowed: whole numbers of at least 1 with commas between")
    return ranks


def _folder(text: str) -> Path:
    if not text.strip():
        raise archive.ArchiveError("--out: given nothing; allowed: a folder, . for this one")
    return Path(text)


def _prepare(out: Path, files: Sequence[str], *, overwrite: bool) -> None:
    """Make the output folder and refuse what would overwrite, before anything runs."""
    try:
        out.mkdir(parents=True, exist_ok=True)
    except (FileExistsError, NotADirectoryError):
        raise archive.ArchiveError(f"--out: given {out}, which is or lies below a file; allowed: a folder") from None
    except OSError as error:
        raise archive.ArchiveError(
            f"--out: given {out}, which cannot be made: {error.strerror}; allowed: a folder"
        ) from None
    probe = out / f".cablepod-{os.getpid()}"
    try:
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise archive.ArchiveError(
            f"--out: given {out}, which cannot be written: {error.strerror}; allowed: a folder"
        ) from None
    present = [name for name in files if (out / name).exists()]
    if present and not overwrite:
        raise archive.ArchiveError(
            f"--out: given {out}, which has {', '.join(present)} already; allowed: another folder, or --overwrite to replace them"
        )


def _report_times(snapshots_at: np.ndarray) -> np.ndarray:
    last = float(snapshots_at[-1])
    count = round(last / REPORT_INTERVAL)
    if count > REPORT_INSTANTS or abs(count * REPORT_INTERVAL - last) > 1e-9 * last:
        count = max(1, min(REPORT_INSTANTS, int(last / REPORT_INTERVAL)))
    grid = np.linspace(0.0, last, count + 1)
    # the snapshots are among the instants, so that one run of the chain serves both
    nearest = np.abs(grid - snapshots_at[_nearest(snapshots_at, grid)])
    return np.sort(np.concatenate([snapshots_at, grid[nearest > 1e-9 * last]]))


def _nearest(places: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Index of the nearest of rising `places` for each value."""
    right = np.clip(np.searchsorted(places, values), 1, places.size - 1)
    return np.where(values - places[right - 1] < places[right] - values, right - 1, right)


@contextmanager
def _stopping(keep: Callable[[str, xr.Dataset], None], name: str) -> Iterator[None]:
    """Keep what a stopped run had computed."""
    try:
        yield
    except RunStopped as error:
        if error.partial is not None:
            keep(f"{name}_incomplete", error.partial)
        raise


@contextmanager
def _bar(label: str) -> Iterator[Callable[[float], None]]:
    from tqdm import tqdm  # only the command shows bars

    # disable=None: quiet where stderr is no terminal
    with tqdm(
        total=1.0, desc=label, disable=None, leave=False, bar_format="{desc}: {percentage:3.0f}% {bar} {elapsed}"
    ) as bar:

        def progress(part: float) -> None:
            bar.update(part - bar.n)

        yield progress


def _timed(job: Callable[..., xr.Dataset], *arguments: Any, **options: Any) -> tuple[xr.Dataset, float]:
    """Return result and wall time [s] of the whole call, compilation included where it happens."""
    begin = time.perf_counter()
    result = job(*arguments, **options)
    seconds = time.perf_counter() - begin
    result.attrs["wall_time_s"] = seconds
    return result, seconds


Row = tuple[str, str, xr.Dataset, float, xr.Dataset | None]


def _table(rows: Sequence[Row]) -> xr.Dataset:
    """Gather the comparisons along the ranks."""
    errors = [row[4] for row in rows if row[4] is not None]
    ranks = [int(row[1]) for row in rows if row[4] is not None]
    table = xr.concat(errors, dim="rank", data_vars="all", coords="minimal", compat="override", join="exact")
    table = table.assign_coords(rank=("rank", ranks, {"units": "1", "long_name": "modes of each coordinate"}))
    table.attrs = {**errors[0].attrs, "title": "errors of the Galerkin models against the elastic chain"}
    return table


def _text(rows: Sequence[Row]) -> str:
    lines = [
        f"{'model':<15}{'modes':>6}{'largest error':>15}{'rms error':>12}{'step [s]':>11}{'steps':>10}{'time [s]':>10}"
    ]
    for model, rank, run, seconds, error in rows:
        worst = "truth" if error is None else f"{100 * float(error['error_max']):.4f} %"
        mean = "" if error is None else f"{100 * float(error['error_rms']):.4f} %"
        lines.append(
            f"{model:<15}{rank:>6}{worst:>15}{mean:>12}{run.attrs['step']:>11.3g}{run.attrs['number_of_steps']:>10}{seconds:>10.3f}"
            + ("" if _settled(run) else " *")
        )
    lines.append(
        "errors over the largest rms displacement of the chain; times are of the whole call with the check of its step,"
    )
    lines.append("and include compilation the first time a model runs on this machine")
    if not all(_settled(row[2]) for row in rows):
        lines.append(
            "* two steps disagree by more than the tolerance: chaotic or too abrupt a motion, to be judged by statistics"
        )
    return "\n".join(lines)


def _settled(run: xr.Dataset) -> bool:
    limit = DEFAULT_TOLERANCE if run.attrs["model"] == "elastic chain" else REDUCED_TOLERANCE
    return bool(run.attrs["time_error_estimate"] <= limit)


def _values(modes: xr.Dataset) -> str:
    """Tell the first singular values of each coordinate and what they hold."""
    values = modes["singular_value"]
    lines = []
    for axis in modes["coordinate"].values:
        one = values.sel(coordinate=axis).values
        first = "  ".join(f"{value:.5g}" for value in one[:5])
        held = [100.0 * one[:count].sum() / one.sum() if one.any() else 0.0 for count in (1, 5)]
        share = f"the first has {held[0]:.2f} %, these have {held[1]:.2f} % of the sum of {one.size}"
        lines.append(f"singular values of {axis} [m]: {first}; {share}")
    return "\n".join(lines)


def _plain_figures() -> None:
    import matplotlib as mpl  # only the command draws

    mpl.use("Agg")


def _figures(out: Path, truth: xr.Dataset, modes: xr.Dataset, rows: Sequence[Row]) -> list[Path]:
    _plain_figures()
    from matplotlib import pyplot as plt

    from cablepod import plots

    best = rows[-1][2]
    # fractions without a common period, so that a periodic motion is not seen in one phase only
    picked = np.rint(np.array([0.0, 0.12, 0.37, 0.58, 0.83]) * (truth.sizes["time"] - 1)).astype(int)
    times = [float(t) for t in truth["time"].values[np.unique(picked)]]
    drawings: dict[str, Callable[[], object]] = {
        "shapes": lambda: plots.shapes(truth, best, times=times),
        "deflection": lambda: plots.shapes(truth, best, times=times, deflection=True),
        "modes": lambda: plots.modes(modes),
        "singular_values": lambda: plots.singular_values(modes),
        "error_over_time": lambda: plots.error_over_time(
            {f"r = {row[1]}": row[4] for row in rows if row[4] is not None}
        ),
    }
    written = []
    for name, draw in drawings.items():
        draw()
        path = out / f"{name}.png"
        try:
            with whole_file(path) as unfinished:
                plt.savefig(unfinished, dpi=150, format="png")
        finally:
            plt.close("all")
        written.append(path)
    return written


if __name__ == "__main__":
    sys.exit(main())
