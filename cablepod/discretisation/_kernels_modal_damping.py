"""Compiled damping forces of given ratios on the nodes of a cable."""

from cablepod._jit import REORDERED, compiled
from cablepod.discretisation._kernels_laws import on_line


@compiled(fastmath=REORDERED)
def damping_forces(modal, rates, first, relative, forces):
    """Add the damping forces of the free nodes to `forces` (dims, N) [N]: -C times velocities relative to the line of the ends.

    The line between the ends moves with them.

    Parameters
    ----------
    modal
        See :class:`cablepod.discretisation._modal_damping.NodalDamping`.
    rates
        Velocities of all nodes (dims, N) [m/s].
    first
        Number of the first free node.
    relative
        Work array (unknowns or more,).
    forces
        Added to; those of held nodes are left alone.
    """
    dims, last = rates.shape[0], rates.shape[1] - 1
    size = modal.matrix.shape[0]
    for j in range(size // dims):
        sigma = modal.sigma[first + j]
        for c in range(dims):
            relative[dims * j + c] = rates[c, first + j] - on_line(rates[c, 0], rates[c, last], sigma)
    for j in range(size // dims):
        for c in range(dims):
            row, total = dims * j + c, 0.0
            for k in range(size):
                total += modal.matrix[row, k] * relative[k]
            forces[c, first + j] -= total
