"""First default calls compile each kernel for few kinds of arguments, and none of numba's functions for texts."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest
from benchmarks import first_calls

pytestmark = pytest.mark.slow  # some twenty seconds of compilation a call, on purpose with an empty cache
#: Kernels that a call has two kinds of, which is cheaper than one kind for all.
SEVERAL = {
    "_forces", "_chord_tensions", "_geometric_forces",  # the number of coordinates is a constant of the steps of a run alone
    "planar_frames_of_lanes",  # the number of lanes likewise
    "assign",  # between rows of one array and arrays of their own
}  # fmt: skip


@pytest.fixture(scope="module")
def inputs(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("inputs")
    first_calls.write_inputs(folder)
    return folder


@pytest.mark.parametrize("call", first_calls.CALLS)
def test_no_kernel_of_a_default_call_is_compiled_twice(inputs, call):
    """A literal number, or an array of another layout, would be a kind of its own."""
    _, compiled = first_calls.first_call(call, inputs)
    kernels = Counter(name for name in compiled if name.startswith("cablepod."))
    assert kernels
    again = {name for name, count in kernels.items() if count > 1}
    assert {name.rpartition(".")[2] for name in again} <= SEVERAL
    assert max(kernels.values()) <= 2
    # array expressions and products of matrices bring the text of an error with them, which takes seconds to compile
    assert not [name for name in compiled if "unicode" in name or "charseq" in name]
