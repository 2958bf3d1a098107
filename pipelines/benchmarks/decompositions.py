"""Measure time and error of pod.decompose beside other packages (extra `peers`), on exactly known spectra.

    python pipelines/benchmarks/decompositions.py [--threads 1] [--smallest 1e-5] [--skip-wide] [--repeats 5] [--readme]
    python pipelines/benchmarks/decompositions.py --disk FOLDER [--gigabytes 4] [--skip-peers]
    python pipelines/benchmarks/decompositions.py --routes [--most-snapshots 12500] [--repeats 5]

Rank 20 of 80 x 12 500 and 4000 x 20 000 (features x snapshots); 40 singular values fall evenly on a log scale, the 20th is
`smallest` of the first.  Ours is the whole public call, from Dataset to labelled modes, and beside it the sums alone; numpy,
dask, scikit-learn, xeofs and pyMOR get the plain centred matrix in their preferred order.  Medians of the repeats after a
warm-up; a run of more than ten seconds is not repeated (column "runs").  threadpoolctl sets the BLAS threads of all; ours uses
one for small matrices.  The error is the maximum relative error of the 20 singular values, the angle the maximum sine between
mode and exact mode.  Packages that are not installed are named.

With --disk, an archive of 4 GB is written to FOLDER, read raw with a cold file cache, decomposed with a cold file cache in a
process of its own, three times, and deleted; the memory is the peak of that process, as Linux reports it.

With --routes, the three methods of pod.decompose up to 80 x 12 500, the method of snapshots included (minutes, 4 GB), on one BLAS
thread.  Beside the time stands the precision on a matrix of the same size: the smallest singular value, relative to the largest,
down to which all are right to a tenth.
"""

from __future__ import annotations

import contextlib
import os
import statistics
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from importlib.util import find_spec
from multiprocessing import get_context
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
import xarray as xr
from _study import command_line, markdown_table, show_table, timed
from threadpoolctl import threadpool_limits

import cablepod as cp
from cablepod.paper import routes
from cablepod.pod._incremental import IncrementalSVD

HERE = Path(__file__).resolve().parent
RANK = 20
#: singular values and left singular vectors (features, rank)
Answer = tuple[np.ndarray, np.ndarray]


def known(features: int, samples: int, smallest: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return rows (samples, features) of zero mean, their singular values and modes."""
    rng = np.random.default_rng(0)
    values = smallest ** (np.arange(2 * RANK) / (RANK - 1.0))
    left = np.linalg.qr(rng.normal(size=(features, 2 * RANK)))[0]
    right = np.linalg.qr(np.c_[np.ones(samples), rng.normal(size=(samples, 2 * RANK))])[0][:, 1:]
    return (right * values) @ left.T, values[:RANK], left[:, :RANK]


def trajectory(rows: np.ndarray) -> xr.Dataset:
    """Return rows as planar snapshots with both ends in the origin."""
    position = np.zeros((len(rows), rows.shape[1] // 2 + 2, 2))
    position[:, 1:-1] = rows.reshape(len(rows), -1, 2)
    return labelled(position, np.arange(len(rows)) * 0.01)


def labelled(position: np.ndarray, instants: np.ndarray) -> xr.Dataset:
    """Return positions (time, particle, coordinate) as a trajectory."""
    return xr.Dataset(
        {"position": (("time", "particle", "coordinate"), position, {"units": "m"})},
        coords={
            "time": ("time", instants, {"units": "s"}),
            "arc_length": ("particle", np.linspace(0.0, 50.0, position.shape[1]), {"units": "m"}),
            "coordinate": ("coordinate", list("xy"), {"units": "1"}),
        },
    )


def ours(snapshots: xr.Dataset) -> Answer:
    """Decompose by the public call."""
    modes = cp.pod.decompose(snapshots, rank=RANK, layout="vector")
    return modes["singular_value"].values, modes["mode_shape"].values[:, 1:-1].reshape(RANK, -1).T


def sums_alone(rows: np.ndarray) -> Answer:
    """Decompose by the sums alone, on lifted rows."""
    sums = IncrementalSVD(rows.shape[1])
    block = max(64, (3 << 18) // (8 * rows.shape[1]))
    sums.prepare(rows[:: max(1, len(rows) // 320)])
    for begin in range(0, len(rows), block):
        sums.add(rows[begin : begin + block].copy())
    found = sums.decompose(RANK)
    return found.values[:RANK], found.left[:, :RANK]


def by_numpy(rows: np.ndarray) -> Answer:
    """Decompose the matrix (features, samples) by LAPACK."""
    left, values, _ = np.linalg.svd(rows.T, full_matrices=False)
    return values[:RANK], left[:, :RANK]


def by_gram(rows: np.ndarray) -> Answer:
    """Decompose by the eigenvectors of the plain Gram matrix."""
    squares, left = np.linalg.eigh(rows.T @ rows)
    return np.sqrt(np.maximum(squares[::-1], 0.0))[:RANK], left[:, ::-1][:, :RANK]


def by_dask(iterator: str, power: int) -> Callable[[np.ndarray], Answer]:
    """Return dask's compressed decomposition.

    "power" and 0 are its defaults, "power" and 4 those of xeofs with dask.
    """

    def run(rows: np.ndarray) -> Answer:
        import dask
        import dask.array as da

        data = rows if isinstance(rows, da.Array) else da.from_array(rows, chunks=(max(1, len(rows) // 8), -1))
        left, values, _ = da.linalg.svd_compressed(data.T, RANK, n_power_iter=power, seed=0, iterator=iterator)
        return tuple(np.asarray(item) for item in dask.compute(values, left))

    return run


def by_sklearn(power: int) -> Callable[[np.ndarray], Answer]:
    """Return scikit-learn's randomised decomposition with a number of iterations."""

    def run(rows: np.ndarray) -> Answer:
        from sklearn.utils.extmath import randomized_svd

        left, values, _ = randomized_svd(rows.T, RANK, n_iter=power, random_state=0)
        return values, left

    return run


def by_xeofs(rows: np.ndarray) -> Answer:
    """Decompose by the EOF of xeofs with its default solver."""
    from xeofs.single import EOF

    model = EOF(n_modes=RANK, random_state=0)
    places = {"time": np.arange(len(rows)), "space": np.arange(rows.shape[1])}
    model.fit(xr.DataArray(rows, places, dims=("time", "space")), dim="time")
    return model.singular_values().values, model.components().transpose("space", "mode").values


def by_pymor(rows: np.ndarray) -> Answer:
    """Decompose by pyMOR's incremental HAPOD in 20 steps.

    Its mean error is 1e-11 of the largest singular value.
    """
    from pymor.algorithms.hapod import inc_vectorarray_hapod
    from pymor.core.logger import set_log_levels
    from pymor.vectorarrays.numpy import NumpyVectorSpace

    set_log_levels({"pymor": "ERROR"})
    array = NumpyVectorSpace(rows.shape[1]).from_numpy(rows.T)  # vectors are columns
    modes, values, _ = inc_vectorarray_hapod(20, array, 1e-11 / np.sqrt(len(rows)), 0.75)
    return np.asarray(values)[:RANK], modes.to_numpy()[:, :RANK]


PEERS: tuple[tuple[str, str, Callable[[np.ndarray], Answer]], ...] = (
    ("numpy svd", "numpy", by_numpy),
    ("Gram matrix, eigh", "numpy", by_gram),
    ("dask svd_compressed, default", "dask", by_dask("power", 0)),
    ("dask svd_compressed, 4 powers", "dask", by_dask("power", 4)),
    ("dask svd_compressed, 4 by QR", "dask", by_dask("QR", 4)),
    ("scikit-learn, n_iter=2", "sklearn", by_sklearn(2)),
    ("scikit-learn, n_iter=7", "sklearn", by_sklearn(7)),
    ("xeofs EOF", "xeofs", by_xeofs),
    ("pyMOR incremental HAPOD", "pymor", by_pymor),
)


def errors(answer: Answer, values: np.ndarray, left: np.ndarray) -> tuple[float, float]:
    """Return maximum relative error of singular values and maximum sine of angles.

    Missing values and modes count as wrong.
    """
    found, modes = answer
    missing = RANK - len(found)
    found = np.pad(found, (0, missing))
    modes = np.pad(modes, ((0, 0), (0, missing)))
    off = modes - left * np.sum(left * modes, axis=0)
    sines = np.where(modes.any(axis=0), np.linalg.norm(off, axis=0), 1.0)
    return float(np.abs(found / values - 1.0).max()), float(np.minimum(sines, 1.0).max())


def row_of(name: str, job: Callable[[], Answer], values: np.ndarray, left: np.ndarray, repeats: int) -> list[str]:
    """Return a row of the table."""
    answer, warm_up = timed(job)
    seconds = [warm_up]
    if warm_up <= 10.0:
        runs = [timed(job) for _ in range(repeats)]
        answer, seconds = runs[-1][0], [spent for _, spent in runs]
    error, sine = errors(answer, values, left)
    return [name, f"{1e3 * statistics.median(seconds):.0f} ms", str(len(seconds)), f"{error:.0e}", f"{sine:.0e}"]


def in_memory(features: int, samples: int, smallest: float, threads: int, repeats: int) -> str:
    """Measure one size and write its table."""
    rows, values, left = known(features, samples, smallest)
    snapshots = trajectory(rows)
    print(f"\n{features} x {samples}, down to {smallest:g}, {threads} BLAS thread(s)", flush=True)
    lines = [
        row_of("cablepod, whole call", lambda: ours(snapshots), values, left, repeats),
        row_of("cablepod, sums alone", lambda: sums_alone(rows), values, left, repeats),
    ]
    for name, package, job in PEERS:
        if find_spec(package) is None:
            lines.append([name, "not installed", "", "", ""])
        else:
            lines.append(row_of(name, lambda job=job: job(rows), values, left, repeats))
    head = [f"{features} × {samples}, to {smallest:g}", "time", "runs", "error of singular values", "angle"]
    return markdown_table(head, lines)


def route_table(most_snapshots: int, repeats: int) -> str:
    """Measure the methods of pod.decompose over the sizes of the paper and write their table."""
    lines = []
    for size in routes.SIZES:
        times = routes.run_times(sizes=(size,), repeats=repeats, most_snapshots=most_snapshots)
        found = routes.precision(features=size[0], samples=size[1], most_snapshots=most_snapshots)
        for route in times["route"].values:
            seconds = float(times["route_time"].sel(route=route)[0])
            down_to = float(found["route_usable"].sel(route=route))
            lines.append([f"{size[0]} × {size[1]}", str(route), f"{1e3 * seconds:.2f} ms", f"{down_to:.0e}"])
    return markdown_table(["size", "method", "time", "right down to"], lines)


def drop(paths: list[Path]) -> None:
    """Drop files from the cache of the system before a cold read."""
    for path in paths:
        handle = os.open(path, os.O_RDONLY)
        os.fsync(handle)
        os.posix_fadvise(handle, 0, 0, os.POSIX_FADV_DONTNEED)
        os.close(handle)


def raw_read(paths: list[Path]) -> float:
    """Return the time to read files into one buffer [s]."""
    buffer = bytearray(8 << 20)
    begin = time.perf_counter()
    for path in paths:
        with path.open("rb", buffering=0) as file:
            while file.readinto(buffer):
                pass
    return time.perf_counter() - begin


@contextlib.contextmanager
def archive(folder: Path, gigabytes: float, smallest: float) -> Iterator[tuple[list[Path], np.ndarray, np.ndarray]]:
    """Write four uncompressed files of planar snapshots; delete them at the end."""
    particles, files = 42, 4
    each = int(gigabytes * 1e9 / files / (particles * 2 * 8))
    total = each * files
    rng = np.random.default_rng(0)
    left = np.linalg.qr(rng.normal(size=(80, RANK)))[0]
    values = np.geomspace(1.0, smallest, RANK) * 0.05 * np.sqrt(total)
    waves = rng.choice(np.arange(1, total), RANK, replace=False)
    paths = [folder / f"decompositions_{number}.nc" for number in range(files)]
    try:
        for number, path in enumerate(paths):
            instants = np.arange(number * each, (number + 1) * each, dtype=np.int64)
            # cosines of whole numbers of half periods are orthonormal, the argument is reduced without rounding
            right = np.stack([np.cos(np.pi / (2 * total) * ((w * (2 * instants + 1)) % (4 * total))) for w in waves], 1)
            position = np.zeros((each, particles, 2))
            position[:, 1:-1] = ((right * (values * np.sqrt(2.0 / total))) @ left.T).reshape(each, 40, 2)
            part = labelled(position, instants * 1e-3).assign_attrs(cablepod_schema=1, id=f"part {number}")
            encoding = {
                "position": {"chunksizes": (1560, particles, 2), "_FillValue": None},
                "coordinate": {"dtype": "S1"},
            }
            part.to_netcdf(path, engine="netcdf4", encoding=encoding)
        yield paths, values, left
    finally:
        for path in paths:
            path.unlink(missing_ok=True)


def opened(paths: list[Path]) -> xr.Dataset:
    """Open the files as one lazy Dataset."""
    parts = [cp.archive.read(path, chunks={}, verify=False) for path in paths]
    return xr.concat(parts, "time", data_vars="minimal", coords="minimal", compat="override")


def alone(paths: list[Path], threads: int) -> tuple[Answer, float, float, float]:
    """Decompose files; return the answer, wall and processor time [s], and peak memory [GB]."""
    with threadpool_limits(limits=threads, user_api="blas"):
        used = time.process_time()
        answer, spent = timed(lambda: ours(opened(paths)))
        used = time.process_time() - used
    # getrusage returns the peak of the parent if that is larger
    peak = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM"))
    return answer, spent, used, int(peak.split()[1]) * 1024 / 1e9


def on_disk(folder: Path, gigabytes: float, smallest: float, threads: int, *, peers: bool) -> None:
    """Measure an archive in files."""
    with archive(folder, gigabytes, smallest) as (paths, values, left):
        size = sum(path.stat().st_size for path in paths) / 1e9
        print(f"\narchive of {size:.2f} GB, 80 features, down to {smallest:g}, {threads} BLAS thread(s), once each")
        for _ in range(3):
            drop(paths)
            raw = raw_read(paths)
            drop(paths)
            with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as executor:
                answer, spent, used, peak = executor.submit(alone, paths, threads).result()
            error, sine = errors(answer, values, left)
            print(
                f"cold raw read {raw:.2f} s, cablepod from opening on {spent:.2f} s, {spent / raw:.2f} times ({used:.2f} s of "
                f"processor time), error {error:.0e}, angle {sine:.0e}, peak memory {peak:.2f} GB",
                flush=True,
            )
        if peers and find_spec("dask") is not None:
            lazy = opened(paths)
            data = lazy["position"][:, 1:-1].data.reshape(lazy.sizes["time"], -1)
            data = data.rechunk((100_000, -1))
            for name, iterator in (("4 powers", "power"), ("4 by QR", "QR")):
                drop(paths)
                begin = time.perf_counter()
                error, sine = errors(by_dask(iterator, 4)(data), values, left)
                print(
                    f"dask svd_compressed, {name} {time.perf_counter() - begin:.1f} s, error {error:.0e}, angle {sine:.0e}",
                    flush=True,
                )


def main() -> None:
    """Print the tables."""
    parser = command_line(__doc__, repeats=5, readme=True)
    parser.add_argument("--threads", type=int, default=1, help="number of BLAS threads")
    parser.add_argument("--smallest", type=float, default=1e-5, help="20th singular value over the first")
    parser.add_argument("--skip-wide", action="store_true", help="leave out 4000 x 20 000")
    parser.add_argument("--skip-peers", action="store_true", help="with --disk: leave dask out, which takes minutes")
    parser.add_argument("--disk", type=Path, metavar="FOLDER", help="decompose an archive in FOLDER instead")
    parser.add_argument("--gigabytes", type=float, default=4.0, help="size of that archive")
    parser.add_argument("--routes", action="store_true", help="compare the methods of pod.decompose instead")
    parser.add_argument(
        "--most-snapshots", type=int, default=12500, help="with --routes: limit of the method of snapshots"
    )
    options = parser.parse_args()
    page = HERE if options.readme else None
    if options.routes:
        show_table("routes", route_table(options.most_snapshots, options.repeats), page)
        return
    warnings.simplefilter("ignore")
    with threadpool_limits(limits=options.threads, user_api="blas"):
        if options.disk is None:
            sizes = [(80, 12_500)] if options.skip_wide else [(80, 12_500), (4000, 20_000)]
            for size in sizes:
                table = in_memory(*size, options.smallest, options.threads, options.repeats)
                show_table(f"decompositions_{size[0]}_{options.smallest:g}", table, page)
        else:
            on_disk(options.disk, options.gigabytes, options.smallest, options.threads, peers=not options.skip_peers)


if __name__ == "__main__":
    main()
