"""A lens from a board that is held up to the camera, in a real browser: from pictures whose camera is known, and from a live stream of a real camera."""

import re
import shutil
import subprocess
import tomllib

from playwright.sync_api import expect
from studio_fixtures import DATA, ROOT, run, until

BOARDS = DATA / "calibration/dioptric"
STEREO = DATA / "calibration/opencv-stereo"
# A picture of 320 x 240 pixels.
SMALL = DATA / "webcams-two/frames/cam1/000000.jpg"


def hold_up(page, square_mm):
    """Looks for a checkerboard of 9 x 6 inner corners."""
    page.click("#way-board")
    page.fill("#board-columns", "9")
    page.fill("#board-rows", "6")
    page.fill("#board-side", str(square_mm))
    page.click("#look")


def parameters(path):
    """Returns the parameters of the only camera in a calibration file, in order."""
    (camera,) = tomllib.loads(path.read_text())["cameras"].values()
    ((kind, model),) = camera["model"].items()
    flat = []
    for name in sorted(model):
        flat += model[name] if isinstance(model[name], list) else [model[name]]
    return kind, flat


def recorded(folder):
    """Makes a recording of the rendered pictures of a board, one a second."""
    folder.mkdir()
    pictures = sorted(BOARDS.glob("board_*.jpg"))
    for picture in pictures:
        shutil.copy(picture, folder)
    (folder / "times.csv").write_text("frame,time_s\n" + "".join(f"{i},{i}\n" for i in range(len(pictures))))
    return len(pictures)


def test_a_recorded_board_gives_the_lens_that_calibrate_board_finds(studio, tmp_path):
    count = recorded(tmp_path / "board")
    one = studio("board")
    page = one.page
    before = one.ask("state")["text"]
    one.step("camera")
    hold_up(page, 60)
    expect(page.locator("#board-count")).to_contain_text(f"{count} views")
    page.click("#fit-board")
    expect(page.locator("#board-rms")).to_contain_text(re.compile(r"equidistant: points fit to 0\.0\d pixels, points that were held out to 0\.\d\d"))
    page.click("#use-board")
    expect(page.locator("#panel .now").first).to_contain_text("Calibrated: camera.lens.toml (equidistant)")
    # The same as from the command line, and near the camera with which the pictures were rendered.
    found = tmp_path / "camera.lens.toml"
    run("calibrate", "board", "board", "--board", "checkerboard:9x6:0.06", "--model", "all", "-o", "lens", folder=tmp_path)
    kind, values = parameters(found)
    assert kind == "equidistant"
    assert parameters(tmp_path / "lens/camera.toml")[0] == kind
    for ours, theirs in zip(values, parameters(tmp_path / "lens/camera.toml")[1], strict=True):
        # The page has the pictures in colour, and the command in grey.
        assert abs(ours - theirs) < 1e-3 * abs(theirs), (values, theirs)
    model = tomllib.loads(found.read_text())["cameras"]["camera"]["model"]["equidistant"]
    assert abs(model["f_px_per_rad"] / 145.562 - 1) < 0.002
    assert abs(model["center_px"][0] - 319.5) < 0.4 and abs(model["center_px"][1] - 239.5) < 0.4
    # Undoing takes back the file and the scene, and doing it again restores both.
    text, lens = one.ask("state")["text"], found.read_text()
    assert "camera.lens.toml" in text
    page.click("#undo")
    until(lambda: not found.exists())
    assert one.ask("state")["text"] == before
    page.click("#redo")
    until(found.exists)
    assert found.read_text() == lens
    assert one.ask("state")["text"] == text


def test_pictures_of_a_board_in_a_folder_give_the_lens(studio, tmp_path):
    # The camera shows something else.
    shutil.copytree(DATA / "dioptric-jump/frames", tmp_path / "frames")
    pictures = tmp_path / "pictures/board"
    pictures.mkdir(parents=True)
    taken = sorted(BOARDS.glob("board_*.jpg"))
    for picture in taken:
        shutil.copy(picture, pictures)
    shutil.copy(DATA / "dioptric-jump/frames/000000.jpg", pictures / "without.jpg")
    one = studio("frames", ".")
    page = one.page
    one.step("camera")
    page.click("#way-board")
    page.fill("#board-columns", "9")
    page.fill("#board-rows", "6")
    page.fill("#board-side", "60")
    page.click("#board-folder summary")
    page.get_by_title("Open pictures").click()
    page.get_by_role("button", name="Use the pictures in board").click()
    expect(page.locator("#board-count")).to_contain_text(f"{len(taken)} views")
    expect(page.locator("#fit-board")).to_be_enabled()
    page.click("#board-left-out summary")
    expect(page.locator("#board-left-out")).to_contain_text("(last in without.jpg)")
    page.select_option("#board-model", "equidistant")
    page.click("#fit-board")
    page.click("#use-board")
    expect(page.locator("#panel .now").first).to_contain_text("lens.toml (equidistant)")
    run("calibrate", "board", "pictures/board", "--board", "checkerboard:9x6:0.06", "--model", "equidistant", "-o", "lens", folder=tmp_path)
    (found,) = tmp_path.rglob("*.lens.toml")
    # The same bytes are read.
    assert parameters(found) == parameters(tmp_path / "lens/camera.toml")
    # Views have the names of their pictures.
    page.click("#panel details:has(#board-report) summary")
    expect(page.locator("#board-report")).to_contain_text(taken[0].name)
    # Of another size, elsewhere, or none.
    (tmp_path / "other").mkdir()
    shutil.copy(SMALL, tmp_path / "other/000.jpg")
    board = {"camera": one.ask("state")["cameras"][0]["name"], "board": "checkerboard:9x6:0.06"}
    for folder, problem in [("other", "take the pictures with the camera's present settings"), ("/etc", "is no file or folder below those"), ("pictures", "no images there")]:
        folder = folder if folder.startswith("/") else str(tmp_path / folder)
        assert problem in one.ask("look_for_board_in", {**board, "folder": folder})["error"], folder
    # A picture that cannot be read ends it.
    (pictures / "000.jpg").write_bytes(b"no picture")
    shutil.copy(taken[0], pictures / "0.jpg")
    one.ask("look_for_board_in", {**board, "folder": str(pictures)})
    expect(page.locator("#panel .bad")).to_contain_text("000.jpg")
    one.errors.clear()


def test_what_cannot_be_used_leaves_no_file_behind(studio, tmp_path):
    count = recorded(tmp_path / "board")
    # An inline table has no place for a lens.
    inline = 'images = "board", world_from_camera = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]'
    model = "model = { pinhole = { f_px = [300, 300], center_px = [319.5, 239.5] } }"
    (tmp_path / "scene.toml").write_text(f"[cameras]\ncamera = {{ {inline}, {model} }}\n")
    one = studio("scene.toml")
    page = one.page
    before = one.ask("state")["text"]
    one.step("camera")
    hold_up(page, 60)
    expect(page.locator("#board-count")).to_contain_text(f"{count} views")
    page.select_option("#board-model", "equidistant")
    page.click("#fit-board")
    page.click("#use-board")
    expect(page.locator(".message.error")).to_contain_text("has no table of its own")
    assert one.ask("state")["text"] == before
    assert not (tmp_path / "camera.lens.toml").exists()
    one.errors.clear()


def test_a_board_before_a_live_camera_is_collected_while_the_picture_goes_on(studio, tmp_path, streams):
    # Each picture of a real camera stands still for a while, and jumps to the next.
    pictures = sorted(STEREO.glob("left*.jpg"))
    for number, picture in enumerate(pictures):
        shutil.copy(picture, tmp_path / f"{number:02}.jpg")
    film = ["-framerate", "0.9", "-i", tmp_path / "%02d.jpg", "-vf", "fps=25", "-c:v", "ffv1", tmp_path / "film.mkv"]
    subprocess.run(["ffmpeg", "-nostdin", "-v", "error", *film], check=True)
    address = streams("-i", tmp_path / "film.mkv").address
    one = studio()
    page = one.page
    page.fill("#address", address)
    page.keyboard.press("Enter")
    expect(page.locator("figure .live")).to_be_visible()
    one.step("camera")
    hold_up(page, 25)
    # Up to eight rounds of the pictures: a busy machine misses some in each.
    expect(page.locator("#board-advice")).to_contain_text("enough", timeout=120_000)
    # The picture did not wait for the search.
    expect(page.locator("figcaption")).to_contain_text(re.compile(r"2\d\.\d per second"))
    # What was left out has its reason.
    page.click("#board-left-out summary")
    expect(page.locator("#board-left-out")).to_contain_text("the board moves")
    expect(page.locator("#board-left-out")).to_contain_text("seen like this before")
    page.click("#leave-board")
    views = int(re.search(r"(\d+) views", page.locator("#board-count").inner_text())[1])
    assert 11 <= views <= 14
    page.select_option("#board-model", "pinhole")
    page.click("#fit-board")
    expect(page.locator("#board-rms")).to_contain_text("pinhole: points fit to 0.")
    page.click("#use-board")
    expect(page.locator("#panel .now").first).to_contain_text("Calibrated: camera.lens.toml (pinhole)")
    run("calibrate", "board", *map(str, pictures), "--board", "checkerboard:9x6:0.025", "--model", "pinhole", "-o", "lens", folder=tmp_path)
    model = tomllib.loads((tmp_path / "camera.lens.toml").read_text())["cameras"]["camera"]["model"]["pinhole"]
    theirs = tomllib.loads((tmp_path / "lens/camera.toml").read_text())["cameras"]["camera"]["model"]["pinhole"]
    # The stream is compressed, and has most of the views.
    for ours, other in zip(model["f_px"] + model["center_px"], theirs["f_px"] + theirs["center_px"]):
        assert abs(ours - other) < 3, (model, theirs)


def test_boards_that_are_described_wrongly_are_refused_with_the_remedy(studio, tmp_path):
    recorded(tmp_path / "board")
    (tmp_path / "board.toml").write_text("checkerboard = { columns = 9, rows = 6, square_m = 0.06 }\n")
    one = studio("board")
    page = one.page
    errors = {
        "look_for_board": ({"camera": "camera", "board": "chess"}, "is not a board; allowed: checkerboard"),
        "look_for_board ": ({"camera": "camera", "board": "checkerboard:1x1:0.1"}, "allowed: 3 to 200"),
        "look_for_board  ": ({"camera": "camera", "board": str(tmp_path / "board.toml")}, "describe the board in words"),
        "look_for_board   ": ({"camera": "none", "board": "checkerboard:9x6:0.06"}, "has no picture"),
        "fit_board": ({"model": "all"}, "begin with it"),
        "use_board": ({}, "begin with it"),
    }
    before = one.ask("state")["text"]
    for request, (value, message) in errors.items():
        assert message in one.ask(request.strip(), value)["error"], request
    # A board with other squares is seen in part, and says so.
    one.step("camera")
    page.click("#way-board")
    page.fill("#board-columns", "12")
    page.fill("#board-rows", "9")
    page.click("#look")
    expect(page.locator("#board-seen")).to_contain_text("12 x 9 inner corners must be in view; the largest part found has 54")
    assert "0 views of the board are too few" in one.ask("fit_board", {"model": "all"})["error"]
    assert page.locator("#fit-board").count() == 0
    # Another description begins again. One or two views do not determine a lens.
    page.click("#forget-board")
    page.fill("#board-columns", "9")
    page.fill("#board-rows", "6")
    page.fill("#board-side", "60")
    one.ask("show", {"camera": "camera", "frame": 0, "is_playing": False})
    one.ask("look_for_board", {"camera": "camera", "board": "checkerboard:9x6:0.06"})
    expect(page.locator("#board-count")).to_contain_text(re.compile("[12] view"))
    assert "too few" in one.ask("fit_board", {"model": "all"})["error"]
    assert "not calibrated yet" in one.ask("use_board")["error"]
    assert one.ask("state")["text"] == before
    one.errors.clear()


def test_boards_with_markers_are_described_in_any_unit(studio, tmp_path):
    pictures = ROOT / "crates/pardalis-calibrate/tests/boards"
    boards = {"charuco": ("cm", {"columns": 5, "rows": 7, "side": 4, "marker": 3, "dictionary": "DICT_4X4_50"}), "aprilgrid": ("mm", {"columns": 6, "rows": 6, "side": 40, "gap": 0.3})}
    for kind in boards:
        (tmp_path / kind).mkdir()
        for name in ("turned", "whole"):
            shutil.copy(pictures / f"{kind}_{name}.jpg", tmp_path / kind)
        (tmp_path / kind / "times.csv").write_text("frame,time_s\n0,0\n1,1\n")
    one = studio(*boards)
    page = one.page
    one.step("camera")
    page.click("#way-board")
    for kind, (unit, values) in boards.items():
        # The second camera has the name of the folder, or a number.
        page.locator(".tabs button[id^=tab-]").nth(list(boards).index(kind)).click()
        page.select_option("#board-kind", kind)
        page.select_option("#board-unit", unit)
        for name, value in values.items():
            page.fill(f"#board-{name}", str(value))
            page.keyboard.press("Tab")
        page.click("#look")
        expect(page.locator("#board-count")).to_contain_text("2 views")
        # One camera at a time.
        page.click("#forget-board")
        expect(page.locator("#board-kind")).to_be_visible()
