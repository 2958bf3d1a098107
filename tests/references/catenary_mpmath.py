"""The elastic catenary to 50 digits, by another route than the kernel's.

Unknowns are the force across the load H and the force against it at the lower end V0, in the textbook's closed form

    x(S) = H S/K + (H/q) [asinh(V/H) - asinh(V0/H)],   y(S) = (S/K) (V0 + q S/2) + (1/q) [T(S) - T0],   V = V0 + q S

evaluated as it stands: its cancellation (up to 25 digits for a nearly weightless cable) is paid for with digits.  For a
given length (H, V0) minimises a strictly convex function, the complementary energy, whose gradient is the misfit of the
upper end; damped Newton steps therefore find the one solution from any start.  For a given tension or force an outer
search moves the length, from the short side, and keeps to the branch where the quantity falls with the length.
"""

from __future__ import annotations

from dataclasses import dataclass

import mpmath as mp

DIGITS = 50
WORKING_DIGITS = 110  # the digits wanted, those lost to cancellation, and the residual's own
MP = mp.mp.clone()  # so that no other user of mpmath is affected by the precision
MP.dps = WORKING_DIGITS
SMALL = MP.mpf(10) ** (-DIGITS - 6)


class NoCable(ValueError):
    """No cable has the quantity asked for."""


@dataclass
class Cable:
    """A solved cable; all numbers are mpf."""

    a: mp.mpf
    b: mp.mpf
    q: mp.mpf
    stiffness: mp.mpf
    length: mp.mpf
    force: mp.mpf
    lower: mp.mpf  # V0, the force against the load at the lower end

    def vertical(self, s):
        return self.lower + self.q * s

    def tension(self, s):
        return MP.sqrt(self.force**2 + self.vertical(s) ** 2)

    def position(self, s):
        h, k, q, v, v0 = self.force, self.stiffness, self.q, self.vertical(s), self.lower
        if q == 0:
            part = s / self.length
            return self.a * part, self.b * part  # a straight spring, uniformly stretched
        x = h * s / k + h / q * (MP.asinh(v / h) - MP.asinh(v0 / h)) if h > 0 else MP.mpf(0)
        return x, s / k * (v0 + q * s / 2) + (self.tension(s) - self.tension(0)) / q

    def stretched(self):
        """Return L0 + (1/K) times the integral of T dS."""
        h, k, q, length = self.force, self.stiffness, self.q, self.length
        if q == 0:
            return length * (1 + self.tension(0) / k)

        def primitive(v):
            return (v * MP.sqrt(h * h + v * v) + (h * h * MP.asinh(v / h) if h > 0 else 0)) / 2

        return length + (primitive(self.vertical(length)) - primitive(self.lower)) / (q * k)

    def solution(self):
        """Return the kernel's columns."""
        middle = self.vertical(self.length / 2)
        return [self.length, self.stretched(), self.force, middle, self.tension(0), self.tension(self.length)]

    def residual(self):
        """Misfit of the upper end relative to the chord."""
        x, y = self.position(self.length)
        return MP.hypot(x - self.a, y - self.b) / MP.hypot(self.a, self.b)


def _misfit(a, b, q, k, length, h, v0):
    """Return the misfit of the upper end, its symmetric derivative by (H, V0), and its derivative by the length."""
    v1 = v0 + q * length
    t0, t1 = MP.sqrt(h * h + v0 * v0), MP.sqrt(h * h + v1 * v1)
    turn = (MP.asinh(v1 / h) - MP.asinh(v0 / h)) / q
    x = h * length / k + h * turn
    y = length / k * (v0 + q * length / 2) + (t1 - t0) / q
    rise = (v1 / t1 - v0 / t0) / q
    xx, xy, yy = length / k + turn - rise, h / q * (1 / t1 - 1 / t0), length / k + rise
    by_length = 1 / k + 1 / t1
    return x - a, y - b, xx, xy, yy, h * by_length, v1 * by_length, t0, t1


def _forces(a, b, q, k, length, start=None):
    """Return (H, V0) of a cable of given length with a > 0 and q > 0."""
    c = MP.hypot(a, b)
    if start is None:
        t = max(k * (c - length) / length, q * length / 2)
        start = a / c * t, b / c * t - q * length / 2
    h, v0 = start
    for _ in range(400):
        f, g, xx, xy, yy, *_ = _misfit(a, b, q, k, length, h, v0)
        det = xx * yy - xy * xy
        dh, dv = -(yy * f - xy * g) / det, -(xx * g - xy * f) / det
        fall = f * dh + g * dv
        step = MP.mpf(1)
        while h + step * dh <= h / 20:
            step /= 2
        for _ in range(60):
            fn, gn, *_ = _misfit(a, b, q, k, length, h + step * dh, v0 + step * dv)
            if fn * dh + gn * dv <= -MP.mpf("0.9") * fall or MP.hypot(fn, gn) < SMALL * c:
                break
            step /= 2
        h, v0 = h + step * dh, v0 + step * dv
        if step == 1 and abs(dh) <= SMALL * h and abs(dv) <= SMALL * (abs(v0) + q * length):
            return h, v0
    msg = f"reference did not converge: {a=} {b=} {q=} {k=} {length=}"
    raise ArithmeticError(msg)


def _vertical_lower(b, q, k, length):
    """Return V0 where the span is zero: y(V0) is piecewise linear and rising, so one of three pieces holds it."""
    w = q * length
    up = (b - length) * k / length - w / 2  # 0 <= V0
    if up >= 0:
        return up
    down = (b + length) * k / length - w / 2  # V0 <= -q L0
    if down <= -w:
        return down
    return (b - w * length / (2 * k) - length) / (length / k + 2 / q)  # folded: y = L0/K (V0 + w/2) + (2 V0 + w)/q


def from_length(a, b, q, stiffness, length, start=None):
    """Return the cable of given unstretched length."""
    a, b, q, k, length = (MP.mpf(v) for v in (a, b, q, stiffness, length))
    c = MP.hypot(a, b)
    if q == 0:
        if length > c:
            raise NoCable
        t = k * (c - length) / length
        return Cable(a, b, q, k, length, a / c * t, b / c * t)
    if a == 0:
        return Cable(a, b, q, k, length, MP.mpf(0), _vertical_lower(b, q, k, length))
    return Cable(a, b, q, k, length, *_forces(a, b, q, k, length, start))


def _quantity(cable, which):
    """Return T1, T0 or H (`which` 0, 1, 2) and its derivative by the length."""
    a, b, q, k, length, h, v0 = (
        cable.a, cable.b, cable.q, cable.stiffness, cable.length, cable.force, cable.lower,
    )  # fmt: skip
    _, _, xx, xy, yy, xl, yl, t0, t1 = _misfit(a, b, q, k, length, h, v0)
    det = xx * yy - xy * xy
    dh, dv = -(yy * xl - xy * yl) / det, -(xx * yl - xy * xl) / det
    if which == 2:
        return h, dh
    if which == 1:
        return t0, (h * dh + v0 * dv) / t0
    return t1, (h * dh + (v0 + q * length) * (dv + q)) / t1


def _short_start(a, b, q, k, which, value):
    """Return a length short enough that the quantity exceeds the value, and its cable."""
    c = MP.hypot(a, b)
    strain = MP.mpf(value) / k
    while True:
        cable = from_length(a, b, q, k, c / (1 + strain))
        f, slope = _quantity(cable, which)
        if f >= value and slope < 0:
            return cable
        strain *= 2


def from_quantity(a, b, q, stiffness, which, value):
    """Return the shortest cable of given T1, T0 or H (`which` 0, 1, 2).

    Raises
    ------
    NoCable
        If the quantity is below the least one.
    """
    a, b, q, k, value = (MP.mpf(v) for v in (a, b, q, stiffness, value))
    c = MP.hypot(a, b)
    if q == 0:
        t = value * c / a if which == 2 else value
        return from_length(a, b, q, k, c / (1 + t / k))
    if a == 0:
        return _vertical_from_tension(b, q, k, which, value)
    cable = _short_start(a, b, q, k, which, value)
    low, high = cable.length, None
    f, slope = _quantity(cable, which)
    careful = False
    for _ in range(2000):
        # From the short side the quantity is convex in the length, so Newton's steps do not overshoot.  Those on its
        # logarithm are longer and may: then a plain one follows, and where that overshoots too, a bisection.
        new = low + (value - f) / slope
        longer = low + MP.log(value / f) * f / slope if value > 0 else new
        if not careful and (high is None or longer < high):
            new = longer
        if high is not None and new >= high:
            new = (low + high) / 2
        trial = from_length(a, b, q, k, new, (cable.force, cable.lower))
        ft, st = _quantity(trial, which)
        if st < 0 and abs(ft - value) <= SMALL * value:
            return trial
        careful = not (st < 0 and ft > value)
        if careful:
            high = new  # past the value, or past the least one
        else:
            cable, low, f, slope = trial, new, ft, st
        if high is not None and high - low <= MP.mpf(10) ** -90 * low:
            raise NoCable
    msg = f"reference did not converge: {a=} {b=} {q=} {k=} {which=} {value=}"
    raise ArithmeticError(msg)


def _vertical_from_tension(b, q, k, which, value):
    """Return the straight vertical cable of given end tension: b = L0 (1 + (T1 - q L0/2)/K) with T1 at the top."""
    if which == 2:
        raise NoCable
    at_top = (which == 0) == (b > 0)
    sign = 1 if at_top else -1
    # sign q L0^2 / (2 K) - (1 + T/K) L0 + |b| = 0, the shorter root
    p, r = 1 + value / k, sign * q * abs(b) / (2 * k)
    disc = p * p - 4 * r
    if disc < 0:
        raise NoCable
    cable = from_length(0, b, q, k, 2 * abs(b) / (p + MP.sqrt(disc)))
    if cable.lower < 0 < cable.vertical(cable.length):
        raise NoCable
    return cable


def least(a, b, q, stiffness, which):
    """Return the cable of least T1 or T0 (`which` 0, 1) and that tension: where its derivative by the length is zero.

    It is the first minimum met from the short side.
    """
    a, b, q, k = (MP.mpf(v) for v in (a, b, q, stiffness))
    c = MP.hypot(a, b)
    low = _short_start(a, b, q, k, which, q * c / 2).length
    high = low
    while True:
        high = high * MP.mpf("1.05")
        if _quantity(from_length(a, b, q, k, high), which)[1] > 0:
            break
        low = high
    while high - low > MP.mpf(10) ** -40 * low:  # the tension is right to the square of that
        # near the vertical the slope is a step, on which a secant search would stall
        length = (low + high) / 2
        if _quantity(from_length(a, b, q, k, length), which)[1] > 0:
            high = length
        else:
            low = length
    cable = from_length(a, b, q, k, low)
    return cable, _quantity(cable, which)[0]


def sag(cable):
    """Largest distance below the chord, at the place where the cable has its slope: sought by bisection."""
    low, high = MP.mpf(0), cable.length
    for _ in range(220):
        middle = (low + high) / 2
        before = cable.force * cable.b / cable.a > cable.vertical(middle)
        low, high = (middle, high) if before else (low, middle)
    x, y = cable.position(low)
    return x * cable.b / cable.a - y
