"""Bending moments of the mast by the equilibrium of its loads, with the static part of the modes left out."""

from __future__ import annotations

import numpy as np

from cablepod.mast._model import ModalMast
from cablepod.mast._request import MastTrajectory
from cablepod.mast._statics import load_vectors, seen_by


def bending_moments(mast: ModalMast, run: MastTrajectory) -> np.ndarray:
    r"""Return the bending moments at the outputs, in x and z (outputs, nodes, 2) [N m].

    The displacement u of the modes kept lacks the static displacement by the forces that these modes do not contain,

    .. math::

        u_c = K^{-1} \big[(1 - M \Phi \Phi^T) R - (K \Phi - M \Phi \Omega^2) a\big], \qquad
        R = F + K_g u - \sum_l (P_l - P_{l,0}) G_l (u_0 + u),

    with loads, drag and forces of the guys F less those at rest, their static stiffness K_g about rest, stiffness K and mass M of
    mast and guys, the pull P of the guys at each level and the geometric stiffness G of a pull of one.  The second term vanishes
    for modes of K and M.  Moments are those of u + u_c.

    References
    ----------
    R. R. Craig and A. J. Kurdila, Fundamentals of Structural Dynamics (2006), section 11.4: mode acceleration method.
    """
    n, rest, request = run.completed, mast.rest, run.request
    beam, modal, force = rest.beam, run.modal[:n], run.force[:n] - run.force[:1]
    shape, inertia = mast.modes, mast.mass_with_guys @ mast.modes
    # moments (nodes 2, count) by static forces, and by what of them the modes do not contain
    by_forces = np.linalg.solve(rest.stiffness, beam.moment_rows.reshape(-1, beam.count).T).T
    by_others = by_forces - (by_forces @ inertia) @ shape.T
    by_modes = mast.moment_rows.reshape(-1, shape.shape[1]) - by_forces @ (
        rest.stiffness @ shape - inertia * mast.omega**2
    )
    by_modes = by_modes + by_others @ seen_by(rest.rows, rest.guy_stiffness) @ shape
    total = modal @ by_modes.T
    total += force[:, :, [0, 2]].reshape(n, -1) @ (by_others @ rest.rows.reshape(-1, beam.count).T).T
    factors = request.factors(rest.p.loads)
    if factors is not None:
        at_outputs = factors[:, :: request.every][:, :n]
        total += (at_outputs - factors[:, :1]).T @ (by_others @ load_vectors(rest.p, beam).T).T
    if run.drag.size:
        nodes = beam.height.size - 1  # the foot does not move
        drag = np.swapaxes(run.drag[:n, :, :nodes] - run.drag[:1, :, :nodes], 1, 2)
        total += drag.reshape(n, -1) @ (by_others @ beam.all_rows[1:].reshape(-1, beam.count).T).T
    for level in np.unique(mast.level_of_guy).tolist():
        pull = -force[:, mast.level_of_guy == level, 1].sum(axis=1)
        by_pull = by_others @ beam.of_pull(float(mast.heights[level]))
        total -= pull[:, None] * (by_pull @ rest.unknowns + modal @ (by_pull @ shape).T)
    return mast.moment_rest + total.reshape(n, -1, 2)
