"""Solution of the exact elastic catenary: one root search in one unknown for each given quantity.

Of one cable in plain Python, which takes some ten microseconds; compiled for many in ``_kernels_solve.py``.

In the plane of chord and load, with span a >= 0 across the load, rise b against it, load q >= 0 per unstretched length
and axial stiffness K, let w = q L0/2, V the mean of the end forces against the load and T the mean of the end tensions.
The closed form of the linear law, without cancelling differences, is

    z = tanh(eta) = w / T,  e = T / K,  l = L0 (1 + e),  A = eta coth(eta),  G = (e + A) / (1 + e)
    V = T b / l,            H = a T / (l G),             l^2 = c^2 + a^2 sigma,   sigma = cosh(eta)^2 / G^2 - 1

with the chord c; the end tensions are T +- V z.  eta = 0 is a straight spring, eta -> infinity a cable folded on itself.
A given end tension T1 fixes T by a quadratic, (T1 - T)(K + T) = q b K / 2, a horizontal force H gives
eta + e tanh(eta) = q a / (2 H).
"""

import math

UPPER_TENSION, LOWER_TENSION, HORIZONTAL_FORCE, LENGTH = range(4)
FOUND, BELOW_LEAST_TENSION, SLACK_WEIGHTLESS, VERTICAL_WITH_FORCE, NOT_FOUND = range(5)
#: Columns of a solution.
COLUMNS = ("unstretched_length", "stretched_length", "horizontal_force", "mid_force", "tension_lower", "tension_upper")
# Relative tolerance of the last Newton step (its square bounds the error, and further steps are rounding noise).
NEWTON_RTOL = 1e-11
# Taylor coefficients of eta coth(eta) - 1 in eta^2, highest first: 2^(2n) B_2n / (2n)! (the next term is 1e-16 at 0.5).
SERIES = (
    -174611 / 330 * 2**20 / math.factorial(20),
    43867 / 798 * 2**18 / math.factorial(18),
    -3617 / 510 * 2**16 / math.factorial(16),
    4 / 18243225,
    -1382 / 638512875,
    2 / 93555,
    -1 / 4725,
    2 / 945,
    -1 / 45,
    1 / 3,
)


def sag_excess(eta):
    """Return A - 1 and dA/deta for A = eta coth(eta); by the Taylor series if the closed form cancels."""
    if eta < 0.5:
        s = eta * eta
        p = dp = 0.0
        for k in range(len(SERIES)):
            dp = dp * s + p
            p = p * s + SERIES[k]
        return s * p, 2.0 * eta * (p + s * dp)
    th = math.tanh(eta)
    sh = math.sinh(eta) if eta < 350.0 else math.inf
    return (eta - th) / th, 1.0 / th - eta / (sh * sh)


def _sigma(eta, e, de):
    """Return sigma and dsigma/deta for the mean strain `e` and its derivative `de` with respect to eta."""
    excess, slope = sag_excess(eta)
    g1 = excess / (1.0 + e)
    g = 1.0 + g1
    dg = (slope - g1 * de) / (1.0 + e)
    sh = math.sinh(eta) if eta < 350.0 else math.inf
    ch = math.sqrt(1.0 + sh * sh)
    return (sh * sh - g1 * (1.0 + g)) / (g * g), 2.0 * ch * (sh - ch * dg / g) / (g * g)


def _from_length(a, c, q, stiffness, length):
    """Solve for eta from the unstretched length (a > 0, q > 0): bracketed Newton's method in log(eta); also return success."""
    w = 0.5 * q * length
    # Initial guess: root of the leading terms of a taut cable, at the crossover, or of a slack cable.
    cross = (6.0 * c * length * w / (stiffness * a * a)) ** (1.0 / 3.0)
    if length < c:
        eta = min(w * length / (stiffness * (c - length)), cross)
    else:
        eta = max(math.asinh(math.sqrt(6.0 * c * (length - c)) / a), min(cross, 300.0))
    low, high = 0.0, math.inf
    for _ in range(200):
        th = math.tanh(eta)
        e = w / th / stiffness
        sh = math.sinh(eta) if eta < 350.0 else math.inf
        de = -w / (stiffness * sh * sh)
        sigma, dsigma = _sigma(eta, e, de)
        stretch = length * e - (c - length)
        f = stretch * (2.0 * c + stretch) - a * a * sigma
        if f > 0.0:
            low = eta
        elif f < 0.0:
            high = eta
        else:
            return eta, True
        sag = a * a * sigma
        slope = 2.0 * (c + stretch) * length * de - a * a * dsigma
        new = math.nan  # compares false: no Newton step
        if eta < 1.0:
            new = eta * math.exp(max(min(-f / (slope * eta), 3.0), -3.0)) if slope < 0.0 else math.nan
        elif stretch > 0.0 and sag < math.inf:
            # sigma grows like exp(2 eta): Newton's method for the logarithms, as steps are at most 1/2 otherwise
            left = stretch * (2.0 * c + stretch)
            new = eta - math.log(left / sag) / (2.0 * (c + stretch) * length * de / left - a * a * dsigma / sag)
        if abs(new - eta) <= NEWTON_RTOL * eta:
            return new, True
        if not (low < new < high):
            # the Newton step leaves the bracket: bisection in log(eta)
            if low == 0.0:
                new = 1e-3 * high
            elif high == math.inf:
                new = 2.0 * low
            else:
                new = math.sqrt(low) * math.sqrt(high)
        if new in (low, high):
            return new, True
        eta = new
    return eta, high - low <= 1e-14 * high


def _from_mean_tension(a, c, q, e, mean, excess):
    """Solve for the smallest eta of a mean end tension; nan if the tension is below the minimum.

    The function h(t) = t - k^2 (c^2 + a^2 sigma(t)), t = tanh(eta)^2, is concave.  Newton's method from the left therefore
    increases monotonically to the smaller root.  Near the vertical t is close to 1 and the force across the load depends on
    u = 1 - t, which is updated separately.  `excess` is T (1 + e) - q c / 2, computed without cancellation.
    """
    k = q / (2.0 * mean * (1.0 + e))
    floor = (k * c) ** 2
    u_floor = excess / (mean * (1.0 + e)) * (1.0 + k * c)
    t, u = floor, u_floor
    for _ in range(500):
        if u <= 0.0:
            return math.nan
        z = math.sqrt(t)
        eta = math.atanh(z) if t < 0.5 else math.log((1.0 + z) / math.sqrt(u))
        if eta == 0.0:
            return eta
        sigma, dsigma = _sigma(eta, e, 0.0)
        residual = (t - floor if t < 0.5 else u_floor - u) - (k * a) ** 2 * sigma
        slope = 1.0 - (k * a) ** 2 * dsigma / (2.0 * z * u)
        if slope <= 0.0:
            return eta if residual >= -1e-15 * t else math.nan
        step = -residual / slope
        if step <= 2e-16 * min(t, u):
            return eta
        t += step
        u -= step
    return math.nan


def _mean_tension(sign, b, q, stiffness, tension):
    """Compute the mean of the end tensions from that at the upper (`sign` 1) or lower (-1) end; nan without solution."""
    reduced = tension - sign * 0.5 * q * b
    disc = (stiffness - tension) ** 2 + 4.0 * stiffness * reduced
    if disc < 0.0:
        return math.nan
    root = math.sqrt(disc)
    # two forms of the same root, each without cancellation
    if stiffness > tension:
        return 2.0 * stiffness * reduced / (stiffness - tension + root)
    return 0.5 * (tension - stiffness + root)


def _from_force(a, b, q, stiffness, force):
    """Solve for eta and the mean strain from the force across the load: bracketed Newton's method; also return success."""
    beta = 0.5 * q * a / force
    low = force * math.hypot(1.0, b / a) / stiffness
    high = math.inf
    e = low
    eta = beta / (1.0 + e)
    for _ in range(200):
        # inner root: eta + e tanh(eta) = beta, monotone and concave, from below
        for _ in range(100):
            th = math.tanh(eta)
            step = (beta - eta - e * th) / (1.0 + e * (1.0 - th * th))
            eta += step
            if abs(step) <= NEWTON_RTOL * eta:
                break
        th = math.tanh(eta)
        deta = -th / (1.0 + e * (1.0 - th * th))
        left = e * stiffness / force
        if eta > 300.0:
            # beyond the range of cosh: the mean tension over the force is exp(eta) / 2
            low = e
            new = e - (math.log(2.0 * left) - eta) / (1.0 / e - deta)
        else:
            excess, slope = sag_excess(eta)
            g1 = excess / (1.0 + e)
            dg = (slope * deta - g1) / (1.0 + e)
            ch = math.cosh(eta)
            mean = math.hypot(ch, (b / a) * (1.0 + g1))
            dmean = ch * (math.sinh(eta) / mean) * deta + (b / a) * (1.0 + g1) * ((b / a) * (dg / mean))
            if left < mean:
                low = e
            else:
                high = e
            if eta < 1.0:
                new = e - (left - mean) / (stiffness / force - dmean)
            else:
                # Newton's method for the logarithms, as steps from the slack side are short otherwise
                new = e - math.log(left / mean) / (1.0 / e - dmean / mean)
        if abs(new - e) <= NEWTON_RTOL * e:
            return eta + deta * (new - e), new, eta < 300.0
        if not (low <= new <= high):
            new = 0.5 * (low + high) if high < math.inf else 2.0 * low
        # eta decreases with the strain and is convex in it: both guesses are lower bounds of the next inner root
        eta = max(eta + deta * (new - e), beta / (1.0 + new))
        e = new
    return eta, e, eta < 300.0 and high - low <= 1e-14 * high


def _end_tensions(eta, mean, force, mid, w):
    """Compute the tensions at the lower and the upper end.

    Near the vertical |V| - w cancels if the smaller tension is small.  It also equals (T^2 / cosh(eta)^2 - H^2 cosh(eta)^2) /
    (|V| + w), which cancels if the forces against the load are small compared with the force across it.
    """
    total = abs(mid) + w
    rest = abs(mid) - w
    if eta < 300.0:
        ch = math.cosh(eta)
        near, far = mean / ch, force * ch
        if max(near, far) ** 2 < 0.5 * w * total:
            rest = (near - far) * ((near + far) / total)
    small, large = math.hypot(force, rest), math.hypot(force, total)
    return (small, large) if mid > 0.0 else (large, small)


def _vertical(b, q, stiffness, length, out):
    """Fill `out` for a cable of given length along the load: straight, or folded at its lowest point."""
    w = 0.5 * q * length
    if length * (1.0 + w / stiffness) >= abs(b):
        mean = w
        mid = b / (length * (1.0 / stiffness + 1.0 / w)) if w > 0.0 else 0.0
    else:
        mean = stiffness * ((abs(b) - length) / length)
        mid = math.copysign(mean, b)
    low, high = abs(mid - w), abs(mid + w)
    strain = 0.5 * mean / stiffness * (1.0 + (mid / mean) ** 2) if mean > 0.0 else 0.0
    out[0], out[1], out[2], out[3], out[4], out[5] = length, length * (1.0 + strain), 0.0, mid, low, high


def _by_length(a, c, q, stiffness, length):
    """Return status, eta, mean tension, unstretched length and mean stretched length, from the unstretched length."""
    eta = mean = 0.0
    if not length > 0.0:
        return NOT_FOUND, eta, mean, length, length
    if q * length < 1e-290 * stiffness:
        q = 0.0
    if q == 0.0 and length > c:
        return SLACK_WEIGHTLESS, eta, mean, length, length
    if q == 0.0:
        mean = stiffness * ((c - length) / length)
    elif a > 0.0:
        eta, good = _from_length(a, c, q, stiffness, length)
        if not good:
            return NOT_FOUND, eta, mean, length, length
        mean = 0.5 * q * length / math.tanh(eta)
    return FOUND, eta, mean, length, length * (1.0 + mean / stiffness)


def _by_force(a, b, q, stiffness, force):
    """Return the same as `_by_length`, from the force across the load."""
    if not force > 0.0:
        return NOT_FOUND, 0.0, 0.0, 0.0, 0.0
    eta, e, good = _from_force(a, b, q, stiffness, force)
    if not good:
        return NOT_FOUND, eta, 0.0, 0.0, 0.0
    mean = e * stiffness
    excess, _ = sag_excess(eta)
    stretched_mean = a * (mean / force) / (1.0 + excess / (1.0 + e))
    return FOUND, eta, mean, stretched_mean / (1.0 + e), stretched_mean


def _by_tension(sign, a, b, c, q, stiffness, tension):
    """Return the same as `_by_length`, from the tension at the upper (`sign` 1) or lower (-1) end."""
    mean = _mean_tension(sign, b, q, stiffness, tension)
    if not mean > 0.0:
        return BELOW_LEAST_TENSION, 0.0, 0.0, 0.0, 0.0
    e = mean / stiffness
    # T (1 + e) - q c / 2 from the given tension, with chord plus rise computed without cancellation
    rise = sign * b
    gap = c + rise if rise > 0.0 else a * (a / (c - rise))
    excess = tension * (1.0 + e) - 0.5 * q * gap
    if a == 0.0:
        return (FOUND if excess >= 0.0 else BELOW_LEAST_TENSION), math.inf, mean, c / (1.0 + e), c
    eta = _from_mean_tension(a, c, q, e, mean, excess)
    if math.isnan(eta):
        return BELOW_LEAST_TENSION, eta, 0.0, 0.0, 0.0
    sigma, _ = _sigma(eta, e, 0.0)
    stretched_mean = math.sqrt(c * c + a * a * sigma)
    return FOUND, eta, mean, stretched_mean / (1.0 + e), stretched_mean


def _status(out):
    """Return FOUND if all numbers of a solution are finite, else NOT_FOUND."""
    for number in out:
        if not math.isfinite(number):
            return NOT_FOUND
    return FOUND


def solve(a, b, c, q, stiffness, kind, value, out):
    """Solve one elastic catenary.

    Parameters
    ----------
    a, b, c : float
        Span across the load (>= 0), rise against it, chord [m].
    q, stiffness : float
        Load per unstretched length [N/m], axial stiffness [N].
    kind, value : int, float
        Given quantity, one of the constants above, and its value [N or m].
    out : float array (6,)
        Filled with unstretched and stretched length [m], force across the load, force against the load at the middle of
        the unstretched length, tension at the lower and at the upper end [N].

    Returns
    -------
    int
        FOUND, or the reason for failure; `out` is then nan.
    """
    for column in range(6):
        out[column] = math.nan
    if not (0.0 <= a < math.inf and 0.0 < c < math.inf and abs(b) < math.inf and UPPER_TENSION <= kind <= LENGTH):
        return NOT_FOUND
    if not (0.0 <= q < math.inf and 0.0 < stiffness < math.inf and abs(value) < math.inf):
        return NOT_FOUND
    if a < 1e-100 * c:  # the square of the span would underflow
        a = 0.0
    if a == 0.0 and kind == HORIZONTAL_FORCE:
        return VERTICAL_WITH_FORCE
    if kind == LENGTH:
        status, eta, mean, length, stretched_mean = _by_length(a, c, q, stiffness, value)
    elif kind == HORIZONTAL_FORCE:
        status, eta, mean, length, stretched_mean = _by_force(a, b, q, stiffness, value)
    else:
        sign = 1.0 if kind == UPPER_TENSION else -1.0
        status, eta, mean, length, stretched_mean = _by_tension(sign, a, b, c, q, stiffness, value)
    if status != FOUND:
        return status
    if a == 0.0:
        if kind == LENGTH:
            _vertical(b, q, stiffness, length, out)
        else:
            # the shortest cable is straight; the given tension stays exact even if the opposite one is much larger
            opposite = 2.0 * mean - value
            out[0], out[1], out[2], out[3] = length, c, 0.0, math.copysign(mean, b)
            out[4], out[5] = (opposite, value) if kind == UPPER_TENSION else (value, opposite)
        return _status(out)
    e = mean / stiffness
    excess, _ = sag_excess(eta)
    w = 0.5 * q * length
    mid = mean * (b / stretched_mean)
    force = a * mean / (stretched_mean * (1.0 + excess / (1.0 + e)))
    strain = 0.0
    if mean > 0.0:
        strain = 0.5 * e * (1.0 + (mid / mean) ** 2 + (force / mean) ** 2 * (1.0 + excess))
    out[0], out[1], out[2], out[3] = length, length * (1.0 + strain), force, mid
    out[4], out[5] = _end_tensions(eta, mean, force, mid, w)
    return _status(out)


#: All functions of this file, in the order in which they call one another.
FORMULAS = (
    sag_excess, _sigma, _from_length, _from_mean_tension, _mean_tension, _from_force, _end_tensions, _vertical, _by_length,
    _by_force, _by_tension, _status, solve,
)  # fmt: skip
