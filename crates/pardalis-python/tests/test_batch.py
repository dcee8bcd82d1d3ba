"""Batches: the same bytes on every engine, nothing repeated, failures reported and tried again."""

import concurrent.futures
import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import types
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import distributed
import numpy as np
import pandas
import polars
import pytest
import ray
from PIL import Image
from pictures import DATA
from ray.cluster_utils import Cluster
from test_program import WORLD

import pardalis
import pardalis.batch

SEEDS = range(1, 4)


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    """A simulated recording of 10 small images, with truth."""
    return pardalis.simulate(WORLD, tmp_path_factory.mktemp("simulated") / "world")


@pytest.fixture
def scene(world, tmp_path):
    """A scene of the test's own."""
    shutil.copytree(world, tmp_path / "world")
    return tmp_path / "world" / "scene.toml"


@pytest.fixture
def calls(monkeypatch):
    """The commands that are run, one after the other."""
    calls = []
    call = pardalis.batch.call

    def counted(*arguments, **options):
        calls.append(arguments[0])
        return call(*arguments, **options)

    monkeypatch.setattr(pardalis.batch, "call", counted)
    return calls


def files(folder):
    """The bytes of all files in a folder, by their names."""
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def items(folder):
    return pandas.read_parquet(folder / "items.parquet").set_index(["scene", "recording", "seed"])


def wait_for(folder, count, pattern="*.parquet"):
    """Wait until a batch has written as many files."""
    while len(list(folder.glob(pattern))) < count:
        time.sleep(0.01)


def wait_for_rows(folder, count):
    """Wait until an item has written more rows than those that are tracked for `count` frames."""
    rows = 0
    while rows <= count + 1:
        time.sleep(0.01)
        with contextlib.suppress(OSError):
            # An item that ends removes its folder.
            rows = max((file.read_bytes().count(b"\n") for file in folder.glob("*/tracks.csv")), default=0)


def bad(scene):
    """The path of a scene that cannot be tracked."""
    path = scene.with_name("bad.toml")
    path.write_text(scene.read_text().replace("shape.sphere.radius_m = 0.1", "shape.sphere.radius_m = -1"))
    return path


def slow(scene):
    """The path of a scene that outlasts any test: a thousand images, with as many particles as take half a second each."""
    frames = scene.with_name("slow")
    frames.mkdir()
    for frame in range(1000):
        os.link(scene.with_name("frames") / "000000.png", frames / f"{frame:06}.png")
    text = scene.read_text().replace('images = "frames"', 'images = "slow"\nfps = 25', 1)
    path = scene.with_name("slow.toml")
    path.write_text(text.replace("[targets.ball]", "[targets.ball]\nfilter.particles = 1000000", 1))
    return path


def test_results_are_those_of_track(scene, tmp_path):
    batch = pardalis.batch.run({"ring": scene}, tmp_path / "out", seeds=SEEDS, frames=4)
    assert (batch.folder, batch.items, batch.tracked, batch.failures) == (tmp_path / "out", 3, 3, {})
    assert sorted(files(tmp_path / "out")) == ["items.parquet", *(f"tracks/ring.own.{seed}.parquet" for seed in SEEDS)]
    rows = pandas.read_parquet(tmp_path / "out" / "tracks")
    assert len(rows) == 12 and set(rows.scene) == {"ring"} and set(rows.recording) == {"own"}
    assert rows.dtypes[["seed", "frame", "x_m"]].astype(str).tolist() == ["int64", "int64", "float64"]
    tracks = pardalis.track(scene, tmp_path / "tracks", seed=2, frames=4, plots=False)
    of_seed = rows[rows.seed == 2]
    assert list(rows.columns) == ["scene", "recording", "seed", *tracks.columns]
    for name, values in tracks.columns.items():
        np.testing.assert_array_equal(of_seed[name].to_numpy(), values)
    assert polars.read_parquet(tmp_path / "out" / "tracks").shape == rows.shape
    ball = items(tmp_path / "out").loc[("ring", "own", 2)]
    assert (ball.status, ball.target, ball.rows, ball.tracking) == ("done", "ball", 4, 4)
    assert ball.error is None and np.isnan(ball.position_rmse_m)


def test_recordings_and_truths(scene, tmp_path, monkeypatch):
    folder = scene.parent
    shutil.copytree(folder / "frames", folder / "first")
    for image in sorted((folder / "first").glob("*.png"))[5:]:
        image.unlink()
    monkeypatch.chdir(folder)
    cameras = {"cam1": {"images": "frames", "calibration": Path("cameras.toml")}}
    targets = {"ball": {"shape": {"sphere": {"radius_m": 0.1}}, "colors": "ball.colors.toml"}}
    table = {"seed": 7, "cameras": cameras, "targets": targets}
    batch = pardalis.batch.run(
        {"plain": "scene.toml", "table": table},
        "out",
        recordings={"first": {"cam1": "first"}, "half": {"cam1": {"frame_step": 2}}, "gone": {"cam1": "gone.mp4"}},
        truths={"first": ".", "half": "truth.csv"},
        evaluate_options=["--to=0.1"],
    )
    table = items(folder / "out")
    names = ("first", "half", "gone")
    assert list(table.index) == [(*scene, name, *seed) for scene, seed in ((["plain"], [1]), (["table"], [7])) for name in names]
    assert table.rows.fillna(0).tolist() == [5, 5, 0] * 2
    for name, options in (("first", {"frames": 5}), ("half", {})):
        rows = pandas.read_parquet(folder / "out" / "tracks" / f"plain.{name}.1.parquet")
        times_s = [0.0, 0.04, 0.08, 0.12, 0.16] if name == "first" else [0.0, 0.08, 0.16, 0.24, 0.32]
        np.testing.assert_allclose(rows.time_s, times_s)
    figures = pardalis.evaluate(pardalis.track(scene, "own", frames=5, plots=False), "truth.csv", "--to=0.1")
    errors_m = figures["targets"][0]["all"]["errors"]["position_m"]
    ball = table.loc[("plain", "first", 1)]
    assert [ball.position_rmse_m, ball.position_median_m, ball.position_max_m] == [
        errors_m["rmse"],
        errors_m["median"],
        errors_m["max"],
    ]
    assert list(batch.failures) == ["plain.gone.1", "table.gone.7"]
    assert "gone.mp4" in batch.failures["plain.gone.1"]


def test_circles_in_place_of_positions(scene, tmp_path):
    truth = pandas.read_csv(scene.with_name("truth.csv"))
    circles = truth[["frame", "object", "u_px", "v_px"]].assign(radius_px=8.0)
    # In the last frame the label is on something else, and the one before was not judged.
    circles.loc[circles.index[-1], "u_px"] += 30
    circles.drop(circles.index[-2]).to_csv(tmp_path / "circles.csv", index=False)
    pardalis.batch.run(scene, tmp_path / "out", truths={"scene": tmp_path / "circles.csv"})
    [ball] = items(tmp_path / "out").itertuples()
    judged = len(circles) - 1
    assert (ball.status, ball.on_object_share, ball.elsewhere_share) == ("done", (judged - 1) / judged, 1 / judged)
    assert np.isnan(ball.coverage) and np.isnan(ball.position_rmse_m)


def test_platforms_move_as_in_the_recording(scene, tmp_path):
    # Without a start, which would be in the world. The camera's own pose is that on the platform.
    text = scene.read_text().split("motion.")[0].replace("[cameras.cam1]", '[cameras.cam1]\nplatform = "robot"')
    scene.write_text(text + "[platforms.robot]\n")
    rows = [f"{time_s},{{x_m}},0,0,0,0,0,1" for time_s in (0, 1)]
    for name, x_m in (("still", 0), ("moved", 3)):
        poses = "\n".join(["time_s,x_m,y_m,z_m,qx,qy,qz,qw", *rows]).format(x_m=x_m)
        (tmp_path / f"{name}.csv").write_text(poses + "\n")

    def run(output, still, moved, **options):
        recordings = {"still": {"cam1": {}, "robot": still}, "moved": {"cam1": {}, "robot": moved}}
        return pardalis.batch.run(scene, tmp_path / output, recordings=recordings, frames=3, **options)

    assert run("out", {"poses": tmp_path / "still.csv"}, {"poses": tmp_path / "moved.csv"}).failures == {}
    rows = pandas.read_parquet(tmp_path / "out" / "tracks")
    x_m = {name: rows[rows.recording == name].x_m.to_numpy() for name in ("still", "moved")}
    assert np.isfinite(x_m["still"]).all()
    np.testing.assert_allclose(x_m["moved"] - x_m["still"], 3, atol=0.01)
    # The name of a file alone takes the place of the scene's.
    scene.write_text(scene.read_text() + 'poses = "nowhere.csv"\n')
    assert run("names", tmp_path / "still.csv", tmp_path / "moved.csv").failures == {}
    for name in ("still", "moved"):
        assert pandas.read_parquet(tmp_path / "names" / "tracks" / f"scene.{name}.1.parquet").x_m.tolist() == x_m[name].tolist()
    # Its contents count, not its time.
    os.utime(tmp_path / "moved.csv", ns=(0, 0))
    assert run("names", tmp_path / "still.csv", tmp_path / "moved.csv").tracked == 0
    (tmp_path / "moved.csv").write_text((tmp_path / "still.csv").read_text())
    assert run("names", tmp_path / "still.csv", tmp_path / "moved.csv").tracked == 1

    def error(recording):
        with pytest.raises(ValueError) as raised:
            pardalis.batch.run(scene, tmp_path / "none", recordings={"a": recording})
        return str(raised.value)

    assert error({"cam1": {}}) == 'recordings: "a" has nothing of the platforms robot of scene "scene"; give {} to leave them'
    assert error({"cam1": {}, "rover": "a.csv"}).endswith('target "rover", and scene "scene" has only cam1, robot, ball')
    scene.write_text(scene.read_text().replace('poses = "nowhere.csv"\n', ""))
    assert error({"cam1": {}, "robot": "a.csv"}).endswith('the platform "robot"; give {"odometry": ...} or {"poses": ...}')
    scene.write_text(scene.read_text().replace("robot", "cam1"))
    assert error({"cam1": {}}) == 'recordings: "cam1" is a camera and a platform of scene "scene"; rename one of them there'


def test_targets_are_measured_as_in_the_recording(scene, tmp_path):
    # Searched for, without a start.
    scene.write_text(scene.read_text().split("motion.")[0] + 'measurements = "nowhere.csv"\n')
    # In the world, far beside the ball: rejected, and said so.
    (tmp_path / "far.csv").write_text("time_s,x_m,y_m,z_m,sigma_m\n0.04,50,0,0,0.01\n")
    (tmp_path / "near.csv").write_text("time_s,x_m,y_m,z_m,sigma_m\n0.04,0,0,0.3,1\n")

    def run(**measured):
        recordings = {name: {"cam1": {}, "ball": file} for name, file in measured.items()}
        return pardalis.batch.run(scene, tmp_path / "out", recordings=recordings, frames=3)

    batch = run(near=tmp_path / "near.csv", far={"measurements": tmp_path / "far.csv"})
    assert batch.failures == {}
    warnings = items(tmp_path / "out").warnings
    assert ["measurement" in str(warnings[("scene", name, 1)]) for name in ("near", "far")] == [False, True]
    # Its contents count, not its time.
    os.utime(tmp_path / "near.csv", ns=(0, 0))
    assert run(near=tmp_path / "near.csv", far=tmp_path / "far.csv").tracked == 0
    (tmp_path / "near.csv").write_text((tmp_path / "far.csv").read_text())
    assert run(near=tmp_path / "near.csv", far=tmp_path / "far.csv").tracked == 1
    with pytest.raises(ValueError, match='recordings: "a" has nothing of the targets ball of scene "scene"; give {} to leave them'):
        pardalis.batch.run(scene, tmp_path / "no", recordings={"a": {"cam1": {}}})


def test_crowds_and_warnings(scene, tmp_path):
    folder = scene.parent
    cameras = {"cam1": {"images": folder / "frames", "calibration": folder / "cameras.toml"}}
    ball = {"count": "any", "shape": {"sphere": {"radius_m": 0.1}}, "colors": folder / "ball.colors.toml"}
    table = {"guessed": ["targets.ball.shape.sphere.radius_m"], "cameras": cameras, "targets": {"ball": ball}}
    pardalis.batch.run(table, tmp_path / "out", truths={"scene": folder})
    crowd = items(tmp_path / "out").loc[("scene", "own", 1)]
    with pytest.warns(UserWarning) as warned:
        figures = pardalis.evaluate(pardalis.track(table, tmp_path / "tracks", plots=False), folder)
    assert (crowd.target, crowd.gospa_m, crowd.switches) == ("ball", figures["crowds"][0]["gospa_m"], 0)
    assert np.isnan(crowd.position_rmse_m)
    # The program names the file of the scene and its lines, which exist only while an item is tracked.
    (warning,) = crowd.warnings.splitlines()
    words = "guessed: positions are only as right as these guesses: radius_m"
    assert warning.startswith(f'scene "scene": {words}. ') and words in str(warned[0].message)


def test_arguments_that_cannot_be_used_are_named(scene, tmp_path, monkeypatch):
    out = tmp_path / "out"

    def error(scenes=scene, **options):
        with pytest.raises(ValueError) as raised:
            pardalis.batch.run(scenes, out, **options)
        return str(raised.value)

    assert error({"a.b": scene}) == '"a.b" is the name of a scene or recording; allowed: 1 to 64 of A-Z a-z 0-9 _ -'
    assert "no.toml" in error({"a": tmp_path / "no.toml"})
    assert error(recordings={"a": {"left": "a.mp4"}}).endswith('"left", and scene "scene" has only cam1, ball')
    assert "rtsp://camera" in error(recordings={"a": {"cam1": "rtsp://camera"}})
    assert error(recordings={"a": {"cam1": {"video": os.devnull}}}).startswith(f'video = "{os.devnull}" is a device')
    assert error(truths={"a": scene}) == 'truths: there is no "a"; allowed: scene'
    assert "truth.csv" in error(truths={"scene": tmp_path})
    assert error(engine="rai") == "engine is 'rai'; allowed: \"local\", \"ray\", \"dask\" or a client of Dask"
    assert error(workers=0) == "workers is 0; allowed: a whole number, 1 or more"
    assert error(frames=0) == "frames is 0; allowed: a whole number, 1 or more"
    assert error(frames=2.5) == "frames is 2.5; allowed: a whole number, 1 or more"
    assert error(evaluate_options="--interpolate") == 'evaluate_options is a text; allowed: a list, ["--interpolate"]'
    assert error(truths="ring") == "truths is 'ring'; allowed: a dictionary by the names of recordings"
    assert error(recordings={"a": "a.mp4"}) == "recordings: \"a\" is 'a.mp4'; allowed: a dictionary by the names of cameras, platforms and targets"
    camera = {"images": "frames", "calibration": "cameras.toml", "detections": "boxes.csv"}
    two = {"cameras": {"cam1": camera, "cam2": camera}, "targets": {}}
    assert error(two, recordings={"a": {"cam1": {"video": "a.mp4", "detections": "a.csv"}}}).startswith(
        'recordings: "a" has nothing of the cameras cam2 of scene "scene"'
    )
    assert error(two, recordings={"a": {"cam1": "a.mp4", "cam2": {}}}).startswith(
        'recordings: "a" has no detections of the camera "cam1"'
    )
    assert error(seeds=[1, -1]) == "a seed is -1; allowed: 0 to 4294967295"
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(ImportError, match='needs the package ray: pip install "ray"'):
        pardalis.batch.run(scene, out, engine="ray")
    assert not out.exists()


def test_files_of_other_items_are_refused(scene, tmp_path):
    pardalis.batch.run(scene, tmp_path / "out", seeds=SEEDS, frames=2)
    before = files(tmp_path / "out")
    with pytest.raises(ValueError, match=r"has 1 files of items that are not in this batch, such as scene.own.3.parquet"):
        pardalis.batch.run(scene, tmp_path / "out", seeds=[1, 2], frames=2)
    assert files(tmp_path / "out") == before


def test_keys_of_files_are_those_of_scenes():
    def texts(schema):
        for name, value in schema.get("properties", {}).items():
            if value.get("type") == "string" and "enum" not in value:
                yield name
            yield from texts(value)
        for value in (*schema.get("patternProperties", {}).values(), *schema.get("anyOf", ()), *schema.get("oneOf", ())):
            yield from texts(value)

    found = set(texts(json.loads((DATA.parent / "docs" / "reference" / "scene.schema.json").read_text())))
    known = {*pardalis._items.RECORDED, *pardalis._items.CONTENTS}
    # A new key that holds text is a file's name, and belongs into pardalis/_items.py, or it is listed here.
    assert found - known == {"calibration_camera", "camera", "class", "pixel_format", "platform", "target", "topic"}
    assert known <= found


def test_progress_is_printed(scene, tmp_path, capfd):
    pardalis.batch.run(scene, tmp_path / "out", seeds=SEEDS, frames=2)
    assert capfd.readouterr().err == f"3 of 3 items done, 0 failed, 3 tracked now: {tmp_path / 'out'}\n"
    pardalis.batch.run(scene, tmp_path / "out", seeds=SEEDS, frames=3, progress=False)
    assert capfd.readouterr() == ("", "")


def test_nothing_is_tracked_twice(scene, tmp_path, calls):
    out = tmp_path / "out"
    assert pardalis.batch.run(scene, out, seeds=SEEDS, frames=2).tracked == 3
    before = {path: path.stat().st_mtime_ns for path in (out / "tracks").iterdir()}
    assert pardalis.batch.run(scene, out, seeds=SEEDS, frames=2, workers=1, threads=2).tracked == 0
    assert calls == ["track"] * 3
    # More seeds are added to those.
    assert pardalis.batch.run(scene, out, seeds=range(1, 5), frames=2).tracked == 1
    assert {path: path.stat().st_mtime_ns for path in before} == before
    # Of a folder that was moved, too.
    moved = shutil.move(scene.parent, tmp_path / "moved")
    assert pardalis.batch.run(Path(moved, "scene.toml"), out, seeds=range(1, 5), frames=2).tracked == 0
    assert len(calls) == 4


def test_changed_input_is_tracked_again(scene, tmp_path):
    scenes = {"a": scene, "b": scene.with_name("b.toml")}
    shutil.copy(scene, scenes["b"])

    def tracked(**options):
        return pardalis.batch.run(scenes, tmp_path / "out", **({"frames": 2} | options)).tracked

    assert tracked() == 2
    with open(scenes["b"], "a") as file:
        file.write("\n[timing]\nmax_delay_s = 0.5\n")
    assert tracked() == 1
    with open(scene.with_name("ball.colors.toml"), "a") as file:
        file.write("# changed\n")
    assert tracked() == 2
    os.utime(next((scene.parent / "frames").glob("*.png")), ns=(0, 0))
    assert tracked() == 2
    assert tracked(frames=3) == 2
    assert tracked(frames=3, smooth=True) == 2
    assert tracked(frames=3, smooth=True, truths={"a": scene.parent}) == 1
    assert tracked(frames=3, smooth=True, truths={"a": scene.parent}) == 0


def test_a_file_without_its_end_is_written_again(scene, tmp_path):
    out = tmp_path / "out"
    pardalis.batch.run(scene, out, seeds=SEEDS, frames=2)
    before = files(out)
    path = out / "tracks" / "scene.own.2.parquet"
    path.write_bytes(path.read_bytes()[:-100])
    assert pardalis.batch.run(scene, out, seeds=SEEDS, frames=2).tracked == 1
    assert files(out) == before


def test_invalid_input_fails_once_and_the_others_are_tracked(scene, tmp_path, calls):
    out = tmp_path / "out"
    scenes = {"bad": bad(scene), "good": scene}
    batch = pardalis.batch.run(scenes, out, seeds=[1, 2], frames=2)
    assert calls == ["track"] * 4 and batch.tracked == 2
    error = 'scene "bad": a problem in the scene:\n  targets.ball.shape.sphere.radius_m: is -1; allowed: above 0 and at most 1000'
    assert batch.failures == {"bad.own.1": error, "bad.own.2": error}
    table = items(out)
    assert table.status.tolist() == ["failed", "failed", "done", "done"]
    assert table.error.tolist() == [error, error, None, None]
    # The next run tries it again.
    scenes["bad"].write_text(scene.read_text())
    batch = pardalis.batch.run(scenes, out, seeds=[1, 2], frames=2)
    assert (batch.tracked, batch.failures, len(calls)) == (2, {}, 6)
    # What has become invalid leaves no earlier result.
    bad(scene)
    assert len(pardalis.batch.run(scenes, out, seeds=[1, 2], frames=2).failures) == 2
    assert sorted(path.name for path in (out / "tracks").iterdir()) == ["good.own.1.parquet", "good.own.2.parquet"]
    # It is not lost, and comes back with its input.
    assert sorted(path.name for path in (out / "replaced").iterdir()) == ["bad.own.1.parquet", "bad.own.2.parquet"]
    scenes["bad"].write_text(scene.read_text())
    batch = pardalis.batch.run(scenes, out, seeds=[1, 2], frames=2)
    assert (batch.tracked, batch.failures) == (0, {}) and len(list((out / "tracks").iterdir())) == 4
    assert not (out / "replaced").exists()


def test_tracks_are_kept_if_they_cannot_be_evaluated(scene, tmp_path, calls):
    out = tmp_path / "out"
    truth = scene.with_name("truth.csv")
    right = truth.read_text()
    truth.write_text("frame,time_s\n")
    options = {"frames": 3, "truths": {"scene": truth}}
    batch = pardalis.batch.run(scene, out, **options)
    # Invalid input is not tried again.
    assert calls == ["track", "evaluate"] and batch.tracked == 0
    [error] = batch.failures.values()
    assert error.startswith("evaluation: ") and "truth.csv" in error
    rows = pandas.read_parquet(out / "tracks")
    tracks = pardalis.track(scene, tmp_path / "tracks", frames=3, plots=False)
    np.testing.assert_array_equal(rows.x_m.to_numpy(), tracks.columns["x_m"])
    ball = items(out).loc[("scene", "own", 1)]
    assert (ball.status, ball.error, ball.rows, ball.tracking) == ("failed", error, 3, 3)
    assert np.isnan(ball.position_rmse_m)
    # The next run tries it again, and has the tracks meanwhile.
    before = files(out)
    assert pardalis.batch.run(scene, out, **options).failures == batch.failures
    assert files(out) == before and calls == ["track", "evaluate"] * 2
    truth.write_text(right)
    batch = pardalis.batch.run(scene, out, **options)
    assert (batch.tracked, batch.failures) == (1, {})
    ball = items(out).loc[("scene", "own", 1)]
    assert ball.status == "done" and ball.error is None and ball.position_rmse_m < 0.1
    assert not (out / "replaced").exists()


def test_what_was_not_tracked_is_no_miss(scene, tmp_path):
    pardalis.batch.run(scene, tmp_path / "out", frames=3, truths={"scene": scene.parent})
    ball = items(tmp_path / "out").loc[("scene", "own", 1)]
    assert (ball.rows, ball.coverage, ball.lost_frames) == (3, 1, 0)


def test_a_crowd_that_is_never_there_is_no_failure(scene, tmp_path):
    folder = scene.parent
    size = Image.open(next((folder / "frames").glob("*.png"))).size
    (tmp_path / "dark").mkdir()
    Image.new("RGB", size).save(tmp_path / "dark" / "0.png")
    cameras = {"cam1": {"images": tmp_path / "dark", "fps": 25, "calibration": folder / "cameras.toml"}}
    ball = {"count": "any", "shape": {"sphere": {"radius_m": 0.1}}, "colors": folder / "ball.colors.toml"}
    table = {"cameras": cameras, "targets": {"ball": ball}}
    batch = pardalis.batch.run(table, tmp_path / "out", truths={"scene": folder})
    assert batch.failures == {}
    crowd = items(tmp_path / "out").loc[("scene", "own", 1)]
    assert crowd.status == "done" and np.isnan(crowd.gospa_m)


def test_a_process_that_is_killed_is_tried_again(scene, tmp_path, monkeypatch):
    call = pardalis.batch.call
    kills = [True] * 3

    def killed(*arguments, watch, stop):
        if kills:
            kills.pop()
            watch = subprocess.Popen.kill
        return call(*arguments, watch=watch, stop=stop)

    monkeypatch.setattr(pardalis.batch, "call", killed)
    batch = pardalis.batch.run(scene, tmp_path / "out", frames=2, retries=2)
    assert list(batch.failures.values()) == ["pardalis track ended with code -9"]
    kills += [True] * 2
    batch = pardalis.batch.run(scene, tmp_path / "out", frames=2, retries=2)
    assert (batch.tracked, batch.failures, kills) == (1, {}, [])


def test_an_interrupt_keeps_what_is_finished(scene, tmp_path):
    out = tmp_path / "out"
    scenes = {"quick": str(scene), "slow": str(slow(scene))}
    code = f"import pardalis.batch\npardalis.batch.run({scenes!r}, {str(out)!r}, seeds=range(4), workers=2)"
    with subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE, start_new_session=True) as process:
        wait_for(out / "tracks", 4)
        # Of the interpreter alone, as a notebook does.
        os.kill(process.pid, signal.SIGINT)
        _, messages = process.communicate(timeout=60)
        # Nothing of its session is left.
        with pytest.raises(ProcessLookupError):
            os.killpg(process.pid, 0)
    assert b"KeyboardInterrupt" in messages and b"4 of 8 items done, 0 failed, 4 tracked now" in messages
    assert items(out).status.tolist() == ["done"] * 4 + ["open"] * 4
    assert sorted(path.name for path in out.iterdir()) == ["items.parquet", "tracks"]
    assert pardalis.batch.run({"quick": scene}, out, seeds=range(5)).tracked == 1


def test_termination_keeps_what_is_finished(scene, tmp_path):
    out = tmp_path / "out"
    scenes = {"quick": str(scene), "slow": str(slow(scene))}
    code = f"import pardalis.batch\npardalis.batch.run({scenes!r}, {str(out)!r}, seeds=range(2), workers=2)"
    with subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE, start_new_session=True) as process:
        wait_for(out / "tracks", 2)
        process.terminate()
        _, messages = process.communicate(timeout=60)
        # Nothing of its session is left.
        with pytest.raises(ProcessLookupError):
            os.killpg(process.pid, 0)
    assert process.returncode == 128 + signal.SIGTERM
    assert messages.decode().endswith(f"2 of 4 items done, 0 failed, 2 tracked now: {out}\n")
    assert items(out).status.tolist() == ["done"] * 2 + ["open"] * 2
    assert sorted(path.name for path in out.iterdir()) == ["items.parquet", "tracks"]
    # Afterwards it is as before.
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    pardalis.batch.run(scene, tmp_path / "quick", frames=2)
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


def test_an_interrupt_between_any_two_instructions_stops_the_items():
    """Python looks for signals between instructions: here one of them after the other is interrupted."""
    names = {"_outcomes", "_ended"}

    def interrupted(at):
        """Interrupt instruction `at` since an item has begun; report whether items run, whether they were stopped, and whether it was reached."""
        begun, stopped, count = [], [], -1

        def submit(item):
            # The first one ends at once, the others never do.
            future = concurrent.futures.Future()
            if not begun:
                future.set_result(pardalis.batch._Outcome({}))
            begun.append(future)
            return future

        def trace(frame, event, _):
            nonlocal count
            if frame.f_code.co_name not in names:
                return None
            frame.f_trace_opcodes = True
            if event == "opcode" and len(begun) > 1:
                count += 1
                if count == at:
                    raise KeyboardInterrupt
            return trace

        items = [types.SimpleNamespace(name=str(number)) for number in range(3)]
        before = sys.gettrace()
        try:
            sys.settrace(trace)
            with contextlib.closing(pardalis.batch._outcomes(items, submit, stopped.append, 2, 0)) as outcomes:
                for _ in outcomes:
                    pass
        except KeyboardInterrupt:
            pass
        finally:
            sys.settrace(before)
        return bool(stopped), count

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pardalis.batch, "_STOP_S", 0)
        patch.setattr(pardalis.batch, "_WAKE_S", 0)
        for at in range(200):
            assert interrupted(at) == (True, at), at


def test_two_batches_at_once_need_two_folders(scene, tmp_path):
    out = tmp_path / "out"
    code = f"import pardalis.batch\npardalis.batch.run({str(slow(scene))!r}, {str(out)!r})"
    (tmp_path / "work").mkdir()
    own = {"env": {**os.environ, "TMPDIR": str(tmp_path / "work")}, "start_new_session": True}
    with subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.DEVNULL, **own) as process:
        try:
            wait_for(tmp_path / "work", 1, "*/tracks.csv")
            with pytest.raises(RuntimeError, match=f"another batch is writing into {out}; wait until it has ended"):
                pardalis.batch.run(scene, out, frames=2)
            assert pardalis.batch.run(scene, tmp_path / "other", frames=2).tracked == 1
        finally:
            # However it ends, the next one may begin.
            os.killpg(process.pid, signal.SIGKILL)
    assert (out / ".lock").exists()
    assert pardalis.batch.run(scene, out, frames=2).tracked == 1
    assert sorted(path.name for path in out.iterdir()) == ["items.parquet", "tracks"]


def test_workers_of_another_version_are_refused(scene, tmp_path):
    def pretend(version):
        import pardalis.batch

        pardalis.batch.__version__ = version

    with (
        distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        client.run(pretend, "0.0.1")
        batch = pardalis.batch.run(scene, tmp_path / "out", frames=2, engine=client)
        [error] = batch.failures.values()
        versions = f"has Pardalis 0.0.1, and the batch was started with {pardalis.__version__}; install the same version on all computers"
        assert error.endswith(versions) and not (tmp_path / "out" / "tracks").exists()
        client.run(pretend, pardalis.__version__)
        assert pardalis.batch.run(scene, tmp_path / "out", frames=2, engine=client).tracked == 1


def test_dask_writes_the_same_bytes(scene, tmp_path):
    scenes = {"good": scene, "bad": bad(scene)}
    pardalis.batch.run(scenes, tmp_path / "local", seeds=SEEDS, frames=4, workers=1)
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
        distributed.Client(cluster) as client,
    ):
        for number, engine in enumerate((client, "dask")):
            out = tmp_path / f"dask-{number}"
            assert pardalis.batch.run(scenes, out, seeds=SEEDS, frames=4, engine=engine, workers=3).tracked == 3
            assert files(out) == files(tmp_path / "local")


def test_ray_writes_the_same_bytes_although_a_node_is_killed(scene, tmp_path, monkeypatch):
    # Of the items; Ray's own folder needs a short name.
    (tmp_path / "work").mkdir()
    monkeypatch.setenv("RAY_TMPDIR", tempfile.gettempdir())
    monkeypatch.setenv("TMPDIR", str(tmp_path / "work"))
    monkeypatch.setenv("RAY_USAGE_STATS_ENABLED", "0")
    scenes = {"good": scene, "bad": bad(scene)}
    pardalis.batch.run(scenes, tmp_path / "local", seeds=range(12), frames=4)
    memory = {"object_store_memory": 80 << 20}
    # Notices within a second that a node is gone, not within fifteen.
    check = {"health_check_period_ms": 500, "health_check_timeout_ms": 500, "health_check_failure_threshold": 2}
    head = {**memory, "num_cpus": 0, "include_dashboard": False, "_system_config": check}
    cluster = Cluster(initialize_head=True, head_node_args=head)
    try:
        node = cluster.add_node(**memory, num_cpus=1)
        ray.init(address=cluster.address, log_to_driver=False)
        out = tmp_path / "ray"
        with ThreadPoolExecutor() as thread:
            running = thread.submit(pardalis.batch.run, scenes, out, seeds=range(12), frames=4, engine="ray")
            wait_for(out / "tracks", 3)
            cluster.remove_node(node, allow_graceful=False)
            assert len(files(out / "tracks")) < 12
            cluster.add_node(**memory, num_cpus=1)
            assert running.result().tracked == 12
        assert files(out) == files(tmp_path / "local")

        # An interrupt ends the program there, too, and its folder is removed. The killed node has left one.
        for folder in (tmp_path / "work").iterdir():
            shutil.rmtree(folder)
        with pytest.raises(KeyboardInterrupt), ThreadPoolExecutor() as thread:
            # The killed node may still be at an item of four frames.
            thread.submit(lambda: (wait_for_rows(tmp_path / "work", 4), os.kill(os.getpid(), signal.SIGINT)))
            pardalis.batch.run(slow(scene), tmp_path / "slow", engine="ray")
        assert items(tmp_path / "slow").status.tolist() == ["open"]
        assert list((tmp_path / "work").iterdir()) == []
    finally:
        ray.shutdown()
        cluster.shutdown()
