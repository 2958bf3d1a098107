"""Compiled rainflow counting by ASTM E1049-85, section 5.4.4."""

import numpy as np

from cablepod._jit import compiled

#: Samples among which reversals are looked for at a time.
BLOCK = 1024


@compiled
def cycles(series, stack, values, pairs, inverse_scale, exponent):
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
    pairs : int array (n, 2)
        Filled with the places where each cycle begins and ends, of half a cycle the latter as its complement -1 - place; None to
        sum the damage.
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
    if pairs is not None:
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
            if pairs is not None:
                stack[top] = places[k]
            top += 1
            while top - bottom >= 3:
                extent = abs(values[top - 2] - values[top - 3])
                if abs(x - values[top - 2]) < extent:
                    break
                is_half = top - bottom == 3
                if pairs is not None:
                    pairs[count, 0] = stack[top - 3]
                    pairs[count, 1] = ~stack[top - 2] if is_half else stack[top - 2]
                if exponent is not None:
                    part = (extent * inverse_scale) ** exponent
                    damage += 0.5 * part if is_half else part
                count += 1
                if is_half:
                    bottom += 1
                else:
                    values[top - 3] = x
                    if pairs is not None:
                        stack[top - 3] = places[k]
                    top -= 2
    while top - bottom > 1:
        if pairs is not None:
            pairs[count, 0], pairs[count, 1] = stack[bottom], ~stack[bottom + 1]
        if exponent is not None:
            damage += 0.5 * (abs(values[bottom] - values[bottom + 1]) * inverse_scale) ** exponent
        bottom, count = bottom + 1, count + 1
    return count, damage


@compiled
def all_cycles(series, pairs, counts):
    """Count the cycles of many series (rows, n); `pairs` (rows, n, 2) and `counts` (rows,) are filled."""
    stack, values = np.empty(series.shape[1], np.int32), np.empty(series.shape[1])
    for row in range(series.shape[0]):
        counts[row], _ = cycles(series[row], stack, values, pairs[row], None, None)


@compiled
def tables(series, places, pairs, counts, filled):
    """Fill range, mean, count, begin and end of the cycles (5, rows, cycles); nan and the count 0 beyond the last."""
    for row in range(series.shape[0]):
        for k in range(counts[row]):
            i, j = pairs[row, k, 0], pairs[row, k, 1]
            is_half = j < 0
            j = ~j if is_half else j
            filled[0, row, k] = abs(series[row, i] - series[row, j])
            filled[1, row, k] = 0.5 * (series[row, i] + series[row, j])
            filled[2, row, k] = 0.5 if is_half else 1.0
            filled[3, row, k], filled[4, row, k] = places[i], places[j]
        for k in range(counts[row], filled.shape[2]):
            filled[0, row, k], filled[1, row, k], filled[2, row, k] = np.nan, np.nan, 0.0
            filled[3, row, k], filled[4, row, k] = np.nan, np.nan


@compiled
def damage_sums(series, scales, exponent, sums):
    """Fill `sums` (rows,) with the sums of count (range / scale)^exponent over the cycles of each series; scales (rows,)."""
    values = np.empty(series.shape[1])
    for row in range(series.shape[0]):
        _, sums[row] = cycles(series[row], None, values, None, 1.0 / scales[row], exponent)
