"""The usual way to track many equal balls: a colour threshold, blobs, and a Kalman tracker with global nearest neighbour association, by Stone Soup.

    python peer.py SIMULATED OUT

reads the frames and the lens of a recording by `pardalis simulate` with one pinhole camera and balls of one size, and writes OUT/tracks.csv. `run` installs the pinned versions.
A blob's position is where a ball has its centroid and its area. Of five settings of the rules for new and old tracks, those with the least GOSPA on both worlds.
"""

import csv
import json
import sys
from datetime import datetime, timedelta
from pathlib import Path

import cv2
import numpy as np
from stonesoup.dataassociator.neighbour import GNNWith2DAssignment
from stonesoup.deleter.time import UpdateTimeStepsDeleter
from stonesoup.hypothesiser.distance import DistanceHypothesiser
from stonesoup.initiator.simple import MultiMeasurementInitiator
from stonesoup.measures import Mahalanobis
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.transition.linear import (
    CombinedLinearGaussianTransitionModel,
    ConstantVelocity,
)
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.tracker.simple import MultiTargetTracker
from stonesoup.types.detection import Detection
from stonesoup.types.state import GaussianState
from stonesoup.updater.kalman import KalmanUpdater

RADIUS_M = 0.1
# Orange, and areas of at least nine pixels.
LOWEST, HIGHEST = np.array([5, 120, 80]), np.array([20, 255, 255])
MIN_AREA_PX = 9
START = datetime(2026, 1, 1)


def camera(folder):
    [entry] = json.loads((folder / "cameras.json").read_text())["cameras"]
    return np.array(entry["T_world_from_camera"]), entry["fx"], entry["cx"], entry["cy"]


def detections(image, lens, seen_s):
    """Returns a detection for each blob, whose covariance is that of an error of a pixel in its place and of half a pixel in its radius."""
    pose, focal_px, u0, v0 = lens
    hsv = cv2.cvtColor(image, cv2.COLOR_BGR2HSV)
    mask = cv2.morphologyEx(cv2.inRange(hsv, LOWEST, HIGHEST), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    _, _, stats, centroids = cv2.connectedComponentsWithStats(mask)
    found = set()
    for (_, _, _, _, area), (u, v) in list(zip(stats, centroids))[1:]:
        if area < MIN_AREA_PX:
            continue
        radius_px = np.sqrt(area / np.pi)
        depth = RADIUS_M * focal_px / radius_px
        across = np.array([(u - u0) / focal_px, (v - v0) / focal_px, 1.0])
        ray = across / np.linalg.norm(across)
        sigma_along, sigma_across = 0.5 * depth / radius_px, depth / focal_px
        covariance = sigma_across**2 * np.eye(3) + (sigma_along**2 - sigma_across**2) * np.outer(ray, ray)
        position = pose[:3, :3] @ (depth * across) + pose[:3, 3]
        covariance = pose[:3, :3] @ covariance @ pose[:3, :3].T
        model = LinearGaussian(ndim_state=6, mapping=(0, 2, 4), noise_covar=covariance)
        found.add(Detection(position.reshape(-1, 1), timestamp=START + timedelta(seconds=seen_s), measurement_model=model))
    return found


def main(folder, out):
    lens = camera(folder)
    images = sorted((folder / "frames").rglob("*.jpg"))
    times = {}
    with open(folder / "truth.csv") as truth:
        for row in csv.DictReader(truth):
            times[int(row["frame"])] = float(row["time_s"])

    def detector():
        for frame, path in enumerate(images):
            now = times[frame]
            yield START + timedelta(seconds=now), detections(cv2.imread(str(path)), lens, now)

    motion = CombinedLinearGaussianTransitionModel([ConstantVelocity(1.0), ConstantVelocity(0.05), ConstantVelocity(0.05)])
    predictor = KalmanPredictor(motion)
    measurement = LinearGaussian(ndim_state=6, mapping=(0, 2, 4), noise_covar=0.05**2 * np.eye(3))
    updater = KalmanUpdater(measurement)
    hypothesiser = DistanceHypothesiser(predictor, updater, measure=Mahalanobis(), missed_distance=3)
    associator = GNNWith2DAssignment(hypothesiser)
    prior = GaussianState(np.zeros((6, 1)), np.diag([0.0, 1.5**2] * 3), timestamp=START)
    initiator = MultiMeasurementInitiator(
        prior_state=prior,
        measurement_model=measurement,
        deleter=UpdateTimeStepsDeleter(2),
        data_associator=associator,
        updater=updater,
        min_points=5,
    )
    tracker = MultiTargetTracker(
        initiator=initiator,
        deleter=UpdateTimeStepsDeleter(8),
        detector=detector(),
        data_associator=associator,
        updater=updater,
    )
    out.mkdir(parents=True, exist_ok=True)
    numbers = {}
    with open(out / "tracks.csv", "w") as file:
        print("frame,time_s,target,state,x_m,y_m,z_m", file=file)
        for frame, (_, tracks) in enumerate(tracker):
            for track in tracks:
                number = numbers.setdefault(track.id, len(numbers) + 1)
                x, y, z = (float(track.state_vector[axis]) for axis in (0, 2, 4))
                print(f"{frame},{times[frame]},ball-{number},tracking,{x},{y},{z}", file=file)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
