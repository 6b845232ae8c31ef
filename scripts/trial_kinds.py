"""The kinds of trials of scripts/trials.py: random strips, their records, and cases that fit them.

Each kind is a function of a random generator and the number of the trial, and returns one or more
trials. Import this module after `need("numpy", "scipy")` of program.py.
"""

from dataclasses import dataclass, field

import numpy as np

from strips import Motion, Strip

MATERIALS = (7e10, 2700.0), (2.05e11, 7850.0)    # E [N/m^2], density [kg/m^3] of aluminium, steel
FREE = "'E','m_S','c_D','gamma','offset'"
SAMPLES = 4000    # in the window of a free decay, at most
ERRORS = ("damping", "hardening", "mass", "clamp")


@dataclass
class Trial:
    """A case, its tables (name: columns) and the true values by their names in estimates.csv."""

    sort: str
    groups: list
    tables: dict
    truth: dict = field(default_factory=dict)
    command: str = "identify"


def between(random, low, high):
    """A random number, uniform in its logarithm."""
    return low * (high / low)**random.uniform()


def laboratory(random, thickness=(0.6e-3, 1.5e-3), **values):
    """A random strip of aluminium or steel with a sensor."""
    E, density = MATERIALS[random.integers(2)]
    E *= random.uniform(0.95, 1.05)
    length, width = random.uniform(0.3, 0.6), random.uniform(0.02, 0.03)
    height = random.uniform(*thickness)
    omega = 3.516 * np.sqrt(E * height**2 / 12 / density) / length**2
    air = between(random, 0.001, 0.006)    # damping ratio
    return Strip(**dict(
        length=length, width=width, height=height, density=density, E=E,
        c_D=E * between(random, 5e-6, 4e-5), gamma=2 * air * omega * density * width * height,
        m_S=random.uniform(0.002, 0.01), x_S=length * random.uniform(0.3, 0.95)) | values)


def sampled(random, motion, visible, late=0.0):
    """Times of a free decay in which the visible modes are below the Nyquist frequency."""
    highest = motion.omega[visible - 1] / (2 * np.pi)
    rates = [rate for rate in (200, 250, 400, 500, 1000) if rate > 2.5 * highest] or [2000]
    rate = random.choice(rates)
    decay = -motion.poles.real[np.argmin(np.abs(np.abs(motion.poles) - motion.omega[0]))]
    seconds = min(np.clip(random.uniform(1, 3) / decay, 3, 20), SAMPLES / rate)
    return np.arange((late + seconds) * rate) / rate


def twelve_bits(random, a, offset=0.0):
    """A record as a sensor of 12 bits with a little noise and an offset shows it."""
    step = 2.5 * np.abs(a).max() / 4096
    return step * np.round((a + offset) / step + random.normal(0, 0.4, len(a)))


def decay_case(strip, modes, wrong, tables, *groups, free=FREE, **record):
    """A trial of a free decay."""
    truth = {name: getattr(strip, name) for name in ("E", "m_S", "c_D", "gamma")
             if f"'{name}'" in free}
    return Trial("", [*strip.groups(**wrong), ("excitation", dict(kind="'free'", modes=modes)),
                      ("record", dict(file="'record.csv'", **record)), *groups,
                      ("stage", dict(free=free))], tables, truth)


def guesses(random, strip, E, m_S, damping):
    """Wrong values for a case, within shares of E and m_S and by up to a factor of the damping."""
    return dict(E=strip.E * random.uniform(1 - E, 1 + E),
                m_S=strip.m_S * random.uniform(1 - m_S, 1 + m_S),
                c_D=strip.c_D * between(random, 1 / damping, damping),
                gamma=strip.gamma * between(random, 1 / damping, damping))


def hard(random, _):
    """A measured strip: what an amateur's sensor adds to the record."""
    strip = laboratory(random)
    motion, modes = Motion(strip), random.integers(2, 4)
    t = sampled(random, motion, modes)
    state = motion.deflected(random.uniform(0.005, 0.03),
                             [1, between(random, 0.01, 0.4), between(random, 0.003, 0.1)][:modes])
    a = motion.free(t, state)
    first = np.argmin(np.abs(motion.poles - 1j * motion.omega[0]))
    size = np.abs(2 * motion.residues(state)[first])
    sort, others = f"m{modes}", random.choice(np.arange(2, 8), 2, replace=False)
    for n in others[:random.choice(3)]:
        turn = 2j * np.pi * random.uniform()
        a += between(random, 0.01, 0.05) * size * np.exp(n * motion.poles[first] * t + turn).real
        sort += f"-x{n}"
    if random.uniform() < 0.6:
        a += between(random, 5e-4, 0.02) * size * np.sin(100 * np.pi * t + 6 * random.uniform())
        sort += "-mains"
    z = twelve_bits(random, a, random.uniform(-0.1, 0.1) * size)
    kept = np.ones(len(t), bool)
    for gap in random.integers(len(t), size=random.choice(4)):
        kept[gap:gap + int(random.uniform(0.01, 0.08) * len(t))] = False
    trial = decay_case(strip, modes, guesses(random, strip, 0.15, 0.4, 2),
                       {"record": (t[kept], z[kept])})
    trial.sort = sort
    return [trial]


def careless(random, _):
    """A plain strip, and a case that knows little."""
    strip = laboratory(random)
    motion, visible = Motion(strip), random.integers(1, 4)
    late = random.choice([0, random.uniform(0, 6)])
    t = sampled(random, motion, visible, late)
    a = motion.free(t, motion.deflected(random.uniform(0.005, 0.03), np.ones(visible)))
    wrong = guesses(random, strip, 0.3, 0, 2)
    wrong["m_S"] *= random.choice([3, 1 / 3])
    modes = random.integers(2, 4)
    trial = decay_case(strip, modes, wrong, {"record": (t, twelve_bits(random, a, 0.3))},
                       t_first=round(late, 3))
    trial.sort = f"m{modes}-seen{visible}-{'late' if late else 'start'}"
    return [trial]


def higher(random, _):
    """A strip from the instant of its release: the record holds more modes than the case."""
    strip = laboratory(random)
    strip.c_D = strip.E * between(random, 1e-5, 3e-4)
    motion, modes = Motion(strip), random.integers(2, 5)
    t = sampled(random, motion, min(modes + random.integers(0, 3), 5))
    a = motion.free(t, motion.deflected(random.uniform(0.005, 0.03)))
    wrong = guesses(random, strip, 0.15, 0.4, 2)
    noise = between(random, 0.002, 0.02) * a.std()
    trial = decay_case(strip, modes, wrong, {"record": (t, a + random.normal(0, noise, len(t)))})
    trial.sort = f"m{modes}"
    return [trial]


def folds(random, _):
    """A plain strip with two visible modes, whose frequencies belong to two values of m_S."""
    factors = np.array([1, 0.25, 0.5, 0.75, 1.33, 2, 3, 4, 6])
    sides = np.zeros(9)
    while not (np.ptp(sides[1:4]) or np.ptp(sides[4:])):    # a frequency ratio has an extremum
        strip = laboratory(random)
        first, second = np.transpose([Motion(Strip(
            **vars(strip) | dict(m_S=factor * strip.m_S)), 24).omega[:2] for factor in factors])
        sides = np.sign(second / first - second[0] / first[0])
    motion, modes = Motion(strip), 2
    t = sampled(random, motion, modes)
    a = motion.free(t, motion.deflected(0.02, np.ones(modes)))
    wrong = guesses(random, strip, 0.3, 0, 2)
    wrong["m_S"] *= random.choice([3, 1 / 3])
    trial = decay_case(strip, modes, wrong, {"record": (t, twelve_bits(random, a, 0.3))})
    trial.sort = "more" if wrong["m_S"] > strip.m_S else "less"
    return [trial]


def joint(random, _):
    """Four lengths of a strip in one elastic clamp."""
    strip = laboratory(random)
    strip.k_R = between(random, 20, 100) * strip.E * strip.width * strip.height**3 / 12 / 0.4
    wrong = guesses(random, strip, 0.05, 0.1, 1.5)
    groups, tables, truth = [], {}, {"E": strip.E, "k_R": strip.k_R}
    for k, length in enumerate(np.linspace(0.3, 0.6, 4) * random.uniform(0.9, 1.1), 1):
        error = np.clip(random.normal(0, 0.001), -0.002, 0.002)
        one = Strip(**vars(strip) | dict(
            length=length + error, x_S=length * random.uniform(0.5, 0.95),
            m_S=strip.m_S * random.uniform(0.8, 1.2)))
        motion = Motion(one)
        t = sampled(random, motion, 2)
        a = motion.free(t, motion.deflected(0.02, [1, between(random, 0.02, 0.4)]))
        tables[f"record_{k}"] = t, twelve_bits(random, a, 0.3)
        groups += [("record", dict(file=f"'record_{k}.csv'", length=length, x_S=one.x_S)),
                   ("prior", dict(parameter="'length'", sd=0.001, record=k))]
        truth[f"m_S({k})"] = one.m_S
        strip.x_S, strip.length = one.x_S, length
    stage = dict(free=f"{FREE},'k_R'", shared="'E','k_R','c_D','gamma'")
    truth |= dict(c_D=strip.c_D, gamma=strip.gamma)
    wrong["k_R"] = strip.k_R * between(random, 1 / 1.5, 1.5)
    groups = [*strip.groups("k_R", **wrong), ("excitation", dict(kind="'free'", modes=2)), *groups]
    return [Trial("auto", [*groups, ("stage", stage)], tables, truth),
            Trial("case", [*groups, ("stage", stage | dict(start="'case'"))], tables, truth)]


def errors(random, _):
    """Four records with something that the model does not have."""
    trials = []
    for sort in ERRORS:
        strip = laboratory(random)
        true = Strip(**vars(strip))
        if sort == "mass":
            true.masses = ((strip.length * random.uniform(0.2, 0.9), 0.003),)
        if sort == "clamp":
            true.k_R = 50 * strip.E * strip.width * strip.height**3 / 12 / strip.length
        motion, modes = Motion(true), random.integers(2, 4)
        t = sampled(random, motion, modes)
        state = motion.deflected(0.02, np.append(1, random.uniform(0.05, 0.5, modes - 1)))
        if sort in ("mass", "clamp"):
            a = motion.free(t, state)
        else:
            a = motion.nonlinear(t, state, *((0.1, 0) if sort == "damping" else (0, 0.01)))
        trial = decay_case(strip, modes, guesses(random, strip, 0.1, 0.2, 1.5),
                           {"record": (t, twelve_bits(random, a, 0.3))})
        trial.sort = sort
        if sort in ("damping", "hardening"):    # the damping has no constant true value
            trial.truth = {name: trial.truth[name] for name in ("E", "m_S")}
        trials.append(trial)
    return trials


def damage(random, _):
    """Four beams that were struck, three of them damaged."""
    trials = []
    for sort in ("dip", "cut", "crack", "sound"):
        strip = laboratory(random, (2e-3, 4e-3), m_S=0.0)
        strip.x_S = l = strip.length
        place, truth = l * random.uniform(0.1, 0.9), {}
        if sort == "dip":
            strip.dip = place, l * random.uniform(0.04, 0.1), random.uniform(0.1, 0.4)
        elif sort == "cut":
            strip.cut = place - l / 40, place + l / 40, random.uniform(0.1, 0.5)
        elif sort == "crack":
            stiffness = strip.E * strip.width * strip.height**3 / 12 / l
            strip.crack = place, stiffness / between(random, 0.005, 0.05)
        if sort != "sound":
            truth["place"] = place
        t = 0.01 + np.arange(1991) / 1000
        a = Motion(strip).pulse(t, 1, 0.005) + random.normal(0, 0.1, len(t))
        trials.append(Trial(sort, [
            *strip.groups(E=strip.E * random.uniform(0.98, 1.02)),
            ("along", dict(kind="'dip'", place=0.4 * l, width=0.08 * l, depth=0.1)),
            ("excitation", dict(kind="'pulse'", amplitude=1, duration=0.005)),
            ("discretization", dict(degree=5, elements=16)), ("record", dict(file="'record.csv'")),
            ("stage", dict(free="'E','c_D','gamma','place','width','depth'"))],
            {"record": (t, a)}, truth))
    return trials


def coverage(random, k):
    """A strip whose dimensions are known as well as the priors say. If m_S is not free, one or two
    modes are visible; with one, c_D is not free either."""
    sort, modes = (("free", 2), ("fixed", 1), ("fixed", 2))[k % 3]
    stated = laboratory(random)
    errors = dict(length=between(random, 2e-4, 1e-3), height=0.01 * stated.height,
                  m_S=between(random, 0.03, 0.2) * stated.m_S)
    wrong = guesses(random, stated, 0.1, 0, 2)
    if modes == 1:
        errors["c_D"], wrong["c_D"] = 0.2 * stated.c_D, stated.c_D
    true = Strip(**vars(stated) | {name: random.normal(getattr(stated, name), sd)
                                   for name, sd in errors.items()})
    motion = Motion(true)
    t = sampled(random, motion, modes)
    a = motion.free(t, motion.deflected(0.02, [1, between(random, 0.05, 0.5)][:modes]))
    free = FREE if sort == "free" else FREE.replace("'m_S',", "")
    trial = decay_case(
        true, modes, vars(stated) | wrong,
        {"record": (t, twelve_bits(random, a, 0.3))},
        *(("prior", dict(parameter=f"'{name}'", sd=sd)) for name, sd in errors.items()),
        free=free if modes > 1 else free.replace("'c_D',", ""))
    trial.sort = f"{sort}-m{modes}"
    return [trial]


def meshes(random, k):
    """A plain strip and a mesh that is too coarse."""
    strip = laboratory(random)
    motion = Motion(strip)
    t = sampled(random, motion, 2)
    a = motion.free(t, motion.deflected(0.02, [1, random.uniform(0.1, 0.5)]))
    trial = decay_case(strip, 2, guesses(random, strip, 0.1, 0.2, 1.5),
                       {"record": (t, twelve_bits(random, a, 0.3))},
                       ("discretization", dict(elements=2 + k % 3)))
    trial.sort = f"N{2 + k % 3}"
    return [trial]


def driven(random, sort, strip, elements=96, first=0.02, longest=6000):
    """Groups and tables of a record without noise, with a motion that the case describes."""
    motion = Motion(strip, elements)
    t = first + np.arange(between(random, 2000, longest)) / 1000
    if sort == "release":
        displacement = random.uniform(0.005, 0.03)
        return [("excitation", dict(kind="'release'", displacement=displacement))], {
            "record": (t, motion.free(t, motion.deflected(displacement)))}
    if sort == "pulse":
        return [("excitation", dict(kind="'pulse'", amplitude=0.5, duration=0.005))], {
            "record": (t, motion.pulse(t, 0.5, 0.005))}
    z = np.zeros(len(t))
    noise = np.convolve(random.normal(0, 10, 1001), np.ones(5) / 5, "same")
    z[:1001] = noise * np.hanning(1001)
    t, later = np.arange(len(t)) / 1000, round(1000 * first)
    return [("excitation", dict(kind="'base'", file="'base.csv'"))], {
        "base": (t[:1001], z[:1001]), "record": (t[later:], motion.base(0.001, z)[later:])}


def perfect(random, k):
    """A record of exactly the model of the case, with white noise."""
    sort, strip = ("free", "release", "pulse", "base")[k % 4], laboratory(random)
    wrong = guesses(random, strip, 0.01, 0.05, 1.3)
    if sort == "free":
        motion, modes = Motion(strip), random.integers(2, 4)
        t = sampled(random, motion, modes)
        a = motion.free(t, motion.deflected(0.02, np.append(1, random.uniform(0.05, 1, modes - 1))))
        trial = decay_case(strip, modes, wrong, {"record": (t, a)})
    else:
        groups, tables = driven(random, sort, strip, 160)
        trial = decay_case(strip, 0, wrong, tables)
        trial.groups[2:3] = groups
        t, a = tables["record"]
    trial.tables["record"] = t, a + random.normal(0, between(random, 0.001, 0.03) * a.std(), len(t))
    trial.sort = sort
    return [trial]


def generator(random, k):
    """A record to be compared with that of the program."""
    sort, strip = ("release", "pulse", "base")[k % 3], laboratory(random)
    l = strip.length
    strip.c_D = 1e-4 * strip.E    # so that high modes, which both meshes miss, end early
    strip.dip = random.uniform(0.2, 0.8) * l, 0.1 * l, 0.3
    strip.k_R = 50 * strip.E * strip.width * strip.height**3 / 12 / l
    groups, tables = driven(random, sort, strip, 192, 1.2, 2000)
    t = tables["record"][0]
    return [Trial(sort, [
        *strip.groups("k_R"), *groups,
        ("along", dict(kind="'dip'", **dict(zip(("place", "width", "depth"), strip.dip)))),
        ("discretization", dict(degree=5, elements=256)),
        ("record", dict(t_first=t[0], t_last=t[-1], t_step=0.001))], tables, {}, "simulate")]


KINDS = {f.__name__: f for f in (hard, careless, higher, folds, joint, errors, damage, coverage,
                                 meshes, perfect, generator)}
