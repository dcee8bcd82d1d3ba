"""OpenCV's own tools beside Pardalis, on the same sequences, scored alike.

compare.py PARDALIS OUTPUT_FOLDER, from the repository's root

PARDALIS is the program. Each method gives in each image a middle and an area, or none. One camera: the direction is that of the middle, the distance that of a
ball whose disc has the same solid angle. Several cameras: the point nearest to the rays through the middles. threshold: pixels in a range of hue, saturation
and value, opened, the largest blob. CamShift and CSRT start from the true box, which they need; Pardalis gets no start. Prints a Markdown table: root mean
square error and mean error of the distance over frames in which more than 0.6 of the ball is visible, the share of those with an estimate, and how many of them are
lost: without an estimate, or with one farther off than three diameters (one camera) or one (several).
"""
import csv
import json
import pathlib
import subprocess
import sys
import tomllib

import cv2
import numpy as np

program, output = pathlib.Path(sys.argv[1]), pathlib.Path(sys.argv[2])
DATA = pathlib.Path("data")
# By hand, for the best result on these very sequences.
ORANGE = {"hue_deg": (4, 40), "saturation_from": 0.35, "value_from": 0.15}
ORANGE_IN_MIRROR = {"hue_deg": (4, 60), "saturation_from": 0.4, "value_from": 0.15}
PINK = {"hue_deg": (335, 10), "saturation_from": 0.35, "value_from": 0.55}
# Sequence, the scene whose cameras see it, the ball's radius, its colours.
SEQUENCES = [
    ("dioptric-jump", "fisheye", 0.11, ORANGE),
    ("dioptric-occlusion-robot", "fisheye", 0.11, ORANGE),
    ("dioptric-occlusion-bar", "fisheye", 0.11, ORANGE),
    ("catadioptric-bounce", "mirror", 0.11, ORANGE_IN_MIRROR),
    ("catadioptric-ramp", "mirror", 0.11, ORANGE_IN_MIRROR),
    ("webcams-two", "webcams-two", 0.035, PINK),
    ("webcams-four", "webcams-four", 0.035, PINK),
]
COLUMNS = "frame time_s target state x_m y_m z_m".split()


class Camera:
    """Pixels to rays: `rays(pixels)` gives unit vectors of the world from `center_m`."""

    def __init__(self, world_from_camera, directions):
        pose = np.array(world_from_camera)
        self.rotation, self.center_m = pose[:3, :3], pose[:3, 3]
        self.directions = directions

    def rays(self, pixels):
        rays = self.directions(np.asarray(pixels, float).reshape(-1, 2))
        return (rays / np.linalg.norm(rays, axis=1, keepdims=True)) @ self.rotation.T

    def solid_angle_per_px(self, pixel):
        """Steradians of a square pixel there."""
        u, v = pixel
        left, right, up, down = self.rays([(u - 0.5, v), (u + 0.5, v), (u, v - 0.5), (u, v + 0.5)])
        return np.linalg.norm(np.cross(right - left, down - up))

    def pixel_of(self, point_m, near_px):
        """The pixel that sees a point, from one nearby: Newton's method."""
        wanted = (point_m - self.center_m) / np.linalg.norm(point_m - self.center_m)
        pixel = np.array(near_px, float)
        for _ in range(10):
            u, v = pixel
            here, right, down = self.rays([(u, v), (u + 0.01, v), (u, v + 0.01)])
            jacobian = np.stack([right - here, down - here], axis=1) / 0.01
            pixel += np.linalg.lstsq(jacobian, wanted - here, rcond=None)[0]
        return pixel


def pinhole(camera):
    def directions(pixels):
        x = (pixels[:, 0] - camera["cx"]) / camera["fx"]
        y = (pixels[:, 1] - camera["cy"]) / camera["fy"]
        return np.stack([x, y, np.ones(len(pixels))], axis=1)

    return Camera(camera["T_world_from_camera"], directions)


def equidistant(camera):
    def directions(pixels):
        x, y = pixels[:, 0] - camera["cx"], pixels[:, 1] - camera["cy"]
        r = np.hypot(x, y) + 1e-12
        angle = r / camera["f_px_per_rad"]
        return np.stack([x / r * np.sin(angle), y / r * np.sin(angle), np.cos(angle)], axis=1)

    return Camera(camera["T_world_from_camera"], directions)


def unified(path):
    camera = tomllib.loads(path.read_text())["cameras"]["camera"]
    model = camera["model"]["unified"]
    l, scale = model["l"], model["f_px"] * (model["l"] + model["m"])

    def directions(pixels):
        x, y = (pixels - model["center_px"]).T
        r = np.hypot(x, y) + 1e-12
        k = r / scale  # sin a / (l + cos a), with a from the mirror's -z
        phi = np.arctan(k)
        angle = phi + np.arcsin(k * l * np.cos(phi))
        return np.stack([x / r * np.sin(angle), y / r * np.sin(angle), -np.cos(angle)], axis=1)

    return Camera(camera["world_from_camera"], directions)


def cameras_of(sequence, scene):
    """The cameras with the folders of their images."""
    folder = DATA / sequence
    if scene == "mirror":
        return [(unified(DATA / "calibration/catadioptric/unified.toml"), folder / "frames")]
    if scene == "fisheye":
        return [(equidistant(json.loads((folder / "camera.json").read_text())), folder / "frames")]
    cameras = json.loads((folder / "cameras.json").read_text())["cameras"]
    return [(pinhole(camera), folder / "frames" / camera["name"]) for camera in cameras]


def threshold_mask(image, colors):
    hsv = cv2.cvtColor(image, cv2.COLOR_BGR2HSV)
    hue, saturation, value = hsv[..., 0] * 2.0, hsv[..., 1] / 255, hsv[..., 2] / 255
    first, last = colors["hue_deg"]
    in_hue = (hue >= first) & (hue <= last) if first <= last else (hue >= first) | (hue <= last)
    mask = in_hue & (saturation >= colors["saturation_from"]) & (value >= colors["value_from"])
    return mask.astype(np.uint8)


class Threshold:
    def __init__(self, colors, _image, _box):
        self.colors = colors

    def find(self, image):
        mask = cv2.morphologyEx(threshold_mask(image, self.colors), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
        count, _, stats, centroids = cv2.connectedComponentsWithStats(mask)
        if count < 2:
            return None
        largest = 1 + np.argmax(stats[1:, cv2.CC_STAT_AREA])
        return centroids[largest], stats[largest, cv2.CC_STAT_AREA]


class CamShift:
    """As OpenCV's demo: back projection of the hue in the middle of the first box, without pixels that are greyer or darker than the threshold's."""

    def __init__(self, colors, image, box):
        self.lowest = (0, int(255 * colors["saturation_from"]), int(255 * colors["value_from"]))
        self.box = box
        x, y, width, height = box
        hsv, colored = self.colored(image)
        inside = slice(y + height // 4, y + height - height // 4), slice(x + width // 4, x + width - width // 4)
        self.histogram = cv2.calcHist([hsv[inside]], [0], colored[inside], [180], [0, 180])
        cv2.normalize(self.histogram, self.histogram, 0, 255, cv2.NORM_MINMAX)

    def colored(self, image):
        hsv = cv2.cvtColor(image, cv2.COLOR_BGR2HSV)
        return hsv, cv2.inRange(hsv, self.lowest, (180, 255, 255))

    def find(self, image):
        hsv, colored = self.colored(image)
        weights = cv2.calcBackProject([hsv], [0], self.histogram, [0, 180], 1) & colored
        criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 10, 1)
        (middle, (width, height), _), self.box = cv2.CamShift(weights, self.box, criteria)
        # Where all is lost its window is empty, and it would never come back.
        if width < 1 or height < 1 or not self.box[2] or not self.box[3]:
            self.box = (0, 0, image.shape[1], image.shape[0])
            return None
        return np.array(middle), np.pi / 4 * width * height


class Csrt:
    def __init__(self, _colors, image, box):
        self.tracker = cv2.TrackerCSRT_create()
        self.tracker.init(image, box)

    def find(self, image):
        is_found, (x, y, width, height) = self.tracker.update(image)
        if not is_found:
            return None
        # Pixel centres are at integers.
        return np.array([x + width / 2 - 0.5, y + height / 2 - 0.5]), np.pi / 4 * width * height


def true_box(camera, point_m, radius_m, near_px, size_px):
    """The box around the ball, whole pixels within the image."""
    middle = camera.pixel_of(point_m, near_px)
    half_angle = np.arcsin(radius_m / np.linalg.norm(point_m - camera.center_m))
    radius_px = half_angle / np.sqrt(camera.solid_angle_per_px(middle))
    low = np.maximum(np.round(middle - radius_px), 0).astype(int)
    high = np.minimum(np.round(middle + radius_px) + 1, size_px).astype(int)
    return (*(int(c) for c in low), *(int(c) for c in high - low))


def by_size(camera, middle, area_px, radius_m):
    solid_angle = area_px * camera.solid_angle_per_px(middle)
    half_angle = np.arccos(1 - min(solid_angle / (2 * np.pi), 0.999))
    return camera.center_m + radius_m / np.sin(half_angle) * camera.rays([middle])[0]


def by_rays(seen):
    normal, right = np.zeros((3, 3)), np.zeros(3)
    for camera, middle in seen:
        ray = camera.rays([middle])[0]
        across = np.eye(3) - np.outer(ray, ray)
        normal += across
        right += across @ camera.center_m
    return np.linalg.solve(normal, right)


def truth_of(sequence):
    """Rows of the ball: by frame, then in the order of cameras."""
    frames = {}
    with open(DATA / sequence / "truth.csv", newline="") as file:
        for row in csv.DictReader(file):
            if row["object"] == "ball":
                frames.setdefault(int(row["frame"]), []).append(row)
    return frames


def follow(method, sequence, scene, radius_m, colors, path):
    """Writes the tracks of a method."""
    cameras, truth = cameras_of(sequence, scene), truth_of(sequence)
    finders = [None] * len(cameras)
    with open(path, "w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        for frame, rows in truth.items():
            point_m = np.array([float(rows[0][column]) for column in ("x_m", "y_m", "z_m")])
            seen = []
            for number, ((camera, folder), row) in enumerate(zip(cameras, rows, strict=True)):
                image = cv2.imread(str(folder / f"{frame:06}.jpg"))
                if finders[number] is None and float(row["visible_fraction"]) > 0.9:
                    size_px = (image.shape[1], image.shape[0])
                    near_px = float(row["u_px"]), float(row["v_px"])
                    box = true_box(camera, point_m, radius_m, near_px, size_px)
                    finders[number] = method(colors, image, box)
                found = finders[number] and finders[number].find(image)
                if found:
                    seen.append((camera, *found))
            said = {"frame": frame, "time_s": rows[0]["time_s"], "target": "ball", "state": "lost"}
            position_m = None
            if len(cameras) == 1 and seen:
                position_m = by_size(*seen[0], radius_m)
            elif len(seen) > 1:
                position_m = by_rays([(camera, middle) for camera, middle, _ in seen])
            if position_m is not None:
                said |= dict(zip(("state", "x_m", "y_m", "z_m"), ("tracking", *position_m)))
            writer.writerow(said)


def track(sequence, scene, folder):
    """Pardalis with the scene of its kind of camera, its images replaced, without a start."""
    text = pathlib.Path(f"experiments/edge/{scene}.toml").read_text()
    named = {"fisheye": "dioptric-jump", "mirror": "catadioptric-bounce"}.get(scene, scene)
    text = text.replace(f"data/{named}/", f"data/{sequence}/").replace("../../data", str(DATA.resolve()))
    fps = json.loads(next((DATA / sequence).glob("camera*.json")).read_text())["sequence"]["fps"]
    scene_file = output / f"{sequence}.toml"
    scene_file.write_text(text.replace("fps = 25", f"fps = {fps}"))
    subprocess.run([program, "track", scene_file, "-o", folder], check=True, capture_output=True)


def scored(tracks, sequence, scene, lost_beyond_m):
    """Distances are from the first camera."""
    around_m = ",".join(str(c) for c in cameras_of(sequence, scene)[0][0].center_m)
    command = [program, "evaluate", tracks, DATA / sequence, "--json", "-"]
    command += ["--lost-beyond-m", str(lost_beyond_m), "--around", around_m]
    report = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)
    return report["targets"][0]


output.mkdir(parents=True, exist_ok=True)
print("| sequence | method | RMSE (mm) | distance mean (mm) | coverage | lost frames |\n|---|---|---:|---:|---:|---:|")
for sequence, scene, radius_m, colors in SEQUENCES:
    lost_beyond_m = 6 * radius_m if scene in ("fisheye", "mirror") else 2 * radius_m
    for name, method in [("threshold", Threshold), ("CamShift", CamShift), ("CSRT", Csrt), ("Pardalis", None)]:
        tracks = output / f"{sequence}-{name}.csv"
        if method is None:
            tracks = output / f"{sequence}-{name}"
            track(sequence, scene, tracks)
        else:
            follow(method, sequence, scene, radius_m, colors, tracks)
        scores = scored(tracks, sequence, scene, lost_beyond_m)
        errors, frames = scores["visible"]["errors"], scores["visible"]["frames"]
        rmse = f"{1e3 * errors['position_m']['rmse']:.1f}" if errors else "-"
        distance = f"{1e3 * errors['distance_m']['mean']:.1f}" if errors else "-"
        print(f"| {sequence} | {name} | {rmse} | {distance} | {100 * scores['coverage']:.0f} % | {scores['lost_frames']} of {frames} |", flush=True)
