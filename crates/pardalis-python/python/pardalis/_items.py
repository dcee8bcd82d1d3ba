"""The items of a batch: which scene is tracked with which recording and seed, and what each result depends on."""

from __future__ import annotations

import functools
import hashlib
import importlib
import json
import operator
import os
import re
import sys
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ._pardalis import __version__, toml_text

Scene = str | os.PathLike[str] | Mapping[str, Any]
Source = str | os.PathLike[str] | Mapping[str, Any]

# The name of the recording where a scene tracks what it names itself.
_OWN = "own"
_NAME = re.compile(r"[A-Za-z0-9_-]{1,64}")
# Keys of scenes that name files. Images and videos are large, and known by size and time; the others by their contents.
RECORDED = ("images", "video", "mcap")
CONTENTS = ("calibration", "colors", "detections", "file", "mask", "measurements", "odometry", "poses")
# Keys of a camera that belong to images, videos or recordings of robots alone.
_ONLY_OF = {"images": ("images", "fps"), "video": ("video", "input", "yuv"), "mcap": ("mcap", "topic")}
# Keys of platforms and targets that name what was measured of them during a recording: a platform has one of them.
_MEASURED = {"platforms": ("odometry", "poses"), "targets": ("measurements",)}
_IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png")
_MCAP_SUFFIX = ".mcap"
# Part of what an item's results depend on: another number when the same input is to give other files.
_FORMAT = 1
_MAX_SEED = 2**32 - 1


@dataclass(frozen=True)
class Commands:
    """Options of the commands; results depend on all but the number of threads."""

    track: tuple[str, ...]
    evaluate: tuple[str, ...]
    threads: int


@dataclass(frozen=True)
class Item:
    """A scene, a recording and a seed: all that a worker needs, which may be on another computer."""

    scene: str
    recording: str
    seed: int
    # The scene file, with absolute paths.
    text: str
    truth: str | None
    commands: Commands
    # Of everything that its result depends on.
    key: str
    folder: Path
    # Of Pardalis, where the batch was started.
    version: str = __version__

    @property
    def name(self) -> str:
        return f"{self.scene}.{self.recording}.{self.seed}"

    @property
    def path(self) -> Path:
        return self.folder / "tracks" / f"{self.name}.parquet"

    @property
    def replaced(self) -> Path:
        """Where an earlier result is until there is another."""
        return self.folder / "replaced" / self.path.name


def planned(
    scenes: Scene | Mapping[str, Scene],
    recordings: Mapping[str, Mapping[str, Source]] | None,
    truths: Mapping[str, str | os.PathLike[str]] | None,
    seeds: Iterable[int] | None,
    commands: Commands,
    folder: Path,
) -> list[Item]:
    """Return the items in their order: by scene, recording and seed, each as given."""
    named_scenes = _named(scenes)
    for name in (*named_scenes, *(recordings or ())):
        if not _NAME.fullmatch(name):
            raise ValueError(f'"{name}" is the name of a scene or recording; allowed: 1 to 64 of A-Z a-z 0-9 _ -')
    truth_files = _truth_files(truths or {}, named_scenes if recordings is None else recordings)
    seed_list = None if seeds is None else list(dict.fromkeys(map(operator.index, seeds)))
    stamp = functools.cache(_stamp)
    items = []
    for scene_name, scene in named_scenes.items():
        table = _read(scene_name, scene)
        own_seed = operator.index(table.pop("seed", 1))
        for recording_name, sources in ({_OWN: {}} if recordings is None else recordings).items():
            shown = _with_sources(table, scene_name, recording_name, sources)
            truth = truth_files.get(scene_name if recordings is None else recording_name)
            # Stamps stand for paths: folders that are moved are still known.
            parts = [_FORMAT, __version__, scene_name, recording_name, toml_text(_with_files(shown, stamp)), commands.track]
            parts += [] if truth is None else [stamp("truth", truth), commands.evaluate]
            text = toml_text(shown)
            for seed in [own_seed] if seed_list is None else seed_list:
                if not 0 <= seed <= _MAX_SEED:
                    raise ValueError(f"a seed is {seed}; allowed: 0 to {_MAX_SEED}")
                key = hashlib.sha256(json.dumps([*parts, seed]).encode()).hexdigest()
                items.append(Item(scene_name, recording_name, seed, text, truth, commands, key, folder))
    return items


def _named(scenes: Scene | Mapping[str, Scene]) -> Mapping[str, Scene]:
    if not isinstance(scenes, Mapping):
        return {Path(scenes).stem: scenes}
    # Every scene has cameras.
    return {"scene": scenes} if "cameras" in scenes else scenes


def _truth_files(truths: Mapping[str, str | os.PathLike[str]], known: Iterable[str]) -> dict[str, str]:
    files = {}
    for name, truth in truths.items():
        if name not in known:
            raise ValueError(f'truths: there is no "{name}"; allowed: {", ".join(known)}')
        path = os.path.abspath(truth)
        path = os.path.join(path, "truth.csv") if os.path.isdir(path) else path
        if not os.path.isfile(path):
            raise ValueError(f'truths: {path}, that of "{name}", is not there; check its name')
        files[name] = path
    return files


def _read(name: str, scene: Scene) -> dict[str, Any]:
    """Return a scene as a dictionary whose paths are absolute."""
    if isinstance(scene, Mapping):
        return _with_files(scene, lambda _, path: os.path.abspath(path))
    path = Path(os.path.abspath(scene))
    toml = needed("tomllib" if sys.version_info >= (3, 11) else "tomli", "tomli")
    try:
        table = toml.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ValueError(f'{scene}, the scene "{name}", cannot be read: {error}') from error
    return _with_files(table, lambda _, file: os.path.join(path.parent, file))


def _with_files(table: Mapping[str, Any], change: Callable[[str, str], str]) -> dict[str, Any]:
    """Return a copy of a scene in which `change`, given key and path, replaces the names of files."""
    changed: dict[str, Any] = {}
    for key, value in table.items():
        if isinstance(value, Mapping):
            changed[key] = _with_files(value, change)
        elif key in (*RECORDED, *CONTENTS) and isinstance(value, (str, os.PathLike)):
            if value == "-" or "://" in os.fspath(value):
                raise ValueError(f'{key} = "{value}" is live; a batch tracks recordings: give the name of a file or folder')
            changed[key] = change(key, os.fspath(value))
        else:
            changed[key] = value
    return changed


def _with_sources(table: dict[str, Any], scene: str, recording: str, sources: Mapping[str, Source]) -> dict[str, Any]:
    """Return a copy of a scene whose cameras show a recording, and whose platforms and targets were measured in it."""
    if not isinstance(sources, Mapping):
        raise ValueError(
            f'recordings: "{recording}" is {sources!r}; allowed: a dictionary by the names of cameras, platforms and targets'
        )
    tables = {kind: dict(table.get(kind, {})) for kind in ("cameras", *_MEASURED)}
    for name, source in sources.items():
        kinds = [kind for kind, named in tables.items() if name in named]
        if len(kinds) > 1:
            first, second = (kind.removesuffix("s") for kind in kinds[:2])
            raise ValueError(f'recordings: "{name}" is a {first} and a {second} of scene "{scene}"; rename one of them there')
        if not kinds:
            known = ", ".join(known for named in tables.values() for known in named)
            raise ValueError(
                f'recordings: "{recording}" is of the camera, platform or target "{name}", and scene "{scene}" has only {known}'
            )
        named = tables[kinds[0]]
        if kinds[0] == "cameras":
            named[name] = _camera(named[name], name, recording, source)
        else:
            named[name] = _measured(named[name], kinds[0], name, recording, source)
    # Without a source, they would be those that the scene names, of another day.
    measured = [name for name, target in tables["targets"].items() if _names_measured(target)]
    expected: dict[str, Iterable[str]] = {**tables, "targets": measured}
    for kind, names in expected.items():
        if missing := [name for name in names if sources and name not in sources]:
            raise ValueError(f'recordings: "{recording}" has nothing of the {kind} {", ".join(missing)} of scene "{scene}"; give {{}} to leave them')
    return {**table, **{kind: named for kind, named in tables.items() if named}}


def _names_measured(target: Any) -> bool:
    return isinstance(target, Mapping) and any(key in target for key in _MEASURED["targets"])


def _camera(camera: Mapping[str, Any], name: str, recording: str, source: Source) -> dict[str, Any]:
    """Return a copy of a camera's table that shows a recording."""
    if not isinstance(source, Mapping):
        name_of_file = os.fspath(source).lower()
        is_images = os.path.isdir(source) or name_of_file.endswith(_IMAGE_SUFFIXES)
        source = {"images" if is_images else "mcap" if name_of_file.endswith(_MCAP_SUFFIX) else "video": source}
    if "detections" in camera and source and "detections" not in source:
        raise ValueError(f'recordings: "{recording}" has no detections of the camera "{name}"; give {{"video": ..., "detections": ...}}')
    left_out: set[str] = set()
    if any(kind in source for kind in _ONLY_OF):
        left_out = {key for kind, keys in _ONLY_OF.items() if kind in camera and kind not in source for key in keys}
    kept = {key: value for key, value in camera.items() if key not in left_out}
    return kept | _with_files(source, lambda _, path: os.path.abspath(path))


def _measured(table: Mapping[str, Any], kind: str, name: str, recording: str, source: Source) -> dict[str, Any]:
    """Return a copy of the table of a platform or a target with what was measured of it in a recording."""
    allowed = _MEASURED[kind]
    if not isinstance(source, Mapping):
        keys = [key for key in allowed if key in table] if len(allowed) > 1 else allowed
        if len(keys) != 1:
            given = " or ".join(f'{{"{key}": ...}}' for key in allowed)
            raise ValueError(f'recordings: "{recording}" has {source!r} for the {kind.removesuffix("s")} "{name}"; give {given}')
        source = {keys[0]: source}
    kept = {key: value for key, value in table.items() if key not in allowed or not any(key in source for key in allowed)}
    return kept | _with_files(source, lambda _, path: os.path.abspath(path))


def _stamp(key: str, path: str) -> str:
    """Return a text that changes with what the file or folder of this key holds."""
    # A calibration may be in a recording.
    if key not in RECORDED and not path.lower().endswith(_MCAP_SUFFIX):
        # A missing file is an error of its items, in the words of the program.
        return hashlib.sha256(Path(path).read_bytes()).hexdigest() if os.path.isfile(path) else "missing"
    if os.path.isdir(path):
        files = sorted(entry.path for entry in os.scandir(path))
    elif os.path.isfile(path) or not os.path.exists(path):
        files = [path]
    else:
        raise ValueError(f'{key} = "{path}" is a device; a batch tracks recordings: give the name of a file or folder')
    sizes = []
    for file in files:
        if os.path.exists(file):
            about = os.stat(file)
            sizes.append([os.path.relpath(file, path), about.st_size, about.st_mtime_ns])
    return hashlib.sha256(json.dumps(sizes).encode()).hexdigest()


def needed(module: str, package: str) -> Any:
    """Import a package that is only needed here."""
    try:
        return importlib.import_module(module)
    except ImportError as error:
        raise ImportError(f'pardalis.batch needs the package {package}: pip install "{package}"') from error
