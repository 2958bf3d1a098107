"""Time the first default call of each model with nothing compiled, and count what numba compiles for it.

    python pipelines/benchmarks/first_calls.py [--repeats 3] [--readme]

A fresh process with an empty numba cache for each call; scene and modes are read from files, so that only the call compiles.  CPU
time of the call, one thread, median.  `prepare` contains a first ``.step``, batches are 32 members.  "Kernels" are compiled
functions of the package, "all" also those of numba that they need.
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from _study import command_line, markdown_table, show_table

import cablepod as cp
from cablepod.examples import scene as shipped

HERE = Path(__file__).resolve().parent
#: Name of a call -> the rank of the modes and the call, of a scene, modes of layout "normal" and "separate", and a mast.
CALLS = {
    "chain": "cp.chain.simulate(scene)",
    "cable, trapezoidal": 'cp.cable.simulate(scene, scheme="trapezoidal", step=0.02, elements=8)',
    "rigid": "cp.rigid.simulate(slack)",
    "galerkin, r = 2": "cp.galerkin.simulate(scene, separate, rank=2)",
    "condensed, r = 2": "cp.condensed.simulate(scene, normal, rank=2)",
    "condensed, r = 4": "cp.condensed.simulate(scene, normal, rank=4)",
    "condensed, r = 8 after r = 4": "cp.condensed.simulate(scene, normal, rank=8)",
    "condensed, exact, r = 4": 'cp.condensed.simulate(scene, normal, rank=4, order="exact")',
    "condensed, 32 members, r = 4": "cp.condensed.simulate(members, normal, rank=4)",
    "prepare and step, r = 4": "host()",
    "periodic.orbit, r = 2": "cp.periodic.orbit(scene, normal, rank=2)",
    "mast": "cp.mast.simulate(mast)",
}
#: What comes before the call that is timed, of some of them.
BEFORE = {"condensed, r = 8 after r = 4": "cp.condensed.simulate(scene, normal, rank=4)"}
#: Run in a process of its own; prints the CPU time [s] and what was compiled, by module and name, in this order.
CODE = """
import json, sys, time
import numba.core.event as events
import cablepod as cp
from cablepod.examples import scene as shipped

class Count(events.Listener):
    names = []
    def on_start(self, event):
        function = event.data["dispatcher"].py_func
        self.names.append(f"{function.__module__}.{function.__qualname__}")
    def on_end(self, event):
        pass

events.register("numba:compile", Count())
folder, before, call = sys.argv[1:]
scene, mast, slack = (shipped(name) for name in ("example3", "mast30", "pendulum"))
separate, normal = (cp.archive.read(f"{folder}/{layout}.nc") for layout in ("separate", "normal"))
members = cp.archive.read(f"{folder}/members.nc")

def host():
    model = cp.condensed.prepare(scene, normal, rank=4)
    return model.step(model.end_position + [0.001, 0.0], [0.1, 0.0], 0.01)

eval(before)
Count.names.clear()
begin = time.process_time()
eval(call)
seconds = time.process_time() - begin
print(json.dumps([seconds, Count.names]))
"""


def first_call(name: str, inputs: Path) -> tuple[float, list[str]]:
    """Return CPU time [s] of a call in a process with an empty cache, and the functions that it compiles."""
    with tempfile.TemporaryDirectory() as cache:
        single = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
        done = subprocess.run(
            [sys.executable, "-c", CODE, str(inputs), BEFORE.get(name, "None"), CALLS[name]],
            check=True, stdout=subprocess.PIPE, text=True, env={**os.environ, **single, "NUMBA_CACHE_DIR": cache},
        )  # fmt: skip
    seconds, compiled = json.loads(done.stdout.splitlines()[-1])
    return seconds, compiled


def write_inputs(folder: Path) -> None:
    """Write the modes of Example 3 and 32 scenes of other tensions."""
    scene = shipped("example3")
    chain = cp.chain.simulate(scene)
    for layout in ("separate", "normal"):
        cp.archive.write(cp.pod.decompose(chain, rank=8, layout=layout), folder / f"{layout}.nc")
    ranges = {"cable.top_tension": [12000.0, 18000.0]}
    cp.archive.write(cp.ensemble.design(scene, ranges, members=32), folder / "members.nc")


def main() -> None:
    """Print the table of first calls."""
    options = command_line(__doc__, repeats=3, readme=True).parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as name:
        write_inputs(Path(name))
        for call in CALLS:
            found = [first_call(call, Path(name)) for _ in range(options.repeats)]
            seconds = statistics.median(seconds for seconds, _ in found)
            compiled = found[0][1]
            kernels = [name for name in compiled if name.startswith("cablepod")]
            rows.append([call, f"{seconds:.1f} s", str(len(kernels)), str(len(compiled))])
    table = markdown_table(["first call", "CPU time", "kernels", "all"], rows)
    show_table("first_calls", table, HERE if options.readme else None)


if __name__ == "__main__":
    main()
