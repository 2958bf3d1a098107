"""Compiled solution of many elastic catenaries, with the functions of ``_formulas.py``."""

from numba.extending import register_jitable

from cablepod._jit import compiled
from cablepod.catenary._formulas import FORMULAS, solve

for formula in FORMULAS:
    register_jitable(error_model="numpy")(formula)


@compiled
def solve_many(a, b, c, q, stiffness, kind, value, out, status):
    """Solve one catenary for each element of the arrays; see :func:`solve`, `out` (members, 6), `status` (members,)."""
    for i in range(a.size):
        status[i] = solve(a[i], b[i], c[i], q[i], stiffness[i], kind, value[i], out[i])
