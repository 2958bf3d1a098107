"""Ctrl-C comes where no lock is left taken: at the worst places there are, in threads, files, and with handlers of others."""

from __future__ import annotations

import json
import os
import signal
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
from children import run_python

from cablepod import _resources as sigint
from cablepod.batch import _pool as batch_pool


def press():
    signal.raise_signal(signal.SIGINT)


def press_later(seconds=0.3):
    threading.Timer(seconds, os.kill, (os.getpid(), signal.SIGINT)).start()


#: Longest wait of a thread for an event that a working interrupt sets (s).
PATIENCE = 20.0


@pytest.fixture(autouse=True)
def nothing_stays_held(ctrl_c):
    before = signal.getsignal(signal.SIGINT)
    yield
    assert signal.getsignal(signal.SIGINT) is before
    assert sigint._State.previous is None


@pytest.mark.parametrize(
    ("steps", "done"),
    [
        ("press work", "work"),
        ("check press work check work", "work"),
        ("press press work", ""),  # twice: at once
        ("inner work", "work"),  # it was pressed in a block within this one, which leaves it to this one
        ("press fail work", ""),
        ("press caught press work", ""),  # what ends after the first one need not be waited for
        ("press caught work press", "work"),
    ],
)
def test_when_it_comes(steps, done):
    did = []

    def fail():
        raise ValueError("of the block")

    @sigint.defer_sigint()
    def inner():
        press()

    def caught():
        with pytest.raises(KeyboardInterrupt):
            sigint.check_sigint()

    does = {
        "press": press,
        "check": sigint.check_sigint,
        "inner": inner,
        "fail": fail,
        "caught": caught,
        "work": lambda: did.append("work"),
    }

    @sigint.defer_sigint()
    def block():
        for step in steps.split():
            does[step]()

    with pytest.raises(KeyboardInterrupt) as error:
        block()
    assert " ".join(did) == done
    assert ("of the block" in str(error.value.__context__)) == ("fail" in steps)
    with sigint.defer_sigint():  # and is forgotten then
        sigint.check_sigint()


def test_whoever_else_is_told_of_it_still_is():
    told = []
    before = signal.signal(signal.SIGINT, lambda number, frame: told.append(number))
    try:
        with sigint.defer_sigint():
            press()
            assert not told
            sigint.check_sigint()
            assert told == [signal.SIGINT]
            press()
        assert told == [signal.SIGINT] * 2
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # as of nohup
        with sigint.defer_sigint():
            press()
        assert len(told) == 2
    finally:
        signal.signal(signal.SIGINT, before)


def test_other_threads_hold_nothing():
    def inside():
        with sigint.defer_sigint():
            sigint.check_sigint()
            return signal.getsignal(signal.SIGINT)

    before = signal.getsignal(signal.SIGINT)
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(inside).result() is before


def test_waiting_ends_with_it():
    end = threading.Event()
    with ThreadPoolExecutor(1) as pool:
        never = pool.submit(end.wait, PATIENCE)
        press_later()
        begin = time.monotonic()
        with pytest.raises(KeyboardInterrupt):
            sigint.wait_for_any([never])
        assert time.monotonic() - begin < 0.5 * PATIENCE
        end.set()
    assert sigint.wait_for_any([never]) == {never}


def test_items_in_threads():
    counts = []
    assert batch_pool.map_threads(lambda x: x**2, range(20), 2, done=counts.append) == [x**2 for x in range(20)]
    assert counts[-1] == 20
    assert batch_pool.map_threads(abs, [], 2) == []


def test_what_has_not_begun_does_not_begin():
    begun, end, deadline = [], threading.Event(), time.monotonic() + PATIENCE

    def work(i):
        begun.append(i)
        end.wait(max(0.0, deadline - time.monotonic()))  # all items together wait no longer

    press_later()
    with pytest.raises(KeyboardInterrupt):
        batch_pool.map_threads(work, range(50), 2, ended=end.set)
    assert sorted(begun) == [0, 1]


def test_the_failure_that_ended_it_is_told():
    end, deadline = threading.Event(), time.monotonic() + PATIENCE

    def work(i):
        if i == 1:
            raise ValueError("why")
        if end.wait(max(0.0, deadline - time.monotonic())):
            raise RuntimeError("asked to end")

    with pytest.raises(ValueError, match="why"):
        batch_pool.map_threads(work, range(50), 2, ended=end.set)


# --- at the worst places --------------------------------------------------------------------------------------------------

#: Ctrl-C at the n-th place where the main thread has taken a lock that is written in Python, and nothing lets go of it yet.
WORST = """
import concurrent.futures._base as base
import json, signal, sys, threading
import cablepod as cp
from scenes import SOFT
from xarray.backends import locks

count, wanted, main = 0, -1, threading.get_ident()

def after(function):
    def wrapped(*given):
        global count
        result = function(*given)
        if threading.get_ident() == main:
            count += 1
            if count == wanted:
                signal.raise_signal(signal.SIGINT)
        return result
    return wrapped

threading.Condition.__enter__ = after(threading.Condition.__enter__)
base._AcquireFutures.__enter__ = after(base._AcquireFutures.__enter__)
locks.CombinedLock.acquire = after(locks.CombinedLock.acquire)

def run(folder):
    return cp.ensemble.run(scenes, folder, batch=2, step=1e-3)

def handed_over(folder):
    return [batch["position"].values for batch in cp.ensemble.batches(scenes, batch=2, step=1e-3)]

def chains(folder):
    return cp.chain.simulate(scenes, step=1e-3)

def files(folder):
    path = cp.archive.write(one, folder + ".nc", overwrite=True)
    with cp.archive.read(path, chunks={"time": 5}) as lazy:
        cp.archive.write(lazy, folder + "-again.nc", overwrite=True)
        cp.pod.decompose(lazy, rank=2)
    return cp.archive.read(path)

scenes = cp.ensemble.design(cp.make_scene(SOFT), {"cable.top_tension": [200.0, 300.0]}, members=8)
one = cp.chain.simulate(cp.make_scene(SOFT), step=1e-3, times=[0.01 * i for i in range(50)])
told = {}
for use in (run, handed_over, chains, files):
    folder, name = sys.argv[1] + "/" + use.__name__, use.__name__
    count, wanted = 0, -1
    use(folder + "-whole")
    places, came = count, 0
    for n in range(1, places + 1, max(1, places // int(sys.argv[2]))):
        count, wanted = 0, n
        try:
            use(f"{folder}-{n}")
        except KeyboardInterrupt:
            came += 1
        wanted = -1
        use(f"{folder}-{n}")  # goes on, or begins anew: nothing waits for what was left taken
    told[name] = [places, came]
    print(json.dumps(told), flush=True)
"""


@pytest.mark.slow
def test_at_the_worst_places_it_leaves_nothing_taken(tmp_path):
    # it takes some ten seconds; one lock left taken, and it never ends
    done = run_python("-X", "faulthandler", "-c", WORST, tmp_path, "12", timeout=120)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout.splitlines()[-1])
    for _, came in told.values():
        assert came > 0
    assert not list(tmp_path.glob("**/.cablepod-*.part"))
