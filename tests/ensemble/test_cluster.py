"""Workers of a dask scheduler: awaited, late, lost, without the folder, with other packages."""

from __future__ import annotations

import json
import os
import pickle
import re
import signal
import threading
import time
import types
from concurrent.futures import Future
from importlib import metadata

import numpy as np
import pytest
import xarray as xr
from children import finish, python, without_progress
from clusters import cluster_in, way_apart
from scenes import SOFT_TOML

import cablepod as cp
from cablepod.ensemble import _cluster
from cablepod.ensemble._cluster import Again, DaskPool
from cablepod.ensemble._job import LOCK, inputs_of, run_batch, unseen
from cablepod.ensemble._workers import JobQueue
from cablepod.errors import WorkersWarning

distributed = pytest.importorskip("distributed")

#: Members of half a tenth of a second.
STEP = 4e-6
LOST = "tcp://127.0.0.1:1"


@pytest.fixture
def cluster(tmp_path):
    """A cluster of processes."""
    with cluster_in(tmp_path / "cluster") as made:
        yield made


@pytest.fixture
def threads():
    """Make a client whose workers are threads of this process."""
    made = []

    def client(workers):
        options = {"threads_per_worker": 1, "processes": False, "dashboard_address": None, "silence_logs": 50}
        cluster = distributed.LocalCluster(n_workers=workers, **options)
        made.extend([cluster, distributed.Client(cluster, set_as_default=False)])
        return made[-1]

    yield client
    for item in reversed(made):
        item.close()


@pytest.fixture
def impatient(monkeypatch):
    """Say at once what is awaited."""
    monkeypatch.setattr(_cluster, "TELL_AFTER", 0.1)
    monkeypatch.setattr(_cluster, "ASK_EVERY", 0.05)


def fake_version(folder, version):
    """A folder that makes the package one of another version, for a process that has it in its path."""
    info = folder / f"cablepod-{version}.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: cablepod\nVersion: {version}\n")
    return folder


def same_but_times(one, other):
    """Hold that two ensembles have the same values and ids."""
    assert one.attrs["id"] == other.attrs["id"]
    xr.testing.assert_identical(one.compute().drop_attrs(), other.compute().drop_attrs())


def hold(seconds):
    time.sleep(seconds)
    return seconds


# --- threads of this process ----------------------------------------------------------------------------------------------


def test_open_jobs_follow_the_workers_that_are_there(threads, impatient):
    client = threads(1)
    found, workers, most = [], [1], {1: 0, 2: 0, 3: 0}

    def submit(_):
        most[workers[-1]] = max(most[workers[-1]], len(queue.open) + 1)
        return pool.submit(_held)

    with _cluster.client_pool(client, client) as pool:
        queue = JobQueue(pool, submit, range(300), limit=lambda slots: 2 * slots)
        for key, _ in queue.results():
            found.append(key)
            if len(found) in (20, 150):
                workers.append({20: 3, 150: 2}[len(found)])
                client.cluster.scale(workers[-1])
                until(lambda: pool.slots == workers[-1])
    assert sorted(found) == list(range(300))
    assert most == {1: 2, 2: 4, 3: 6}


def _held():
    return hold(0.01)


def until(condition):
    for _ in range(600):  # half a minute
        if condition():
            return
        time.sleep(0.05)
    pytest.fail("nothing has happened for half a minute")


def test_a_run_waits_for_workers_and_goes_on_when_all_had_left(threads, impatient, monkeypatch, scenes_of, tmp_path):
    client, said = threads(0), []

    def warn(text):
        said.append(text)
        threading.Timer(0.3, client.cluster.scale, [1]).start()  # only then does a worker come

    monkeypatch.setattr(DaskPool, "warn", staticmethod(warn))
    run = cp.ensemble.run(scenes_of(6), tmp_path / "it", batch=2, step=1e-3, scheduler=client)
    address = re.escape(client.scheduler.address)
    wanted = rf"waiting for a worker of the scheduler {address}: it has none at present, 3 batches are left; .*Ctrl-C ends it"
    assert len(said) == 1
    assert re.fullmatch(wanted, said[0])
    same_but_times(run, cp.ensemble.run(scenes_of(6), tmp_path / "here", batch=2, step=1e-3))
    found = []
    for batch in cp.ensemble.batches(scenes_of(6), batch=1, step=1e-3, scheduler=client):
        found.append(batch["position"])
        if len(found) == 2:
            client.cluster.scale(0)
            until(lambda: not client.nthreads())
    np.testing.assert_array_equal(np.concatenate(found), run["position"])
    assert len(said) == 2
    assert re.search(r"it has none at present, [234] batches are left", said[1])


def test_a_batch_whose_workers_are_lost_is_submitted_again_but_not_for_ever(threads):
    from distributed.scheduler import KilledWorker

    with _cluster.client_pool(client := threads(1), client) as pool:

        def lost():
            future = Future()
            future.set_exception(KilledWorker("batch", types.SimpleNamespace(address=LOST), 3))
            return future

        assert [pool.outcome(5, lost()) for _ in range(_cluster.MAX_LOSSES)] == [Again] * _cluster.MAX_LOSSES
        assert pool.outcome(6, lost()) is Again  # of another batch
        with pytest.raises(
            cp.RunStopped, match=r"^batch 5 was given up: 4 times all workers were lost .* batches are kept"
        ):
            pool.outcome(5, lost())
        # what the job itself raises is raised here, as it is
        with pytest.raises(ZeroDivisionError) as caught:
            pool.outcome(1, pool.submit(_fail))
        assert "in _fail" in caught.value.__notes__[0]
        unreadable = pool.executor.submit(_never_read, Unreadable())
        match = r"^scheduler: given a worker that cannot read its task .*; allowed: workers with the Python and packages of this "
        with pytest.raises(cp.SceneError, match=match + r"process, 3\.\d+\.\d+, cablepod"):
            pool.outcome(1, unreadable)


def _fail():
    raise ZeroDivisionError("nothing")


def _never_read(_):
    raise NotImplementedError("an error of reading stands in for one of another Python")


class Unreadable:
    """Anything."""


def test_workers_with_other_packages_are_named_with_both_versions(threads, monkeypatch, scenes_of, tmp_path):
    here = metadata.version("cablepod")
    wanted = {**_cluster.package_versions(), "cablepod": "99.1"}  # the workers have the version of this process
    assert {"cablepod", "numba", "numpy", "xarray"} <= set(wanted)
    monkeypatch.setattr(_cluster, "package_versions", lambda: wanted)
    client = threads(2)
    address = next(iter(client.nthreads()))
    match = rf"^scheduler: given workers with other packages: .*{address} has cablepod {here} \(here 99\.1\).*; allowed: those "
    with pytest.raises(cp.SceneError, match=match):
        cp.ensemble.run(scenes_of(4), tmp_path / "it", batch=2, step=1e-3, scheduler=client)
    assert not list((tmp_path / "it").glob("batch*"))


def test_a_job_that_only_lost_workers_may_run_is_submitted_again(threads, impatient):
    with _cluster.client_pool(client := threads(1), client) as pool:
        (there,) = client.nthreads()
        pool.present = {**pool.present, LOST: 1}
        pool.refused = {there: f"{there} has cablepod 0.0.9 (here 0.1.0)"}
        stuck = pool.submit(_held)  # for the lost one alone
        assert pool.allowed == {stuck: frozenset([LOST])}
        assert pool.stranded([stuck]) == []
        until(lambda: LOST not in pool.present)
        assert pool.stranded([stuck]) == [stuck]
        stuck.cancel()
        with pytest.raises(
            cp.SceneError, match=r"^scheduler: given workers with other packages: .* cablepod 0\.0\.9 \(here"
        ):
            pool.look(1)
        pool.accepted = True  # later on it waits for others
        pool.look(1)
        time.sleep(2 * _cluster.TELL_AFTER)
        with pytest.warns(WorkersWarning, match=r"waiting for a worker of .*: it has only refused ones \(.*0\.0\.9"):
            pool.look(1)


def test_a_client_that_cannot_be_asked_is_refused(threads, scenes_of, tmp_path):
    client = threads(1)
    client.close()
    with pytest.raises(cp.SceneError, match=r"^scheduler: given <Client.*; allowed: a scheduler that answers"):
        cp.ensemble.run(scenes_of(2), tmp_path / "it", step=1e-3, scheduler=client)


def test_a_folder_of_the_same_name_elsewhere_is_not_that_of_the_run(copied, tmp_path):
    ensemble, token = json.loads((copied / "manifest.json").read_text())["id"], (copied / LOCK).read_text()
    assert len(token) == 32
    assert unseen(copied, ensemble, token) == ""
    assert "is another folder" in unseen(copied, ensemble, token[::-1])
    assert unseen(tmp_path / "none", ensemble, token)
    assert "holds ensemble" in unseen(copied, "another", token)
    # a batch for a process that does not see it: it asks for the inputs, then sends its results, with all attributes
    (copied / "batch_0001.nc").unlink()
    blind = {"token": token[::-1], "alone": False}
    assert run_batch(copied, ensemble, 1, **blind)[:2] == (None, None)
    inputs = pickle.loads(pickle.dumps(inputs_of(copied, ensemble, 1)))
    done = run_batch(copied, ensemble, 1, inputs=inputs, **blind)
    assert done.entry is None
    assert not (copied / "batch_0001.nc").exists()
    written = run_batch(copied, ensemble, 1, token=token, alone=False)
    assert written.batch is None
    assert written.entry == json.loads((copied / "manifest.json").read_text())["done"]["1"]
    kept = cp.archive.read(copied / "batch_0001.nc")
    xr.testing.assert_equal(done.batch, kept)
    assert done.batch.attrs["id"] == kept.attrs["id"]


def test_a_scheduler_that_cannot_be_reached_leaves_nothing(scenes_of, copied, tmp_path, monkeypatch):
    monkeypatch.setattr(_cluster, "CONNECT_TIMEOUT", 0.5)
    begin = time.monotonic()
    for address in ("tcp://127.0.0.1:9", "tcp://no.such.host.invalid:8786", "ftp://x"):
        with pytest.raises(
            cp.SceneError, match=rf"^scheduler: given '{address}'; allowed: an address at which a dask scheduler"
        ):
            cp.ensemble.run(scenes_of(2), tmp_path / "new", step=1e-3, scheduler=address)
        assert not (tmp_path / "new").exists()
    before = sorted(copied.iterdir())  # another ensemble
    with pytest.raises(cp.SceneError, match=r"^scheduler: given"):
        cp.ensemble.run(scenes_of(2), copied, step=1e-3, scheduler="tcp://127.0.0.1:9", overwrite=True)
    assert sorted(copied.iterdir()) == before
    with pytest.raises(ValueError, match="No client"):  # nothing is left that would take over what others compute
        distributed.default_client()
    assert time.monotonic() - begin < 30  # three times the limit, and what names take
    with pytest.raises(cp.SceneError, match=r"^workers: given 2; allowed: none with a scheduler of your own"):
        cp.ensemble.run(scenes_of(2), tmp_path / "new", step=1e-3, scheduler="tcp://127.0.0.1:9", workers=2)


# --- processes ------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_client_writes_what_workers_send_that_do_not_see_the_folder(
    cluster, impatient, monkeypatch, scenes_of, tmp_path
):
    if way_apart() is None:
        pytest.skip("no file systems of its own for a process")
    (folder := tmp_path / "it").mkdir()
    address, said = cluster.start_scheduler(), []

    def warn(text):
        said.append(text)
        cluster.worker(hidden=folder)

    monkeypatch.setattr(DaskPool, "warn", staticmethod(warn))
    run = cp.ensemble.run(scenes_of(6), folder, batch=2, step=1e-3, scheduler=address)
    here = cp.ensemble.run(scenes_of(6), tmp_path / "here", batch=2, step=1e-3)
    same_but_times(run, here)
    assert len(said) == 1
    assert said[0].startswith(f"waiting for a worker of '{address}': it has none at present, 3 batches")
    manifests = [json.loads((path / "manifest.json").read_text()) for path in (folder, tmp_path / "here")]
    assert len(list(folder.glob("batch*"))) == 3
    assert manifests[0]["done"] == manifests[1]["done"]
    # it goes on with what is missing, and only that, beside a worker that does see the folder
    kept = (folder / "batch_0001.nc").stat().st_mtime_ns
    (folder / "batch_0000.nc").unlink()
    (folder / "batch_0002.nc").unlink()
    cluster.worker()
    with distributed.Client(address, set_as_default=False) as client:
        until(lambda: len(client.nthreads()) == 2)
        same_but_times(cp.ensemble.run(scenes_of(6), folder, batch=2, step=1e-3, scheduler=client), here)
    assert (folder / "batch_0001.nc").stat().st_mtime_ns == kept
    assert not list(folder.glob(".*.part"))


@pytest.mark.slow
def test_workers_come_late_leave_are_killed_and_refused(cluster, impatient, scenes_of, tmp_path, recwarn):
    address = cluster.start_scheduler()
    first, other = cluster.worker(), cluster.worker(path=fake_version(tmp_path / "other", "0.0.9"))
    with distributed.Client(address, set_as_default=False) as client:
        until(lambda: len(client.nthreads()) == 2)
        given = iter(range(99))

        def change(_):
            number = next(given)
            if number == 2:
                cluster.worker()
                cluster.worker()
            elif number == 6:
                os.kill(first.pid, signal.SIGKILL)
            elif number == 12:
                cluster.processes[-1].terminate()  # it leaves in order

        run = cp.ensemble.run(scenes_of(80), tmp_path / "it", batch=2, step=STEP, scheduler=client, progress=change)
    assert other.poll() is None
    texts = [str(item.message) for item in recwarn if item.category is WorkersWarning]
    version = metadata.version("cablepod")
    assert re.fullmatch(
        rf"workers with other packages are not used: tcp://\S+ has cablepod 0\.0\.9 \(here {version}\); install the same there",
        texts[0],
    )
    direct = cp.chain.simulate(scenes_of(80), step=STEP)
    np.testing.assert_array_equal(run["position"], direct["position"])


@pytest.mark.slow
@pytest.mark.parametrize("form", ["command", "script"])
def test_ctrl_c_ends_the_wait_with_one_message(cluster, ctrl_c, tmp_path, form):
    address, scene, folder = cluster.start_scheduler(), tmp_path / "study.toml", tmp_path / "out"
    scene.write_text(SOFT_TOML + '[ensemble]\nmembers = 9\n[ensemble.ranges]\n"cable.top_tension" = [200.0, 300.0]\n')
    script = "import sys, cablepod as cp\nscenes = cp.ensemble.design(cp.read_scene(sys.argv[1]))\n"
    script += "cp.ensemble.run(scenes, sys.argv[2], scheduler=sys.argv[3])\n"
    command = ["-m", "cablepod", "ensemble", scene, "--out", folder, "--scheduler", address]
    process = python(*(command if form == "command" else ["-c", script, scene, folder, address]), bufsize=1)
    line = next(line for line in process.stderr if "waiting for a worker" in line)
    assert f"waiting for a worker of '{address}': it has none at present, 1 batch is left" in line
    time.sleep(1.0)  # it waits on
    assert process.poll() is None
    begin = time.monotonic()
    process.send_signal(signal.SIGINT)
    _, error = finish(process, timeout=60)
    assert time.monotonic() - begin < 10.0  # two seconds by themselves; the machine may be busy
    if form == "command":
        assert process.returncode == 130
        told = "interrupted; every file that was written is whole, the same command goes on where it stopped"
        assert without_progress(error) == f"cablepod: {told}\n"
    else:
        assert error.count("Traceback") == 1
        assert error.endswith("KeyboardInterrupt\n")
        assert "distributed" not in error
    assert sorted(path.name for path in folder.iterdir()) == [LOCK, "manifest.json", "scenes.nc"]
    assert json.loads((folder / "manifest.json").read_text())["done"] == {}
