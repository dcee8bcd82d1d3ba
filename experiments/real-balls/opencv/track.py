"""OpenCV's usual tracker of a coloured ball: blur, HSV range, erode, dilate, largest contour, least enclosing circle.

track.py IMAGES LABELS.csv FOUND.csv

IMAGES is a video or a folder of files NNNNNN.jpg. LABELS.csv and FOUND.csv have the columns frame, u_px, v_px and
radius_px. The range of hues holds the 2nd to the 98th percentile of the inner 85 % of the labelled circles, those of
saturation and value all above their 2nd percentile. Prints the frames per second.
"""

import csv
import pathlib
import sys
import time

import cv2
import numpy as np

LEAST_RADIUS_PX = 4


def frames(images):
    capture = cv2.VideoCapture(str(images / "%06d.jpg" if images.is_dir() else images))
    while (read := capture.read())[0]:
        yield read[1]


def blurred_hsv(image):
    return cv2.cvtColor(cv2.GaussianBlur(image, (11, 11), 0), cv2.COLOR_BGR2HSV)


def learnt_range(images, labels):
    pixels = []
    for frame, image in enumerate(frames(images)):
        for u_px, v_px, radius_px in labels.get(frame, []):
            mask = np.zeros(image.shape[:2], np.uint8)
            cv2.circle(mask, (round(u_px), round(v_px)), max(1, int(radius_px * 0.85)), 255, -1)
            pixels.append(blurred_hsv(image)[mask > 0])
    hue, saturation, value = np.vstack(pixels).astype(float).T
    angle = np.deg2rad(2 * hue)
    mean_deg = np.rad2deg(np.arctan2(np.sin(angle).mean(), np.cos(angle).mean()))
    off_deg = np.percentile((2 * hue - mean_deg + 180) % 360 - 180, [2, 98])
    first, last = (int(round((mean_deg + off) % 360 / 2)) % 180 for off in off_deg)
    return (first, int(np.percentile(saturation, 2)), int(np.percentile(value, 2))), (last, 255, 255)


def find(image, low, high):
    hsv = blurred_hsv(image)
    if low[0] <= high[0]:
        mask = cv2.inRange(hsv, low, high)
    else:
        mask = cv2.inRange(hsv, (0, *low[1:]), high) | cv2.inRange(hsv, low, (180, 255, 255))
    mask = cv2.dilate(cv2.erode(mask, None, iterations=2), None, iterations=2)
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    if not contours:
        return None
    contour = max(contours, key=cv2.contourArea)
    _, radius_px = cv2.minEnclosingCircle(contour)
    moments = cv2.moments(contour)
    if radius_px <= LEAST_RADIUS_PX or moments["m00"] <= 0:
        return None
    return moments["m10"] / moments["m00"], moments["m01"] / moments["m00"], radius_px


images, labels_file, found_file = (pathlib.Path(argument) for argument in sys.argv[1:])
labels = {}
with open(labels_file, newline="") as file:
    for row in csv.DictReader(file):
        circle = [float(row[name]) for name in ("u_px", "v_px", "radius_px")]
        labels.setdefault(int(row["frame"]), []).append(circle)
low, high = learnt_range(images, labels)
start = time.perf_counter()
found = [find(image, low, high) for image in frames(images)]
print(len(found) / (time.perf_counter() - start))
with open(found_file, "w", newline="") as file:
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(["frame", "u_px", "v_px", "radius_px"])
    writer.writerows([frame, *circle] for frame, circle in enumerate(found) if circle)
