"""Chains of many members: runs of equal shape advance together in one compiled call.

Each member has the preparation and the checks of the run of its scene alone; only its Dataset is left out.  Explicit members
have the same loop, and the same bits.  Implicit ones lie in lanes, whose sums over links are added up in another order.
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
from cablepod.chain._scheme import SCHEMES, ChainRequest, PreparedScene, prepare, solve
from cablepod.errors import SceneError
from cablepod.integrate._march import BLOCK
from cablepod.integrate._run import Trajectory
from cablepod.integrate._scheme import Solution
from cablepod.parameters._from_scene import Members

#: Maximum and minimum number of steps per block (multiples of the period after which tables of sines restart, so that the tables
#: equal those of a single run).
MAX_BLOCK_STEPS, MIN_BLOCK_STEPS = BLOCK, 1024
#: Maximum link steps of all members per block (a few tenths of a second, the latency of cancellation).
BLOCK_WORK = 2e8
#: Maximum memory of the saved steps of a chunk [bytes]; members beyond it run one by one.
MAX_KEPT_BYTES = 2**27


def plan(scene: xr.Dataset, **options: Any) -> BatchPlan | None:
    """Return the plan of a batched run; None for invalid options, which single runs report for each member."""
    try:
        members, request = Members(scene), ChainRequest.of(**options)
    except SceneError:
        return None
    batch = ChainBatch(members, request, str(scene.attrs.get("title", "scene")))
    in_lanes = request.step is not None and request.scheme not in (None, SCHEMES[0])
    return BatchPlan(batch.run_member, lambda: batch.first[0], batch.prepare_chunk, LANES if in_lanes else 1)


class ChainBatch:
    """Runs of the members of a scene with common options."""

    def __init__(self, members: Members, request: ChainRequest, title: str) -> None:
        self.members, self.request, self.title = members, request, title
        self.first: list[xr.Dataset] = []  #: result of the first member, the template of all others
        self._shared: dict[str, tuple[tuple[str, ...], Any]] = {}  # coordinates that are equal in all members
        self._ready: dict[int, PreparedScene] = {}
        self._advanced: dict[int, tuple[Any, int]] = {}

    def prepare_chunk(self, first: int, last: int, check: Callable[[], None]) -> None:
        """Advance the members `first` ... `last - 1` together, as far as they have a given step.

        `check` is called regularly and raises :class:`cablepod.errors.StoppedError` on cancellation.
        """
        shapes: dict[Any, list[int]] = {}
        prepared: dict[int, PreparedRun | ImplicitStepper] = {}
        memory = MAX_KEPT_BYTES
        for i in range(first, last):
            check()
            member = self._prepare(i)
            if member is not None and member.saved_bytes <= memory:
                memory -= member.saved_bytes
                prepared[i] = member
                shapes.setdefault(member.run.shape, []).append(i)
        for alike in shapes.values():
            run: Any = prepared[alike[0]].run
            for places in run.groups([prepared[i] for i in alike]):
                group = [alike[place] for place in places]
                stepper = run.together([prepared[i] for i in group])
                self._advance(stepper, check)
                # runs that are no longer finite are repeated alone, to find the failing step
                self._advanced |= {i: (stepper, place) for place, i in enumerate(group) if stepper.is_finite[place]}

    def _prepare(self, i: int) -> PreparedRun | ImplicitStepper | None:
        """Prepare a member; None if it has no given step, or fails, which its own run reports."""
        try:
            ready = self._ready[i] = prepare(self.members[i], self.request, self.title)
            alone = (
                ready.run.air is not None or self.request.window is not None or "tension_peaks" in self.request.outputs
            )
            return (
                None if alone or ready.steps_per_second is None else cast(Any, ready.run).begin(ready.steps_per_second)
            )
        except (ValueError, ArithmeticError):
            return None

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
        ready = self._ready.pop(i, None) or prepare(self.members[i], self.request, self.title)
        state: Trajectory | None = None
        if i in self._advanced:
            state = cast(Any, ready.run).finish(*self._advanced.pop(i))
        return self._to_variables(solve(ready, self.request, state))

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
        if isinstance(variable, xr.Variable):
            if name not in self._shared:
                self._shared[name] = cast(tuple[str, ...], variable.dims), variable.values
            return self._shared[name]
        if isinstance(variable, tuple):
            dims, values = variable
            return (dims,) if isinstance(dims, str) else dims, values
        return (name,), variable
