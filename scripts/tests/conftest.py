"""What the tests in a browser share."""

import shutil

import pytest


@pytest.fixture(scope="module")
def browser():
    """A headless Chromium."""
    playwright = pytest.importorskip("playwright.sync_api",
                                     reason="no Playwright: scripts/setup.sh browser")
    chromium = shutil.which("chromium") or shutil.which("google-chrome")
    if not chromium:
        pytest.skip("no Chromium: scripts/setup.sh browser")
    with playwright.sync_playwright() as engine:
        instance = engine.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        yield instance
        instance.close()
