"""What becomes of a Dataset depends on it alone, whichever Datasets were seen before."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
import xarray as xr
from altered import ALTERATIONS
from public_calls import datasets

import cablepod as cp
from cablepod import provenance
from cablepod._inputs import (
    AMPLITUDES,
    FIELD_MODES,
    MODES,
    MOTION,
    NORMAL_MODES,
    SCENE,
    SNAPSHOTS,
    TIMED,
    TRAJECTORY,
    WITH_PLACES,
    _seen,
    _taken,
    taken,
)
from cablepod.conventions import IN_ORDER, PLACES_IN_ORDER

#: Kinds, and the stages of which Datasets are altered and follow each other.
KINDS = {
    "scene": (SCENE, ("scene", "members")),
    "snapshots": (SNAPSHOTS, ("chain", "condensed")),
    "trajectory": (TRAJECTORY, ("chain", "condensed")),
    "motion": (MOTION, ("chain", "condensed")),
    "timed": (TIMED, ("chain", "amplitudes")),
    "with places": (WITH_PLACES, ("chain", "modes")),
    "amplitudes": (AMPLITUDES, ("amplitudes", "condensed")),
    "modes": (MODES, ("modes", "vector modes", "normal modes")),
    "field modes": (FIELD_MODES, ("modes", "vector modes")),
    "normal modes": (NORMAL_MODES, ("normal modes", "modes")),
}
#: Datasets altered in one and in two ways of each stage, and checks in a row, of a quick test and of a slow one.
QUICK, SLOW = (100, 60, 400), (400, 600, 6000)
# whichever test comes first makes the Datasets
pytestmark = pytest.mark.filterwarnings("ignore")


@pytest.fixture(autouse=True)
def _own_tables(monkeypatch):
    monkeypatch.setattr(_seen, "_records", {})


def forget() -> None:
    """Forget all Datasets, indexes and places that were seen."""
    _seen._records.clear()
    _taken._verdict.cache_clear()
    _taken._known.cache_clear()
    provenance.VERDICTS.clear()
    PLACES_IN_ORDER.clear()
    for known in IN_ORDER.values():
        known.clear()


def outcome(dataset: xr.Dataset, kind: Any) -> Any:
    """The message that refuses a Dataset, that it is in order, or what is made of it."""
    try:
        found = taken("it", dataset, kind)
    except cp.SceneError as error:
        return str(error)
    if found is dataset:
        return "in order"
    variables = found.variables.items()
    return [
        (name, v.dims, v.dtype.str, v.values.tolist() if v.dtype.kind == "O" else v.values.tobytes())
        for name, v in variables
    ]


@cache
def original(stage: str) -> xr.Dataset:
    """A Dataset of one's own."""
    return datasets()[stage].copy(deep=True)


def altered(stages: tuple[str, ...], once: int, twice: int, rng: np.random.Generator) -> list[xr.Dataset]:
    """Datasets altered in so many ways, and as they were, in any order."""
    pool = [original(stage) for stage in stages for _ in range(once // 4)]
    for stage in stages:
        found: list[xr.Dataset] = []
        while len(found) < once + twice:
            # those altered once follow each other often, so that their verdicts meet
            before = found[rng.integers(once)] if len(found) >= once else original(stage)
            kind = list(ALTERATIONS)[rng.integers(len(ALTERATIONS))]
            try:
                one = ALTERATIONS[kind](before, rng)
            except Exception:  # an alteration of the package's Datasets, not of altered ones
                one = None
            if one is not None:
                found.append(one.dataset)
        pool += found
    return pool


def differing(name: str, once: int, twice: int, checks: int, seed: int) -> list[str]:
    """Datasets of which something else becomes after others were seen, one a line."""
    kind, stages = KINDS[name]
    rng = np.random.default_rng(seed)
    pool = altered(stages, once, twice, rng)
    alone = []
    for dataset in pool:
        forget()
        alone.append(outcome(dataset, kind))
    assert "in order" in alone
    assert sum(isinstance(one, str) and one != "in order" for one in alone) > len(alone) // 10
    forget()
    found = []
    for number in rng.integers(len(pool), size=checks):
        after = outcome(pool[number], kind)
        if after != alone[number]:
            found.append(f"{number}: alone {alone[number]!s:.200}; after others {after!s:.200}")
    return found


@pytest.mark.parametrize("name", KINDS)
def test_a_sample_of_datasets_after_others(name):
    found = differing(name, *QUICK, seed=5)
    assert not found, "\n".join(found)


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize("seed", [61, 62, 63])
def test_many_datasets_after_others(name, seed):
    found = differing(name, *SLOW, seed=seed)
    assert not found, "\n".join(found)
