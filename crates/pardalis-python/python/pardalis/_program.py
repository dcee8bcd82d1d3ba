"""Commands of the program for Python: each runs in a process of its own, and its errors are exceptions."""

from __future__ import annotations

import csv
import json
import os
import signal
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ._pardalis import toml_text

TEXT_COLUMNS = ("target", "state")
_WARNING, _ERROR = "warning: ", "error: "
_WAKE_S = 0.5


def run(*arguments: str | float | os.PathLike[str]) -> str:
    """Run a command of the program, such as `run("learn", "--image", "a.jpg", "-o", "ball.colors.toml")`, and return what it prints.

    `run("--help")` lists the commands. Invalid input raises a `ValueError`, any other failure a `RuntimeError`, both with the words of
    the program; its warnings are Python's. When Python is interrupted, the program stops as with Ctrl-C, and keeps what it has written.
    """
    ended = call(*arguments)
    for message in ended.warnings:
        warnings.warn(message, stacklevel=2)
    if ended.error is not None:
        raise ended.error
    print(*ended.notes, sep="\n", end="\n" * bool(ended.notes), file=sys.stderr)
    return ended.printed


@dataclass(frozen=True)
class Ended:
    """What a command printed and said, and the error that ended it, if one did."""

    printed: str
    warnings: list[str]
    notes: list[str]
    error: ValueError | RuntimeError | None


def call(
    *arguments: str | float | os.PathLike[str],
    watch: Callable[[subprocess.Popen[str]], None] | None = None,
    stop: signal.Signals = signal.SIGINT,
) -> Ended:
    """Run a command of the program.

    `watch` gets its process, for instance to end it from another thread. When Python is interrupted, the program gets the signal `stop`.
    """
    command = [sys.executable, "-m", __package__, *map(_text, arguments)]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=pipe, stderr=pipe, encoding="utf-8") as process:
        try:
            if watch is not None:
                watch(process)
            printed, messages = _communicated(process)
        except BaseException:
            process.send_signal(stop)
            process.communicate()
            raise
    warned, notes = [], []
    for message in _messages(messages):
        if message.startswith(_WARNING):
            warned.append(message.removeprefix(_WARNING))
        else:
            notes.append(message.removeprefix(_ERROR))
    error: ValueError | RuntimeError | None = None
    if process.returncode != 0:
        text = "\n".join(notes) or f"pardalis {arguments[0]} ended with code {process.returncode}"
        error = ValueError(text) if process.returncode == 2 else RuntimeError(text)
    return Ended(printed, warned, notes, error)


def _communicated(process: subprocess.Popen[str]) -> tuple[str, str]:
    while True:
        try:
            return process.communicate(timeout=_WAKE_S)
        except subprocess.TimeoutExpired:
            # Lets an interrupt in that comes without a signal, as in workers of Ray.
            pass


def _text(argument: str | float | os.PathLike[str]) -> str:
    return os.fspath(argument) if isinstance(argument, os.PathLike) else str(argument)


def _messages(text: str) -> list[str]:
    """Separate the program's messages, which may have several lines."""
    messages: list[str] = []
    for line in text.splitlines():
        if line.startswith((_WARNING, _ERROR)) or not messages:
            messages.append(line)
        else:
            messages[-1] += "\n" + line
    return messages


@dataclass(frozen=True)
class Plot:
    """A plot of a run, in an SVG file. Notebooks show it."""

    path: Path

    def _repr_svg_(self) -> str:
        return self.path.read_text(encoding="utf-8")


@dataclass(frozen=True)
class Tracks:
    """The tracks of a run: one row for each image (or images of one time) and target.

    `columns` maps the names of columns to arrays: whole numbers for `frame`, text for `target` and `state`, otherwise numbers, NaN where
    there is none. `pandas.DataFrame(tracks.columns)` and `polars.DataFrame(tracks.columns)` are tables of them. `summary` is what
    the run says of cameras, targets and settings.
    """

    folder: Path
    columns: Mapping[str, NDArray[Any]] = field(repr=False)
    summary: Mapping[str, Any] = field(repr=False)

    @property
    def targets(self) -> list[str]:
        """The names of the targets that have rows."""
        return list(dict.fromkeys(self.columns["target"].tolist()))

    def of(self, target: str) -> dict[str, NDArray[Any]]:
        """Return the rows of one target."""
        rows = self.columns["target"] == target
        if not rows.any():
            raise ValueError(f'no row is of "{target}"; allowed: {", ".join(self.targets)}')
        return {name: values[rows] for name, values in self.columns.items()}

    def positions_m(self, target: str) -> NDArray[np.float64]:
        """Return the positions of a target in the world (N x 3, metres), NaN where it was not found."""
        rows = self.of(target)
        return np.stack([rows[name] for name in ("x_m", "y_m", "z_m")], axis=1)

    @property
    def plots(self) -> dict[str, Plot]:
        """The plots of the run, by name: `above`, `side`, `3d`, `coordinates`. There are none with `plots=False`."""
        return {path.stem: Plot(path) for path in sorted(self.folder.glob("*.svg"))}

    def __len__(self) -> int:
        return len(self.columns["frame"])


def read_tracks(folder: str | os.PathLike[str]) -> Tracks:
    """Read the results of `track`, or of the program, from their folder."""
    folder = Path(folder)
    with open(folder / "tracks.csv", newline="", encoding="utf-8") as file:
        names, *rows = csv.reader(file)
    columns = {}
    for name, values in zip(names, zip(*rows) if rows else [()] * len(names)):
        if name in TEXT_COLUMNS:
            columns[name] = np.array(values, dtype=str)
        elif name == "frame":
            columns[name] = np.array(values, dtype=np.int64)
        else:
            columns[name] = np.array([value or "nan" for value in values], dtype=np.float64)
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    return Tracks(folder, columns, summary)


def track(
    scene: str | os.PathLike[str] | Mapping[str, Any],
    output: str | os.PathLike[str],
    *,
    seed: int | None = None,
    frames: int | None = None,
    smooth: bool = False,
    annotate: bool = False,
    explain: bool = False,
    plots: bool = True,
    mcap: str | os.PathLike[str] | None = None,
) -> Tracks:
    """Track the targets of a scene through its images or videos, write the results into the folder `output`, and return the tracks.

    The scene is a file, or a dictionary with the same tables and keys, whose paths start at the current folder. The results are the same
    bytes as those of `pardalis track`, and the keywords are its options.
    """
    options = [f"--{name}={value}" for name, value in (("seed", seed), ("frames", frames)) if value is not None]
    flags = {"smooth": smooth, "annotate": annotate, "explain": explain, "no-plots": not plots}
    options += [f"--{name}" for name, is_on in flags.items() if is_on]
    options += [] if mcap is None else [f"--mcap={_text(mcap)}"]
    with _file_of(scene, "scene") as path:
        run("track", *options, "--output", output, "--", path)
    return read_tracks(output)


def simulate(
    world: str | os.PathLike[str] | Mapping[str, Any],
    output: str | os.PathLike[str],
    *,
    seed: int | None = None,
    force: bool = False,
) -> Path:
    """Render the images of a synthetic world into the folder `output`, and return that folder.

    The world is a file, or a dictionary with the same tables and keys, whose paths start at the current folder. The folder has the images of each
    camera, truth.csv, and scene.toml, which `track` reads. `force` replaces an earlier sequence.
    """
    options = [] if seed is None else [f"--seed={seed}"]
    options += ["--force"] if force else []
    with _file_of(world, "world") as path:
        run("simulate", *options, "--output", output, "--", path)
    return Path(output)


def evaluate(
    tracks: Tracks | str | os.PathLike[str],
    truth: str | os.PathLike[str],
    *options: str,
) -> dict[str, Any]:
    """Compare tracks with the truth, a file or the folder that holds truth.csv, and return errors and other figures.

    The truth may be a table of circles that were drawn around the object in some images.

    `options` are those of `pardalis evaluate`, such as `"--interpolate"` or `"--from=2.0"`.
    """
    folder = tracks.folder if isinstance(tracks, Tracks) else tracks
    figures: dict[str, Any] = json.loads(run("evaluate", "--json=-", *options, "--", folder, truth))
    return figures


@contextmanager
def _file_of(table: str | os.PathLike[str] | Mapping[str, Any], what: str) -> Iterator[Path]:
    """Give the file of a scene or world; one of a dictionary is in the current folder, where its paths start, for as long as it is needed."""
    if not isinstance(table, Mapping):
        yield Path(table)
        return
    text = toml_text(dict(table))
    number, name = tempfile.mkstemp(dir=".", prefix=f"{what}-", suffix=".toml")
    path = Path(name)
    try:
        with open(number, "w", encoding="utf-8") as file:
            file.write(text)
        yield path
    finally:
        path.unlink()
