"""Compiled rainflow counting by ASTM E1049-85, section 5.4.4."""

from __future__ import annotations

import numpy as np

from cablepod._jit import compiled

#: Samples among which reversals are looked for at a time.
BLOCK = 1024


@compiled
def cycles(series, stack, values, start, end, half, inverse_scale, exponent):
    """Count the cycles of a series, or sum their damage.

    Reversals are the samples at which the series turns (of a plateau the last one), and both ends.  With X the newest range of
    three stored reversals and Y the one before it, Y counts once X is at least as large: as half a cycle if it contains the first
    stored reversal, which is dropped, else as a whole cycle, whose two reversals are dropped.  The ranges that remain at the end
    count as half cycles.

    Reversals of a block of samples are found first, by arithmetic on the signs of the changes: a branch at each sample, which
    turns at every other one at random, would take twice as long as all the rest.

    Parameters
    ----------
    series : float array (n,)
        The series.
    stack, values : int and float arrays (n,)
        Workspace: places and values of the stored reversals; the places are None to sum the damage.
    start, end : int arrays (n,)
        Filled with the places where each cycle begins and ends; None to sum the damage.
    half : bool array (n,)
        Filled: whether it is half a cycle; None to sum the damage.
    inverse_scale, exponent : float, number
        Factor of the ranges, and exponent of the damage; None to count.

    Returns
    -------
    int, float
        Number of cycles, half cycles included; sum of count (range inverse_scale)^exponent.
    """
    n = series.size
    if n < 2:
        return 0, 0.0
    places = np.empty(BLOCK + 1, np.int32)
    bottom, top, count, damage = 0, 1, 0, 0.0
    values[0] = series[0]
    if start is not None:
        stack[0] = 0
    before, direction, i = series[0], 0, 1
    while i <= n:
        last, turns = min(i + BLOCK, n), 0
        while i < last:
            new = series[i]
            change = int(new > before) - int(new < before)
            places[turns] = i - 1  # counts if the series turns there
            turns += int(change * direction < 0)
            direction = change if change != 0 else direction
            before = new
            i += 1
        if i == n:
            places[turns] = n - 1
            turns += 1
            i += 1
        for k in range(turns):
            x = series[places[k]]
            values[top] = x
            if start is not None:
                stack[top] = places[k]
            top += 1
            while top - bottom >= 3:
                extent = abs(values[top - 2] - values[top - 3])
                if abs(x - values[top - 2]) < extent:
                    break
                is_half = top - bottom == 3
                if start is not None:
                    start[count], end[count], half[count] = stack[top - 3], stack[top - 2], is_half
                if exponent is not None:
                    part = (extent * inverse_scale) ** exponent
                    damage += 0.5 * part if is_half else part
                count += 1
                if is_half:
                    bottom += 1
                else:
                    values[top - 3] = x
                    if start is not None:
                        stack[top - 3] = places[k]
                    top -= 2
    while top - bottom > 1:
        if start is not None:
            start[count], end[count], half[count] = stack[bottom], stack[bottom + 1], True
        if exponent is not None:
            damage += 0.5 * (abs(values[bottom] - values[bottom + 1]) * inverse_scale) ** exponent
        bottom, count = bottom + 1, count + 1
    return count, damage


@compiled
def all_cycles(series, start, end, half, counts):
    """Count the cycles of many series (rows, n); `start`, `end` and `half` (rows, n) and `counts` (rows,) are filled."""
    stack, values = np.empty(series.shape[1], np.int32), np.empty(series.shape[1])
    for row in range(series.shape[0]):
        counts[row], _ = cycles(series[row], stack, values, start[row], end[row], half[row], None, None)


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
    values = np.empty(series.shape[1])
    for row in range(series.shape[0]):
        _, sums[row] = cycles(series[row], None, values, None, None, None, 1.0 / scales[row], exponent)
