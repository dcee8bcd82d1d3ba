"""Batches: each recording with each scene and seed, on the cores of one computer or on a cluster, with the results as Parquet.

    import pardalis.batch

    pardalis.batch.run("scene.toml", "results", seeds=range(1, 101))

Needs the package pyarrow. Import this module by its name: `import pardalis` alone leaves it out.
"""

from __future__ import annotations

import concurrent.futures
import contextlib
import functools
import json
import os
import queue
import re
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import uuid
from collections import Counter, deque
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import timedelta
from pathlib import Path
from typing import Any

from ._items import Commands, Item, Scene, Source, needed, planned
from ._pardalis import __version__
from ._program import TEXT_COLUMNS, call

__all__ = ["Batch", "run"]

_METADATA = b"pardalis"
_STATES = ("tracking", "occluded", "searching", "lost")
# The columns of `items.parquet`, in their order, with what they hold.
_ITEM_COLUMNS = (
    ("text", ("scene", "recording")),
    ("whole", ("seed",)),
    ("text", ("status", "error", "warnings", "target")),
    ("whole", ("rows", *_STATES)),
    ("number", ("coverage",)),
    ("whole", ("lost_frames",)),
    ("number", ("position_rmse_m", "position_median_m", "position_max_m", "gospa_m")),
    ("whole", ("switches",)),
    ("number", ("on_object_share", "elsewhere_share")),
)
# How long an interrupted run waits for its items to end.
_STOP_S = 10.0
_WAKE_S = 0.5
# How often progress is printed.
_TERMINAL_S, _LINES_S = 0.2, 30.0


@dataclass(frozen=True)
class Batch:
    """What became of a batch.

    `folder` has the results: `items.parquet` and the folder `tracks`. `items` is the number of items, and `tracked` how many of them
    this run has tracked; those that earlier runs had finished were not tracked again. `failures` maps the names of the items that
    failed, such as `scene.monday.1`, to their errors.
    """

    folder: Path
    items: int
    tracked: int
    failures: Mapping[str, str] = field(repr=False)


def run(
    scenes: Scene | Mapping[str, Scene],
    output: str | os.PathLike[str],
    *,
    recordings: Mapping[str, Mapping[str, Source]] | None = None,
    truths: Mapping[str, str | os.PathLike[str]] | None = None,
    seeds: Iterable[int] | None = None,
    frames: int | None = None,
    smooth: bool = False,
    evaluate_options: Sequence[str] = (),
    engine: Any = "local",
    workers: int | None = None,
    threads: int = 1,
    retries: int = 2,
    progress: bool = True,
) -> Batch:
    """Track each recording with each scene and seed, and write the results into the folder `output`.

    A scene is a file or a dictionary, as for `track`; several have names: `{"plain": "plain.toml", "prior": "prior.toml"}`. `recordings`
    maps names to what the cameras of the scenes show: `{"monday": {"cam1": "monday.mp4"}}`, with a video or a folder of images, or a
    dictionary of the camera's keys that differ. Without it, each scene tracks what it names itself, and its recording is called "own".
    The motion of platforms and the measurements of targets belong to a recording, too: `{"monday": {"cam1": "monday.mp4", "robot":
    "odometry.csv", "ball": "measurements.csv"}}`.
    `seeds` default to that of each scene. `truths` maps recordings, or scenes without `recordings`, to the truth that each item is
    evaluated with, given `evaluate_options`. `frames` and `smooth` are those of `track`. Paths start at the current folder, those in the
    file of a scene at its folder.

    The folder then has a file per item in `tracks`, with the rows of `tracks.csv` after the columns `scene`, `recording` and `seed`, and
    `items.parquet`, with one row per item and target: status, error, warnings, the number of rows in each state, and errors in metres.
    The same arguments and versions give the same bytes for any engine, `workers` and `threads`.

    What is finished is not tracked again, unless its scene, a file that it names, an option or the version of Pardalis has changed.
    Invalid input fails at once; other failures are tried up to `retries` more times. An item that fails does not stop the others, and the
    next run tries it again. Ctrl-C and SIGTERM end the running items and keep the finished ones.

    `engine` is "local", "ray" (the Ray that is initialised, or the cluster that `ray.init()` finds, or else this computer), "dask" (the
    current client, or a new one) or a client of Dask. All computers of a cluster need Pardalis and the same paths. At most `workers`
    items run at once: by default as many as there are cores, or as the cluster has room for. Each takes `threads` of them; more are of
    use where there are fewer items than cores.
    """
    _check(workers, threads, retries, frames, recordings, truths, evaluate_options)
    needed("pyarrow", "pyarrow")
    folder = Path(os.path.abspath(output))
    options = ["--no-plots"]
    options += [] if frames is None else [f"--frames={frames}"]
    options += ["--smooth"] if smooth else []
    commands = Commands(tuple(options), tuple(evaluate_options), threads)
    items = planned(scenes, recordings, truths, seeds, commands, folder)
    # At once; None for as many as a cluster has room for.
    limit = workers or (max(1, _cores() // threads) if engine == "local" else None)
    starting = _engine(engine, limit, threads)
    with _terminable(), _alone(folder):
        _refuse_others(folder, items)
        records = _known(items)
        waiting = [item for item in items if not _is_whole(records[item.name])]
        failures: dict[str, str] = {}
        report = _Progress(len(items), len(waiting), is_on=progress)
        try:
            if waiting:
                with (
                    starting as (submit, stop),
                    # Closed at once on an interrupt, which stops the items before the engine waits for them.
                    contextlib.closing(_outcomes(waiting, submit, stop, limit, retries)) as outcomes,
                ):
                    for item, outcome in outcomes:
                        records[item.name] = outcome.record or records[item.name]
                        if outcome.error is not None:
                            failures[item.name] = outcome.error
                        else:
                            item.replaced.unlink(missing_ok=True)
                        report.show(len(failures))
        finally:
            for item in waiting:
                if item.name not in failures and not _is_whole(records[item.name]):
                    # It may have ended while the run was interrupted.
                    records[item.name] = _record(item, item.path)
            tracked = sum(_is_whole(records[item.name]) for item in waiting)
            _write_items(folder, items, records, failures)
            for name in (".partial", "replaced"):
                with contextlib.suppress(OSError):
                    # Unless it has results of items that have failed.
                    (folder / name).rmdir()
            report.end(tracked, failures, folder)
    # In the order of the items, not in that in which they ended.
    in_order = {item.name: failures[item.name] for item in items if item.name in failures}
    return Batch(folder, len(items), tracked, in_order)


def _check(
    workers: Any, threads: Any, retries: Any, frames: Any, recordings: Any, truths: Any, evaluate_options: Any
) -> None:
    """Fail if an argument of `run` cannot be used."""
    for name, value, least in (("workers", workers, 1), ("threads", threads, 1), ("retries", retries, 0), ("frames", frames, 1)):
        # Also those of NumPy.
        if value is not None and (not hasattr(value, "__index__") or value < least):
            raise ValueError(f"{name} is {value!r}; allowed: a whole number, {least} or more")
    for name, given in (("recordings", recordings), ("truths", truths)):
        if given is not None and not isinstance(given, Mapping):
            raise ValueError(f'{name} is {given!r}; allowed: a dictionary by the names of recordings')
    if isinstance(evaluate_options, str):
        raise ValueError(f'evaluate_options is a text; allowed: a list, ["{evaluate_options}"]')


@contextlib.contextmanager
def _terminable() -> Iterator[None]:
    """Let SIGTERM end the batch like an interrupt, unless the program has a handler of its own."""

    def end(number: int, _: Any) -> None:
        # The exit code of a program that a signal has ended, for shells.
        raise SystemExit(128 + number)

    is_free = signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    # Python lets no other thread do this.
    if is_free and threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        # Ray sets one of its own.
        if signal.getsignal(signal.SIGTERM) is end:
            signal.signal(signal.SIGTERM, signal.SIG_DFL)


@contextlib.contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Fail if another batch is writing into the folder; otherwise keep others out. The system ends this with the process, however that ends."""
    if sys.platform == "win32":
        # It has no such locks.
        yield
        return
    import fcntl

    folder.mkdir(parents=True, exist_ok=True)
    path = folder / ".lock"
    while True:
        with open(path, "ab") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                message = f"another batch is writing into {folder}; wait until it has ended, or give another output folder"
                raise RuntimeError(message) from None
            except OSError:
                # Some file systems of clusters have no locks.
                pass
            if not (path.exists() and os.path.samestat(os.stat(path), os.fstat(file.fileno()))):
                # The one before has removed it meanwhile.
                continue
            try:
                yield
            finally:
                path.unlink(missing_ok=True)
            return


@dataclass(frozen=True)
class _Outcome:
    """The record of an item, or its error; both if it was tracked and could not be evaluated."""

    record: dict[str, Any] | None
    error: str | None = None
    is_final: bool = True


# --- What is finished ---


def _record(item: Item, path: Path) -> dict[str, Any] | None:
    """Return the record of an item if the file at this path was made from the same input."""
    parquet = needed("pyarrow.parquet", "pyarrow")
    try:
        # At the end of the file: a file without its end has none.
        record: dict[str, Any] = json.loads(parquet.read_schema(path).metadata[_METADATA])
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return record if record.get("key") == item.key else None


def _is_whole(record: Mapping[str, Any] | None) -> bool:
    """Report whether nothing is left to do for an item. One that could not be evaluated is tried again."""
    return record is not None and "error" not in record


def _known(items: list[Item]) -> dict[str, dict[str, Any] | None]:
    """Return the records of the items that earlier runs have tracked, and put aside the results of other input."""
    records = {item.name: _record(item, item.path) for item in items}
    for item in items:
        if records[item.name] is not None:
            continue
        if (record := _record(item, item.replaced)) is not None:
            # An earlier run with other input failed, and this one is as before.
            item.path.parent.mkdir(exist_ok=True)
            os.replace(item.replaced, item.path)
            records[item.name] = record
        elif item.path.exists():
            # Of an earlier scene, or half of it was lost: `tracks` shall not have it if the item fails.
            item.replaced.parent.mkdir(exist_ok=True)
            os.replace(item.path, item.replaced)
    return records


def _refuse_others(folder: Path, items: list[Item]) -> None:
    """Fail if the folder has results of other items: readers of the folder would take them for results of this batch."""
    known = {item.path.name for item in items}
    others = sorted(path.name for path in (folder / "tracks").glob("*.parquet") if path.name not in known)
    if others:
        raise ValueError(
            f"{folder / 'tracks'} has {len(others)} files of items that are not in this batch, such as {others[0]}; "
            "give another output folder, or remove them"
        )


def _write_items(
    folder: Path, items: list[Item], records: Mapping[str, dict[str, Any] | None], failures: Mapping[str, str]
) -> None:
    """Write the table of all items."""
    pyarrow = needed("pyarrow", "pyarrow")
    rows = []
    for item in items:
        row = {"scene": item.scene, "recording": item.recording, "seed": item.seed}
        record = records[item.name]
        error = failures.get(item.name, None if record is None else record.get("error"))
        if record is not None:
            row |= {"status": "done" if error is None else "failed", "error": error}
            row["warnings"] = "\n".join(record["warnings"]) or None
            rows += [{**row, **target} for target in record["targets"]]
        elif error is not None:
            rows.append({**row, "status": "failed", "error": error})
        else:
            rows.append({**row, "status": "open"})
    kinds = {"text": pyarrow.string(), "whole": pyarrow.int64(), "number": pyarrow.float64()}
    schema = pyarrow.schema([(name, kinds[kind]) for kind, names in _ITEM_COLUMNS for name in names])
    _write(pyarrow.Table.from_pylist(rows, schema), folder / "items.parquet", folder)


def _write(table: Any, path: Path, folder: Path) -> None:
    """Write a table so that its file is always whole."""
    partial = folder / ".partial" / f"{path.name}.{uuid.uuid4()}"
    for parent in (partial.parent, path.parent):
        parent.mkdir(parents=True, exist_ok=True)
    needed("pyarrow.parquet", "pyarrow").write_table(table, partial, compression="zstd")
    os.replace(partial, path)


# --- Tracking one item, on a worker ---


def _track(item: Item, watch: Callable[[subprocess.Popen[str]], None] | None = None) -> _Outcome:
    """Track an item, and write its file."""
    if item.version != __version__:
        here = f"{socket.gethostname()} has Pardalis {__version__}"
        return _Outcome(None, f"{here}, and the batch was started with {item.version}; install the same version on all computers")
    with tempfile.TemporaryDirectory(prefix="pardalis-") as work:
        scene = os.path.join(work, "scene.toml")
        try:
            Path(scene).write_text(item.text, encoding="utf-8")
            options = [f"--seed={item.seed}", f"--threads={item.commands.threads}", *item.commands.track]
            # Nothing is kept of an item that is interrupted. Workers of Ray, and so the program there, block SIGINT.
            run_command = functools.partial(call, watch=watch, stop=signal.SIGTERM)
            tracked = run_command("track", *options, "--output", work, "--", scene)
            if tracked.error is not None:
                raise tracked.error
            warnings = tracked.warnings
            figures: dict[str, Any] = {}
            error: ValueError | RuntimeError | None = None
            table = _table(item, os.path.join(work, "tracks.csv"))
            # Without rows, as of a crowd that is never there, there is nothing to compare.
            if item.truth is not None and len(table) > 0:
                evaluated = run_command("evaluate", "--json=-", *_evaluate_options(item, table), "--", work, item.truth)
                warnings, error = warnings + evaluated.warnings, evaluated.error
                figures = json.loads(evaluated.printed) if error is None else {}
            summary = json.loads(Path(work, "summary.json").read_text(encoding="utf-8"))
            record: dict[str, Any] = {
                "key": item.key,
                "warnings": [_told(text, scene, item) for text in warnings],
                "targets": [_row(name, target["rows"], figures) for name, target in summary["targets"].items()],
            }
            if error is not None:
                # The tracks are kept.
                record["error"] = f"evaluation: {_told(str(error), scene, item)}"
            table = table.replace_schema_metadata({_METADATA: json.dumps(record)})
            _write(table, item.path, item.folder)
        except Exception as failure:
            return _Outcome(None, _told(str(failure), scene, item), isinstance(failure, ValueError))
        return _Outcome(record, record.get("error"), isinstance(error, ValueError))


def _evaluate_options(item: Item, table: Any) -> list[str]:
    # What was not tracked is no miss.
    is_part = any(option.startswith("--frames") for option in item.commands.track)
    has_end = any(option.startswith("--to") for option in item.commands.evaluate)
    end = [f"--to={max(table['time_s'].to_pylist())}"] if is_part and not has_end else []
    return [*end, *item.commands.evaluate]


def _told(message: str, scene: str, item: Item) -> str:
    """Return a message of the program without the place of the worker's scene and the lines there: nobody sees that file."""
    name = f'scene "{item.scene}"'
    message = message.replace(scene, name).replace(os.path.dirname(scene) + os.sep, "")
    if message.startswith(name):
        message = re.sub(rf"(?m)^(  |{name}: )line \d+: ", r"\1", message)
        message = re.sub(r" \(line \d+\)", "", message)
    return message


def _row(target: str, states: Mapping[str, int], figures: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values of `items.parquet` for a target."""
    row: dict[str, Any] = {"target": target, "rows": sum(states.values()), **{state: states[state] for state in _STATES}}
    for crowd in figures.get("crowds", ()):
        if crowd["crowd"] == target:
            return row | {name: crowd[name] for name in ("gospa_m", "switches")}
    compared_targets = [compared for compared in figures.get("targets", ()) if compared["target"] == target]
    if "circles" in figures:
        # One for each camera.
        sums = {
            name: sum(compared[f"{name}_frames"] for compared in compared_targets) for name in ("on_object", "visible", "elsewhere")
        }
        frames = sum(compared["frames"] for compared in compared_targets)
        if sums["visible"] > 0:
            row["on_object_share"] = sums["on_object"] / sums["visible"]
        if frames > 0:
            row["elsewhere_share"] = sums["elsewhere"] / frames
        return row
    for compared in compared_targets:
        errors = compared["all"]["errors"]["position_m"]
        row |= {f"position_{name}_m": errors[name] for name in ("rmse", "median", "max")}
        row |= {name: compared[name] for name in ("coverage", "lost_frames")}
    return row


def _table(item: Item, path: str) -> Any:
    """Read the rows of an item: N rows, three columns more than `tracks.csv`."""
    pyarrow, csv = needed("pyarrow", "pyarrow"), needed("pyarrow.csv", "pyarrow")
    with open(path, encoding="utf-8") as file:
        names = file.readline().rstrip().split(",")
    kinds = {"frame": pyarrow.int64(), **dict.fromkeys(TEXT_COLUMNS, pyarrow.string())}
    types = {name: kinds.get(name, pyarrow.float64()) for name in names}
    rows = csv.read_csv(path, csv.ReadOptions(use_threads=False), convert_options=csv.ConvertOptions(column_types=types))
    for name in ("seed", "recording", "scene"):
        rows = rows.add_column(0, name, pyarrow.repeat(getattr(item, name), len(rows)))
    return rows


# --- Engines ---

_Future = concurrent.futures.Future[_Outcome]
_Submit = Callable[[Item], _Future]
_Stop = Callable[[Iterable[_Future]], None]
_Engine = tuple[_Submit, _Stop]


def _outcomes(
    items: Iterable[Item], submit: _Submit, stop: _Stop, limit: int | None, retries: int
) -> Generator[tuple[Item, _Outcome], None, None]:
    """Track items, `limit` at once, and yield what became of each when it has succeeded or failed for good. Stop them when interrupted."""
    running: set[_Future] = set()
    try:
        # Python raises an interrupt between any two instructions, and for a few of them not into the `try` around them. Here, none of the loop's is missed.
        yield from _ended(items, running, submit, limit, retries)
    except BaseException:
        stop(running)
        concurrent.futures.wait([future for future in running if not future.done()], _STOP_S)
        raise


def _ended(
    items: Iterable[Item], running: set[_Future], submit: _Submit, limit: int | None, retries: int
) -> Generator[tuple[Item, _Outcome], None, None]:
    """Yield what `_outcomes` does; `running` holds what was begun and has not ended."""
    waiting = deque(items)
    attempts: Counter[str] = Counter()
    ended: queue.SimpleQueue[tuple[Item, _Future]] = queue.SimpleQueue()
    while waiting or running:
        while waiting and (limit is None or len(running) < limit):
            item = waiting.popleft()
            future = submit(item)
            running.add(future)
            future.add_done_callback(functools.partial(lambda item, future: ended.put((item, future)), item))
        try:
            item, future = ended.get(timeout=_WAKE_S)
        except queue.Empty:
            # Lets an interrupt in that another thread has received.
            continue
        running.discard(future)
        outcome = _outcome(future)
        attempts[item.name] += 1
        if outcome.error is None or outcome.is_final or attempts[item.name] > retries:
            yield item, outcome
        else:
            waiting.append(item)


def _outcome(future: concurrent.futures.Future[_Outcome]) -> _Outcome:
    try:
        return future.result()
    except Exception as error:
        # Of the engine: a worker or its computer has ended.
        return _Outcome(None, f"{type(error).__name__}: {error}", is_final=False)


def _engine(engine: Any, limit: int | None, threads: int) -> contextlib.AbstractContextManager[_Engine]:
    """Give the engine's functions that start an item and that stop items."""
    if engine == "local":
        return _local(limit)
    if engine == "ray":
        return _ray(needed("ray", "ray"), threads)
    if engine == "dask" or hasattr(engine, "get_executor"):
        return _dask(needed("distributed", "dask[distributed]"), engine)
    raise ValueError(f'engine is {engine!r}; allowed: "local", "ray", "dask" or a client of Dask')


def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@contextlib.contextmanager
def _local(workers: int | None) -> Iterator[_Engine]:
    # Threads suffice: each item is a process of its own.
    pool = concurrent.futures.ThreadPoolExecutor(workers)
    processes: dict[int, subprocess.Popen[str]] = {}
    is_stopping = threading.Event()

    def watch(process: subprocess.Popen[str]) -> None:
        processes[threading.get_ident()] = process
        if is_stopping.is_set():
            process.terminate()

    def stop(_: Iterable[_Future]) -> None:
        is_stopping.set()
        for process in list(processes.values()):
            process.terminate()

    with pool:
        yield lambda item: pool.submit(_track, item, watch), stop


@contextlib.contextmanager
def _ray(ray: Any, threads: int) -> Iterator[_Engine]:
    is_ours = not ray.is_initialized()
    if is_ours:
        ray.init()
    # Retries are counted here, for all engines alike.
    task = ray.remote(num_cpus=threads, max_retries=0)(_track)
    references: dict[_Future, Any] = {}

    def submit(item: Item) -> _Future:
        reference = task.remote(item)
        future: _Future = reference.future()
        references[future] = reference
        future.add_done_callback(lambda future: references.pop(future, None))
        return future

    def stop(_: Iterable[_Future]) -> None:
        for reference in list(references.values()):
            ray.cancel(reference)

    try:
        yield submit, stop
    finally:
        if is_ours:
            ray.shutdown()


@contextlib.contextmanager
def _dask(distributed: Any, client: Any) -> Iterator[_Engine]:
    is_ours = False
    if client == "dask":
        try:
            client = distributed.default_client()
        except ValueError:
            client, is_ours = distributed.Client(), True
    # Not pure: an item that is tried again is tracked again.
    executor = client.get_executor(pure=False)

    def stop(futures: Iterable[_Future]) -> None:
        # Dask lets items end that have begun.
        for future in futures:
            future.cancel()

    try:
        yield functools.partial(executor.submit, _track), stop
    finally:
        if is_ours:
            client.close()


# --- Progress ---


class _Progress:
    """How many items are done, on standard error: one line that changes in a terminal, otherwise a line now and then."""

    def __init__(self, items: int, waiting: int, *, is_on: bool) -> None:
        self._items, self._waiting, self._ended = items, waiting, 0
        self._is_on = is_on
        self._is_terminal = sys.stderr.isatty()
        self._begin_s = self._shown_s = time.monotonic()

    def show(self, failed: int) -> None:
        """Count an item that has ended."""
        self._ended += 1
        now_s = time.monotonic()
        if self._is_on and now_s - self._shown_s >= (_TERMINAL_S if self._is_terminal else _LINES_S):
            self._shown_s = now_s
            each_s = (now_s - self._begin_s) / self._ended
            left = timedelta(seconds=round(each_s * (self._waiting - self._ended)))
            self._print(f"{self._state(self._ended - failed, failed)}, {60 / each_s:.3g} items/min, {left} left")

    def end(self, tracked: int, failures: Mapping[str, str], folder: Path) -> None:
        """Say what became of all items, and what one of those that failed says."""
        if self._is_on:
            self._print(f"{self._state(tracked, len(failures))}, {tracked} tracked now: {folder}", end="\n")
            for name, error in list(failures.items())[:1]:
                print(f"{name} failed: {error}", file=sys.stderr)

    def _state(self, tracked: int, failed: int) -> str:
        return f"{self._items - self._waiting + tracked} of {self._items} items done, {failed} failed"

    def _print(self, text: str, end: str = "") -> None:
        if self._is_terminal:
            # From the start of the line, and nothing left of a longer one.
            print(f"\r\x1b[K{text}", end=end, file=sys.stderr, flush=True)
        else:
            print(text, file=sys.stderr, flush=True)
