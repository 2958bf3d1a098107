"""Time and error of pod.decompose beside numpy, dask, scikit-learn, xeofs and pyMOR (extra `peers`), on exactly known spectra.

    python pipelines/benchmarks/decompositions.py [--threads 1] [--smallest 1e-5] [--disk FOLDER --gigabytes 4]
        [--skip-wide] [--skip-peers]

Rank 20 of 80 x 12 500 and 4000 x 20 000 (features x snapshots); 40 singular values fall evenly on a log scale, the 20th is
`smallest` of the first.  Ours is the whole public call, from Dataset to labelled modes, and beside it the sums alone; the peers
get the plain centred matrix in the order they like.  Medians of five after one outside, of fewer where one takes more than ten
seconds (the column says so).  BLAS threads are set on purpose, by threadpoolctl, for all alike; ours holds one where matrices are
small.  The error is the largest relative one of the 20 singular values and the largest sine of an angle between mode and exact
mode.  With --disk an archive of 4 GB is written to FOLDER, read raw after it was dropped from the cache of the system, decomposed
after it was dropped again, in a process of its own, three times, and deleted; the memory is the peak of that process, as Linux
tells it.  A peer that is not installed is a line that says so.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import statistics
import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from importlib.util import find_spec
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import xarray as xr
from threadpoolctl import threadpool_limits

import cablepod as cp
from cablepod.streaming import Accumulator

RANK = 20
#: singular values and left singular vectors (features, rank)
Answer = tuple[np.ndarray, np.ndarray]


def known(features: int, samples: int, smallest: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows (samples, features) of zero mean, their singular values and modes."""
    rng = np.random.default_rng(0)
    values = smallest ** (np.arange(2 * RANK) / (RANK - 1.0))
    left = np.linalg.qr(rng.normal(size=(features, 2 * RANK)))[0]
    right = np.linalg.qr(np.c_[np.ones(samples), rng.normal(size=(samples, 2 * RANK))])[0][:, 1:]
    return (right * values) @ left.T, values[:RANK], left[:, :RANK]


def trajectory(rows: np.ndarray) -> xr.Dataset:
    """Rows as planar snapshots whose ends rest in the origin."""
    position = np.zeros((len(rows), rows.shape[1] // 2 + 2, 2))
    position[:, 1:-1] = rows.reshape(len(rows), -1, 2)
    return labelled(position, np.arange(len(rows)) * 0.01)


def labelled(position: np.ndarray, instants: np.ndarray) -> xr.Dataset:
    """Positions (time, particle, coordinate) as a trajectory."""
    return xr.Dataset(
        {"position": (("time", "particle", "coordinate"), position, {"units": "m"})},
        coords={
            "time": ("time", instants, {"units": "s"}),
            "arc_length": ("particle", np.linspace(0.0, 50.0, position.shape[1]), {"units": "m"}),
            "coordinate": ("coordinate", list("xy"), {"units": "1"}),
        },
    )


def ours(snapshots: xr.Dataset) -> Answer:
    """Do what a user does."""
    modes = cp.pod.decompose(snapshots, rank=RANK, layout="vector")
    return modes["singular_value"].values, modes["mode_shape"].values[:, 1:-1].reshape(RANK, -1).T


def sums_alone(rows: np.ndarray) -> Answer:
    """Do the numerical part, on rows that are lifted already."""
    sums = Accumulator(rows.shape[1])
    block = max(64, (3 << 18) // (8 * rows.shape[1]))
    sums.prepare(rows[:: max(1, len(rows) // 320)])
    for begin in range(0, len(rows), block):
        sums.add(rows[begin : begin + block].copy())
    found = sums.decomposed(RANK)
    return found.values[:RANK], found.left[:, :RANK]


def by_numpy(rows: np.ndarray) -> Answer:
    """Decompose the matrix, features x samples, by LAPACK."""
    left, values, _ = np.linalg.svd(rows.T, full_matrices=False)
    return values[:RANK], left[:, :RANK]


def by_gram(rows: np.ndarray) -> Answer:
    """Eigenvectors of the plain Gram matrix."""
    squares, left = np.linalg.eigh(rows.T @ rows)
    return np.sqrt(np.maximum(squares[::-1], 0.0))[:RANK], left[:, ::-1][:, :RANK]


def by_dask(iterator: str, power: int) -> Callable[[np.ndarray], Answer]:
    """Return dask's compressed decomposition; "power" and 0 are its defaults, "power" and 4 what xeofs takes for dask."""

    def run(rows: np.ndarray) -> Answer:
        import dask
        import dask.array as da

        data = rows if isinstance(rows, da.Array) else da.from_array(rows, chunks=(max(1, len(rows) // 8), -1))
        left, values, _ = da.linalg.svd_compressed(data.T, RANK, n_power_iter=power, seed=0, iterator=iterator)
        return tuple(np.asarray(item) for item in dask.compute(values, left))

    return run


def by_sklearn(power: int) -> Callable[[np.ndarray], Answer]:
    """scikit-learn's randomised decomposition with so many iterations."""

    def run(rows: np.ndarray) -> Answer:
        from sklearn.utils.extmath import randomized_svd

        left, values, _ = randomized_svd(rows.T, RANK, n_iter=power, random_state=0)
        return values, left

    return run


def by_xeofs(rows: np.ndarray) -> Answer:
    """Xeofs' EOF with its default solver."""
    from xeofs.single import EOF

    model = EOF(n_modes=RANK, random_state=0)
    places = {"time": np.arange(len(rows)), "space": np.arange(rows.shape[1])}
    model.fit(xr.DataArray(rows, places, dims=("time", "space")), dim="time")
    return model.singular_values().values, model.components().transpose("space", "mode").values


def by_pymor(rows: np.ndarray) -> Answer:
    """PyMOR's incremental HAPOD, in 20 steps, to a mean error of 1e-11 of the largest singular value."""
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
    """Largest relative error of the singular values and largest sine; what is missing is wrong."""
    found, modes = answer
    missing = RANK - len(found)
    found = np.pad(found, (0, missing))
    modes = np.pad(modes, ((0, 0), (0, missing)))
    off = modes - left * np.sum(left * modes, axis=0)
    sines = np.where(modes.any(axis=0), np.linalg.norm(off, axis=0), 1.0)
    return float(np.abs(found / values - 1.0).max()), float(np.minimum(sines, 1.0).max())


def show(name: str, job: Callable[[], Answer], values: np.ndarray, left: np.ndarray, repeats: int = 5) -> None:
    """Print a row of the table."""
    begin = time.perf_counter()
    answer = job()
    seconds = [time.perf_counter() - begin]
    if seconds[0] <= 10.0 and repeats > 1:
        seconds = []
        for _ in range(repeats):
            begin = time.perf_counter()
            answer = job()
            seconds.append(time.perf_counter() - begin)
    error, sine = errors(answer, values, left)
    median = statistics.median(seconds)
    print(f"| {name} | {1e3 * median:.0f} ms | {len(seconds)} | {error:.0e} | {sine:.0e} |", flush=True)


def in_memory(features: int, samples: int, smallest: float, threads: int) -> None:
    """Print the table of one size."""
    rows, values, left = known(features, samples, smallest)
    snapshots = trajectory(rows)
    print(f"\n{features} x {samples}, down to {smallest:g}, {threads} BLAS thread(s)")
    print("| | time | runs | error of singular values | angle |\n| --- | --- | --- | --- | --- |")
    show("cablepod, whole call", lambda: ours(snapshots), values, left)
    show("cablepod, sums alone", lambda: sums_alone(rows), values, left)
    for name, package, job in PEERS:
        if find_spec(package) is None:
            print(f"| {name} | not installed | | | |")
            continue
        show(name, lambda job=job: job(rows), values, left)


def drop(paths: list[Path]) -> None:
    """Ask the system to forget files, so that the next look at them is a cold one."""
    for path in paths:
        handle = os.open(path, os.O_RDONLY)
        os.fsync(handle)
        os.posix_fadvise(handle, 0, 0, os.POSIX_FADV_DONTNEED)
        os.close(handle)


def raw_read(paths: list[Path]) -> float:
    """Seconds to read files from end to end into one buffer."""
    buffer = bytearray(8 << 20)
    begin = time.perf_counter()
    for path in paths:
        with path.open("rb", buffering=0) as file:
            while file.readinto(buffer):
                pass
    return time.perf_counter() - begin


@contextlib.contextmanager
def archive(folder: Path, gigabytes: float, smallest: float) -> Iterator[tuple[list[Path], np.ndarray, np.ndarray]]:
    """Write four files of planar snapshots of 40 inner particles, uncompressed; delete them at the end."""
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
    parts = [cp.archive.read(path, chunks={}) for path in paths]
    return xr.concat(parts, "time", data_vars="minimal", coords="minimal", compat="override")


def alone(paths: list[Path], threads: int) -> tuple[Answer, float, float, float]:
    """Decompose files in a process that has done nothing else; seconds, of processor time too, and its peak memory in GB."""
    with threadpool_limits(limits=threads, user_api="blas"):
        begin, used = time.perf_counter(), time.process_time()
        answer = ours(opened(paths))
        spent, used = time.perf_counter() - begin, time.process_time() - used
    # getrusage would tell the peak of the parent where that is larger
    peak = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM"))
    return answer, spent, used, int(peak.split()[1]) * 1024 / 1e9


def on_disk(folder: Path, gigabytes: float, smallest: float, threads: int, *, peers: bool) -> None:
    """Print the table of an archive in files."""
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
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--smallest", type=float, default=1e-5)
    parser.add_argument("--skip-wide", action="store_true")
    parser.add_argument("--skip-peers", action="store_true", help="with --disk: leave dask out, which takes minutes")
    parser.add_argument("--disk", type=Path)
    parser.add_argument("--gigabytes", type=float, default=4.0)
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    with threadpool_limits(limits=options.threads, user_api="blas"):
        if options.disk is None:
            in_memory(80, 12_500, options.smallest, options.threads)
            if not options.skip_wide:
                in_memory(4000, 20_000, options.smallest, options.threads)
        else:
            on_disk(options.disk, options.gigabytes, options.smallest, options.threads, peers=not options.skip_peers)


if __name__ == "__main__":
    main()
