"""People in a real room, followed by the published boxes of a public detector: Pardalis beside the published tracks of the authors.

    python experiments/room/measure.py target/release/pardalis [--data FOLDER] [--record experiments/record/DATE]

Needs the package `pardalis` (pip install ./crates/pardalis-python). Downloads 3 MB from GitHub into target/room, unless a folder has the files.
"""

import argparse
import csv
import hashlib
import json
import platform
import subprocess
import sys
import urllib.parse
import urllib.request
from pathlib import Path

import numpy as np
import pardalis

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).parent
URL = "https://raw.githubusercontent.com/researchwork888/Multi-view-3D-multi-object-tracking-dataset/ee35cdef2508d0ab69b1ee0c372db19367cb27d1/"
TRACKS = "release/amilan-motchallenge-devkit-CLEARMOT/{kind}_{name}_WORLD_CENTROID.txt"
BOXES = "Detections/results/faster_rcnn_resnet50_coco_2018_01_28/{recording}/Cam_{camera}/MOT format/DET_{name}_Cam{camera}.txt"
RECORDINGS = {"CMC1": "J_1_1", "CMC2": "J_5_2", "CMC3": "J_6_1"}
CAMERAS = [1, 2, 3, 4]
FPS = 4
# Where the truth is annotated, metres: from and to along x and y.
AREA_M = [(2.03, 6.30), (0.0, 3.41)]
SEEDS = [1, 2, 3]
# The person of docs/detectors.md.
PERSON = {"shape": {"cylinder": {"radius_m": 0.25, "height_m": 1.75}}, "count": "any"}
SETTINGS = {"pardalis": {}, "pardalis, sides 10 %": {"side_sigma": 0.1}}


def files():
    for recording, name in RECORDINGS.items():
        yield from (TRACKS.format(kind=kind, name=name) for kind in ("GT", "EST"))
        yield from (BOXES.format(recording=recording, name=name, camera=camera) for camera in CAMERAS)


def download(folder):
    """Fetches what is missing, and checks everything."""
    sums = dict(reversed(line.split(maxsplit=1)) for line in (HERE / "sha256.txt").read_text().splitlines())
    for path in files():
        file = folder / path
        if not file.exists():
            file.parent.mkdir(parents=True, exist_ok=True)
            with urllib.request.urlopen(URL + urllib.parse.quote(path), timeout=60) as response:
                file.write_bytes(response.read())
        if hashlib.sha256(file.read_bytes()).hexdigest() != sums[path]:
            sys.exit(f"{file} is not the file that was measured; remove it, and run this again")


def rows(file):
    return [[float(value) for value in line.split()] for line in file.read_text().splitlines() if line.strip()]


def is_in_area(place_m):
    return all(least < value < most for value, (least, most) in zip(place_m, AREA_M, strict=False))


def write(path, people):
    """Writes tracks or truth: frame, number and place on the floor of everybody in the area."""
    is_truth = path.name == "truth.csv"
    path.parent.mkdir(parents=True, exist_ok=True)
    with open(path, "w", newline="") as file:
        writer = csv.writer(file)
        name = ["object"] if is_truth else ["target", "state"]
        writer.writerow(["frame", "time_s", *name, "x_m", "y_m", "z_m"])
        for frame, number, *place_m in people:
            name = [f"person-{int(number)}"] if is_truth else [f"person-{int(number)}", "tracking"]
            if is_in_area(place_m):
                writer.writerow([int(frame), frame / FPS, *name, *place_m[:2], 0.0])


def people_of(file):
    """Frame, number and place of everybody in a file of the data set, whose centres are above where they stand."""
    return [(row[0], row[1], row[7], row[8]) for row in rows(file)]


def boxes_of(file):
    """The boxes of each frame. Their sides count from 0 to the width of the image."""
    boxes = {}
    for row in rows(file):
        left, top, width, height = row[2:6]
        sides = [left - 0.5, top - 0.5, left + width - 0.5, top + height - 0.5]
        boxes.setdefault(int(row[0]), []).append(sides)
    return boxes


def track(boxes, frames, detector, seed):
    cameras = {f"cam{camera}": {"calibration": str(HERE / "cameras.json"), "calibration_camera": f"cam{camera}"} for camera in CAMERAS}
    scene = {"cameras": cameras, "targets": {"person": {**PERSON, "detector": detector}}}
    tracker = pardalis.Tracker.of_scene(scene, seed=seed)
    for frame in range(1, frames + 1):
        found = {name: {"person": np.array(boxes[name].get(frame, np.zeros((0, 4))))} for name in cameras}
        tracker.observe({}, frame / FPS, boxes=found)
        for member in tracker.members("person"):
            if member.state == "tracking":
                yield (frame, member.number, *member.position_m)


def evaluate(program, tracks, truth):
    report = tracks.parent / "report.json"
    options = ["--crowd", "person", "--lost-beyond-m", "1", "--json", report]
    subprocess.run([program, "evaluate", tracks, truth, *options], check=True, stdout=subprocess.DEVNULL)
    return json.loads(report.read_text())["crowds"][0]


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("program", type=Path)
    parser.add_argument("--data", type=Path, default=ROOT / "target/room/data")
    parser.add_argument("--record", type=Path)
    options = parser.parse_args()
    download(options.data)
    out = ROOT / "target/room"
    measured = []
    for recording, name in RECORDINGS.items():
        truth = out / recording / "truth.csv"
        people = people_of(options.data / TRACKS.format(kind="GT", name=name))
        write(truth, people)
        frames = int(max(frame for frame, *_ in people))
        boxes = {f"cam{camera}": boxes_of(options.data / BOXES.format(recording=recording, name=name, camera=camera)) for camera in CAMERAS}
        runs = {"published": [people_of(options.data / TRACKS.format(kind="EST", name=name))]}
        for setting, detector in SETTINGS.items():
            runs[setting] = [list(track(boxes, frames, detector, seed)) for seed in SEEDS]
        for setting, tracks in runs.items():
            for seed, found in zip(SEEDS, tracks, strict=False):
                path = out / recording / f"{setting}-{seed}" / "tracks.csv"
                write(path, found)
                crowd = evaluate(options.program, path, truth)
                row = {"run": recording, "target": setting, "seed": seed, **{key: crowd[key] for key in KEYS}}
                print(row)
                measured.append(row)
    if options.record:
        write_record(options.record, measured)


KEYS = "members gospa_m switches missed longest_missed_frames false_tracks longest_false_frames".split()


def write_record(folder, measured):
    folder.mkdir(parents=True, exist_ok=True)
    with open(folder / "room.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, measured[0], lineterminator="\n")
        writer.writeheader()
        writer.writerows(measured)
    git = lambda *arguments: subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()
    changed = " with uncommitted changes" if git("status", "--porcelain", "--untracked-files=no") else ""
    facts = {
        "command": "python experiments/room/measure.py",
        "commit": git("rev-parse", "HEAD") + changed,
        "python": f"{platform.python_version()}, numpy {np.__version__}",
    }
    (folder / "room.facts.txt").write_text("".join(f"{key:<10}{value}\n" for key, value in facts.items()))


if __name__ == "__main__":
    main()
