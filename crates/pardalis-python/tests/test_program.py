"""The program by way of the package: files, dictionaries, errors and warnings."""

import os
import shutil
import signal
import subprocess
import sys
import time

import numpy as np
import pandas
import polars
import pytest
from pictures import DATA

import pardalis

SCENE = {
    "cameras": {
        "cam1": {
            "images": DATA / "dioptric-jump" / "frames",
            "fps": 25,
            "world_from_camera": np.array([[0, -1, 0, 0], [-1, 0, 0, 0], [0, 0, -1, 0.9], [0, 0, 0, 1]]),
            "model": {
                "equidistant": {
                    "f_px_per_rad": 145.5622506548578,
                    "center_px": (319.5, 239.5),
                    "field_of_view_deg": 185.0,
                }
            },
        }
    },
    "targets": {
        "ball": {
            "shape": {"sphere": {"radius_m": np.float64(0.11)}},
            "colors": DATA / "colors" / "orange-ball.hsi.colors.toml",
        }
    },
}

WORLD = {
    "duration_s": 0.4,
    "training_stills": 1,
    "timing": {"fps": 25},
    "cameras": {
        "cam1": {
            "size_px": [160, 120],
            "look_from_m": [0, -2, 1],
            "look_at_m": [0, 0, 0.3],
            "model": {"pinhole": {"f_px": [160, 160], "center_px": [79.5, 59.5]}},
        }
    },
    "objects": {
        "ball": {
            "target": True,
            "shape": {"sphere": {"radius_m": 0.1}},
            "color_srgb": [225, 70, 130],
            "path": {"line": {"position_m": [0, 0, 0.3], "velocity_mps": [0.3, 0, 0]}},
        }
    },
}


def command(*arguments):
    return [sys.executable, "-m", "pardalis", *map(str, arguments)]


def test_a_file_is_tracked_with_the_bytes_of_the_program(tmp_path):
    scene = DATA / "dioptric-jump" / "scene.toml"
    tracks = pardalis.track(scene, tmp_path / "python", frames=12, plots=False)
    options = ["-o", tmp_path / "program", "--frames", 12, "--no-plots"]
    subprocess.run(command("track", scene, *options), check=True, capture_output=True)
    files = [(tmp_path / folder / "tracks.csv").read_bytes() for folder in ("python", "program")]
    assert files[0] == files[1]
    assert len(tracks) == 12 and tracks.targets == ["ball"]
    assert tracks.columns["frame"].tolist() == list(range(12))
    assert set(tracks.columns["state"]) == {"tracking"}
    # Of the truth's first position.
    np.testing.assert_allclose(tracks.positions_m("ball")[0], [1.3, -1.2, 0.62], atol=0.15)
    assert tracks.summary["targets"].keys() == {"ball"}


def test_a_dictionary_is_a_scene(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    of_table = pardalis.track(SCENE, "results", frames=5, seed=3, plots=False)
    of_file = pardalis.track(DATA / "dioptric-jump" / "scene.toml", "other", frames=5, seed=3, plots=False)
    np.testing.assert_array_equal(of_table.positions_m("ball"), of_file.positions_m("ball"))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["other", "results"]


def test_plots_are_shown_by_notebooks(tmp_path):
    tracks = pardalis.track(SCENE, tmp_path / "results", frames=3)
    assert {"above", "side", "coordinates"} <= set(tracks.plots)
    assert tracks.plots["above"]._repr_svg_().lstrip().startswith("<svg")
    assert not pardalis.track(SCENE, tmp_path / "none", frames=3, plots=False).plots


def test_rows_are_tables(tmp_path):
    tracks = pardalis.track(SCENE, tmp_path / "results", frames=3, plots=False)
    frame = pandas.DataFrame(tracks.columns)
    assert frame.shape == (3, len(tracks.columns)) and frame.heading_rad.isna().all()
    frame = polars.DataFrame(tracks.of("ball"))
    assert frame["frame"].to_list() == [0, 1, 2] and frame["x_m"].dtype == polars.Float64
    again = pardalis.read_tracks(tmp_path / "results")
    np.testing.assert_array_equal(again.columns["x_m"], tracks.columns["x_m"])
    with pytest.raises(ValueError, match='no row is of "cup"; allowed: ball'):
        tracks.of("cup")


def test_a_world_is_rendered_tracked_and_evaluated(tmp_path):
    folder = pardalis.simulate(WORLD, tmp_path / "world", seed=4)
    tracks = pardalis.track(folder / "scene.toml", tmp_path / "results", plots=False)
    figures = pardalis.evaluate(tracks, folder)
    (ball,) = figures["targets"]
    assert ball["object"] == "ball" and ball["rows"] == 10
    assert ball["all"]["errors"]["position_m"]["rmse"] < 0.1
    with pytest.raises(ValueError, match="--force"):
        pardalis.simulate(WORLD, folder)


def test_errors_are_those_of_the_program(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ValueError, match="^missing.toml: cannot be read: there is no such file"):
        pardalis.track("missing.toml", "results")
    with pytest.raises(ValueError, match="targets.ball.shape.sphere.radius_m"):
        ball = {**SCENE["targets"]["ball"], "shape": {"sphere": {"radius_m": -1.0}}}
        pardalis.track({**SCENE, "targets": {"ball": ball}}, "results")
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(TypeError, match=r"targets.ball.colors is <object object.*; allowed: texts, numbers"):
        pardalis.track({"targets": {"ball": {"colors": object()}}}, "results")
    with pytest.raises(ValueError, match="unrecognized subcommand 'trak'"):
        pardalis.run("trak")
    with pytest.raises(ValueError, match="no_such.csv"):
        pardalis.evaluate("no_such.csv", "truth.csv")
    assert pardalis.run("--version").startswith("pardalis ")


def test_warnings_are_those_of_the_program(tmp_path):
    (tmp_path / "other").mkdir()
    for image in sorted((DATA / "dioptric-jump" / "frames").iterdir())[:2]:
        shutil.copy(image, tmp_path / "other")
    camera = SCENE["cameras"]["cam1"]
    cameras = {"cam1": {**camera, "frame_limit": 2}, "cam2": {**camera, "images": tmp_path / "other"}}
    with pytest.warns(UserWarning, match="^[^\n]*cameras.cam2[^\n]*$"):
        pardalis.track({**SCENE, "cameras": cameras}, tmp_path / "results", frames=2, plots=False)


def test_an_interrupt_ends_the_program(tmp_path):
    scene = DATA / "dioptric-jump" / "scene.toml"
    code = f"import pardalis; pardalis.track({str(scene)!r}, {str(tmp_path / 'results')!r}, annotate=True)"
    with subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.PIPE, start_new_session=True) as process:
        while not (tmp_path / "results" / "tracks.csv").exists():
            time.sleep(0.01)
        # Of the interpreter alone, as a notebook does.
        os.kill(process.pid, signal.SIGINT)
        _, messages = process.communicate(timeout=60)
    assert b"KeyboardInterrupt" in messages
    rows = (tmp_path / "results" / "tracks.csv").read_text().splitlines()
    assert 1 <= len(rows) <= 111 and (tmp_path / "results" / "summary.json").exists()
