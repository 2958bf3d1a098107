"""Compiled block tridiagonal solvers for planar and spatial chains, members in lanes.

Both eliminate from the ends towards the middle: two independent chains of operations, which halve the time.
"""

from cablepod._jit import FUSED, compiled

# --- planar -----------------------------------------------------------------------------------------------------------


@compiled(fastmath=FUSED, noalias=True, forceinline=True, counted=False)
def _eliminate_planar(lanes, p, link, block, s, bx, by, matrix, carry):
    """Eliminate particle `p`; `carry` changes from the sums of its neighbour to those for the next one, through `link`.

    With the block D = [[a, b], [b, c]], the link S to the next particle and the right side r, `matrix` is D^-1 S, r becomes
    D^-1 r, and `carry` S D^-1 S and S D^-1 r.  The products do not depend on the division by the determinant, the slowest
    operation, which runs in parallel.
    """
    width, size = len(lanes), max(bx.size, 0)
    row, p, link = size + width, max(p, 0), max(link, 0)
    for m in range(width):
        i, j = p * width + m, link * width + m
        a = block[i] + s[i] + s[i + width] - carry[m]
        b = block[size + i] + s[row + i] + s[row + i + width] - carry[width + m]
        c = block[2 * size + i] + s[2 * row + i] + s[2 * row + i + width] - carry[2 * width + m]
        rx, ry = bx[i] + carry[3 * width + m], by[i] + carry[4 * width + m]
        sxx, sxy, syy = s[j], s[row + j], s[2 * row + j]
        scale = 1.0 / (a * c - b * b)
        # the adjugate of D times S, and S times that
        mxx, mxy = c * sxx - b * sxy, c * sxy - b * syy
        myx, myy = a * sxy - b * sxx, a * syy - b * sxy
        carry[m] = (sxx * mxx + sxy * myx) * scale
        carry[width + m] = (sxx * mxy + sxy * myy) * scale
        carry[2 * width + m] = (sxy * mxy + syy * myy) * scale
        tx, ty = (c * rx - b * ry) * scale, (a * ry - b * rx) * scale
        carry[3 * width + m] = sxx * tx + sxy * ty
        carry[4 * width + m] = sxy * tx + syy * ty
        at = 4 * p * width + m
        matrix[at], matrix[at + width] = mxx * scale, mxy * scale
        matrix[at + 2 * width], matrix[at + 3 * width] = myx * scale, myy * scale
        bx[i], by[i] = tx, ty


@compiled(fastmath=FUSED, noalias=True, forceinline=True, counted=False)
def _middle_planar(lanes, p, block, s, bx, by, up, down):
    """Solve for particle `p`, where both eliminations meet; the first rows of `up` and `down` become the solution."""
    width, size = len(lanes), max(bx.size, 0)
    row, p = size + width, max(p, 0)
    for m in range(width):
        i = p * width + m
        a = block[i] + s[i] + s[i + width] - up[m] - down[m]
        b = block[size + i] + s[row + i] + s[row + i + width] - up[width + m] - down[width + m]
        c = block[2 * size + i] + s[2 * row + i] + s[2 * row + i + width] - up[2 * width + m] - down[2 * width + m]
        rx = bx[i] + up[3 * width + m] + down[3 * width + m]
        ry = by[i] + up[4 * width + m] + down[4 * width + m]
        scale = 1.0 / (a * c - b * b)
        tx, ty = (c * rx - b * ry) * scale, (a * ry - b * rx) * scale
        bx[i], by[i] = tx, ty
        up[m], up[width + m] = tx, ty
        down[m], down[width + m] = tx, ty


@compiled(fastmath=FUSED, noalias=True, forceinline=True, counted=False)
def _substitute_planar(lanes, p, bx, by, matrix, carry):
    """Solve for particle `p`; the first rows of `carry` change from the solution of its neighbour to its own."""
    width, p = len(lanes), max(p, 0)
    for m in range(width):
        i, at = p * width + m, 4 * p * width + m
        x, y = carry[m], carry[width + m]
        bx[i] += matrix[at] * x + matrix[at + width] * y
        by[i] += matrix[at + 2 * width] * x + matrix[at + 3 * width] * y
        carry[m], carry[width + m] = bx[i], by[i]


@compiled(fastmath=FUSED, noalias=True, counted=False)
def solve_planar(lanes, block, s, bx, by, matrix, up, down, first, last):
    """Solve the block tridiagonal systems of planar chains.

    The row of the free particle p is (block_p + S_below + S_above) d_p - S_below d_(p-1) - S_above d_(p+1) = b_p; the particles
    before `first` and from `last` on are held.

    Parameters
    ----------
    lanes : tuple
        Its length is the number of lanes.
    block, s
        Of :class:`cablepod.chain._kernels_arguments.Newton`.
    bx, by : float arrays (n + 1, lanes)
        Right sides [N]; changed to the solution [m] from `first` to `last` - 1.
    matrix, up, down : float arrays (n + 1, 4, lanes), (5, lanes)
        Workspace.
    first, last : int
        The free particles.
    """
    for q in range(up.size):
        up[q] = 0.0
        down[q] = 0.0
    half = (last - first) // 2
    middle = first + half
    for i in range(half):
        _eliminate_planar(lanes, first + i, first + i + 1, block, s, bx, by, matrix, up)
        p = last - 1 - i
        if p > middle:
            _eliminate_planar(lanes, p, p, block, s, bx, by, matrix, down)
    _middle_planar(lanes, middle, block, s, bx, by, up, down)
    for i in range(half):
        _substitute_planar(lanes, middle - 1 - i, bx, by, matrix, up)
        if middle + 1 + i < last:
            _substitute_planar(lanes, middle + 1 + i, bx, by, matrix, down)


# --- spatial ----------------------------------------------------------------------------------------------------------


@compiled(fastmath=FUSED, forceinline=True, counted=False)
def _inverse(a, b, c, d, e, f):
    """Return the inverse of the symmetric matrix [[a, b, c], [b, d, e], [c, e, f]] as six numbers in the same order."""
    p, q, r = d * f - e * e, c * e - b * f, b * e - c * d
    scale = 1.0 / (a * p + b * q + c * r)
    return p * scale, q * scale, r * scale, (a * f - c * c) * scale, (b * c - a * e) * scale, (a * d - b * b) * scale


@compiled(fastmath=FUSED, forceinline=True, counted=False)
def _times(s, x, y, z):
    """Return the product of a symmetric matrix (six numbers) and a vector."""
    return s[0] * x + s[1] * y + s[2] * z, s[1] * x + s[3] * y + s[4] * z, s[2] * x + s[4] * y + s[5] * z


@compiled(fastmath=FUSED, forceinline=True, counted=False)
def _six(values, at, row):
    """Return six numbers of rows at a distance `row`."""
    return (
        values[at], values[at + row], values[at + 2 * row], values[at + 3 * row], values[at + 4 * row],
        values[at + 5 * row],
    )  # fmt: skip


@compiled(fastmath=FUSED, forceinline=True, counted=False)
def _block(own, below, above, update, second):
    """Return the inverse of the block of a particle after both updates by elimination."""
    return _inverse(
        own[0] + below[0] + above[0] - update[0] - second[0],
        own[1] + below[1] + above[1] - update[1] - second[1],
        own[2] + below[2] + above[2] - update[2] - second[2],
        own[3] + below[3] + above[3] - update[3] - second[3],
        own[4] + below[4] + above[4] - update[4] - second[4],
        own[5] + below[5] + above[5] - update[5] - second[5],
    )


@compiled(fastmath=FUSED, noalias=True, forceinline=True, counted=False)
def _eliminate_spatial(lanes, p, link, block, s, bx, by, bz, inverses, carry):
    """Eliminate particle `p`, as :func:`_eliminate_planar`; `inverses` is D^-1, and r becomes the right side with the sums."""
    width, size = len(lanes), max(bx.size, 0)
    row, p, link, none = size + width, max(p, 0), max(link, 0), (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for m in range(width):
        i, at = p * width + m, 6 * p * width + m
        onward, update = _six(s, link * width + m, row), _six(carry, m, width)
        inverse = _block(_six(block, i, size), _six(s, i, row), _six(s, i + width, row), update, none)
        x, y, z = bx[i] + carry[6 * width + m], by[i] + carry[7 * width + m], bz[i] + carry[8 * width + m]
        bx[i], by[i], bz[i] = x, y, z
        for r in range(6):
            inverses[at + r * width] = inverse[r]
        tx, ty, tz = _times(inverse, x, y, z)
        carry[6 * width + m], carry[7 * width + m], carry[8 * width + m] = _times(onward, tx, ty, tz)
        # S D^-1 S
        a = _times(inverse, onward[0], onward[1], onward[2])
        b = _times(inverse, onward[1], onward[3], onward[4])
        c = _times(inverse, onward[2], onward[4], onward[5])
        carry[m], carry[width + m], carry[2 * width + m] = _times(onward, a[0], a[1], a[2])
        _, carry[3 * width + m], carry[4 * width + m] = _times(onward, b[0], b[1], b[2])
        _, _, carry[5 * width + m] = _times(onward, c[0], c[1], c[2])


@compiled(fastmath=FUSED, noalias=True, forceinline=True, counted=False)
def _middle_spatial(lanes, p, block, s, bx, by, bz, up, down):
    """Solve for particle `p`, as :func:`_middle_planar`."""
    width, size = len(lanes), max(bx.size, 0)
    row, p = size + width, max(p, 0)
    for m in range(width):
        i = p * width + m
        inverse = _block(
            _six(block, i, size), _six(s, i, row), _six(s, i + width, row), _six(up, m, width), _six(down, m, width)
        )
        x, y, z = _times(
            inverse,
            bx[i] + up[6 * width + m] + down[6 * width + m],
            by[i] + up[7 * width + m] + down[7 * width + m],
            bz[i] + up[8 * width + m] + down[8 * width + m],
        )
        bx[i], by[i], bz[i] = x, y, z
        up[m], up[width + m], up[2 * width + m] = x, y, z
        down[m], down[width + m], down[2 * width + m] = x, y, z


@compiled(fastmath=FUSED, noalias=True, forceinline=True, counted=False)
def _substitute_spatial(lanes, p, link, s, bx, by, bz, inverses, carry):
    """Solve for particle `p`; the first rows of `carry` change from the solution of its neighbour, through `link`, to its own."""
    width, row, p, link = len(lanes), max(bx.size, 0) + len(lanes), max(p, 0), max(link, 0)
    for m in range(width):
        i = p * width + m
        rx, ry, rz = _times(_six(s, link * width + m, row), carry[m], carry[width + m], carry[2 * width + m])
        x, y, z = _times(_six(inverses, 6 * p * width + m, width), bx[i] + rx, by[i] + ry, bz[i] + rz)
        bx[i], by[i], bz[i] = x, y, z
        carry[m], carry[width + m], carry[2 * width + m] = x, y, z


@compiled(fastmath=FUSED, noalias=True, counted=False)
def solve_spatial(lanes, block, s, bx, by, bz, inverses, up, down, first, last):
    """Solve the systems of spatial chains: `inverses` (n + 1, 6, lanes), `up` and `down` (9, lanes); else as for planar ones."""
    for q in range(up.size):
        up[q] = 0.0
        down[q] = 0.0
    half = (last - first) // 2
    middle = first + half
    for i in range(half):
        _eliminate_spatial(lanes, first + i, first + i + 1, block, s, bx, by, bz, inverses, up)
        p = last - 1 - i
        if p > middle:
            _eliminate_spatial(lanes, p, p, block, s, bx, by, bz, inverses, down)
    _middle_spatial(lanes, middle, block, s, bx, by, bz, up, down)
    for i in range(half):
        p = middle - 1 - i
        _substitute_spatial(lanes, p, p + 1, s, bx, by, bz, inverses, up)
        p = middle + 1 + i
        if p < last:
            _substitute_spatial(lanes, p, p, s, bx, by, bz, inverses, down)
