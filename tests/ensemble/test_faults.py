"""What an ensemble survives: interrupts, kills, a full disk, damaged files, other designs, two runs at once."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import time
from contextlib import nullcontext as nothing
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from children import call, finish, python, run_python, without_progress
from scenes import SOFT_TOML

import cablepod as cp

#: Short enough to be many, so that there is time to interrupt: a member takes some hundredths of a second.
STEP = 4e-6
RUN = """
import json, sys, warnings
import cablepod as cp
from scenes import SOFT

warnings.simplefilter("ignore", cp.CoarseWarning)  # eight links are few

if __name__ == "__main__":
    scenes = cp.ensemble.design(cp.make_scene(SOFT), {"cable.top_tension": [200.0, 300.0]}, members=16)
    cp.ensemble.run(scenes, sys.argv[1], batch=2, step=float(sys.argv[2]), **json.loads(sys.argv[3]))
"""


def scenes_of(soft, members=16):
    return cp.ensemble.design(cp.make_scene(soft), {"cable.top_tension": [200.0, 300.0]}, members=members)


def start(folder, tmp_path, **options):
    """Run the ensemble in another process."""
    script = tmp_path / "study.py"
    script.write_text(RUN)
    return python(script, folder, STEP, json.dumps(options), start_new_session=True)


def wait_for(folder, count, process):
    """Wait until so many batches are there."""
    for _ in range(6000):  # a minute
        if len(list(folder.glob("batch_*.nc"))) >= count:
            return
        if process.poll() is not None:
            pytest.fail(f"ended too soon: {process.communicate()}")
        time.sleep(0.01)
    process.kill()
    pytest.fail(f"no batch in a minute: {process.communicate()}")


def files(folder):
    return {path.name: path.stat().st_mtime_ns for path in folder.glob("batch_*.nc")}


def goes_on(folder, soft):
    """Run what is missing, and hold that nothing else is, and that all is as if never interrupted."""
    before = files(folder)
    assert 0 < len(before) < 8, "it was stopped too soon or too late"
    result = cp.ensemble.run(scenes_of(soft), folder, batch=2, step=STEP)
    assert before.items() <= files(folder).items()
    direct = cp.chain.simulate(scenes_of(soft), step=STEP)
    for name in ("position", "arc_length", "energy_excess", "cable_top_tension"):
        np.testing.assert_array_equal(result[name], direct[name])
    assert not list(folder.glob("*.part"))
    assert not list(folder.glob(".*.part"))


def test_it_refuses_another_run_at_a_time_and_survives_being_killed(soft, tmp_path):
    folder, scenes = tmp_path / "it", scenes_of(soft)
    cp.chain.simulate(scenes, step=1e-3)  # loads its kernels, which takes longer than all members
    process = start(folder, tmp_path)
    wait_for(folder, 1, process)
    if find_spec("fcntl"):
        with pytest.raises(cp.ArchiveError, match="another run is at work in this folder; wait for it"):
            cp.ensemble.run(scenes, folder, batch=2, step=STEP)
    os.kill(process.pid, signal.SIGKILL)
    finish(process, timeout=60)
    (folder / ".cablepod-0123.part").write_text("left behind")
    with pytest.raises(cp.ArchiveError, match="members are not done yet"):
        cp.archive.open_ensemble(folder)
    part = cp.archive.open_ensemble(folder, incomplete=True)
    assert part.sizes["member"] == 2 * len(files(folder))
    assert np.isfinite(part["position"]).all()
    goes_on(folder, soft)


@pytest.mark.slow
def test_it_survives_an_interrupt(soft, ctrl_c, tmp_path):
    folder = tmp_path / "it"
    process = start(folder, tmp_path)
    wait_for(folder, 2, process)
    os.kill(process.pid, signal.SIGINT)
    begin = time.monotonic()
    _, error = finish(process, timeout=60)
    assert "KeyboardInterrupt" in error
    # members at hand are finished, a few hundredths of a second each; all that waits would take a second and more
    assert time.monotonic() - begin < 20
    assert not list(folder.glob(".*.part"))
    noted = json.loads((folder / "manifest.json").read_text())["done"]
    assert {f"batch_{int(number):04d}.nc" for number in noted} <= set(files(folder))
    goes_on(folder, soft)


@pytest.mark.slow
def test_the_command_says_how_to_go_on(ctrl_c, tmp_path):
    scene = tmp_path / "study.toml"
    scene.write_text(SOFT_TOML + '[ensemble]\nmembers = 500\n[ensemble.ranges]\n"cable.top_tension" = [200.0, 300.0]\n')
    process = python("-m", "cablepod", "ensemble", scene, "--out", tmp_path / "out", "--option", f"step={STEP}")
    wait_for(tmp_path / "out", 1, process)
    process.send_signal(signal.SIGINT)
    _, error = finish(process, timeout=60)
    assert process.returncode == 130
    assert (
        without_progress(error)
        == "cablepod: interrupted; every file that was written is whole, the same command goes on where it stopped\n"
    )
    told = call("info", tmp_path / "out")
    assert "; the same command or call goes on" in told.stdout


@pytest.mark.slow
def test_it_survives_killed_workers_and_a_scheduler_given_by_its_address(soft, tmp_path):
    distributed = pytest.importorskip("distributed")
    folder = tmp_path / "it"
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50) as cluster,
        distributed.Client(cluster) as client,
    ):
        pids = list(client.run(os.getpid).values())
        process = start(folder, tmp_path, scheduler=cluster.scheduler_address)
        wait_for(folder, 2, process)
        os.kill(pids[0], signal.SIGKILL)  # its nanny starts another one
        _, error = finish(process, timeout=120)
        assert process.returncode == 0, error
        result = cp.archive.open_ensemble(folder)
        np.testing.assert_array_equal(result["position"], cp.chain.simulate(scenes_of(soft), step=STEP)["position"])


@pytest.mark.slow
def test_processes_of_this_machine_give_the_same_bits(soft, tmp_path):
    process = start(tmp_path / "it", tmp_path, scheduler="processes", workers=2)
    _, error = finish(process, timeout=120)
    assert (process.returncode, error) == (0, "")
    here = cp.ensemble.run(scenes_of(soft), tmp_path / "other", batch=2, step=STEP)
    there = cp.archive.open_ensemble(tmp_path / "it")
    assert here.attrs["id"] == there.attrs["id"]
    xr.testing.assert_equal(here.compute(), there.compute())


@pytest.mark.slow
def test_a_script_that_each_process_reads_again_is_told_what_it_lacks(tmp_path):
    script = tmp_path / "study.py"
    script.write_text(RUN.replace('if __name__ == "__main__":', "if True:"))
    options = json.dumps({"scheduler": "processes", "workers": 2})
    ended = run_python(script, tmp_path / "it", 1e-3, options, timeout=120)
    last = ended.stderr.strip().splitlines()[-1]
    assert "SceneError: scheduler: given 'processes'; allowed: processes that start" in last
    assert last.endswith('; a script needs if __name__ == "__main__": for them')
    assert not (tmp_path / "it").exists()


FULL = """
import resource, signal, sys
import cablepod as cp
from scenes import SOFT

scenes = cp.ensemble.design(cp.make_scene(SOFT), {"cable.top_tension": [200.0, 300.0]}, members=24)
options = {"batch": 8, "step": 1e-3, "times": [0.001 * i for i in range(3000)]}
if sys.argv[2] == "limit":
    cp.ensemble.run(scenes.isel(member=slice(0, 1)), sys.argv[1] + "-first", step=1e-3)  # compiled code may be larger
    resource.setrlimit(resource.RLIMIT_FSIZE, (1_500_000, 1_500_000))
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
try:
    cp.ensemble.run(scenes, sys.argv[1], **options)
except cp.ArchiveError as error:
    print(error)
"""


@pytest.fixture
def full_disk(tmp_path):
    """A folder on a disk of six megabytes, where this may be mounted; otherwise None."""
    folder = tmp_path / "small"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=6m", "tmpfs", str(folder)]
    mounted = shutil.which("mount") is not None and subprocess.run(command, capture_output=True).returncode == 0
    yield folder if mounted else None
    if mounted:
        subprocess.run(["umount", str(folder)], check=True)


def test_it_survives_a_full_disk(soft, tmp_path, full_disk):
    options = {"batch": 8, "step": 1e-3, "times": [0.001 * i for i in range(3000)]}
    folder = (full_disk or tmp_path) / "it"
    done = run_python("-c", FULL, folder, "mount" if full_disk else "limit", timeout=120)
    assert done.returncode == 0, done.stderr
    assert "is the disk full?" in done.stdout, done
    assert done.stdout.count("\n") == 1
    assert not list(folder.glob(".*.part"))
    there = len(files(folder))
    assert there < 3
    if full_disk:
        assert there > 0
        subprocess.run(["mount", "-o", "remount,size=60m", str(full_disk)], check=True)
    before = files(folder)
    result = cp.ensemble.run(scenes_of(soft, 24), folder, **options)
    assert before.items() <= files(folder).items()
    direct = cp.chain.simulate(scenes_of(soft, 24), step=1e-3, times=options["times"])
    np.testing.assert_array_equal(result["position"], direct["position"])


def test_another_ensemble_in_the_folder_is_refused_saying_what_differs(soft, tmp_path):
    scenes, folder = scenes_of(soft, 6), tmp_path / "it"
    first = cp.ensemble.run(scenes, folder, batch=3, step=1e-3).compute()
    kept = files(folder)
    wider = cp.ensemble.design(cp.make_scene(soft), {"cable.top_tension": [200.0, 400.0]}, members=6)
    heavier = scenes.assign(cable_density=2.0 * scenes["cable_density"])
    for other, options, match in (
        (scenes, {"step": 2e-3}, "the option step was 0.001 and is 0.002;"),
        (
            scenes,
            {"step": 1e-3, "outputs": ("tension",)},
            r"the option outputs was \['position', 'tension', 'tension_extremes'\] and is \['tension'\];",
        ),
        (scenes, {"step": 1e-3, "model": "rigid"}, "the model was 'chain' and is 'rigid';"),
        (scenes, {"step": 1e-3, "batch": 2}, "the size of batches was 3 and is 2;"),
        (scenes.isel(member=slice(0, 4)), {"step": 1e-3}, "the number of members was 6 and is 4; the scenes differ"),
        (wider, {"step": 1e-3}, "the scenes differ, in cable_top_tension;"),
        (heavier, {"step": 1e-3}, "the scenes differ;"),
    ):
        with pytest.raises(cp.ArchiveError, match=f"holds another ensemble: .*{match}.*overwrite=True to replace it"):
            cp.ensemble.run(other, folder, **{"batch": 3, **options})
        assert files(folder) == kept
    replaced = cp.ensemble.run(wider, folder, batch=4, step=1e-3, overwrite=True)
    np.testing.assert_array_equal(replaced["position"], cp.chain.simulate(wider, step=1e-3)["position"])
    assert not np.array_equal(replaced["position"], first["position"])
    assert len(files(folder)) == 2


def interrupted_after(fraction):
    """A callback of the progress that presses Ctrl-C."""

    def press(done):
        if done >= fraction:
            raise KeyboardInterrupt

    return press


def test_another_ensemble_remains_until_the_new_one_is_complete(soft, tmp_path, described):
    folder, new = tmp_path / "it", scenes_of(soft, 4)
    old = cp.ensemble.run(scenes_of(soft, 6), folder, batch=2, step=1e-3).compute()
    (folder / "map.csv").write_text("of the old one")
    options = {"batch": 1, "step": 2e-3, "workers": 1, "overwrite": True}
    with pytest.raises(KeyboardInterrupt):
        cp.ensemble.run(new, folder, **options, progress=interrupted_after(0.5))
    xr.testing.assert_identical(cp.archive.open_ensemble(folder).compute(), old)
    assert (folder / "map.csv").exists()
    assert "replaced  not yet" in described(folder)
    done = []
    result = cp.ensemble.run(new, folder, **options, progress=done.append)
    assert done[0] >= 0.25, "it began anew"
    np.testing.assert_array_equal(result["position"], cp.chain.simulate(new, step=2e-3)["position"])
    assert sorted(path.name for path in folder.iterdir()) == sorted(
        [".cablepod-lock", "manifest.json", "scenes.nc", *(f"batch_{number:04d}.nc" for number in range(4))]
    )


@pytest.mark.parametrize("steps", range(6))
def test_a_replacement_that_is_stopped_midway_is_completed(soft, tmp_path, monkeypatch, steps):
    """Three files, manifest and old ones are moved or removed one by one: the process may end between any two of them."""
    folder, new = tmp_path / "it", scenes_of(soft, 2)
    cp.ensemble.run(scenes_of(soft, 3), folder, batch=1, step=1e-3)
    left = [steps]

    def counted(call):
        def move(path, *to, **options):
            moved = ".cablepod-complete" in str(path) or path.parent == folder
            if moved and path.exists() and not path.name.startswith("."):
                if not left[0]:
                    raise KeyboardInterrupt
                left[0] -= 1
            return call(path, *to, **options)

        return move

    for name in ("replace", "unlink"):
        monkeypatch.setattr(Path, name, counted(getattr(Path, name)))
    with pytest.raises(KeyboardInterrupt):
        cp.ensemble.run(new, folder, batch=1, step=2e-3, overwrite=True)
    monkeypatch.undo()
    with pytest.raises(cp.ArchiveError, match="is being replaced; run its ensemble again") if steps else nothing():
        cp.archive.open_ensemble(folder)
    result = cp.ensemble.run(new, folder, batch=1, step=2e-3)
    np.testing.assert_array_equal(result["position"], cp.chain.simulate(new, step=2e-3)["position"])
    assert len(list(folder.iterdir())) == 5


def test_what_was_opened_is_not_read_from_the_ensemble_that_replaced_it(soft, tmp_path):
    folder = tmp_path / "it"
    old = cp.ensemble.run(scenes_of(soft, 2), folder, step=1e-3)
    cp.ensemble.run(scenes_of(soft, 2), folder, step=2e-3, overwrite=True)
    with pytest.raises(cp.ArchiveError, match=r"batch_0000\.nc: is not batch 0 of the ensemble .* open it again"):
        old["position"].compute()


def test_files_without_their_manifest_are_known_by_their_ids(soft, tmp_path):
    scenes, folder = scenes_of(soft, 6), tmp_path / "it"
    whole = cp.ensemble.run(scenes, folder, batch=2, step=1e-3).compute()
    kept = files(folder)
    for damage, overwrite in ((None, False), ("{", True)):
        (folder / "manifest.json").unlink()
        if damage is not None:
            (folder / "manifest.json").write_text(damage)
        again = cp.ensemble.run(scenes, folder, batch=2, step=1e-3, overwrite=overwrite)
        xr.testing.assert_equal(again.compute(), whole)
        assert files(folder) == kept


def test_files_of_somebody_else_are_left_alone(soft, tmp_path):
    scenes, folder = scenes_of(soft, 2), tmp_path / "it"
    folder.mkdir()
    (folder / "notes.txt").write_text("mine")
    (folder / "batch_0000.nc").write_text("mine too")
    with pytest.raises(
        cp.ArchiveError, match=r"holds batch_0000\.nc but no manifest\.json; give another folder, or overwrite"
    ):
        cp.ensemble.run(scenes, folder, step=1e-3)
    assert (folder / "batch_0000.nc").read_text() == "mine too"
    cp.ensemble.run(scenes, folder, step=1e-3, overwrite=True)
    assert (folder / "notes.txt").read_text() == "mine"
    for path in (folder / "notes.txt", folder / "notes.txt" / "below"):
        with pytest.raises(cp.ArchiveError, match=r"^path: given .*, which is or lies below a file; allowed: a folder"):
            cp.ensemble.run(scenes, path, step=1e-3)


def test_damaged_files_are_named_and_computed_again_only_on_demand(soft, tmp_path, described):
    scenes, folder = scenes_of(soft, 6), tmp_path / "it"
    whole = cp.ensemble.run(scenes, folder, batch=2, step=1e-3).compute()
    content = (folder / "batch_0001.nc").read_bytes()
    for damage, match in (
        (content[:2000], "is truncated or damaged"),
        (content + b"\0", "is truncated or damaged"),
        (content + bytes(4096), "is damaged or edited, it lacks its last line"),
    ):
        (folder / "batch_0001.nc").write_bytes(damage)
        with pytest.raises(
            cp.ArchiveError, match=rf"batch_0001\.nc: .*{match}.*; give overwrite=True to compute them again"
        ):
            cp.ensemble.run(scenes, folder, batch=2, step=1e-3)
        assert (folder / "batch_0001.nc").read_bytes() == damage
    kept = files(folder)
    again = cp.ensemble.run(scenes, folder, batch=2, step=1e-3, overwrite=True)
    assert {name for name, at in files(folder).items() if kept[name] != at} == {"batch_0001.nc"}
    xr.testing.assert_equal(again.compute(), whole)
    # what is gone is just missing
    (folder / "batch_0002.nc").unlink()
    assert "missing   batch_0002.nc" in described(folder)
    xr.testing.assert_equal(cp.ensemble.run(scenes, folder, batch=2, step=1e-3).compute(), whole)
    # and a manifest that is gone before a batch was there is written again
    for path in [*folder.glob("batch*"), folder / "manifest.json"]:
        path.unlink()
    xr.testing.assert_equal(cp.ensemble.run(scenes, folder, batch=2, step=1e-3).compute(), whole)
