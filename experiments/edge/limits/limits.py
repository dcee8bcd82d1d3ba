"""How near to the truth an estimator can come, image by image: the Cramer-Rao bound of an ideal edge.

limits.py, from the repository's root; takes some minutes and prints a Markdown table.

A target is one colour, what surrounds it another, and the edge between them is a step that optics and pixels blur to a cumulative normal curve: a pixel at the signed distance d from the
outline has the value b + c F(-d/s), of luma in each pixel, of the two chroma planes in each block of 2 x 2 (4:2:0). The outline is the true one, projected by the exact camera. Measured
in each sequence: the noise by what changes from frame to frame where nothing moves, and the blur s by the mean course of colours across the true outlines; in each frame and eighth
of an outline the contrast c by what lies beside it. Motion during the exposure blurs by its own length. The Fisher information of the position is the sum over pixels, planes and cameras of
(dI/dx)(dI/dx)'/noise^2, the bound on the root mean square error that of its inverse's trace over frames. Colours known: c and b are given. Unknown: they are sought along with the
position, in each eighth of the outline and each plane.

Two columns are no bounds. Misfit as noise: the bound with unknown colours, were all that the ideal edge leaves unexplained (texture, shading, JPEG) noise, independent from pixel to pixel.
Ideal edge: the error of least squares with an ideal edge, by one step from the truth.
"""
import csv
import json
import pathlib

import cv2
import numpy as np
from scipy.optimize import least_squares
from scipy.special import ndtr

DATA = pathlib.Path("data")
OUTLINE_POINTS = 256
SECTORS = 8
# Pixels that take part, by their distance from the outline.
NEAR_PX = 6.0
# The colours beside an outline are those of pixels at such distances, away from what the blur mixes.
BESIDE_PX = (2.0, 5.0)


class Camera:
    """`project(points_m)`: world points to pixels. `eye_m(point_m)`: whence a point of the world is seen, in the world."""

    def __init__(self, world_from_camera, project, eye=lambda _: np.zeros(3)):
        pose = np.array(world_from_camera)
        self.rotation, self.center_m = pose[:3, :3], pose[:3, 3]
        self.of_camera, self.eye_of = project, eye

    def inside(self, points_m):
        return (points_m - self.center_m) @ self.rotation

    def project(self, points_m):
        return self.of_camera(self.inside(points_m))

    def eye_m(self, point_m):
        return self.eye_of(self.inside(point_m)) @ self.rotation.T + self.center_m


def pinhole(camera):
    def project(p):
        return p[:, :2] / p[:, 2:] * [camera["fx"], camera["fy"]] + [camera["cx"], camera["cy"]]

    return Camera(camera["T_world_from_camera"], project)


def equidistant(camera):
    def project(p):
        r = np.hypot(p[:, 0], p[:, 1])
        scale = camera["f_px_per_rad"] * np.arctan2(r, p[:, 2]) / r
        return p[:, :2] * scale[:, None] + [camera["cx"], camera["cy"]]

    return Camera(camera["T_world_from_camera"], project)


def mirror(camera):
    """The reflection is sought on the mirror's profile t, F(t), F'(t) by halving: the ray that leaves it at t looks the lower the smaller t."""
    profile, lens = camera["mirror_profile"], camera["perspective_camera"]
    t_m, f_m, slope = (np.array(profile[key]) for key in ("t_m", "F_m", "dF"))

    def at(t):
        return np.interp(t, t_m, f_m), np.interp(t, t_m, slope)

    def reflection(p):
        r, z = np.hypot(p[:, 0], p[:, 1]), p[:, 2]
        low, high = np.zeros(len(p)), np.full(len(p), t_m[-1])
        for _ in range(50):
            t = (low + high) / 2
            f, df = at(t)
            is_low = np.arctan2(t, f) + 2 * np.arctan(df) < np.arctan2(r - t, f - z)
            low, high = np.where(is_low, t, low), np.where(is_low, high, t)
        return t, at(t)[0], p[:, :2] / r[:, None]

    def project(p):
        t, f, direction = reflection(p)
        return direction * (lens["fx"] * t / f)[:, None] + [lens["cx"], lens["cy"]]

    def eye(p):
        t, f, direction = reflection(p[None])
        return np.append(direction[0] * t, f)

    return Camera(camera["T_world_from_camera"], project, eye)


def circle(center_m, radius_m, across):
    """Points of a circle in the plane of two unit vectors."""
    angle = np.linspace(0, 2 * np.pi, OUTLINE_POINTS, endpoint=False)[:, None]
    return center_m + radius_m * (np.cos(angle) * across[0] + np.sin(angle) * across[1])


def sphere(camera, center_m, radius_m):
    """The outline of a sphere: where rays touch it."""
    ray = center_m - camera.eye_m(center_m)
    distance = np.linalg.norm(ray)
    ray /= distance
    side = np.cross(ray, [0.0, 0.0, 1.0] if abs(ray[2]) < 0.9 else [1.0, 0.0, 0.0])
    side /= np.linalg.norm(side)
    sine = radius_m / distance
    touched = circle(center_m - radius_m * sine * ray, radius_m * np.sqrt(1 - sine**2), (side, np.cross(ray, side)))
    return camera.project(touched)


def disc(camera, center_m, radius_m):
    """The outline of a disc that lies flat."""
    return camera.project(circle(center_m, radius_m, np.eye(3)[:2]))


def planes(path):
    """Luma, and both chroma planes as they were stored: means over blocks of 2 x 2."""
    image = cv2.cvtColor(cv2.imread(str(path)), cv2.COLOR_BGR2YCrCb).astype(float)
    height, width = image.shape[0] // 2, image.shape[1] // 2
    halved = image[: 2 * height, : 2 * width, 1:].reshape(height, 2, width, 2, 2).mean(axis=(1, 3))
    return image[..., 0], halved[..., 0], halved[..., 1]


class Edge:
    """Pixels of one plane near an outline: values, signed distances (inside negative), sector, and how the distance changes with what is sought."""

    def __init__(self, image, step_px, outline, derivative, blur_px):
        first = (step_px - 1) / 2
        low = np.floor((outline.min(axis=0) - NEAR_PX - 2 - first) / step_px).astype(int)
        high = np.ceil((outline.max(axis=0) + NEAR_PX + 2 - first) / step_px).astype(int)
        low, high = np.maximum(low, 0), np.minimum(high, [image.shape[1] - 1, image.shape[0] - 1])
        u, v = np.meshgrid(np.arange(low[0], high[0] + 1), np.arange(low[1], high[1] + 1))
        pixels = np.stack([u.ravel(), v.ravel()], axis=1)
        places = pixels * step_px + first
        tangent = np.roll(outline, -1, axis=0) - np.roll(outline, 1, axis=0)
        normal = np.stack([tangent[:, 1], -tangent[:, 0]], axis=1)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        if np.sum((outline - outline.mean(axis=0)) * normal) < 0:
            normal = -normal
        offset = places[:, None] - outline
        nearest = np.argmin((offset**2).sum(axis=2), axis=1)
        distance = (offset[np.arange(len(places)), nearest] * normal[nearest]).sum(axis=1)
        near = np.abs(distance) <= NEAR_PX
        nearest = nearest[near]
        self.distance_px = distance[near]
        self.value = image[pixels[near, 1], pixels[near, 0]]
        self.sector = nearest * SECTORS // OUTLINE_POINTS
        # An outline that moves outwards makes the distance smaller.
        self.slope = -np.einsum("pkd,pd->pk", derivative, normal)[nearest]
        self.motion_px = np.abs((blur_px * normal).sum(axis=1))[nearest]

    def blurred_px(self, blur_px):
        """A uniform motion has a twelfth of its squared length as variance."""
        return np.sqrt(blur_px**2 + self.motion_px**2 / 12)

    def sides(self):
        """The colours inside and outside, by sector; without pixels there, those of all sectors."""
        def side(sign):
            beside = (sign * self.distance_px >= BESIDE_PX[0]) & (sign * self.distance_px <= BESIDE_PX[1])
            if not beside.any():  # a small target's inside
                beside = sign * self.distance_px >= 0.8 * (sign * self.distance_px).max()
            whole = np.median(self.value[beside])
            of = [self.value[beside & (self.sector == s)] for s in range(SECTORS)]
            return np.array([np.median(values) if len(values) else whole for values in of])[self.sector]

        return side(-1), side(1)

    def linear(self, blur_px):
        """What the ideal edge says of each pixel at the truth: how it changes with what is sought, colours known; likewise, without what unknown colours of each
        sector's sides explain as well; and what the ideal edge with the best such colours leaves of its value."""
        inside, outside = self.sides()
        s = self.blurred_px(blur_px)
        z = self.distance_px / s
        known = -((inside - outside) * np.exp(-(z**2) / 2) / np.sqrt(2 * np.pi) / s)[:, None] * self.slope
        sector, share = np.eye(SECTORS)[self.sector], ndtr(-z)[:, None]
        colors = np.concatenate([sector * share, sector * (1 - share)], axis=1)
        both = np.column_stack([known, self.value])
        unexplained = both - colors @ np.linalg.lstsq(colors, both, rcond=None)[0]
        return known, unexplained[:, :-1], unexplained[:, -1]


def near_edges(frame, planes_of):
    """All planes of a frame around all its outlines: plane number and `Edge`."""
    for image, outline_of in frame["views"]:
        outline = outline_of(frame["sought"])
        # Metres and radians alike.
        steps = 1e-4 * np.eye(len(frame["sought"]))
        change = [outline_of(frame["sought"] + step) - outline_of(frame["sought"] - step) for step in steps]
        derivative = np.stack(change, axis=1) / 2e-4
        motion_px = np.einsum("pkd,k->pd", derivative, frame["motion"])
        for plane, values in enumerate(planes_of[image]):
            yield plane, Edge(values, 1 if plane == 0 else 2, outline, derivative, motion_px)


def noise_of(images, levels=16):
    """Standard deviation by plane and level of luma, as functions: of what changes between successive images, most of which stands still. Of means over 3 x 3 times 3, so that
    what JPEG makes neighbours share counts as noise of all of them."""
    changes, lumas = [[], [], []], [[], [], []]
    for before, after in zip(images, images[1:]):
        luma = [before[0]] + 2 * [cv2.resize(before[0], before[1].shape[::-1], interpolation=cv2.INTER_AREA)]
        for plane in range(3):
            change = 3 * cv2.blur(after[plane] - before[plane], (3, 3))
            changes[plane].append(change[1:-1:3, 1:-1:3].ravel())
            lumas[plane].append(cv2.blur(luma[plane], (3, 3))[1:-1:3, 1:-1:3].ravel())
    functions = []
    for change, luma in zip(map(np.concatenate, changes), map(np.concatenate, lumas)):
        level = (luma * levels / 256).astype(int)
        filled = [l for l in range(levels) if np.sum(level == l) > 500]
        spread = []
        for l in filled:
            of_level = change[level == l]
            deviation = 1.4826 * np.median(np.abs(of_level - np.median(of_level)))
            # Rounding to whole numbers has a variance of a twelfth.
            spread.append(np.sqrt(deviation**2 / 2 + 1 / 12))
        middles = (np.array(filled) + 0.5) * 256 / levels
        functions.append(lambda value, middles=middles, spread=spread: np.interp(value, middles, spread))
    return functions


def blur_of(edges):
    """The blur in px, and where the middle of edges lies, by the mean course of colours across outlines; pixels count by their contrast."""
    distance, motion, value, inside, outside = (
        np.concatenate(columns)
        for columns in zip(*((e.distance_px, e.motion_px, e.value, *e.sides()) for e in edges))
    )

    def off(sought):
        blur, middle = sought
        share = ndtr(-(distance - middle) / np.sqrt(blur**2 + motion**2 / 12))
        return outside + (inside - outside) * share - value

    return least_squares(off, [1.0, 0.0], loss="soft_l1", f_scale=5.0).x


def frames_of(sequence):
    """For each frame in which more than 0.6 of the target is seen: what is sought, its change during the exposure, the distance from the camera, and its views: images
    with the outlines in them as functions of what is sought."""
    folder = DATA / sequence
    file = next(folder.glob("camera*.json"))
    described = json.loads(file.read_text())
    timing = described["sequence"]
    exposure_s = timing.get("shutter_fraction_of_frame_interval", 0) / (timing.get("fps") or 1)
    rows = {}
    for row in csv.DictReader((folder / "truth.csv").open()):
        rows.setdefault(int(row["frame"]), {}).setdefault(row["object"], []).append(row)
    for number, objects in rows.items():
        if sequence == "plane-robot":
            row = objects["robot"][0]
            names = ["x_m", "y_m", "heading_rad"]
            camera = pinhole(described)

            def outline(sought, side):
                x, y, heading = sought
                center_m = [x + side * 0.15 * np.cos(heading), y + side * 0.15 * np.sin(heading), 0.406]
                return disc(camera, np.array(center_m), 0.06)

            views = [(f"frames/{number:06}.jpg", lambda sought, s=s: outline(sought, s)) for s in (1, -1)]
            seen = [row]
        else:
            seen = objects["ball"]
            row, names = seen[0], ["x_m", "y_m", "z_m"]
            make = mirror if sequence.startswith("cata") else equidistant if sequence.startswith("diop") else pinhole
            cameras = [make(camera) for camera in described.get("cameras", [described])]
            radius_m = timing["ball_radius_m"]
            subfolders = [f"{c['name']}/" for c in described["cameras"]] if "cameras" in described else [""]
            views = [
                (f"frames/{subfolder}{number:06}.jpg", lambda sought, c=c: sphere(c, sought, radius_m))
                for subfolder, c in zip(subfolders, cameras)
            ]
        if min(float(r["visible_fraction"]) for r in seen) <= 0.6:
            continue
        position = np.array([float(row[name]) for name in names])
        velocity = np.array([float(row[v]) for v in ("vx_mps", "vy_mps", "vz_mps")])
        if sequence == "plane-robot":
            velocity[2] = 0
        yield {
            "sought": position,
            "motion": velocity * exposure_s,
            "range_m": np.linalg.norm([float(row[c]) for c in ("xc_m", "yc_m", "zc_m")]),
            "views": views,
        }


def limits(sequence):
    """The frames of a sequence, each with the three covariances and the error of the table, noise and misfit; and blur and middle of its edges, luma's and chroma's."""
    frames = list(frames_of(sequence))
    images = {image: planes(DATA / sequence / image) for frame in frames for image, _ in frame["views"]}
    folder = lambda image: pathlib.Path(image).parent
    noises = {f: noise_of([p for image, p in images.items() if folder(image) == f]) for f in set(map(folder, images))}
    edges = [list(near_edges(frame, images)) for frame in frames]
    blurs = [blur_of([e for of in edges for plane, e in of if (plane > 0) == is_chroma]) for is_chroma in (False, True)]
    for frame, of in zip(frames, edges):
        noise_at = [noises[folder(image)] for image, _ in frame["views"] for _ in range(3)]
        levels = [np.mean(e.sides()) for _, e in of]
        noise = [noise_at[i][plane](levels[i - plane]) for i, (plane, _) in enumerate(of)]
        known, unknown, left = zip(*(e.linear(blurs[plane > 0][0]) for plane, e in of))
        spread = [np.sqrt(np.sum(l**2) / (len(l) - 2 * SECTORS)) for l in left]
        covariance = lambda js, noise: np.linalg.inv(sum(j.T @ j / n**2 for j, n in zip(js, noise)))
        frame["covariances"] = [covariance(known, noise), covariance(unknown, noise), covariance(unknown, spread)]
        frame["error"] = frame["covariances"][2] @ sum(j.T @ l / n**2 for j, l, n in zip(unknown, left, spread))
        frame["noise"] = [np.mean(noise[::3]), np.mean([n for i, n in enumerate(noise) if i % 3])]
        frame["misfit"] = [np.mean(spread[::3]), np.mean([n for i, n in enumerate(spread) if i % 3])]
    return frames, blurs


def row(name, frames, blurs):
    """Pairs are of luma and of chroma; root mean squares over frames, of the robot over x and y."""
    pair = lambda key: ", ".join(f"{n:.1f}" for n in np.mean([f[key] for f in frames], axis=0))
    cells = [name, str(len(frames)), pair("noise"), pair("misfit")]
    cells += [", ".join(f"{blur[i]:.2f}" for blur in blurs) for i in (0, 1)]
    size = 2 if "plane" in name else 3
    for kind in range(3):
        of = np.array([f["covariances"][kind] for f in frames])
        cells.append(f"{1e3 * np.sqrt(np.mean(np.trace(of[:, :size, :size], axis1=1, axis2=2))):.2f}")
    errors = np.array([f["error"] for f in frames])[:, :size]
    cells.append(f"{1e3 * np.sqrt(np.mean(np.sum(errors**2, axis=1))):.2f}")
    print("| " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    print("| sequence | frames | noise | misfit | blur s (px) | middle (px) | **colours known** (mm) | **unknown** (mm) | misfit as noise (mm) | ideal edge (mm) |")
    print("|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|")
    for sequence in ["dioptric-jump", "catadioptric-static", "webcams-two", "plane-robot"]:
        frames, blurs = limits(sequence)
        if sequence == "dioptric-jump":
            near = [f for f in frames if f["range_m"] <= 2.5]
            row("dioptric-jump, up to 2.5 m", near, blurs)
        row(sequence, frames, blurs)
