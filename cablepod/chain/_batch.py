"""Chains of many scenes: set up number by number, stepped by compiled loops over those of equal shape.

Each member is what a run of its scene alone is, bit for bit: the same setup, the same loop, the same checks of what came out.
What is left out is what makes a Dataset of each.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, cast

import xarray as xr

from cablepod import provenance
from cablepod.batch._members import BatchPlan
from cablepod.batch._stack import Variables
from cablepod.chain._explicit import ExplicitChainRun, ExplicitStepper, PreparedRun
from cablepod.chain._scheme import ChainRequest, ChainResult, PreparedScene, prepare, solve
from cablepod.errors import SceneError
from cablepod.integrate import _march as march
from cablepod.integrate._run import Trajectory
from cablepod.parameters._from_scene import Members

#: Steps in a block, at most and at least: multiples of those after which the tables of sines begin anew, so that they are those
#: of a single run.
MAX_BLOCK_STEPS, MIN_BLOCK_STEPS = march.BLOCK, 1024
#: Links times steps of all members in a block, at most: some tenths of a second, in which nobody can stop them.
BLOCK_WORK = 2e8
#: Bytes that a chunk keeps of its steps before they are results, at most; members beyond go the way of single scenes.
MAX_KEPT_BYTES = 2**27


def plan(scene: xr.Dataset, **given: Any) -> BatchPlan | None:
    """Tell how to run many members; None where what is asked for cannot be, which single runs say for each of them."""
    try:
        members, request = Members(scene), ChainRequest.of(**given)
    except SceneError:
        return None
    batch = ChainBatch(members, request, str(scene.attrs.get("title", "scene")))
    return BatchPlan(batch.one, lambda: batch.first[0], batch.ahead)


class ChainBatch:
    """Members and what is asked for."""

    def __init__(self, members: Members, request: ChainRequest, title: str) -> None:
        self.members, self.request, self.title = members, request, title
        self.first: list[xr.Dataset] = []
        self._names: dict[str, tuple[tuple[str, ...], Any]] = {}  # coordinates that are the same in all
        self._ready: dict[int, PreparedScene] = {}
        self._marched: dict[int, tuple[ExplicitStepper, int]] = {}

    def ahead(self, first: int, last: int, check: Callable[[], None]) -> None:
        """Step the members `first` ... `last - 1` abreast, those that are explicit and whose step is given."""
        shapes: dict[Any, list[int]] = {}
        begun: dict[int, PreparedRun] = {}
        room = MAX_KEPT_BYTES
        for i in range(first, last):
            check()
            item = self._begin(i)
            if item is not None and item.kept <= room:
                room -= item.kept
                begun[i] = item
                shapes.setdefault(item.run.shape, []).append(i)
        for group in shapes.values():
            march = ExplicitStepper([begun[i] for i in group])
            self._step(march, check)
            # runs that left the finite numbers are made once more, alone, to say when
            self._marched |= {i: (march, place) for place, i in enumerate(group) if march.is_finite[place]}

    def _begin(self, i: int) -> PreparedRun | None:
        """Make a member ready; None where it cannot go abreast, or not at all, which is said when its turn comes."""
        try:
            ready = self._ready[i] = prepare(self.members[i], self.request, self.title)
            return (
                ready.run.begin(ready.steps_per_second)
                if isinstance(ready.run, ExplicitChainRun) and ready.steps_per_second is not None
                else None
            )
        except (ValueError, ArithmeticError):
            return None

    def _step(self, march: ExplicitStepper, check: Callable[[], None]) -> None:
        """Take all steps, block by block."""
        block = MAX_BLOCK_STEPS
        while block > MIN_BLOCK_STEPS and block * march.saved[:, 0, 0].size > BLOCK_WORK:
            block //= 2
        for start in range(0, march.total, block):
            check()
            march.is_finite &= march.advance(start, min(block, march.total - start))

    def one(self, i: int) -> tuple[Variables, Mapping[str, Any]]:
        """Return variables and attributes of a member."""
        ready = self._ready.pop(i, None) or prepare(self.members[i], self.request, self.title)
        state: Trajectory | None = None
        if i in self._marched:
            state = ready.explicit.finish(*self._marched.pop(i))
        return self._parts(solve(ready, self.request, state))

    def _parts(self, solution: ChainResult) -> tuple[Variables, Mapping[str, Any]]:
        run, state = solution.run, solution.state
        if not self.first:
            self.first[:] = [solution.dataset()]
        variables, coords = run.arrays(state)
        made = variables | coords
        ordered = {str(name): self._array(str(name), made[str(name)]) for name in self.first[0].variables}
        return ordered, provenance.in_order(run.attributes(state) | solution.diagnostics)

    def _array(self, name: str, item: Any) -> tuple[tuple[str, ...], Any]:
        """Read what a Dataset is made of; to make a variable of it takes as long as a thousand steps of a chain."""
        if isinstance(item, xr.Variable):
            if name not in self._names:
                self._names[name] = cast(tuple[str, ...], item.dims), item.values
            return self._names[name]
        if isinstance(item, tuple):
            dims, values = item
            return (dims,) if isinstance(dims, str) else dims, values
        return (name,), item
