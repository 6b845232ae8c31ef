"""to_csv.py --frf against structures with known frequency response functions."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("scipy")

SCRIPTS = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(SCRIPTS), str(Path(__file__).resolve().parent)]

import frequency_examples as example  # noqa: E402
import frf_estimates  # noqa: E402
from channels import REMARKS, Channel  # noqa: E402
from frf_options import Settings  # noqa: E402
from scipy.signal import coherence, csd, lfilter, firwin, welch  # noqa: E402

NOISE = 0.4    # m/s^2; the coherence then is from .05 to .999


def estimate(t, force, response, **settings):
    """Returns the FRF of a response in m/s^2 to a force in N."""
    channels = [Channel("force", force, "N", t, "s"), Channel("a", response, "m/s^2", t, "s")]
    return frf_estimates.estimate("test", channels[0], channels[1:], Settings(**settings))[0]


def run(*arguments, status=0):
    """Runs to_csv.py; returns what it prints."""
    done = subprocess.run([sys.executable, SCRIPTS / "to_csv.py", *map(str, arguments)],
                          capture_output=True, text=True)
    assert done.returncode == status, done.stderr
    return done.stdout if status == 0 else done.stderr


def hammer_file(path, t, force, response):
    """Writes the columns of a hammer test."""
    path.write_text("t [s],force [N],acc [m/s^2]\n" + "".join(
        f"{a!r},{b!r},{c!r}\n" for a, b, c in zip(t.tolist(), force.tolist(), response.tolist())))
    return path


def test_noiseless_hammer_test():
    """The FRF is that of the structure, if the response decays within the block: here to
    exp(-7.5*1.9) = 6e-7."""
    t, force, response = example.hammer_test(blows=3)
    found = estimate(t, force, response, block=1.95, trigger=5.0, before=0.02)
    f = found.frequencies
    band = (f > 5) & (f < 300)
    exact = example.sampled_accelerance(f)
    assert np.abs(found.values - exact)[band].max() < 1e-5 * np.abs(exact).max()
    # It is also that of the structure, but for 1 - sinc(130/2048)^2 = 1.3 % at the second mode.
    assert np.abs(found.values - example.accelerance(f))[band].max() < 0.015 * np.abs(exact).max()
    assert found.coherence[band].min() > 1 - 1e-6
    assert found.quantity == "accelerance" and found.unit == "(m/s^2)/N"
    assert found.keys == {"averages": "3", "window": "'boxcar'"}


@pytest.mark.parametrize("estimator", ["H1", "H2"])
def test_errors_of_a_hammer_test(estimator):
    """H1 scatters by its standard error |H|^2 (1 - g)/(2 n g) in each part, and its coherence is
    that of the signal-to-noise ratio. H2 is larger by 1/g."""
    n = 40
    t, force, response = example.hammer_test(n, noise=NOISE)
    found = estimate(t, force, response, block=1.95, trigger=5.0, before=0.02, estimator=estimator)
    _, _, clean = example.hammer_test(n)
    exact = estimate(t, force, clean, block=1.95, trigger=5.0, before=0.02)
    f = found.frequencies
    band = (f > 5) & (f < 300)
    length = round(1.95 * example.RATE)
    starts, _ = frf_estimates.cut(Settings(block=1.95, trigger=5.0, before=0.02), force,
                                  example.RATE)
    assert len(starts) == n
    blocks = np.array([force[start:start + length] for start in starts])
    energy = np.sum(np.abs(np.fft.rfft(blocks)[:, 1:(length + 1) // 2])**2, axis=0)
    variance = NOISE**2 * length / (2 * energy)    # of each part, for a force without noise
    ratio = np.abs(exact.values)**2 / (np.abs(exact.values)**2 + 2 * n * variance)
    lines = band.sum()
    # The sample coherence has the mean g + (1 - g)^2/n, to the order 1/n.
    expected = ratio + (1 - ratio)**2 / n
    assert abs(np.mean((found.coherence - expected)[band])) < 0.5 / n
    if estimator == "H2":
        h1 = found.values * found.coherence
        assert np.abs(h1 - exact.values)[band].std() < 3 * np.sqrt(variance[band].max())
        return
    errors = np.abs(found.values - exact.values)**2 / (2 * variance)
    # Exponential of mean 1 at each line: five standard errors of the mean, and of the tail.
    assert abs(errors[band].mean() - 1) < 5 / np.sqrt(lines)
    tail = np.mean(errors[band] > 3)
    assert abs(tail - np.exp(-3)) < 5 * np.sqrt(np.exp(-3) / lines)
    # The variance that beamid computes from coherence and averages, where it is not tiny.
    good = band & (ratio > 0.5)
    own = np.abs(found.values)**2 * (1 - found.coherence) / (2 * (n - 1) * found.coherence)
    assert abs(np.mean((own / variance)[good]) - 1) < 0.05
    # A conjugated estimate is off by much more than its errors.
    conjugated = np.abs(found.values.conj() - exact.values)**2 / (2 * variance)
    assert conjugated[band].mean() > 20


def test_continuous_excitation():
    """Random force, Hann window: H1 has the known FRF within its standard errors at nearly all
    lines, and equals SciPy's welch and csd."""
    rate, length, overlap = example.RATE, 4096, 0.5
    generator = np.random.default_rng(5)
    force = lfilter(firwin(201, 300, fs=rate), 1, 20 * generator.standard_normal(80 * length))
    t = np.arange(len(force)) / rate
    response = example.motion(force) + NOISE * generator.standard_normal(len(t))
    found = estimate(t, force, response, block=length / rate, window="hann", overlap=overlap)
    x, y = force - force.mean(), response - response.mean()
    kept = slice(1, length // 2)
    keys = dict(fs=rate, window="hann", nperseg=length, noverlap=length // 2, detrend=False)
    h1 = csd(x, y, **keys)[1] / welch(x, **keys)[1]
    assert np.allclose(found.values, h1[kept], rtol=1e-9)
    assert np.allclose(found.coherence, coherence(x, y, **keys)[1][kept], rtol=1e-9)
    # 159 blocks that overlap by half are 159/(1 + 2/36) = 150.6 averages.
    assert found.keys == {"averages": "150", "window": "'hann'"}
    f = found.frequencies
    band = (f > 10) & (f < 200)
    exact = example.sampled_accelerance(f)[band]
    g = found.coherence[band]
    variance = np.abs(found.values[band])**2 * (1 - g) / (2 * 150 * g)
    errors = np.abs(found.values[band] - exact)**2 / (2 * variance)
    assert np.mean(errors < -np.log(0.05)) > 0.9    # 95 % expected, less some leakage
    assert np.mean(np.abs(found.values[band].conj() - exact)**2 / (2 * variance)) > 20


@pytest.mark.parametrize("window", ["boxcar", "hann"])
def test_pure_tones(window):
    """At a pure tone, the FRF is the ratio of amplitudes with the phase of the response."""
    rate, block = 1000.0, 2.0
    t = np.arange(20000) / rate
    force, response = np.zeros_like(t), np.zeros_like(t)
    tones = {12.0: 2 * np.exp(-0.5j), 77.5: 0.3 * np.exp(2.2j)}
    for f, value in tones.items():
        force += np.cos(2 * np.pi * f * t)
        response += (value * np.exp(2j * np.pi * f * t)).real
    # Other lines need some force.
    noise = 1e-9 * np.random.default_rng(1).standard_normal(len(t))
    found = estimate(t, force + noise, response + noise, block=block, window=window)
    for f, value in tones.items():
        line = round(f * block) - 1
        assert found.frequencies[line] == pytest.approx(f)
        assert found.values[line] == pytest.approx(value, rel=1e-6)


def test_exponential_window():
    """The window adds its decay rate to that of every mode, and nothing else."""
    t, force, response = example.hammer_test(blows=3)
    decay = 6.0
    found = estimate(t, force, response, block=0.9, trigger=5.0, before=0.02, exponential=decay)
    f = found.frequencies
    band = (f > 5) & (f < 200)
    exact = example.sampled_accelerance(f, decay=decay)
    # The response has decayed to exp(-13.5*0.88) = 7e-6.
    assert np.abs(found.values - exact)[band].max() < 2e-4 * np.abs(exact[band]).max()
    assert found.keys["exponential_window"] == "6.0"


def test_independent_averages():
    """Blocks without overlap count one each; a Hann window with an overlap of a half has a
    correlation of 1/6, a boxcar of 1/2."""
    n, m = 400, 256
    step = np.arange(n) * (m // 2)
    hann = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(m) / m)
    count = frf_estimates.independent_averages
    assert count(2 * step, hann) == pytest.approx(n)
    assert count(step, hann) == pytest.approx(n / (1 + 2 / 36 * (1 - 1 / n)), rel=1e-4)
    assert count(step, np.ones(m)) == pytest.approx(n / (1 + 2 / 4 * (1 - 1 / n)), rel=1e-9)


def test_command(tmp_path):
    """The script names the averages, the window and the lines of the case file."""
    t, force, response = example.hammer_test(blows=4, noise=0.01)
    path = hammer_file(tmp_path / "hammer.csv", t, force + 0.3, response - 0.1)
    text = run(path, "--frf", "--force", "force", "--response", "acc", "--block", 1.9,
               "--trigger", 5, "--exponential", 2)
    out = tmp_path / "hammer_frf.csv"
    assert "H1 from 4 blocks of 1.8999 s" in text and "window boxcar times exp(-2 t)" in text
    assert ("&record kind='frf', file='hammer_frf.csv', quantity='accelerance', averages=4, "
            "window='boxcar', exponential_window=2.0 /") in text
    lines = out.read_text().splitlines()
    above = [line for line in lines if line.startswith("#")]
    assert "# FRF acc/force" in above and "# real, imag: accelerance [(m/s^2)/N]" in above
    assert lines[len(above)] == "frequency_hz,real,imag,coherence"
    f, real, imag, found = np.loadtxt(out, delimiter=",", skiprows=len(above) + 1).T
    assert f[0] > 0 and found.max() <= 1
    peak = np.argmin(np.abs(f - 40))
    exact = example.accelerance(f[peak], decay=2.0)
    assert real[peak] + 1j * imag[peak] == pytest.approx(exact, rel=0.02)
    assert "exists; --out" in run(path, "--frf", "--force", "1", "--response", "2", "--block",
                                  1.9, "--trigger", 5, status=2)
    assert len(run(path, "--frf", "--force", 1, "--response", 2, "--averages", 4, "--window",
                   "hann", "--overlap", 0.5, "--out", out).splitlines()) == 3


def test_velocity_makes_mobility():
    """The quantity follows from the unit of the response."""
    t, force, response = example.hammer_test(blows=2)
    channels = [Channel("force", force, "N", t, "s"), Channel("v", response, "mm/s", t, "s")]
    found, = frf_estimates.estimate("test", channels[0], channels[1:],
                                    Settings(block=1.9, trigger=5.0))
    assert (found.quantity, found.unit) == ("mobility", "(mm/s)/N")
    channels[1].unit = "V"
    found, = frf_estimates.estimate("test", channels[0], channels[1:],
                                    Settings(block=1.9, trigger=5.0))
    assert (found.quantity, found.unit) == ("accelerance", "V/N")
    assert "counts as acceleration" in found.notes[0]


def test_one_average(remarks):
    """One block has no coherence."""
    t, force, response = example.hammer_test(blows=1)
    found = estimate(t, force, response, block=1.9, trigger=5.0)
    assert found.coherence is None and found.keys["averages"] == "1"
    assert remarks == ["one average has no coherence: the column is left out"]


REFUSED = {
    "--block 1": "expected --force and --response",
    "--force force --response acc": "expected either --block or --averages",
    "--force force --response acc --block 1 --averages 3": "expected either --block or --averages",
    "--force force --response acc --block -1": "--block: found -1.0, expected a number above 0",
    "--force force --response acc --block 100": "found blocks of 204800 samples, expected 16 to",
    "--force force --response acc --trigger 5": "found no --block",
    "--force force --response acc --trigger 500 --block 1": "largest magnitude of the force: 46.4",
    "--force force --response force --block 1": "expected one channel that is no response",
    "--force f --response acc --block 1": "no channel 'f'",
    "--force force --response acc --block 1 --rate 2048": "found times and --rate",
    "--force force --response acc --block 1 --exponential 2": "found no --trigger",
    "--force force --response acc --block 1 --trigger 5 --window hann": "expected neither",
    "--force force --response acc --block 1 --overlap 1": "--overlap: found 1.0",
}


@pytest.mark.parametrize("options", REFUSED)
def test_refused(options, tmp_path):
    """Contradictions are one line that says what was expected."""
    t, force, response = example.hammer_test(blows=1)
    path = hammer_file(tmp_path / "hammer.csv", t, force, response)
    message = run(path, "--frf", *options.split(), status=2)
    assert REFUSED[options] in message and len(message.splitlines()) == 1


def test_unsuitable_records(tmp_path):
    """Uneven times, and options without --frf, are refused."""
    t, force, response = example.hammer_test(blows=1)
    path = hammer_file(tmp_path / "hammer.csv", t + 0.4 / example.RATE * (np.arange(len(t)) % 2),
                       force, response)
    words = ["--force", "1", "--response", "2", "--block", "1"]
    assert "without a constant step" in run(path, "--frf", *words, status=2)
    assert re.search("--force: found no --frf", run(path, *words, status=2))
    plain = tmp_path / "plain.npz"
    np.savez(plain, force=force, acc=response)
    assert "expected --rate" in run(plain, "--frf", *words, status=2)
    assert "averages=2" in run(plain, "--frf", *words, "--rate", example.RATE)


@pytest.fixture
def remarks():
    """The remarks of an estimate."""
    REMARKS.clear()
    yield REMARKS
    REMARKS.clear()


def test_remarks_on_blows(remarks):
    """Blows too near to the ends and double blows are reported."""
    t, force, _ = example.hammer_test(blows=3)
    force = force + example.pulse(t, 2.5)
    estimate(t, force, example.motion(force), block=0.7, trigger=5.0, before=0.4)
    assert any("1 of 3 blows are left out" in remark for remark in remarks)
    assert any("1 of 2 blocks contain more than one blow" in remark for remark in remarks)


@pytest.mark.parametrize("noise", [0.0, 0.2])
@pytest.mark.parametrize("spacing, block, exponential, words", [
    (2.0, 0.5, 0.0, ["left at the end of a block"]), (2.0, 0.5, 20.0, []), (2.0, 1.9, 0.0, []),
    (0.55, 0.5, 0.0, ["left at the end of a block", "left at the next blow"]),
    (0.55, 0.5, 20.0, ["left at the next blow"])])
def test_remarks_on_decay(remarks, noise, spacing, block, exponential, words):
    """Vibration at the end of a block and at the next blow is reported, and noise is not.

    The first mode decays by 7.5 1/s: to 2 % in 0.5 s, and to 6e-7 in 1.9 s.
    """
    t, force, response = example.hammer_test(blows=6, spacing=spacing, noise=noise)
    estimate(t, force, response, block=block, trigger=5.0, exponential=exponential)
    assert len(remarks) == len(words)
    assert all(word in remark for word, remark in zip(words, remarks))


def write_npz(path, t, force, response):
    np.savez(path, time=t, force=force, acc=response, force_unit="N", acc_unit="m/s^2")


def write_mat(path, t, force, response):
    from scipy.io import savemat
    savemat(path, {"fs": example.RATE, "force": force, "acc": response})


def write_lvm(path, t, force, response):
    path.write_text(
        "LabVIEW Measurement\t\nSeparator\tTab\nDecimal_Separator\t.\nMulti_Headings\tNo\n"
        "X_Columns\tNo\n***End_of_Header***\t\n\t\nChannels\t2\t\t\n"
        f"Samples\t{len(t)}\t{len(t)}\t\nY_Unit_Label\tN\tm/s^2\t\nX_Dimension\tTime\tTime\t\n"
        f"X0\t0\t0\t\nDelta_X\t{1 / example.RATE!r}\t{1 / example.RATE!r}\t\n"
        "***End_of_Header***\t\t\t\nX_Value\tforce\tacc\tComment\n"
        + "".join(f"\t{a!r}\t{b!r}\n" for a, b in zip(force.tolist(), response.tolist())))


def write_tdms(path, t, force, response):
    nptdms = pytest.importorskip("nptdms")
    known = {"wf_increment": 1 / example.RATE}
    with nptdms.TdmsWriter(path) as file:
        file.write_segment([
            nptdms.ChannelObject("m", "force", force, {**known, "unit_string": "N"}),
            nptdms.ChannelObject("m", "acc", response, {**known, "unit_string": "m/s^2"})])


def write_uff(path, t, force, response):
    pyuff = pytest.importorskip("pyuff")
    common = dict(
        type=58, binary=0, func_type=1, func_id=0, ver_num=0, load_case_id=0, rsp_dir=3,
        ref_ent_name="NONE", ref_node=0, ref_dir=0, x=t, id1="NONE", id2="NONE", id3="NONE",
        id4="NONE", id5="NONE", abscissa_spacing=1, abscissa_min=0.0,
        abscissa_inc=1 / example.RATE, abscissa_spec_data_type=17, abscissa_axis_units_lab="s",
        orddenom_spec_data_type=0)
    pyuff.UFF(str(path)).write_sets(
        [dict(common, rsp_ent_name="force", rsp_node=1, ordinate_spec_data_type=13, data=force),
         dict(common, rsp_ent_name="acc", rsp_node=2, ordinate_spec_data_type=12, data=response)],
        "overwrite")


@pytest.mark.parametrize("write, names", [
    (write_npz, ("force", "acc")), (write_mat, ("force", "acc")), (write_lvm, ("force", "acc")),
    (write_tdms, ("m/force", "m/acc")), (write_uff, ("force 1+Z", "acc 2+Z"))])
def test_formats(tmp_path, write, names):
    """The FRF of one test is the same from every format."""
    t, force, response = example.hammer_test(blows=2, noise=0.01)
    path = tmp_path / f"hammer.{write.__name__[6:]}"
    write(path, t, force, response)
    text = run(path, "--frf", "--force", names[0], "--response", names[1], "--block", 1.9,
               "--trigger", 5)
    assert "quantity='accelerance', averages=2, window='boxcar' /" in text
    lines = (tmp_path / "hammer_frf.csv").read_text().splitlines()
    columns = np.loadtxt([line for line in lines if line[0] not in "#f"], delimiter=",").T
    expected = estimate(t, force, response, block=1.9, trigger=5.0)
    # UFF has six digits of the sampling interval, and twelve of the samples.
    assert np.allclose(columns[0], expected.frequencies, rtol=5e-6 if write is write_uff else 1e-9)
    assert np.allclose(columns[1] + 1j * columns[2], expected.values, rtol=1e-6, atol=1e-8)


def test_sign_of_the_force():
    """Blows in the direction -z are found, too."""
    t, force, response = example.hammer_test(blows=2)
    down, up = (estimate(t, sign * force, sign * response, block=1.9, trigger=5.0)
                for sign in (-1, 1))
    assert np.allclose(down.values, up.values)
