"""Reports of every command in a browser: nothing sticks out, no legend covers data, no text is cut.

The screenshots of all pages are in out/screenshots: 360 and 1200 pixels wide, light and dark, and
printed on A4. Without Chromium or Playwright the tests are skipped; `scripts/setup.sh browser`
installs both.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import fit_page

CHECKOUT = Path(__file__).resolve().parent.parent.parent
OUT = CHECKOUT / "out" / "screenshots"
DATA = CHECKOUT / "data"
CASE = """&beam           length=4.0, rho=0.03, E=80.0, I=1.0, c_D=0.005, gamma=0.001 /
&tip            m_T=0.15 /
&hose           m_H=0.04, c_H=0.004, k_H=0.3 /
&excitation     kind='pulse', amplitude=1.0, duration=0.05 /
&discretization degree=3, elements=4 /
&observation    formula='displacement_difference', delta=0.1 /
&record         t_first=0.2, t_last=5.0, t_step=0.1 /
&noise          sd=0.0172 /
&stage          free='c_D','m_H','c_H','k_H' /
&ensemble       members=60, seed=1 /
&draw           parameter='m_H', low=0.03, high=0.05 /
&units          length='ft', force='lb', time='s', mass='slug' /
"""
PRIORS = """&prior parameter='length', sd=0.001 /
&prior parameter='rho', sd=0.003 /
&multistart n=4 /
&windows n=3 /
"""
STRIP = """&beam           length=0.5, width=0.03, height=0.003, density=2700, E={E}, c_D=2e6,
                gamma=0.05 /
&sensor         m_S=0.005, x_S=0.4 /
&discretization degree=5, elements=16 /
&record         kind='frf', f_first=5, f_last=400, f_step=1, x_F=0.3 /
&units          length='m', force='N', time='s', mass='kg' /
"""
# The response of the strip as a record without noise: intervals and residuals are tiny.
RESPONSE = "&record kind='frf', file='frf/frf.csv', sd=0.5, x_F=0.3 /\n"
MODES = "&record kind='modes', file='modes.csv' /\n"
TABLE = """mode,frequency_hz,sd_hz,damping_ratio,sd_damping
1,9.4692,0.002,0.00244,0.0001
2,61.84,0.01,0.0058,0.0002
3,171.13,0.02,0.0155,0.0003
"""
FREE = "&stage free='E','c_D','gamma' /\n"
# A cantilever on a rigid support, which follows a free decay.
TRACK = """&beam           length=0.5, rho=2.67, E=2e11, width=0.05, height=0.0066, c_D=5e6 /
&sensor         m_S=0.03, x_S=0.34 /
&support        x_P=0.10 /
&excitation     kind='free', modes=2 /
&discretization degree=5 /
&record         file='dwell/record.csv', sd=0.05 /
&stage          free='x_P','c_D','offset' /
&track          parameter='x_P', window=0.3, hop=0.01, rate=0.05 /
&units          length='m', force='N', time='s', mass='kg' /
"""
DWELL = """kind='release', displacement=0.001 /
&noise sd=0.05, seed=1 /
&record t_first=0.0005, t_last=1, t_step=0.0005 /
"""
# Name of a page: the commands that fill its folder.
PAGES = {
    "identify": [["identify", DATA / "bench_fit.nml"]],
    "priors": [["identify", "priors.nml"]],
    "along": [["identify", DATA / "notch_fit.nml"]],
    "simulate": [["simulate", DATA / "bench_truth.nml"]],
    "modes": [["modes", DATA / "table_4_1_noisy.nml"]],
    "frf": [["frf", "strip.nml"]],
    "frf-fit": [["identify", "frf_fit.nml"]],
    "modes-fit": [["identify", "modes_fit.nml"]],
    "mixed-fit": [["identify", "mixed_fit.nml"]],
    "profile": [["profile", DATA / "table_4_1_noisy.nml"]],
    "sample": [["identify", DATA / "table_4_1_noisy.nml"],
               ["sample", DATA / "table_4_1_noisy.nml"]],
    "bootstrap": [["bootstrap", DATA / "table_4_1_noisy.nml"]],
    "compare": [["compare", *(DATA / f"rpl_table_4_{k}.nml" for k in (3, 4, 6))]],
    "damping": [["compare", "--damping", "modes_fit.nml"]],
    "damping-fit": [["compare", "--damping", "modes_fit.nml"], ["identify", "modes_fit.nml"]],
    "design": [["design", DATA / "design_table_4_1.nml"]],
    "ensemble": [["ensemble", "ensemble.nml"]],
    "fleet": [["ensemble", "fleet.nml"]],
    "track": [["track", "track.nml"]],
    "table-4.1": [["reproduce", "table-4.1"]],
    "section-4": [["reproduce", "section-4"]],
}
# Parts of `reproduce all`, which writes a folder for each.
PARTS = ("table-4.1", "section-4", "acceleration", "convergence", "varying", "benchmarks",
         "damping")
# View: width in pixels, colour scheme, medium.
VIEWS = {"360": (360, "light", "screen"), "360-dark": (360, "dark", "screen"),
         "1200": (1200, "light", "screen"), "1200-dark": (1200, "dark", "screen"),
         "a4": (680, "light", "print")}

# Boxes of a page: widths, legends that overlap the plotted area, texts that are cut off.
INSPECT = """() => {
  const root = document.documentElement, found = { wide: [], covered: [], cut: [] };
  const name = (element) => element.closest("figure")?.textContent.slice(0, 60) ?? "";
  for (const element of document.querySelectorAll("table, pre, .box, h1, h2, p")) {
    const box = element.getBoundingClientRect();
    if (box.right > root.clientWidth + 1 && !element.closest(".scroll, .plot, pre, details")) {
      found.wide.push(element.tagName + ": " + element.textContent.slice(0, 60));
    }
  }
  for (const chart of document.querySelectorAll(".js-plotly-plot")) {
    const own = chart.getBoundingClientRect();
    if (!own.width) continue;
    const areas = [...chart.querySelectorAll(".nsewdrag")].map((a) => a.getBoundingClientRect());
    for (const legend of chart.querySelectorAll(".legend")) {
      const box = legend.getBoundingClientRect();
      for (const area of areas) {
        const x = Math.min(box.right, area.right) - Math.max(box.left, area.left);
        const y = Math.min(box.bottom, area.bottom) - Math.max(box.top, area.top);
        if (x > 1 && y > 1) found.covered.push([name(chart), x, y].join(" "));
      }
    }
    for (const text of chart.querySelectorAll(".main-svg text")) {
      const box = text.getBoundingClientRect();
      if (box.width && (box.left < own.left - 2 || box.right > own.right + 2 ||
          box.top < own.top - 2 || box.bottom > own.bottom + 2)) {
        found.cut.push(text.textContent + " in " + name(chart));
      }
    }
  }
  return { ...found, scroll: root.scrollWidth, client: root.clientWidth,
    figures: document.querySelectorAll(".plot").length, drawn: Number(root.dataset.drawn ?? 0),
    blank: [...document.querySelectorAll(".still")].filter((image) => !image.naturalWidth).length };
}"""


def program():
    """Returns the program of the tests, or of the newest build."""
    if os.environ.get("BEAMID_PROGRAM"):
        return Path(os.environ["BEAMID_PROGRAM"])
    built = sorted(CHECKOUT.glob("build/gfortran_*/app/beamid"),
                   key=lambda path: path.stat().st_mtime)
    return built[-1] if built else pytest.skip("the program is not built: scripts/run.sh version")


def run(*command, **options):
    """Runs a command in the folder of the pages; its failure is one of the test."""
    done = subprocess.run([str(word) for word in command], cwd=OUT, capture_output=True, text=True,
                          **options)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def everything():
    """The folder of `reproduce all`."""
    OUT.mkdir(parents=True, exist_ok=True)
    folder = OUT / "all"
    shutil.rmtree(folder, ignore_errors=True)
    run(program(), "reproduce", "all", "--out", folder, "--quiet")
    return folder


@pytest.fixture(scope="module", params=PAGES)
def page(request, browser):
    """The path of the report of a command, in a folder of its own."""
    OUT.mkdir(parents=True, exist_ok=True)
    (OUT / "ensemble.nml").write_text(CASE)
    (OUT / "priors.nml").write_text((DATA / "bench_fit.nml").read_text().replace(
        "'bench_record.csv'", f"'{DATA / 'bench_record.csv'}'") + PRIORS)
    (OUT / "list.txt").write_text("".join(f"{DATA / name}.nml\n" for name in
                                          ("table_4_1_noisy", "table_4_1_fit", "bench_fit")))
    (OUT / "fleet.nml").write_text("&ensemble cases='list.txt' /\n")
    (OUT / "strip.nml").write_text(STRIP.format(E="7e10"))
    (OUT / "modes.csv").write_text(TABLE)
    start = STRIP.format(E="6.5e10") + FREE
    (OUT / "frf_fit.nml").write_text(re.sub("&record.*\n", RESPONSE, start))
    (OUT / "modes_fit.nml").write_text(re.sub("&record.*\n", MODES, start))
    (OUT / "mixed_fit.nml").write_text(re.sub("&record.*\n", RESPONSE + MODES, start))
    dwell = re.sub("&(record|stage|track|disc).*\n", "", TRACK)
    (OUT / "dwell.nml").write_text(dwell.replace("kind='free', modes=2 /\n", DWELL))
    (OUT / "track.nml").write_text(TRACK)
    if request.param == "track":
        run(program(), "simulate", "dwell.nml", "--out", "dwell", "--quiet")
    if request.param.endswith("-fit"):
        run(program(), "frf", "strip.nml", "--out", "frf", "--quiet")
    if PAGES[request.param][0][0] == "reproduce":
        folder = request.getfixturevalue("everything") / request.param
    else:
        folder = OUT / request.param
        shutil.rmtree(folder, ignore_errors=True)
        for command in PAGES[request.param]:
            run(program(), *command, "--out", folder, "--quiet")
    command, *cases = (word for word in PAGES[request.param][-1] if word != "--damping")
    report = [sys.executable, CHECKOUT / "scripts" / "report.py", folder]
    if command not in ("identify", "reproduce"):
        report += ["--case", *cases]
    path = Path(run(*report).strip())
    first = path.read_bytes()
    run(*report)
    assert path.read_bytes() == first, "two reports of the same outputs differ"
    return path


@pytest.fixture(scope="module")
def tab(browser, page):
    """The report in the browser, what it complains about, and what it asks the network for."""
    tab = browser.new_page()
    faults, requests = [], []
    tab.on("pageerror", lambda error: faults.append(str(error)))
    tab.on("console", lambda message: faults.append(message.text)
           if message.type in ("error", "warning") else None)
    tab.on("request", lambda request: requests.append(request.url)
           if not request.url.startswith(("data:", "blob:")) else None)
    tab.goto(page.as_uri())
    tab.wait_for_function("document.documentElement.dataset.drawn || "
                          "!document.querySelector('.plot')", timeout=120000)
    yield tab, faults, requests
    tab.close()


@pytest.mark.parametrize("view", VIEWS)
def test_view(tab, page, view):
    width, scheme, medium = VIEWS[view]
    tab, faults, requests = tab
    tab.set_viewport_size({"width": width, "height": 900})
    tab.emulate_media(media=medium, color_scheme=scheme)
    if medium == "screen":    # figures follow the width of the window after a delay
        tab.wait_for_function("!document.querySelector('.plot') || "
                              "Number(document.documentElement.dataset.width) === innerWidth")
    found = tab.evaluate(INSPECT)
    target = OUT / f"{page.parent.name}-{view}"
    tab.screenshot(path=f"{target}.png", full_page=True)
    if medium == "print":
        tab.pdf(path=f"{target}.pdf", format="A4", prefer_css_page_size=True)

    assert faults == []
    assert requests == [page.as_uri()], "the page needs the network"
    assert found["drawn"] == found["figures"] and found["blank"] == 0
    assert found["scroll"] <= found["client"], "the page is wider than the screen"
    assert found["wide"] == [], "wider than the screen"
    assert found["covered"] == [], "a legend covers the plotted area"
    assert found["cut"] == [], "a text of a figure is cut off"


def test_text(page):
    """Symbols in place of names, units, short numbers, a description of every figure."""
    source = page.read_text(encoding="utf-8")
    prose = re.sub(r"(?s)<(script|style|pre|code|details)\b.*?</\1>", "", source)
    words = re.sub(r"<[^>]+>", "", prose)
    assert re.findall(r"\b(?:gamma|rho|[cmkEJ]_[A-Z])\b|\^\d|\d[Ee][+-]?\d\d", words) == []
    assert re.findall(r"\d\.\d{12,}", words) == []
    labels = re.findall(r'class="live" role="img" aria-label="([^"]*)"', source)
    assert all(len(label) > 8 for label in labels)
    assert re.findall(r"https?://|\bsrc=\"(?!data:)", source) == []
    assert ("<pre>" in prose or "<pre>" in source), "no case file"


def test_every_command_has_a_page():
    """A new command needs a report, too."""
    text = subprocess.run([program(), "help"], capture_output=True, text=True).stdout
    commands = set(re.findall(r"(?m)^  (\w+) (?=(?:\S+ )*?(?:case|a)\.nml|WHAT)", text))
    tested = {words[0] for commands in PAGES.values() for words in commands}
    assert commands == tested


def test_reproduce_all(everything):
    """A folder for each part, with the text that the part prints when it is run alone."""
    assert sorted(path.name for path in everything.iterdir() if path.is_dir()) == sorted(PARTS)
    texts = {part: (everything / part / "summary.txt").read_text() for part in PARTS}
    assert "Table 4.1" in texts["table-4.1"] and "exact responses" in texts["table-4.1"]
    alone = OUT / "section-4"
    shutil.rmtree(alone, ignore_errors=True)
    run(program(), "reproduce", "section-4", "--out", alone, "--quiet")
    assert (alone / "summary.txt").read_text() == texts["section-4"]


def test_hardly_apart():
    """Parameters that are correlated with one another make one group, whatever their order."""
    names = ["E", "m_S", "c_D", "k_R", "gamma", "offset"]
    strong = {("E", "k_R"): -1.0, ("c_D", "m_S"): 0.995, ("k_R", "m_S"): 0.991,
              ("gamma", "offset"): -0.999, ("E", "gamma"): 0.98, ("E", "cos_1"): 0.999}
    fit = SimpleNamespace(main=[{"parameter": name} for name in names], correlation_matrix=lambda: {
        **strong, **{(name, name): 1.0 for name in names}})
    text = re.sub("<[^>]*>", "", fit_page.Fit.compensating(fit))
    assert "0.99: E, mS, cD, kR; γ, offset." in text
    fit.correlation_matrix = lambda: {("E", "k_R"): 0.98}
    assert fit_page.Fit.compensating(fit) == ""
