"""Compiled block-tridiagonal solvers for planar and spatial chains."""

from __future__ import annotations

from cablepod._jit import FUSED, compiled

# --- block tridiagonal systems ----------------------------------------------------------------------------------------


@compiled(fastmath=FUSED, forceinline=True)
def eliminate(a, b, c, s, rx, ry):
    """Eliminate a particle with the block D = [[a, b], [b, c]], the link S to the next one and the right side r.

    Returns D^-1 S (four numbers), D^-1 r, and the changes of the next particle's block and right side, S D^-1 S (three numbers)
    and S D^-1 r.  The products do not depend on the division by the determinant, the slowest operation, which runs in parallel.
    """
    scale = 1.0 / (a * c - b * b)
    sxx, sxy, syy = s
    # the adjugate of D times S, and S times that
    mxx, mxy = c * sxx - b * sxy, c * sxy - b * syy
    myx, myy = a * sxy - b * sxx, a * syy - b * sxy
    update = (sxx * mxx + sxy * myx) * scale, (sxx * mxy + sxy * myy) * scale, (sxy * mxy + syy * myy) * scale
    tx, ty = (c * rx - b * ry) * scale, (a * ry - b * rx) * scale
    return (
        (mxx * scale, mxy * scale, myx * scale, myy * scale),
        (tx, ty),
        update,
        (sxx * tx + sxy * ty, sxy * tx + syy * ty),
    )


@compiled(fastmath=FUSED, forceinline=True)
def particle2(diagonal, own, p, below, above, update):
    """Return the block of a particle, xx, xy, yy, after an update by elimination."""
    xx = diagonal[p] + below[0] + above[0] - update[0]
    xy = below[1] + above[1] - update[1]
    yy = diagonal[p] + below[2] + above[2] - update[2]
    if own is not None:  # an if that the compiler can prune
        xx, xy, yy = xx + own[0, p], xy + own[1, p], yy + own[2, p]
    return xx, xy, yy


@compiled(fastmath=FUSED)
def solve_planar(diagonal, own, s, b, workspace, first, last):
    """Solve the block tridiagonal system of a planar chain.

    The row of the free particle p is (diagonal_p + S_below + S_above) d_p - S_below d_(p-1) - S_above d_(p+1) = b_p; the
    particles before `first` and from `last` on are held.

    Parameters
    ----------
    diagonal : float array (n + 1,)
        Inertia over the square of the step, added to the diagonal of each block [N/m].
    own : float array (3, n + 1) or None
        xx, xy, yy of what is added to the block of each particle beside [N/m].
    s : tuple of 3 float arrays (n + 2,)
        xx, xy, yy of the tangent stiffness of the links [N/m].
    b : tuple of 2 float arrays (n + 1,)
        Right side [N]; overwritten by the solution [m] from `first` to `last` - 1.
    workspace : tuple of 4 float arrays (n + 1,)
        Workspace.
    first, last : int
        The free particles.
    """
    sxx, sxy, syy = s
    bx, by = b
    mxx, mxy, myx, myy = workspace
    half = (last - first) // 2
    up, u = (0.0, 0.0, 0.0), (0.0, 0.0)
    down, w = up, u
    for i in range(half):
        # from the lower end
        p = first + i
        above = (sxx[p + 1], sxy[p + 1], syy[p + 1])
        xx, xy, yy = particle2(diagonal, own, p, (sxx[p], sxy[p], syy[p]), above, up)
        matrix, t, up, u = eliminate(xx, xy, yy, above, bx[p] + u[0], by[p] + u[1])
        mxx[p], mxy[p], myx[p], myy[p] = matrix
        bx[p], by[p] = t
        # from the upper end
        p = last - 1 - i
        if p > first + half:
            below = (sxx[p], sxy[p], syy[p])
            xx, xy, yy = particle2(diagonal, own, p, below, (sxx[p + 1], sxy[p + 1], syy[p + 1]), down)
            matrix, t, down, w = eliminate(xx, xy, yy, below, bx[p] + w[0], by[p] + w[1])
            mxx[p], mxy[p], myx[p], myy[p] = matrix
            bx[p], by[p] = t
    p = first + half
    xx, xy, yy = particle2(diagonal, own, p, (sxx[p], sxy[p], syy[p]), (sxx[p + 1], sxy[p + 1], syy[p + 1]), up)
    _, t, _, _ = eliminate(
        xx - down[0], xy - down[1], yy - down[2], (0.0, 0.0, 0.0), bx[p] + u[0] + w[0], by[p] + u[1] + w[1],
    )  # fmt: skip
    tx, ty = t
    bx[p], by[p] = tx, ty
    qx, qy = tx, ty
    for i in range(half):
        p = first + half - 1 - i
        tx, ty = mxx[p] * tx + mxy[p] * ty + bx[p], myx[p] * tx + myy[p] * ty + by[p]
        bx[p], by[p] = tx, ty
        p = first + half + 1 + i
        if p < last:
            qx, qy = mxx[p] * qx + mxy[p] * qy + bx[p], myx[p] * qx + myy[p] * qy + by[p]
            bx[p], by[p] = qx, qy


@compiled(fastmath=FUSED, forceinline=True)
def inverse3(a, b, c, d, e, f):
    """Return the inverse of the symmetric matrix [[a, b, c], [b, d, e], [c, e, f]] as six numbers in the same order."""
    p, q, r = d * f - e * e, c * e - b * f, b * e - c * d
    scale = 1.0 / (a * p + b * q + c * r)
    return p * scale, q * scale, r * scale, (a * f - c * c) * scale, (b * c - a * e) * scale, (a * d - b * b) * scale


@compiled(fastmath=FUSED, forceinline=True)
def times3(s, x, y, z):
    """Return the product of a symmetric matrix (six numbers) and a vector."""
    return s[0] * x + s[1] * y + s[2] * z, s[1] * x + s[3] * y + s[4] * z, s[2] * x + s[4] * y + s[5] * z


@compiled(fastmath=FUSED, forceinline=True)
def sandwich3(s, i):
    """Return the product S I S of symmetric matrices as six numbers."""
    a = times3(i, s[0], s[1], s[2])
    b = times3(i, s[1], s[3], s[4])
    c = times3(i, s[2], s[4], s[5])
    xx, xy, xz = times3(s, a[0], a[1], a[2])
    _, yy, yz = times3(s, b[0], b[1], b[2])
    _, _, zz = times3(s, c[0], c[1], c[2])
    return xx, xy, xz, yy, yz, zz


@compiled
def _at3(s, p):
    """Return the six numbers of column p."""
    return s[0][p], s[1][p], s[2][p], s[3][p], s[4][p], s[5][p]


@compiled(fastmath=FUSED, forceinline=True)
def block3(diagonal, below, above, update, second_update):
    """Return the inverse of a particle's block after the updates by elimination."""
    return inverse3(
        diagonal + below[0] + above[0] - update[0] - second_update[0],
        below[1] + above[1] - update[1] - second_update[1],
        below[2] + above[2] - update[2] - second_update[2],
        diagonal + below[3] + above[3] - update[3] - second_update[3],
        below[4] + above[4] - update[4] - second_update[4],
        diagonal + below[5] + above[5] - update[5] - second_update[5],
    )


@compiled(fastmath=FUSED, forceinline=True)
def _and_own3(own, p, below):
    """Return the sum of the link below a particle and what is added to its own block."""
    if own is None:  # an if that the compiler can prune
        return below
    return (
        below[0] + own[0, p], below[1] + own[1, p], below[2] + own[2, p], below[3] + own[3, p], below[4] + own[4, p],
        below[5] + own[5, p],
    )  # fmt: skip


@compiled(fastmath=FUSED)
def solve_spatial(diagonal, own, s, b, inverses, first, last):
    """Solve the system of a spatial chain; `s` and the workspace `inverses` are tuples of 6 arrays, `b` is one of 3.

    The six arrays of a symmetric matrix are xx, xy, xz, yy, yz, zz; else as in :func:`solve_planar`.
    """
    bx, by, bz = b
    half = (last - first) // 2
    none = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    up, down = none, none
    u, w = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    for i in range(half):
        p = first + i
        above = _at3(s, p + 1)
        inverse = block3(diagonal[p], _and_own3(own, p, _at3(s, p)), above, up, none)
        inverses[0][p], inverses[1][p], inverses[2][p], inverses[3][p], inverses[4][p], inverses[5][p] = inverse
        bx[p] += u[0]
        by[p] += u[1]
        bz[p] += u[2]
        t = times3(inverse, bx[p], by[p], bz[p])
        u = times3(above, t[0], t[1], t[2])
        up = sandwich3(above, inverse)
        p = last - 1 - i
        if p > first + half:
            below = _at3(s, p)
            inverse = block3(diagonal[p], _and_own3(own, p, below), _at3(s, p + 1), down, none)
            inverses[0][p], inverses[1][p], inverses[2][p], inverses[3][p], inverses[4][p], inverses[5][p] = inverse
            bx[p] += w[0]
            by[p] += w[1]
            bz[p] += w[2]
            t = times3(inverse, bx[p], by[p], bz[p])
            w = times3(below, t[0], t[1], t[2])
            down = sandwich3(below, inverse)
    p = first + half
    inverse = block3(diagonal[p], _and_own3(own, p, _at3(s, p)), _at3(s, p + 1), up, down)
    t = times3(inverse, bx[p] + u[0] + w[0], by[p] + u[1] + w[1], bz[p] + u[2] + w[2])
    bx[p], by[p], bz[p] = t
    q = t
    for i in range(half):
        p = first + half - 1 - i
        r = times3(_at3(s, p + 1), t[0], t[1], t[2])
        t = times3(_at3(inverses, p), bx[p] + r[0], by[p] + r[1], bz[p] + r[2])
        bx[p], by[p], bz[p] = t
        p = first + half + 1 + i
        if p < last:
            r = times3(_at3(s, p), q[0], q[1], q[2])
            q = times3(_at3(inverses, p), bx[p] + r[0], by[p] + r[1], bz[p] + r[2])
            bx[p], by[p], bz[p] = q
