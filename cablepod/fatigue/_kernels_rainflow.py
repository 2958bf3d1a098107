"""Compiled rainflow counting by ASTM E1049-85, section 5.4.4."""

from __future__ import annotations

import numpy as np

from cablepod._jit import compiled


@compiled
def cycles(series, stack, values, start, end, half):
    """Count the cycles of a series.

    Reversals are the samples at which the series turns (of a plateau the last one), and both ends.  With X the newest range of
    three stored reversals and Y the one before it, Y counts once X is at least as large: as half a cycle if it contains the first
    stored reversal, which is dropped, else as a whole cycle, whose two reversals are dropped.  The ranges that remain at the end
    count as half cycles.

    Parameters
    ----------
    series : float array (n,)
        The series.
    stack, values : int and float arrays (n,)
        Workspace: places and values of the stored reversals.
    start, end : int arrays (n,)
        Filled with the places where each cycle begins and ends.
    half : bool array (n,)
        Filled: whether it is half a cycle.

    Returns
    -------
    int
        Number of cycles, half cycles included.
    """
    n = series.size
    if n < 2:
        return 0
    bottom, top, count = 0, 1, 0
    stack[0], values[0] = 0, series[0]
    x = series[1]
    rising = x > series[0]
    is_flat = x == series[0]
    for i in range(2, n + 1):
        if i < n:
            new = series[i]
            rises = new > x
            if is_flat or rises == rising or new == x:
                if new != x:
                    x, rising, is_flat = new, rises, False
                continue
        elif n > 2:
            x = series[n - 1]
        # a reversal at i - 1
        stack[top], values[top] = i - 1, x
        top += 1
        while top - bottom >= 3:
            before = abs(values[top - 2] - values[top - 3])
            if abs(x - values[top - 2]) < before:
                break
            start[count], end[count] = stack[top - 3], stack[top - 2]
            half[count] = top - bottom == 3
            if half[count]:
                bottom += 1
            else:
                stack[top - 3], values[top - 3] = stack[top - 1], x
                top -= 2
            count += 1
        if i < n:
            x, rising = new, rises
    while top - bottom > 1:
        start[count], end[count], half[count] = stack[bottom], stack[bottom + 1], True
        bottom, count = bottom + 1, count + 1
    return count


@compiled
def all_cycles(series, start, end, half, counts):
    """Count the cycles of many series (rows, n); `start`, `end` and `half` (rows, n) and `counts` (rows,) are filled."""
    stack, values = np.empty(series.shape[1], np.int32), np.empty(series.shape[1])
    for row in range(series.shape[0]):
        counts[row] = cycles(series[row], stack, values, start[row], end[row], half[row])


@compiled
def tables(series, places, start, end, half, counts, extent, mean, number, begin, finish):
    """Fill the tables (rows, cycles) of range, mean, count, begin and end of the cycles; nan and the count 0 beyond the last."""
    for row in range(series.shape[0]):
        for k in range(extent.shape[1]):
            if k < counts[row]:
                i, j = start[row, k], end[row, k]
                extent[row, k] = abs(series[row, i] - series[row, j])
                mean[row, k] = 0.5 * (series[row, i] + series[row, j])
                number[row, k] = 0.5 if half[row, k] else 1.0
                begin[row, k], finish[row, k] = places[i], places[j]
            else:
                extent[row, k], mean[row, k], number[row, k] = np.nan, np.nan, 0.0
                begin[row, k], finish[row, k] = np.nan, np.nan


@compiled
def damage_sums(series, scales, exponent, sums):
    """Fill `sums` (rows,) with the sums of count (range / scale)^exponent over the cycles of each series; scales (rows,)."""
    n = series.shape[1]
    stack, start, end = np.empty(n, np.int32), np.empty(n, np.int32), np.empty(n, np.int32)
    values, half = np.empty(n), np.empty(n, np.bool_)
    for row in range(series.shape[0]):
        total, inverse = 0.0, 1.0 / scales[row]
        for k in range(cycles(series[row], stack, values, start, end, half)):
            damage = (abs(series[row, start[k]] - series[row, end[k]]) * inverse) ** exponent
            total += 0.5 * damage if half[k] else damage
        sums[row] = total
