"""Measures `pardalis.batch`: overhead per item, speed-up, a node of Ray that is killed, and what video costs.

    python experiments/batch/measure.py experiments/record/DATE [batch|batch-killed|batch-video ...]

Needs the Python package with its extra `ray`, and ffmpeg for the videos.
"""

import csv
import os
import platform
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pyarrow
import pyarrow.parquet
import ray
from ray.cluster_utils import Cluster

import pardalis
import pardalis.batch

ROOT = Path(__file__).resolve().parents[2]
SCENE = ROOT / "data" / "dioptric-jump" / "scene.toml"
ITEMS, FRAMES = 500, 5
# Bare commands and batches take turns, because other programs run on the same computer.
ROUNDS, ROUND_ITEMS = 4, 25
VIDEO_FRAMES = 1500


def main() -> None:
    record = Path(sys.argv[1]).resolve()
    record.mkdir(parents=True, exist_ok=True)
    tables = {"batch": engines, "batch-killed": killed, "batch-video": videos}
    for name in sys.argv[2:] or tables:
        with tempfile.TemporaryDirectory() as folder:
            os.chdir(folder)
            write(record / f"{name}.csv", tables[name]())
            os.chdir(ROOT)
        (record / f"{name}.facts.txt").write_text(facts())


def engines() -> list[dict[str, object]]:
    rows = turns("local")
    with cluster([1, 1]):
        return rows + turns("ray")


def batch(output: str, items: int, **options) -> pardalis.batch.Batch:
    """Track so many items, all of them now."""
    seeds = range(1, items + 1)
    result = pardalis.batch.run(SCENE, output, seeds=seeds, frames=FRAMES, progress=False, **options)
    assert result.items == result.tracked == items and not result.failures, result
    return result


def timed(item: pardalis.batch._Item) -> pardalis.batch._Outcome:
    """Track an item on a worker, and add the time of the program to its record."""
    call = pardalis.batch.call
    spent_s = []

    def timed_call(*arguments, **options):
        begin_s = time.monotonic()
        ended = call(*arguments, **options)
        spent_s.append(time.monotonic() - begin_s)
        return ended

    pardalis.batch.call = timed_call
    try:
        outcome = pardalis.batch._track(item)
    finally:
        pardalis.batch.call = call
    outcome.record["program_ms"] = 1e3 * sum(spent_s)
    return outcome


def beside_ms(engine: str, output: str) -> float:
    """Return how much longer an item takes than the program that it runs, with one worker."""
    commands = pardalis.batch._Commands(("--no-plots", f"--frames={FRAMES}"), (), 1)
    items = pardalis.batch._planned(SCENE, None, None, range(ROUND_ITEMS), commands, Path(output).resolve())
    with ThreadPoolExecutor(1) as pool:
        task = ray.remote(num_cpus=1)(timed)
        submit = {"local": lambda item: pool.submit(timed, item), "ray": lambda item: task.remote(item).future()}[engine]
        begin_s = time.monotonic()
        outcomes = [outcome for _, outcome in pardalis.batch._outcomes(items, submit, lambda _: None, 1, 0)]
        whole_ms = 1e3 * (time.monotonic() - begin_s)
    return (whole_ms - sum(outcome.record["program_ms"] for outcome in outcomes)) / ROUND_ITEMS


def turns(engine: str) -> list[dict[str, object]]:
    """Return what bare commands and batches with one and two workers take."""
    command = [sys.executable, "-m", "pardalis", "track", str(SCENE), f"--frames={FRAMES}", "--threads=1", "--no-plots"]
    # Workers of Ray start with the first items.
    batch(f"{engine}-start", 4, engine=engine, workers=2)
    rows = []
    for number in range(1, ROUNDS + 1):
        begin_s, load = time.monotonic(), os.getloadavg()[0]
        for seed in range(1, ROUND_ITEMS + 1):
            shutil.rmtree("bare", ignore_errors=True)
            subprocess.run([*command, f"--seed={seed}", "--output=bare"], check=True, capture_output=True)
        item_ms = [1e3 * (time.monotonic() - begin_s) / ROUND_ITEMS]
        for workers in (1, 2):
            begin_s = time.monotonic()
            batch(f"{engine}-{workers}-{number}", ROUND_ITEMS, engine=engine, workers=workers)
            item_ms.append(1e3 * (time.monotonic() - begin_s) / ROUND_ITEMS)
        bare_ms, one_ms, two_ms = item_ms
        row = {"run": engine, "seed": number, "bare_ms": f"{bare_ms:.0f}", "one_worker_ms": f"{one_ms:.0f}", "two_workers_ms": f"{two_ms:.0f}"}
        row |= {"beside_ms": f"{beside_ms(engine, f'{engine}-beside-{number}'):.1f}", "speed_up": f"{one_ms / two_ms:.2f}", "load": f"{load:.1f}"}
        rows.append(row)
        print(row, file=sys.stderr)
    return rows


def killed() -> list[dict[str, object]]:
    """Return what one process and a cluster of three nodes, of which one is killed, take, and whether they write the same."""
    begin_s = time.monotonic()
    batch("one", ITEMS, workers=1)
    one_s = time.monotonic() - begin_s
    with cluster([1, 1, 1]) as (nodes, remove):
        begin_s = time.monotonic()
        with ThreadPoolExecutor() as thread:
            running = thread.submit(batch, "three", ITEMS, engine="ray")
            while len(list(Path("three", "tracks").glob("*.parquet"))) < ITEMS // 2:
                time.sleep(0.05)
            remove(nodes[1])
            finished = len(list(Path("three", "tracks").glob("*.parquet")))
            running.result()
        three_s = time.monotonic() - begin_s
    same = sum(content == Path("three", name).read_bytes() for name, content in contents("one").items())
    begin_s = time.monotonic()
    assert pardalis.batch.run(SCENE, "three", seeds=range(1, ITEMS + 1), frames=FRAMES, progress=False).tracked == 0
    again_s = time.monotonic() - begin_s
    return [
        {"run": "one process", "items": ITEMS, "wall_s": f"{one_s:.0f}", "killed_after": "", "same_files": "", "again_ms": ""},
        {
            "run": "three nodes of Ray",
            "items": ITEMS,
            "wall_s": f"{three_s:.0f}",
            "killed_after": finished,
            "same_files": f"{same} of {len(contents('three'))}",
            "again_ms": f"{1e3 * again_s:.0f}",
        },
    ]


def contents(folder: str) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in Path(folder).rglob("*") if path.is_file()}


class cluster:
    """A local cluster of Ray: a head without cores, and nodes with so many cores each."""

    def __init__(self, cores: list[int]) -> None:
        self._cores = cores

    def __enter__(self):
        memory = {"object_store_memory": 100 << 20}
        self._cluster = Cluster(initialize_head=True, head_node_args={**memory, "num_cpus": 0, "include_dashboard": False})
        nodes = [self._cluster.add_node(**memory, num_cpus=cores) for cores in self._cores]
        ray.init(address=self._cluster.address, log_to_driver=False)
        return nodes, lambda node: self._cluster.remove_node(node, allow_graceful=False)

    def __exit__(self, *_: object) -> None:
        ray.shutdown()
        self._cluster.shutdown()


def videos() -> list[dict[str, object]]:
    """Return what a core needs for H.264 video, with one thread."""
    rows = []
    for name, scale in (("640 x 480", 1.0), ("1440 x 1080", 2.25)):
        clip = f"{name.replace(' ', '')}.mp4"
        scaled = f"scale=iw*{scale}:ih*{scale},format=yuv420p"
        images = ["-framerate", "25", "-stream_loop", "-1", "-i", str(SCENE.parent / "frames" / "%06d.jpg")]
        code = ["-frames:v", str(VIDEO_FRAMES), "-vf", scaled, "-c:v", "libx264", "-crf", "20", clip]
        subprocess.run(["ffmpeg", "-v", "error", "-y", *images, *code], check=True)
        model = {"f_px_per_rad": 145.5622506548578 * scale, "center_px": [320 * scale - 0.5, 240 * scale - 0.5], "field_of_view_deg": 185.0}
        pose = [[0, -1, 0, 0], [-1, 0, 0, 0], [0, 0, -1, 0.9], [0, 0, 0, 1]]
        camera = {"video": clip, "world_from_camera": pose, "model": {"equidistant": model}}
        colors = ROOT / "data" / "colors" / "orange-ball.hsi.colors.toml"
        scene = {"cameras": {"cam1": camera}, "targets": {"ball": {"shape": {"sphere": {"radius_m": 0.11}}, "colors": colors}}}
        before, begin_s = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
        result = pardalis.batch.run(scene, f"video-{scale}", workers=1, progress=False)
        wall_s, after = time.monotonic() - begin_s, resource.getrusage(resource.RUSAGE_CHILDREN)
        assert not result.failures, result.failures
        file = next(Path(f"video-{scale}", "tracks").iterdir())
        states = pyarrow.parquet.read_table(file, columns=["state"]).column("state").to_pylist()
        assert len(states) == VIDEO_FRAMES, len(states)
        core_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        rows.append(
            {
                "run": name,
                "core_ms_per_frame": f"{1e3 * core_s / VIDEO_FRAMES:.2f}",
                "wall_ms_per_frame": f"{1e3 * wall_s / VIDEO_FRAMES:.2f}",
                "tracked_share": f"{states.count('tracking') / len(states):.3f}",
                "result_bytes_per_row": f"{file.stat().st_size / len(states):.0f}",
                "video_bytes_per_frame": f"{os.path.getsize(clip) / VIDEO_FRAMES:.0f}",
            }
        )
        print(rows[-1], file=sys.stderr)
    return rows


def write(path: Path, rows: list[dict[str, object]]) -> None:
    with open(path, "w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, rows[0], lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def facts() -> str:
    commit = subprocess.run(["git", "-C", ROOT, "rev-parse", "HEAD"], check=True, capture_output=True, text=True).stdout.strip()
    about = {
        "command": "python experiments/batch/measure.py",
        "version": pardalis.__version__,
        "commit": commit,
        "python": f"{platform.python_version()}, pyarrow {pyarrow.__version__}, ray {ray.__version__}",
        "cpu": next(line.split(": ")[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")),
        "cores": str(os.cpu_count()),
        "load": f"{os.getloadavg()[0]:.2f} processes, the mean of the last minute",
    }
    return "".join(f"{name:<9} {value}\n" for name, value in about.items())


if __name__ == "__main__":
    main()
