"""Functions, pictures, copies and signatures, against the program's tables and against scipy."""
import builtins
import copy
import importlib
import inspect
import math
import multiprocessing
import os
import pickle
import re
import subprocess
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import beamid
from beamid import _library as library

CHECKOUT = Path(__file__).resolve().parents[2]
DATA = CHECKOUT / "data"
NOISY = DATA / "table_4_1_noisy.nml"
MODEL = dict(
    beam=dict(length=4.0, rho=0.03, E=80.0, I=1.0, c_D=0.0035), tip=dict(m_T=0.15),
    hose=dict(m_H=0.035, c_H=0.0035, k_H=0.4),
    excitation=dict(kind="pulse", amplitude=1.0, duration=0.05),
    discretization=dict(degree=3, elements=4),
    observation=dict(formula="displacement_difference", delta=0.1))
FREE = ["c_D", "m_H", "c_H", "k_H"]
NAMES = dict(units=dict(length="ft", force="lb", time="s", mass="slug"))


@pytest.fixture(scope="module")
def record():
    return np.loadtxt(DATA / "table_4_1_noisy.csv", delimiter=",", skiprows=1).T


@pytest.fixture(scope="module")
def fit(record):
    return beamid.fit(*record, free=FREE, **MODEL, **NAMES)


@pytest.fixture(scope="module")
def program():
    path = os.environ.get("BEAMID_PROGRAM")
    if not path:
        pytest.skip("BEAMID_PROGRAM names no program")

    def run(command, *cases, out):
        subprocess.run([path, command, *map(str, cases), "--out", str(out), "--quiet"], check=True,
                       capture_output=True)
        return {file.name: file.read_text() for file in Path(out).glob("*.*")}

    return run


def columns(text):
    """Columns of a table by name, as texts."""
    rows = [line.split(",") for line in text.splitlines()]
    return {name: [row[k] for row in rows[1:]] for k, name in enumerate(rows[0])}


def same_tables(found, files):
    """The same texts; the program alone copies the case and its units, which its report shows."""
    copies = {"case.txt", "labels.csv"}
    assert copies <= set(files)
    assert found.summary() == files["summary.txt"]
    assert set(found.tables) - copies == set(files) - {"summary.txt", "manifest.txt", *copies}
    for name, text in found.tables.items():
        assert text == files[name], name
    assert found._table + ".csv" in files


def test_simulate_is_that_of_the_program(program, tmp_path):
    """From the case file to the last character; from arguments to the last digit."""
    case = DATA / "table_4_1_truth.nml"
    files = program("simulate", case, out=tmp_path)
    found = beamid.simulate(case)
    same_tables(found, files)
    table = columns(files["response.csv"])
    last = [k for k, n in enumerate(table["elements"]) if n == table["elements"][-1]]
    for name in ("t", "acceleration", "displacement", "velocity", "force"):
        assert getattr(found, name).tolist() == [float(table[name][k]) for k in last]
    assert found.record.tolist() == list(map(float, columns(files["record.csv"])["acceleration"]))
    pandas = pytest.importorskip("pandas")
    assert isinstance(found.to_pandas(), pandas.DataFrame)
    assert list(found.to_pandas("record").columns) == ["t", "acceleration"]


def test_simulate_at_given_times():
    """The response at uneven times, the noise, and the units of the sensor."""
    t = np.array([0.2, 0.25, 0.4, 1.0])
    noise = dict(sd=0.01, seed=3)
    found = beamid.simulate(t, noise=noise, record=dict(scale=2.0, offset=0.5), **MODEL)
    exact = beamid.response(t, **MODEL)
    assert (found.t == t).all() and (found.acceleration == exact.acceleration).all()
    added = 2*(found.record - 0.5) - found.acceleration
    assert 0 < np.abs(added).max() < 0.05
    assert (beamid.simulate(t, noise=noise, **MODEL).record - found.acceleration
            == pytest.approx(added, abs=1e-14))
    with pytest.raises(beamid.InputError, match="not ascending"):
        beamid.simulate([0.2, 0.1], **MODEL)
    with pytest.raises(beamid.InputError, match="masked"):
        beamid.simulate([0.2, 0.3], noise=dict(sd=np.ma.masked), **MODEL)
    with pytest.raises(beamid.InputError, match="&record: found no such group"):
        beamid.simulate(**MODEL)
    with pytest.raises(beamid.InputError, match="found values of a record beside a case"):
        beamid.profile(DATA / "table_4_1_noisy.nml", [0.1])


def test_modes_are_those_of_the_program(program, tmp_path):
    files = program("modes", NOISY, out=tmp_path)
    same_tables(beamid.modes(NOISY), files)
    same_tables(beamid.modes(beamid.load(NOISY)), files)
    found = beamid.modes(NOISY)
    table = columns(files["modes.csv"])
    assert found.frequencies.tolist() == list(map(float, table["frequency_hz"]))
    assert found.s.imag.tolist() == list(map(float, table["imag"]))
    assert found.shapes.shape == (6, 101) and found.x[-1] == 4.0
    np.testing.assert_allclose(-found.s.real/abs(found.s), found.damping_ratios, rtol=1e-12,
                               atol=1e-15)


def test_modes_of_a_changed_structure_are_not_fitted():
    """The record belongs to the structure that was measured: with another tip mass, the modes are
    those of the values that are given."""
    problem = beamid.load(NOISY)
    assert "modes_fitted.csv" in beamid.modes(problem).tables
    found = beamid.modes(problem, tip=dict(m_T=0.3))
    assert "modes_fitted.csv" not in found.tables
    assert found.frequencies[0] < beamid.modes(problem).frequencies[0]
    lines = dict(f_first=0.1, f_last=1, f_step=0.1)
    assert beamid.frf(problem, tip=dict(m_T=0.3), record=lines).band is None


def test_modes_and_responses_of_a_fit_are_those_of_its_problem():
    """Modes with intervals, and a frequency response with its band, from a record in time; other
    arguments change the structure, which was not measured."""
    problem = beamid.load(NOISY)
    fit = problem.fit()
    fitted = beamid.modes(fit)
    assert fitted.tables["modes_fitted.csv"] == beamid.modes(problem).tables["modes_fitted.csv"]
    assert "modes_fitted.csv" not in beamid.modes(fit, tip=dict(m_T=0.3)).tables
    lines = dict(f_first=0.1, f_last=1, f_step=0.1)
    found = beamid.frf(fit, record=lines)
    assert found.tables == beamid.frf(problem, record=lines).tables
    assert (found.band[:, 0] < abs(found.h)).all() and (abs(found.h) < found.band[:, 1]).all()
    estimates = {name: fit[name].value for name in FREE}
    beam, tip = dict(MODEL["beam"], c_D=estimates.pop("c_D")), MODEL["tip"]
    bare = beamid.frf(record=lines, beam=beam, tip=tip, hose=estimates,
                      discretization=dict(degree=3, elements=4))
    np.testing.assert_allclose(found.h, bare.h, rtol=1e-9)
    with pytest.raises(beamid.InputError, match="expected one, with f_first, f_last and f_step"):
        beamid.frf(fit)
    memory = beamid.fit(fit.t, fit.measured, free=FREE, start=[0.0035, 0.035, 0.0035, 0.4], **MODEL)
    assert beamid.frf(memory, record=lines).band.tolist() == found.band.tolist()


def test_modes_of_a_bare_beam():
    """Frequencies and shapes of a clamped beam from its characteristic equation, by scipy. The mesh
    of 32 elements of degree 5 is exact to 1e-9 for the first three modes."""
    optimize = pytest.importorskip("scipy.optimize")
    beam = dict(length=0.5, rho=0.471, E=2e11, I=2e-11)
    found = beamid.modes(beam=beam, discretization=dict(degree=5, elements=32))
    roots = [optimize.brentq(lambda z: np.cos(z)*np.cosh(z) + 1, lower, lower + 2, xtol=1e-14)
             for lower in (1, 4, 7)]
    omega = np.array(roots)**2*np.sqrt(beam["E"]*beam["I"]/beam["rho"])/beam["length"]**2
    np.testing.assert_allclose(found.frequencies[:3], omega/(2*np.pi), rtol=1e-9)
    z = roots[1]
    ratio = (np.sinh(z) - np.sin(z))/(np.cosh(z) + np.cos(z))
    x = z*found.x/beam["length"]
    shape = np.cosh(x) - np.cos(x) - ratio*(np.sinh(x) - np.sin(x))
    mine = found.shapes[1].real
    np.testing.assert_allclose(mine/mine[-1], shape/shape[-1], atol=1e-7)


def test_modes_of_a_free_bar():
    """Rigid-body modes count, but have no shape: the first shape is that of mode 3, with the two
    nodes and the frequency of the first bending mode of a free bar (4.7300 is a root of
    cos z cosh z = 1). Titles and labels say so, with units."""
    pytest.importorskip("matplotlib").use("Agg")
    from matplotlib import pyplot
    beam = dict(length=0.5, width=0.03, height=0.003, density=2700, E=7e10)
    ends = [dict(at="root", kind="free"), dict(at="tip", kind="free")]
    found = beamid.modes(beam=beam, end=ends, units=dict(length="m", time="s"))
    radius = beam["height"]/np.sqrt(12)
    first = 4.7300407**2*radius*np.sqrt(beam["E"]/beam["density"])/(2*np.pi*beam["length"]**2)
    assert found.shape_modes.tolist() == list(range(3, 3 + len(found.shapes)))
    for number, shape in zip(found.shape_modes, found.shapes):
        assert np.count_nonzero(np.diff(np.sign(shape.real))) == number - 1
    # 1e-6: the error of the mesh is far smaller.
    assert found.frequencies[found.shape_modes[0] - 1] == pytest.approx(first, rel=1e-6)
    panels = found.plot()
    title = panels[0].get_title() + panels[0].get_title("left")
    assert title.startswith(f"mode 3: {first:.5g} Hz,")
    assert panels[-1].get_xlabel() == "x [m]"
    changed = beamid.modes(NOISY, hose=dict(m_H=0.01), units=dict(time="ms"))
    assert changed.plot()[-1].get_xlabel() == "x [ft]"
    assert " 1/ms," in changed.plot()[0].get_title() + changed.plot()[0].get_title("left")
    lines = beamid.frf(NOISY, record=dict(f_first=0.1, f_last=1, f_step=0.1))
    assert lines.plot()[-1].get_xlabel() == "frequency [Hz]"
    bare = beamid.frf(beam=beam, record=dict(f_first=1, f_last=5, f_step=1))
    assert bare.plot()[-1].get_xlabel() == "frequency [1/time]"
    pyplot.close("all")


def test_pictures_of_modes_by_the_scripts(program, tmp_path, monkeypatch):
    """plot_modes.py and reports give a shape the number and the frequency of its mode."""
    pytest.importorskip("matplotlib").use("Agg")
    case = DATA / "benchmarks" / "free-bar.nml"
    files = program("modes", case, out=tmp_path)
    table = columns(files["modes.csv"])
    known = [(number, float(frequency)) for number, frequency, imag in zip(
        table["mode"], table["frequency_hz"], table["imag"]) if float(imag) > 0]
    assert known[0][0] == "3"
    monkeypatch.syspath_prepend(str(CHECKOUT / "scripts"))
    plot_modes = importlib.import_module("plot_modes")
    figure, _ = plot_modes.draw(tmp_path)
    for axes, (number, frequency) in zip(figure.axes, known):
        title = axes.get_title() + axes.get_title("left")
        assert title.startswith(f"mode {number}: ")
        assert float(title.split()[2].replace("\u202f", "")) == pytest.approx(frequency, rel=1e-4)
    from matplotlib import pyplot
    pyplot.close("all")


def test_frequency_response_of_a_bare_beam():
    """Receptance at the tip of a clamped beam without damping below its first resonance, in closed
    form. A mesh of 32 elements of degree 5 is exact to 1e-9."""
    beam = dict(length=0.5, rho=0.471, E=2e11, I=2e-11)
    record = dict(kind="frf", f_first=1, f_last=6, f_step=0.5, quantity="receptance")
    found = beamid.frf(beam=beam, record=record, discretization=dict(degree=5, elements=32))
    assert found.frequencies.tolist() == np.arange(1, 6.5, 0.5).tolist() and found.band is None
    stiffness = beam["E"]*beam["I"]
    k = (beam["rho"]*(2*np.pi*found.frequencies)**2/stiffness)**0.25
    z = k*beam["length"]
    exact = ((np.sin(z)*np.cosh(z) - np.cos(z)*np.sinh(z))
             / (stiffness*k**3*(1 + np.cos(z)*np.cosh(z))))
    np.testing.assert_allclose(found.h.real, exact, rtol=1e-9)
    np.testing.assert_allclose(found.h.imag, 0, atol=1e-15*abs(exact).max())
    with pytest.raises(beamid.InputError, match="expected one, with f_first"):
        beamid.frf(beam=beam)


def test_design_is_that_of_the_program(program, tmp_path):
    case = DATA / "design_table_4_1.nml"
    files = program("design", case, out=tmp_path)
    heard = []
    found = beamid.design(case, progress=lambda *piece: heard.append(piece))
    same_tables(found, files)
    table = columns(files["design.csv"])
    assert set(found.std_errors) == set(FREE) and len(found.settings) == len(table["design"])
    assert found.std_errors["k_H"].tolist() == [float(x or "nan") for x in table["sd_k_H"]]
    assert found.D.tolist() == [float(x or "nan") for x in table["D"]]
    assert found.settings[3]["duration"] == float(table["duration"][3])
    assert heard[-1][0] == heard[-1][1] and heard[-1][2] == "positions"


def test_design_from_arguments():
    """The standard errors of the present experiment are those by the exact derivatives."""
    t = np.arange(0.2, 5.05, 0.1)
    grid = dict(t_first=0.2, t_last=5.0, t_step=0.1)
    found = beamid.design(record=grid, free=FREE, noise=dict(sd=0.02),
                          design=dict(duration=[0.05, 0.1]), **MODEL)
    by = beamid.response(t, derivatives=FREE, **MODEL).derivatives
    jacobian = np.array([by[name] for name in FREE]).T
    covariance = 0.02**2*np.linalg.inv(jacobian.T @ jacobian)
    # The condition of the normal equations is some 1e6; times on the grid differ by round-off.
    for k, name in enumerate(FREE):
        assert found.std_errors[name][0] == pytest.approx(np.sqrt(covariance[k, k]), rel=1e-6)


def test_design_of_frequency_responses():
    """A band with more resonances tells more."""
    found = beamid.design(
        beam=dict(length=0.5, width=0.03, height=0.003, density=2700, E=7e10, c_D=2e6, gamma=0.05),
        record=dict(kind="frf", f_first=4, f_last=100, f_step=0.5), free=["E", "c_D"],
        design=dict(noise_sd=0.1, f_last=[100, 400]))
    assert [settings["f_last"] for settings in found.settings] == [100, 100, 400]
    assert found.std_errors["E"][1] == pytest.approx(found.std_errors["E"][0], rel=1e-9)
    assert found.std_errors["E"][2] < found.std_errors["E"][1]


@pytest.fixture(scope="module")
def rivals(tmp_path_factory):
    """The case with noise, and with the hose's spring known."""
    folder = tmp_path_factory.mktemp("rivals")
    text = NOISY.read_text().replace("file='", f"file='{DATA}/")
    small = text.replace("free='c_D','m_H','c_H','k_H', start=0.0035,0.035,0.0035,0.4",
                         "free='c_D','m_H','c_H', start=0.0035,0.035,0.0035")
    assert small != text
    for name, content in dict(full=text, small=small).items():
        (folder / f"{name}.nml").write_text(content)
    return folder / "full.nml", folder / "small.nml"


def test_compare_is_that_of_the_program(program, tmp_path, rivals, record):
    files = program("compare", *rivals, out=tmp_path)
    found = beamid.compare(*rivals)
    same_tables(found, files)
    table = columns(files["models.csv"])
    assert [model.aicc for model in found.models] == list(map(float, table["aicc"]))
    assert found.best.model == "full" and found.nested[0].restricted == "small"
    # Problems in memory: the same numbers under other names.
    keys = {**MODEL, **NAMES}
    full = beamid.Problem(*record, free=FREE, start=[0.0035, 0.035, 0.0035, 0.4], **keys)
    small = beamid.Problem(*record, free=FREE[:3], start=[0.0035, 0.035, 0.0035], **keys)
    named = beamid.compare({"all four": full, "spring known": small})
    assert [model.model for model in named.models] == ["all four", "spring known"]
    assert [model[1:] for model in named.models] == [model[1:] for model in found.models]
    mixed = beamid.compare(rivals[0], small)
    assert [model.model for model in mixed.models] == ["full", "model 2"]
    assert beamid.compare(full.fit(), small).models[0].J == found.models[0].J


def test_damping_is_that_of_the_program(program, tmp_path):
    """Two damping ratios of a strip, from a table of modes."""
    (tmp_path / "modes.csv").write_text("mode,frequency_hz,sd_hz,damping_ratio,sd_damping\n"
                                        "1,10.1,0.01,0.004,0.0001\n2,63.5,0.05,0.006,0.0002\n")
    case = tmp_path / "strip.nml"
    case.write_text("&beam length=0.5, width=0.03, height=0.003, density=2700, E=7e10, c_D=1e6 /\n"
                    "&record kind='modes', file='modes.csv' /\n&stage free='E','c_D' /\n")
    for damping, option in ((True, "--damping"), ("ratios", "--damping=ratios")):
        files = program("compare", option, case, out=tmp_path / option)
        found = beamid.compare(case, damping=damping)
        same_tables(found, files)
        table = columns(files["damping.csv"])
        assert [row.damping_ratio for row in found.damping] == list(map(float,
                                                                        table["damping_ratio"]))
        measured = [row.measured_damping for row in found.damping if row.model == "air"]
        assert measured[:2] == [0.004, 0.006] and math.isnan(measured[2])
    heard = []
    beamid.compare(case, damping=True, progress=lambda *piece: heard.append(piece))
    done, whole, pieces = heard[-1]
    assert pieces == "damping models" and done == whole > 1
    with pytest.raises(beamid.InputError, match="found 2 cases beside damping, expected one"):
        beamid.compare(case, case, damping=True)


def test_criteria_by_their_formulas(rivals):
    """AICc, BIC and the probability by numpy and scipy."""
    stats = pytest.importorskip("scipy.stats")
    found, m = beamid.compare(*rivals), 49
    for model in found.models:
        k = model.parameters + 1
        assert model.aicc == pytest.approx(
            m*np.log(model.J/m) + 2*k + 2*k*(k + 1)/(m - k - 1), rel=1e-12)
        assert model.bic == pytest.approx(m*np.log(model.J/m) + k*np.log(m), rel=1e-12)
    pair = found.nested[0]
    full, small = (model.J for model in found.models)
    assert pair.U == pytest.approx(m*(small - full)/full, rel=1e-12)
    assert pair.probability == pytest.approx(stats.chi2.sf(pair.U, pair.restrictions), rel=1e-9)


def test_bad_comparisons(rivals, record):
    t, a = record
    with pytest.raises(beamid.InputError, match="found other samples than in"):
        beamid.compare(rivals[0], beamid.Problem(t[:-5], a[:-5], free=FREE, **MODEL))
    with pytest.raises(beamid.InputError, match="found no case"):
        beamid.compare()
    for cases, found in ([[rivals]], "a list"), ([4], "4"), ([{}, {}], "a dict"):
        with pytest.raises(beamid.InputError, match=rf"compare: found {found}, .*compare\(one, "):
            beamid.compare(*cases)
    with pytest.raises(beamid.InputError, match=r"damping: found 'ratio', .*False or 'ratios'"):
        beamid.compare(rivals[0], damping="ratio")
    with pytest.raises(beamid.InputError, match="found the name 'a,b'"):
        beamid.compare({"a,b": rivals[0]})


ENSEMBLE = dict(free=["c_D", "k_H"], noise=dict(sd=0.01), ensemble=dict(members=40, seed=3),
                draw=dict(parameter="m_H", low=0.03, high=0.05), **MODEL)


def test_ensemble_is_that_of_the_program(program, tmp_path):
    case = tmp_path / "case.nml"
    case.write_text(library_text(dict(record=dict(t_first=0.2, t_last=5.0, t_step=0.1),
                                      **ENSEMBLE)))
    files = program("ensemble", case, out=tmp_path / "out")
    heard = []
    found = beamid.ensemble(case, progress=lambda *piece: heard.append(piece))
    same_tables(found, files)
    assert heard[-1] == (40, 40, "members")
    again = beamid.ensemble(record=dict(t_first=0.2, t_last=5.0, t_step=0.1), **ENSEMBLE)
    assert again.tables == found.tables
    table = columns(files["ensemble.csv"])
    assert [row.mean for row in found.statistics] == list(map(float, table["mean"]))
    members = columns(files["members.csv"])
    expected = [float(value) for value, name in zip(members["estimate"], members["parameter"])
                if name == "k_H"]
    assert found.estimates["k_H"].tolist() == expected and not found.failures
    assert np.mean(expected) == pytest.approx(found.statistics[1].mean, rel=1e-12)
    assert np.std(expected, ddof=1) == pytest.approx(found.statistics[1].sd, rel=1e-9)


def library_text(groups):
    """The groups as a case file."""
    from beamid._cases import case_text
    keys = dict(groups)
    record, free = keys.pop("record"), keys.pop("free")
    return case_text([record], [dict(free=free)], keys)


def test_ensemble_at_given_times_and_of_cases(program, tmp_path, rivals):
    t = np.linspace(0.2, 5, 49)
    found = beamid.ensemble(t, **{**ENSEMBLE, "ensemble": dict(members=5)})
    assert found.estimates["c_D"].shape == (5,)
    fleet = rivals[0].parent / "fleet.nml"
    fleet.write_text("&ensemble cases='list.txt' /\n")
    (fleet.parent / "list.txt").write_text("full.nml\nsmall.nml\nmissing.nml\n")
    files = program("ensemble", fleet, out=tmp_path)
    listed = beamid.ensemble(fleet)
    same_tables(listed, files)
    assert "missing.nml" in listed.failures[3] and np.isnan(listed.estimates["k_H"][1])
    with pytest.raises(beamid.InputError, match="&ensemble: found no such group"):
        beamid.ensemble(NOISY)
    (fleet.parent / "list.txt").write_text("missing.nml\n")
    with pytest.raises(beamid.ComputationError, match=r"every member failed; .*missing\.nml"):
        beamid.ensemble(fleet)


def test_progress_stops_an_ensemble():
    class Enough(Exception):
        pass

    def stop(*_):
        raise Enough

    with pytest.raises(Enough):
        beamid.ensemble(np.linspace(0.2, 5, 49), progress=stop,
                        **{**ENSEMBLE, "ensemble": dict(members=10**6)})


def test_residuals_have_one_sign(program, tmp_path, fit):
    """Record - model in Python, in fit.csv of the program, and by the response itself."""
    files = program("identify", NOISY, out=tmp_path)
    table = columns(files["fit.csv"])
    assert fit.residuals.tolist() == list(map(float, table["residual"]))
    np.testing.assert_allclose(fit.residuals, fit.measured - fit.model, rtol=0, atol=1e-15)
    assert fit.model.tolist() == list(map(float, table["model"]))
    beam = dict(MODEL["beam"], c_D=fit["c_D"].value)
    hose = {name: fit[name].value for name in ("m_H", "c_H", "k_H")}
    model = beamid.response(fit.t, **{**MODEL, "beam": beam, "hose": hose}).acceleration
    np.testing.assert_allclose(fit.measured - model, fit.residuals, atol=1e-12)


def test_jacobian_is_that_of_the_model(fit):
    """Against the response's derivatives: of the model, so that those of residuals are negative."""
    beam = dict(MODEL["beam"], c_D=fit["c_D"].value)
    hose = {name: fit[name].value for name in ("m_H", "c_H", "k_H")}
    by = beamid.response(fit.t, derivatives=FREE,
                         **{**MODEL, "beam": beam, "hose": hose}).derivatives
    for k, name in enumerate(FREE):
        np.testing.assert_allclose(fit.jacobian[:, k], by[name],
                                   atol=1e-9*abs(by[name]).max())


def test_minimum_by_scipy(fit):
    """The search of scipy ends at the same minimum; both stop within 1e-6 standard errors, and
    its Jacobian by differences adds some 1e-4."""
    optimize = pytest.importorskip("scipy.optimize")
    scale = np.array([0.005, 0.04, 0.004, 0.3])

    def residuals(p):
        c_D, m_H, c_H, k_H = p*scale
        groups = {**MODEL, "beam": dict(MODEL["beam"], c_D=c_D),
                  "hose": dict(m_H=m_H, c_H=c_H, k_H=k_H)}
        return fit.measured - beamid.response(fit.t, **groups).acceleration

    found = optimize.least_squares(residuals, np.ones(4), xtol=1e-12, ftol=1e-12)
    assert 2*found.cost == pytest.approx(fit.J, rel=1e-9)
    errors = [fit[name].std_error for name in FREE]
    assert (abs(found.x*scale - fit.values) < 1e-3*np.array(errors)).all()


def test_summary_is_that_of_the_program(program, tmp_path, fit):
    files = program("identify", NOISY, out=tmp_path)
    loaded = beamid.load(NOISY).fit()
    assert loaded.summary() == files["summary.txt"]
    assert loaded.verdict == files["summary.txt"].partition("\n\n")[0]    # no line is wrapped
    table = columns(files["estimates.csv"])
    for e in loaded.estimates.values():
        assert e.determined == (table["determined"][table["parameter"].index(e.name)] == "yes")


def test_table_in_html(fit, record):
    text = fit._repr_html_()
    for e in fit.estimates.values():
        assert f"<td>{e.name}</td><td>{e.value:.6g}</td><td>{e.unit}</td>" in text
        assert f"{e.interval[0]:.6g} to {e.interval[1]:.6g}" in text
    assert text.count("<tr>") == 5 and "fit 98.11 %" in text
    t, a = record
    with pytest.raises(beamid.NoFit) as caught:
        beamid.fit(t, a[::-1].copy(), free="c_D", **MODEL)
    assert "no fit: " in caught.value.fit._repr_html_()


def test_a_rejected_fit_names_what_the_model_lacks():
    """The reason of a rejection includes the score tests, as in the program: without air damping,
    the model explains less than half of the record."""
    beam = dict(length=0.5, width=0.03, height=0.003, density=2700, E=7e10, c_D=1e5)
    rest = dict(sensor=dict(m_S=0.005, x_S=0.4),
                excitation=dict(kind="pulse", amplitude=1, duration=0.01))
    times = np.arange(1, 201)/200
    found = beamid.simulate(times, beam=dict(beam, gamma=1), noise=dict(sd=0.05, seed=3), **rest)
    with pytest.raises(beamid.NoFit, match=r"with gamma = .*add 'gamma' to free"):
        beamid.fit(times, found.record, beam=beam, free="c_D", **rest)


def test_pictures(fit, record):
    """What is drawn is the record, the model, the residuals and the shapes of the tables."""
    pytest.importorskip("matplotlib").use("Agg")
    from matplotlib import pyplot
    upper, lower = fit.plot()
    drawn = {line.get_label(): line for line in upper.get_lines()}
    assert (drawn["record"].get_ydata() == fit.measured).all()
    assert (drawn["model"].get_ydata() == fit.model).all()
    assert (lower.get_lines()[0].get_ydata() == fit.residuals).all()
    assert "s" in lower.get_xlabel() and "ft/s^2" in upper.get_ylabel()
    assert lower.get_ylabel() == "record - model"
    panels = fit.plot_modes()
    frequencies = [mode.frequency for mode in fit.modes if mode.s.imag > 0]
    assert len(panels) == len(frequencies)
    for panel, frequency in zip(panels, frequencies):
        # The scripts, which other tests import, put titles on the left.
        assert f"{frequency:.5g} Hz" in panel.get_title() + panel.get_title("left")
        assert panel.get_lines()[1].get_xdata()[-1] == 4.0
    _, given = pyplot.subplots(2)
    assert fit.plot(axes=given)[0] is given[0]
    with pytest.raises(ValueError, match="found 1 axes, expected 2"):
        fit.plot(axes=given[:1])
    with pytest.raises(ValueError, match="found record=2, expected 1 to 1"):
        fit.plot(record=2)
    t, a = record
    halves = [beamid.Record(t[::2], a[::2]), beamid.Record(t[1::2], a[1::2])]
    both = beamid.fit(records=halves, free=FREE, **MODEL)
    upper, _ = both.plot(record=2)
    assert (upper.get_lines()[0].get_xdata() == t[1::2]).all()
    assert len(beamid.modes(NOISY).plot()) == 6
    pyplot.close("all")


def test_pictures_of_profiles(fit):
    """The points of the profile; the parabola is 1 at the ends of the linear interval."""
    pytest.importorskip("matplotlib").use("Agg")
    from matplotlib import pyplot
    found = beamid.profile(fit)
    assert len(found.plot()) == len(FREE)
    panel, = found.plot("c_D")
    drawn = {line.get_label(): line for line in panel.get_lines()}
    assert (drawn["profile"].get_xdata() == found["c_D"].value).all()
    np.testing.assert_allclose(drawn["profile"].get_ydata(), found["c_D"].distance**2)
    x, y = drawn["linear theory"].get_data()
    upper = found.interval("c_D", "linear").upper
    assert np.interp(upper, x, y) == pytest.approx(1, abs=0.02)    # 200 points
    assert panel.get_xlabel() == "c_D [lb s/ft^2]"
    with pytest.raises(KeyError, match="guess: expected one of c_D"):
        found.plot("guess")
    pyplot.close("all")


def test_pictures_of_densities(record):
    """Histograms hold all draws; the lines are the mean and the ends of the interval. A stiffness
    is drawn as its reciprocal, which the search varies."""
    pytest.importorskip("matplotlib").use("Agg")
    from matplotlib import pyplot
    fit = beamid.Problem(*record, free=FREE, bootstrap=dict(n=100), **MODEL, **NAMES).fit()
    posterior, resampled = beamid.sample(fit), beamid.bootstrap(fit)
    for found, sets, method in (
            (posterior, posterior.draws.reshape(-1, 4), "posterior"),
            (resampled, resampled.estimates, "bca")):
        panels = found.plot()
        assert len(panels) == len(FREE)
        for panel, name, values in zip(panels, FREE, sets.T):
            area = sum(bar.get_width()*bar.get_height() for bar in panel.patches)
            assert area == pytest.approx(1, rel=1e-9)
            assert panel.patches[0].get_x() == pytest.approx(values.min())
            interval = found.interval(name, method)
            assert [line.get_xdata()[0] for line in panel.get_lines()] == [
                pytest.approx(values.mean()), interval.lower, interval.upper]
        assert panels[0].get_xlabel() == "c_D [lb s/ft^2]"
        _, axes = pyplot.subplots()
        assert found.plot("k_H", axes=[axes])[0] is axes
        with pytest.raises(KeyError, match=r"guess: expected one of c_D"):
            found.plot("guess")
    soft = beamid.Inference(fit, ["1/k_R"], [beamid.Interval("bca", 8, "k_R", "N m", 50.0, 40.0,
                                                             math.inf, "closed", "unbounded")], "",
                            {})
    panel, = soft._densities(np.linspace(0, 0.025, 50)[:, None], "bca", None, None, "test")
    assert [line.get_xdata()[0] for line in panel.get_lines()] == [
        pytest.approx(0.0125), 0, 1/40]
    assert panel.get_xlabel() == "1/k_R"
    pyplot.close("all")


def test_results_in_notebooks(fit):
    """A problem says what it fits; results show their main table, rounded and cut."""
    assert repr(fit._problem) == "Problem: 1 record (49 samples), free: c_D, m_H, c_H, k_H"
    loaded = repr(beamid.load(NOISY))
    assert loaded == (f"Problem of {NOISY}: 1 record (the file 'table_4_1_noisy.csv'), "
                      "free: c_D, m_H, c_H, k_H")
    table = beamid.ModalRecord([1.0, 6.0], 0.1)
    both = beamid.Problem(records=[table, beamid.Record(fit.t, fit.measured)],
                          stages=[dict(free="E"), dict(free=["E", "m_H"])], **MODEL)
    assert repr(both) == ("Problem: 2 records (ModalRecord of 2 rows; 49 samples), free: E; then "
                          "E, m_H")
    modes = beamid.modes(NOISY)
    text = modes._repr_html_()
    assert text.count("<tr>") == 1 + len(modes.frequencies) and "more rows" not in text
    long = beamid.simulate(np.linspace(0.2, 5, 49), **MODEL)._repr_html_()
    assert long.count("<tr>") == 1 + 10 and "... 39 more rows" in long
    assert f"<td>{modes.frequencies[0]:.6g}</td>" in text and "natural modes" in text
    profiles = beamid.profile(fit)
    text = profiles._repr_html_()
    assert f"<td>{profiles.interval('k_H', 'profile').upper:.6g}</td>" in text


def test_printed_results_are_the_beginning_of_the_summary(fit):
    """Warnings come first, and long summaries are cut."""
    simulation = beamid.simulate(DATA / "table_4_1_truth.nml")
    assert repr(simulation) == simulation.summary().strip()
    coarse = beamid.simulate(np.arange(0, 2, 1/500), beam=dict(
        length=0.5, width=0.03, height=0.002, density=7850, E=2.05e11, c_D=1e7),
        sensor=dict(m_S=0.012, x_S=0.48), excitation=dict(kind="release", displacement=0.02))
    assert repr(coarse).startswith("warning: mesh: ")
    modes = beamid.modes(NOISY)
    lines, rest = repr(modes).splitlines(), modes.summary().strip().splitlines()
    assert lines[:-1] == rest[:14]
    assert lines[-1] == f"... {len(rest) - 14} more lines in summary()"
    assert repr(beamid.profile(fit)).startswith(("beamid: profile", "table_4_1_noisy: profile"))


@pytest.mark.parametrize("name", [
    "Estimate", "Mode", "FittedMode", "FittedResponse", "Interval", "Profile", "Profiles",
    "Posterior", "Bootstrap", "Inference", "ComparedModel", "NestedPair", "DampingRatio",
    "MemberStatistics", "Results", "Simulation", "FrequencyResponse", "Modes", "Design",
    "Comparison", "Ensemble", "Response", "TrackedWindow"])
def test_fields_of_results_are_documented(name):
    """help() describes each field, and of a named tuple also at the field itself."""
    result = getattr(beamid, name)
    told = inspect.getdoc(result).partition("Attributes\n----------\n")[2]
    fields = getattr(result, "_fields", None) or result.__annotations__
    for field in fields:
        if not field.startswith("_"):
            assert f"\n{field} : " in "\n" + told, field
        if hasattr(result, "_fields"):
            assert "Alias" not in getattr(result, field).__doc__


def test_packages_that_are_missing(fit, monkeypatch):
    """Which package is needed for what, and how to install it."""
    posterior = beamid.sample(NOISY, progress=None)
    plain = builtins.__import__

    def without(name, *arguments):
        if name.partition(".")[0] in ("pandas", "matplotlib", "arviz"):
            raise ImportError(name)
        return plain(name, *arguments)

    monkeypatch.setattr(library.importlib, "import_module", without)
    for call, package, what in [
            (fit.to_pandas, "pandas", "to_pandas"), (fit.plot, "matplotlib", "Fit.plot"),
            (posterior.to_pandas, "pandas", "to_pandas"),
            (posterior.to_arviz, "arviz", "to_arviz"),
            (fit.plot_modes, "matplotlib", "plot_modes")]:
        with pytest.raises(ImportError, match=f"found no {package}, expected it for {what}: pip "
                                              f"install {package}"):
            call()


def test_a_fit_survives_a_pickle(fit):
    """Numbers, texts and tables; further intervals, after a fit that is made again."""
    twin = pickle.loads(pickle.dumps(fit))
    assert twin.names == fit.names and (twin.values == fit.values).all()
    for name in ("covariance", "correlation", "jacobian", "residuals", "model", "t", "measured"):
        assert (getattr(twin, name) == getattr(fit, name)).all()
        getattr(twin, name)[...] = np.nan
        assert (getattr(twin, name) == getattr(fit, name)).all()
    assert (twin.J, twin.modes, twin.no_fit, twin.note) == (fit.J, fit.modes, fit.no_fit, fit.note)
    assert twin.estimates == fit.estimates and twin.tables == fit.tables
    assert twin.summary() == fit.summary() and repr(twin) == repr(fit)
    assert pickle.loads(pickle.dumps(twin)).tables == fit.tables
    fresh = beamid.load(NOISY).fit()
    beamid.profile(fresh)
    restored = pickle.loads(pickle.dumps(fresh))
    assert beamid.bootstrap(restored).tables == beamid.bootstrap(fresh).tables
    assert restored.tables == fresh.tables


def test_copies_share_the_fit(fit):
    for twin in (copy.copy(fit), copy.deepcopy(fit)):
        assert twin is not fit and twin._handle is fit._handle
        assert (twin.values == fit.values).all() and twin.summary() == fit.summary()


def test_problems_survive_a_pickle(record, tmp_path, monkeypatch):
    problem = beamid.Problem(*record, free=FREE, **MODEL)
    expected = problem.fit().values
    for twin in (copy.copy(problem), copy.deepcopy(problem), pickle.loads(pickle.dumps(problem))):
        assert (twin.fit().values == expected).all()
    # A case file by a relative path, restored elsewhere; its record file has to stay.
    (tmp_path / "case.nml").write_bytes(NOISY.read_bytes())
    (tmp_path / "table_4_1_noisy.csv").write_bytes((DATA / "table_4_1_noisy.csv").read_bytes())
    monkeypatch.chdir(tmp_path)
    loaded = beamid.load("case.nml")
    fit, packed = loaded.fit(), pickle.dumps(loaded)
    kept = pickle.dumps(fit)
    (tmp_path / "case.nml").unlink()
    monkeypatch.chdir("/")
    assert (pickle.loads(packed).fit().values == fit.values).all()
    (tmp_path / "table_4_1_noisy.csv").unlink()
    assert pickle.loads(kept).summary() == fit.summary()
    with pytest.raises(beamid.InputError, match=r"table_4_1_noisy\.csv"):
        pickle.loads(packed).fit()


def test_results_survive_a_pickle(record):
    for found in (beamid.sample(NOISY), beamid.profile(NOISY), beamid.modes(NOISY),
                  beamid.response([0.1, 0.2], **MODEL), beamid.Record(*record)):
        twin = pickle.loads(pickle.dumps(found))
        for name, value in vars(found).items():
            if isinstance(value, np.ndarray):
                assert (getattr(twin, name) == value).all()
            elif name in ("text", "tables", "names", "intervals"):
                assert getattr(twin, name) == value
    with pytest.raises(beamid.NoFit) as caught:
        beamid.fit(record[0], record[1][::-1].copy(), free=["c_D"], **MODEL)
    twin = pickle.loads(pickle.dumps(caught.value))
    assert str(twin) == str(caught.value) and twin.fit.no_fit == str(twin)


def fit_elsewhere(problem):
    """Runs in another process."""
    return problem.fit()


def summary_elsewhere(fit):
    """Runs in another process."""
    return fit.summary(), fit.values, beamid.profile(fit).interval("c_D", "profile")


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_fits_go_to_and_fro(record, method):
    """A problem is sent to another process, which sends its fit back; and a fit is sent there."""
    problem = beamid.Problem(*record, free=FREE, **MODEL, **NAMES)
    fit = problem.fit()
    with multiprocessing.get_context(method).Pool(1) as pool:
        there = pool.apply_async(fit_elsewhere, (problem,)).get(120)
        text, values, interval = pool.apply_async(summary_elsewhere, (fit,)).get(120)
    assert there.tables == fit.tables and there.summary() == fit.summary() == text
    assert (values == fit.values).all()
    assert interval == beamid.profile(fit).interval("c_D", "profile")


def test_one_name_is_enough(record):
    """A text in place of a list of one."""
    t, a = record
    keys = {**MODEL, "hose": dict(m_H=0.0389, c_H=0.00375, k_H=0.296)}
    one = beamid.fit(t, a, free="c_D", **keys)
    assert one.names == ["c_D"] and one.tables == beamid.fit(t, a, free=["c_D"], **keys).tables
    record = beamid.Record(t, a)
    for more in (dict(records=record, free="c_D"), dict(records=[record], stages=dict(free="c_D"))):
        assert (beamid.fit(**more, **keys).values == one.values).all()
    halves = [beamid.Record(t[::2], a[::2]), beamid.Record(t[1::2], a[1::2])]
    both = [beamid.fit(records=halves, free=["c_D", "k_H"], shared=shared, **keys).names
            for shared in ("k_H", ["k_H"])]
    assert both[0] == both[1] and len(both[0]) == 3
    assert list(beamid.response(t, derivatives="E", **MODEL).derivatives) == ["E"]
    grid = dict(t_first=0.2, t_last=5.0, t_step=0.1)
    keys = dict(record=grid, noise=dict(sd=0.02), design=dict(duration=0.05), **MODEL)
    assert beamid.design(free="c_D", **keys).tables == beamid.design(free=["c_D"], **keys).tables


@pytest.mark.parametrize("keys, message", [
    (dict(record=4), "record: found 4, expected its keys"),
    (dict(records=4), "records: found 4, expected one or several"),
    (dict(records=[dict(t=1)]), r"records: found \{'t': 1\}, expected beamid.Record"),
    (dict(stages=4), "stages: found 4, expected one or several"),
    (dict(stages="E"), "stages: found 'E', expected one or several"),
    (dict(stages=[dict(free="E")], free="E"), "found stages beside free"),
    (dict(t=[0, 1], records=[]), "found records beside t, a or record"),
    (dict(beam=dict(E=None, length=np.ma.masked)), "found a masked value"),
    (dict(beam=dict(E=[np.nan])), "&beam E: found 'nan', expected a number"),
])
def test_bad_arguments(keys, message):
    """An InputError says what is wrong, instead of an error deep inside."""
    free = {} if "stages" in keys else dict(free="E")
    with pytest.raises(beamid.InputError, match=message):
        beamid.fit(**{**MODEL, **free, **keys})


def test_a_fit_of_a_case_file(fit):
    """A path or a problem in place of the record."""
    loaded = beamid.fit(NOISY)
    assert loaded.names == fit.names
    np.testing.assert_allclose(loaded.values, fit.values, rtol=1e-5)
    assert (beamid.fit(beamid.load(str(NOISY))).values == loaded.values).all()
    assert beamid.fit(NOISY, free="m_H").names == ["m_H"]


def test_arguments_change_a_case(fit, record):
    """The same results as with all arguments; the case itself stays as it is."""
    problem = beamid.Problem(*record, free=FREE, **MODEL, **NAMES)
    longer = {**MODEL, "beam": dict(MODEL["beam"], length=4.2)}
    expected = beamid.fit(*record, free=["m_H", "k_H"], **longer, **NAMES)
    found = beamid.fit(problem, free=["m_H", "k_H"], beam=dict(length=4.2))
    assert (found.values == expected.values).all() and found.summary() == expected.summary()
    assert (problem.fit().values == fit.values).all()
    t, a = record
    half = beamid.fit(fit, records=beamid.Record(t[:30], a[:30]))
    assert half.t.size == 30 and half.names == FREE
    assert (beamid.fit(fit, record=dict(t_last=3.0)).t < 3.05).all()
    structure = {key: longer[key] for key in ("beam", "tip", "hose", "discretization")}
    assert (beamid.modes(NOISY, beam=dict(length=4.2), stages=[]).frequencies
            == beamid.modes(**structure).frequencies).all()
    release = dict(kind="release", displacement=0.1)
    other = beamid.simulate(t, **{**MODEL, "excitation": release, "observation": None})
    again = beamid.simulate(problem, excitation=release, observation=[])
    assert (again.acceleration == other.acceleration).all()
    with pytest.raises(beamid.InputError, match="found length, which belongs into beam=dict"):
        beamid.modes(fit, length=4.2)
    masses = [dict(x=1, m=0.1, name="a"), dict(x=2, m=0.1, name="b")]
    with pytest.raises(beamid.InputError, match="the case has 2 groups &mass"):
        beamid.modes(beamid.Problem(*record, free="E", **MODEL, mass=masses), mass=dict(m=0.2))
    with pytest.raises(beamid.InputError, match=r"noisy\.nml, changed: &beam E: found -1"):
        beamid.modes(NOISY, beam=dict(E=-1))
    with pytest.raises(beamid.InputError, match=r"noisy\.nml, changed: &stage free: found 'q'"):
        beamid.fit(NOISY, free="q")
    with pytest.raises(beamid.InputError, match=r"nowhere\.nml: No such file"):
        beamid.modes("nowhere.nml", beam=dict(length=1))


def test_settings_of_a_method_do_not_change_the_fit(record):
    """The fit collects the intervals of all methods with any settings, and the numbers are those of
    a fit that has these settings from the beginning."""
    keys = dict(free=FREE, **MODEL, **NAMES)
    problem = beamid.Problem(*record, **keys)
    fit = problem.fit()
    seed, n = dict(draws=400, seed=7), dict(n=100, seed=4)
    few = beamid.sample(fit, sample=seed)
    again = beamid.bootstrap(fit, bootstrap=n)
    assert few.fit is fit and again.fit is fit
    assert {item.method for item in again.intervals} == {"linear", "profile", "posterior",
                                                         "percentile", "bca"}
    other = beamid.Problem(*record, sample=seed, bootstrap=n, **keys).fit()
    assert few.draws.shape == (4, 100, 4) and (few.draws == beamid.sample(other).draws).all()
    assert (again.estimates == beamid.bootstrap(other).estimates).all()
    # Without settings, those of the case count again; a copy by pickle keeps the intervals.
    assert (beamid.bootstrap(fit).estimates == beamid.bootstrap(problem.fit()).estimates).all()
    restored = pickle.loads(pickle.dumps(fit))
    assert beamid.profile(restored).tables == beamid.profile(fit).tables
    assert restored.tables == fit.tables
    with pytest.raises(beamid.InputError, match="&sample draws: found -1"):
        beamid.sample(fit, sample=dict(draws=-1))
    assert (beamid.sample(fit, sample=seed).draws == few.draws).all()
    changed = beamid.bootstrap(fit, bootstrap=n, record=dict(t_last=4.5))
    assert changed.fit is not fit and changed.fit.t[-1] < 4.55 and len(changed.estimates) == 100
    # Estimates of these methods are means.
    for k, name in enumerate(FREE):
        assert few.interval(name, "posterior").estimate == pytest.approx(
            few.values(name).mean(), rel=1e-12)
        assert again.interval(name, "bca").estimate == pytest.approx(
            again.estimates[:, k].mean(), rel=1e-12)


def test_commands_take_a_fit(fit):
    """They compute with the estimates, on the mesh of the fit."""
    estimates = {name: fit[name].value for name in FREE}
    fitted = {**MODEL, "beam": dict(MODEL["beam"], c_D=estimates.pop("c_D")), "hose": estimates}
    expected = [mode.frequency for mode in fit.modes]
    assert beamid.modes(fit).frequencies[:len(expected)].tolist() == expected
    simulation = beamid.simulate(fit)
    np.testing.assert_allclose(simulation.acceleration, fit.model, rtol=0, atol=1e-12)
    structure = {key: fitted[key] for key in ("beam", "tip", "hose", "discretization")}
    lines = dict(f_first=0.1, f_last=2, f_step=0.1, x_F=3)
    # The search for the band ends within 1e-6 standard errors, which are some 1 % of the values.
    np.testing.assert_allclose(beamid.frf(fit, record=lines).h,
                               beamid.frf(record=lines, **structure).h, rtol=1e-7)
    grid, noise = dict(t_first=0.1, t_last=5, t_step=0.05), dict(sd=0.016)
    plan = beamid.design(fit, record=grid, noise=noise, design=dict(x_S=[2, 4]))
    other = beamid.design(record=grid, free=FREE, noise=noise, design=dict(x_S=[2, 4]), **fitted,
                          **NAMES)
    assert plan.tables["design.csv"] == other.tables["design.csv"]
    reverse = fit.measured[::-1].copy()
    rejected = beamid.Problem(fit.t, reverse, free="c_D", **MODEL).fit(judge=False)
    with pytest.raises(beamid.NoFit, match="the model explains"):
        beamid.modes(rejected)
    noise = dict(sd=float(columns(fit.tables["quality.csv"])["noise_sd"][0]))
    known = beamid.Problem(fit.t, fit.measured, free=FREE, noise=dict(sd=0.1), **MODEL).fit()
    other = beamid.design(fit, record=grid, noise=dict(sd=0.1), design=dict(x_S=[2, 4]))
    plan = beamid.design(known, record=grid, design=dict(x_S=[2, 4]))
    np.testing.assert_allclose(plan.D, other.D)
    assert (beamid.design(fit, record=grid, design=dict(x_S=[2, 4])).std_errors["m_H"]
            == beamid.design(fit, record=grid, noise=noise, design=dict(x_S=[2, 4])
                             ).std_errors["m_H"]).all()


def test_a_fit_gives_its_values_to_the_keys_of_a_case():
    """Each parameter goes to the group and the key that the reference names."""
    from beamid import _changes
    reference = (CHECKOUT / "docs/reference/case-file.md").read_text().split("## Parameters")[1]
    rows = [row.split("|") for row in reference.splitlines() if row.startswith("| `")]
    places = {row[1].strip(" `"): tuple(row[4].replace("`", "").replace("&", "").split())
              for row in rows}
    del places["E(x)"], places["c_D(x)"]
    ends = {name: places.pop(name) for name in ("k_R", "c_R")}
    assert {name: _changes.PLACES[name] for name in places} == places and len(places) > 30
    text = """&Beam width=1.5, height=2 density = 3d0, E=1 ! a comment /
        / &end at='root', k_R=1 / &mass x=1, m=1, name='a' / &mass x=2, m=1, name="b" /
        &excitation kind='release', displacement=1 / &record x_S=1 / &record x_S=2, offset=3/"""
    groups = _changes.read_groups(text)
    _changes.set_estimates(groups, {
        "E": 7e10, "rho": 6.0, "k_R.root": 50.0, "m_M.a": 4.0, "J_M.b": 5.0, "amplitude": 8.0,
        "x_S(2)": 9.0, "offset(1)": 0.5, "cos_1": 1.0, "m_T": 2.0}, 16)
    assert groups == [
        ("beam", {"width": "1.5", "height": "2", "density": "2.0", "e": "70000000000.0"}),
        ("end", {"at": "'root'", "k_r": "50.0"}),
        ("mass", {"x": "1", "m": "4.0", "name": "'a'"}),
        ("mass", {"x": "2", "m": "1", "name": '"b"', "j": "5.0"}),
        ("excitation", {"kind": "'release'", "displacement": "8.0"}),
        ("record", {"x_s": "1", "offset": "0.5"}), ("record", {"x_s": "9.0", "offset": "3"}),
        ("tip", {"m_t": "2.0"}), ("discretization", {"elements": "16"})]
    assert ends["k_R"] == ("end", "k_R")
    for estimates, message in [
            ({"m_M": 1.0}, "m_M: found 2 groups &mass"), ({"E(1)": 1.0}, "a value for one record"),
            ({"E.3": 1.0}, r"estimates of E\(x\)")]:
        with pytest.raises(beamid.InputError, match=message):
            _changes.set_estimates(_changes.read_groups(text), estimates, 16)


def test_a_record_from_a_file(record, tmp_path, monkeypatch):
    """Columns by name; the path is relative to the folder of the call."""
    rows = "".join(f"{x},{t},{a}\n" for x, (t, a) in enumerate(zip(*record)))
    (tmp_path / "phone.csv").write_text("number,seconds,g\n" + rows)
    monkeypatch.chdir(tmp_path)
    problem = beamid.Problem(record=dict(file="phone.csv", time_column="seconds", value_column="g"),
                             free=FREE, **MODEL)
    with pytest.raises(beamid.InputError, match=r"is read by record=dict\(file='phone.csv'\)"):
        beamid.fit("phone.csv", free=FREE, **MODEL)
    monkeypatch.chdir("/")
    found = pickle.loads(pickle.dumps(problem)).fit(judge=False)
    assert (found.measured == record[1]).all() and (found.t == record[0]).all()


@pytest.mark.parametrize("keys, message", [
    (dict(scale=9.8), r"^found scale, which belongs into record=dict\(scale=...\)$"),
    (dict(E=7e10), r"^found E, which belongs into beam=dict\(E=...\)$"),
    (dict(free="density"), r"^free: found 'density', expected one of m_T"),
    (dict(beam=dict(MODEL["beam"], E=-1)), r"^&beam E: found -1, expected"),
])
def test_messages_name_the_argument(record, keys, message):
    """There is no line of a case file, and no group of a stage that the user has not written."""
    with pytest.raises(beamid.InputError, match=message):
        beamid.fit(*record, **{**MODEL, "free": "m_H", **keys})
    with pytest.raises(beamid.InputError, match=r"profile\(fit\)\['E'\] is that of E"):
        beamid.profile(NOISY, parameters="E")


@pytest.mark.parametrize("call, message", [
    (lambda fit: beamid.fit(fit, free="c_D,m_H"),
     r"^free: found 'c_D,m_H', but several names are a list: free=\['c_D', 'm_H'\]$"),
    (lambda fit: beamid.fit(fit, shared=["c_D m_H"]), r"are a list: shared=\['c_D', 'm_H'\]$"),
    (lambda fit: beamid.response([0.1], derivatives="E, m_T", **MODEL),
     r"are a list: derivatives=\['E', 'm_T'\]$"),
    (lambda fit: beamid.fit(fit, free=[]), r"^free: found no name, .*free=\['E', "),
    (lambda fit: beamid.fit(fit, sensors=dict(x_S=1)), r"expected one of .*record, .*sensor$"),
    (lambda fit: beamid.frf(fit, beem=dict(E=1)), r"found beem, .*, perhaps beam$"),
    (lambda fit: beamid.response([0.1], free="E", **MODEL), "free, which this function does not"),
    (lambda fit: beamid.bootstrap(fit, n=200), r"found n, which belongs into bootstrap=dict\(n"),
    (lambda fit: beamid.sample(fit, seed=3), r"seed, which belongs into sample=dict\(seed="),
    (lambda fit: beamid.simulate(fit, seed=3), r"seed, which belongs into noise=dict\(seed="),
    (lambda fit: beamid.ensemble(fit, members=3), r"into ensemble=dict\(members="),
    (lambda fit: beamid.design(fit, x_S=[1]), r"into design=dict\(x_S="),
    (lambda fit: beamid.modes([fit]), "case: found a list, expected the path"),
    (beamid.Tracker, "Tracker: found a Fit, expected the path of a case file"),
    (lambda fit: beamid.Tracker(fit._problem, track=dict(window=1)), "Tracker: found a Problem, "),
    (lambda fit: beamid.FrequencyRecord([1, 2], ["1", "2"]), "h of FrequencyRecord: found"),
])
def test_messages_say_what_to_do(fit, call, message):
    """A slip in the arguments is an InputError of one sentence that names the remedy."""
    with pytest.raises(beamid.InputError, match=message) as caught:
        call(fit)
    assert "\n" not in str(caught.value)


def test_tables_and_other_texts(fit):
    """Every table becomes a data frame; the copy of the case is a text, and a message says so."""
    pandas = pytest.importorskip("pandas")
    tables = [name for name in fit.tables if name.endswith(".csv")]
    assert all(isinstance(fit.to_pandas(name), pandas.DataFrame) for name in tables)
    with pytest.raises(KeyError, match=r"case\.txt: found a text, expected a table"):
        fit.to_pandas("case.txt")
    with pytest.raises(KeyError, match=r"nothing: expected one of .*estimates"):
        fit.to_pandas("nothing")


def test_columns_are_records(record):
    """Arrays (m, 1) and (1, m) are the same record as (m,)."""
    t, a = record
    one = beamid.Problem(t, a, free="c_D", **MODEL).fit(judge=False)
    two = beamid.Problem(t[:, None], a[None, :], free="c_D", **MODEL).fit(judge=False)
    assert (one.values == two.values).all()


def test_help_on_units_speaks_of_a_record_only_where_there_is_one():
    """Functions that fit compare the units with the record; the others have none."""
    for function in (beamid.Problem, beamid.fit, beamid.profile, beamid.sample, beamid.bootstrap):
        assert "contradicts the" in inspect.getdoc(function), function
    for function in (beamid.modes, beamid.simulate, beamid.design, beamid.response, beamid.frf):
        told = inspect.getdoc(function)
        assert "contradicts the" not in told, function
        assert "They appear in texts and tables." in told, function


@pytest.mark.parametrize("group", ["beam", "sensor", "excitation"])
def test_help_lists_every_key(group):
    """The docstring of Problem names each key that the reference lists."""
    reference = (CHECKOUT / "docs/reference/case-file.md").read_text()
    rows = reference.partition(f"\n## `&{group}`\n")[2].partition("\n## ")[0]
    keys = [row.split("`")[1] for row in rows.splitlines() if row.startswith("| `")]
    told = inspect.getdoc(beamid.Problem).partition(f"\n{group} : ")[2]
    entry = re.split(r"\n(?=\S)", told)[0]
    assert len(keys) > 3 and [key for key in keys if f"`{key}`" not in entry] == []


@pytest.mark.parametrize("function", [beamid.fit, beamid.sample, beamid.modes, beamid.design])
def test_help_describes_the_arguments(function):
    """Each argument has a line of its own, and is described once."""
    told = inspect.getdoc(function)
    for name, parameter in inspect.signature(function).parameters.items():
        mark = "**" if parameter.kind is inspect.Parameter.VAR_KEYWORD else ""
        lines = [line for line in told.splitlines() if line[:1].strip()
                 and mark + name in line.partition(" :")[0].split(", ")]
        assert len(lines) == 1, name


def test_commands_in_two_threads(rivals):
    """The same tables from two threads at once as from one."""
    def work(_):
        t = np.linspace(0.2, 5, 49)
        return [found.tables for found in (
            beamid.modes(NOISY), beamid.compare(*rivals), beamid.simulate(t, **MODEL),
            beamid.ensemble(t, **{**ENSEMBLE, "ensemble": dict(members=30)}))]

    expected = work(0)
    with ThreadPoolExecutor(2) as pool:
        assert all(found == expected for found in pool.map(work, range(6)))


ALIKE = [beamid.Problem, beamid.fit, beamid.profile, beamid.sample, beamid.bootstrap]


@pytest.mark.parametrize("function", [*ALIKE, beamid.simulate, beamid.modes, beamid.design,
                                      beamid.ensemble, beamid.frf, beamid.response,
                                      beamid.Record, beamid.FrequencyRecord,
                                      beamid.ModalRecord])
def test_signatures(function):
    """Every argument is documented and may be left out; an unknown group is an InputError."""
    names = inspect.signature(function).parameters
    told = inspect.getdoc(function)
    for name, parameter in names.items():
        assert name in told, name
        if parameter.kind is inspect.Parameter.KEYWORD_ONLY:
            assert parameter.default is None or parameter.default == ()
    if isinstance(function, type) and function is not beamid.Problem:
        return
    assert "beam" in names
    first = next(iter(names))
    arguments = {first: [0.1, 0.2]} if first == "t" else {}
    if "a" in names:
        arguments["a"] = [0.1, 0.2]
    with pytest.raises(beamid.InputError, match=r"found baem, expected one of .*beam"):
        function(**arguments, baem=dict(E=1))


def test_arguments_are_alike():
    """Functions that fit take the arguments of Problem, in its order."""
    expected = list(inspect.signature(beamid.Problem).parameters)
    for function in ALIKE[1:]:
        names = list(inspect.signature(function).parameters)
        assert [name for name in names if name != "progress"] == expected


def test_every_group_is_an_argument_or_documented():
    """Each group of a case file is an argument of Problem, or its docstring names it."""
    names = inspect.signature(beamid.Problem).parameters
    told = inspect.getdoc(beamid.Problem).partition("**other")[2]
    for name in set(library.groups()) - {"record", "stage"}:
        assert name in names or f"`{name}`" in told, name


def test_end():
    """`end` describes what holds an end: a beam that is pinned at both has (pi/l)**2 sqrt(EI/rho);
    the default is a clamped root and a free tip, where 3.516 takes the place of pi**2."""
    beam = dict(length=2.0, E=7.0, I=0.5, rho=0.3, c_D=0)
    scale = np.sqrt(beam["E"]*beam["I"]/beam["rho"])/beam["length"]**2/(2*np.pi)
    mesh = dict(degree=5, elements=16)
    pinned = [dict(at="root", kind="pinned"), dict(at="tip", kind="pinned")]
    # 1e-6: the error of this mesh is far smaller, other ends differ by far more.
    assert beamid.modes(beam=beam, end=pinned, discretization=mesh).frequencies[0] == \
        pytest.approx(np.pi**2*scale, rel=1e-6)
    for same in (dict(), dict(end=dict(at="tip", kind="free"))):
        assert beamid.modes(beam=beam, discretization=mesh, **same).frequencies[0] == \
            pytest.approx(3.5160152685*scale, rel=1e-6)
    with pytest.raises(beamid.InputError, match="&end kind: found 'loose'"):
        beamid.modes(beam=beam, end=dict(at="tip", kind="loose"))


def test_keys_of_the_docstring_exist(program):
    """Each key that the docstring of Problem names is one of its group."""
    path = os.environ["BEAMID_PROGRAM"]
    group = None
    for line in inspect.getdoc(beamid.Problem).splitlines():
        if line[:1].isalpha() or line.startswith("*"):
            group = line.partition(" :")[0]
        elif group in set(library.groups()) - {"record"}:
            known = subprocess.run([path, "help", group], capture_output=True, text=True,
                                   check=True).stdout
            for key in line.split("`")[1::2]:
                if not key.startswith("dict("):
                    assert f"\n  {key} " in known, (group, key)


def test_results_of_a_command_are_no_fit():
    """The library refuses to treat them as one."""
    from beamid._commands import _opened, _run
    handle = _run("modes", [_opened(NOISY)], "", None)
    with pytest.raises(beamid.InputError, match="found the results of a command, expected a fit"):
        library.array_of(handle, "covariance")
    with pytest.raises(beamid.InputError, match="found the results of a command, expected a fit"):
        library.call("beamid_judge", handle.number)
    assert library.text_of(handle, "names") == ""
    with pytest.raises(beamid.InputError, match="found another command"):
        _run("identify", [_opened(NOISY)], "", None)


def test_examples_of_the_readme(monkeypatch, tmp_path):
    """Every block of the README runs, one after the other; the truth is inside the intervals."""
    pytest.importorskip("matplotlib").use("Agg")
    pytest.importorskip("pandas")
    pytest.importorskip("arviz")
    text = (CHECKOUT / "python" / "README.md").read_text()
    blocks = [part.partition("```")[0] for part in text.split("```python\n")[1:]]
    assert len(blocks) > 5
    monkeypatch.chdir(tmp_path)
    space = {}
    for block in blocks:
        exec(compile(block, "README.md", "exec"), space)
    fit, truth = space["copy"], dict(E=2.05e11, c_D=1e7, m_S=0.012, offset=0)
    for name, true in truth.items():
        lower, upper = fit[name].interval
        assert lower < true < upper, name
    from matplotlib import pyplot
    pyplot.close("all")


STRIP = dict(length=0.5, width=0.03, height=0.003, density=2700, E=7e10, c_D=2e6, gamma=0.05)
MESH = dict(sensor=dict(m_S=0.005, x_S=0.4), discretization=dict(degree=5, elements=16))
LINES = dict(f_first=5, f_last=200, f_step=1, x_F=0.3)


@pytest.fixture(scope="module")
def strip_response():
    """The frequency response of a strip."""
    return beamid.frf(record=LINES, beam=STRIP, **MESH)


def measured_response(found, sd=0.05):
    """A record with noise of a known standard deviation."""
    random = np.random.default_rng(5)
    noise = random.normal(0, sd, (2, found.h.size))
    return beamid.FrequencyRecord(found.frequencies, found.h + noise[0] + 1j*noise[1], sd=sd,
                                  x_F=LINES["x_F"])


def fit_strip(*records, **more):
    return beamid.fit(records=list(records), beam=dict(STRIP, E=6e10, c_D=1e6),
                      free=["E", "c_D", "gamma"], **MESH, **more)


def test_frequency_response_in_memory(strip_response):
    """A fit finds the parameters that made the response, and shows its residuals."""
    record = measured_response(strip_response)
    fit = fit_strip(record)
    for name in ("E", "c_D", "gamma"):    # 5: one interval in two million is that far off
        assert abs(fit[name].value - STRIP[name]) < 5*fit[name].std_error
    found, = fit.frequency_responses
    assert found.record == 1 and fit.measured_modes == []
    measured = record.columns["real"] + 1j*record.columns["imag"]
    assert found.measured.tolist() == measured.tolist()    # the temporary file has all digits
    np.testing.assert_allclose(found.measured - found.model, found.residual, atol=1e-12*1e3)
    np.testing.assert_allclose(np.concatenate([found.residual.real, found.residual.imag])/0.05,
                               fit.residuals, atol=1e-9)
    assert found.sd.tolist() == [0.05]*found.sd.size and np.isnan(found.coherence).all()
    assert (found.band[:, 0] < np.abs(found.model)).all()
    assert (found.band[:, 1] > np.abs(found.model)).all()
    assert fit.t.size == 0
    pytest.importorskip("matplotlib").use("Agg")
    assert fit.plot().shape == (3,) and strip_response.plot().shape == (2,)


def test_response_of_a_fitted_structure(strip_response):
    """Frf of a problem is the response of its fit, with a band, at the lines of the record."""
    record = measured_response(strip_response)
    fit = fit_strip(record)
    found = beamid.frf(fit._problem)
    assert found.frequencies.tolist() == strip_response.frequencies.tolist()
    np.testing.assert_allclose(found.h, fit.frequency_responses[0].model, rtol=1e-9)
    np.testing.assert_allclose(found.band, fit.frequency_responses[0].band, rtol=1e-6)
    assert strip_response.band is None
    # Of the fit it is the same, also at other lines, and from other start values.
    again = beamid.frf(fit)
    assert again.tables == found.tables and (again.band == found.band).all()
    few = dict(f_first=5, f_last=200, f_step=39, x_F=LINES["x_F"])
    for case in (fit, fit._problem):
        other = beamid.frf(case, record=few)
        assert other.h.tolist() == found.h[::39].tolist()
        assert other.band.tolist() == found.band[::39].tolist()
    elsewhere = fit._problem.fit([7.1e10, 1.5e6, 0.06])
    np.testing.assert_allclose(beamid.frf(elsewhere).band, found.band, rtol=1e-4)
    with pytest.raises(beamid.InputError, match="found beam, tip beside a fit and no record"):
        beamid.frf(fit, beam=dict(length=0.4), tip=dict(m_T=0.01))
    assert beamid.frf(fit, beam=dict(length=0.4), record=few).band is None


def test_modes_in_memory():
    """Frequencies and damping ratios of the model itself give back its parameters."""
    known = beamid.modes(beam=STRIP, **MESH)
    table = beamid.ModalRecord(known.frequencies[:3], 0.01, known.damping_ratios[:3], 1e-4)
    fit = fit_strip(table)
    # The search ends within 1e-6 standard errors.
    for name in ("E", "c_D", "gamma"):
        assert abs(fit[name].value - STRIP[name]) < 1e-3*fit[name].std_error
    assert [mode.mode for mode in fit.measured_modes] == [1, 2, 3]
    assert all(abs(mode.residual) < 1e-3*mode.sd for mode in fit.measured_modes)
    assert fit.frequency_responses == []
    with pytest.raises(ValueError, match="has no samples"):
        fit.plot()


def test_records_of_several_kinds(strip_response):
    """A free decay, a response and a table of modes in one fit; a copy by pickle gives the same."""
    t = np.arange(0, 2, 0.001)
    free = dict(excitation=dict(kind="release", displacement=0.001))
    decay = beamid.simulate(t, beam=STRIP, noise=dict(sd=0.1, seed=3), **free, **MESH)
    known = beamid.modes(beam=STRIP, **MESH)
    records = [beamid.Record(t, decay.record), measured_response(strip_response),
               beamid.ModalRecord(known.frequencies[:2], [0.01, 0.02], mode=[1, 2])]
    fit = fit_strip(*records, **free)
    for name in ("E", "c_D", "gamma"):
        assert abs(fit[name].value - STRIP[name]) < 5*fit[name].std_error
    alone = fit_strip(records[1])
    assert all(fit[name].std_error < alone[name].std_error for name in fit.names)
    assert fit.t.size == t.size and len(fit.frequency_responses) == 1
    assert [mode.record for mode in fit.measured_modes] == [3, 3]
    again = pickle.loads(pickle.dumps(fit._problem)).fit()
    assert again.values.tolist() == fit.values.tolist()


def test_noise_of_windowed_blocks():
    """An exponential window correlates the noise of neighbouring lines. The standard errors allow
    for that: without it the rms of the standardized errors is near 2. 1.3 is far beyond the scatter
    of 60 values, 1.0 +- 0.1."""
    rate, duration, sampling, count = 3.5, 2.0, 1024, 5
    f = np.arange(1, 512)/duration
    exact = beamid.frf(beam=STRIP, record=dict(LINES, f_first=f[0], f_last=f[-1], f_step=f[0],
                                               exponential_window=rate), **MESH)
    m = int(duration*sampling)
    window = np.exp(-rate*np.arange(m)/sampling)
    random = np.random.default_rng(8)
    errors = []
    for _ in range(20):
        noise = np.fft.rfft(window*random.normal(0, 0.05, (count, m)))[:, 1:f.size + 1]
        blocks = exact.h + noise
        h = blocks.mean(0)
        record = beamid.FrequencyRecord(
            f, h, coherence=np.abs(h)**2/np.mean(np.abs(blocks)**2, 0), averages=count, x_F=0.3,
            exponential_window=rate, f_first=5, f_last=200)
        fit = beamid.Problem(records=record, beam=STRIP, free=["E", "c_D", "gamma"], start="case",
                             **MESH).fit(judge=False)
        errors += [(fit[name].value - STRIP[name])/fit[name].std_error for name in fit]
    assert np.sqrt(np.mean(np.square(errors))) < 1.3
    # From estimated noise the intervals do not allow for that, and the summary says so.
    record = beamid.FrequencyRecord(f, h, x_F=0.3, exponential_window=rate, f_first=5, f_last=200)
    fit = beamid.Problem(records=record, beam=STRIP, free="E", start="case", **MESH).fit()
    assert "too narrow by a factor of up to 2.6" in " ".join(fit.summary().split())


def test_bad_records_in_memory():
    with pytest.raises(beamid.InputError, match="2 of real"):
        beamid.FrequencyRecord([1, 2, 3], [1, 2j])
    with pytest.raises(beamid.InputError, match="frequency_hz that is not finite"):
        beamid.ModalRecord([1, np.nan], 0.1)
    with pytest.raises(beamid.InputError, match="FrequencyRecord"):
        beamid.fit(records=[([1, 2], [3, 4])], beam=STRIP, free="E")
    with pytest.raises(beamid.InputError, match="averages"):
        fit_strip(beamid.FrequencyRecord(np.arange(5, 200), np.ones(195)*(1 + 1j),
                                         coherence=np.full(195, 0.9)))


TRACK = dict(
    beam=dict(length=0.5, rho=2.67, E=2e11, width=0.05, height=0.0066, c_D=5e6),
    sensor=dict(m_S=0.03, x_S=0.34), support=dict(x_P=0.1), free=["x_P", "c_D", "offset"],
    excitation=dict(kind="free", modes=2), discretization=dict(degree=5, elements=8),
    track=dict(parameter="x_P", window=0.3, hop=0.1))


def decay():
    """A free decay of a beam on a support at 0.1 m, on the mesh of TRACK."""
    t = np.arange(1, 1601)*5e-4
    model = {name: TRACK[name] for name in ("beam", "sensor", "support")}
    found = beamid.response(t, excitation=dict(kind="release", displacement=1e-3),
                            discretization=dict(degree=5, elements=8, knots="uniform"), **model)
    noise = np.random.default_rng(1).normal(scale=0.05, size=t.size)
    return t, found.acceleration + noise


def test_tracker_holds_the_position_in_blocks_of_any_size():
    t, a = decay()
    whole = beamid.Tracker(**TRACK).feed(t, a)
    # Windows begin at 0.0005, 0.1005, ..., 0.4005 and are 0.3 long.
    assert [round(window.first, 4) for window in whole] == [0.0005, 0.1005, 0.2005, 0.3005, 0.4005]
    assert all(window.lower <= 0.1 <= window.upper for window in whole)
    tracker = beamid.Tracker(**TRACK)
    pieces = [window for k in range(0, t.size, 37)
              for window in tracker.feed(t[k:k + 37], a[k:k + 37])]
    assert [(w.estimate, w.flag) for w in pieces] == [(w.estimate, w.flag) for w in whole]


def test_tracker_refuses_bad_samples():
    tracker = beamid.Tracker(**TRACK)
    tracker.feed([0.0, 0.1], [1.0, 2.0])
    for t, a in (([0.1], [1.0]), ([0.3, 0.2], [1.0, 1.0]), ([np.nan], [1.0]), ([0.2, 0.3], [1.0])):
        with pytest.raises(beamid.InputError):
            tracker.feed(t, a)
    with pytest.raises(beamid.InputError, match="track"):
        beamid.Tracker(**{**TRACK, "track": None})
