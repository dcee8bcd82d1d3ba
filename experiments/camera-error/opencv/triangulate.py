"""What people use today: colour threshold, centroid of the largest blob in each image, triangulation, with the same wrong cameras as in experiment.toml.

triangulate.py

Prints a row for each run of the experiment: mean and greatest error in millimetres. Thresholds are those of webcams-two, tuned for the best result there. A pen of the ball's colour lies
in one of the four webcams, so that the largest blob is not always the ball: for these, blobs count only within 30 pixels of where the ball is.
"""
import csv
import pathlib
import tomllib

import cv2
import numpy as np

folder = pathlib.Path(__file__).parent.parent
FPS = 25
MIN_PIXELS = 30
NEAR_PX = 30


def centroid(path, place):
    hsv = cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2HSV)
    hue, saturation, value = hsv[..., 0] * 2.0, hsv[..., 1] / 255, hsv[..., 2] / 255
    mask = (((hue >= 335) | (hue <= 10)) & (saturation >= 0.35) & (value >= 0.55)).astype(np.uint8)
    mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    count, _, stats, centroids = cv2.connectedComponentsWithStats(mask)
    blobs = [(stats[i, cv2.CC_STAT_AREA], centroids[i]) for i in range(1, count)]
    if place is not None:
        blobs = [blob for blob in blobs if np.linalg.norm(blob[1] - place) < NEAR_PX]
    area, middle = max(blobs, key=lambda blob: blob[0], default=(0, None))
    return middle if area >= MIN_PIXELS else None


def triangulated(seen):
    rows = []
    for matrix, (u, v) in seen:
        rows += [u * matrix[2] - matrix[0], v * matrix[2] - matrix[1]]
    point = np.linalg.svd(np.array(rows))[2][-1]
    return point[:3] / point[3]


def replaced(scene, keys, values):
    for key, value in zip(keys, values):
        *tables, last = key.split(".")
        table = scene
        for name in tables:
            table = table[name]
        table[last] = value
    return scene


experiment = tomllib.loads((folder / "experiment.toml").read_text())
known = {}
print("| run | mean (mm) | max (mm) |\n|---|---:|---:|")
for sweep in experiment["sweeps"]:
    truth, places = {}, {}
    with open(folder / sweep["truth"]) as file:
        for row in csv.DictReader(file):
            if row["object"] == "ball":
                frame, fraction = int(row["frame"]), float(row["visible_fraction"])
                before = truth.get(frame, (0, 0))[1]
                truth[frame] = (np.array([float(row[c]) for c in ("x_m", "y_m", "z_m")]), max(fraction, before))
                places[row["camera"], frame] = np.array([float(row["u_px"]), float(row["v_px"])]) if fraction > 0 else None
    for name, values in zip(sweep["names"], sweep["values"]):
        scene = replaced(tomllib.loads((folder / sweep["scene"]).read_text()), sweep["key"], values)
        seen = {}
        for camera, settings in scene["cameras"].items():
            images = folder / settings["images"]
            (fx, fy), (cx, cy) = (settings["model"]["pinhole"][key] for key in ("f_px", "center_px"))
            intrinsics = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
            matrix = intrinsics @ np.linalg.inv(np.array(settings["world_from_camera"]))[:3]
            for frame in truth:
                path = images / f"{frame:06}.jpg"
                if path not in known:
                    place = places[camera, frame] if "four" in sweep["scene"] else None
                    hidden = "four" in sweep["scene"] and place is None
                    known[path] = None if hidden else centroid(path, place)
                if known[path] is not None:
                    at = frame + round(settings.get("time_offset_s", 0) * FPS)
                    seen.setdefault(at, []).append((matrix, known[path]))
        errors = [
            1000 * np.linalg.norm(triangulated(seen[frame]) - position)
            for frame, (position, fraction) in truth.items()
            if fraction > sweep["visible_over"] and len(seen.get(frame, [])) >= 2
        ]
        print(f"| {sweep['name']}: {name} | {np.mean(errors):.2f} | {np.max(errors):.1f} |")
