"""`pardalis track` as a whole: how much of its processor time goes into decoding, how many times faster than the recording it is, how much memory it takes, and
how long OpenCV's usual way to find a ball takes on the same images, in the same run.

    pip install -r experiments/speed/requirements.txt
    python experiments/speed/whole.py target/release/pardalis [experiments/record/DATE]

OpenCV: conversion to hue, saturation and value, a range of them by hand, opened, connected components, and the direction and distance of the largest as those of a disc. It takes no account of
the lens, so that only its middle is compared with the truth. Both take one thread; reading and decoding files are not part of the milliseconds.
"""

import csv
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "experiments"))
import records

REPEATS = 5
FPS = 25
# By hand: from hue in degrees (over 0), saturation and value on.
ORANGE, PINK = ((4, 40), 0.35, 0.15), ((335, 10), 0.35, 0.55)
# The scene in experiments/edge, the sequence, its cameras, the colours, and the size of images.
RUNS = [
    ("fisheye", "dioptric-jump", ["cam1"], ORANGE, "1 of 640 x 480"),
    ("webcams-two", "webcams-two", ["cam1", "cam2"], PINK, "2 of 320 x 240"),
    ("webcams-four", "webcams-four", ["cam1", "cam2", "cam3", "cam4"], PINK, "4 of 320 x 240"),
]
LARGE = """
duration_s = 1.2
training_stills = 4
[cameras.cam1]
size_px = [3840, 2160]
model.pinhole = { f_px = [3000, 3000], center_px = [1919.5, 1079.5] }
look_from_m = [-2.0, 0.0, 1.0]
look_at_m = [0.5, 0.0, 0.3]
[timing]
fps = 25
[ground]
texture.noise = { size_m = 0.2, octaves = 4, colors_srgb = [[120, 95, 70], [175, 150, 115]] }
[objects.ball]
target = true
shape.sphere.radius_m = 0.1
color_srgb = [230, 110, 30]
[objects.ball.path.harmonic]
center_m = [0.5, 0.0, 0.3]
y = [[0.4, 0.5, 0]]
"""


def tracked(program, scene, folder):
    """Track in one thread. Return the summary, the seconds that it took, those of the processor, and the most memory in MiB."""
    begun_s = time.monotonic()
    process = subprocess.Popen([program, "track", scene, "--threads", "1", "--no-plots", "-o", folder], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    message = process.stderr.read()
    _, status, usage = os.wait4(process.pid, 0)
    assert status == 0, message
    summary = json.loads((Path(folder) / "summary.json").read_text())
    return summary, time.monotonic() - begun_s, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


def blob_of(image, colors):
    """The middle of the largest blob of these colours in pixels, and the angle of a disc of its area; None without one."""
    (low, high), saturation, value = colors
    hsv = cv2.cvtColor(image, cv2.COLOR_BGR2HSV)
    least = [round(255 * saturation), round(255 * value)]
    parts = [(low, high)] if low < high else [(low, 360), (0, high)]
    masks = [cv2.inRange(hsv, (a // 2, *least), (b // 2, 255, 255)) for a, b in parts]
    mask = masks[0] if len(masks) == 1 else masks[0] | masks[1]
    mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    count, _, stats, middles = cv2.connectedComponentsWithStats(mask)
    if count < 2:
        return None
    largest = 1 + np.argmax(stats[1:, cv2.CC_STAT_AREA])
    return middles[largest], math.sqrt(stats[largest, cv2.CC_STAT_AREA] / math.pi) / image.shape[1]


def of_opencv(sequence, cameras, colors):
    """The milliseconds per image set, median over the sets. Fails unless most middles are on the ball."""
    with open(ROOT / "data" / sequence / "truth.csv") as file:
        truth = {(row["camera"], int(row["frame"])): row for row in csv.DictReader(file) if row["object"] == "ball"}
    folders = [ROOT / "data" / sequence / "frames" / ("" if len(cameras) == 1 else camera) for camera in cameras]
    files = [sorted(folder.glob("*.jpg")) for folder in folders]
    times_ms, near, seen = [], 0, 0
    for number, paths in enumerate(zip(*files)):
        images = [cv2.imread(str(path)) for path in paths]
        begun_s = time.perf_counter()
        found = [blob_of(image, colors) for image in images]
        times_ms.append(1e3 * (time.perf_counter() - begun_s))
        for camera, blob in zip(cameras, found):
            row = truth.get((camera, number))
            if row and float(row["visible_fraction"]) > 0.6:
                seen += 1
                near += blob is not None and math.dist(blob[0], [float(row["u_px"]), float(row["v_px"])]) < 15
    assert near > 0.7 * seen > 0, (sequence, near, seen)
    return statistics.median(times_ms)


def row_of(program, run, scene, images, opencv_ms=None):
    """Measure a scene."""
    with tempfile.TemporaryDirectory() as folder:
        found = [tracked(program, scene, folder) for _ in range(REPEATS)]
    median = lambda figure: statistics.median(figure(*one) for one in found)
    sets = found[0][0]["frame_sets"]
    track_ms = median(lambda summary, *_: 1e3 * summary["time"]["tracking_s"] / sets)
    return {
        "run": run,
        "images": images,
        "track_ms": round(track_ms, 2),
        "opencv_ms": "" if opencv_ms is None else round(opencv_ms, 2),
        "opencv_over_track": "" if opencv_ms is None else round(opencv_ms / track_ms, 2),
        "decoding_share": round(median(lambda summary, wall_s, cpu_s, mib: summary["time"]["decoding_beside_tracking_s"] / cpu_s), 2),
        "times_real": round(median(lambda summary, wall_s, cpu_s, mib: sets / FPS / wall_s), 1),
        "memory_mib": round(median(lambda summary, wall_s, cpu_s, mib: mib)),
    }


def main(program, record=None):
    cv2.setNumThreads(1)
    table = []
    for run, sequence, cameras, colors, images in RUNS:
        opencv_ms = of_opencv(sequence, cameras, colors)
        table.append(row_of(program, run, ROOT / f"experiments/edge/{run}.toml", images, opencv_ms))
    with tempfile.TemporaryDirectory() as folder:
        world = Path(folder) / "large.toml"
        world.write_text(LARGE)
        subprocess.run([program, "simulate", world, "-o", f"{folder}/large"], check=True, capture_output=True)
        table.append(row_of(program, "large", f"{folder}/large/scene.toml", "1 of 3840 x 2160"))
    for row in table:
        print(", ".join(f"{key} {value}" for key, value in row.items()))
    if record:
        records.write(record, "whole", table, "python experiments/speed/whole.py target/release/pardalis", f"OpenCV {cv2.__version__}", f"NumPy {np.__version__}")


if __name__ == "__main__":
    main(*sys.argv[1:])
