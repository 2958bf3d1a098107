"""How much longer `import cablepod` takes than `import xarray`.

    python pipelines/benchmarks/import_time.py [--repeats 11]

Fresh processes, taken in turn, after two warm-ups that write the byte code; medians.
"""

from __future__ import annotations

import argparse
import statistics
import subprocess
import sys

CODE = "import time; begin = time.perf_counter(); import {}; print(time.perf_counter() - begin)"


def seconds(module: str) -> float:
    """Time of one import in a fresh process [s]."""
    return float(
        subprocess.run([sys.executable, "-c", CODE.format(module)], check=True, capture_output=True, text=True).stdout
    )


def main() -> None:
    """Print both times and their difference."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=11)
    repeats = parser.parse_args().repeats
    for _ in range(2):
        seconds("xarray"), seconds("cablepod")
    pairs = [(seconds("xarray"), seconds("cablepod")) for _ in range(repeats)]
    print(f"import xarray   {statistics.median(a for a, _ in pairs):.3f} s")
    print(f"import cablepod {statistics.median(b for _, b in pairs):.3f} s")
    print(f"difference      {statistics.median(b - a for a, b in pairs):.3f} s (median of {repeats})")


if __name__ == "__main__":
    main()
