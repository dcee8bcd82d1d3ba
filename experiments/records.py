"""Records of experiments that are measured from Python."""

import csv
import platform
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def write(folder, name, rows, command, *versions):
    """Write rows, dictionaries with the same keys, as the record `name` in a folder, with the command and the versions of packages that they come from."""
    git = lambda *arguments: subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()
    # Before the record itself is such a change.
    changed = " with uncommitted changes" if git("status", "--porcelain", "--untracked-files=no") else ""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    with open(folder / f"{name}.csv", "w", newline="") as file:
        writer = csv.DictWriter(file, rows[0], lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    load = Path("/proc/loadavg").read_text().split()[0]
    facts = {
        "command": command,
        "commit": git("rev-parse", "HEAD") + changed,
        "python": ", ".join([platform.python_version(), *versions]),
        "load": f"{load} processes, the mean of the last minute",
    }
    (folder / f"{name}.facts.txt").write_text("".join(f"{key:<10}{value}\n" for key, value in facts.items()))
