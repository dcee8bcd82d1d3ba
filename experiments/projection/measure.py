"""A million points projected from NumPy: Pardalis beside its Rust library, and beside OpenCV on the lens models that both have.

    python experiments/projection/measure.py [experiments/record/DATE]

Needs the packages of requirements.txt, `pip install ./crates/pardalis-python`, and cargo. Fails if any pixel differs from that of the Rust library, or by more than
1e-9 px from that of OpenCV.
"""

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np
from pardalis import Camera

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "experiments"))
import records

COUNT = 1_000_000
REPEATS = 15
SIZE_PX = (1280, 720)
F_PX, CENTER_PX = (900.0, 905.0), (640.5, 355.25)
TOLERANCE_PX = 1e-9
# Each with the coefficients of OpenCV.
LENSES = {
    "pinhole": [],
    "pinhole, 5 coefficients": [-0.28, 0.09, 4e-4, -7e-4, -0.012],
    "pinhole, 8 coefficients": [0.11, -0.05, 4e-4, -7e-4, 0.002, 0.31, -0.04, 0.003],
    "pinhole, 12 coefficients": [0.11, -0.05, 4e-4, -7e-4, 0.002, 0.31, -0.04, 0.003, 1e-3, -2e-4, 5e-4, 1e-4],
    "fisheye": [0.02, -0.006, 0.003, -0.001],
}


def points_m(rng):
    """Points ahead of the camera, from the middle of the image to its corners."""
    z = rng.uniform(0.5, 8.0, COUNT)
    return np.column_stack([rng.uniform(-0.68, 0.68, COUNT) * z, rng.uniform(-0.38, 0.38, COUNT) * z, z])


def pose():
    """A camera somewhere: as 4 x 4 matrix from it to the world, and as OpenCV has it."""
    rotation, _ = cv2.Rodrigues(np.array([0.3, -0.7, 1.1]))
    world_from_camera = np.eye(4)
    world_from_camera[:3, :3] = rotation
    world_from_camera[:3, 3] = [0.4, -1.2, 2.5]
    camera_from_world = np.linalg.inv(world_from_camera)
    turned, _ = cv2.Rodrigues(camera_from_world[:3, :3])
    return world_from_camera, turned, camera_from_world[:3, 3]


def calibration(name, k, world_from_camera):
    """The text of a calibration file of Pardalis."""
    model = f"kannala_brandt]\nk = {k}" if name == "fisheye" else f"pinhole]\ndistortion = {k}"
    return (
        f"[cameras.cam]\nsize_px = {list(SIZE_PX)}\nworld_from_camera = {world_from_camera.tolist()}\n"
        f"[cameras.cam.model.{model}\nf_px = {list(F_PX)}\ncenter_px = {list(CENTER_PX)}\n"
    )


def of_rust(folder):
    """Project the points of the folder by the Rust library. Return the pixels, and the least time of a few calls in seconds."""
    command = ["cargo", "bench", "--quiet", "--locked", "--package", "pardalis", "--bench", "rows", "--", str(folder), str(REPEATS)]
    ended = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True)
    return np.fromfile(folder / "pixels.f64").reshape(-1, 2), 1e-3 * float(ended.stdout)


def of_lens(name, k, in_camera_m, folder):
    world_from_camera, turned, moved = pose()
    in_world_m = in_camera_m @ world_from_camera[:3, :3].T + world_from_camera[:3, 3]
    (folder / "camera.toml").write_text(calibration(name, k, world_from_camera))
    in_world_m.tofile(folder / "points.f64")
    camera = Camera.read(folder / "camera.toml")
    matrix = np.array([[F_PX[0], 0, CENTER_PX[0]], [0, F_PX[1], CENTER_PX[1]], [0, 0, 1.0]])
    if name == "fisheye":
        of_opencv = lambda: cv2.fisheye.projectPoints(in_world_m[:, None], turned, moved, matrix, np.array(k))[0]
    else:
        of_opencv = lambda: cv2.projectPoints(in_world_m, turned, moved, matrix, np.array(k))[0]
    both = {"pardalis": lambda: camera.project(in_world_m), "opencv": of_opencv}
    pixels = both["pardalis"]()
    off_px = np.abs(pixels - both["opencv"]()[:, 0]).max()
    if not off_px <= TOLERANCE_PX:
        sys.exit(f"{name}: pixels differ by {off_px} px from those of OpenCV")
    # Before and after the others, because other programs may be busy meanwhile.
    rust_pixels, rust_s = of_rust(folder)
    if not np.array_equal(pixels, rust_pixels):
        sys.exit(f"{name}: pixels differ from those of the Rust library")
    best_s = dict.fromkeys(both, np.inf)
    for _ in range(REPEATS):
        for which, project in both.items():
            begin_s = time.perf_counter()
            project()
            best_s[which] = min(best_s[which], time.perf_counter() - begin_s)
    rust_s = min(rust_s, of_rust(folder)[1])
    rust_ms, ours_ms, theirs_ms = (1e3 * seconds for seconds in (rust_s, best_s["pardalis"], best_s["opencv"]))
    return {
        "run": name,
        "rust_ms": round(rust_ms, 1),
        "pardalis_ms": round(ours_ms, 1),
        "opencv_ms": round(theirs_ms, 1),
        "times_rust": round(ours_ms / rust_ms, 2),
        "times_as_fast": round(theirs_ms / ours_ms, 2),
        "most_off_px": f"{off_px:.1e}",
    }


def main(record=None):
    cv2.setNumThreads(1)
    in_camera_m = points_m(np.random.default_rng(1))
    measured = []
    with tempfile.TemporaryDirectory() as folder:
        for name, k in LENSES.items():
            measured.append(of_lens(name, k, in_camera_m, Path(folder)))
            print(measured[-1])
    if record:
        records.write(record, "numpy-projection", measured, "python experiments/projection/measure.py", f"numpy {np.__version__}", f"opencv {cv2.__version__}")


if __name__ == "__main__":
    main(*sys.argv[1:])
