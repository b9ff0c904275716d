"""Slips of a review that no other test holds: nonsense in sheets and certificates, names beyond the disk's limit."""

import re
import shutil
from pathlib import Path

import pytest
from camtorque.ingest import read_recording, summarise
from camtorque.records import Refusal
from damaged.logs import CALIBRATION, edit

EXAMPLES = CALIBRATION.parent / "raw_examples"
TORQUE, PRESSURE = "torque_T22-40117", "pressure_K4067-40117"


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    shutil.copytree(EXAMPLES / "A_1250rpm", tmp_path / "raw" / "A")
    shutil.copytree(CALIBRATION, tmp_path / "calibration")
    return tmp_path


def number_lines(file: Path) -> list[str]:
    """Return the lines of a sheet whose value is a number."""
    return re.findall(r"^\w+ = [-+.e\d]+ *(?:#.*)?$", file.read_text(encoding="utf-8"), re.MULTILINE)


SHEETS = [(name, line) for name in (TORQUE, PRESSURE) for line in number_lines(CALIBRATION / f"{name}.toml")]


@pytest.mark.parametrize("value", ["nan", "-inf", "1e308", "-1.0", "1" + "0" * 400])
@pytest.mark.parametrize(("name", "line"), SHEETS)
def test_no_number_of_a_sheet_may_be_nonsense(bench: Path, name: str, line: str, value: str) -> None:
    key = line.partition(" = ")[0]
    edit(bench / "calibration" / f"{name}.toml", line, f"{key} = {value}")
    with pytest.raises(Refusal, match=key):
        read_recording(bench / "raw" / "A")


@pytest.mark.parametrize("key", ["cam_inertia_kg_m2", "switching_delay_typ_s", "level_V"])
@pytest.mark.parametrize("value", ["nan", "inf", "1e308", "-1.0", "1" + "0" * 400])
def test_small_numbers_and_levels_may_not_be_nonsense(bench: Path, key: str, value: str) -> None:
    toml = bench / "raw" / "A" / "recording.toml"
    line = next(line for line in toml.read_text(encoding="utf-8").splitlines() if line.startswith(f"{key} ="))
    edit(toml, line, f"{key} = {value}")
    with pytest.raises(Refusal, match=key):
        read_recording(bench / "raw" / "A")


@pytest.mark.parametrize("comment", ["k=0", "k=0.0"])
def test_a_certificate_of_an_impossible_coverage_factor(bench: Path, comment: str) -> None:
    edit(bench / "calibration" / f"{TORQUE}.csv", "k=2", comment)
    with pytest.raises(Refusal, match=r"k has to be above 0"):
        read_recording(bench / "raw" / "A")


@pytest.mark.parametrize("key", ["file", "calibration", "cam_table"])
def test_a_name_that_no_disk_takes_is_refused_in_one_line(bench: Path, key: str) -> None:
    toml = bench / "raw" / "A" / "recording.toml"
    line = next(line for line in toml.read_text(encoding="utf-8").splitlines() if line.startswith(f"{key} ="))
    edit(toml, line, f'{key} = "{"a" * 5000}.csv"')
    with pytest.raises(Refusal) as caught:
        summarise(read_recording(bench / "raw" / "A"))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", [TORQUE, PRESSURE])
def test_a_gain_that_is_off_by_a_tenth_is_told(bench: Path, name: str) -> None:
    file = bench / "calibration" / f"{name}.csv"
    head, *rows = (line for line in file.read_text(encoding="utf-8").splitlines() if line[:1] not in ("#", ""))
    notes = [line for line in file.read_text(encoding="utf-8").splitlines() if line.startswith("#")]
    turned = [f"{load},{1.1 * float(volts):.6f}" for load, volts in (row.split(",") for row in rows)]
    before = {finding.code for finding in read_recording(bench / "raw" / "A").findings}
    file.write_text("\n".join([*notes, head, *turned]) + "\n", encoding="utf-8")
    after = {finding.code for finding in read_recording(bench / "raw" / "A").findings}
    assert after - before == {"sensitivity_off_nominal"}
