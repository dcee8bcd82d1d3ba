"""Fixtures of tests of the studio: the running program with its page, and streams of ffmpeg as live cameras.

PARDALIS names the program, built with the feature `studio`.
"""

import csv
import os
import re
import shutil
import signal
import socket
import subprocess
import time
from pathlib import Path

import pytest
from playwright.sync_api import expect

ROOT = Path(__file__).resolve().parents[4]
DATA = ROOT / "data"
PROGRAM = os.environ["PARDALIS"]
# The program learns colours with code that is hardly optimised, on machines with other work.
PATIENCE_MS = 60_000
expect.set_options(timeout=PATIENCE_MS)


class Studio:
    """A running program that serves a page, and that page."""

    def __init__(self, browser, folder, *arguments, command="studio", **context):
        self.folder = folder
        self.log = open(folder / "program.log", "w+")
        self.command = [PROGRAM, command, *arguments]
        self.start()
        self.address = self.wait_for(r"Open (http://\S+) ")
        self.errors = []
        self.foreign = []
        self.context = browser.new_context(viewport={"width": 1280, "height": 800}, **context)
        self.context.set_default_timeout(PATIENCE_MS)
        self.page = self.context.new_page()
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.on("console", lambda message: message.type == "error" and self.errors.append(message.text))
        self.page.on("request", lambda request: self.is_own(request.url) or self.foreign.append(request.url))
        self.page.goto(self.address)

    def start(self):
        self.process = subprocess.Popen(self.command, cwd=self.folder, stdout=self.log, stderr=self.log)

    def wait_for(self, pattern):
        for _ in range(300):
            text = Path(self.log.name).read_text()
            if found := re.search(pattern, text):
                return found[1]
            assert self.process.poll() is None, text
            time.sleep(0.1)
        raise AssertionError(text)

    def is_own(self, url):
        return url.startswith((self.address, self.address.replace("http", "ws"), "blob:", "data:"))

    def step(self, name):
        self.page.click(f"#step-{name}")

    def at(self, camera, pixel, size_px):
        """Returns where on the page a picture shows a pixel."""
        canvas = self.page.locator(f"[data-camera={camera}] canvas")
        expect(self.page.locator(f"[data-camera={camera}]:not(.waits)")).to_be_visible()
        box = canvas.bounding_box()
        scale = box["width"] / size_px[0]
        return [box["x"] + (pixel[0] + 0.5) * scale, box["y"] + (pixel[1] + 0.5) * scale]

    def show(self, camera, frame):
        """Goes to a frame of a recording."""
        self.page.locator(f"#frame-{camera}").evaluate(
            "(slider, frame) => { slider.value = frame; slider.dispatchEvent(new Event('input')); }", frame
        )
        shown = self.page.locator(f"[data-camera={camera}] .number-of-frame")
        expect(shown).to_have_text(re.compile(rf"^{frame} /"))

    def ask(self, request, value=None):
        """Asks the program as the page does."""
        return self.page.evaluate(
            """async ([request, value]) => (await fetch(`/api/${request}`, {
                method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(value) })).json()""",
            [request, value or {}],
        )

    def close(self):
        self.context.close()
        self.process.send_signal(signal.SIGINT)
        assert self.process.wait(30) == 0, Path(self.log.name).read_text()
        assert self.errors == []
        assert self.foreign == []


@pytest.fixture
def studio(browser, tmp_path):
    started = []

    def start(*arguments, folder=tmp_path, **more):
        started.append(Studio(browser, folder, *arguments, **more))
        return started[-1]

    yield start
    for one in started:
        one.close()


def until(is_so):
    """Waits until something holds."""
    for _ in range(PATIENCE_MS // 100):
        if is_so():
            return
        time.sleep(0.1)
    raise AssertionError("it did not come to hold")


def truth_of(sequence):
    with open(DATA / sequence / "truth.csv") as file:
        return list(csv.DictReader(file))


def run(*arguments, folder):
    return subprocess.run([PROGRAM, *arguments], cwd=folder, check=True, capture_output=True, text=True).stdout


def figure(report, name):
    """Returns a figure of the column for all frames of a report of `evaluate`."""
    line = re.search(rf"^\s+{name}\s.*$", report, re.MULTILINE)
    return float(line[0].split()[-1])


def frames_of(folder):
    """Returns the options of ffmpeg for the frames of a bundled sequence."""
    return "-framerate", "25", "-i", DATA / folder / "%06d.jpg"


class Streams:
    """Inputs that one ffmpeg streams in real time, again and again, as network cameras do. Give the options of each input up to its file."""

    def __init__(self, inputs, log):
        self.log = log
        self.command, self.addresses = ["ffmpeg", "-nostdin"], []
        begin = 0
        for end in [place + 2 for place, option in enumerate(inputs) if option == "-i"]:
            self.command += ["-re", "-stream_loop", "-1", *map(str, inputs[begin:end])]
            begin = end
        for number in range(inputs.count("-i")):
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
                free.bind(("127.0.0.1", 0))
                port = free.getsockname()[1]
            self.addresses.append(f"udp://127.0.0.1:{port}")
            encoded = ["-c:v", "mpeg2video", "-q:v", "2", "-g", "5", "-f", "mpegts"]
            self.command += ["-map", f"{number}:v", *encoded, f"{self.addresses[-1]}?pkt_size=1316"]
        self.start()

    @property
    def address(self):
        (address,) = self.addresses
        return address

    def start(self):
        with open(self.log, "w") as log:
            self.process = subprocess.Popen(self.command, stdout=log, stderr=log)

    def stop(self):
        self.process.kill()
        self.process.wait()


@pytest.fixture
def streams(tmp_path_factory):
    """Starts streams."""
    assert shutil.which("ffmpeg"), "these tests need ffmpeg; install it"
    started = []

    def start(*inputs):
        started.append(Streams(inputs, tmp_path_factory.mktemp("streams") / "ffmpeg.log"))
        return started[-1]

    yield start
    for one in started:
        one.stop()
