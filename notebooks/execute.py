"""Executes the notebooks of this folder, and fails if a cell of one raises.

    python notebooks/execute.py [--write] [NOTEBOOK.ipynb ...]

Each runs in a temporary folder beside a link to `data`, so that nothing here changes. `--write` stores the outputs in the notebooks, without what differs
from run to run: times of execution, identifiers, and the outputs of cells with the tag `varies`.
"""

import argparse
import sys
import tempfile
import time
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError

FOLDER = Path(__file__).resolve().parent
# For one notebook; each takes seconds.
TIMEOUT_S = 300


def execute(notebook, folder):
    resources = {"metadata": {"path": str(folder)}}
    # Errors only: the kernel warns that it listens on this computer.
    options = ["--IPKernelApp.log_level=40"]
    NotebookClient(notebook, timeout=TIMEOUT_S, kernel_name="python3", resources=resources, extra_arguments=options).execute()


def normalize(notebook):
    notebook.metadata = {
        "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
        "language_info": {"name": "python"},
    }
    for number, cell in enumerate(notebook.cells, 1):
        cell.id = f"cell-{number}"
        cell.metadata.pop("execution", None)
        if "varies" in cell.metadata.get("tags", []):
            cell.outputs = []


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--write", action="store_true", help="store the outputs in the notebooks")
    parser.add_argument("notebooks", nargs="*", type=Path, help="all in this folder by default")
    arguments = parser.parse_args()
    failed = []
    for path in arguments.notebooks or sorted(FOLDER.glob("*.ipynb")):
        notebook = nbformat.read(path, as_version=4)
        start_s = time.monotonic()
        with tempfile.TemporaryDirectory() as temporary:
            (Path(temporary) / "data").symlink_to(FOLDER.parent / "data")
            folder = Path(temporary) / "notebooks"
            folder.mkdir()
            try:
                execute(notebook, folder)
            except CellExecutionError as error:
                print(f"{path.name}: {error}", file=sys.stderr)
                failed.append(path.name)
                continue
        print(f"{path.name}: {time.monotonic() - start_s:.0f} s", flush=True)
        if arguments.write:
            normalize(notebook)
            nbformat.write(notebook, path)
    if failed:
        sys.exit(f"notebooks that failed: {', '.join(failed)}")


if __name__ == "__main__":
    main()
