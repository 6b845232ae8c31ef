"""The page of `beamid studio` in a headless Chromium: from a recorder's file to case and report.

The screenshots are in out/screenshots. Without NiceGUI, the package beamid, Playwright or Chromium
the tests are skipped; `scripts/setup.sh studio` and `scripts/setup.sh browser` install them.
"""

import http.client
import json
import os
import re
import signal
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("nicegui", reason="no NiceGUI: scripts/setup.sh studio")
pytest.importorskip("beamid", reason="no package beamid: scripts/setup.sh studio")
sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import beamid_command
import text_tables

CHECKOUT = Path(__file__).resolve().parent.parent.parent
SCREENSHOTS = CHECKOUT / "out" / "screenshots"
PROGRAM = os.environ.get("BEAMID_PROGRAM") or str(beamid_command.PROGRAM)
LIMIT = 3          # MB of an upload
WAIT = 120_000     # ms; a machine may be busy
BEAM = {"beam-length": "500", "beam-width": "50", "beam-height": "2", "sensor-x_s": "440",
        "sensor-m_s": "4"}
#: Mistakes at a field: the field, the text or the unit that is wrong, and a word of the sentence.
MISTAKES = [("beam-length", "500", "m", "looks like mm"), ("beam-e", "70", "N/m²", "GPa"),
            ("beam-density", "2.7", "kg/m³", "g/cm^3"), ("sensor-m_s", "4", "kg", "looks like g")]


class Server:
    """A studio in a process of its own."""

    def __init__(self, folder, *options):
        self.folder = folder
        # NiceGUI behaves differently below pytest.
        environment = {name: value for name, value in os.environ.items()
                       if not name.startswith("PYTEST_")}
        self.process = subprocess.Popen(
            [sys.executable, "-m", "beamid_command", "studio", "--no-browser", "--out", folder,
             "--limit", str(LIMIT), *map(str, options)], stdout=subprocess.PIPE, text=True,
            env={**environment, "BEAMID_PROGRAM": PROGRAM})
        line = self.process.stdout.readline()
        match = re.search(r"http://127\.0\.0\.1:(\d+)/\?token=(\S+)", line)
        assert match, line
        self.url, self.port, self.token = match[0], int(match[1]), match[2]

    def files(self):
        """Everything below the folder, with its size."""
        return sorted((str(path), path.stat().st_size) for path in self.folder.rglob("*")
                      if path.is_file())

    def settled(self):
        """The files as they are when nothing is being written any more."""
        before, after = None, self.files()
        while before != after:
            time.sleep(1.5)
            before, after = after, self.files()
        return after

    def children(self):
        """The processes that the server has started and that have not been waited for."""
        own = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children")
        return own.read_text().split()

    def memory(self):
        """The resident memory of the server in MB."""
        text = Path(f"/proc/{self.process.pid}/status").read_text()
        return int(re.search(r"VmRSS:\s+(\d+)", text)[1]) / 1000

    def ask(self, method="GET", path="/", headers=None, body=None, host=None):
        """Status and text of the answer to a request."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=20)
        connection.putrequest(method, path, skip_host=True)
        connection.putheader("Host", host or f"127.0.0.1:{self.port}")
        for name, value in (headers or {}).items():
            connection.putheader(name, value)
        connection.endheaders(body)
        answer = connection.getresponse()
        text = answer.read().decode("utf-8", "replace")
        connection.close()
        return answer.status, text

    @property
    def cookie(self):
        """What the browser sends after it has opened the page."""
        return {"Cookie": f"beamid_studio_{self.port}={self.token}"}

    def end(self, number=signal.SIGINT):
        """End the server, and return its exit status."""
        self.process.send_signal(number)
        return self.process.wait(timeout=20)


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    """A studio that stays without a tab."""
    found = Server(tmp_path_factory.mktemp("studio"), "--stay")
    yield found
    assert found.end() == 0, "Ctrl-C does not end the studio"
    assert not list(found.folder.glob(".studio-*")), "the scratch folder is left"


@pytest.fixture(scope="module")
def example(tmp_path_factory):
    """The times and accelerations of a strip that the program has simulated, E = 7e10 N/m^2."""
    folder = tmp_path_factory.mktemp("example")
    subprocess.run([PROGRAM, "new", "free-decay", folder / "trial"], check=True,
                   stdout=subprocess.DEVNULL)
    return np.loadtxt(folder / "trial" / "record.csv", delimiter=",", skiprows=1).T


def write(path, t, values, header="time,acceleration"):
    """Writes a recorder's file."""
    path.write_text(header + "\n" + "".join(f"{a!r},{b!r}\n" for a, b in
                                            zip(t.tolist(), values.tolist())))
    return path


def slow_record(folder):
    """Writes a record whose fit takes long: of two frequencies that are not those of the strip."""
    t = np.arange(0, 60, 0.002)
    values = 5 * np.exp(-0.02 * t) * np.sin(39.4 * t) + np.sin(256 * t)
    return write(folder / "slow.csv", t, values + 0.05 * np.cos(9000 * t**2))


@pytest.fixture()
def tab(browser, server):
    """A tab with the page, and what JavaScript complains about."""
    with_faults(page := browser.new_page(viewport={"width": 1400, "height": 900}))
    page.goto(server.url)
    page.wait_for_selector("[data-step=record]", timeout=WAIT)
    yield page
    assert page.faults == []
    page.close()


def with_faults(page):
    """Collects errors of JavaScript. Plotly does not resize a figure that has just been hidden."""
    page.set_default_timeout(WAIT)
    page.faults = []
    page.on("pageerror", lambda error: page.faults.append(str(error))
            if "Resize must be passed" not in str(error) else None)


def upload(page, path, place="file"):
    """Opens a file, and waits for the plot of the record."""
    page.set_input_files(f"[data-field={place}] input[type=file]", path)
    page.wait_for_function("document.querySelector('.js-plotly-plot')?._fullData?.length",
                           timeout=WAIT)


def pick(page, name, text):
    """Chooses from a list."""
    page.click(f"[data-field={name}]")
    choose(page, text)


def pick_unit(page, name, text):
    """Chooses the unit of a number."""
    page.locator(f".field:has([data-field={name}]) .q-field__append .q-select").click()
    choose(page, text)


def choose(page, text):
    """Chooses from the list that is open, and waits until it has gone."""
    page.locator(".q-menu .q-item").get_by_text(text, exact=True).click()
    page.wait_for_selector(".q-menu", state="detached", timeout=WAIT)


def describe(page, **values):
    """Enters the aluminium strip."""
    page.click("[data-step=beam]")
    pick(page, "material", "aluminium")
    for name, text in {**BEAM, **values}.items():
        page.fill(f"[data-field={name}]", text)


def wait_for_hints(page, number):
    """Wait until so many hints are visible, such as those of presets."""
    page.wait_for_function("(number) => [...document.querySelectorAll('.hint')].filter((one) => "
                           "one.offsetParent).length === number", arg=number, timeout=WAIT)


def fit(page, number):
    """Fits, and waits for the result of this number."""
    page.click("[data-step=fit]")
    page.click("[data-go=run]")
    page.wait_for_selector(f"[data-fit='{number}']", timeout=WAIT)
    page.wait_for_selector("[data-go=run]", timeout=WAIT)


def download(page, button, folder):
    """Saves what a button sends."""
    with page.expect_download(timeout=WAIT) as sent:
        page.click(f"[data-go={button}]")
    path = folder / sent.value.suggested_filename
    sent.value.save_as(path)
    return path


def unpacked_case(page, folder):
    """Saves and unpacks the case; returns its folder."""
    archive = download(page, "case", folder)
    with zipfile.ZipFile(archive) as packed:
        packed.extractall(folder)
    return folder / archive.stem


def look(page, name):
    """Takes screenshots of a step, in which nothing is wider than the screen."""
    SCREENSHOTS.mkdir(parents=True, exist_ok=True)
    for width in (1400, 800):
        for scheme in ("light", "dark"):
            page.set_viewport_size({"width": width, "height": 900})
            page.emulate_media(color_scheme=scheme)
            page.wait_for_function("(dark) => document.body.classList.contains('body--dark') "
                                   "=== dark", arg=scheme == "dark")
            page.wait_for_timeout(700)    # figures follow the width and the colours
            page.screenshot(path=SCREENSHOTS / f"studio-{name}-{width}-{scheme}.png",
                            full_page=True)
            sizes = page.evaluate("[document.documentElement.scrollWidth, "
                                  "document.documentElement.clientWidth]")
            assert sizes[0] <= sizes[1], f"{name} is wider than {width} pixels"
    page.set_viewport_size({"width": 1400, "height": 900})


def test_from_record_to_case(tab, server, example, tmp_path):
    """A file in ms and g with a quiet lead-in becomes a case that repeats the fit exactly."""
    _t, a = example
    quiet = 0.002 * np.random.default_rng(1).standard_normal(500)
    both = np.concatenate([quiet, a]) / 9.80665 + 0.02
    times = 2.0 * np.arange(both.size)
    upload(tab, write(tmp_path / "strip.csv", times, both, "t,z"))
    pick(tab, "time-unit", "ms")
    pick(tab, "unit", "g")
    tab.get_by_text("The motion begins at 1 s").wait_for(timeout=WAIT)

    # The window is dragged: from a fifth of the record to its middle, 1 to 2.5 s.
    area = tab.locator(".nsewdrag").first.bounding_box()
    middle = area["y"] + area["height"] / 2
    tab.mouse.move(area["x"] + 0.3 * area["width"], middle)
    tab.mouse.down()
    for share in (0.4, 0.6, 0.9):
        tab.mouse.move(area["x"] + share * area["width"], middle)
    tab.mouse.up()
    tab.wait_for_function("document.querySelector('[data-field=record-t_last]').value > 0")
    ends = [float(tab.input_value(f"[data-field=record-{key}]")) for key in ("t_first", "t_last")]
    span = times[-1] / 1000
    assert np.allclose(ends, [0.3 * span, 0.9 * span], atol=0.02 * span)

    describe(tab)
    tab.locator(".modes figure").first.wait_for(timeout=WAIT)
    frequency = float(re.search(r"1 ([\d.]+) Hz", tab.locator(
        ".modes figcaption").first.inner_text())[1])
    assert frequency == pytest.approx(6.26, rel=0.02)
    look(tab, "beam")
    tab.click("[data-step=record]")
    look(tab, "record")
    tab.click("[data-step=fit]")
    tab.click("[data-free=m_S]")
    fit(tab, 1)
    assert "The model explains" in tab.locator(".report .box").first.inner_text()
    look(tab, "fit")
    report = download(tab, "report", tmp_path).read_text(encoding="utf-8")
    assert "Where the error comes from" in report and "The model explains" in report
    tab.click("[data-go=profile]")
    tab.get_by_text("Beyond linear theory").wait_for(timeout=WAIT)
    tab.click("[data-step=save]")
    look(tab, "save")
    folder = unpacked_case(tab, tmp_path)
    case = (folder / "case.nml").read_text()
    assert "scale=9.80665" in case and f"t_first={ends[0]:g}" in case
    subprocess.run([PROGRAM, "identify", "case.nml", "--quiet", "--out", "out"], cwd=folder,
                   check=True, stdout=subprocess.DEVNULL)
    there = server.folder / folder.name / "fit_1"
    for name in ("estimates.csv", "modes.csv", "fit.csv", "summary.txt"):
        assert (folder / "out" / name).read_text() == (there / name).read_text(), name
    rows = [line.split(",") for line in (there / "estimates.csv").read_text().splitlines()]
    row = dict(zip(rows[0], next(row for row in rows if "E" in row)))
    assert float(row["total_lower95"]) < 7e10 < float(row["total_upper95"])


def test_mistakes_before_the_fit(tab, example, tmp_path):
    """Units that are mixed up are named at their field, and only while they are."""
    upload(tab, write(tmp_path / "strip.csv", *example))
    describe(tab)
    tab.locator(".modes figure").first.wait_for(timeout=WAIT)
    for name, text, unit, words in MISTAKES:
        usual = tab.locator(f".field:has([data-field={name}]) .q-field__append "
                            ".q-field__native").inner_text()
        before = tab.input_value(f"[data-field={name}]")
        tab.fill(f"[data-field={name}]", text)
        if unit != usual.strip():
            pick_unit(tab, name, unit)
        sentence = tab.locator(f".field:has([data-field={name}]) .tell.error")
        sentence.get_by_text(words).wait_for(timeout=WAIT)
        tab.fill(f"[data-field={name}]", before)
        if unit != usual.strip():
            pick_unit(tab, name, usual.strip())
        sentence.wait_for(state="detached", timeout=WAIT)
    tab.fill("[data-field=beam-length]", "half a metre")
    tab.get_by_text("Found half a metre, expected a number").wait_for(timeout=WAIT)
    tab.fill("[data-field=beam-length]", "500")
    # Time stamps in ms that are taken for s.
    tab.click("[data-step=record]")
    upload(tab, write(tmp_path / "stamps.csv", 1000 * example[0], example[1]))
    tab.get_by_text("the time stamps look like milliseconds").first.wait_for(timeout=WAIT)
    pick(tab, "time-unit", "ms")
    tab.get_by_text("the time stamps look like milliseconds").first.wait_for(
        state="detached", timeout=WAIT)


def test_mistakes_after_the_fit(tab, example, tmp_path):
    """What only a fit can show is named after it: an offset, and a wrong rate."""
    _t, a = example
    (tmp_path / "values.csv").write_text("a\n" + "".join(f"{x + 3!r}\n" for x in a.tolist()))
    tab.set_input_files("[data-field=file] input[type=file]", tmp_path / "values.csv")
    tab.fill("[data-field=rate]", "1000", timeout=WAIT)    # it is 500
    describe(tab)
    tab.click("[data-step=fit]")
    tab.click("[data-free=m_S]")
    fit(tab, 1)
    tab.click("[data-step=record]")
    tab.get_by_text("check rate or the time stamps").wait_for(timeout=WAIT)
    tab.fill("[data-field=rate]", "500")
    tab.click("[data-step=fit]")
    tab.click("[data-free=offset]")
    tab.wait_for_timeout(600)
    fit(tab, 2)
    tab.get_by_role("button", name="Estimate offset").click(timeout=WAIT)
    tab.locator("[data-free=offset][aria-checked=true]").wait_for(timeout=WAIT)
    fit(tab, 3)
    assert tab.get_by_role("button", name="Estimate offset").count() == 0
    tab.click("[data-go=compare]")
    tab.get_by_text("not estimated").first.wait_for(timeout=WAIT)


REFUSED = {
    "no token": (403, {}, "/", None),
    "wrong token": (403, {}, "/?token=abc", None),
    "token in another cookie": (403, {"Cookie": "beamid_studio=abc"}, "/", None),
    "no token for a file": (403, {}, "/_nicegui/", None),
    "another host": (403, "cookie", "/", "evil.example"),
    "another origin": (403, {"Origin": "http://evil.example"}, "cookie", None),
    "null origin": (403, {"Origin": "null"}, "cookie", None),
    "path traversal": (404, "cookie", "/_nicegui/../../../../etc/passwd", None),
    "encoded path traversal": (404, "cookie", "/%2e%2e/%2e%2e/etc/passwd", None),
}


@pytest.mark.parametrize("what", REFUSED)
def test_refused(server, what):
    """A request that is none of the page is refused in one sentence, and nothing is written."""
    status, headers, path, host = REFUSED[what]
    headers = server.cookie if headers == "cookie" else dict(headers)
    if path == "cookie":
        headers, path = {**headers, **server.cookie}, "/"
    before = server.files()
    found, text = server.ask(path=path, headers=headers, host=host)
    assert found == status and text.count("\n") == 1 and text.strip().endswith("."), text
    assert not set(server.files()) - set(before)


@pytest.mark.parametrize("origin, cookie, path", [
    ("http://evil.example", True, ""), (None, True, ""), ("own", False, ""), ("own", True, "ok")])
def test_websocket(server, origin, cookie, path):
    """A websocket of another page, or without a token, is refused; that of the page is accepted."""
    own = f"http://127.0.0.1:{server.port}"
    headers = {"Upgrade": "websocket", "Connection": "Upgrade", "Sec-WebSocket-Version": "13",
               "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
               **({"Origin": own if origin == "own" else origin} if origin else {}),
               **(server.cookie if cookie else {})}
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=20)
    connection.request("GET", "/_nicegui_ws/socket.io/?EIO=4&transport=websocket",
                       headers=headers)
    answer = connection.getresponse()
    assert answer.status == (101 if path == "ok" else 403)
    if path != "ok":
        assert answer.read().decode().strip().endswith(".")
    connection.close()


def test_huge_upload(tab, server, tmp_path):
    """A file of 2 GB is refused before it is sent, and one without a length when it is too long."""
    address = tab.evaluate("""() => { let found; const own = XMLHttpRequest.prototype.open;
        XMLHttpRequest.prototype.open = function (method, url) { found = url;
            return own.apply(this, arguments); }; window.address = () => found; }""")
    small = write(tmp_path / "small.csv", np.arange(50.0), np.arange(50.0) % 7)
    upload(tab, small)
    address = tab.evaluate("window.address()")
    assert "/upload/" in address
    before = server.settled()
    kind = {"Content-Type": "multipart/form-data; boundary=x"}
    found, text = server.ask("POST", address, {**server.cookie, **kind,
                                               "Content-Length": str(2 * 10**9)})
    assert found == 413 and text.count("\n") == 1
    head = b'--x\r\nContent-Disposition: form-data; name="a"; filename="a.csv"\r\n\r\n'
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=20)
    pieces = (head if k == 0 else b"1,2\n" * 50_000 for k in range(60))
    try:
        connection.request("POST", address, body=pieces, encode_chunked=True, headers={
            **server.cookie, **kind, "Transfer-Encoding": "chunked"})
        answer = connection.getresponse()
        assert answer.status == 413
    except (BrokenPipeError, ConnectionResetError):
        pass    # the server has closed the connection while the rest was being sent
    connection.close()
    assert not set(server.settled()) - set(before)
    # The page itself says so, without sending the file.
    large = tmp_path / "large.csv"
    large.write_bytes(b"1,2\n" * (LIMIT * 300_000))
    tab.set_input_files("[data-field=file] input[type=file]", large)
    tab.get_by_text(f"The file is larger than {LIMIT} MB").wait_for(timeout=WAIT)
    assert not set(server.settled()) - set(before)


def test_markup_in_names(tab, server, example, tmp_path):
    """Names of files and columns are shown as they are, and are no paths."""
    mark = "<img src=x onerror='window.run=1'>"
    path = tmp_path / f"..{mark.replace('/', '')}.csv"
    upload(tab, write(path, *example, f"t,<b>z</b> {mark}"))
    tab.wait_for_timeout(500)
    assert tab.evaluate("[window.run === undefined, document.querySelectorAll('img[src=x]')"
                        ".length]") == [True, 0]
    assert tab.locator(".js-plotly-plot .ytitle").first.text_content().startswith("<b>z</b>")
    assert path.name in tab.locator(".facts").inner_text()
    tab.click("[data-step=save]")
    assert tab.evaluate("window.run === undefined")
    folders = [one for one in server.folder.iterdir() if "img" in one.name]
    assert len(folders) == 1 and re.fullmatch(r"[A-Za-z0-9_-]+", folders[0].name)


def test_many_fits(browser, tab, server, example, tmp_path):
    """Twenty fits in a row, cancelled fits and two tabs leave no process and mix up nothing."""
    part = example[:, :300]
    upload(tab, write(tmp_path / "short.csv", *part))
    describe(tab)
    fit(tab, 1)
    fit(tab, 2)
    memory = server.memory()
    for number in range(3, 21):
        fit(tab, number)
    assert tab.locator("[data-fit]").count() == 20
    growth = server.memory() - memory
    assert growth < 80, f"memory grows by {growth / 18:.1f} MB per fit"
    assert server.children() == []

    # A long fit of another tab is cancelled, and leaves no result.
    with_faults(other := browser.new_page(viewport={"width": 1400, "height": 900}))
    other.goto(server.url)
    other.wait_for_selector("[data-step=record]", timeout=WAIT)
    upload(other, slow_record(tmp_path))
    describe(other)
    other.click("[data-step=fit]")
    for _ in range(3):
        other.click("[data-go=run]")
        other.wait_for_selector("[data-go=cancel]", timeout=WAIT)
        other.click("[data-go=cancel]")
        other.wait_for_selector("[data-go=run]", timeout=WAIT)
    assert other.locator("[data-fit]").count() == 0
    assert tab.locator("[data-fit]").count() == 20
    # A tab that is closed during its fit takes the program with it.
    other.click("[data-go=run]")
    other.wait_for_selector("[data-go=cancel]", timeout=WAIT)
    other.close()
    deadline = time.monotonic() + 30
    while server.children() and time.monotonic() < deadline:
        time.sleep(0.2)
    assert server.children() == []
    for folder in server.folder.glob("slow*/fit_*"):    # a fit that has ended before
        assert (folder / "manifest.txt").exists()


def restored(page):
    """Loads a tab again, and waits for its page."""
    page.reload()
    page.wait_for_selector("[data-step=record]", timeout=WAIT)


def test_reload(browser, tab, server, example, tmp_path):
    """A tab that is loaded again shows its record, its inputs and its fits, and no others."""
    before = {path.name for path in server.folder.iterdir()}
    upload(tab, write(tmp_path / "again.csv", *example))
    tab.fill("[data-field=record-t_last]", "2.5")
    describe(tab)
    pick_unit(tab, "beam-length", "cm")
    tab.fill("[data-field=beam-length]", "50")
    tab.click("[data-step=fit]")
    tab.click("[data-free=gamma]")
    fit(tab, 1)
    restored(tab)
    tab.wait_for_selector("[data-fit='1']", timeout=WAIT)
    tab.get_by_text("The model explains").first.wait_for(timeout=WAIT)
    assert tab.locator("[data-free=gamma]").get_attribute("aria-checked") == "false"
    tab.click("[data-step=beam]")
    assert tab.input_value("[data-field=beam-length]") == "50"
    tab.locator(".modes figure").first.wait_for(timeout=WAIT)
    tab.click("[data-step=record]")
    assert tab.input_value("[data-field=record-t_last]") == "2.5"
    tab.wait_for_function("document.querySelector('.js-plotly-plot')?._fullData?.length",
                          timeout=WAIT)
    # A tab that is duplicated has the storage of the first, but not its session.
    with tab.context.expect_page() as opened:
        tab.evaluate("window.open(location.href)")
    with_faults(other := opened.value)
    other.wait_for_selector("[data-step=record]", timeout=WAIT)
    assert other.evaluate("sessionStorage.length") > 0
    assert other.locator(".facts").inner_text() == ""
    other.close()
    # Another file in the tab: the fit of the first is not that of this one.
    upload(tab, write(tmp_path / "other.csv", *example[:, :400]))
    tab.get_by_text("other.csv").first.wait_for(timeout=WAIT)
    restored(tab)
    tab.get_by_text("other.csv").first.wait_for(timeout=WAIT)
    tab.click("[data-step=fit]")
    tab.get_by_text("The result of the fit appears here").wait_for(timeout=WAIT)
    assert {path.name for path in server.folder.iterdir()} - before == {"again", "other"}


def test_reload_during_a_fit(tab, server, example, tmp_path):
    """A fit goes on while its tab is loaded again, and can then be seen, and cancelled."""
    upload(tab, slow_record(tmp_path))
    describe(tab)
    tab.click("[data-step=fit]")
    tab.click("[data-go=run]")
    tab.wait_for_selector("[data-go=cancel]", timeout=WAIT)
    restored(tab)
    tab.wait_for_selector("[data-go=cancel]", timeout=WAIT)
    tab.click("[data-go=cancel]")
    tab.wait_for_selector("[data-go=run]", timeout=WAIT)
    assert tab.locator("[data-fit]").count() == 0 and server.children() == []
    upload_again = write(tmp_path / "short.csv", *example[:, :300])
    tab.click("[data-step=record]")
    upload(tab, upload_again)
    tab.get_by_text("short.csv").first.wait_for(timeout=WAIT)
    tab.click("[data-step=fit]")
    tab.wait_for_timeout(1000)
    tab.click("[data-go=run]")
    restored(tab)
    tab.wait_for_selector("[data-fit='1']", timeout=WAIT)
    tab.get_by_text("The model explains").first.wait_for(timeout=WAIT)


def test_sleep(browser, server, example, tmp_path):
    """A page whose websocket was given up while it slept comes back as it was."""
    with_faults(page := browser.new_page(viewport={"width": 1400, "height": 900}))
    page.goto(server.url)
    page.wait_for_selector("[data-step=record]", timeout=WAIT)
    upload(page, write(tmp_path / "sleep.csv", *example))
    describe(page)
    page.wait_for_timeout(1000)
    # A page that sleeps does not answer: the processes of the pages stand still.
    control = browser.new_browser_cdp_session()
    pages = [process["id"] for process in control.send("SystemInfo.getProcessInfo")["processInfo"]
             if process["type"] == "renderer"]
    for number in pages:
        os.kill(number, signal.SIGSTOP)
    time.sleep(40)    # the server waits 25 s for an answer, and 10 s for another websocket
    for number in pages:
        os.kill(number, signal.SIGCONT)
    page.wait_for_function("performance.now() < 38000", timeout=WAIT)    # it has loaded again
    page.wait_for_selector("[data-step=beam]", timeout=WAIT)
    page.wait_for_function("document.querySelector('[data-field=beam-length]')?.value === '500'",
                           timeout=WAIT)
    page.click("[data-step=record]")
    page.get_by_text("sleep.csv").first.wait_for(timeout=WAIT)
    page.close()


def test_memory_of_reloads(tab, server, tmp_path):
    """Loading a tab again and again, and closing tabs, does not let the memory grow."""
    t = np.arange(0, 60, 0.001)
    upload(tab, write(tmp_path / "long.csv", t, np.sin(39.4 * t)))
    growths = []
    # The first pages make the heap as large as it has to be, and later its gaps may grow once more.
    # What is kept for every page grows each time.
    while len(growths) < 5 and (len(growths) < 2 or growths[-1] > 8):
        before = server.memory()
        for _ in range(15):
            restored(tab)
        tab.wait_for_timeout(13000)    # pages that were left are deleted after 10 s
        growths.append(server.memory() - before)
    assert growths[-1] <= 8, f"MB that every 15 loads add: {growths}"
    tab.get_by_text("long.csv").first.wait_for(timeout=WAIT)


def frequency_response(folder):
    """Writes the accelerance of the strip under a force at 200 mm, with a noise of 0.1 1/kg."""
    folder.mkdir()
    (folder / "frf.nml").write_text(
        "&beam length=0.5, width=0.05, height=0.002, density=2700, E=7e10, c_D=2e6, gamma=0.05 /\n"
        "&sensor x_S=0.44, m_S=0.004 /\n"
        "&record kind='frf', f_first=2, f_last=300, f_step=0.5, x_F=0.2 /\n")
    subprocess.run([PROGRAM, "frf", "frf.nml", "--quiet", "--out", "out"], cwd=folder, check=True,
                   stdout=subprocess.DEVNULL)
    rows = [line.split(",") for line in (folder / "out" / "frf.csv").read_text().splitlines()]
    finest = rows[-1][0]
    places = [rows[0].index(name) for name in ("frequency_hz", "real", "imag")]
    f, real, imag = np.array([[float(row[k]) for k in places] for row in rows[1:]
                              if row[0] == finest]).T
    noise = 0.1 * np.random.default_rng(2).standard_normal((2, f.size))
    text = "frequency_hz,real,imag,sd\n" + "".join(
        f"{a!r},{b!r},{c!r},0.1\n" for a, b, c in
        zip(f.tolist(), (real + noise[0]).tolist(), (imag + noise[1]).tolist()))
    (folder / "response.csv").write_text(text)
    return folder / "response.csv"


def dashed(page, place=0):
    """The frequencies of the model in a figure, from its dashed lines."""
    return page.evaluate("""(place) => [...new Set(
        [...document.querySelectorAll('.js-plotly-plot')].filter((one) => one.offsetParent)[place]
        ._fullData.filter((one) => one.line?.dash === 'dash').flatMap((one) => [...one.x])
        .filter((x) => x !== null))]""", place)


def test_several_records(tab, server, example, tmp_path):
    """Records are added, edited one by one and removed; fit and download contain all of them."""
    t, a = example
    upload(tab, write(tmp_path / "first.csv", t, a))
    describe(tab)
    tab.click("[data-step=record]")
    tab.fill("[data-field=record-t_last]", "3")
    tab.wait_for_timeout(600)    # a field waits for the end of typing
    # The second file counts in ms and in g, and has another window.
    upload(tab, write(tmp_path / "second.csv", 1000 * t, a / 9.80665), "further")
    tab.get_by_text("second.csv").first.wait_for(timeout=WAIT)
    pick(tab, "time-unit", "ms")
    pick(tab, "unit", "g")
    assert tab.input_value("[data-field=record-t_last]") == ""
    tab.fill("[data-field=record-t_first]", "1.5")
    tab.wait_for_timeout(600)
    upload(tab, write(tmp_path / "third.csv", t, a), "further")
    tab.wait_for_selector("[data-record='3']", timeout=WAIT)
    # An unusable window of one record is named beside the others.
    tab.fill("[data-field=record-t_first]", "77")
    tab.locator(".field:has([data-field=record-t_first]) .tell.error").wait_for(timeout=WAIT)
    tab.click("[data-record='1']")
    tab.get_by_text("Record 3: ").first.wait_for(timeout=WAIT)
    tab.wait_for_function("document.querySelector('[data-field=record-t_last]').value === '3'")
    look(tab, "records")
    tab.click("[data-record='3']")
    tab.wait_for_selector("[aria-label='remove record 3']", timeout=WAIT)
    tab.click("[data-go=remove-record]")
    tab.wait_for_selector("[data-record='3']", state="detached", timeout=WAIT)
    # The message goes with the next check of the case.
    tab.get_by_text("Record 3: ").first.wait_for(state="detached", timeout=WAIT)
    assert tab.get_by_text("Record 3: ").count() == 0
    restored(tab)
    tab.wait_for_selector("[data-record='2']", timeout=WAIT)
    tab.wait_for_function("document.querySelector('[data-field=record-t_first]').value === '1.5'")
    fit(tab, 1)
    tab.click("[data-step=save]")
    folder = unpacked_case(tab, tmp_path)
    case = (folder / "case.nml").read_text()
    assert re.findall(r"&record +(.*) /", case) == [
        "file='record.csv', t_last=3", "file='record_2.csv', scale=9.80665, t_first=1.5"]
    subprocess.run([PROGRAM, "identify", "case.nml", "--quiet", "--out", "out"], cwd=folder,
                   check=True, stdout=subprocess.DEVNULL)
    there = server.folder / folder.name / "fit_1"
    assert (folder / "out/estimates.csv").read_text() == (there / "estimates.csv").read_text()
    assert (there / "summary.txt").read_text().count("\nrecord 2:") == 1


def test_records_of_frequencies(tab, server, tmp_path):
    """A frequency response and a table of modes are drawn with the frequencies of the model."""
    upload(tab, frequency_response(tmp_path / "frf"))
    tab.get_by_text("2 to 300 Hz").wait_for(timeout=WAIT)
    assert dashed(tab) == []
    describe(tab)
    tab.locator(".modes figure").first.wait_for(timeout=WAIT)
    tab.wait_for_timeout(1000)
    before = dashed(tab)
    tab.fill("[data-field=beam-e]", "280")
    tab.wait_for_function("document.querySelector('.modes figcaption').innerText.includes('12.6')",
                          timeout=WAIT)
    tab.wait_for_timeout(1000)
    assert before[0] == pytest.approx(6.32, rel=0.01) and len(before) == 4
    assert dashed(tab)[0] == pytest.approx(2 * before[0], rel=1e-4)
    tab.fill("[data-field=beam-e]", "70")
    tab.click("[data-step=record]")
    tab.fill("[data-field=record-x_f]", "200")
    tab.fill("[data-field=record-f_last]", "250")
    look(tab, "frf")
    (tmp_path / "modes.csv").write_text("frequency_hz,sd_hz,damping_ratio,sd_damping\n"
                                        "6.33,0.02,0.0027,0.001\n40.9,0.1,0.004,0.001\n")
    upload(tab, tmp_path / "modes.csv", "further")
    tab.get_by_text("2, 6.33 to 40.9 Hz").wait_for(timeout=WAIT)
    tab.wait_for_function("""[...document.querySelectorAll('.js-plotly-plot')].filter(
        (one) => one.offsetParent)[0]._fullData.length === 6""", timeout=WAIT)
    shown = tab.evaluate("""[...document.querySelectorAll('.js-plotly-plot')].filter(
        (one) => one.offsetParent)[0]._fullData.map((one) => [one.name, [...one.y],
        one.error_y?.array && [...one.error_y.array]])""")
    assert [name for name, *_ in shown] == ["model", "measured, 95 %"] * 3
    assert shown[1][1:] == [[6.33, 40.9], pytest.approx([0.0392, 0.196])]
    assert shown[0][1] == pytest.approx([6.324, 40.83], rel=1e-3)
    look(tab, "modes")
    fit(tab, 1)
    summary = next(server.folder.glob("response*/fit_1/summary.txt")).read_text()
    assert "record 1: 497 lines" in summary and "record 2: 2 modes" in summary
    assert tab.get_by_text("A free decay").count() == 0
    tab.click("[data-step=record]")
    (tmp_path / "bare.csv").write_text("frequency_hz,damping_ratio\n6.33,0.0027\n40.9,0.004\n")
    tab.set_input_files("[data-field=further] input[type=file]", tmp_path / "bare.csv")
    tab.get_by_text("or 'sd_hz' for a table of modes").wait_for(timeout=WAIT)


def hammer(folder):
    """Writes the force and the acceleration of the strip under a blow at 200 mm."""
    folder.mkdir()
    t = np.arange(0, 4, 0.002)
    force = np.where((t > 0.1) & (t < 0.14), 2 * np.sin(np.pi * (t - 0.1) / 0.04)**2, 0.0)
    write(folder / "force.csv", t, force, "t,force [N]")
    (folder / "truth.nml").write_text(
        "&beam length=0.5, width=0.05, height=0.002, density=2700, E=7e10, c_D=2e6, gamma=0.05 /\n"
        "&sensor x_S=0.44, m_S=0.004 / &excitation kind='table', file='force.csv', x_F=0.2 /\n"
        "&record t_first=0, t_last=3.998, t_step=0.002 / &noise sd=0.02, seed=3 /\n")
    subprocess.run([PROGRAM, "simulate", "truth.nml", "--quiet", "--out", "out"], cwd=folder,
                   check=True, stdout=subprocess.DEVNULL)
    a = np.loadtxt(folder / "out" / "record.csv", delimiter=",", skiprows=1)[:, 1]
    rows = zip(t.tolist(), (force / 1000).tolist(), a.tolist())
    (folder / "hammer.csv").write_text("t [s],force,acceleration [m/s^2]\n" + "".join(
        f"{x!r},{y!r},{z!r}\n" for x, y, z in rows))
    return folder / "hammer.csv"


def test_measured_force(tab, server, tmp_path):
    """A force in a column of the file, or in a file of its own, is the excitation."""
    folder = tmp_path / "hammer"
    upload(tab, hammer(folder))
    describe(tab)
    tab.click("[data-step=fit]")
    # What the program asks of an impulse and of a release stands at its field.
    pick(tab, "motion", "impulse: a constant force")
    tab.locator(".field:has([data-field=excitation-amplitude]) .tell.error").wait_for(timeout=WAIT)
    pick(tab, "motion", "release: pulled aside and let go")
    tab.locator(".field:has([data-field=excitation-force]) .tell.error").wait_for(timeout=WAIT)
    tab.fill("[data-field=excitation-displacement]", "10")
    tab.locator(".field:has([data-field=excitation-force]) .tell.error").wait_for(
        state="detached", timeout=WAIT)
    pick(tab, "motion", "measured force")
    pick(tab, "force", "force")
    pick(tab, "force-unit", "kN")
    tab.fill("[data-field=excitation-x_f]", "600")
    tab.locator(".field:has([data-field=excitation-x_f]) .tell.error").wait_for(timeout=WAIT)
    tab.fill("[data-field=excitation-x_f]", "200")
    tab.locator(".field:has([data-field=excitation-x_f]) .tell.error").wait_for(
        state="detached", timeout=WAIT)
    look(tab, "motion")
    fit(tab, 1)
    restored(tab)
    tab.wait_for_selector("[data-fit='1']", timeout=WAIT)
    tab.set_input_files("[data-field=force-file] input[type=file]", folder / "force.csv")
    tab.get_by_text("force [N] (force.csv)").wait_for(timeout=WAIT)
    fit(tab, 2)
    tab.click("[data-step=save]")
    own = unpacked_case(tab, tmp_path)
    assert "&excitation kind='table', file='force_2.csv', x_F=0.2 /" in (
        own / "case.nml").read_text()
    subprocess.run([PROGRAM, "identify", "case.nml", "--quiet", "--out", "out"], cwd=own,
                   check=True, stdout=subprocess.DEVNULL)
    texts = [path.read_text() for path in (own / "out/estimates.csv", *(
        server.folder / own.name / f"fit_{k}" / "estimates.csv" for k in (1, 2)))]
    assert texts[0] == texts[2]
    for text in texts[1:]:    # a force in kN is that in N but for round-off
        rows = [line.split(",") for line in text.splitlines()]
        row = dict(zip(rows[0], next(row for row in rows if "E" in row)))
        assert float(row["estimate"]) == pytest.approx(7e10, rel=2e-3)
        assert float(row["total_lower95"]) < 7e10 < float(row["total_upper95"])


def ruler(folder):
    """Writes the record of a steel ruler that is pulled aside and let go after a quiet second."""
    folder.mkdir()
    (folder / "truth.nml").write_text(
        "&beam length=0.3, width=0.025, height=0.001, density=7850, E=2.03e11, c_D=3e6, "
        "gamma=0.02 /\n&sensor x_S=0.28, m_S=0.005 /\n"
        "&excitation kind='release', displacement=0.01, time=1 /\n"
        "&record t_first=0, t_last=8, t_step=0.002 / &noise sd=0.05, seed=4 /\n")
    subprocess.run([PROGRAM, "simulate", "truth.nml", "--quiet", "--out", "out"], cwd=folder,
                   check=True, stdout=subprocess.DEVNULL)
    t, a = np.loadtxt(folder / "out" / "record.csv", delimiter=",", skiprows=1).T
    return write(folder / "ruler.csv", t, a + 0.35, "Time (s),Acceleration z (m/s^2)")


def test_first_user(tab, server, tmp_path):
    """The file and the dimensions of a ruler lead to its modulus in ten actions or fewer.

    The page then says what a change, a preset, a refused run and a narrow interval mean.
    """
    actions = [lambda: upload(tab, ruler(tmp_path / "ruler")),
               lambda: tab.click("[data-go=beam]"),
               lambda: tab.fill("[data-field=beam-length]", "300"),
               lambda: tab.fill("[data-field=beam-width]", "25"),
               lambda: tab.fill("[data-field=beam-height]", "1"),
               lambda: pick(tab, "material", "steel"),
               lambda: tab.fill("[data-field=sensor-x_s]", "280"),
               lambda: tab.fill("[data-field=sensor-m_s]", "5"),
               lambda: tab.click("[data-go=run-now]")]
    assert len(actions) <= 10
    for action in actions:
        action()
    tab.wait_for_selector("[data-fit='1']", timeout=WAIT)
    tab.get_by_text("The model explains").first.wait_for(timeout=WAIT)
    # The window begins at the release, with higher modes than those of the fit: the only remark.
    assert tab.locator("[data-step=record] .q-badge").inner_text() == "1"
    assert re.search(r"Begin at [\d.]+, and fit again", tab.inner_text("body"))
    text = (server.folder / "ruler" / "fit_1" / "estimates.csv").read_text()
    rows = [line.split(",") for line in text.splitlines()]
    row = dict(zip(rows[0], next(row for row in rows if "E" in row)))
    assert float(row["estimate"]) == pytest.approx(2.03e11, rel=5e-3)
    assert float(row["total_lower95"]) < 2.03e11 < float(row["total_upper95"])
    assert tab.evaluate("scrollY") == 0    # the step of the beam was scrolled to its button
    says_what_the_result_is(tab)
    follows_changes(tab)
    refuses_once(tab)
    look(tab, "ruler")
    compares(tab)
    shows_what_is_added(tab)
    begins_later(tab, server)


def begins_later(tab, server):
    """One click takes the time at which the program proposes to begin, and fits again."""
    tab.click("[data-fit='1']")
    begin = re.search(r"Begin at ([\d.]+) s", tab.inner_text("[data-go=begin]"))[1]
    fits = tab.locator("[data-fit]").count()
    tab.click("[data-go=begin]")
    tab.wait_for_selector(f"[data-fit='{fits + 1}']", timeout=WAIT)
    text = (server.folder / "ruler" / f"fit_{fits + 1}" / "case.txt").read_text()
    assert f"t_first={begin}" in text
    tab.locator("[data-go=begin]").wait_for(state="detached", timeout=WAIT)
    # What the first fit said returns with it, once the inputs are its own again.
    badge = tab.locator("[data-step=record] .q-badge")
    tab.click("[data-step=record]")
    tab.fill("[data-field=record-t_first]", "")
    tab.fill("[data-field=record-t_last]", "")
    tab.click("[data-step=fit]")
    tab.fill("[data-field=prior-m_s]", "0.5")
    tab.fill("[data-field=prior-height]", "0.02")
    badge.wait_for(state="hidden", timeout=WAIT)
    tab.click("[data-fit='1']")
    badge.wait_for(timeout=WAIT)
    # The buttons are new ones as soon as the result is shown; a click on an old one is lost.
    tab.locator("[data-go=report]").get_by_text("Report of fit 1").wait_for(timeout=WAIT)
    tab.click(f"[data-fit='{fits + 1}']")
    badge.wait_for(state="hidden", timeout=WAIT)


def says_what_the_result_is(tab):
    """Units are those of the fields; presets are named, and what each command does."""
    tables = tab.locator(".report:has(.bars) table")
    assert re.search(r"\nE\t203\t.*\tGPa\t", "\n" + tables.filter(
        has_text="from noise alone").inner_text())
    assert re.search(r"\nheight\t0.02 mm\t\u22124\.\d+ %\t", tables.filter(
        has_text="standard deviation").inner_text())
    assert tab.get_by_text("Preset: Enter confirms").count() == 4
    mass = tab.locator("[data-field=prior-m_s]")
    assert mass.input_value() == "0.5"    # g, a tenth of 5 g
    mass.fill("")
    effect = tab.get_by_text("An error of 10 % would move E by").inner_text()
    assert 1 < float(re.search(r"by ([\d.]+) %", effect)[1]) < 4
    mass.fill("0.5")
    for command in ("profile", "sample", "bootstrap", "track"):
        tab.hover(f"[data-go={command}]")
        tab.locator(".q-tooltip").get_by_text("Fits" if command != "sample" else "Draws"
                                              ).wait_for(timeout=WAIT)
        tab.mouse.move(700, 5)
        tab.wait_for_selector(".q-tooltip", state="detached", timeout=WAIT)


def follows_changes(tab):
    """A result of other inputs is marked; a window before the motion is named at its field."""
    mark = tab.locator("[data-mark=outdated]")
    assert mark.is_hidden() and tab.locator("[data-field=outdated]").is_hidden()
    tab.fill("[data-field=prior-m_s]", "0.6")
    tab.get_by_text("Standard deviation of m_S (0.5 g, now 0.6 g)").wait_for(timeout=WAIT)
    assert mark.is_visible() and "fit 1" in tab.locator("[data-field=outdated]").inner_text()
    tab.get_by_text("An error of 10 % would move E by").wait_for(state="hidden", timeout=WAIT)
    tab.fill("[data-field=prior-height]", "0.01")
    wait_for_hints(tab, 2)
    guesses = tab.locator("[data-field=unchecked]")
    guesses.get_by_text("guesses of the page: length, density.").wait_for(timeout=WAIT)
    # A preset that is right is confirmed in its field.
    for name in ("length", "density"):
        tab.focus(f"[data-field=prior-{name}]")
        tab.keyboard.press("Enter")
    wait_for_hints(tab, 0)
    guesses.wait_for(state="hidden", timeout=WAIT)
    tab.click("[data-step=save]")
    differs = tab.locator("[data-field=differs]")
    differs.wait_for(timeout=WAIT)
    assert "of fit 1" in differs.inner_text() and "Height" not in differs.inner_text()
    assert tab.locator("[data-go=last-report]").inner_text() == "Report of fit 1"
    tab.click("[data-step=record]")
    tab.fill("[data-field=record-t_first]", "0.5")
    tab.locator(".field:has([data-field=record-t_first]) .tell").get_by_text(
        "The motion begins at 1 s; the window begins before it").wait_for(timeout=WAIT)
    tab.fill("[data-field=record-t_last]", "0.2")
    error = tab.locator(".field:has([data-field=record-t_last]) .tell.error")
    error.wait_for(timeout=WAIT)
    assert "“From” = 0.5" in error.inner_text() and "t_first" not in error.inner_text()
    tab.fill("[data-field=record-t_first]", "1.1")
    tab.fill("[data-field=record-t_last]", "6")
    error.wait_for(state="detached", timeout=WAIT)


def refuses_once(tab):
    """A refused case is named before it is saved; its run is marked, and its message shown once."""
    tab.click("[data-step=beam]")
    tab.fill("[data-field=beam-density]", "7.85")
    tab.locator(".field:has([data-field=beam-density]) .tell.error").wait_for(timeout=WAIT)
    tab.click("[data-step=save]")
    tab.locator("[data-field=refused]").get_by_text(
        "The program refuses this case. Step Beam, Density: Found 7.85").wait_for(timeout=WAIT)
    fit(tab, 2)
    assert tab.locator("[data-fit='2']").inner_text().endswith("Fit 2, refused")
    assert tab.get_by_text("which looks like g/cm^3").locator("visible=true").count() == 1
    tab.click("[data-fit='1']")
    tab.locator("[data-field=outdated]").get_by_text("Density (7850 kg/m³, now 7.85 kg/m³)"
                                                     ).wait_for(timeout=WAIT)
    tab.click("[data-step=beam]")
    tab.fill("[data-field=beam-density]", "7850")
    tab.locator(".field:has([data-field=beam-density]) .tell.error").wait_for(
        state="detached", timeout=WAIT)
    fit(tab, 3)
    assert tab.locator("[data-mark=outdated]").is_hidden()
    good, limits = (tab.locator(f".report .box{kind}").first.inner_text()
                    for kind in (".good", ":not(.good)"))
    words = re.compile("NOT white|not in these intervals", re.I)
    assert words.search(limits) and not words.search(good)


def compares(tab):
    """Fits side by side show what is determined, and the inputs that differ."""
    tab.click("[data-go=compare]")
    tab.get_by_text("Inputs that differ").wait_for(timeout=WAIT)
    estimates = tab.locator(".report table").first.inner_text()
    assert estimates.count("\ndetermined") == 8, estimates    # 4 parameters of 2 fits
    rows = tab.locator(".report table").nth(1).inner_text()
    for row in ("From\tnot set\t1.1 s", "To\tnot set\t6 s",
                "Standard deviation of mS\t0.5 g\t0.6 g",
                "Standard deviation of height\t0.02 mm\t0.01 mm"):
        assert row in rows, rows
    tab.click("[data-fit='1']")
    tab.click("[data-go=take-back]")
    tab.locator("[data-field=outdated]").wait_for(state="hidden", timeout=WAIT)
    assert tab.input_value("[data-field=prior-m_s]") == "0.5"
    assert tab.get_by_text("Preset: Enter confirms").count() == 4
    tab.click("[data-step=record]")
    first = tab.locator("[data-field=record-t_first]")
    assert first.input_value() == "" and float(first.get_attribute("placeholder")) == 1
    tab.click("[data-step=fit]")
    tab.click("[data-fit='3']")
    tab.locator("[data-field=outdated]").get_by_text("From (1.1 s, now not set)").wait_for(
        timeout=WAIT)
    tab.click("[data-go=take-back]")
    tab.locator("[data-field=outdated]").wait_for(state="hidden", timeout=WAIT)


def shows_what_is_added(tab):
    """The result of a command is open and in view; no table of 800 pixels is cut."""
    tab.click("[data-go=profile]")
    box = tab.get_by_text("Errors that these intervals leave out")
    box.wait_for(timeout=WAIT)
    tab.wait_for_function("scrollY > 300", timeout=WAIT)
    tab.wait_for_timeout(500)
    assert 0 < box.bounding_box()["y"] < 900
    tab.locator(".part").get_by_text("Modes", exact=True).click()
    tab.get_by_text("Modes of the fitted structure").wait_for(timeout=WAIT)
    for width in (1400, 800):
        tab.set_viewport_size({"width": width, "height": 900})
        tab.wait_for_timeout(700)
        cut = tab.evaluate("[...document.querySelectorAll('.scroll')].filter((one) => "
                           "one.clientWidth && one.scrollWidth > one.clientWidth).map("
                           "(one) => one.innerText)")
        assert cut == [], width
        crossing = tab.evaluate("""[...document.querySelectorAll('.js-plotly-plot')].filter((one) =>
            one.offsetParent && one.querySelector('.xtitle')).filter((one) => {
                const title = one.querySelector('.xtitle').getBoundingClientRect();
                return [...one.querySelectorAll('.xtick text')].some((tick) =>
                    tick.getBoundingClientRect().bottom > title.top + 2); }).length""")
        assert crossing == 0, width
        covering = tab.evaluate("""[...document.querySelectorAll('.js-plotly-plot')].filter((one) =>
            one.offsetParent && one.querySelector('.nsewdrag')).filter((one) =>
                one.querySelector('.modebar').getBoundingClientRect().left < Math.max(
                    ...[...one.querySelectorAll('.nsewdrag')].map((area) =>
                        area.getBoundingClientRect().right))).length""")
        assert covering == 0, width
    look(tab, "profile")


def test_restores_a_case(browser, example, tmp_path):
    """A case file opens with its values, and the folder of a fit with its result."""
    subprocess.run([PROGRAM, "new", "free-decay", tmp_path / "trial"], check=True,
                   stdout=subprocess.DEVNULL)
    case = tmp_path / "trial" / "case.nml"
    case.write_text(case.read_text() + "&gravity g=9.81, direction='hanging' /\n")
    out = tmp_path / "trial" / "fit"
    subprocess.run([PROGRAM, "identify", case, "--quiet", "--out", out], check=True,
                   stdout=subprocess.DEVNULL)
    for file, number in ((case, 0), (out, 1)):
        found = Server(tmp_path / f"studio{number}", file)
        page = browser.new_page(viewport={"width": 1400, "height": 900})
        page.goto(found.url)
        page.wait_for_selector("[data-step=record]", timeout=WAIT)
        if number:
            page.wait_for_selector("[data-fit='1']", timeout=WAIT)
        page.click("[data-step=beam]")
        page.wait_for_function("document.querySelector('[data-field=beam-length]')?.value === "
                               "'500'", timeout=WAIT)
        page.get_by_text("&gravity").wait_for(timeout=WAIT)
        fit(page, 1 + number)
        folder = next(path for path in found.folder.iterdir() if path.name[0] != ".")
        estimates = [(place / "estimates.csv").read_text()
                     for place in (out, folder / f"fit_{1 + number}")]
        assert estimates[0] == estimates[1]
        page.close()
        if number:    # the studio ends with its last tab
            assert found.process.wait(timeout=30) == 0
        else:
            assert found.end() == 0


def test_long_text_is_read_alike(tmp_path, monkeypatch):
    """NumPy's reader and that of rows return the same table, or the second explains a mistake."""
    rows = "".join(f"{0.001 * k:.3f};{(-1)**k * 1.5:.6f}\n" for k in range(200))
    texts = ["Time [s];a [g]\n" + rows, "logger 7\n\nTime;a\n(s);(g)\n" + rows, rows,
             "# a comment\nTime;a\n" + rows.replace(".", ","), "Time;a\n" + rows + "0.2;nan\n"]
    for text in texts:
        found = []
        for limit in (0, 10**9):
            monkeypatch.setattr(text_tables, "LONG_TEXT", limit)
            table = text_tables.parse("file", text)
            found.append([table.names, table.above, text_tables.numbers(table, 0).tolist(),
                          np.nan_to_num(text_tables.numbers(table, 1), nan=-7).tolist(),
                          [(one.name, one.unit, one.time_unit) for one in
                           text_tables.channels_of(table)]])
        assert found[0] == found[1]
    monkeypatch.setattr(text_tables, "LONG_TEXT", 0)
    assert text_tables.parse("file", texts[0]).values.shape == (200, 2)
    with pytest.raises(SystemExit) as failure:
        text_tables.channels_of(text_tables.parse("file", texts[0] + "0.2;x\n"))
    assert "file:202" in failure.value.message


def test_case_of_the_page():
    """Numbers are converted exactly, and groups without fields are kept."""
    from beamid_studio.case_model import Case, number_text
    from beamid_studio.checks import verdict_remarks
    assert number_text("0,3", "0.001") == "0.0003" and number_text("70", "1e9") == "7e10"
    assert number_text("0.0003", "0.001", divide=True) == "0.3" and number_text("1 mm") is None
    case = Case("&along parameter='E', x=0,1, value=1,2 / &beam length=1d0, E=2 /\n"
                "&stage free='E','c_D', start=1,2 / &prior parameter='E', sd=1 /")
    case.free = ["E"]
    case.set("beam", "length", "0.5")
    case.set_prior("E", None)
    assert case.text() == ("&beam    length=0.5, E=2 /\n"
                           "&along   parameter='E', x=0,1, value=1,2 /\n&stage   free='E' /\n")
    same = Case("&prior sd=1D-3, parameter='E' / &beam E=2, length=0.50 / &stage free='E' /")
    other = Case("&stage free='E' / &beam length=0.5, E=2.0 / &prior parameter='E', sd=0.001 /")
    assert same.inputs() == other.inputs()
    other.set("beam", "e", "3")
    assert same.inputs()["beam", "1", "e"] == ("2",) != other.inputs()["beam", "1", "e"]
    case = Case("&excitation kind='free' / &excitation kind='release', force=1 / &record file='a' /"
                "&record file='b' / &prior parameter='length', sd=1, record=2 /"
                "&prior parameter='length', sd=2, record=1 /")
    case.chosen = 1
    assert case.get("excitation", "kind") == "release" and case.get("record", "file") == "b"
    case.remove_record(0)
    assert case.get("record", "file") == "b"
    assert case.text() == ("&excitation kind='release', force=1 /\n&record  file='b' /\n"
                           "&prior   parameter='length', sd=1, record=1 /\n")
    remark, = verdict_remarks("k_R, which the model leaves out, is significant: with k_R = 10 J "
                              "falls by 9 %; add 'k_R'\n    to free\n\nrecord 1: 10 samples")
    assert (remark.field, remark.advice) == (("stage", "k_r"), "k_R")


TABLES = {    # text: kind, chosen names, keys of &record
    "frequency_hz,real,imag,sd\n1,2,3,0.1\n2,3,4,0.1\n": ("frf", ["FRF"], {
        "quantity": ["'accelerance'"]}),
    "f [Hz];mag H1 [g/N];phase H1 [deg]\n1;2;3\n2;3;9\n": ("frf", ["FRF h1 [g/N]"], {
        "quantity": ["'accelerance'"], "scale": ["9.80665"]}),
    "mode,frequency_hz,sd_hz\n1,6.3,0.02\n2,40,0.1\n": ("modes", ["modes [Hz]"], {}),
    "t,f,sd\n0,1,2\n0.1,2,1\n0.2,1,2\n": ("time", ["f", "sd"], {}),
    "time_s,a [g],frequency_hz\n0,1,2\n0.1,2,1\n0.2,1,2\n": ("time", ["a [g]", "frequency_hz"], {
        "scale": ["9.80665"]}),
}


@pytest.mark.parametrize("text", TABLES)
def test_kind_of_a_file(tmp_path, text):
    """Columns tell a record in time, a frequency response and a table of modes apart."""
    from beamid_studio import recordings
    kind, names, keys = TABLES[text]
    (tmp_path / "table.csv").write_text(text)
    found = recordings.read(tmp_path / "table.csv")
    assert (found.kind, [name for name, _ in found.channels], found.keys) == (kind, names, keys)
    found.write(tmp_path / "written.csv")
    written = (tmp_path / "written.csv").read_text()
    assert ("imag,sd\n1.0,2.0,3.0,0.1\n" in written) == ("imag,sd" in text)
    if kind == "modes":
        assert written == "frequency_hz,sd_hz,mode\n6.3,0.02,1\n40,0.1,2\n"
    again = recordings.read(tmp_path / "written.csv")
    assert again.kind == kind and np.array_equal(again.samples()[1], found.samples()[1])


def test_session_of_a_tab(tmp_path):
    """A session goes to its tab again, to no other tab while it is shown, and few are kept."""
    from beamid_studio.session import KEPT, Session

    class Page:
        is_connected = True

    memory = {}
    first = Session.of_tab(memory, "a", tmp_path, 10**6)
    first.page = page = Page()
    assert Session.of_tab(memory, "a", tmp_path, 10**6) is first      # a reload
    copied = dict(memory)                                             # a duplicated tab
    second = Session.of_tab(copied, "b", tmp_path, 10**6)
    assert second is not first and copied != memory
    first.leave(Page(), asleep=False)    # an earlier page of the tab
    assert first.page is page
    first.leave(page, asleep=True)
    assert Session.of_tab(dict(memory), "c", tmp_path, 10**6) is first    # a tab that was discarded
    for k in range(KEPT + 3):
        session = Session.of_tab({}, f"d{k}", tmp_path, 10**6)
        session.page = page
        session.leave(page, asleep=False)
    kept = [one for one in Session.every.values() if one.page is None]
    assert len(kept) == KEPT and first.closed
    Session.close_all()
    assert not Session.every


def test_needs_nothing_for_import():
    """The package beamid can be imported without what the studio needs."""
    code = ("import json, sys, beamid; print(json.dumps([name for name in ('nicegui', 'plotly', "
            "'matplotlib', 'fastapi') if name in sys.modules]))")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == []
