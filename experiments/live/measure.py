"""Four network cameras of 640x480 pixels at 30 images a second, tracked and shown in a browser on one computer.

    scripts/web-test --collect-only    # once: Chromium and Playwright
    target/web/bin/python experiments/live/measure.py target/release/pardalis 600 [experiments/record/DATE]

The program must be built with the feature `studio`. Needs ffmpeg.
"""

import csv
import json
import os
import platform
import re
import shutil
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

from playwright.sync_api import sync_playwright

WORLD = Path(__file__).parent / "world.toml"
RATE_HZ = 30
CAMERAS = ["cam1", "cam2", "cam3", "cam4"]
# Of the images that are rendered, of which each camera has its own.
WORLD_RATE_HZ = RATE_HZ * len(CAMERAS)
# This camera is unplugged for a tenth of the time.
UNPLUGGED, UNPLUGGED_SHARE = "cam2", (0.45, 0.55)
PARTS = 5


class Camera:
    """A network camera: single JPEG images over HTTP, each at its time, to one client after another."""

    def __init__(self, images, begin_s):
        self.images, self.begin_s = images, begin_s
        self.is_plugged = True
        self.sent, self.skipped = 0, 0
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.port = self.listener.getsockname()[1]
        threading.Thread(target=self.serve, daemon=True).start()

    def serve(self):
        while True:
            client, _ = self.listener.accept()
            with client:
                try:
                    if self.is_plugged:
                        self.send_to(client)
                except OSError:
                    pass  # It has hung up.

    def send_to(self, client):
        client.recv(65536)
        client.sendall(b"HTTP/1.1 200 OK\r\nContent-Type: multipart/x-mixed-replace; boundary=frame\r\n\r\n")
        number = self.number()
        while self.is_plugged:
            number += 1
            while time.time() < self.begin_s + number / RATE_HZ:
                time.sleep(0.001)
            late = self.number() - number
            if late > 0:
                # Nobody took the images; a camera does not keep them.
                self.skipped += late
                number += late
            image = self.images[number % len(self.images)]
            client.sendall(b"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n" % len(image) + image + b"\r\n")
            self.sent += 1

    def number(self):
        return int((time.time() - self.begin_s) * RATE_HZ)


class Receiver:
    """What `--send` sends. Single JPEG images have the time stamps of their arrival, by this computer's clock."""

    def __init__(self):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.port = self.socket.getsockname()[1]
        self.arrived_s = {}
        self.rows = []
        threading.Thread(target=self.receive, daemon=True).start()

    def receive(self):
        while True:
            line = json.loads(self.socket.recv(65536))
            self.arrived_s[line["frame"]] = line["time_s"]
            self.rows.append((line["time_s"], time.time() - line["time_s"], line["targets"][0]))


def scene_of(folder, cameras):
    text = "".join(
        f'[cameras.{name}]\nvideo = "http://127.0.0.1:{camera.port}/video"\ninput.format = "mpjpeg"\ninput.reopen_s = 300\ncalibration = "cameras.toml"\n'
        for name, camera in cameras.items()
    )
    text += '[targets.ball]\nshape.sphere.radius_m = 0.035\ncolors = "ball.colors.toml"\n'
    (folder / "live.toml").write_text(text)


def cpu_s(pid):
    """Returns the processor time of a process and its children, in seconds."""
    total = 0
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            number = int(stat.parent.name)
            fields = stat.read_text().rsplit(")", 1)[1].split()
        except OSError:
            continue
        if number == pid or int(fields[1]) == pid:
            total += int(fields[11]) + int(fields[12])
    return total / os.sysconf("SC_CLK_TCK")


def memory_mib(pid):
    return int(re.search(r"VmRSS:\s+(\d+)", Path(f"/proc/{pid}/status").read_text())[1]) / 1024


def ball_at(folder):
    """Returns where the ball was at each of the frames of the world."""
    with open(folder / "truth.csv") as file:
        rows = [row for row in csv.DictReader(file) if (row["camera"], row["object"]) == (CAMERAS[0], "ball")]
    return [[float(row[axis]) for axis in ("x_m", "y_m", "z_m")] for row in rows]


def measure(program, seconds):
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name) / "rig"
        subprocess.run([program, "simulate", WORLD, "-o", folder], check=True, stdout=subprocess.DEVNULL)
        # Not triggered: each camera exposes at its own time.
        files = {name: sorted((folder / "frames" / name).glob("*.jpg"))[i :: len(CAMERAS)] for i, name in enumerate(CAMERAS)}
        images = {name: [file.read_bytes() for file in files[name]] for name in CAMERAS}
        begin_s = time.time()
        cameras = {name: Camera(images[name], begin_s + i / RATE_HZ / len(CAMERAS)) for i, name in enumerate(CAMERAS)}
        receiver = Receiver()
        scene_of(folder, cameras)
        command = [program, "track", "live.toml", "--watch", "--send", f"udp://127.0.0.1:{receiver.port}", "-o", "out", "--no-plots"]
        with open(folder / "log.txt", "w") as log:
            process = subprocess.Popen(command, cwd=folder, stdout=log, stderr=log)
        try:
            samples = watched(process, folder, receiver, cameras, seconds)
        finally:
            process.send_signal(2)
            process.wait(30)
            print((folder / "log.txt").read_text())
        truth = ball_at(folder)
        return samples, [row_of(part, samples, receiver, cameras, truth, begin_s) for part in parts(samples)]


def watched(process, folder, receiver, cameras, seconds):
    """Shows the run in a browser for some time, and returns a sample a second."""
    while not (found := re.search(r"Open (http://\S+) ", (folder / "log.txt").read_text())):
        assert process.poll() is None, (folder / "log.txt").read_text()
        time.sleep(0.1)
    executable = next(filter(None, map(shutil.which, ["chromium", "chromium-browser", "google-chrome"])))
    arguments = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable, args=arguments)
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        count = "window.shown = 0; const decode = createImageBitmap; window.createImageBitmap = (blob) => { window.shown += 1; return decode(blob); };"
        page.add_init_script(count)
        page.goto(found[1])
        page.wait_for_selector("#now .time")
        start_s, samples = time.time(), []
        while time.time() < start_s + seconds:
            share = (time.time() - start_s) / seconds
            cameras[UNPLUGGED].is_plugged = not UNPLUGGED_SHARE[0] <= share < UNPLUGGED_SHARE[1]
            text, shown = page.evaluate("[document.querySelector('#now .time').textContent, window.shown]")
            now_s, frame = time.time(), int(re.search(r"\d+", text)[0]) - 1
            samples.append(
                {"time_s": now_s, "page_age_s": now_s - receiver.arrived_s.get(frame, now_s), "shown": shown, "cpu_s": cpu_s(process.pid), "memory_mib": memory_mib(process.pid)}
            )
            time.sleep(1)
        browser.close()
    return samples


def parts(samples):
    """Returns spans of equal length, each with a number of samples."""
    size = len(samples) // PARTS
    return [samples[number * size : (number + 1) * size] for number in range(PARTS)]


def quantile(values, share):
    return sorted(values)[min(int(share * len(values)), len(values) - 1)]


def row_of(part, samples, receiver, cameras, truth, begin_s):
    from_s, to_s = part[0]["time_s"], part[-1]["time_s"]
    rows = [row for row in receiver.rows if from_s <= row[0] < to_s]
    late_ms = [1e3 * row[1] for row in rows]
    errors_mm = []
    for arrived_s, _, target in rows:
        if target["position_m"]:
            # The last image that a camera has sent.
            wanted = truth[int((arrived_s - begin_s) * WORLD_RATE_HZ) % len(truth)]
            errors_mm.append(1e3 * sum((x - y) ** 2 for x, y in zip(target["position_m"], wanted)) ** 0.5)
    took_s = to_s - from_s
    start_s = samples[0]["time_s"]
    return {
        "run": f"{from_s - start_s:.0f} to {to_s - start_s:.0f} s",
        "sets_per_s": f"{len(rows) / took_s:.1f}",
        "tracking_share": f"{sum(row[2]['state'] == 'tracking' for row in rows) / len(rows):.4f}",
        "median_error_mm": f"{statistics.median(errors_mm):.2f}",
        "latency_median_ms": f"{quantile(late_ms, 0.5):.1f}",
        "latency_p99_ms": f"{quantile(late_ms, 0.99):.1f}",
        "latency_most_ms": f"{max(late_ms):.0f}",
        "page_median_ms": f"{1e3 * quantile([s['page_age_s'] for s in part], 0.5):.0f}",
        "page_most_ms": f"{1e3 * max(s['page_age_s'] for s in part):.0f}",
        "page_images_per_s": f"{(part[-1]['shown'] - part[0]['shown']) / took_s:.0f}",
        "cores": f"{(part[-1]['cpu_s'] - part[0]['cpu_s']) / took_s:.2f}",
        "memory_mib": f"{part[-1]['memory_mib']:.0f}",
    }


def main():
    samples, table = measure(str(Path(sys.argv[1]).resolve()), float(sys.argv[2]))
    for row in table:
        print(row)
    if len(sys.argv) > 3:
        folder = Path(sys.argv[3])
        folder.mkdir(parents=True, exist_ok=True)
        with open(folder / "live.csv", "w", newline="") as file:
            writer = csv.DictWriter(file, table[0])
            writer.writeheader()
            writer.writerows(table)
        commit = subprocess.run(["git", "describe", "--always", "--dirty"], capture_output=True, text=True).stdout.strip()
        (folder / "live.facts.txt").write_text(
            f"""command   python experiments/live/measure.py
commit    {commit}
python    {platform.python_version()}
cores     {os.cpu_count()}
load      {os.getloadavg()[1]:.1f} processes, the mean of the last five minutes, with this one
"""
        )


if __name__ == "__main__":
    main()
