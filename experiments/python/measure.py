"""The tracker from NumPy beside the program, on the same frames.

    python experiments/python/measure.py [experiments/record/DATE]

Needs `pip install ./crates/pardalis-python`, and cargo. Fails if a position differs from that of the program at all.
"""

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

# Before the package starts its threads.
os.environ["RAYON_NUM_THREADS"] = "1"

import numpy as np
from pardalis import Tracker, read_image, read_tracks

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "experiments"))
import records

REPEATS = 15
FPS = 25
# A scene with one camera and a ball, and its images.
SCENE, CAMERA, TARGET = ROOT / "experiments/edge/fisheye.toml", "cam1", "ball"
IMAGES = ROOT / "data/dioptric-jump/frames"


def of_program(folder):
    """Track with the program. Return the positions, and the time for tracking a frame in milliseconds."""
    program = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"), "release/pardalis")
    subprocess.run([program, "track", SCENE, "--threads", "1", "--no-plots", "-o", folder], capture_output=True, check=True)
    tracks = read_tracks(folder)
    return tracks.positions_m(TARGET), 1e3 * tracks.summary["time"]["tracking_s"] / len(tracks)


def of_python(paths, arranged):
    """Track arrays. Return the positions, and the time for observing a frame and asking for the estimate in milliseconds."""
    tracker = Tracker.of_scene(SCENE)
    positions_m, took_s = [], 0.0
    for number, path in enumerate(paths):
        # As in the program, each image is decoded right before it is tracked.
        image = arranged(read_image(path))
        begin_s = time.perf_counter()
        tracker.observe({CAMERA: image}, number / FPS)
        positions_m.append(tracker.estimate(TARGET).position_m)
        took_s += time.perf_counter() - begin_s
    return np.array(positions_m), 1e3 * took_s / len(paths)


def main(record=None):
    subprocess.run(["cargo", "build", "--quiet", "--release", "--locked", "--package", "pardalis-cli"], cwd=ROOT, check=True)
    paths = sorted(IMAGES.glob("*.jpg"))
    # The same image as an array of OpenCV, blue first, that is turned around.
    turned = lambda image: np.ascontiguousarray(image[..., ::-1])[..., ::-1]
    ways = {"python": lambda: of_python(paths, lambda image: image), "python, image[..., ::-1]": lambda: of_python(paths, turned)}
    times_ms = {name: [] for name in ("program", *ways)}
    with tempfile.TemporaryDirectory() as folder:
        # In turn, because other programs may be busy meanwhile.
        for _ in range(REPEATS):
            wanted_m, took_ms = of_program(folder)
            times_ms["program"].append(took_ms)
            for name, track in ways.items():
                positions_m, took_ms = track()
                if not np.array_equal(positions_m, wanted_m, equal_nan=True):
                    sys.exit(f"{name}: positions differ from those of the program")
                times_ms[name].append(took_ms)
    middle_ms = {name: statistics.median(times) for name, times in times_ms.items()}
    measured = [
        {"run": name, "frame_ms": round(middle_ms[name], 3), "least_ms": round(min(times), 3), "times_program": round(middle_ms[name] / middle_ms["program"], 3)}
        for name, times in times_ms.items()
    ]
    print(*measured, sep="\n")
    if record:
        records.write(record, "python", measured, "python experiments/python/measure.py", f"numpy {np.__version__}")


if __name__ == "__main__":
    main(*sys.argv[1:])
