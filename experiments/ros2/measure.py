"""Four cameras at 30 images a second, over the loopback interface, to the node of ROS 2 and back as poses.

    python experiments/ros2/measure.py target/release/pardalis-ros2 300 [experiments/record/DATE]

Needs the packages of crates/pardalis-ros2/tests/peer/requirements.txt. Prints, and records, losses, the time from image to pose and that of the node
itself, which its diagnostics have once a second.
"""

import csv
import os
import platform
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "crates/pardalis-ros2/tests/peer"))

import numpy as np
from cyclonedds.internal import InvalidSample
from ros import DATA, Peer, header, message, nanoseconds

RIG = DATA / "webcams-four"
NAMES = ["cam1", "cam2", "cam3", "cam4"]
RATE_HZ = 30
COMPRESSED = "sensor_msgs/msg/CompressedImage"


def main(program, seconds):
    domain = random.randrange(10, 200)
    peer = Peer(domain)
    writers = [peer.publisher(f"/{name}/image_raw/compressed", COMPRESSED) for name in NAMES]
    poses = peer.subscription("/pardalis/ball/pose", "geometry_msgs/msg/PoseWithCovarianceStamped")
    diagnostics = peer.subscription("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")
    count = len(list((RIG / "frames" / NAMES[0]).glob("*.jpg")))
    images = [[(RIG / "frames" / name / f"{n:06}.jpg").read_bytes() for n in range(count)] for name in NAMES]
    scene = "".join(f'[cameras.{name}]\ncalibration = "{RIG}/cameras.json"\n' for name in NAMES)
    scene += f'[targets.ball]\nshape.sphere.radius_m = 0.035\ncolors = "{DATA}/colors/pink-ball.hsi.colors.toml"\n'
    sent, latencies_ms, own_ms = [], {}, []

    def receive():
        for pose in poses.take(100):
            if not isinstance(pose, InvalidSample):
                stamp = nanoseconds(pose.header)
                latencies_ms[stamp] = 1e-6 * (time.time_ns() - stamp)
        for sample in diagnostics.take(100):
            if not isinstance(sample, InvalidSample):
                own_ms.append(float({pair.key: pair.value for pair in sample.status[0].values}["latency_ms"]))

    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "scene.toml").write_text(scene)
        topics = [f"{name}=/{name}/image_raw/compressed" for name in NAMES]
        command = [program, Path(folder) / "scene.toml", "--domain", str(domain), "--reliable", *topics]
        node = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        frame, begin_s = 0, time.monotonic()
        measured_from = None
        while time.monotonic() - begin_s < seconds + 10:
            if all(w.get_matched_subscriptions() for w in writers) and poses.get_matched_publications():
                measured_from = measured_from or time.monotonic()
            is_measured = measured_from is not None and time.monotonic() > measured_from + 2
            # There and back: the ball does not jump.
            number = abs((frame + count - 1) % (2 * count - 2) - (count - 1))
            stamp = time.time_ns()
            for writer, of_camera in zip(writers, images):
                writer.write(message(COMPRESSED)(header(stamp), "jpeg", of_camera[number]))
            if is_measured:
                sent.append(stamp)
            frame += 1
            while time.monotonic() < begin_s + frame / RATE_HZ:
                receive()
                time.sleep(0.0005)
            if is_measured and time.monotonic() - measured_from > seconds + 2:
                break
        until = time.monotonic() + 1
        while time.monotonic() < until:
            receive()
            time.sleep(0.001)
        node.send_signal(signal.SIGINT)
        _, log = node.communicate(timeout=10)
    found_ms = np.array([latencies_ms[stamp] for stamp in sent if stamp in latencies_ms])
    print(log.strip())
    row = {"run": f"{len(NAMES)} cameras", "sets": len(sent), "lost": len(sent) - len(found_ms)}
    for name, values in (("pose", found_ms), ("node", np.array(own_ms))):
        for column, value in (("median", np.median(values)), ("p99", np.percentile(values, 99)), ("most", values.max())):
            row[f"{name}_{column}_ms"] = f"{value:.1f}"
    print(row)
    return row


def facts():
    return f"""command   python experiments/ros2/measure.py
python    {platform.python_version()}
cores     {os.cpu_count()}
load      {os.getloadavg()[1]:.1f} processes, the mean of the last five minutes, with this one
"""


if __name__ == "__main__":
    measured = main(sys.argv[1], float(sys.argv[2]))
    if len(sys.argv) > 3:
        folder = Path(sys.argv[3])
        folder.mkdir(parents=True, exist_ok=True)
        with open(folder / "ros2.csv", "w", newline="") as file:
            table = csv.DictWriter(file, measured)
            table.writeheader()
            table.writerow(measured)
        (folder / "ros2.facts.txt").write_text(facts())
