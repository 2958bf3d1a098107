"""Measure time and error of the solution of the catenary and of a general root search.

    python pipelines/benchmarks/catenary.py [--members 10000] [--repeats 7] [--readme]

One thread.  Each row is one set of random cables of a kind (seed fixed).  ``array`` is the time of `solve_many` over all
members divided by their number; ``call`` that of one call of `solve`, plain Python, over 1000 calls; ``root`` that of
`scipy.optimize.root` (hybr, tolerance 1e-13) on the two (length or force given) or three equations of the closed form of
textbooks, started from a straight or parabolic cable of the same length, over 100 members.  All are medians of the repeats in
microseconds of processor time, after a warm-up that includes compilation.  Errors are maxima over the same 30 members, relative
(lengths to themselves, forces to the maximum tension), against the tests' 50-digit reference; ``limit`` is the effect of one
rounding of the given value on the exact answer.  Members where `root` stops without success, or at another cable than the
shortest, count as failed and not in its error.  Needs the extra ``test``.
"""

from __future__ import annotations

import math
import statistics
import sys
import time
import warnings
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from _study import command_line, markdown_table, show_table
from scipy.optimize import root

from cablepod.catenary import _formulas as formulas
from cablepod.catenary._kernels_solve import solve_many

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))
from references import catenary_mpmath as reference

HERE = Path(__file__).resolve().parent
KINDS = {
    "length": formulas.LENGTH,
    "upper": formulas.UPPER_TENSION,
    "lower": formulas.LOWER_TENSION,
    "force": formulas.HORIZONTAL_FORCE,
}
COLUMN = {"length": 0, "upper": 5, "lower": 4, "force": 2}
WHICH = {"upper": 0, "lower": 1, "force": 2}
#: span, rise, load, stiffness, and the shortest and longest length in chords.
SETS = {
    "taut": (20.40, 57.70, 9.8125, 2e7, 0.998, 0.9999),
    "slack": (20.40, 57.70, 9.8125, 2e7, 1.001, 1.05),
    "horizontal": (60.0, 0.0, 9.8125, 2e7, 0.999, 1.05),
    "near-vertical": (1e-6, 57.70, 9.8125, 2e7, 0.998, 0.9999),
    "near-vert. slack": (1e-6, 57.70, 9.8125, 2e7, 1.01, 2.0),
    "stiff": (20.40, 57.70, 9.8125, 1e13, 0.9999999, 1.05),
    "soft": (20.40, 57.70, 9.8125, 1e3, 0.05, 0.9),
}


def members(name, count):
    """Draw arrays a, b, c, q, K and the lengths of one set."""
    a, b, q, k, low, high = SETS[name]
    random = np.random.default_rng(7)
    a = a * (1 + 0.01 * random.random(count))
    b = np.full(count, b)
    c = np.hypot(a, b)
    return a, b, c, np.full(count, q), np.full(count, k), c * random.uniform(low, high, count)


def warm_time(function, repeats):
    """Return the median processor time of a call [s], after one for warming up."""
    function()
    spent = []
    for _ in range(repeats):
        begin = time.process_time()
        function()
        spent.append(time.process_time() - begin)
    return statistics.median(spent)


def textbook(unknowns, a, b, q, k, kind, value):
    """Return the residuals of the closed form of textbooks over the chord.

    The unknowns are log H, V0 / H and perhaps the length.
    """
    c = math.hypot(a, b)
    h = value if kind == "force" else math.exp(unknowns[0])
    v0 = unknowns[1] * h
    length = value if kind == "length" else unknowns[0 if kind == "force" else 2] * c
    v1 = v0 + q * length
    x = h * length / k + h / q * (math.asinh(v1 / h) - math.asinh(v0 / h))
    y = length / k * (v0 + q * length / 2) + (math.hypot(h, v1) - math.hypot(h, v0)) / q
    misfit = [(x - a) / c, (y - b) / c]
    if kind in ("upper", "lower"):
        misfit.append(math.hypot(h, v1 if kind == "upper" else v0) / value - 1)
    return misfit


def competitor(a, b, q, k, kind, value, length):
    """Return the six columns by a general root search, None if it fails."""
    c = math.hypot(a, b)
    parabola = q * a / 2 * math.sqrt(a / (6 * abs(length - c) + 1e-3 * c))
    h = max(parabola, k * (c - length) / length * a / c)
    v0 = (b / a) * h - q * length / 2
    start = {"length": [math.log(h), v0 / h], "force": [length / c, v0 / value]}.get(
        kind, [math.log(h), v0 / h, length / c]
    )
    try:
        found = root(textbook, start, args=(a, b, q, k, kind, value), tol=1e-13)
        misfit = max(abs(m) for m in textbook(found.x, a, b, q, k, kind, value))
    except (OverflowError, ValueError, ZeroDivisionError):
        return None
    if misfit > 1e-9:
        return None
    h = value if kind == "force" else math.exp(found.x[0])
    v0 = found.x[1] * h
    length = value if kind == "length" else found.x[0 if kind == "force" else 2] * c
    v1 = v0 + q * length
    t0, t1 = math.hypot(h, v0), math.hypot(h, v1)
    turn = math.asinh(v1 / h) - math.asinh(v0 / h)
    stretched = length + (v1 * t1 - v0 * t0 + h * h * turn) / (2 * q * k)
    return [length, stretched, h, v0 + q * length / 2, t0, t1]


def truth(a, b, q, k, kind, value):
    """Return the cable of the reference."""
    if kind == "length":
        return reference.from_length(a, b, q, k, value)
    return reference.from_quantity(a, b, q, k, WHICH[kind], value)


def distance(row, exact):
    """Return the maximum relative difference of a solution from the exact one."""
    most = max(exact[4:])
    return max(float(abs(r - e) / (e if j < 2 else most)) for j, (r, e) in enumerate(zip(row, exact, strict=True)))


def measure(name, kind, count, repeats):
    """Return one row of the table."""
    a, b, c, q, k, length = members(name, count)
    out, status = np.empty((count, 6)), np.empty(count, dtype=np.int64)
    solve_many(a, b, c, q, k, formulas.LENGTH, length, out, status)
    value = out[:, COLUMN[kind]].copy()
    number = KINDS[kind]
    array = warm_time(lambda: solve_many(a, b, c, q, k, number, value, out, status), repeats) / count
    refused = int((status != formulas.FOUND).sum())

    rows = list(
        zip(a.tolist(), b.tolist(), c.tolist(), q.tolist(), k.tolist(), value.tolist(), length.tolist(), strict=True)
    )
    one = np.empty(6)

    def calls():
        for aa, bb, cc, qq, kk, vv, _ in rows[:1000]:
            formulas.solve(aa, bb, cc, qq, kk, number, vv, one)

    single = warm_time(calls, repeats) / min(count, 1000)

    def roots():
        return [competitor(aa, bb, qq, kk, kind, vv, ll) for aa, bb, _, qq, kk, vv, ll in rows[:100]]

    other = warm_time(roots, repeats) / min(count, 100)

    worst, limit, worst_root, failed = 0.0, 0.0, 0.0, 0
    for i, found in enumerate(roots()[:30]):
        aa, bb, _, qq, kk, vv, _ = rows[i]
        exact = truth(aa, bb, qq, kk, kind, vv).solution()
        worst = max(worst, distance(out[i], exact))
        limit = max(
            limit, distance(truth(aa, bb, qq, kk, kind, vv * (1 + reference.MP.mpf(2) ** -53)).solution(), exact)
        )
        error = math.inf if found is None else distance(found, exact)
        if error < 1e-3:
            worst_root = max(worst_root, error)
        else:
            failed += 1
    times = [f"{array * 1e6:.2f}", f"{single * 1e6:.2f}", f"{other * 1e6:.0f}"]
    errors = [f"{worst:.1e}", f"{limit:.1e}", f"{worst_root:.1e}" if failed < 30 else ""]
    return [name, kind, *times, *errors, f"{failed}/30", str(refused)]


def main():
    """Print the table."""
    parser = command_line(__doc__, repeats=7, readme=True)
    parser.add_argument("--members", type=int, default=10_000, help="number of cables in a set")
    options = parser.parse_args()
    warnings.simplefilter("ignore")  # the general search leaves the range of its equations
    lines = [measure(name, kind, options.members, options.repeats) for name in SETS for kind in KINDS]
    head = ["set", "given", "array [µs]", "call [µs]", "root [µs]"]
    head += ["error, solve", "limit", "error, root", "root failed", "refused"]
    show_table("catenary", markdown_table(head, lines), HERE if options.readme else None)


if __name__ == "__main__":
    main()
