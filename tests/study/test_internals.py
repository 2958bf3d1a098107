"""Parts of a study: warnings are given once, run times have no compilation, statistics begin after ramps."""

from __future__ import annotations

import time
import warnings
from pathlib import Path

import pytest
from numba.core import event
from public_calls import MAST
from scenes import SOFT

import cablepod as cp
from cablepod.cli import _mast, _report
from cablepod.plots import mast_shapes
from cablepod.study import _mast as study_of_mast
from cablepod.study import _tension
from cablepod.study._stages import OnceEach


def test_a_note_is_given_once_whatever_model_and_numbers():
    notes = OnceEach()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for model, number in (("condensed", 0.56), ("Galerkin", 2), ("Galerkin", 1.5e-3)):
            with notes.collected():
                warnings.warn(f"an error of {number} (of the model {model}, r = 4)", cp.OutOfRangeWarning, stacklevel=1)
        with notes.collected():
            warnings.warn("another error of 2 (of the model Galerkin, r = 4)", cp.OutOfRangeWarning, stacklevel=1)

        def stops() -> None:
            with notes.collected():
                warnings.warn("before it stops", UserWarning, stacklevel=1)
                raise cp.RunStopped("stopped")

        with pytest.raises(cp.RunStopped):
            stops()
    said = [str(item.message).split(" (")[0] for item in caught]
    assert said == ["an error of 0.56", "another error of 2", "before it stops"]
    assert caught[0].category is cp.OutOfRangeWarning
    assert caught[0].filename == __file__
    assert notes.left_out == 2


def test_a_study_gives_a_note_once_and_counts_the_others():
    # one mode does not hold the second shape of a slack line, in either model and with any number of modes
    slack = SOFT | {"cable": SOFT["cable"] | {"top_tension": 100.0}, "title": "slack"}
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        study = cp.study.run(cp.make_scene(slack), ranks=(1, 2))
    kinds = [(item.category, str(item.message)[:40].rstrip("0123456789.e-+ ")) for item in caught]
    assert len(kinds) == len(set(kinds)), kinds
    assert study.attrs["notes_left_out"] >= 1
    assert f"{study.attrs['notes_left_out']} more like those above" in "\n".join(_report.notes(study))


def test_the_run_time_of_a_mast_is_without_compilation(monkeypatch):
    scene = cp.make_scene(MAST)
    run = study_of_mast.mast.simulate(scene, step=0.02, outputs=study_of_mast.OUTPUTS)

    def compiled(*_, **__):
        with event.trigger_event("numba:compiler_lock"), event.trigger_event("numba:compile"):
            time.sleep(0.5)
        return run

    monkeypatch.setattr(study_of_mast.mast, "simulate", compiled)
    labels: list[str] = []
    study = cp.study.run(scene, progress=lambda label, _: labels.append(label))
    assert study["motion"].attrs["wall_time_s"] < 0.25  # half of the sleep, far more than a call that returns a result
    assert study.attrs["compile_time_s"] >= 0.5
    assert "mast: compiling" in labels
    assert "of compiling, once on this machine" in _mast.text(study, Path(__file__).parent)


def test_the_picture_of_the_modes_has_the_frequencies_of_the_table():
    study = cp.study.run(cp.make_scene(MAST))
    ticks = [label.get_text() for label in mast_shapes(study["frequencies"].to_dataset()).get_xticklabels()]
    (line,) = [line for line in _mast.text(study, Path(__file__).parent).splitlines() if "as in modes.png" in line]
    assert line.split(" Hz")[0].split() == ticks
    assert len(ticks) == 6


@pytest.mark.parametrize(
    ("ramps", "start"), [([], 0.0), ([0.0], 0.0), ([2.0, 5.0], 5.0), ([9.0], 9.0), ([9.5], 0.0), ([20.0], 0.0)]
)
def test_too_little_after_a_ramp_is_no_part(ramps, start):
    assert _tension.start_of_statistics(ramps, 10.0) == start
