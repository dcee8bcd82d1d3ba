"""Poses of all cameras from a waved ball, in a real browser: from recordings, as `calibrate rig` finds them, and from live cameras."""

import csv
import json
import re
import shutil
import socket
import subprocess
import tomllib

import pytest
from playwright.sync_api import expect
from studio_fixtures import DATA, figure, run, until

SEQUENCE = DATA / "webcams-two"


def truth():
    return {camera["name"]: camera for camera in json.loads((SEQUENCE / "cameras.json").read_text())["cameras"]}


def scene(images, colors="ball.colors.toml", radius=0.035):
    """Returns the text of a scene of the two webcams without their poses."""
    text = "# Two webcams.\n"
    for name, camera in truth().items():
        text += f"[cameras.{name}]  # on the desk\n{images[name]}\n"
        text += f"model.pinhole = {{ f_px = [{camera['fx']}, {camera['fy']}], center_px = [{camera['cx']}, {camera['cy']}] }}\n\n"
    return text + f'[targets.ball]\nshape.sphere.radius_m = {radius}\ncolors = "{colors}"\n'


@pytest.fixture
def desk(tmp_path):
    """A folder with the images of the two webcams, and a scene without poses."""
    shutil.copytree(SEQUENCE / "frames", tmp_path / "frames")
    shutil.copy(DATA / "colors/pink-ball.hsi.colors.toml", tmp_path / "ball.colors.toml")
    text = scene({name: f'images = "frames/{name}"\nfps = 25' for name in truth()})
    (tmp_path / "desk.toml").write_text(text)
    return tmp_path


def poses(text):
    return {name: camera["world_from_camera"] for name, camera in tomllib.loads(text)["cameras"].items() if "world_from_camera" in camera}


def seen_at(camera, place):
    """Returns where a camera shows a place."""
    rows = camera["T_world_from_camera"]
    x, y, z = (sum(rows[k][i] * (place[k] - rows[k][3]) for k in range(3)) for i in range(3))
    return [camera["fx"] * x / z + camera["cx"], camera["fy"] * y / z + camera["cy"]]


def relative(matrices):
    """Returns the pose of the second camera in the frame of the first, as rows of a rotation and a translation."""
    a, b = matrices["cam1"], matrices["cam2"]
    turn = [[sum(a[k][i] * b[k][j] for k in range(3)) for j in range(3)] for i in range(3)]
    apart = [sum(a[k][i] * (b[k][3] - a[k][3]) for k in range(3)) for i in range(3)]
    return turn, apart


def test_recordings_give_the_scene_that_calibrate_rig_writes(studio, desk):
    one = studio("desk.toml")
    page = one.page
    before = one.ask("state")["text"]
    # Its cameras are shown although they have no pose, which the step says.
    one.step("pose")
    expect(page.locator("#step-pose .number")).to_have_text("!")
    expect(page.locator("#panel .now")).to_have_text("Not known yet.")
    expect(page.locator("#panel .problems")).to_contain_text("choose above how to find it")
    page.select_option("#way", "ball")
    expect(page.locator("figure:not(.waits)")).to_have_count(2)
    page.click("#wave")
    expect(page.locator("#panel")).to_contain_text("cam2 fits to 0.08 px, seen in 160 frames")
    page.click("#use-rig")
    expect(page.locator("#step-pose .number")).to_have_text("✓")
    # The same text as from the command line.
    run("calibrate", "rig", "desk.toml", "--corrected", "other.toml", folder=desk)
    text = one.ask("state")["text"]
    assert text == (desk / "other.toml").read_text()
    page.click("#undo")
    expect(page.locator("#step-pose .number")).to_have_text("!")
    assert one.ask("state")["text"] == before
    page.click("#redo")
    expect(page.locator("#step-pose .number")).to_have_text("✓")
    page.click("#save")
    until(lambda: (desk / "desk.toml").read_text() == text)
    run("track", "desk.toml", "-o", "out", "--no-plots", folder=desk)
    rows = list(csv.DictReader(open(desk / "out/tracks.csv")))
    assert sum(row["state"] == "tracking" for row in rows) > 150


def test_known_points_say_where_the_room_is(studio, desk):
    # Places on the desk, and where the first camera shows them.
    camera = truth()["cam1"]
    places = [[0.3, 0.6, 0], [0.7, 0.6, 0], [0.7, 0.9, 0], [0.3, 0.9, 0]]
    points = [{"at_px": [round(value, 1) for value in seen_at(camera, place)], "world_m": place} for place in places]
    lines = [f"cam1,{p['at_px'][0]},{p['at_px'][1]},{','.join(map(str, p['world_m']))}\n" for p in points]
    (desk / "points.csv").write_text("view,u_px,v_px,x_m,y_m,z_m\n" + "".join(lines))
    one = studio("desk.toml")
    page = one.page
    one.step("pose")
    # The page has them from clicks.
    for number, point in enumerate(points):
        page.mouse.click(*one.at("cam1", point["at_px"], (320, 240)))
        for axis, value in zip("xyz", point["world_m"]):
            page.fill(f"#point-{number}-{axis}", str(value))
            page.keyboard.press("Tab")
    # They outlive the page.
    page.reload()
    one.step("pose")
    expect(page.locator("#point-3-y")).to_have_value("0.9")
    page.select_option("#way", "ball")
    expect(page.locator("#wave-world")).to_have_value("points")
    page.click("#wave")
    page.click("#use-rig")
    expect(page.locator("#step-pose .number")).to_have_text("✓")
    clicked = poses(one.ask("state")["text"])
    run("calibrate", "rig", "desk.toml", "--points", "points.csv", "--corrected", "other.toml", folder=desk)
    exact = poses((desk / "other.toml").read_text())
    for name, camera in truth().items():
        at = [[row[3] for row in of[:3]] for of in (clicked[name], exact[name], camera["T_world_from_camera"])]
        # Clicks are right to a pixel or so of the screen.
        assert max(abs(a - b) for a, b in zip(at[0], at[1])) < 0.02, at
        assert max(abs(a - b) for a, b in zip(at[1], at[2])) < 0.02, at


def test_points_of_the_next_camera_are_the_same_places(studio, desk):
    one = studio("desk.toml")
    page = one.page
    page.evaluate("() => { window.clicks = 0; addEventListener('click', (event) => (window.clicks += event.detail > 0), true); }")
    places = [[0.4, 0.45, 0], [0.6, 0.45, 0], [0.6, 0.6, 0.25], [0.3, 0.4, 0.1], [0.5, 0.4, 0.25], [0.3, 0.5, 0.2]]
    one.step("pose")
    for camera, size in [("cam1", (320, 240)), ("cam2", (240, 320))]:
        if camera == "cam2":
            page.click("#tab-cam2")
            expect(page.locator("#same-places")).to_contain_text("in the same order")
        for place in places:
            page.mouse.click(*one.at(camera, seen_at(truth()[camera], place), size))
        if camera == "cam1":
            # Typed from the first field on, with the tabulator between them.
            page.click("#point-0-x")
            for number in [number for place in places for number in place]:
                page.keyboard.press("Control+a")
                page.keyboard.type(str(number))
                page.keyboard.press("Tab")
                # Behind each point there is its button.
                if page.evaluate("document.activeElement.tagName") == "BUTTON":
                    page.keyboard.press("Tab")
            page.click("#compute")
        until(lambda: camera in poses(one.ask("state")["text"]))
    # The step, six points each, the first field, the button of the first camera, and the tab of the second.
    assert page.evaluate("window.clicks") == 16
    found = poses(one.ask("state")["text"])
    for name, camera in truth().items():
        # Clicks are right to a pixel or so of the screen.
        assert max(abs(row[3] - true[3]) for row, true in zip(found[name][:3], camera["T_world_from_camera"])) < 0.02, (name, found[name])


def test_what_is_missing_is_said_with_the_way_there(studio, desk):
    (desk / "ball.colors.toml").rename(desk / "kept")
    one = studio("desk.toml")
    page = one.page
    one.step("pose")
    page.select_option("#way", "ball")
    expect(page.locator("#panel")).to_contain_text("The ball's colours come first")
    page.click("#go-first")
    expect(page.locator("#step-colors")).to_have_attribute("aria-current", "step")
    (desk / "kept").rename(desk / "ball.colors.toml")
    before = one.ask("state")["text"]
    request = {"target": "ball", "duration_s": 5, "points": [], "board": None, "refine_focal": False}
    for change, message in [({"duration_s": 0}, "allowed: above 0"), ({"board": "/etc/x.toml"}, "describe the board in words")]:
        assert message in one.ask("wave", request | change)["error"]
    assert "wave the ball first" in one.ask("use_rig")["error"]
    # A board that is nowhere, and a search that is cancelled.
    one.ask("wave", request | {"board": "checkerboard:9x6:0.025"})
    one.step("pose")
    expect(page.locator("#wave-error")).to_contain_text("no camera shows the board")
    assert "wave the ball first" in one.ask("use_rig")["error"]
    one.ask("wave", request)
    assert "being calibrated" in one.ask("wave", request)["error"]
    assert "being calibrated" in one.ask("track")["error"]
    one.ask("stop_waving", {"is_cancelled": True})
    expect(page.locator("#wave")).to_be_enabled()
    assert "wave the ball first" in one.ask("use_rig")["error"]
    # An edit in between makes the poses those of another scene.
    page.click("#wave")
    expect(page.locator("#use-rig")).to_be_visible()
    assert "error" not in one.ask("set_shape", {"target": "ball", "kind": "sphere", "sizes": {"radius_m": 0.04}})
    expect(page.locator("#use-rig")).to_be_disabled()
    assert "was edited since" in one.ask("use_rig")["error"]
    one.ask("undo")
    assert one.ask("state")["text"] == before
    one.ask("use_rig")
    assert one.ask("state")["text"] != before
    one.errors.clear()


def test_a_camera_that_delivers_nothing_does_not_delay_cancelling(studio, desk, streams):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as silent:
        silent.bind(("127.0.0.1", 0))
        address = f"udp://127.0.0.1:{silent.getsockname()[1]}"
    images = {"cam1": 'images = "frames/cam1"\nfps = 25', "cam2": f'video = "{address}"\ninput.timeout_s = 3600\nsize_px = [320, 240]'}
    (desk / "silent.toml").write_text(scene(images))
    one = studio("silent.toml")
    one.ask("wave", {"target": "ball", "duration_s": 3600, "points": [], "board": None, "refine_focal": False})
    one.step("pose")
    one.page.select_option("#way", "ball")
    one.page.click("#wave-cancel")
    expect(one.page.locator("#wave")).to_be_enabled()
    assert "wave the ball first" in one.ask("use_rig")["error"]
    one.errors.clear()


@pytest.fixture
def single_connections(desk):
    """Senders of the two webcams, each of which serves one connection and then ends; their addresses."""
    senders, addresses = [], []
    for name in truth():
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            addresses.append(f"tcp://127.0.0.1:{free.getsockname()[1]}")
        encoded = ["-c:v", "mpeg2video", "-q:v", "2", "-g", "5", "-f", "mpegts", f"{addresses[-1]}?listen=1"]
        frames = ["-re", "-stream_loop", "-1", "-framerate", "25", "-i", SEQUENCE / f"frames/{name}/%06d.jpg"]
        with open(desk / f"{name}.log", "w") as log:
            senders.append(subprocess.Popen(["ffmpeg", "-nostdin", *map(str, frames), *encoded], stdout=log, stderr=log))
    yield addresses
    for sender in senders:
        sender.kill()
        sender.wait()


def test_live_cameras_are_calibrated_while_the_ball_is_waved(studio, desk, single_connections):
    addresses = single_connections
    text = scene({name: f'video = "{address}"' for name, address in zip(truth(), addresses)})
    (desk / "live.toml").write_text(text)
    one = studio("live.toml")
    page = one.page
    one.step("pose")
    page.select_option("#way", "ball")
    # A connection that is only being made is given up.
    expect(page.locator("figure:not(.waits) .live")).to_have_count(2)
    page.fill("#wave-seconds", "60")
    page.keyboard.press("Tab")
    page.click("#wave")
    expect(page.locator("#wave-time")).to_contain_text("s left")
    # Both cameras are watched at once, and shown meanwhile.
    expect(page.locator("#wave-progress")).to_contain_text(re.compile(r"cam1\d{2,}"))
    until(lambda: min(int(n) for n in re.findall(r"\d+$", page.locator("#wave-progress").inner_text(), re.MULTILINE)[-2:]) > 120)
    expect(page.locator("figure:not(.waits)")).to_have_count(2)
    page.click("#wave-enough")
    page.click("#use-rig")
    expect(page.locator("#step-pose .number")).to_have_text("✓")
    turn, apart = relative(poses(one.ask("state")["text"]))
    true_turn, true_apart = relative({name: camera["T_world_from_camera"] for name, camera in truth().items()})
    assert max(abs(a - b) for row, other in zip(turn, true_turn) for a, b in zip(row, other)) < 0.05, turn
    assert max(abs(a - b) for a, b in zip(apart, true_apart)) < 0.05, apart
    # The pictures are back, over the same connections.
    one.step("sources")
    expect(page.locator("figure .live")).to_have_count(2)
    expect(page.locator("figure .bad")).to_have_count(0)


def test_a_focal_length_that_was_guessed_is_refined(studio, tmp_path):
    sequence = DATA / "webcams-four"
    shutil.copytree(sequence / "frames", tmp_path / "frames")
    shutil.copy(DATA / "colors/pink-ball.hsi.colors.toml", tmp_path / "ball.colors.toml")
    one = studio()
    page = one.page
    true_px = [camera["fx"] for camera in json.loads((sequence / "cameras.json").read_text())["cameras"]]
    for number in range(1, 5):
        assert "error" not in one.ask("add_source", {"input": str(tmp_path / f"frames/cam{number}"), "fps": 25})
    ball = '[targets.ball]\nshape.sphere.radius_m = 0.035\ncolors = "ball.colors.toml"\n'
    one.ask("restore", {"text": one.ask("state")["text"] + ball})
    # An angle of view for all, as somebody guesses it: the focal lengths are 7 % too short.
    for name in [camera["name"] for camera in one.ask("state")["cameras"]]:
        until(lambda: "error" not in one.ask("set_fov", {"camera": name, "fov_deg": 55}))
    guessed = one.ask("state")["text"]
    one.step("pose")
    page.select_option("#way", "ball")
    page.check("#wave-refine")
    expect(page.locator("#wave-world")).to_contain_text("the first camera is taken to be level")
    page.click("#wave")
    page.click("#use-rig")
    # Nothing says where the room is.
    expect(page.locator("#messages")).to_contain_text("Where the room is remains a guess.")
    assert [key["key"] for key in one.ask("state")["guesses"] if key["step"] == "pose"] == [f"cameras.{camera['name']}.world_from_camera" for camera in one.ask("state")["cameras"]]
    found = tomllib.loads(one.ask("state")["text"])["cameras"]
    # Those that the ball determines are right within three of the standard deviations that `calibrate rig` gives, and the others stay.
    (tmp_path / "guessed.toml").write_text(guessed)
    run("calibrate", "rig", "guessed.toml", "--refine-focal", folder=tmp_path)
    refined = 0
    for row, true in zip(csv.DictReader(open(tmp_path / "guessed-rig/cameras.csv")), true_px, strict=True):
        before = tomllib.loads(guessed)["cameras"][row["camera"]]["model"]["pinhole"]["f_px"][0]
        assert before < 0.94 * true
        after = found[row["camera"]]["model"]["pinhole"]["f_px"][0]
        if row["focal_refined"] == "1":
            assert abs(after / true - 1) < 3 * float(row["focal_factor_sigma"]) < 0.04, row
            refined += 1
        else:
            assert after == before
    assert refined > 0
    one.errors.clear()


def test_a_calibration_file_with_poses_is_replaced_by_that_of_the_rig(studio, desk):
    shutil.copy(SEQUENCE / "cameras.json", desk)
    text = re.sub(r"model\.pinhole = .*", 'calibration = "cameras.json"', (desk / "desk.toml").read_text())
    (desk / "desk.toml").write_text(text)
    one = studio("desk.toml")
    page = one.page
    before = one.ask("state")["text"]
    one.step("pose")
    page.select_option("#way", "ball")
    page.click("#wave")
    page.click("#use-rig")
    until(lambda: one.ask("state")["text"] != before)
    rig = desk / "desk.rig.toml"
    run("calibrate", "rig", "desk.toml", "-o", "other", folder=desk)
    assert rig.read_text() == (desk / "other/rig.toml").read_text()
    after = one.ask("state")
    assert after["text"].count('calibration = "desk.rig.toml"') == 2 and "world_from_camera" not in after["text"]
    assert after["problems"] == []
    page.click("#undo")
    until(lambda: not rig.exists())
    assert one.ask("state")["text"] == before
    page.click("#redo")
    until(rig.exists)
    # Another program's file of that name is not replaced.
    page.click("#undo")
    until(lambda: not rig.exists())
    rig.write_text("mine")
    assert "exists already" in one.ask("use_rig")["error"]
    assert rig.read_text() == "mine"
    one.errors.clear()
