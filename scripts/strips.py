"""Strips of a laboratory by Hermite finite elements, and their motion, exact in time. No code is
shared with the program, so that the records of scripts/trials.py are independent of it.
`scripts/trials.py generator 9` compares both: they agree within 3e-7 of the largest value.

Import this module after `need("numpy", "scipy")` of program.py.
"""

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import eig, solve, solve_triangular, svd


@dataclass
class Strip:
    """A cantilever in m, kg, s and N.

    masses  (position, mass) of each mass beside the sensor's
    dip     (place, width, depth) of a Gaussian dip of E
    cut     (first, last, share of E that is missing between them)
    crack   (position, stiffness of the rotational spring)
    """

    length: float
    width: float
    height: float
    density: float
    E: float
    c_D: float
    gamma: float
    m_S: float
    x_S: float
    k_R: float = np.inf
    masses: tuple = ()
    dip: tuple = ()
    cut: tuple = ()
    crack: tuple = ()

    def modulus(self, x):
        """E at the positions x."""
        share = np.zeros_like(x)
        if self.dip:
            place, width, depth = self.dip
            share = depth * np.exp(-0.5 * ((x - place) / width)**2)
        if self.cut:
            first, last, missing = self.cut
            share = np.where((x > first) & (x < last), missing, share)
        return self.E * (1 - share)

    def groups(self, *names, **wrong):
        """&beam and &sensor of a case, with names beside the usual ones, and wrong values."""
        values = vars(self) | wrong
        names = ("length", "width", "height", "density", "E", "c_D", "gamma", *names)
        sensor = ("m_S", "x_S") if self.m_S else ("x_S",)
        return [("beam", {name: values[name] for name in names}),
                ("sensor", {name: values[name] for name in sensor})]


def element(a, b):
    """A Hermite element from a to b with deflection and slope at both ends: its mass matrix per
    unit of rho, and at its Gauss points the positions, the weights and the curvature (points, 4).
    """
    h = b - a
    points, weights = np.polynomial.legendre.leggauss(5)
    xi, weights = (points + 1) / 2, weights * h / 2
    shapes = np.array([1 - 3 * xi**2 + 2 * xi**3, h * (xi - 2 * xi**2 + xi**3),
                       3 * xi**2 - 2 * xi**3, h * (xi**3 - xi**2)])
    curvature = np.array([12 * xi - 6, h * (6 * xi - 4), 6 - 12 * xi, h * (6 * xi - 2)]) / h**2
    return (shapes * weights) @ shapes.T, a + h * xi, weights, curvature.T


class Motion:
    """The motion of a strip of Hermite elements, exact in time: its undamped modes, which damping
    couples, and the eigenvectors of their equations of first order. No mode is left out: beside a
    spring without damping, the coupling of many modes matters.

    The stiffness matrix is S'S, where S has a row for each Gauss point and for each spring, and the
    mass matrix is LL'. The natural frequencies are the singular values of S L'^-1, to ten digits;
    as roots of eigenvalues they would have six, because S'S has the squared condition number.
    Masses, the sensor and damage are at nodes. Nodes nearer than 1e-6 of the length are one,
    because the mass matrix would be ill-conditioned. State: omega q and q' of each mode, velocity
    of the base.
    """

    def __init__(self, strip, elements=96):
        self.strip = s = strip
        sites = [0, s.x_S, *(x for x, _ in s.masses), *s.cut[:2], *s.crack[:1], s.length]
        even = [x for x in np.linspace(0, s.length, elements + 1)
                if np.abs(x - np.array(sites)).min() > 0.2 * s.length / elements]
        x = np.sort([*sites, *even])
        self.x = x = x[np.append(True, np.diff(x) > 1e-6 * s.length)]
        size = 2 * len(x) + bool(s.crack)
        area, I = s.width * s.height, s.width * s.height**3 / 12
        M, G = np.zeros((2, size, size))
        S, viscous = np.zeros((2, 5 * len(x) - 3, size))    # the last two rows are springs
        for k, (a, b) in enumerate(zip(x[:-1], x[1:])):
            dofs = [2 * k, 2 * k + 1, 2 * k + 2, 2 * k + 3]
            if s.crack and k == self.node(s.crack[0]):
                dofs[1] = size - 1    # the slope behind the crack
            mass, points, weights, curvature = element(a, b)
            M[np.ix_(dofs, dofs)] += s.density * area * mass
            G[np.ix_(dofs, dofs)] += s.gamma * mass
            S[5 * k:5 * k + 5, dofs] = np.sqrt(weights * I * s.modulus(points))[:, None] * curvature
            viscous[5 * k:5 * k + 5, dofs] = np.sqrt(weights * I * s.c_D)[:, None] * curvature
        for position, m in [(s.x_S, s.m_S), *s.masses]:
            M[2 * self.node(position), 2 * self.node(position)] += m
        if s.crack:
            S[-1, [2 * self.node(s.crack[0]) + 1, -1]] = np.sqrt(s.crack[1]) * np.array([-1, 1])
        if np.isfinite(s.k_R):
            S[-2, 1] = np.sqrt(s.k_R)
        first = 1 if np.isfinite(s.k_R) else 2    # of the degrees of freedom that are not clamped
        L = np.linalg.cholesky(M[first:, first:])
        _, omega, turned = svd(solve_triangular(L, S[:, first:].T, lower=True).T,
                               full_matrices=False)
        shapes = solve_triangular(L, turned[::-1].T, lower=True, trans="T")
        self.first, n = first, len(omega)
        self.omega, self.shapes = omega[::-1], shapes
        damped = viscous[:, first:] @ self.shapes
        self.C = damped.T @ damped + self.shapes.T @ G[first:, first:] @ self.shapes
        rigid = np.zeros(size)
        rigid[:2 * len(x):2] = 1
        self.A = np.zeros((2 * n + 1, 2 * n + 1))
        self.A[:n, n:-1], self.A[n:-1, :n] = np.diag(self.omega), -np.diag(self.omega)
        self.A[n:-1, n:-1] = -self.C
        self.A[n:-1, -1] = -self.shapes.T @ (G @ rigid)[first:]
        self.base_load = np.r_[np.zeros(n), -self.shapes.T @ (M @ rigid)[first:], 1]
        self.at_sensor = self.row(s.x_S)
        # With the highest modes first, the poles have twelve digits instead of seven.
        order = np.r_[n - 1:-1:-1, 2 * n - 1:n - 1:-1, 2 * n]
        self.poles, vectors = eig(self.A[np.ix_(order, order)])
        self.vectors = vectors[np.argsort(order)]
        self.output = np.r_[np.zeros(n), self.at_sensor, 0] @ self.A @ self.vectors

    def node(self, x):
        """Number of the node at a position."""
        return int(np.abs(self.x - x).argmin())

    def row(self, x):
        """Deflection at a position in each mode."""
        return self.shapes[2 * self.node(x) - self.first]

    def deflected(self, displacement=0.02, factors=None):
        """State in which the tip is held aside; factors of the lowest modes, 0 for others."""
        tip = self.row(self.strip.length)
        force = displacement / np.sum((tip / self.omega)**2)
        state = np.zeros(len(self.A))
        state[:len(self.omega)] = force * tip / self.omega
        if factors is not None:
            state[len(factors):] = 0
            state[:len(factors)] *= factors
        return state

    def residues(self, state):
        """Acceleration of the sensor in a free motion: the factor of exp(pole t) of each pole."""
        return self.output * solve(self.vectors, state.astype(complex))

    def free(self, t, state):
        """Acceleration of the sensor at the times t of a free motion."""
        return self.decaying(t, self.residues(state))

    def decaying(self, t, residues):
        """The sum of the residues times exp(pole t), without what has decayed at the first time."""
        sizes = np.abs(residues) * np.exp(self.poles.real * t[0])
        kept = sizes > 1e-14 * sizes.max()
        return (np.exp(np.outer(t, self.poles[kept])) @ residues[kept]).real

    def pulse(self, t, force, duration):
        """Acceleration after a constant force on the tip that lasts from 0 to `duration`."""
        load = np.r_[np.zeros(len(self.omega)), force * self.row(self.strip.length), 0]
        moving = np.abs(self.poles) > 1e-6 * self.omega[0]
        s = np.where(moving, self.poles, 1)
        gain = np.where(moving, (np.exp(s * duration) - 1) / s, duration)
        return self.decaying(t - duration, gain * self.residues(load))

    def base(self, step, z):
        """Absolute acceleration at times 0, step, ... while the base has the acceleration z there,
        and linear between."""
        moving = np.abs(self.poles) > 1e-6 * self.omega[0]
        s = np.where(moving, self.poles * step, 1)
        both = np.where(moving, (np.exp(s) - 1) / s, 1)
        late = np.where(moving, (np.exp(s) - 1 - s) / s**2, 0.5)
        grown = step * solve(self.vectors, self.base_load.astype(complex))
        decay, y, a = np.exp(self.poles * step), np.zeros(len(self.poles), complex), [0.0]
        direct = 1 + self.at_sensor @ self.base_load[len(self.omega):-1]
        for before, now in zip(z[:-1], z[1:]):
            y = decay * y + grown * (both * before + late * (now - before))
            a.append((self.output @ y).real + direct * now)
        return np.array(a)

    def nonlinear(self, t, state, damping=0.0, frequency=0.0, modes=3):
        """Free motion of a few modes; damping and frequency of mode 1 grow by these shares at the
        amplitude of the start."""
        w, C = self.omega[:modes], self.C[:modes, :modes]
        q = state[:modes] / w
        cubic = 8 / 3 * frequency * w[0]**2 / q[0]**2    # Duffing: 3/8 of it, relative

        def acceleration(y):
            force = C @ y[modes:] + w**2 * y[:modes]
            amplitude = np.hypot(y[0], y[modes] / w[0]) / abs(q[0])
            force[0] += damping * amplitude * C[0, 0] * y[modes] + cubic * y[0]**3
            return -force

        found = solve_ivp(lambda _, y: np.r_[y[modes:], acceleration(y)], (0, t[-1]),
                          np.r_[q, 0 * q], "DOP853", t, rtol=1e-9, atol=1e-9 * abs(q[0]))
        return self.at_sensor[:modes] @ np.transpose([acceleration(y) for y in found.y.T])
