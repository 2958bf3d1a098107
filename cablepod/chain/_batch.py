"""Chains of many members: runs of equal shape advance together in one compiled call.

Each member has the preparation, the search of its step and the checks of the run of its scene alone; only its Dataset is left
out.  Both have the same compiled loops; explicit members have the same bits.  Implicit ones lie in lanes, whose sums over links
are added up in another order.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, cast

import xarray as xr

from cablepod import provenance
from cablepod.batch._members import BatchPlan
from cablepod.batch._stack import Variables
from cablepod.chain._explicit import ExplicitStepper, PreparedRun
from cablepod.chain._implicit import ImplicitStepper
from cablepod.chain._lanes import LANES, ImplicitLanes
from cablepod.chain._scheme import SCHEMES, ChainRequest, prepare, search_of, solution_of, solve, with_space_error
from cablepod.errors import RunStopped, SceneError
from cablepod.integrate._coarse import warn_of_few_links_in
from cablepod.integrate._march import BLOCK
from cablepod.integrate._scheme import Solution
from cablepod.integrate._step_control import Search, complete
from cablepod.parameters._from_scene import Members

#: Maximum and minimum number of steps per block (multiples of the period after which tables of sines restart, so that the tables
#: equal those of a single run).
MAX_BLOCK_STEPS, MIN_BLOCK_STEPS = BLOCK, 1024
#: Implicit members that a thread takes at once where each searches its own step.
SEARCHING = 4 * LANES
#: Maximum link steps of all members per block (a few tenths of a second, the latency of cancellation).
BLOCK_WORK = 2e8
#: Maximum memory of the saved steps of a chunk [bytes]; members beyond it run one by one.
MAX_KEPT_BYTES = 2**27


def plan(scene: xr.Dataset, **options: Any) -> BatchPlan | None:
    """Return the plan of a batched run; None for invalid options, which single runs report for each member."""
    try:
        members, request = Members(scene), ChainRequest.of(**options)
        if "error_estimate" not in request.outputs:
            warn_of_few_links_in(members, request.links, request.times)
    except SceneError:
        return None
    batch = ChainBatch(members, request, str(scene.attrs.get("title", "scene")))
    in_lanes = request.scheme not in (None, SCHEMES[0])
    # members that search their steps find more of their like in a larger chunk
    abreast = LANES if request.step is not None else SEARCHING
    return BatchPlan(batch.run_member, lambda: batch.first[0], batch.prepare_chunk, abreast if in_lanes else 1)


class ChainBatch:
    """Runs of the members of a scene with common options."""

    def __init__(self, members: Members, request: ChainRequest, title: str) -> None:
        self.members, self.request, self.title = members, request, title
        self.first: list[xr.Dataset] = []  #: result of the first member, the template of all others
        self._searches: dict[int, Search] = {}  #: of members whose steps are still searched
        self._solved: dict[int, Solution] = {}

    def prepare_chunk(self, first: int, last: int, check: Callable[[], None]) -> None:
        """Advance the members `first` ... `last - 1` together: the runs that their searches of a step need, round by round.

        A member whose next run is like too few others is left to :meth:`run_member`, which goes on with its search alone.
        `check` is called regularly and raises :class:`cablepod.errors.StoppedError` on cancellation.
        """
        ready = []
        for i in range(first, last):
            check()
            if self._begin(i):
                ready.append(i)
        while ready:
            ready = [i for group in self._groups(ready, check) for i in self._together(group, check)]

    def _begin(self, i: int) -> bool:
        """Begin the search of a member; returns False if it runs alone, or fails, which its own run reports."""
        try:
            ready = prepare(self.members[i], self.request, self.title)
            self._searches[i] = search_of(ready, self.request)
        except (ValueError, ArithmeticError):
            return False
        return ready.run.air is None and self.request.window is None and "tension_peaks" not in self.request.outputs

    def _groups(self, ready: list[int], check: Callable[[], None]) -> list[dict[int, PreparedRun | ImplicitStepper]]:
        """Prepare the next run of each member `ready`; returns those of each group that advance together."""
        shapes: dict[Any, dict[int, PreparedRun | ImplicitStepper]] = {}
        memory = MAX_KEPT_BYTES
        for i in ready:
            check()
            run, steps_per_second = cast(Any, self._searches[i].run), cast(float, self._searches[i].wanted)
            try:
                prepared = run.begin(steps_per_second)
            except (ValueError, ArithmeticError):
                continue
            if prepared.saved_bytes <= memory:
                memory -= prepared.saved_bytes
                judged = None if run.judged is None else run.judged.tobytes()
                shapes.setdefault((run.scheme, run.shape, steps_per_second, judged), {})[i] = prepared
        groups = []
        for alike in shapes.values():
            members, prepared_runs = list(alike), list(alike.values())
            for places in cast(Any, prepared_runs[0].run).groups(prepared_runs):
                groups.append({members[place]: prepared_runs[place] for place in places})
        return groups

    def _together(self, group: Mapping[int, PreparedRun | ImplicitStepper], check: Callable[[], None]) -> list[int]:
        """Advance runs of equal shape together, and their searches by the results; returns the members that need another run."""
        first: Any = next(iter(group.values()))
        stepper = first.run.together(list(group.values()))
        self._advance(stepper, check)
        unfinished = []
        for place, i in enumerate(group):
            # runs that are no longer finite, or are broken, are repeated alone, to find the failing step
            if not stepper.is_finite[place]:
                continue
            search = self._searches[i]
            try:
                trajectory = cast(Any, search.run).finish(stepper, place)
            except RunStopped:
                continue
            try:
                search.take(trajectory)
                if search.wanted is not None:
                    unfinished.append(i)
                    continue
                self._solved[i] = solution_of(search)
            except (ValueError, ArithmeticError):
                pass  # which the member's own run reports
            del self._searches[i]
        return unfinished

    def _advance(self, stepper: ExplicitStepper | ImplicitLanes, check: Callable[[], None]) -> None:
        """Take all steps, block by block."""
        block = MAX_BLOCK_STEPS
        while block > MIN_BLOCK_STEPS and block * stepper.work > BLOCK_WORK:
            block //= 2
        for start in range(0, stepper.total, block):
            check()
            stepper.is_finite &= stepper.advance(start, min(block, stepper.total - start))

    def run_member(self, i: int) -> tuple[Variables, Mapping[str, Any]]:
        """Return the variables and attributes of a member."""
        if (solved := self._solved.pop(i, None)) is None:
            if (search := self._searches.pop(i, None)) is None:
                return self._to_variables(solve(prepare(self.members[i], self.request, self.title), self.request))
            complete(search)
            solved = solution_of(search)
        return self._to_variables(with_space_error(solved, self.request))

    def _to_variables(self, solution: Solution) -> tuple[Variables, Mapping[str, Any]]:
        """Return variables and attributes in the order of the first member's Dataset."""
        run, state = solution.run, solution.trajectory
        if not self.first:
            self.first[:] = [solution.dataset()]
        variables, coords = run.arrays(state)
        arrays = variables | coords
        ordered = {str(name): self._array(str(name), arrays[str(name)]) for name in self.first[0].variables}
        return ordered, provenance.in_order(run.attributes(state) | solution.attributes)

    def _array(self, name: str, variable: Any) -> tuple[tuple[str, ...], Any]:
        """Return dimensions and values; an xarray.Variable would cost as much as a thousand steps of a chain."""
        if isinstance(variable, tuple):
            dims, values = variable
            return (dims,) if isinstance(dims, str) else dims, values
        return (name,), variable
