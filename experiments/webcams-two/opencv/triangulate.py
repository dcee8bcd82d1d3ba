"""What people use today: colour threshold, centroid of the largest blob in each image, triangulation.

triangulate.py SEQUENCE HUE_FROM HUE_TO SATURATION_FROM VALUE_FROM TRACKS.csv

Hue in degrees (through 0 where the first is the greater), saturation and value from 0 to 1. Writes positions in the form of Pardalis' tracks, a row
an instant, without one where fewer than two cameras see a blob.
"""
import csv
import json
import pathlib
import sys

import cv2
import numpy as np

sequence, output = pathlib.Path(sys.argv[1]), sys.argv[6]
hue_from, hue_to, saturation_from, value_from = map(float, sys.argv[2:6])
description = json.loads((sequence / "cameras.json").read_text())
fps = description["sequence"]["fps"]
MIN_PIXELS = 30


def projection(camera):
    world_from_camera = np.array(camera["T_world_from_camera"])
    intrinsics = np.array([[camera["fx"], 0, camera["cx"]], [0, camera["fy"], camera["cy"]], [0, 0, 1]])
    return intrinsics @ np.linalg.inv(world_from_camera)[:3]


def centroid(path):
    hsv = cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2HSV)
    hue, saturation, value = hsv[..., 0] * 2.0, hsv[..., 1] / 255, hsv[..., 2] / 255
    in_hue = (hue >= hue_from) & (hue <= hue_to) if hue_from <= hue_to else (hue >= hue_from) | (hue <= hue_to)
    mask = (in_hue & (saturation >= saturation_from) & (value >= value_from)).astype(np.uint8)
    mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    count, _, stats, centroids = cv2.connectedComponentsWithStats(mask)
    if count < 2:
        return None
    largest = 1 + np.argmax(stats[1:, cv2.CC_STAT_AREA])
    return centroids[largest] if stats[largest, cv2.CC_STAT_AREA] >= MIN_PIXELS else None


def triangulated(seen):
    rows = []
    for matrix, (u, v) in seen:
        rows += [u * matrix[2] - matrix[0], v * matrix[2] - matrix[1]]
    point = np.linalg.svd(np.array(rows))[2][-1]
    return point[:3] / point[3]


cameras = [(camera["name"], projection(camera)) for camera in description["cameras"]]
columns = "frame time_s target state x_m y_m z_m vx_mps vy_mps vz_mps heading_rad xx_m2 xy_m2 xz_m2 yy_m2 yz_m2 zz_m2 ess confidence".split()
with open(output, "w", newline="") as file:
    writer = csv.DictWriter(file, columns, lineterminator="\n")
    writer.writeheader()
    for frame in range(description["sequence"]["frames"]):
        found = [(m, centroid(sequence / "frames" / name / f"{frame:06}.jpg")) for name, m in cameras]
        seen = [(matrix, pixel) for matrix, pixel in found if pixel is not None]
        row = {"frame": frame, "time_s": frame / fps, "target": "ball", "state": "lost"}
        if len(seen) >= 2:
            x, y, z = triangulated(seen)
            row |= {"state": "tracking", "x_m": x, "y_m": y, "z_m": z}
        writer.writerow(row)
