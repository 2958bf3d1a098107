"""Time `import cablepod` beside `import xarray`.

    python pipelines/benchmarks/import_time.py [--repeats 11] [--readme]

Fresh processes in turns, after two warm-ups that write the byte code; medians.
"""

from __future__ import annotations

import subprocess
import sys
from functools import partial
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from _study import command_line, in_turns, markdown_table, medians, show_table

HERE = Path(__file__).resolve().parent
CODE = "import time; begin = time.perf_counter(); import {}; print(time.perf_counter() - begin)"


def seconds(module: str) -> float:
    """Return the time of one import in a fresh process [s]."""
    return float(
        subprocess.run([sys.executable, "-c", CODE.format(module)], check=True, capture_output=True, text=True).stdout
    )


def main() -> None:
    """Print both times and their difference."""
    options = command_line(__doc__, repeats=11, readme=True).parse_args()
    jobs = [partial(seconds, "xarray"), partial(seconds, "cablepod")]
    in_turns(jobs, 2)
    base, ours = in_turns(jobs, options.repeats)
    values = medians((a, b, b - a) for a, b in zip(base, ours, strict=True))
    head = ["import xarray", "import cablepod", f"difference (medians of {options.repeats})"]
    table = markdown_table(head, [[f"{value:.3f} s" for value in values]])
    show_table("import_time", table, HERE if options.readme else None)


if __name__ == "__main__":
    main()
