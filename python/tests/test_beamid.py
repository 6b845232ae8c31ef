"""The package against the program, against differences, and against what should be refused."""
import json
import os
import subprocess
import threading
from pathlib import Path

import numpy as np
import pytest

import beamid

CHECKOUT = Path(__file__).resolve().parents[2]
DATA = CHECKOUT / "data"
MODEL = dict(
    beam=dict(length=4.0, rho=0.03, E=80.0, I=1.0, c_D=0.0035), tip=dict(m_T=0.15),
    hose=dict(m_H=0.035, c_H=0.0035, k_H=0.4),
    excitation=dict(kind="pulse", amplitude=1.0, duration=0.05),
    discretization=dict(degree=3, elements=4, gauss_points=2, panels=4),
    observation=dict(formula="displacement_difference", delta=0.1))
FREE = ["c_D", "m_H", "c_H", "k_H"]
# The row N = 4 of Table 4.1 as NASA CR-178199 prints it, of a record that was simulated otherwise;
# c_D, which such a record hardly determines, left out.
PAPER = {"m_H": 0.039777, "c_H": 0.003997, "k_H": 0.299455}


@pytest.fixture(scope="module")
def record():
    return np.loadtxt(DATA / "table_4_1_record.csv", delimiter=",", skiprows=1).T


@pytest.fixture(scope="module")
def problem(record):
    return beamid.Problem(*record, free=FREE, **MODEL)


@pytest.fixture(scope="module")
def fit(problem):
    return problem.fit()


def test_estimates_are_those_of_the_program(fit, tmp_path):
    """To 1e-12: the same library, the same case, nothing but the way in differs."""
    program = os.environ.get("BEAMID_PROGRAM")
    if not program:
        pytest.skip("BEAMID_PROGRAM names no program")
    case = tmp_path / "case.nml"
    case.write_text((DATA / "table_4_1_fit.nml").read_text()
                    .replace("file='", f"file='{DATA}/").replace("elements=2,3,4,5,6", "elements=4")
                    .replace("method='cvode', rtol=1e-11", "method='modal'")
                    .replace(", t_first=0.2, t_last=5.0, t_step=0.1", ""))
    out = tmp_path / "out"
    subprocess.run([program, "identify", str(case), "--out", str(out), "--quiet"], check=True,
                   capture_output=True)
    rows = [line.split(",") for line in (out / "estimates.csv").read_text().splitlines()]
    column = {name: k for k, name in enumerate(rows[0])}
    for row in rows[1:5]:
        e = fit[row[column["parameter"]]]
        assert e.value == pytest.approx(float(row[column["estimate"]]), rel=1e-12)
        assert e.std_error == pytest.approx(float(row[column["std_error"]]), rel=1e-12)
        assert e.interval == pytest.approx((float(row[column["total_lower95"]]),
                                            float(row[column["total_upper95"]])), rel=1e-12)
    assert fit.J == pytest.approx(float(rows[5][column["estimate"]]), rel=1e-12)
    loaded = beamid.load(case).fit()
    assert loaded.names == fit.names and (loaded.values == fit.values).all()
    unit = column["unit"]
    for mine, of_program in zip(fit.tables["estimates.csv"].splitlines()[1:], rows[1:]):
        mine = mine.split(",")
        assert [x for k, x in enumerate(mine) if k != unit] == \
            [x for k, x in enumerate(of_program) if k != unit]


def test_estimates_are_those_of_the_paper(fit):
    """Within 1 %: the estimates of the paper's own rows differ by that from mesh to mesh."""
    for name, printed in PAPER.items():
        assert fit[name].value == pytest.approx(printed, rel=1e-2)


def test_arrays_fit_together(fit, record):
    """Statistics by numpy from residuals and Jacobian; 1e-9 as the condition is some 1e3."""
    m, n = fit.jacobian.shape
    assert (m, n) == (record.shape[1], len(FREE)) and len(fit) == n
    assert fit.residuals @ fit.residuals == pytest.approx(fit.J, rel=1e-12)
    variance = fit.J/(m - n)
    covariance = variance*np.linalg.inv(fit.jacobian.T @ fit.jacobian)
    np.testing.assert_allclose(fit.covariance, covariance, rtol=1e-9)
    np.testing.assert_allclose([fit[name].std_error for name in fit],
                               np.sqrt(np.diag(covariance)), rtol=1e-9)
    np.testing.assert_array_equal(fit.t, record[0])
    np.testing.assert_array_equal(fit.measured, record[1])
    # At a minimum the gradient vanishes against its terms: ftol 1e-14 leaves its square root.
    gradient = fit.jacobian.T @ fit.residuals
    scale = np.linalg.norm(fit.jacobian, axis=0)*np.linalg.norm(fit.residuals)
    assert (abs(gradient) < 1e-6*scale).all()


def test_band_of_the_model(fit):
    """fit.csv: the curve's standard deviation is that of J C J', for the noise as it is."""
    rows = [line.split(",") for line in fit.tables["fit.csv"].splitlines()]
    found = np.array([float(row[rows[0].index("model_sd")]) for row in rows[1:]])
    table = [line.split(",") for line in fit.tables["estimates.csv"].splitlines()]
    plain, corrected = (np.array([float(row[table[0].index(name)]) for row in table[1:5]])
                        for name in ("std_error", "std_error_corrected"))
    ratio = corrected/plain
    covariance = fit.covariance*np.outer(ratio, ratio)
    expected = np.sqrt(np.einsum("ij,jk,ik->i", fit.jacobian, covariance, fit.jacobian))
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_modes_and_text(fit):
    assert [mode.record for mode in fit.modes] == [1]*len(fit.modes)
    for mode in fit.modes:
        if mode.s.imag:
            assert mode.frequency == pytest.approx(abs(mode.s)/(2*np.pi), rel=1e-14)
            assert mode.damping_ratio == pytest.approx(-mode.s.real/abs(mode.s), rel=1e-12)
    assert "every source of error" in fit.summary and fit.no_fit == ""
    assert all(name in repr(fit) for name in FREE)


def test_pandas(fit):
    pandas = pytest.importorskip("pandas")
    frame = fit.to_pandas()
    assert isinstance(frame, pandas.DataFrame) and list(frame.parameter) == [*FREE, "J"]
    np.testing.assert_array_equal(frame.estimate[:4], fit.values)
    assert {"frequency_hz", "damping_ratio"} <= set(fit.to_pandas("modes").columns)
    with pytest.raises(KeyError, match="nonsense: expected one of .*estimates.csv"):
        fit.to_pandas("nonsense")


def test_arrays_outlive_their_fit(problem):
    values = problem.fit(judge=False).residuals
    again = [problem.fit(judge=False).residuals.copy() for _ in range(50)]
    assert all((values == other).all() for other in again)


def test_arrays_stay_when_their_fit_is_judged(problem):
    fit = problem.fit(judge=False)
    values, t = fit.values, fit.t
    before = values.copy(), t.copy()
    assert len(fit.estimates) == len(FREE) and fit.values.ctypes.data == values.ctypes.data
    assert (values == before[0]).all() and (t == before[1]).all()


def test_start_values(problem, fit):
    """Another start ends in the same minimum, as well as the search stops: 1e-6."""
    other = problem.fit([0.006, 0.045, 0.003, 0.25], judge=False)
    np.testing.assert_allclose(other.values, fit.values, rtol=1e-6)
    assert other.estimates["k_H"].start == 0.25
    with pytest.raises(beamid.InputError, match="found 2 start values, expected 4"):
        problem.fit([1.0, 2.0])


def test_two_threads(problem, fit):
    """The same bits from two threads at once as from one, of one problem and of text."""
    found = {}

    def work(number):
        plain = {problem.fit(judge=False).values.tobytes() for _ in range(300)}
        judged = [problem.fit() for _ in range(5)]
        found[number] = (plain, {f.values.tobytes() for f in judged}, {f.summary for f in judged})

    threads = [threading.Thread(target=work, args=(k,)) for k in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found[0] == found[1] == ({problem.fit(judge=False).values.tobytes()},
                                    {fit.values.tobytes()}, {fit.summary})


def test_nothing_leaks(problem, record):
    """Memory stays after the first fits: 4000 more of 49 x 4 doubles would be 6 MB."""
    def resident():
        return int(Path("/proc/self/statm").read_text().split()[1])*os.sysconf("SC_PAGE_SIZE")

    def go_round(times):
        for k in range(times):
            problem.fit(judge=False).residuals
            if k % 20 == 0:
                beamid.Problem(*record, free=FREE, **MODEL).fit().estimates
                with pytest.raises(beamid.InputError):
                    beamid.Problem(*record, free=["none"], **MODEL)

    if not Path("/proc/self/statm").exists():
        pytest.skip("no /proc")
    go_round(1000)
    before = resident()
    go_round(4000)
    assert resident() - before < 2e6


@pytest.mark.parametrize("kind", ["pulse", "release"])
def test_response_and_derivatives(kind):
    """Derivatives against central differences; their own error is some 1e-7 of the largest."""
    t = np.linspace(0.1, 5, 50)
    model = dict(MODEL)
    if kind == "release":
        model["excitation"] = dict(kind="release", displacement=0.1)
    names = ["E", "c_D", "m_T", "k_H"]
    places = {"E": "beam", "c_D": "beam", "m_T": "tip", "k_H": "hose"}
    there = beamid.response(t, derivatives=names, **model)
    for name in names:
        value = model[places[name]][name]
        sides = []
        for step in (1e-5, -1e-5):
            group = {**model[places[name]], name: value*(1 + step)}
            sides.append(beamid.response(t, **{**model, places[name]: group}).acceleration)
        difference = (sides[0] - sides[1])/(2e-5*value)
        np.testing.assert_allclose(there.derivatives[name], difference,
                                   atol=1e-6*abs(difference).max())
    assert there.displacement.shape == there.velocity.shape == t.shape


def test_derivative_by_a_spring():
    """By k_R itself, though a search looks for 1/k_R."""
    t = np.linspace(0.1, 5, 50)

    def at(k_R, **more):
        return beamid.response(t, **{**MODEL, "beam": {**MODEL["beam"], "k_R": k_R}}, **more)

    difference = (at(500.05).acceleration - at(499.95).acceleration)/0.1
    np.testing.assert_allclose(at(500.0, derivatives="k_R").derivatives["k_R"], difference,
                               atol=1e-6*abs(difference).max())


def test_several_records(record):
    """Two halves of a record share their parameters; the estimates stay within their intervals."""
    t, a = record
    halves = [beamid.Record(t[::2], a[::2]), beamid.Record(t[1::2], a[1::2])]
    both = beamid.fit(records=halves, free=FREE, shared=FREE, **MODEL)
    assert both.names == FREE and both.residuals.size == t.size
    for name, printed in PAPER.items():
        assert both[name].value == pytest.approx(printed, rel=2e-2)


def test_free_decay_with_its_own_start():
    """A motion from an unknown start, offset included: truth inside, start values by the record."""
    strip = dict(length=0.5, width=0.03, height=0.002, density=7850.0, E=2.0e11, c_D=2e6)
    t = np.arange(0, 3, 1/500)
    moved = beamid.response(t, beam=strip, tip=dict(m_T=0.02), excitation=dict(
        kind="release", displacement=0.01)).acceleration
    noise = np.random.default_rng(20261122).normal(0, 0.02, t.size)
    strip = {**strip, "E": 1.7e11}
    found = beamid.fit(t, moved + noise + 0.3, beam=strip, tip=dict(m_T=0.02),
                       excitation=dict(kind="free", modes=2), free=["E", "c_D", "offset"])
    assert found["E"].interval[0] < 2.0e11 < found["E"].interval[1]
    assert found["offset"].value == pytest.approx(0.3, abs=0.02)


def test_no_fit_is_raised_with_its_evidence(record):
    t, a = record
    with pytest.raises(beamid.NoFit, match="the model explains") as caught:
        beamid.fit(t, a[::-1].copy(), free=["c_D"], **MODEL)
    assert caught.value.fit.no_fit == str(caught.value)
    assert "no fit" in repr(caught.value.fit)


@pytest.mark.parametrize("change, message", [
    (dict(free=["c_D", "m_Q"]), r"&stage free: found 'm_Q', expected one of"),
    (dict(beam=dict(MODEL["beam"], E=-1)), r"&beam E: found -1, expected a value above 0"),
    (dict(beam=dict(MODEL["beam"], EE=1)), r"&beam EE: .*perhaps E"),
    (dict(beam=4), r"beam: found 4, expected its keys"),
    (dict(baem=MODEL["beam"]), r"found baem, expected .*beam"),
    (dict(beam=dict(MODEL["beam"], E=True)), r"found True, expected a number"),
    (dict(record=dict(t_first=7.0)), r"record 1: .*expected"),
    (dict(excitation=None), r"&excitation: found no such group, expected one"),
])
def test_bad_input(record, change, message):
    arguments = {**MODEL, "free": FREE, **change}
    with pytest.raises(beamid.InputError, match=message):
        beamid.fit(*record, **arguments)


@pytest.mark.parametrize("t, a, message", [
    ([], [], "found 0 times and 0 values"),
    ([0.0, 1.0], [1.0], "found 2 times and 1 values"),
    ([0.0, 0.2, 0.1, 0.3, 0.4], [1.0, 2, 3, 4, 5], r"sample 3: found t = 0?\.1 after 0?\.2"),
    ([0.0, 0.1, 0.2, 0.3, 0.4], [1.0, np.nan, 3, 4, 5], "sample 2: .*expected finite"),
    ([0.0, 0.1, 0.2, 0.3, 0.4], [1.0]*5, "constant signal"),
])
def test_bad_records(t, a, message):
    with pytest.raises(beamid.InputError, match=message):
        beamid.fit(t, a, free=FREE, **MODEL)


def test_bad_responses():
    with pytest.raises(beamid.InputError, match="do not grow"):
        beamid.response([1.0, 0.5], **MODEL)
    with pytest.raises(beamid.InputError, match="'free', expected a start that is known"):
        beamid.response([0.0, 1.0], **{**MODEL, "excitation": dict(kind="free")})
    with pytest.raises(beamid.InputError, match="found 'cvode', expected 'modal'"):
        beamid.response([0.0, 1.0], derivatives="E", **MODEL, integrator=dict(method="cvode"))
    with pytest.raises(beamid.InputError, match="nowhere.nml"):
        beamid.load("nowhere.nml")


def test_notebook(monkeypatch):
    """Every cell of the notebook runs, one after the other."""
    pytest.importorskip("matplotlib").use("Agg")
    pytest.importorskip("pandas")
    monkeypatch.chdir(CHECKOUT / "python")
    cells = json.loads(Path("first_fit.ipynb").read_text())["cells"]
    code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    assert len(code) > 4
    space = {}
    for source in code:
        exec(compile(source, "first_fit.ipynb", "exec"), space)
    assert space["fit"].no_fit == ""


NOISY = DATA / "table_4_1_noisy.nml"
COMMANDS = {"profile": beamid.profile, "sample": beamid.sample, "bootstrap": beamid.bootstrap}


def test_inference_is_that_of_the_program(tmp_path):
    """Files, intervals and what is printed, to the last character; arrays to the last digit."""
    program = os.environ.get("BEAMID_PROGRAM")
    if not program:
        pytest.skip("BEAMID_PROGRAM names no program")
    fit = beamid.load(NOISY).fit()
    for command, call in COMMANDS.items():
        out = tmp_path / "out"    # one folder: intervals of earlier commands stay, as in a fit
        subprocess.run([program, command, str(NOISY), "--out", str(out), "--quiet"], check=True,
                       capture_output=True)
        found = call(fit)
        for name, text in found.tables.items():
            assert text == (out / name).read_text(), name
        assert found.summary.split() == (out / "intervals.txt").read_text().split()
        rows = [line.split(",") for line in (out / "intervals.csv").read_text().splitlines()[1:]]
        assert [(i.method, i.parameter, i.lower, i.upper) for i in found.intervals] == \
            [(row[0], row[2], float(row[5]), float(row[6])) for row in rows]
    assert found.interval("c_D", "bca").lower > found.interval("c_D", "linear").lower
    with pytest.raises(KeyError, match="c_D, guess: expected one of"):
        found.interval("c_D", "guess")
    draws = np.loadtxt(tmp_path / "out" / "posterior.csv", delimiter=",", skiprows=1)
    posterior = beamid.sample(NOISY)
    assert posterior.names == FREE and posterior.draws.shape == (4, 2500, 4)
    for chain in range(4):
        mine = draws[draws[:, 0] == chain]
        assert (posterior.draws[chain] == mine[:, 4:]).all()
        assert (posterior.log_density[chain] == mine[:, 3]).all()
    resampled = np.loadtxt(tmp_path / "out" / "bootstrap.csv", delimiter=",", skiprows=1)
    assert (beamid.bootstrap(NOISY).estimates == resampled[:, 2:]).all()


def test_inference_takes_the_arguments_of_a_fit():
    """The keys of &sample and &bootstrap as groups, records in memory, profiles as arrays."""
    t, a = np.loadtxt(DATA / "table_4_1_noisy.csv", delimiter=",", skiprows=1).T
    keys = dict(free=FREE, start=[0.0035, 0.035, 0.0035, 0.4], **MODEL)
    few = beamid.sample(t, a, sample=dict(draws=400, seed=7), **keys)
    again = beamid.sample(t, a, sample=dict(draws=400, seed=7), **keys)
    other = beamid.sample(t, a, sample=dict(draws=400, seed=8), **keys)
    assert few.draws.shape == (4, 100, 4)
    assert (few.draws == again.draws).all() and not (few.draws == other.draws).any()
    assert beamid.bootstrap(t, a, bootstrap=dict(n=100), **keys).estimates.shape == (100, 4)
    profile = few["c_D"]
    ends = few.interval("c_D", "profile")
    assert (np.diff(profile.value) > 0).all() and profile.ends == ("closed", "closed")
    assert profile.value[[0, -1]] == pytest.approx((ends.lower, ends.upper), rel=1e-6)
    assert profile.distance[[0, -1]] == pytest.approx((-1, 1), abs=1e-6)
    best = profile.parameters[np.argmin(profile.J)]
    assert best == pytest.approx(few.fit.values, rel=1e-12)
    with pytest.raises(beamid.InputError, match="draws"):
        beamid.sample(t, a, sample=dict(draws=-1), **keys)
    with pytest.raises(TypeError, match="found arguments behind a case file"):
        beamid.sample(NOISY, free=FREE)


def test_no_fit_has_no_intervals(record):
    """The program's sentence, and the search as its evidence; also of a fit without a verdict."""
    t, a = record
    for call in COMMANDS.values():
        with pytest.raises(beamid.NoFit, match="the model explains") as caught:
            call(t, a[::-1].copy(), free=["c_D"], **MODEL)
        assert caught.value.fit.no_fit == str(caught.value)
    fit = beamid.Problem(t, a[::-1].copy(), free=["c_D"], **MODEL).fit(judge=False)
    with pytest.raises(beamid.NoFit, match="the model explains"):
        beamid.profile(fit)


def test_arviz_agrees_about_the_draws():
    """Bulk and tail sizes and the potential scale reduction: ours are those of Vehtari et al. as
    ArviZ has them; 3 % for quantiles and ranks of ties taken otherwise."""
    arviz = pytest.importorskip("arviz")
    posterior = beamid.sample(NOISY)
    data = posterior.to_arviz()
    assert data.posterior["c_D"].shape == (4, 2500)
    assert (data.sample_stats["lp"].values == posterior.log_density).all()
    bulk, tail, reduction = (arviz.ess(data, method="bulk"), arviz.ess(data, method="tail"),
                             arviz.rhat(data))
    lines = [line.split() for line in posterior.summary.splitlines()]
    start = next(k for k, line in enumerate(lines) if line[:2] == ["mean", "sd"])
    for line in lines[start + 1:start + 5]:
        name, _, _, *told = line
        theirs = [float(result[name]) for result in (bulk, tail, reduction)]
        assert [float(x) for x in told[:2]] == pytest.approx(theirs[:2], rel=0.03), name
        assert float(told[2]) == pytest.approx(theirs[2], abs=2e-3), name


def test_tables_of_inference_as_frames():
    pytest.importorskip("pandas")
    found = beamid.profile(NOISY)
    assert set(found.to_pandas().method) == {"linear", "profile"}
    assert set(found.to_pandas("profiles").parameter) == set(FREE)
    with pytest.raises(KeyError, match="guess: expected one of"):
        found.to_pandas("guess")
