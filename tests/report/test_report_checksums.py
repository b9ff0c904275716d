"""Checksums and provenance: a flipped byte and a missing file are found, a public validator accepts the crate."""

from __future__ import annotations

import hashlib
import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from camtorque import cli
from camtorque.records import Refusal
from camtorque.report.files import CRATE, SUMS, verify, visible_files, write_checksums
from camtorque.report.folder import output_folder, seal

DOC = {
    "schema": "camtorque.result/1", "version": "0.1.0", "created": "2026-01-01T00:00:00+00:00", "seed": 3,
    "inputs": [{"path": "../raw/Prüfstand 1/a.csv", "sha256": hashlib.sha256(b"a").hexdigest()}],
}  # fmt: skip


@pytest.fixture
def written(tmp_path: Path) -> Path:
    """A finished output with a figure."""
    with output_folder(tmp_path / "out", "result.json") as folder:
        (folder / "figures").mkdir()
        (folder / "figures" / "torque.svg").write_text("<svg></svg>")
        (folder / "result.json").write_text(json.dumps(DOC))
    return tmp_path / "out"


@pytest.fixture
def campaign(written: Path) -> Path:
    """An index that vouches for one recording; another one is of other options."""
    out = written.parent / "campaign"
    (out / "runs").mkdir(parents=True)
    written.rename(out / "runs" / "a1")
    (out / "runs" / "b2").mkdir()
    (out / "runs" / "b2" / "entry.json").touch()
    (out / "campaign.json").write_text("{}")
    (out / ".camtorque-campaign").touch()
    write_checksums(out, [out / "campaign.json", out / "runs" / "a1" / SUMS])
    return out


def flip(path: Path, place: int = 0) -> None:
    content = bytearray(path.read_bytes())
    content[place] ^= 1
    path.write_bytes(content)


def test_an_untouched_output_is_as_it_was_written(written: Path) -> None:
    assert verify(written) == (3, {})
    done = subprocess.run(["sha256sum", "-c", SUMS], cwd=written, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout.count(": OK")) == (0, 3)


@pytest.mark.parametrize("name", ["result.json", "figures/torque.svg", CRATE])
def test_a_flipped_byte_a_missing_and_a_new_file_are_found(written: Path, name: str) -> None:
    flip(written / name)
    assert verify(written)[1] == {name: "changed"}
    (written / name).rename(written / "renamed")
    assert verify(written)[1] == {name: "missing", "renamed": "not listed"}


@pytest.mark.parametrize(
    ("damage", "kinds"),
    [
        (lambda path: flip(path, 3), {"changed", "damaged"}),
        (lambda path: flip(path, 64), {"damaged", "not listed"}),
        (lambda path: path.write_text("0" * 64 + "  ../../etc/passwd\n"), {"damaged", "not listed"}),
        (lambda path: path.write_text("0" * 64 + "  /etc/passwd\n"), {"damaged", "not listed"}),
        (lambda path: path.write_bytes(b"\xff\xfe\n"), {"damaged", "not listed"}),
    ],
)
def test_damaged_checksums_are_found(written: Path, damage: Callable[[Path], None], kinds: set[str]) -> None:
    damage(written / SUMS)
    found = set(verify(written)[1].values())
    assert found
    assert found <= kinds


def test_the_index_of_a_campaign_vouches_for_its_recordings(campaign: Path) -> None:
    assert verify(campaign) == (5, {})
    flip(campaign / "runs" / "a1" / "figures" / "torque.svg")
    assert verify(campaign)[1] == {"runs/a1/figures/torque.svg": "changed"}
    (campaign / "runs" / "a1" / SUMS).unlink()
    assert verify(campaign)[1][f"runs/a1/{SUMS}"] == "missing"
    (campaign / "new").touch()
    assert verify(campaign)[1]["new"] == "not listed"


def test_the_command_says_which_file(written: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["verify", str(written)]) == 0
    assert "3 files compared, 0 not as they were written" in capsys.readouterr().out
    (written / "result.json").unlink()
    assert cli.main(["verify", str(written)]) == 1
    assert "missing     result.json" in capsys.readouterr().out
    assert cli.main(["verify", str(written), "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["schema"] == "camtorque.verify/1"


def test_a_folder_without_checksums_is_refused(tmp_path: Path) -> None:
    with pytest.raises(Refusal, match="found no SHA256SUMS, expected the output of a command; check the path"):
        verify(tmp_path)
    for name in ("b", "a"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "SHA256SUMS").touch()
    with pytest.raises(Refusal, match=r"expected the output of a command; there are .*/a, .*/b$"):
        verify(tmp_path)


def test_hidden_files_are_nobodys_business(tmp_path: Path) -> None:
    (tmp_path / ".lock").touch()
    (tmp_path / ".git").mkdir()
    (tmp_path / ".git" / "x").touch()
    assert visible_files(tmp_path) == []


def test_the_crate_names_inputs_by_content_and_every_output(written: Path) -> None:
    graph = {item["@id"]: item for item in json.loads((written / CRATE).read_text(encoding="utf-8"))["@graph"]}
    action = graph["#computation"]
    (source,) = (graph[item["@id"]] for item in action["object"])
    assert source["sha256"] == DOC["inputs"][0]["sha256"]
    assert source["name"] == "a.csv"
    assert {item["@id"] for item in action["result"]} == {"result.json", "figures/torque.svg"}
    assert graph[action["instrument"]["@id"]]["softwareVersion"] == "0.1.0"
    assert "Prüfstand" not in (written / CRATE).read_text(encoding="utf-8"), "where inputs lie is nobody's business"


def test_a_folder_sealed_again_lists_no_seal_among_its_outputs(written: Path) -> None:
    before = json.loads((written / CRATE).read_text(encoding="utf-8"))
    seal(written, "again")
    again = json.loads((written / CRATE).read_text(encoding="utf-8"))
    ids = [item["@id"] for item in again["@graph"]]
    assert len(ids) == len(set(ids)) == len(before["@graph"])


VALIDATE = """
import json, sys
from pathlib import Path
import rdflib.plugins.shared.jsonld.context as context
import rocrate
from rocrate_validator import models, services
from rocrate_validator.utils.http import HttpRequester

terms = json.loads((Path(rocrate.__file__).parent / "data" / "ro-crate.jsonld").read_text(encoding="utf-8"))

class Answer:
    status_code, ok, headers = 200, True, {"Content-Type": "application/ld+json"}
    text = json.dumps(terms)
    def json(self): return terms
    def raise_for_status(self): pass

# the vocabulary comes from a package and not from the network
context.Context._fetch_context = lambda self, source, base, referenced: terms
type(HttpRequester()).get = lambda self, *_, **__: Answer()
found = []
for folder in sys.argv[1:]:
    settings = services.ValidationSettings(
        rocrate_uri=folder, profile_identifier="process-run-crate", requirement_severity=models.Severity.REQUIRED,
    )
    result = services.validate(settings)
    found.append(sorted({f"{issue.check.identifier} {issue.message}" for issue in result.get_issues()}))
print("RESULT", json.dumps(found))
"""


def validated(*folders: Path) -> list[list[str]]:
    done = subprocess.run([sys.executable, "-c", VALIDATE, *folders], capture_output=True, text=True, check=False)
    lines = [line for line in done.stdout.splitlines() if line.startswith("RESULT ")]
    assert lines, done.stderr
    return json.loads(lines[0].removeprefix("RESULT "))


def test_a_public_validator_accepts_the_crate(written: Path, tmp_path: Path) -> None:
    pytest.importorskip("rocrate_validator")
    faulty = tmp_path / "faulty"
    shutil.copytree(written, faulty)
    crate = json.loads((faulty / CRATE).read_text(encoding="utf-8"))
    for item in crate["@graph"]:
        if item["@type"] == "CreateAction":
            del item["instrument"]
    (faulty / CRATE).write_text(json.dumps(crate), encoding="utf-8")
    sound, broken = validated(written, faulty)
    assert sound == []
    assert any("instrument" in issue for issue in broken), "the validator has to see a fault"
