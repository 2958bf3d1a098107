"""Compiled solver of small dense systems."""

from cablepod._jit import compiled


@compiled(forceinline=True)
def _solve(matrix, x):
    """Solve a small system in place by Gaussian elimination with pivoting; False where it is singular.

    Cholesky's method would fail: a stiff cable whose ends approach has H < 0, and an indefinite matrix, until Newton's method
    has found its sag.
    """
    n = x.size
    if n == 2:  # the common case, without loops; Newton's method corrects the larger rounding
        det = matrix[0, 0] * matrix[1, 1] - matrix[0, 1] * matrix[1, 0]
        if not abs(det) > 0.0:
            return False
        first = (x[0] * matrix[1, 1] - x[1] * matrix[0, 1]) / det
        x[1] = (x[1] * matrix[0, 0] - x[0] * matrix[1, 0]) / det
        x[0] = first
        return True
    for j in range(n):
        best = j
        for i in range(j + 1, n):
            if abs(matrix[i, j]) > abs(matrix[best, j]):
                best = i
        if not abs(matrix[best, j]) > 0.0:
            return False
        if best != j:
            for k in range(j, n):
                matrix[j, k], matrix[best, k] = matrix[best, k], matrix[j, k]
            x[j], x[best] = x[best], x[j]
        for i in range(j + 1, n):
            factor = matrix[i, j] / matrix[j, j]
            for k in range(j + 1, n):
                matrix[i, k] -= factor * matrix[j, k]
            x[i] -= factor * x[j]
    for back in range(n):
        i = n - 1 - back
        for k in range(i + 1, n):
            x[i] -= matrix[i, k] * x[k]
        x[i] /= matrix[i, i]
    return True
