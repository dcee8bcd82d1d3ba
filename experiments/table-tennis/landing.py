"""How far predicted landings are off, in the recordings that `pardalis measure experiments/table-tennis/experiment.toml` has simulated.

    python3 experiments/table-tennis/landing.py target/release/pardalis out/table-tennis [RECORD]
"""

import csv
import math
import statistics
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
import records

# The height of the ball's centre when it touches the table, metres.
LANDS_Z_M = 0.78
GRAVITY_MPS2 = 9.81
THROWN_S = 0.1
# Of a flight that has been seen for less, nothing is asked.
KNOWN_S = 0.1
AHEAD_S = (0.2, 0.1, 0.05)


def rows(path):
    with open(path) as file:
        return list(csv.DictReader(file))


def landings(truth):
    """When and where the ball touches the table: from the last instant before, after which it falls freely."""
    at = {}
    for row in truth:
        if row["object"] == "ball":
            at[float(row["time_s"])] = [float(row[key]) for key in ("x_m", "y_m", "z_m", "vx_mps", "vy_mps", "vz_mps")]
    times = sorted(at)
    found = []
    for time_s, next_s in zip(times, times[1:]):
        x, y, z, vx, vy, vz = at[time_s]
        if vz < 0 < at[next_s][5]:
            after_s = (vz + math.sqrt(vz * vz + 2 * GRAVITY_MPS2 * (z - LANDS_Z_M))) / GRAVITY_MPS2
            found.append((time_s + after_s, (x + after_s * vx, y + after_s * vy)))
    return found


def tracked(program, world):
    """Tracks a recording with the table's plane in its scene; the folder of the results."""
    scene, folder = world / "with-plane.toml", world / "with-plane"
    scene.write_text((world / "scene.toml").read_text() + f"crossing.point_m = [0, 0, {LANDS_Z_M}]\n")
    subprocess.run([program, "track", scene, "-o", folder, "--threads", "1", "--no-plots"], check=True, capture_output=True)
    return folder


def errors(predicted, truth, ahead_s):
    """The errors of the last predictions that are so long ahead, in metres, and in standard deviations; None where there is none."""
    since_s = THROWN_S
    for lands_s, (x_m, y_m) in landings(truth):
        if lands_s - since_s > KNOWN_S + ahead_s:
            early = [row for row in predicted if since_s < float(row["time_s"]) <= lands_s - ahead_s]
            if early:
                off = float(early[-1]["x_m"]) - x_m, float(early[-1]["y_m"]) - y_m
                sigma_m = math.sqrt(float(early[-1]["xx_m2"]) + float(early[-1]["yy_m2"]))
                yield math.hypot(*off), math.hypot(*off) / sigma_m
            else:
                yield None, None
        since_s = lands_s


def main(program, out, record=None):
    table = []
    for run in sorted(Path(out).glob("serve--*/")):
        worlds = sorted(run.glob("world-*/"))
        with ThreadPoolExecutor(2) as pool:
            folders = list(pool.map(lambda world: tracked(program, world), worlds))
        recordings = [(rows(folder / "crossings.csv"), rows(world / "truth.csv")) for folder, world in zip(folders, worlds)]
        for ahead_s in AHEAD_S:
            found = [one for recording in recordings for one in errors(*recording, ahead_s)]
            off_m = sorted(off_m for off_m, _ in found if off_m is not None)
            table.append({
                "run": run.name,
                "ahead_s": ahead_s,
                "landings": len(found),
                "predicted": len(off_m),
                "median_m": statistics.median(off_m),
                "p90_m": off_m[math.ceil(0.9 * len(off_m)) - 1],
                "max_m": off_m[-1],
                "beyond_3_sigma": sum(sigmas is not None and sigmas > 3 for _, sigmas in found),
            })
    for row in table:
        print(", ".join(f"{key} {value}" for key, value in row.items()))
    if record:
        records.write(record, "table-tennis-landing", table, "python3 experiments/table-tennis/landing.py target/release/pardalis out/table-tennis")


if __name__ == "__main__":
    main(*sys.argv[1:])
