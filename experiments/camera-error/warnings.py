"""Which cameras the tracker names, and why.

warnings.py OUT

Prints a row for each run of the experiment whose results are in OUT/camera-error, from the summaries of its first seed.
"""
import json
import pathlib
import sys


def words(name, error):
    if error["cause"] == "clock":
        return f"{name}: clock, {1000 * error['correction_s']:+.0f} ms"
    if error["cause"] == "focal_length":
        return f"{name}: focal length, {100 / error['ratio'] - 100:+.1f} %"
    return f"{name}: pose"


print("| run | off by (px) | likely |\n|---|---:|---|")
for run in sorted((pathlib.Path(sys.argv[1]) / "camera-error").iterdir()):
    summary = run / "seed-01" / "summary.json"
    if not summary.is_file():
        continue
    cameras = json.loads(summary.read_text())["cameras"]
    errors = {name: camera["agreement"]["likely_error"] for name, camera in cameras.items()}
    named = sorted(((error["explained_px"], name) for name, error in errors.items() if error), reverse=True)
    likely = ", or ".join(words(name, errors[name]) for _, name in named)
    print(f"| {run.name} | {named[0][0]:.1f} | {likely} |" if named else f"| {run.name} | | no warning |")
