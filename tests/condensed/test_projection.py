"""Few modes: the equations of the links projected onto them, by an independent ODE solution."""

from __future__ import annotations

import numpy as np
import pytest
from references.condensed_ode import Reference
from scenes import LENGTHS, ORDERS, everything, full_modes
from scipy.integrate import solve_ivp
from scipy.optimize import root

import cablepod as cp


class Projected(Reference):
    """Galerkin projection of the link equations in the plane on shapes (r, inner)."""

    def __init__(self, scene, lengths, shapes, *, order):
        super().__init__(scene, lengths, order=order)
        self.shapes = shapes
        self.mass = self.p.mass * self.share[1:-1]
        self.matrix = self.masses[0] if order == "leading" else np.diag(self.mass)

    def second_rates(self, t, q, v):
        w, speed = (q @ self.shapes)[:, None], (v @ self.shapes)[:, None]
        matrix = self.matrix
        force = matrix @ self.accelerate(t, w)[0][:, 0]
        if self.order == "inertial":
            _, c, e, _ = self.frame(t)
            lever, rate = self.lever(w, speed, self.forces(t) @ e, c)
            force = force - lever.T @ (self.mass * (rate @ speed.ravel()))
            matrix = matrix + lever.T @ (self.mass[:, None] * lever)
        return np.linalg.solve(self.shapes @ matrix @ self.shapes.T, self.shapes @ force) - self.damping * v

    def deflections(self, times):
        """Deflections (times, inner) from rest."""

        def unbalanced(q):
            return self.shapes @ self.matrix @ self.accelerate(0.0, (q @ self.shapes)[:, None], moving=False)[0][:, 0]

        project = np.linalg.solve((self.shapes * self.mass) @ self.shapes.T, self.shapes * self.mass)
        q = root(unbalanced, project @ super().rest()[:, 0], tol=1e-14).x
        rates = self.p.end_positions(np.zeros(1), 1)[0]
        line = rates[0] + np.outer(self.s[1:-1] / self.s[-1], rates[1] - rates[0])
        impulse = -self.mass * (line @ self.frame(0.0)[3][0])
        v = np.linalg.solve(self.shapes @ self.matrix @ self.shapes.T, self.shapes @ impulse)

        def rate(t, state):
            return np.concatenate([state[q.size :], self.second_rates(t, state[: q.size], state[q.size :])])

        start = np.concatenate([q, v])
        run = solve_ivp(rate, (0.0, times[-1]), start, method="DOP853", t_eval=times, rtol=1e-11, atol=1e-12)
        return run.y[: q.size].T @ self.shapes


def deflections(position):
    """Return the distances of the inner particles from the line between the ends, in the plane (times, inner)."""
    chord = position[:, -1] - position[:, 0]
    normal = np.stack([-chord[:, 1], chord[:, 0]], axis=1) / np.linalg.norm(chord, axis=1)[:, None]
    return np.einsum("tpc,tc->tp", position[:, 1:-1] - position[:, :1], normal)


@pytest.mark.parametrize("order", ORDERS)
def test_few_modes_solve_the_projected_equations_of_the_links(soft, order):
    scene = cp.make_scene({**everything(soft), "chain": {"links": len(LENGTHS)}})
    modes, times = full_modes(), np.array([0.4, 0.8])
    shapes = modes["mode_shape"].values[:2, 1:-1]
    reference = Projected(scene, LENGTHS, shapes, order=order).deflections(times)
    options = {"order": order, "scheme": "velocity_verlet", "times": times, "outputs": ("position",)}
    coarse, fine, whole = (
        cp.condensed.simulate(scene, modes, rank=rank, step=step, **options).position.values
        for rank, step in ((2, 1 / 4000), (2, 1 / 8000), (None, 1 / 8000))
    )
    # Richardson extrapolation of a second-order scheme, as for all modes: the error is of fourth order
    np.testing.assert_allclose(deflections((4.0 * fine - coarse) / 3.0), reference, rtol=0, atol=1e-8)
    assert np.abs(deflections(whole) - reference).max() > 1e-4
