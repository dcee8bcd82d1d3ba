"""Fixtures of tests of web pages: a real browser, and the program."""

import os
import subprocess
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, sync_playwright

REPOSITORY = Path(__file__).resolve().parents[4]


@pytest.fixture(scope="session")
def browser():
    """Chromium, with WebGL in software."""
    arguments = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=os.environ["CHROMIUM"], args=arguments)
        yield browser
        browser.close()


@pytest.fixture
def open_page(browser: Browser):
    """Opens a page by its address. Fails at the end of the test if one wrote an error to the console or asked for anything outside of its own server or file."""
    faults: list[str] = []
    contexts = []

    def open_(address: str, *, width=1280, height=800, dark=False, before: str | None = None) -> Page:
        context = browser.new_context(viewport={"width": width, "height": height}, color_scheme="dark" if dark else "light", reduced_motion="reduce")
        contexts.append(context)
        page = context.new_page()
        page.set_default_timeout(20_000)
        if before:
            page.add_init_script(before)
        page.on("console", lambda message: faults.append(message.text) if message.type in ("error", "warning") else None)
        page.on("pageerror", lambda error: faults.append(str(error)))
        origin = "/".join(address.split("/")[:3])
        own = ("data:", "blob:", address if address.startswith("file:") else origin)
        page.on("request", lambda request: None if request.url.startswith(own) else faults.append(f"requested {request.url[:200]}"))
        page.goto(address)
        page.wait_for_selector(".pv-time:not(:empty)")
        return page

    yield open_
    for context in contexts:
        context.close()
    assert faults == []


@pytest.fixture(scope="session")
def pardalis():
    """Runs the program in the root of the repository, and returns its standard output."""

    def run(*arguments) -> str:
        command = [os.environ["PARDALIS"], *map(str, arguments)]
        done = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return done.stdout

    return run
