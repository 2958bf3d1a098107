"""Compiled shape of the elastic catenary."""

from __future__ import annotations

import math

from cablepod._jit import compiled


@compiled
def shape(s, solution, q, stiffness, across, along, tension):
    """Fill positions across and against the load [m], and tensions [N], at unstretched arc lengths `s` from the lower end.

    `solution` (6,) is the output of :func:`cablepod.catenary._kernels_solve.solve`.
    """
    length, force, mid = solution[0], solution[2], solution[3]
    v0 = mid - 0.5 * q * length
    t0 = solution[4]
    for i in range(s.size):
        v = v0 + q * s[i]
        t = math.hypot(force, v)
        total = t + t0
        tension[i] = t
        if total == 0.0:
            across[i] = 0.0
            along[i] = 0.0
            continue
        along[i] = s[i] * ((v0 + 0.5 * q * s[i]) / stiffness + (v + v0) / total)
        if force == 0.0:
            across[i] = 0.0
            continue
        turn = math.asinh(v / force) - math.asinh(v0 / force)
        if turn > 0.5:
            across[i] = force * (s[i] / stiffness + turn / q)
        else:
            # difference of two asinh as one atanh, without cancellation
            z = q * s[i] / total
            ratio = math.atanh(z) / z if z > 1e-8 else 1.0 + z * z / 3.0
            across[i] = force * s[i] * (1.0 / stiffness + 2.0 * ratio / total)
