"""Members of a scene with a mast: those of the same air, structure and steps run abreast."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
import xarray as xr

from cablepod._resources import cores
from cablepod.batch._blas import one_blas_thread
from cablepod.batch._members import BatchPlan
from cablepod.batch._stack import Variables, arrays_of
from cablepod.errors import SceneError
from cablepod.mast import _output as output
from cablepod.mast._abreast_run import run_abreast
from cablepod.mast._kernels_layout import ABREAST
from cablepod.mast._request import MastTrajectory
from cablepod.mast._runs import MastCase
from cablepod.parameters._mast import mast_parameters

#: Outputs of runs abreast.
OUTPUTS = {"displacement", "guy_tension", "guy_force", "bending_moment", "extremes"}
#: Groups of members abreast that a thread prepares together, as members of different steps or air do not run abreast.
GROUPS = 4
#: Members that run abreast at least: a group takes the time of two and a half runs alone however few it has, with vectors of 512
#: bits.
LEAST_ABREAST = 3
#: Outputs of members that a thread keeps at once, all instants of all members.
MAX_INSTANTS = 300_000
#: Defaults of the options of :func:`cablepod.mast.simulate` that a case needs.
DEFAULTS: Mapping[str, Any] = {
    "guys": "condensed", "rank": None, "links": None, "times": None, "step": None, "tolerance": None, "window": None,
    "wind": None, "outputs": ("displacement", "guy_tension", "extremes"),
}  # fmt: skip


def plan(scene: xr.Dataset, modes: xr.Dataset | None = None, **options: Any) -> BatchPlan | None:
    """Return how to run members abreast; None for options and scenes that need a run of each member alone."""
    asked = {**DEFAULTS, **options}
    outputs = asked["outputs"]
    if asked["guys"] != "condensed" or asked["tolerance"] is not None or scene.sizes["member"] < 2:
        return None
    if not isinstance(outputs, tuple | list) or not all(isinstance(name, str) for name in outputs):
        return None
    if set(outputs) - OUTPUTS:
        return None
    try:  # what is wrong is said by the runs of the members
        p = mast_parameters(scene.isel(member=0, drop=True))
        instants = p.times().size if asked["times"] is None else np.size(asked["times"])
    except SceneError:
        return None
    abreast = min(ABREAST, max(1, MAX_INSTANTS // (GROUPS * max(instants, 1))))
    if abreast < 2:
        return None
    members = Members(scene, modes, asked, abreast)
    share = -(-scene.sizes["member"] // cores())  # all threads end together
    return BatchPlan(members.run, members.first, members.prepare, min(GROUPS * abreast, max(abreast, share)))


class Members:
    """Members of a scene whose cases a thread prepares and runs abreast before it takes their results one by one."""

    def __init__(self, scene: xr.Dataset, modes: xr.Dataset | None, options: Mapping[str, Any], abreast: int) -> None:
        self.scene, self.modes, self.options, self.abreast = scene, modes, options, abreast
        self._done: dict[int, tuple[MastCase, MastTrajectory]] = {}
        self._first: list[xr.Dataset] = []
        #: One thread prepares a group while others run theirs: together they would wait for the interpreter, then for the cores.
        self._preparing = threading.Lock()

    def first(self) -> xr.Dataset:
        """Return the result of one completed member."""
        return self._first[0]

    @one_blas_thread()
    def prepare(self, first: int, last: int, check: Callable[[], None]) -> None:
        """Run the members `first` ... `last - 1` abreast, but for those that fail, which say so when they run alone."""
        groups: dict[Any, list[tuple[int, MastCase]]] = {}
        members = iter(range(first, last))
        while (full := self._full_group(members, groups, check)) is not None:
            self._advance(full)
        for group in groups.values():
            check()
            self._advance(group)

    def _full_group(
        self, members: Iterator[int], groups: dict[Any, list[tuple[int, MastCase]]], check: Callable[[], None]
    ) -> list[tuple[int, MastCase]] | None:
        """Sort cases of members into groups; take and return the first that is full, None at the end of the members."""
        with self._preparing:
            for i in members:
                check()
                try:
                    case = self._case(i)
                    case.model.checked_scheme(case.request.step)
                except (SceneError, ValueError, ArithmeticError):
                    continue
                key = _shared(case)
                groups.setdefault(key, []).append((i, case))
                if len(groups[key]) == self.abreast:
                    return groups.pop(key)
        return None

    def _advance(self, group: list[tuple[int, MastCase]]) -> None:
        """Run a group, abreast where it is large enough."""
        if len(group) < LEAST_ABREAST:
            runs = [case.model.run(case.request) for _, case in group]
        else:
            runs = run_abreast([case.model for _, case in group], group[0][1].request)
        self._done.update({i: (case, run) for (i, case), run in zip(group, runs, strict=True) if not run.status})

    @one_blas_thread()
    def run(self, i: int) -> tuple[Variables, Mapping[str, Any]]:
        """Return variables and attributes of a member."""
        case, run = self._done.pop(i) if i in self._done else (self._case(i), None)
        if run is None or not self._first:  # a run alone says what is wrong
            result = case.result(*(case.run() if run is None else (run, {})))
            self._first.append(result)
            attrs = {name: value for name, value in result.attrs.items() if name not in ("id", "history_json")}
            return arrays_of(result), attrs
        return output.arrays(case.mast, run, case.wanted), case.attributes(run, {})

    def _case(self, i: int) -> MastCase:
        return MastCase(self.scene.isel(member=i, drop=True), self.modes, **self.options)


def _shared(case: MastCase) -> Any:
    """Return what members abreast have in common."""
    mast, request = case.mast, case.request
    varying = [load.factor is not None for load in case.p.loads]
    return (
        request.every, request.steps, case.model.steps_of_drag(request.step), request.window_steps, id(case.air),
        len(case.p.guys), case.model.rank, mast.omega.size, mast.level_of_guy.tobytes(), mast.heights.tobytes(),
        mast.rest.beam.height.tobytes(), case.p.mass_damping, len(varying), any(varying),
    )  # fmt: skip
