"""docs/adding_more.md done to copies of the package: a file format, a study and a section of the report are added."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import camtorque
import pytest

PACKAGE = Path(camtorque.__file__).parent
TESTS = Path(__file__).parent
PAGE = (TESTS.parent / "docs" / "adding_more.md").read_text(encoding="utf-8")
FENCES = re.compile(r"```\w+\n(.*?)```", re.DOTALL)
ADDED = {
    "A file format": ("ingest/wav.py", "ingest/formats.py", 'FORMATS: dict[str, Format] = {\n', ""),
    "A study": (
        "studies/samples.py", "studies/study.py", "tuple[Chart, ...]]] = {\n",
        "from camtorque.studies.samples import samples_chart\n",
    ),
    "A section of the report": (
        "report/sections/steadiness.html", "report/page.py", '    "inside": "Inside the pump",\n', ""
    ),
}  # fmt: skip
"""Heading of the page -> the one file, the file that gets the one line, behind what, and its import."""
USE = {
    "A file format": """
from pathlib import Path
import numpy as np
import pytest
from scipy.io import wavfile
from camtorque.align import align
from camtorque.cli import main
from camtorque.ingest import read_recording
from camtorque.records import Refusal
from damaged.logs import NAMES, Plan, clean_log, write_folder

log = clean_log()
folder = write_folder(Path("r"), [log], Plan("hdf5"))
(folder / "DAQ1.h5").unlink()
wavfile.write(folder / "DAQ1.wav", int(log.rate), np.stack(list(log.volts.values()), axis=1).astype(np.float32))
toml = folder / "recording.toml"
text = toml.read_text().replace("DAQ1.h5", "DAQ1.wav").replace('"hdf5"', '"wav"').replace('group = "Main"', "")
for number, quantity in enumerate(log.volts, 1):
    text = text.replace(f'channel = "{NAMES[quantity]}"', f'channel = "{number}"')
toml.write_text(text)
recording = read_recording(folder)
for channel in recording.channels:
    assert np.allclose(channel.source.read(0, 220000), log.volts[channel.quantity], atol=1e-6)
assert align(recording).speed.size == 21
assert main(["new", "r/DAQ1.wav", "--out", "n"]) == 0
assert "DAQ1.wav" in Path("n/recording.toml").read_text()
toml.write_text(text.replace('channel = "3"', 'channel = "7"'))
with pytest.raises(Refusal, match="no channel '7'; there are 1, 2, 3"):
    read_recording(folder)
(folder / "DAQ1.wav").write_bytes(b"RIFF" + bytes(60))
with pytest.raises(Refusal, match="cannot be read as WAV"):
    read_recording(folder)
""",
    "A study": """
import json
from pathlib import Path
from camtorque.studies import study

study.STUDIES["speed-accuracy"] = {"samples": study.CHARTS["samples"]}
study.run_study("speed-accuracy", Path("o"), quick=True)
(part,) = json.loads(Path("o/speed_accuracy.json").read_text())["parts"]
assert part["name"] == "samples" and len(part["points"]) == 2
assert part["points"][1]["error"] < part["points"][0]["error"] + 1e-12
assert Path("o/samples.svg").exists()
""",
    "A section of the report": """
from pathlib import Path
from camtorque.report.write import write_run
from report.report_cases import run_result

write_run(run_result(), Path("."))
page = Path("report.html").read_text()
places = [page.index(f'<h2 id="{name}">') for name in ("inside", "steadiness", "alignment")]
assert places == sorted(places)
assert '<a href="#inside">Inside the pump</a><a href="#steadiness">Steadiness</a>' in page
assert "<p>9 of 11 cycles were used, at 1002.7 rpm.</p>" in page
""",
}
"""Heading of the page -> what is done with what was added."""


def steps(heading: str) -> tuple[str, str]:
    """Return the file and the line that a part of the page shows."""
    part = PAGE.split(f"## {heading}\n", 1)[1].split("\n## ", 1)[0]
    file, line = FENCES.findall(part)
    assert line.count("\n") == 1, "one line"
    return file, line


@pytest.mark.parametrize("heading", ADDED)
def test_one_file_and_one_line(heading: str, tmp_path: Path) -> None:
    file, line = steps(heading)
    name, registry, behind, imported = ADDED[heading]
    copy = tmp_path / "camtorque"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    (copy / name).write_text(file, encoding="utf-8")
    text = (copy / registry).read_text(encoding="utf-8")
    assert text.count(behind) == 1
    head, rest = text.split(behind)
    first = head.index("from camtorque.")
    head = head[:first] + imported + head[first:]
    (copy / registry).write_text(head + behind + line + rest, encoding="utf-8")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(TESTS)])}
    done = subprocess.run(
        [sys.executable, "-c", USE[heading]], cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]
    assert f"`{name}`" in PAGE
    assert f"`{registry}`" in PAGE
