"""What beamid is measured against: fits of Table 4.1 by SciPy and by JAX, variable projection of a
free decay by SciPy, and the linear algebra and the exponentials that no such fit can do without.

Import this module before NumPy: it asks every library for one thread.
"""

import ctypes
import glob
import math
import os

os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", JAX_PLATFORMS="cpu",
                  XLA_FLAGS="--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1")

import numpy as np
from scipy.integrate import solve_ivp
from scipy.interpolate import BSpline
from scipy.linalg import cho_factor, cho_solve, eigh, expm, lapack
from scipy.optimize import least_squares

try:
    import jax
    import jax.numpy as jnp
    from jax.scipy.linalg import expm as jax_expm
except ImportError:
    jax = None
else:
    jax.config.update("jax_enable_x64", True)

try:
    import emcee
    import numpyro
except ImportError:
    emcee = numpyro = None

# Table 4.1's model in the units of its case file; `check_model` compares the two.
LENGTH, RHO, E, I, TIP_MASS, PULSE, DELTA = 4.0, 0.03, 80.0, 1.0, 0.15, 0.05, 0.1
START = (0.0035, 0.035, 0.0035, 0.4)
TOLERANCE = 1e-4    # of a search over 49 samples, on J and on the parameters; SciPy's own is 1e-8


class Model:
    """The beam by cubic B-splines and Galerkin's method, independent of beamid's."""

    def __init__(self, elements, measured):
        h = LENGTH / elements
        spline = BSpline(h * np.arange(-3, elements + 4), np.eye(elements + 3), 3)
        points, weights = np.polynomial.legendre.leggauss(4)    # exact up to degree 7
        x = (h * (np.arange(elements)[:, None] + (points + 1) / 2)).ravel()
        weights = np.tile(weights * h / 2, elements)
        clamp = np.vstack([np.zeros((2, elements + 1)), np.eye(elements + 1)])
        clamp[:2, 0] = 1, -0.5    # w(0) = w'(0) = 0
        basis, curvature, tip = (np.pad(np.atleast_2d(values) @ clamp, [(0, 0), (0, 1)]) for values
                                 in (spline(x), spline.derivative(2)(x), spline(LENGTH)))
        self.n, self.tip, self.measured = elements + 2, tip[0], measured
        hose = np.eye(self.n)[-1]    # the last unknown
        self.hose = np.outer(hose, hose)
        self.stretch = np.outer(hose - self.tip, hose - self.tip)
        self.mass = RHO * (basis.T * weights) @ basis + TIP_MASS * np.outer(self.tip, self.tip)
        self.bending = I * (curvature.T * weights) @ curvature

    def state(self, q):
        """A of (w, v, f)' = A (w, v, f) with a constant force f."""
        c_D, m_H, c_H, k_H = q
        n, inverse = self.n, np.linalg.inv(self.mass + m_H * self.hose)
        A = np.zeros((2 * n + 1, 2 * n + 1))
        A[:n, n:-1] = np.eye(n)
        A[n:-1, :n] = -inverse @ (E * self.bending + k_H * self.stretch)
        A[n:-1, n:-1] = -inverse @ (c_D * self.bending + c_H * self.stretch)
        A[n:-1, -1] = inverse @ self.tip
        return A

    def stepped(self, q):
        """Tip displacement at Delta, 2 Delta, ...: exact, two exponentials, step by step."""
        A = self.state(q)
        pulse, step = expm(PULSE * A), expm(DELTA * A[:-1, :-1])
        states = np.empty((len(self.measured) + 2, 2 * self.n))
        states[0] = pulse[:-1, :-1] @ pulse[:-1, -1]    # DELTA is twice PULSE
        for k in range(len(states) - 1):
            states[k + 1] = step @ states[k]
        return states[:, :self.n] @ self.tip

    def doubled(self, q):
        """The same by one exponential and repeated squaring."""
        pulse = expm(PULSE * self.state(q))
        half = pulse[:-1, :-1]
        step, states = half @ half, (half @ pulse[:-1, -1])[:, None]
        while states.shape[1] < len(self.measured) + 2:
            states = np.hstack([states, step @ states])
            step = step @ step
        return self.tip @ states[:self.n, :len(self.measured) + 2]

    def integrated(self, q, method, rtol):
        """The same by an integrator that restarts where the pulse ends."""
        A = self.state(q)
        F, load = A[:-1, :-1].copy(), A[:-1, -1].copy()
        times = DELTA * np.arange(1, len(self.measured) + 3)
        options = {"method": method, "rtol": rtol, "atol": 0.1 * rtol,    # 0.1: size of w and v
                   "jac": (lambda t, y: F) if method == "LSODA" else F}
        pulse = solve_ivp(lambda t, y: F @ y + load, (0, PULSE), np.zeros(2 * self.n), **options)
        free = solve_ivp(lambda t, y: F @ y, (PULSE, times[-1]), pulse.y[:, -1], t_eval=times,
                         **options)
        if not (pulse.success and free.success):
            raise RuntimeError(free.message)
        return self.tip @ free.y[:self.n]

    def residuals(self, u):
        """(4.1) minus the record."""
        return (u[2:] - 2 * u[1:-1] + u[:-2]) / DELTA**2 - self.measured

    def J(self, q):
        """Sum of squares by the exact response."""
        return float(np.sum(self.residuals(self.doubled(q))**2))

    def fit(self, response, method, step):
        """Least squares over the logarithms of the parameters; the estimates."""
        found = least_squares(lambda x: self.residuals(response(START * np.exp(x))), np.zeros(4),
                              method=method, diff_step=step, ftol=TOLERANCE, xtol=TOLERANCE)
        return tuple(map(float, START * np.exp(found.x)))


class JaxModel:
    """The same model in JAX, and a fit of it that is compiled as a whole.

    doubled  one exponential in the modes at the start, which need fewer squarings, and repeated
             squaring; otherwise two exponentials of the splines' equations, stepped by lax.scan
    """

    def __init__(self, model, doubled):
        self.doubled, self.n, self.samples = doubled, model.n, len(model.measured) + 2
        shapes, omega = np.eye(model.n), np.ones(model.n)
        if doubled:
            _, m_H, _, k_H = START
            omega, shapes = eigh(E * model.bending + k_H * model.stretch,
                                 model.mass + m_H * model.hose)
            omega = np.sqrt(omega)
        self.mass, self.hose, self.stretch, self.bending = (
            jnp.asarray(shapes.T @ matrix @ shapes)
            for matrix in (model.mass, model.hose, model.stretch, model.bending))
        self.tip, self.omega = jnp.asarray(shapes.T @ model.tip), jnp.asarray(omega)
        self.measured = jnp.asarray(model.measured)
        self.compiled = jax.jit(self.search)

    def fit(self):
        """The estimates; the first call compiles."""
        return tuple(map(float, jax.block_until_ready(self.compiled(jnp.zeros(4)))))

    def state(self, q):
        """A of (omega w, v, f)' = A (omega w, v, f)."""
        c_D, m_H, c_H, k_H = q
        n, inverse = self.n, jnp.linalg.inv(self.mass + m_H * self.hose)
        stiffness = (E * self.bending + k_H * self.stretch) / self.omega
        A = jnp.zeros((2 * n + 1, 2 * n + 1)).at[:n, n:-1].set(jnp.diag(self.omega))
        A = A.at[n:-1, :n].set(-inverse @ stiffness)
        A = A.at[n:-1, n:-1].set(-inverse @ (c_D * self.bending + c_H * self.stretch))
        return A.at[n:-1, -1].set(inverse @ self.tip)

    def residuals(self, x):
        """(4.1) minus the record, from the logarithms of the parameters over their starts."""
        A, tip = self.state(jnp.asarray(START) * jnp.exp(x)), self.tip / self.omega
        pulse = jax_expm(PULSE * A, max_squarings=64)
        half = pulse[:-1, :-1]
        first = half @ pulse[:-1, -1]
        if self.doubled:
            step, states = half @ half, first[:, None]
            while states.shape[1] < self.samples:
                states = jnp.hstack([states, step @ states])
                step = step @ step
            u = tip @ states[:self.n, :self.samples]
        else:
            step = jax_expm(DELTA * A[:-1, :-1], max_squarings=64)
            _, u = jax.lax.scan(lambda state, _: (step @ state, tip @ state[:self.n]), first,
                                length=self.samples)
        return (u[2:] - 2 * u[1:-1] + u[:-2]) / DELTA**2 - self.measured

    def search(self, x):
        """Levenberg and Marquardt's, with the Jacobian by forward differentiation."""
        both = jax.jacfwd(lambda x: (self.residuals(x),) * 2, has_aux=True)

        def improve(now):
            x, (jac, r), damping, _, count = now
            normal, slope, J = jac.T @ jac, jac.T @ r, r @ r
            step = -jnp.linalg.solve(normal + damping * jnp.diag(jnp.diag(normal)), slope)
            trial = both(x + step)
            J_there = trial[1] @ trial[1]
            better = J_there < J
            small = jnp.linalg.norm(step) < TOLERANCE * (TOLERANCE + jnp.linalg.norm(x))
            done = small | (better & (J - J_there < TOLERANCE * J))
            x, jac, r = (jnp.where(better, new, old) for new, old in
                         zip((x + step, *trial), (x, jac, r)))
            return x, (jac, r), damping * jnp.where(better, 0.1, 10), done, count + 1

        start = (x, both(x), 1e-3, False, 0)
        found = jax.lax.while_loop(lambda now: ~now[3] & (now[4] < 100), improve, start)
        return jnp.asarray(START) * jnp.exp(found[0])


class Posterior:
    """Draws of Table 4.1's parameters by others: every value above 0 as likely as any other
    beforehand, the noise integrated out: a density of J^(-m/2). The walks are over logarithms of
    the parameters over their starts, and count that in the density.

    estimates  where the walks begin
    """

    def __init__(self, model, estimates):
        self.model, self.begin = JaxModel(model, True), np.log(np.divide(estimates, START))
        self.half = len(model.measured) / 2
        self.many = jax.jit(jax.vmap(self.log_density))
        self.kernel = None

    def log_density(self, x):
        """But for a constant."""
        r = self.model.residuals(x)
        return jnp.sum(x) - self.half * jnp.log(r @ r)

    def by_emcee(self, steps, discard, seed, walkers=32):
        """(walkers, draws, 4) by walkers that stretch, half of them at a time in one call."""
        random = np.random.default_rng(seed)
        begin = self.begin + 0.01 * random.standard_normal((walkers, 4))
        sampler = emcee.EnsembleSampler(walkers, 4, lambda x: np.asarray(self.many(x)),
                                        vectorize=True)
        sampler.random_state = np.random.RandomState(seed).get_state()
        sampler.run_mcmc(begin, steps)
        return START * np.exp(sampler.get_chain(discard=discard).swapaxes(0, 1))

    def by_nuts(self, warmup, draws, seed):
        """(1, draws, 4) by NumPyro's NUTS with a dense mass matrix; the first call compiles."""
        if self.kernel is None:
            kernel = numpyro.infer.NUTS(potential_fn=lambda x: -self.log_density(x),
                                        dense_mass=True)
            self.kernel = numpyro.infer.MCMC(kernel, num_warmup=warmup, num_samples=draws,
                                             progress_bar=False)
        self.kernel.run(jax.random.PRNGKey(seed), init_params=jnp.asarray(self.begin))
        return START * np.exp(np.asarray(self.kernel.get_samples(group_by_chain=True)))


def effective(draws):
    """(parameters) effective sample sizes of (chains, draws, parameters), by NumPyro."""
    return numpyro.diagnostics.effective_sample_size(np.asarray(draws))


class FreeDecay:
    """Decaying modes and an offset, fitted by variable projection: amplitudes, phases and offset
    are linear; the Jacobian is Kaufman's.

    t, y  the record
    """

    def __init__(self, t, y):
        self.t, self.y, self.kept = t - t[0], y, None

    def evaluate(self, x):
        """Residuals and Jacobian; x: logarithms of damping and frequency, of each mode in turn."""
        if self.kept is None or not np.array_equal(self.kept[0], x):
            self.kept = (x.copy(), *self.project(np.exp(x)))
        return self.kept[1:]

    def project(self, values):
        modes, m = len(values) // 2, len(self.t)
        columns, slopes = np.ones((2 * modes + 1, m)), np.empty((2 * modes, m))
        motions = [np.exp(complex(-values[2 * k], values[2 * k + 1]) * self.t)
                   for k in range(modes)]
        for k, motion in enumerate(motions):
            columns[2 * k], columns[2 * k + 1] = motion.real, -motion.imag
        factor = cho_factor(columns @ columns.T, check_finite=False)
        c = cho_solve(factor, columns @ self.y, check_finite=False)
        for k, motion in enumerate(motions):
            slope = complex(*c[2 * k:2 * k + 2]) * motion * self.t
            slopes[2 * k] = -values[2 * k] * slope.real
            slopes[2 * k + 1] = -values[2 * k + 1] * slope.imag
        slopes -= cho_solve(factor, columns @ slopes.T, check_finite=False).T @ columns
        return c @ columns - self.y, slopes.T

    def fit(self, start):
        """J and the estimates."""
        self.kept = None
        found = least_squares(lambda x: self.evaluate(x)[0], np.log(start), method="lm",
                              jac=lambda x: self.evaluate(x)[1])
        return 2 * found.cost, np.exp(found.x)


    def log_density(self, x):
        """Of the values, each above 0 as likely as any other beforehand, times the change of
        variable; amplitudes, offset and noise are integrated out. But for a constant."""
        values = np.exp(x)
        columns = self.columns(values)
        products = columns @ columns.T
        left = self.y - np.linalg.solve(products, columns @ self.y) @ columns
        free = len(self.t) - len(columns)
        return np.sum(x) - free / 2 * math.log(left @ left) - np.linalg.slogdet(products)[1] / 2

    def columns(self, values):
        """(5, m) of the linear unknowns."""
        motions = [np.exp(complex(-damping, omega) * self.t)
                   for damping, omega in zip(values[::2], values[1::2])]
        return np.array([part for motion in motions for part in (motion.real, motion.imag)]
                        + [np.ones_like(self.t)])

    def by_emcee(self, start, steps, discard, seed, walkers=32):
        """(walkers, draws, 4) by walkers that stretch."""
        random = np.random.default_rng(seed)
        residual, jacobian = self.evaluate(np.asarray(start))
        deviation = np.linalg.inv(np.linalg.cholesky(jacobian.T @ jacobian / np.mean(residual**2)))
        begin = start + random.standard_normal((walkers, len(start))) @ deviation
        sampler = emcee.EnsembleSampler(walkers, len(start), self.log_density)
        sampler.random_state = np.random.RandomState(seed).get_state()
        sampler.run_mcmc(begin, steps)
        return np.exp(sampler.get_chain(discard=discard).swapaxes(0, 1))


class PlainDecay(FreeDecay):
    """The same without thought: numpy.linalg.lstsq, and differences for the Jacobian."""

    def fit(self, start):
        found = least_squares(lambda x: self.left(np.exp(x)), np.log(start), method="lm")
        return 2 * found.cost, np.exp(found.x)

    def left(self, values):
        """Residuals."""
        columns = self.columns(values).T
        return columns @ np.linalg.lstsq(columns, self.y)[0] - self.y


class HermiteBeam:
    """The strip clamped at its root, by Hermite elements, with a sensor at the nearest node: its
    accelerance at the sensor, by numpy.linalg.solve line by line, and derivatives by E, m_S, c_D
    and gamma."""

    def __init__(self, elements, length, rho, inertia, place):
        h, n = length / elements, 2 * elements + 2
        bend = inertia / h**3 * np.array([[12, 6 * h, -12, 6 * h], [6 * h, 4 * h * h, -6 * h,
                                          2 * h * h], [-12, -6 * h, 12, -6 * h],
                                          [6 * h, 2 * h * h, -6 * h, 4 * h * h]])
        carry = h / 420 * np.array([[156, 22 * h, 54, -13 * h], [22 * h, 4 * h * h, 13 * h,
                                    -3 * h * h], [54, 13 * h, 156, -22 * h],
                                    [-13 * h, -3 * h * h, -22 * h, 4 * h * h]])
        bending, inertia = np.zeros((n, n)), np.zeros((n, n))
        for e in range(elements):
            part = slice(2 * e, 2 * e + 4)
            bending[part, part] += bend
            inertia[part, part] += carry
        self.rho, self.bending, self.inertia = rho, bending[2:, 2:], inertia[2:, 2:]
        self.o = np.zeros(n - 2)
        self.o[2 * round(place / h) - 2] = 1

    def evaluate(self, values, s):
        """(lines, 5) accelerance and derivatives; the force acts at the sensor, so that one
        solution is enough."""
        E, m_S, c_D, gamma = values
        point = np.outer(self.o, self.o)
        M = self.rho * self.inertia + m_S * point
        C = c_D * self.bending + gamma * self.inertia
        K = E * self.bending
        found = np.empty((len(s), 5), complex)
        for row, z in zip(found, s):
            q = np.linalg.solve((z * M + C) * z + K, self.o)
            bend, carry, tip = q @ self.bending @ q, q @ self.inertia @ q, self.o @ q
            row[:] = z * z * np.array([tip, -bend, -z * z * tip * tip, -z * bend, -z * carry])
        return found


def reference_dgeqrf():
    """Netlib's own QR, as Debian has it beside others; None where it is not installed."""
    paths = [sorted(glob.glob(f"/usr/lib/*/{name}/lib{name}.so.3")) for name in ("blas", "lapack")]
    if not all(paths):
        return None
    ctypes.CDLL(paths[0][0], mode=ctypes.RTLD_GLOBAL)    # before LAPACK asks for any libblas.so.3
    return ctypes.CDLL(paths[1][0]).dgeqrf_


def qr_by_reference(dgeqrf, a):
    """QR of a (columns contiguous), in place."""
    def pointer(array):
        return array.ctypes.data_as(ctypes.c_void_p)

    m, n = (ctypes.c_int(size) for size in a.shape)
    tau, work, info = np.empty(a.shape[1]), np.empty(64 * a.shape[1]), ctypes.c_int()
    dgeqrf(ctypes.byref(m), ctypes.byref(n), pointer(a), ctypes.byref(m), pointer(tau),
           pointer(work), ctypes.byref(ctypes.c_int(len(work))), ctypes.byref(info))


def qr_by_scipy(a):
    """The same by the LAPACK that SciPy brings."""
    lapack.dgeqrf(a, lwork=64 * a.shape[1], overwrite_a=True)
