"""The studio in a real browser, with the real program, bundled sequences and, as live cameras, streams of ffmpeg.

`scripts/web-test` runs it, with the fixtures of `web_fixtures.py` and `studio_fixtures.py`.
"""

import csv
import itertools
import json
import os
import re
import shutil
import socket
import subprocess
import sys
import threading
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest
from playwright.sync_api import expect
from studio_fixtures import DATA, figure, frames_of, run, truth_of, until

# Where the pictures of the guide go (see scripts/studio-pictures); nowhere in tests.
PICTURES = os.environ.get("PICTURES")


@pytest.mark.parametrize("frames", [[3, 67, 107], [20, 60, 80], [5, 55, 90]])
def test_an_empty_folder_becomes_a_scene_that_tracks(studio, tmp_path, frames):
    sequence = DATA / "dioptric-jump"
    shutil.copytree(sequence / "frames", tmp_path / "frames")
    shutil.copy(sequence / "camera.json", tmp_path / "lens.json")
    one = studio()
    page = one.page
    # Sources: the folder of images.
    page.get_by_role("button", name="Add the images in frames").click()
    expect(page.locator("[data-camera=camera] .number-of-frame")).to_have_text("0 / 109")
    # Nothing says how fast they were taken.
    expect(page.locator("#step-sources")).to_have_attribute("title", re.compile("to do"))
    expect(page.locator("#fps-camera")).to_have_value("25")
    page.fill("#fps-camera", "0")
    page.keyboard.press("Tab")
    expect(page.locator("#messages")).to_contain_text("cameras.camera.fps: ")
    expect(page.locator("#fps-camera")).to_have_value("25")
    one.errors.clear()
    page.click("#accept-fps-camera")
    expect(page.locator("#step-sources .number")).to_have_text("✓")
    assert "fps = 25.0\n" in one.ask("state")["text"]
    # Camera: a calibration, with its pose.
    one.step("camera")
    expect(page.locator("#panel .now")).to_contain_text("typical angle of view was guessed")
    page.get_by_role("button", name="lens.json").click()
    expect(page.locator("#panel .now")).to_contain_text("Calibrated: lens.json")
    # Colours: a name, and a click in three frames.
    one.step("colors")
    page.click("#add-target")
    expect(page.locator("#panel .hint")).to_contain_text("Click ball in the picture")
    truth = truth_of("dioptric-jump")
    for number, frame in enumerate(frames):
        one.show("camera", frame)
        # A few pixels beside the middle of the ball, whose radius is 5 to 10 pixels.
        pixel = [float(truth[frame]["u_px"]) + 2.5, float(truth[frame]["v_px"]) - 2]
        page.mouse.click(*one.at("camera", pixel, (640, 480)))
        expect(page.locator("#labels li")).to_have_count(number + 1)
    page.check("#marked")
    expect(page.locator("#share")).to_contain_text("% of this image")
    # A click beside it is no ball, and the page says so.
    expect(page.locator("#doubts")).to_be_hidden()
    one.show("camera", 0)
    page.mouse.click(*one.at("camera", [320, 100], (640, 480)))
    expect(page.locator("#labels li")).to_have_count(4)
    expect(page.locator("#doubts")).to_contain_text("is the outline on the object")
    expect(page.locator("#step-colors .number")).to_have_text("!")
    page.click("#undo")
    expect(page.locator("#doubts")).to_be_hidden()
    expect(page.locator("#step-colors .number")).to_have_text("✓")
    # Targets: its diameter, in centimetres.
    one.step("targets")
    page.fill("#diameter-ball", "20")
    page.keyboard.press("Tab")
    expect(page.locator("#step-targets .number")).to_have_text("✓")
    page.fill("#diameter-ball", "22")
    page.click("#set-ball")
    # To set what is set is no edit.
    expect(page.locator("#undo")).to_have_attribute("title", re.compile("radius_m 0.11 for ball"))
    page.click("#set-ball")
    page.click("#undo")
    expect(page.locator("#diameter-ball")).to_have_value("20")
    page.click("#redo")
    expect(page.locator("#diameter-ball")).to_have_value("22")
    # Track, and save.
    one.step("track")
    page.click("#start")
    expect(page.locator("#report")).to_contain_text("processed 110 frames")
    expect(page.locator("[data-target=ball] .state")).to_have_text("tracking")
    page.click("#save")
    expect(page.locator("#file")).to_have_text("scene.toml")
    # The program tracks the scene as the page did, and well.
    shown = (tmp_path / "scene-tracks/tracks.csv").read_bytes()
    run("track", "scene.toml", "-o", "again", folder=tmp_path)
    assert (tmp_path / "again/tracks.csv").read_bytes() == shown
    report = run("evaluate", "again", str(sequence), folder=tmp_path)
    assert figure(report, "with an estimate") == 110
    # The bounds of experiments/edge for the colours that come with the sequence, plus 20 %. The ball is 1.8 to 3.9 m away, and its diameter 220 mm.
    assert figure(report, "root mean square") < 90
    near = run("evaluate", "again", str(sequence), "--to", "2.02", folder=tmp_path)
    assert figure(near, "root mean square") < 48
    # The 3D view has the numbers of the rows.
    page.click("#show-viewer")
    last = list(csv.DictReader(open(tmp_path / "again/tracks.csv")))[-1]
    expect(page.locator("#viewer")).to_contain_text(f"{float(last['x_m']):.3f} m")


def test_the_keyboard_does_it_all_and_every_edit_can_be_undone(studio, tmp_path):
    shutil.copytree(DATA / "dioptric-jump/frames", tmp_path / "frames")
    shutil.copy(DATA / "dioptric-jump/camera.json", tmp_path / "camera.json")
    one = studio(".")
    page = one.page
    texts = [one.ask("state")["text"]]
    page.keyboard.press("Alt+4")
    expect(page.locator("#step-colors")).to_have_attribute("aria-current", "step")
    page.locator("[data-camera=cam1] canvas").focus()
    for key, count in [("Shift+ArrowRight", 14), ("Shift+ArrowUp", 15), ("ArrowUp", 2)]:
        for _ in range(count):
            page.keyboard.press(key)
    page.keyboard.press("Enter")
    expect(page.locator("#labels li")).to_have_count(1)
    colors = (tmp_path / "ball.colors.toml").read_text()
    # A box in the next frame, begun and ended with B.
    page.locator("#frame-cam1").focus()
    page.keyboard.press("ArrowRight")
    expect(page.locator("[data-camera=cam1] .number-of-frame")).to_have_text("1 / 109")
    page.locator("[data-camera=cam1] canvas").focus()
    for key, count in [("ArrowLeft", 20), ("ArrowUp", 18)]:
        for _ in range(count):
            page.keyboard.press(key)
    page.keyboard.press("b")
    for key, count in [("Shift+ArrowRight", 4), ("Shift+ArrowDown", 4)]:
        for _ in range(count):
            page.keyboard.press(key)
    page.keyboard.press("b")
    expect(page.locator("#labels li")).to_have_count(2)
    until(lambda: (tmp_path / "ball.colors.toml").read_text() != colors)
    page.keyboard.press("Alt+5")
    page.fill("#diameter-ball", "30")
    page.keyboard.press("Enter")
    expect(page.locator("#undo")).to_have_attribute("title", re.compile("radius_m 0.15 for ball"))
    texts.append(one.ask("state")["text"])
    assert "radius_m = 0.15" in texts[1]
    # Undone outside of fields, where it would undo typing.
    page.locator("#step-targets").focus()
    page.keyboard.press("Control+z")
    expect(page.locator("#diameter-ball")).to_have_value("22")
    assert one.ask("state")["text"] == texts[0]
    page.keyboard.press("Control+z")
    until(lambda: (tmp_path / "ball.colors.toml").read_text() == colors)
    for _ in range(2):
        page.keyboard.press("Control+Shift+z")
    expect(page.locator("#diameter-ball")).to_have_value("30")
    page.keyboard.press("Control+s")
    expect(page.locator("#save")).to_be_disabled()
    assert (tmp_path / "scene.toml").read_text() == texts[1]


def test_small_balls_are_magnified_and_clicked(studio, tmp_path):
    shutil.copytree(DATA / "dioptric-jump/frames", tmp_path / "frames")
    shutil.copy(DATA / "dioptric-jump/camera.json", tmp_path / "camera.json")
    one = studio(".")
    page = one.page
    one.step("colors")
    truth = truth_of("dioptric-jump")
    ball_px = lambda frame: [float(truth[frame][axis]) for axis in ("u_px", "v_px")]
    labelled = lambda: [sample["outline_px"] for sample in one.ask("state")["targets"][0]["samples"]]

    def is_ball(outline_px, frame):
        middle = [sum(axis) / len(outline_px) for axis in zip(*outline_px)]
        return max(abs(a - b) for a, b in zip(middle, ball_px(frame))) < 1

    # The wheel magnifies what is below the pointer, which stays there.
    picture = page.locator("[data-camera=cam1]")
    whole = picture.locator(".whole")
    at = one.at("cam1", ball_px(0), (640, 480))
    expect(whole).to_be_hidden()
    page.mouse.move(*at)
    for text in ("1.3×", "1.6×", "2.0×", "2.4×", "3.1×", "3.8×", "4.8×", "6.0×", "7.5×", "9.3×", "12×", "15×"):
        page.mouse.wheel(0, -100)
        expect(whole).to_have_text(f"Whole picture ({text})")
    page.mouse.click(*at)
    expect(page.locator("#labels li")).to_have_count(1)
    assert is_ball(labelled()[0], 0)
    # With Shift the picture is moved, not too far, and a drag is a box as before.
    one.show("cam1", 1)
    scale = picture.locator("canvas").bounding_box()["width"] / 640 * 1.25**12
    to = [a + scale * (b - c) for a, b, c in zip(at, ball_px(1), ball_px(0))]
    page.keyboard.down("Shift")
    page.mouse.move(*to)
    page.mouse.down()
    page.mouse.move(to[0] - 60, to[1] + 40, steps=3)
    page.mouse.up()
    page.keyboard.up("Shift")
    for text in ("12×", "9.3×", "7.5×", "6.0×", "4.8×"):
        page.mouse.wheel(0, 100)
        expect(whole).to_have_text(f"Whole picture ({text})")
    half = 12 * scale / 1.25**5
    page.mouse.move(to[0] - 60 - half, to[1] + 40 - half)
    page.mouse.down()
    page.mouse.move(to[0] - 60 + half, to[1] + 40 + half, steps=3)
    page.mouse.up()
    expect(page.locator("#labels li")).to_have_count(2)
    assert is_ball(labelled()[1], 1)
    # Keys do it, too, and the cross stays in view.
    picture.locator("canvas").focus()
    page.keyboard.press("0")
    expect(whole).to_be_hidden()
    one.show("cam1", 2)
    picture.locator("canvas").focus()
    for axis, keys in enumerate((("ArrowLeft", "ArrowRight"), ("ArrowUp", "ArrowDown"))):
        off = round(ball_px(2)[axis]) - (320, 240)[axis]
        page.keyboard.press("+")
        for _ in range(abs(off)):
            page.keyboard.press(keys[off > 0])
    page.keyboard.press("Enter")
    expect(page.locator("#labels li")).to_have_count(3)
    assert is_ball(labelled()[2], 2)
    expect(whole).to_have_text("Whole picture (1.6×)")
    whole.click()
    expect(whole).to_be_hidden()


def test_two_fingers_magnify_and_label_nothing(studio, tmp_path):
    shutil.copytree(DATA / "dioptric-jump", tmp_path / "dioptric-jump")
    one = studio(str(tmp_path / "dioptric-jump"), has_touch=True)
    page = one.page
    one.step("colors")
    row = truth_of("dioptric-jump")[0]
    x, y = one.at("cam1", [float(row["u_px"]), float(row["v_px"])], (640, 480))
    page.touchscreen.tap(x, y)
    expect(page.locator("#labels li")).to_have_count(1)
    before = one.ask("state")["targets"][0]["samples"]
    session = one.context.new_cdp_session(page)

    def touch(kind, *places):
        points = [{"x": place[0], "y": place[1], "id": number} for number, place in enumerate(places)]
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    # One finger is there before the other, and leaves after it.
    touch("touchStart", (x - 20, y))
    touch("touchMove", (x - 40, y))
    touch("touchStart", (x - 40, y), (x + 40, y))
    for apart in (50, 65, 80):
        touch("touchMove", (x - apart, y), (x + apart, y))
    touch("touchEnd", (x - 80, y))
    touch("touchMove", (x - 120, y))
    touch("touchEnd")
    whole = page.locator("[data-camera=cam1] .whole")
    expect(whole).to_have_text("Whole picture (2.0×)")
    # What was between the fingers still is, and is labelled by one.
    assert one.ask("state")["targets"][0]["samples"] == before
    one.show("cam1", 1)
    page.touchscreen.tap(x, y)
    expect(page.locator("#labels li")).to_have_count(2)


def test_what_an_edit_was_refused_for_is_no_answer_to_the_next(studio, tmp_path):
    one = studio()
    page = one.page
    page.fill("#address", "")
    page.keyboard.press("Enter")
    page.fill("#address", "foo://1")
    page.keyboard.press("Enter")
    expect(page.locator("#messages .error")).to_have_count(1)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as silent:
        silent.bind(("127.0.0.1", 0))
        port = silent.getsockname()[1]
    # Nobody sends there: it takes a while, and the page says that it works.
    page.fill("#address", f"udp://127.0.0.1:{port}")
    page.keyboard.press("Enter")
    expect(page.locator("#messages .error")).to_have_count(0)
    until(lambda: page.evaluate("getComputedStyle(document.body, '::after').opacity") == "1")
    expect(page.locator("#messages .error")).to_contain_text(str(port))
    one.errors.clear()


def test_edits_keep_their_order_and_late_answers_replace_no_later_state(studio, tmp_path):
    shutil.copytree(DATA / "dioptric-jump", tmp_path / "dioptric-jump")
    one = studio(str(tmp_path / "dioptric-jump"))
    page = one.page
    for radius_m in [0.15, 0.2]:
        one.ask("set_shape", {"target": "ball", "kind": "sphere", "sizes": {"radius_m": radius_m}})
    one.step("targets")
    diameter = page.locator("#diameter-ball")
    expect(diameter).to_have_value("40")
    # An edit takes long to reach the program.
    page.evaluate(
        """() => {
            const { fetch } = window;
            window.fetch = async (...what) => {
                window.fetch = fetch;
                await new Promise((resolve) => setTimeout(resolve, 1000));
                return fetch(...what);
            };
        }"""
    )
    page.fill("#diameter-ball", "50")
    page.keyboard.press("Enter")
    page.locator("#step-targets").focus()
    page.keyboard.press("Control+z")
    expect(page.locator("#redo")).to_have_attribute("title", re.compile("radius_m 0.25 for ball"))
    expect(diameter).to_have_value("40")
    # An answer takes long to come back.
    for _ in range(2):
        one.ask("undo")
    expect(diameter).to_have_value("22")
    page.evaluate(
        """() => {
            const { fetch } = window;
            window.fetch = async (...what) => {
                window.fetch = fetch;
                const answer = await fetch(...what);
                window.isWaiting = true;
                await new Promise((resolve) => { window.goOn = resolve; });
                return answer;
            };
        }"""
    )
    page.keyboard.press("Control+Shift+z")
    until(lambda: page.evaluate("window.isWaiting"))
    one.ask("redo")
    expect(diameter).to_have_value("40")
    page.evaluate("window.goOn()")
    until(lambda: page.evaluate("!document.body.classList.contains('busy')"))
    expect(diameter).to_have_value("40")


def test_the_last_of_many_orders_to_a_picture_counts(studio, tmp_path):
    shutil.copytree(DATA / "dioptric-jump/frames", tmp_path / "frames")
    one = studio("frames")
    page = one.page
    slider = page.locator("input[id^=frame-]")
    slider.focus()
    # The first order takes long to reach the program.
    page.evaluate(
        """() => {
            const { fetch } = window;
            window.fetch = async (...what) => {
                window.fetch = fetch;
                await new Promise((resolve) => setTimeout(resolve, 1000));
                window.hasGone = true;
                return fetch(...what);
            };
        }"""
    )
    for _ in range(5):
        page.keyboard.press("ArrowRight")
    until(lambda: page.evaluate("window.hasGone"))
    number = page.locator(".number-of-frame")
    expect(number).to_have_text("5 / 109")
    # It stays there.
    page.wait_for_timeout(500)
    expect(number).to_have_text("5 / 109")


def test_a_target_that_cannot_be_read_is_not_taken_for_none(studio, tmp_path):
    scene = (DATA / "dioptric-jump/scene.toml").read_text()
    scene = scene.replace('"frames"', f'"{DATA / "dioptric-jump/frames"}"').replace("../colors", str(DATA / "colors"))
    scene = scene.replace("radius_m = 0.11", "radius_m = -0.11")
    (tmp_path / "scene.toml").write_text(scene)
    one = studio("scene.toml")
    expect(one.page.locator("#step-targets .number")).to_have_class("number wrong")
    one.step("targets")
    expect(one.page.locator(".problems")).to_contain_text("targets.ball.shape.sphere.radius_m")
    # It would be there twice.
    assert "targets.ball: is in the scene already" in one.ask("add_target", {"name": "ball"})["error"]
    assert one.ask("state")["text"] == scene
    # What is only missing is no problem of a step before that has begun.
    one.ask("add_target", {"name": "other"})
    expect(one.page.locator("#step-colors .number")).to_have_text("4")
    one.errors.clear()


def test_mistakes_are_refused_with_their_remedy_and_change_nothing(studio, tmp_path):
    shutil.copytree(DATA / "dioptric-jump/frames", tmp_path / "in/frames")
    (tmp_path / "secret.toml").write_text("secret = true\n")
    (tmp_path / "broken.yml").write_text("a: [")
    (tmp_path / "in/broken.yml").write_text("a: [")
    one = studio("frames", folder=tmp_path / "in")
    before = one.ask("state")["text"]
    errors = {
        "add_source": ({"input": str(tmp_path / "secret.toml")}, "start it with the folder that holds it"),
        "add_source ": ({"input": "/dev/../etc/passwd"}, "start it with the folder that holds it"),
        "add_source  ": ({"input": "/dev/video/../../etc/passwd"}, "start it with the folder that holds it"),
        "add_source   ": ({"input": "/dev/v4l/by-id/../../../etc/passwd"}, "start it with the folder that holds it"),
        "add_source    ": ({"input": "file:///etc/passwd"}, "rtsp"),
        "files": ({"folder": "/etc"}, "start it with the folder that holds it"),
        "set_calibration": ({"camera": "camera", "file": "../secret.toml"}, "start it with the folder"),
        "set_fov": ({"camera": "camera", "fov_deg": 180}, "allowed: 1 to 170"),
        "add_target": ({"name": "a b"}, "allowed: 1 to 64 of the characters"),
        "set_shape": ({"target": "ball", "kind": "sphere", "sizes": {"radius_m": -1}}, "targets.ball"),
        "set_shape ": ({"target": "ball", "kind": "pyramid", "sizes": {"height_m": 1}}, "[targets.ball.shape.prism]"),
        "set_shape  ": ({"target": "ball", "kind": "box", "sizes": {"size_m": [1, 2]}}, "targets.ball"),
        "set_shape   ": ({"target": "none", "kind": "box", "sizes": {"size_m": [1, 2, 3]}}, "is not in the scene"),
        "label": ({"camera": "camera", "target": "none", "at_px": [1, 1]}, "is not in the scene"),
        "set_pose": ({"camera": "camera", "points": []}, "too few"),
        "set_pose_of_board": ({"camera": "camera", "board": str(tmp_path / "secret.toml")}, "describe the board in words"),
        "restore": ({"text": '[cameras.camera]\nimages = "../secret.toml"\n'}, "start it with the folder"),
        "restore ": ({"text": '[cameras.camera]\nvideo = "/etc/passwd"\n'}, "start it with the folder"),
        "show": ({"camera": "none"}, "has no picture"),
        "nonsense": ({}, "is no request of this page"),
        "track": ({"x": 1}, "the request is malformed"),
    }
    one.ask("add_target", {"name": "ball"})
    before = one.ask("state")["text"]
    for request, (value, message) in errors.items():
        assert message in one.ask(request.strip(), value)["error"], request
    assert one.ask("state")["text"] == before
    # On the page, a mistake is shown until it is closed. The browser lists the failed requests.
    one.step("camera")
    one.page.get_by_role("button", name="broken.yml").click()
    expect(one.page.locator(".message.error")).to_contain_text("broken.yml")
    assert len(one.errors) == len(errors) + 1
    one.errors.clear()


def shape_of(state, target):
    """Returns the shape of a target as the scene has it."""
    [shape] = [one["shape"] for one in state["targets"] if one["name"] == target]
    return shape


def test_targets_of_all_shapes_have_sizes_in_any_unit(studio, tmp_path):
    shutil.copytree(DATA / "dioptric-jump/frames", tmp_path / "frames")
    one = studio("frames")
    page = one.page
    for name in ["ball", "crate"]:
        one.ask("add_target", {"name": name})
    texts = [one.ask("state")["text"]]
    ball = shape_of(one.ask("state"), "ball")
    one.step("targets")
    shapes = {
        "cylinder": ({"diameter": "30", "height": "0.5"}, "in", {"radius_m": 0.381, "height_m": 0.0127}),
        "box": ({"length": "40", "width": "30", "height": "20"}, "cm", {"size_m": [0.4, 0.3, 0.2]}),
        "prism": ({"width": "250", "height": "600"}, "mm", {"across_flats_m": 0.25, "height_m": 0.6}),
        "disc": ({"diameter": "0.12", "height": "0.4"}, "m", {"radius_m": 0.06, "height_m": 0.4}),
        "rectangle": ({"length": "30", "width": "20", "height": "0"}, "cm", {"size_m": [0.3, 0.2], "height_m": 0}),
        "sphere": ({"diameter": "22"}, "cm", {"radius_m": 0.11}),
    }
    for kind, (sizes, unit, expected) in shapes.items():
        page.select_option("#kind-crate", kind)
        page.select_option("#unit-crate", unit)
        for size, value in sizes.items():
            page.fill(f"#{size}-crate", value)
        page.click("#set-crate")
        expect(page.locator("#undo")).to_have_attribute("title", re.compile(f"Undo: {kind}: .* for crate"))
        state = one.ask("state")
        assert shape_of(state, "crate") == {kind: expected}
        assert shape_of(state, "ball") == ball
        assert [problem for problem in state["problems"] if "shape" in problem["key"]] == []
        texts.append(state["text"])
        # What is shown is what was set.
        for size, value in sizes.items():
            expect(page.locator(f"#{size}-crate")).to_have_value(value)
    # Every step can be undone.
    for text in reversed(texts[:-1]):
        page.click("#undo")
        until(lambda: one.ask("state")["text"] == text)
    # Of what is no ball a click gives no outline, but a box does.
    page.select_option("#kind-crate", "box")
    page.click("#set-crate")
    one.step("colors")
    page.select_option("#target", "crate")
    expect(page.locator("#panel .hint")).to_contain_text("Drag a box closely around crate")
    page.mouse.click(*middle_of(page, "camera", ORANGE))
    expect(page.locator(".message.error")).to_contain_text("drag a box")
    u, v = middle_of(page, "camera", ORANGE)
    page.mouse.move(u - 12, v - 12)
    page.mouse.down()
    page.mouse.move(u + 12, v + 12, steps=3)
    page.mouse.up()
    expect(page.locator("#labels li")).to_have_count(1)
    [crate] = [target for target in one.ask("state")["targets"] if target["name"] == "crate"]
    assert len(crate["samples"][0]["outline_px"]) == 4
    one.errors.clear()


def test_a_size_that_the_cameras_contradict_is_shown_and_can_be_taken_over(studio, tmp_path):
    scene = (DATA.parent / "experiments/edge/webcams-two.toml").read_text().replace("../../data", str(DATA))
    (tmp_path / "scene.toml").write_text(scene.replace("radius_m = 0.035", "radius_m = 0.042"))
    one = studio("scene.toml")
    page = one.page
    one.step("track")
    page.click("#start")
    expect(page.locator("#report")).to_contain_text("processed 160 frame")
    one.step("targets")
    expect(page.locator("#measured-ball")).to_contain_text("contradicts the scene")
    page.click("#use-ball")
    expect(page.locator("#undo")).to_have_attribute("title", re.compile("radius_m"))
    assert abs(shape_of(one.ask("state"), "ball")["sphere"]["radius_m"] - 0.035) < 0.0005
    page.click("#unknown-ball")
    expect(page.locator("#panel")).to_contain_text("Its size is unknown")
    assert 'radius_m = "unknown"' in one.ask("state")["text"]


def test_names_of_strangers_stay_texts(studio, tmp_path):
    name = '<img src=x onerror="window.hacked=1">'
    shutil.copytree(DATA / "dioptric-jump/frames", tmp_path / name / "frames")
    one = studio()
    page = one.page
    page.get_by_role("button", name=name, exact=False).first.click()
    page.get_by_role("button", name="Add the images in frames").click()
    expect(page.locator("#panel .name")).to_contain_text(name)
    one.step("track")
    page.click("#start")
    expect(page.locator(".message.error")).to_be_visible()
    assert page.evaluate("window.hacked") is None
    assert page.locator("img:not(.logo)").count() == 0
    one.errors.clear()


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_pages_fit_900_pixels_in_both_modes(studio, tmp_path, scheme):
    shutil.copytree(DATA / "webcams-two", tmp_path / "two")
    one = studio("two", color_scheme=scheme)
    one.page.set_viewport_size({"width": 900, "height": 700})
    for step in ["sources", "camera", "pose", "colors", "targets", "track"]:
        one.step(step)
        expect(one.page.locator("figure:not(.waits)").first).to_be_visible()
        assert one.page.evaluate("document.documentElement.scrollWidth") <= 900, step
        hidden = one.page.evaluate(
            "[...document.querySelectorAll('button, input, select')].filter((e) => e.offsetParent && e.getBoundingClientRect().right > 901).map((e) => e.textContent)"
        )
        assert hidden == [], step
    assert one.page.locator("figure").count() == 2
    red = int(re.search(r"\d+", one.page.evaluate("getComputedStyle(document.body).backgroundColor"))[0])
    assert (red > 200) == (scheme == "light")


def test_the_pose_of_known_points_is_that_of_the_calibration(studio, tmp_path):
    shutil.copytree(DATA / "webcams-two", tmp_path / "two")
    one = studio("two")
    page = one.page
    camera = one.ask("state")["cameras"][0]
    one.step("pose")
    expect(page.locator("#panel .now")).to_contain_text("lines of the grid")
    # Where the ball was, and where this camera showed it.
    seen = [row for row in truth_of("webcams-two") if row["camera"] == camera["name"] and float(row["visible_fraction"]) == 1]
    points = [
        {"at_px": [float(row["u_px"]), float(row["v_px"])], "world_m": [float(row[axis]) for axis in ("x_m", "y_m", "z_m")]}
        for row in seen[:: len(seen) // 8]
    ]
    before = camera["position_m"]
    answer = one.ask("set_pose", {"camera": camera["name"], "points": points})
    assert answer.get("rms_px", 9) < 0.5, answer
    after = one.ask("state")["cameras"][0]["position_m"]
    assert max(abs(a - b) for a, b in zip(before, after)) < 0.005
    assert before != after


def test_a_file_of_several_cameras_asks_which_is_meant(studio, tmp_path):
    shutil.copytree(DATA / "webcams-two/frames/cam2", tmp_path / "frames")
    shutil.copy(DATA / "webcams-two/cameras.json", tmp_path / "rig.json")
    one = studio("frames", ".")
    page = one.page
    one.step("camera")
    page.get_by_role("button", name="rig.json").click()
    expect(page.locator("#panel")).to_contain_text("Which of the cameras in this file is camera?")
    page.locator(".of-file", has_text="cam2").click()
    expect(page.locator("#panel .now").first).to_contain_text("Calibrated: rig.json")
    assert 'calibration_camera = "cam2"' in one.ask("state")["text"]
    expect(page.locator(".of-file")).to_have_count(0)


@pytest.fixture
def stream(streams):
    """The address of a camera that sees the thrown ball."""
    return streams(*frames_of("dioptric-jump/frames")).address


def test_a_live_camera_is_tracked_while_a_page_watches(studio, tmp_path, stream):
    live_scene(tmp_path, stream)
    one = studio("live.toml", "--watch", "--duration", "6", "-o", "out", command="track")
    page = one.page
    expect(page.locator("[data-target=ball] .state")).to_have_text("tracking")
    expect(page.locator("[data-camera=cam1]:not(.waits)")).to_be_visible()
    expect(page.locator("#steps")).to_be_hidden()
    expect(page.locator("#now .time")).to_contain_text("ms old")
    page.click("#show-viewer")
    expect(page.locator("#viewer canvas").first).to_be_visible()
    first = float(re.search(r"([\d.]+) s", page.locator("#now .time").inner_text())[1])
    page.wait_for_timeout(1000)
    later = float(re.search(r"([\d.]+) s", page.locator("#now .time").inner_text())[1])
    assert later > first
    # It ends by itself, which the page says, and its rows are complete.
    assert one.process.wait(60) == 0
    rows = list(csv.DictReader(open(tmp_path / "out/tracks.csv")))
    assert len(rows) > 100
    expect(page.locator(".message")).to_contain_text("The run is over")
    page.close()
    one.errors.clear()


def live_scene(folder, address):
    """Writes a scene of the thrown ball whose camera is a stream."""
    scene = (DATA / "dioptric-jump/scene.toml").read_text()
    scene = scene.replace('images = "frames"\nfps = 25', f'video = "{address}"')
    scene = scene.replace("../colors", str(DATA / "colors"))
    (folder / "live.toml").write_text(scene)


def test_a_camera_that_goes_away_is_missed_and_comes_back(studio, tmp_path, streams):
    stream = streams(*frames_of("dioptric-jump/frames"))
    live_scene(tmp_path, stream.address)
    one = studio("live.toml")
    page = one.page
    caption = page.locator("figcaption")
    is_back = re.compile(r"\d\d\.\d per second")
    # While its picture is shown.
    expect(caption).to_contain_text(is_back)
    stream.stop()
    expect(caption).to_contain_text(re.compile(r"no image for \d+ s"))
    stream.start()
    expect(caption).to_contain_text(is_back)
    # While it is tracked: the run goes on with the rows after the gap.
    one.step("track")
    page.click("#start")
    expect(page.locator("[data-target=ball] .state")).to_have_text("tracking")
    stream.stop()
    expect(caption).to_contain_text(re.compile(r"no image for \d+ s"))
    last = page.locator("#now .time").inner_text()
    stream.start()
    expect(caption).not_to_contain_text("no image")
    expect(page.locator("#now .time")).not_to_have_text(last)
    expect(page.locator("[data-target=ball] .state")).to_have_text("tracking")
    page.click("#stop")
    expect(page.locator("#report")).to_contain_text("ball:")


def test_values_of_a_run_are_called_old_while_no_image_comes(studio, tmp_path, streams):
    source = streams(*frames_of("dioptric-jump/frames"))
    live_scene(tmp_path, source.address)
    one = studio("live.toml")
    page = one.page
    one.step("track")
    page.click("#start")
    expect(page.locator("[data-target=ball] .state")).to_have_text("tracking")
    expect(page.locator("#silence")).to_be_hidden()
    page.reload()
    expect(page.locator("[data-target=ball] .state")).to_have_text("tracking")
    source.stop()
    expect(page.locator("#silence")).to_have_text(re.compile(r"^No new frame for [2-9] s: these values are old.$"))
    expect(page.locator("figcaption .bad")).to_contain_text("waiting for the camera")
    source.start()
    expect(page.locator("#silence")).to_be_hidden()
    page.click("#stop")
    expect(page.locator("#report")).to_contain_text("ball:")
    expect(page.locator("#silence")).to_be_hidden()
    # Another run, while nothing comes, has no values, and not those of the one before. So in another tab.
    source.stop()
    page.click("#start")
    expect(page.locator("#silence")).to_have_text(re.compile(r"^No frame for [2-9] s.$"))
    expect(page.locator("#now .time")).to_be_hidden()
    expect(page.locator("figcaption .bad")).to_contain_text("waiting for the camera")
    other = one.context.new_page()
    other.goto(one.address)
    other.click("#step-track")
    expect(other.locator("#silence")).to_have_text(re.compile(r"^No frame for \d+ s.$"))
    expect(other.locator("#now .time")).to_be_hidden()
    other.close()
    source.start()
    expect(page.locator("[data-target=ball] .state")).to_have_text("tracking")
    page.click("#stop")
    expect(page.locator("#report")).to_contain_text("ball:")


def test_a_recording_that_was_away_is_shown_once_it_is_back(studio, tmp_path):
    shutil.copytree(DATA / "dioptric-jump/frames", tmp_path / "in/frames")
    one = studio("frames", folder=tmp_path / "in")
    page = one.page
    expect(page.locator("[data-camera=camera]:not(.waits)")).to_be_visible()
    (tmp_path / "in/frames").rename(tmp_path / "in/away")
    # Whatever opens it anew.
    one.ask("rename_camera", {"camera": "camera", "name": "cam"})
    page.reload()
    expect(page.locator("figcaption .bad")).to_contain_text("frames")
    (tmp_path / "in/away").rename(tmp_path / "in/frames")
    expect(page.locator("[data-camera=cam]:not(.waits)")).to_be_visible()
    expect(page.locator("figcaption .bad")).to_be_hidden()
    # The same source twice is a slip of the mouse.
    assert "is a camera of the scene already" in one.ask("add_source", {"input": str(tmp_path / "in/frames")})["error"]
    one.errors.clear()


def test_a_box_is_drawn_while_text_of_the_page_is_selected(studio, tmp_path):
    shutil.copytree(DATA / "dioptric-jump/frames", tmp_path / "in/frames")
    one = studio("frames", folder=tmp_path / "in")
    page = one.page
    one.ask("add_target", {"name": "ball"})
    one.step("colors")
    at = one.at("camera", [440, 68], (640, 480))
    to = one.at("camera", [480, 108], (640, 480))
    page.evaluate("getSelection().selectAllChildren(document.body)")
    page.mouse.move(*at)
    page.mouse.down()
    page.mouse.move(*to, steps=5)
    page.mouse.up()
    until(lambda: len(one.ask("state")["targets"][0]["samples"]) == 1)


def test_a_camera_that_is_not_there_is_tried_until_it_is(studio, tmp_path):
    """One whose program ends, unlike a silent one."""
    server = socket.create_server(("127.0.0.1", 0))
    port = server.getsockname()[1]
    server.close()
    live_scene(tmp_path, f"tcp://127.0.0.1:{port}")
    one = studio("live.toml")
    expect(one.page.locator("figcaption .bad")).to_contain_text(f"127.0.0.1:{port}")
    source = ["-re", "-stream_loop", "-1", "-framerate", "25", "-i", str(DATA / "dioptric-jump/frames/%06d.jpg")]
    encoded = ["-c:v", "mpeg2video", "-q:v", "2", "-g", "5", "-f", "mpegts", f"tcp://127.0.0.1:{port}?listen=1"]
    camera = subprocess.Popen(["ffmpeg", "-nostdin", "-loglevel", "error", *source, *encoded], stdout=one.log, stderr=one.log)
    try:
        rate = re.compile(r"\d\d\.\d per second")
        expect(one.page.locator("figcaption")).to_contain_text(rate)
        expect(one.page.locator("figcaption .bad")).to_have_count(0)
        # It serves one connection, which passes from the picture to the run and back.
        one.step("track")
        for _ in range(2):
            one.page.click("#start")
            expect(one.page.locator("#now")).to_contain_text("Frame 2")
            one.page.click("#stop")
            expect(one.page.locator("#report")).to_contain_text("ended on request")
        summary = json.loads((tmp_path / "live-tracks/summary.json").read_text())
        assert summary["cameras"]["cam1"]["reopened"] == 0
        one.step("sources")
        expect(one.page.locator("figcaption")).to_contain_text(rate)
        # It may get another name.
        one.page.fill("#name-cam1", "over the door")
        one.page.keyboard.press("Enter")
        expect(one.page.locator("[data-camera=over-the-door] figcaption")).to_contain_text(rate)
        assert camera.poll() is None
    finally:
        camera.kill()
        camera.wait()


def test_a_program_that_is_started_anew_gets_back_what_was_not_saved(studio, tmp_path):
    shutil.copytree(DATA / "dioptric-jump/frames", tmp_path / "frames")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    one = studio("--port", str(port))
    page = one.page
    page.get_by_role("button", name="Add the images in frames").click()
    one.step("colors")
    page.click("#add-target")
    expect(page.locator("#panel .hint")).to_contain_text("Click ball")
    text = one.ask("state")["text"]
    one.process.kill()
    one.process.wait()
    expect(page.locator(".message.error").last).to_contain_text("does not answer")
    expect(page.locator("body")).to_have_class(re.compile("offline"))
    # Nothing that is tried meanwhile is lost in silence, or shown as done.
    page.click("#undo")
    expect(page.locator(".message.error")).to_have_count(2)
    expect(page.locator("#undo")).to_be_enabled()
    one.start()
    expect(page.locator("#restore")).to_be_visible()
    expect(page.locator("body")).not_to_have_class(re.compile("offline"))
    assert one.ask("state")["text"] != text
    page.click("#restore")
    expect(page.locator("#restore")).to_have_count(0)
    assert one.ask("state")["text"] == text
    expect(page.locator("#panel .hint")).to_contain_text("Click ball")
    expect(page.locator("figure:not(.waits)")).to_be_visible()
    page.click("#save")
    expect(page.locator("#save")).to_be_disabled()
    assert (tmp_path / "scene.toml").read_text() == text
    # The browser lists the requests that nobody answered.
    one.errors.clear()


def test_a_tab_that_slept_shows_the_newest(studio, tmp_path, stream):
    one = studio(stream)
    page = one.page
    caption = page.locator("figcaption")
    expect(caption).to_contain_text(re.compile(r"of \d+ lost"))
    session = one.context.new_cdp_session(page)

    def frames():
        return int(re.search(r"of (\d+) lost", caption.inner_text())[1])

    before = frames()
    session.send("Page.setWebLifecycleState", {"state": "frozen"})
    time.sleep(4)
    session.send("Page.setWebLifecycleState", {"state": "active"})
    until(lambda: frames() > before + 90)
    drawn = page.evaluate("document.querySelector('canvas').toDataURL()")
    until(lambda: page.evaluate("document.querySelector('canvas').toDataURL()") != drawn)
    assert page.locator(".message.error").count() == 0


# Stands in for ffmpeg and ffprobe before a webcam, which is fast and large only with compressed images, as most are. Everything else is the real program's.
WEBCAM = """#!{python}
import os, sys
real, given = "{real}", sys.argv[1:]
if "v4l2" in given and "-i" in given:
    opening, rest = given[: given.index("-i")], given[given.index("-i") + 2 :]
    if "-list_formats" in opening:
        print("[video4linux2,v4l2 @ 0x1] Raw       :     yuyv422 :           YUYV 4:2:2 : 640x480 1920x1080", file=sys.stderr)
        sys.exit("[video4linux2,v4l2 @ 0x1] Compressed:       mjpeg :          Motion-JPEG : 640x480 1280x720 1920x1080")
    def asked(option, otherwise):
        return opening[opening.index(option) + 1] if option in opening else otherwise
    is_compressed = asked("-input_format", "") == "mjpeg"
    size, rate = (asked("-video_size", "640x480"), asked("-framerate", "30")) if is_compressed else ("640x480", "5")
    own = ["-max_pixels", "-protocol_whitelist", "-format_whitelist", "-f", "-framerate", "-video_size", "-pixel_format", "-input_format"]
    for option in own:
        if option in opening:
            del opening[opening.index(option) : opening.index(option) + 2]
    re = ["-re"] if real.endswith("ffmpeg") else []
    given = [*opening, *re, "-f", "lavfi", "-i", f"testsrc2=size={{size}}:rate={{rate}}", *rest]
os.execv(real, [real, *given])
"""


def test_a_webcam_is_asked_for_its_best_images(studio, tmp_path, monkeypatch):
    bin = tmp_path / "bin"
    bin.mkdir()
    for name in ["ffmpeg", "ffprobe"]:
        (bin / name).write_text(WEBCAM.format(python=sys.executable, real=shutil.which(name)))
        (bin / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{bin}:{os.environ['PATH']}")
    (tmp_path / "in").mkdir()
    one = studio(folder=tmp_path / "in")
    page = one.page
    page.fill("#address", "/dev/video7")
    page.keyboard.press("Enter")
    expect(page.locator("figure .live")).to_be_visible()
    text = one.ask("state")["text"]
    for line in ['video = "/dev/video7"', "fps = 30", 'input.codec = "mjpeg"', "size_px = [1280, 720]"]:
        assert f"\n{line}" in text, text
    expect(page.locator("figcaption")).to_contain_text(re.compile(r"(2\d|30)\.\d per second"))
    # Otherwise it would be 4 to 3.
    assert abs(page.locator("canvas").evaluate("canvas => canvas.width / canvas.height") - 16 / 9) < 0.01


def test_a_live_stream_is_shown_learnt_tracked_and_stopped(studio, tmp_path, stream):
    shutil.copy(DATA / "dioptric-jump/camera.json", tmp_path / "lens.json")
    one = studio()
    page = one.page
    page.fill("#address", stream)
    page.keyboard.press("Enter")
    expect(page.locator("figure .live")).to_be_visible()
    expect(page.locator("figcaption")).to_contain_text(re.compile(r"2\d\.\d per second · \d+ ms late · 0 of \d+ lost"))
    one.step("camera")
    page.get_by_role("button", name="lens.json").click()
    expect(page.locator("#panel .now")).to_contain_text("Calibrated")
    # The picture is held while it is clicked: the ball is where it is in some frame.
    one.step("colors")
    page.click("#add-target")
    # The button is pressed for several frames, each of which changes the text beside it.
    page.click("#play-camera", delay=300)
    expect(page.locator("#play-camera")).to_contain_text("Go on")
    held = page.evaluate("document.querySelector('canvas').toDataURL()")
    page.wait_for_timeout(500)
    assert page.evaluate("document.querySelector('canvas').toDataURL()") == held
    page.mouse.click(*middle_of(page, "camera", ORANGE))
    expect(page.locator("#labels li")).to_have_count(1)
    one.step("track")
    page.click("#start")
    expect(page.locator("[data-target=ball] .state")).to_have_text("tracking")
    page.click("#stop")
    expect(page.locator("#report")).to_contain_text("ball:")
    rows = list(csv.DictReader(open(tmp_path / "scene-tracks/tracks.csv")))
    assert any(row["state"] == "tracking" for row in rows)
    # The picture is back.
    one.step("sources")
    expect(page.locator("figure .live")).to_be_visible()


# The least red, the most green, the least and the most blue; green and blue relative to red.
ORANGE = [170, 0.7, 0, 0.4]
PINK = [170, 0.45, 0.35, 1]


def middle_of(page, camera, color):
    """Returns where on the page the middle of the pixels of a colour in the picture of a camera is."""
    return page.evaluate(
        """([camera, [red, green, leastBlue, mostBlue]]) => {
            const canvas = document.querySelector(`[data-camera=${camera}] canvas`);
            const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
            const [us, vs] = [[], []];
            for (let i = 0; i < data.length; i += 4) {
                const [r, g, b] = data.subarray(i, i + 3);
                if (r > red && g < green * r && b >= leastBlue * r && b < mostBlue * r) {
                    us.push((i / 4) % canvas.width);
                    vs.push(Math.floor(i / 4 / canvas.width));
                }
            }
            const middle = (values) => values.sort((a, b) => a - b)[values.length >> 1];
            const box = canvas.getBoundingClientRect();
            return [box.left + (middle(us) / canvas.width) * box.width, box.top + (middle(vs) / canvas.height) * box.height];
        }""",
        [camera, color],
    )


@pytest.fixture
def single_images():
    """The address of a camera that sends single JPEG images over HTTP, as most network cameras and phones do."""
    images = [path.read_bytes() for path in sorted((DATA / "webcams-two/frames/cam1").iterdir())]

    class Camera(BaseHTTPRequestHandler):
        def log_message(self, *_):
            pass

        def do_GET(self):
            self.send_response(200)
            self.send_header("Content-Type", "multipart/x-mixed-replace;boundary=frame")
            self.end_headers()
            try:
                for image in itertools.cycle(images):
                    self.wfile.write(b"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n%s\r\n" % (len(image), image))
                    time.sleep(0.04)
            except OSError:
                pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Camera)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}/video"
    server.shutdown()


def test_an_angle_of_view_counts_without_its_button(studio, tmp_path):
    shutil.copytree(DATA / "dioptric-jump/frames", tmp_path / "frames")
    one = studio("frames")
    expect(one.page.locator("[data-camera=camera]:not(.waits)")).to_be_visible()
    one.step("camera")
    one.page.fill("#fov", "55")
    one.step("colors")
    until(lambda: "55 degrees across the longer side" in one.ask("state")["text"])


def test_what_was_learnt_from_removed_labels_is_forgotten(studio, tmp_path):
    shutil.copytree(DATA / "dioptric-jump/frames", tmp_path / "frames")
    one = studio("frames")
    expect(one.page.locator("[data-camera=camera]:not(.waits)")).to_be_visible()
    one.ask("add_target", {"name": "ball"})
    truth = truth_of("dioptric-jump")[0]
    one.ask("label", {"camera": "camera", "target": "ball", "at_px": [float(truth["u_px"]), float(truth["v_px"])]})
    one.step("colors")
    expect(one.page.locator("#labels li")).to_have_count(1)
    expect(one.page.locator("#step-colors .number")).to_have_text("✓")
    assert (tmp_path / "ball.colors.toml").exists()
    one.ask("unlabel", {"target": "ball", "number": 0})
    expect(one.page.locator("#step-colors .number")).not_to_have_text("✓")
    expect(one.page.locator("#panel .hint")).to_contain_text("Click ball in the picture")
    assert not (tmp_path / "ball.colors.toml").exists()
    one.page.click("#undo")
    expect(one.page.locator("#step-colors .number")).to_have_text("✓")


def test_a_camera_of_single_images_needs_only_its_address(studio, single_images):
    one = studio()
    page = one.page
    page.fill("#address", single_images)
    page.keyboard.press("Enter")
    expect(page.locator("figure .live")).to_have_count(1)
    text = one.ask("state")["text"]
    assert f'video = "{single_images}"' in text and '\ninput.format = "mpjpeg"\n' in text
    expect(page.locator(".message.error")).to_have_count(0)


def test_colours_of_a_file_are_learnt_anew(studio, tmp_path):
    scene = (DATA / "dioptric-jump/scene.toml").read_text()
    (tmp_path / "scene.toml").write_text(scene.replace('"frames"', f'"{DATA / "dioptric-jump/frames"}"').replace("../colors", str(DATA / "colors")))
    one = studio("scene.toml")
    page = one.page
    one.step("colors")
    page.click("#learn-anew")
    expect(page.locator("#panel .hint")).to_contain_text("Click ball")
    truth = truth_of("dioptric-jump")[0]
    page.mouse.click(*one.at("cam1", [float(truth["u_px"]), float(truth["v_px"])], (640, 480)))
    expect(page.locator("#labels li")).to_have_count(1)
    assert 'colors = "ball.colors.toml"' in one.ask("state")["text"]
    page.click("#undo")
    page.click("#undo")
    expect(page.locator("#learn-anew")).to_be_visible()


def test_names_may_be_typed_with_spaces_and_tabs_follow_the_cameras(studio, tmp_path):
    shutil.copytree(DATA / "webcams-two/frames", tmp_path / "desk")
    one = studio("desk/cam1", "desk/cam2")
    page = one.page
    one.step("colors")
    page.click("#new-target")
    page.keyboard.type("pink ball")
    page.keyboard.press("Enter")
    expect(page.locator("#panel .hint")).to_contain_text("Click pink-ball")
    # A camera keeps its labels when it gets another name.
    truth = next(row for row in truth_of("webcams-two") if row["camera"] == "cam1")
    one.ask("label", {"camera": "camera", "target": "pink-ball", "at_px": [float(truth["u_px"]), float(truth["v_px"])]})
    one.step("sources")
    page.fill("#name-camera", "window")
    page.keyboard.press("Enter")
    expect(page.locator("[data-camera=window]:not(.waits)")).to_be_visible()
    for wrong, reason in [("camera-2", "is in the scene already"), ("Tür", "allowed: 1 to 64 of the characters")]:
        page.fill("#name-window", wrong)
        page.keyboard.press("Enter")
        expect(page.locator(".message.error")).to_contain_text(reason)
        expect(page.locator("#name-window")).to_have_value("window")
        one.errors.clear()
    one.step("colors")
    expect(page.locator("#labels li .entry")).to_have_text("window, frame 0")
    # What a camera leaves is no tab.
    expect(page.locator("#tab-camera-2")).to_be_visible()
    one.ask("remove", {"kind": "cameras", "name": "camera-2"})
    expect(page.locator("#tab-camera-2")).to_be_hidden()


def opencv_lens(camera):
    """Returns the lens of a camera as OpenCV writes it."""
    matrix = [camera["fx"], 0, camera["cx"], 0, camera["fy"], camera["cy"], 0, 0, 1]
    text = f"%YAML:1.0\n---\nimage_width: {camera['width']}\nimage_height: {camera['height']}\n"
    for name, rows, columns, data in [("camera_matrix", 3, 3, matrix), ("distortion_coefficients", 1, 5, [0.0] * 5)]:
        text += f"{name}: !!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n   data: {data}\n"
    return text


@pytest.mark.parametrize("poses", ["files", "ball"])
def test_two_live_cameras_become_a_scene_in_25_clicks(studio, tmp_path, streams, poses):
    """From an empty folder, with nothing but the mouse and what is typed into fields. The poses are those of the calibration files, or come from the ball itself."""
    sequence = DATA / "webcams-two"
    cameras = json.loads((sequence / "cameras.json").read_text())["cameras"]
    kind = {"files": "json", "ball": "yml"}[poses]
    for camera in cameras:
        text = json.dumps(camera) if poses == "files" else opencv_lens(camera)
        (tmp_path / f"{camera['name']}.{kind}").write_text(text)
    live = [streams(*frames_of(f"webcams-two/frames/{camera['name']}")) for camera in cameras]
    one = studio()
    page = one.page
    page.evaluate(
        """() => {
            window.clicks = window.typed = 0;
            // Without those that keys make.
            addEventListener("click", (event) => (window.clicks += event.detail > 0), true);
            addEventListener("change", (event) => {
                window.typed += event.target.matches("input[type=text], input[type=number]");
                // One that opens the list, and one at the entry.
                window.clicks += event.target.matches("select") ? 2 : 0;
            }, true);
        }"""
    )
    begun_s = time.monotonic()
    # Sources: two addresses. The names of the cameras are those that the program gives.
    for number, stream in enumerate(live):
        page.click("#address")
        page.keyboard.type(stream.address)
        page.keyboard.press("Enter")
        expect(page.locator("figure .live")).to_have_count(number + 1)
    names = [camera["name"] for camera in one.ask("state")["cameras"]]
    # Camera: a calibration each.
    one.step("camera")
    # The one that was added last is shown.
    for name, camera in reversed(list(zip(names, cameras))):
        if name != names[-1]:
            page.click(f"#tab-{name}")
        page.get_by_role("button", name=f"{camera['name']}.{kind}").click()
        expect(page.locator("#panel .now")).to_contain_text(f"Calibrated: {camera['name']}.{kind}")
    expect(page.locator("#step-camera .number")).to_have_text("✓")
    expect(page.locator("#step-pose .number")).to_have_text("✓" if poses == "files" else "3")
    # Colours: the ball in held pictures of both.
    one.step("colors")
    page.click("#add-target")
    for number, name in enumerate(names):
        if number > 0:
            page.click(f"#tab-{name}")
        page.click(f"#play-{name}")
        expect(page.locator(f"#play-{name}")).to_contain_text("Go on")
        page.mouse.click(*middle_of(page, name, PINK))
        expect(page.locator("#labels li")).to_have_count(number + 1)
    # Targets: the diameter.
    one.step("targets")
    page.click("#diameter-ball")
    page.keyboard.type("7")
    page.keyboard.press("Enter")
    expect(page.locator("#step-targets .number")).to_have_text("✓")
    # Pose: the ball moves before both cameras.
    if poses == "ball":
        one.step("pose")
        page.select_option("#way", "ball")
        # A machine with other work sees only a part of the images.
        page.click("#wave-seconds")
        page.keyboard.type("40")
        page.keyboard.press("Tab")
        page.click("#wave")
        page.click("#use-rig")
        expect(page.locator("#messages")).to_contain_text("The poses are in the scene.")
    # Track, and save.
    one.step("track")
    page.click("#start")
    expect(page.locator("[data-target=ball] .state")).to_have_text("tracking")
    expect(page.locator("figure:not(.waits)")).to_have_count(2)
    page.click("#stop")
    expect(page.locator("#report")).to_contain_text("ball:")
    page.click("#save-here")
    expect(page.locator("#file")).to_have_text("scene.toml")
    clicks, typed = page.evaluate("[window.clicks, window.typed]")
    took_s = time.monotonic() - begun_s
    assert clicks <= (19 if poses == "files" else 25)
    # The saved scene over the files themselves, whose clocks agree, against the truth: the bound of experiments/edge plus 20 %, or half as much again with poses from the ball.
    scene = re.sub("time_offset_s = .*\n", "", (tmp_path / "scene.toml").read_text())
    for name, camera, stream in zip(names, cameras, live):
        frames = sequence / "frames" / camera["name"]
        assert f'video = "{stream.address}"' in scene
        scene = scene.replace(f'video = "{stream.address}"', f'images = "{frames}"\nfps = 25')
    (tmp_path / "recorded.toml").write_text(scene)
    run("track", "recorded.toml", "-o", "recorded", folder=tmp_path)
    align = [] if poses == "files" else ["--align"]
    report = run("evaluate", "recorded", str(sequence), "--from", "0.39", *align, folder=tmp_path)
    assert figure(report, "with an estimate") >= 149
    error_mm = figure(report, "root mean square")
    print(f"{clicks} clicks, {typed} fields, {took_s:.0f} s, {error_mm} mm")
    assert error_mm < (0.96 if poses == "files" else 1.2)


def test_every_step_can_be_pictured_for_the_guide(studio, tmp_path):
    """Goes through the steps with the scene of the thrown ball, and writes pictures if PICTURES says where."""
    folder = Path(PICTURES) if PICTURES else tmp_path
    work = tmp_path / "hall"
    work.mkdir()
    shutil.copytree(DATA / "dioptric-jump/frames", work / "throw")
    shutil.copy(DATA / "dioptric-jump/camera.json", work / "fisheye.json")
    one = studio("throw", folder=work, color_scheme="light")
    page = one.page
    truth = truth_of("dioptric-jump")

    def take(step, name=None):
        expect(page.locator(f"#step-{step}")).to_have_attribute("aria-current", "step")
        expect(page.locator("figure:not(.waits), #viewer canvas").first).to_be_visible()
        expect(page.locator(".message")).to_have_count(0)
        page.mouse.move(0, 0)
        page.wait_for_timeout(300)
        # Not where this test runs.
        page.evaluate("document.querySelectorAll('.folder span').forEach((path) => (path.textContent = 'hall/'))")
        picture = folder / f"studio-{name or step}.jpg"
        page.screenshot(path=picture, type="jpeg", quality=75)
        assert picture.stat().st_size < 120_000, step

    one.show("camera", 40)
    take("sources")
    one.step("camera")
    page.get_by_role("button", name="fisheye.json").click()
    expect(page.locator("#panel .now")).to_contain_text("Calibrated")
    take("camera")
    one.step("pose")
    expect(page.locator("#panel .now")).to_contain_text("lines of the grid")
    take("pose")
    one.step("colors")
    page.click("#add-target")
    for number, frame in enumerate([100, 5, 40]):
        one.show("camera", frame)
        page.mouse.click(*one.at("camera", [float(truth[frame]["u_px"]), float(truth[frame]["v_px"])], (640, 480)))
        expect(page.locator("#labels li")).to_have_count(number + 1)
    take("colors")
    one.step("targets")
    page.fill("#diameter-ball", "22")
    page.click("#set-ball")
    expect(page.locator("#step-targets .number")).to_have_text("✓")
    take("targets")
    one.step("track")
    page.click("#start")
    expect(page.locator("#report")).to_contain_text("processed 110 frames")
    take("track")
    page.click("#settings summary")
    page.fill("#run-diameter-ball", "20")
    page.keyboard.press("Tab")
    expect(page.locator("#undo")).to_have_attribute("title", re.compile("radius_m 0.1 "))
    page.click("#start")
    expect(page.locator("#viewer .pv-comparison")).to_contain_text("change")
    take("track", "compare")
