"""The condensed model written down anew, link by link and without modes, for SciPy's DOP853."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, root

from references.numbers import Numbers


class Reference:
    """Links between the ends of a scene whose inner particles have mass across the chord, but none along it.

    The exact model is a chain whose chordwise coordinates follow from balance along the chord (no scalar H appears), the leading
    one a string with the polynomial closure and constants of second order, both with forces on the particles and accelerations
    of the frame as they stand in the equations.  To the inertial one belongs the kinetic energy of what the deflection moves
    along the chord, if links move as though they kept their length, and what is left over to the ends is taken from all of them
    alike.
    """

    def __init__(self, scene, lengths, *, order="exact", law="linear"):
        self.p, self.order, self.green = Numbers(scene), order, law == "green"
        self.length = self.p.length * np.array(lengths) / np.sum(lengths)
        self.s = np.concatenate([[0.0], np.cumsum(self.length)])
        self.share = 0.5 * (np.append(self.length, 0.0) + np.append(0.0, self.length))
        self.dims, self.inner = self.p.dims, len(lengths) - 1
        self.damping = self.p.damping
        self.zeta = None
        start = np.diff(self.p.end_positions(np.zeros(1))[0], axis=0)[0]
        # the normals in space refer to the first one at the start: that closest to the vertical, or to the flattest axis within
        # 11 degrees of it
        start = start / np.linalg.norm(start)
        self.axis = np.eye(self.dims)[np.argmin(np.abs(start)) if abs(start[1]) > 0.98 else 1]
        self.axis = self.axis - (start @ self.axis) * start
        if order == "leading":
            self.factor, self.masses = self.second_order()

    def second_order(self):
        """Factor of the squared slopes (n,), and mass matrices of both deflections with chordwise inertia (inner, inner)."""
        total, end = self.s[-1], self.p.duration
        _, _, _, normals = self.frame(0.0)
        pushes = np.vstack([np.zeros(self.dims - 1), -np.cumsum(self.forces(0.0, moving=False) @ normals.T, axis=0)])
        shear = pushes - self.length @ pushes / total
        squared = (shear**2).sum(axis=1)
        mean = self.length @ squared / total
        profile, fourth = squared / mean, self.length @ squared**2 / total / mean**2
        strains = [self.frame(t)[1] / total - 1.0 for t in np.linspace(0.0, end, 65)]

        def sag(x):
            """Half the mean square slope of the equilibrium at a strain of the chord."""
            load = 0.5 * mean / self.p.stiffness**2
            n = brentq(
                lambda n: n * n * (n - x) - load, max(x, 0.0), abs(x) + 2.0 * load ** (1 / 3), xtol=1e-300, rtol=1e-15
            )
            return n - x

        weights, excesses = [], []
        for x in (min(strains), max(strains)):
            a = sag(x)
            # S = x - x^2 + (1 + (P - 4) x) A + (3/2 P - 3) A^2 by a factor 1 / (1 + e) in the closure and in the force
            second = -x * x + (fourth - 4.0) * x * a + (1.5 * fourth - 3.0) * a * a
            excesses.append(-second / (x + 2.0 * a))
            weights.append(np.sqrt(a) * (x + 2.0 * a) / (x + 3.0 * a))
        middle = sag(0.5 * (min(strains) + max(strains)))
        factor = 1.0 / (1.0 + np.average(excesses, weights=weights)) + middle * (profile - fourth)
        masses = []
        for part in shear.T * np.sqrt(2.0 * middle / mean):
            shortening = -part[:, None] * np.diff(np.eye(len(self.length) + 1), axis=0)[:, 1:-1]
            along = np.cumsum(shortening, axis=0) - np.outer(np.cumsum(self.length), shortening.sum(axis=0)) / total
            inner = self.p.mass * self.share[1:-1]
            masses.append(np.diag(inner) + along[:-1].T @ (inner[:, None] * along[:-1]))
        return factor, masses

    def rates(self, impulses):
        """Rates of the deflections (inner, normals) for impulses per mass of the particles."""
        if self.order != "leading":
            return impulses
        inner = self.p.mass * self.share[1:-1]
        return np.column_stack(
            [np.linalg.solve(m, inner * part) for m, part in zip(self.masses, impulses.T, strict=True)]
        )

    def frame(self, t):
        ends = self.p.end_positions(np.array([t]))[0]
        reach = ends[1] - ends[0]
        c = np.linalg.norm(reach)
        e = reach / c
        if self.dims == 2:
            return ends, c, e, np.array([[-e[1], e[0]]])
        first = self.axis - (e @ self.axis) * e
        first /= np.linalg.norm(first)
        return ends, c, e, np.array([first, np.cross(e, first)])

    def forces(self, t, *, moving=True):
        """Forces on the inner particles (inner, dims): loads, and what accelerations of the straight line do."""
        p, total = self.p, self.s[-1]
        force = self.share[:, None] * p.load_at(t)
        for place, size, factor in p.point_loads:
            j = min(np.searchsorted(self.s, place * total, side="right"), len(self.length)) - 1
            right = (place * total - self.s[j]) / self.length[j]
            force[j] += (1.0 - right) * factor(t) * size
            force[j + 1] += right * factor(t) * size
        if moving:
            for derivative, factor in ((2, 1.0), (1, self.damping)):
                rates = p.end_positions(np.array([t]), derivative)[0]
                line = rates[0] + np.outer(self.s / total, rates[1] - rates[0])
                force -= p.mass * self.share[:, None] * factor * line
        return force[1:-1]

    def tension_over_reach(self, squares):
        """Tension over the stretched length (n,) for squares of the stretched lengths."""
        k = self.p.stiffness / self.length
        if self.green:
            return 0.5 * k * (squares / self.length**2 - 1.0)
        return k * (1.0 - self.length / np.sqrt(squares))

    def along(self, w, push, c):
        """Chordwise positions of the inner particles in balance along the chord, by Newton's method."""
        across = sum(np.diff(np.pad(part, 1)) ** 2 for part in w.T)
        zeta = self.s[1:-1] / self.s[-1] * c if self.zeta is None else self.zeta.real * (c / self.chord)
        zeta = zeta.astype(np.result_type(zeta, w))
        for sweep in range(50):
            reach = np.diff(np.concatenate([[0.0], zeta, [c]]))
            squares = reach**2 + across
            pull = self.tension_over_reach(squares)
            k = self.p.stiffness / self.length
            steeper = k / self.length**2 if self.green else k * self.length / squares**1.5
            slope = pull + steeper * reach**2
            jacobian = np.diag(slope[:-1] + slope[1:]) - np.diag(slope[1:-1], 1) - np.diag(slope[1:-1], -1)
            change = np.linalg.solve(jacobian, np.diff(pull * reach) + push)
            zeta = zeta + change
            if sweep > 1 and np.abs(change).max() < 1e-15 * c:
                break
        self.zeta, self.chord = zeta, c
        return zeta, pull, jacobian

    def chordwise_forces(self, w, push, c):
        """Chordwise forces of the links to leading order and their squared slopes (n,)."""
        slope = np.diff(np.pad(w, ((1, 1), (0, 0))), axis=0) / self.length[:, None]
        squared, tau, total = (slope**2).sum(axis=1), np.concatenate([[0.0], -np.cumsum(push)]), self.s[-1]
        stretch = c / total - 1.0 + 0.5 * (self.factor * squared) @ self.length / total
        return self.p.stiffness * stretch - (tau @ self.length) / total + tau, squared

    def accelerate(self, t, w, *, moving=True):
        """Accelerations of the deflections (inner, normals) without damping or inertia along the chord, chordwise positions."""
        _, c, e, normals = self.frame(t)
        force = self.forces(t, moving=moving)
        if self.order == "leading":
            n, squared = self.chordwise_forces(w, force @ e, c)
            pull = (self.factor * n / self.length)[:, None]
            zeta = np.cumsum((1.0 + n / self.p.stiffness - 0.5 * self.factor * squared) * self.length)[:-1]
        else:
            zeta, pull, _ = self.along(w, force @ e, c)
            pull = pull[:, None]
        across = np.diff(pull * np.diff(np.pad(w, ((1, 1), (0, 0))), axis=0), axis=0) + force @ normals.T
        return self.rates(across / (self.p.mass * self.share[1:-1, None])), zeta

    def lever(self, w, v, push, c):
        """Rates along the chord (inner,) for rates of the deflections, and the rate of that matrix."""
        reach = np.diff(np.concatenate([[0.0], self.along(w, push, c)[0], [c]]))
        each = np.diff(np.eye(len(self.length) + 1), axis=0)[:, 1:-1]
        even = np.eye(reach.size) - np.outer(self.length, np.ones(reach.size)) / self.s[-1]

        def links(w, reach):
            across = np.diff(np.pad(w, ((1, 1), (0, 0))), axis=0)
            return -(each[:, :, None] * (across / reach[:, None])[:, None]).reshape(reach.size, -1)

        here = links(w, reach)
        # by complex step: no digits are lost
        rate = links(w + 1e-20j * v, reach + 1e-20j * (here @ v.ravel())).imag / 1e-20
        return [np.cumsum(even @ item, axis=0)[:-1] for item in (here, rate)]

    def accelerate_all(self, t, w, v):
        """Accelerations of the deflections (inner, normals)."""
        result, damping = self.accelerate(t, w)[0], self.damping * v
        if self.order != "inertial":
            return result - damping
        _, c, e, _ = self.frame(t)
        mass = self.p.mass * self.share[1:-1]
        lever, rate = self.lever(w, v, self.forces(t) @ e, c)
        across = np.repeat(mass, w.shape[1])
        force = across * result.ravel() - lever.T @ (mass * (rate @ v.ravel()))
        matrix = np.diag(across) + lever.T @ (mass[:, None] * lever)
        return np.linalg.solve(matrix, force).reshape(w.shape) - damping

    def rest(self):
        """Deflections in equilibrium at time 0 (inner, normals)."""
        _, c, _, normals = self.frame(0.0)
        sag = self.forces(0.0, moving=False) @ normals.T
        guess = 0.05 * c * np.sin(np.pi * self.s[1:-1, None] / self.s[-1]) * np.sign(sag)
        scale = 1e-3 * self.p.stiffness / self.p.mass
        found = root(
            lambda x: self.accelerate(0.0, x.reshape(guess.shape), moving=False)[0].ravel() / scale,
            guess.ravel(),
            tol=1e-15,
        )
        return found.x.reshape(guess.shape)

    def tensions(self, t, w):
        """Tensions of the links (n,)."""
        _, c, e, _ = self.frame(t)
        push = self.forces(t) @ e
        if self.order == "leading":
            n, squared = self.chordwise_forces(w, push, c)
            return n * np.sqrt(1.0 + squared)
        zeta, pull, _ = self.along(w, push, c)
        across = np.diff(np.pad(w, ((1, 1), (0, 0))), axis=0)
        return pull * np.sqrt(np.diff(np.concatenate([[0.0], zeta, [c]])) ** 2 + (across**2).sum(axis=1))

    def positions(self, times, w0=None, *, rtol=1e-11):
        """Positions (times, inner, dims) from rest."""
        return self.motion(times, w0, rtol=rtol)[0]

    def motion(self, times, w0=None, *, rtol=1e-11):
        """Positions (times, inner, dims) and tensions (times, n) from rest."""
        w0 = self.rest() if w0 is None else w0
        rates = self.p.end_positions(np.zeros(1), 1)[0]
        line = rates[0] + np.outer(self.s[1:-1] / self.s[-1], rates[1] - rates[0])
        start = np.concatenate([w0.ravel(), self.rates(-(line @ self.frame(0.0)[3].T)).ravel()])

        def rate(t, state):
            w, v = state.reshape(2, *w0.shape)
            return np.concatenate([v, self.accelerate_all(t, w, v)]).ravel()

        run = solve_ivp(rate, (0.0, times[-1]), start, method="DOP853", t_eval=times, rtol=rtol, atol=0.1 * rtol)
        positions, tensions = [], []
        for t, state in zip(times, run.y.T, strict=True):
            w = state.reshape(2, *w0.shape)[0]
            ends, _, e, normals = self.frame(t)
            positions.append(ends[0] + np.outer(self.accelerate(t, w)[1], e) + w @ normals)
            tensions.append(self.tensions(t, w))
        return np.array(positions), np.array(tensions)
