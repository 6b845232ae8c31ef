"""plot_frf.py and the reports of frequency responses, from a hand-made frf.csv."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

SCRIPTS = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(SCRIPTS), str(Path(__file__).resolve().parent)]

pytest.importorskip("scipy")

import frequency_examples as example  # noqa: E402
import frf_folders  # noqa: E402
import frf_outputs  # noqa: E402
from test_reports import DATA, INSPECT, OUT, VIEWS, program  # noqa: E402

PNG = b"\x89PNG\r\n\x1a\n"


def run(script, *arguments, status=0):
    """Runs a script; returns what it prints, or its message."""
    done = subprocess.run([sys.executable, SCRIPTS / script, *map(str, arguments)],
                          capture_output=True, text=True)
    assert done.returncode == status, done.stderr
    return done.stdout if status == 0 else done.stderr


@pytest.fixture
def fitted(tmp_path):
    """The folder of a fit on two meshes."""
    return frf_folders.make(tmp_path / "fitted", frf_folders.fitted_rows(8, shift=0.1),
                            frf_folders.fitted_rows(16), command="identify")


def test_pictures(fitted, tmp_path):
    """One picture for each record; of the mesh and of the mode that are asked for."""
    assert run("plot_frf.py", fitted) == f"{fitted}/frf.png\n"
    assert (fitted / "frf.png").read_bytes()[:8] == PNG
    two = frf_folders.make(
        tmp_path / "two", frf_folders.fitted_rows(16, record=1),
        frf_folders.fitted_rows(16, seed=4, record=2), command="identify",
        more="&record kind='frf', file='b.csv', quantity='mobility' /\n")
    assert run("plot_frf.py", two).splitlines() == [f"{two}/frf.png", f"{two}/frf_2.png"]
    out = tmp_path / "other.png"
    assert run("plot_frf.py", fitted, "--mode", 2, "--elements", 8, "--out", out) == f"{out}\n"
    assert "found 3, expected one of 1, 2" in run("plot_frf.py", fitted, "--mode", 3, status=2)
    assert "no FRF with 4 elements (found: 8, 16)" in run("plot_frf.py", fitted, "--elements", 4,
                                                         status=2)
    assert "which plot_frf.py draws" in run("plot_fit.py", fitted, status=2)


def test_no_response(tmp_path):
    """A folder without frf.csv is one line."""
    folder = frf_folders.make(tmp_path / "none", frf_folders.fitted_rows(4))
    (folder / "frf.csv").unlink()
    text = (folder / "manifest.txt").read_text().splitlines()
    (folder / "manifest.txt").write_text("\n".join([text[0], *text[2:]]) + "\n")
    assert "found no frf.csv" in run("plot_frf.py", folder, status=2)


def test_noise_level(fitted):
    """The level from coherence and averages is the rms magnitude of the noise that was added."""
    folder = frf_outputs.Folder(fitted)
    curve, = folder.finest()
    assert curve.elements == 16 and folder.averages(1) == frf_folders.AVERAGES
    assert folder.unit(1) == "m/s^2/N" and folder.quantity(1) == "accelerance"
    level, basis = frf_outputs.noise_level(curve, folder.averages(1))
    assert basis == "coherence"
    # The measured |H|^2 has the noise in it where the coherence is low: look where it is high.
    high = curve.coherence > 0.99
    assert np.allclose(level[high], 0.02 * np.sqrt(2), rtol=0.1)
    level, basis = frf_outputs.noise_level(curve, None)
    assert basis == "residuals"
    assert level[0] == pytest.approx(0.02 * np.sqrt(2), rel=0.1)


def test_modes_and_circles(fitted):
    """Peaks are within a line of the modes. The circle of a mode of viscous damping has the
    diameter of its peak, 1/(2 zeta) times the modal constant, and passes through the peak."""
    folder = frf_outputs.Folder(fitted)
    curve, = folder.finest()
    modes = folder.modes(curve)
    assert [number for number, _ in modes] == [1, 2]
    assert np.allclose([f for _, f in modes], [40, 130], atol=0.5)
    assert frf_outputs.chosen_mode(folder, curve)[0] == 1
    for (_, frequency), (_, damping, constant) in zip(modes, example.MODES):
        part, top = frf_outputs.circle(curve, frequency)
        assert part.start < top < part.stop
        values = curve.model[part]
        # Least-squares circle: |z|^2 = 2 Re(z conj(middle)) + r^2 - |middle|^2.
        matrix = np.column_stack([2 * values.real, 2 * values.imag, np.ones(len(values))])
        x, y, rest = np.linalg.lstsq(matrix, np.abs(values)**2, rcond=None)[0]
        # The other mode and omega^2 deform the circle by some per cent.
        assert 2 * np.sqrt(rest + x**2 + y**2) == pytest.approx(abs(constant) / (2 * damping),
                                                                rel=0.05)
        fine, between = frf_outputs.between(curve.f[part], values)
        assert np.allclose(between, example.accelerance(fine), atol=0.005 * np.abs(values).max())


def test_report_of_frf(tmp_path):
    """The page of the command frf: both axes' units, the peaks, the circle."""
    folder = frf_folders.make(tmp_path / "model",
                              frf_folders.only_model(frf_folders.fitted_rows(16)))
    source = Path(run("report.py", folder).strip()).read_text(encoding="utf-8")
    assert "computed the frequency response of a structure" in source
    assert source.count('class="live"') == 3
    assert "Peak 2: 113 to 140.5 Hz" in source and "<h3>Peaks</h3>" in source
    assert re.search(r"at 382 frequencies, 10 to 200.5 Hz", source)
    assert "residual" not in re.sub(r"(?s)<script.*?</script>", "", source)
    again = Path(run("report.py", folder).strip()).read_text(encoding="utf-8")
    assert again == source


def test_section_of_a_fit(fitted):
    """The section of a fit says what the noise level rests on."""
    import frf_page
    from output_folder import Outputs
    text = frf_page.section(Outputs(fitted))
    assert text.count('class="live"') == 3
    assert "noise level from the coherence and the number of averages" in text
    assert "95 % band of the model" in text and "m/s\\u00b2/N" in text


@pytest.fixture(scope="module", params=["model", "fit"])
def page(request, tmp_path_factory):
    """The report of the command frf, and that of a fit with frf.csv beside its other outputs."""
    folder = tmp_path_factory.mktemp("frf") / f"frf-{request.param}"
    if request.param == "model":
        frf_folders.make(folder, frf_folders.only_model(frf_folders.fitted_rows(16)))
    else:
        subprocess.run([program(), "identify", DATA / "bench_fit.nml", "--out", folder, "--quiet"],
                       capture_output=True, check=True)
        frf_folders.add(folder, frf_folders.fitted_rows(16))
    return Path(run("report.py", folder).strip())


@pytest.mark.parametrize("view", VIEWS)
def test_view(browser, page, view):
    """Nothing sticks out, no legend covers data, no text is cut; out/screenshots has the pages."""
    width, scheme, medium = VIEWS[view]
    tab = browser.new_page(viewport={"width": width, "height": 900})
    tab.emulate_media(media=medium, color_scheme=scheme)
    tab.goto(page.as_uri())
    tab.wait_for_function("document.documentElement.dataset.drawn", timeout=120000)
    found = tab.evaluate(INSPECT)
    OUT.mkdir(parents=True, exist_ok=True)
    tab.screenshot(path=OUT / f"{page.parent.name}-{view}.png", full_page=True)
    tab.close()
    assert found["drawn"] == found["figures"] and found["blank"] == 0
    assert found["scroll"] <= found["client"], "the page is wider than the screen"
    assert found["wide"] == [] and found["covered"] == [] and found["cut"] == []
