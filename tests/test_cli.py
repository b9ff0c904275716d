"""The command: one line for every refusal, the right exit status, nothing half-written."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from camtorque import __version__, cli
from camtorque.align import align
from camtorque.align.options import LARGEST_GRID as LARGEST_ALIGNED
from camtorque.commands import COMMANDS, Outcome, campaign, check, run, texts
from camtorque.commands.arguments import FASTEST_RPM, LARGEST_GRID, LEAST_GRID, SHELLS
from camtorque.config.schemas import CAM_SPEED
from camtorque.fit.prepare import mean_cycles
from camtorque.ingest import read_recording
from camtorque.laws.chain import BINS
from camtorque.progress import silent
from camtorque.records import Refusal
from damaged.build import PLANS
from damaged.logs import clean_log, edit, write_folder
from threadpoolctl import threadpool_info, threadpool_limits

SEALED = {"SHA256SUMS", "ro-crate-metadata.json"}
EXAMPLES = Path(__file__).resolve().parents[1] / "raw_examples"


def one_line(capsys: pytest.CaptureFixture[str]) -> str:
    captured = capsys.readouterr()
    assert "Traceback" not in captured.err
    lines = captured.err.strip().splitlines()
    assert len(lines) == 1, captured.err
    return lines[0]


@pytest.fixture
def copy(tmp_path: Path) -> Path:
    """A copy of an example whose sheets lie where recording.toml looks for them."""
    shutil.copytree(EXAMPLES.parent / "calibration", tmp_path / "calibration")
    shutil.copytree(EXAMPLES / "A_1250rpm", tmp_path / "raw" / "A")
    return tmp_path / "raw" / "A"


def refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> str:
    out = folder.parent.parent / "out"
    assert cli.main(["run", str(folder), "--out", str(out), "--quiet"]) == 2
    assert not out.exists()
    assert not list(folder.parent.parent.glob(".*"))
    return one_line(capsys)


def test_on_windows_every_command_refuses_in_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "platform", "win32")
    assert cli.main(["check", "nowhere"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "found Windows, expected Linux or macOS" in said
    assert "WSL" in said


def test_missing_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a").mkdir()
    assert "recording.toml" in refused(tmp_path / "a" / "none", capsys)


def test_missing_log(copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (copy / "A_1250rpm_all.csv").unlink()
    assert "A_1250rpm_all.csv" in refused(copy, capsys)


@pytest.mark.parametrize("lines", [0, 1])
def test_empty_or_header_only_log(copy: Path, capsys: pytest.CaptureFixture[str], lines: int) -> None:
    log = copy / "A_1250rpm_all.csv"
    head = log.read_bytes().splitlines(keepends=True)[:lines]
    log.write_bytes(b"".join(head))
    assert "A_1250rpm_all.csv" in refused(copy, capsys)


def test_unknown_unit(copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    edit(copy / "recording.toml", 'unit = "V"', 'unit = "furlong"')
    assert "furlong" in refused(copy, capsys)


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ("run r --tolerance 7", "--tolerance: found '7', expected a number above 0 to 0.01"),
        ("run r --tolerance nan", "--tolerance: found 'nan'"),
        ("run r --n-theta 12", "--n-theta: found '12', expected a whole number from 600"),
        ("run r --n-theta 7.5", "--n-theta: found '7.5', expected a whole number"),
        ("campaign d --out o --workers 0", "--workers: found '0', expected a whole number from 1"),
        ("predict p --speed -5", "--speed: found '-5', expected a number above 0 to 30000 rpm"),
        ("predict p --speed fast", "--speed: found 'fast'"),
    ],
)
def test_options_are_bounded(capsys: pytest.CaptureFixture[str], arguments: str, text: str) -> None:
    with pytest.raises(SystemExit, match="2"):
        cli.main(arguments.split())
    assert text in one_line(capsys)


def test_output_that_cannot_be_written_is_refused_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    assert cli.main(["run", "no such folder", "--out", str(tmp_path / "file" / "o")]) == 2
    assert "on the way, expected folders" in one_line(capsys)
    monkeypatch.setattr("os.access", lambda *_: False)
    assert cli.main(["run", "no such folder", "--out", str(tmp_path / "o")]) == 2
    assert "cannot be written to" in one_line(capsys)


def test_a_run_writes_beside_the_other_reports() -> None:
    assert run.default_out(Path("raw/night/run_7")) == Path("reports/run_7")
    assert run.default_out(Path("raw/night/run_7/recording.toml")) == Path("reports/run_7")


def test_check_as_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["check", str(EXAMPLES / "A_1000rpm"), "--json"]) == 0
    doc = json.loads(capsys.readouterr().out)
    assert doc["schema"] == "camtorque.check/1"
    assert [row["quantity"] for row in doc["channels"]] == ["torque", "pressure", "trigger"]
    assert {"code", "severity", "text", "where"} == set(doc["findings"][0])
    assert doc["usable"] == ["align", "run"]
    assert {"missed_trigger", "misfire"} <= {row["reason"] for row in doc["cut_flow"]}


def test_notes_are_counted_and_warnings_shown() -> None:
    rows = [{"severity": s, "text": s.upper(), "where": ""} for s in ("info", "warning", "info")]
    assert texts.loud_findings(rows) == ["warning   WARNING", "info      2 notes on the page"]


@pytest.mark.parametrize("shell", SHELLS)
def test_completion_names_commands_and_options(capsys: pytest.CaptureFixture[str], shell: str) -> None:
    assert cli.main(["completion", shell]) == 0
    printed = capsys.readouterr().out
    assert all(name in printed for name in COMMANDS)
    assert "speed-accuracy" in printed
    assert "limits" in printed


@pytest.mark.parametrize(
    ("typed", "wanted"), [("ru", "run"), ("run --lim", "--limits"), ("study sp", "speed-accuracy")]
)
def test_bash_completes(capsys: pytest.CaptureFixture[str], typed: str, wanted: str) -> None:
    cli.main(["completion", "bash"])
    words = ["camtorque", *typed.split()]
    script = capsys.readouterr().out + f"COMP_WORDS=({' '.join(words)})\nCOMP_CWORD={len(words) - 1}\n_camtorque\n"
    done = subprocess.run(["bash", "-c", script + 'echo "${COMPREPLY[@]}"'], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == wanted


def test_progress_is_for_a_terminal(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def works(_: object, tell: Callable[[str], None]) -> Outcome:
        tell("half done")
        return Outcome("done", {})

    monkeypatch.setattr(check, "execute", works)
    assert cli.main(["check", "x"]) == 0
    assert capsys.readouterr() == ("done\n", "")
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    assert cli.main(["check", "x"]) == 0
    assert capsys.readouterr() == ("done\n", "camtorque: half done\n")


def test_foreign_output_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "thesis.tex").touch()
    assert cli.main(["run", str(EXAMPLES / "A_1000rpm"), "--out", str(tmp_path), "--quiet"]) == 2
    assert "other files in it" in one_line(capsys)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


def test_campaign_without_recordings(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["campaign", str(tmp_path), "--out", str(tmp_path / "o"), "--quiet"]) == 2
    assert "found no recording.toml" in one_line(capsys)


def test_campaign_of_refused_recordings_says_why(copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (copy / "A_1250rpm_all.csv").unlink()
    out = copy.parent.parent / "out"
    assert cli.main(["campaign", str(copy.parent), "--out", str(out), "--quiet"]) == 2
    assert "refused" in capsys.readouterr().out
    assert "A_1250rpm_all.csv" in (out / "campaign.json").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("error", "status", "text"),
    [
        (Refusal("a\nb"), 2, "camtorque check: a b"),
        (PermissionError(13, "Permission denied", "x.csv"), 2, "x.csv"),
        (ValueError("odd"), 70, "unexpected ValueError: odd; run again with --debug"),
        (KeyboardInterrupt(), 130, "camtorque: stopped"),
    ],
)
def test_every_error_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], error: BaseException, status: int, text: str
) -> None:
    def fails(*_: object) -> Outcome:
        raise error

    monkeypatch.setattr(check, "execute", fails)
    assert cli.main(["check", "x"]) == status
    printed = capsys.readouterr().err
    assert text in printed
    assert len(printed.strip().splitlines()) == 1


def test_a_stopped_campaign_says_how_to_go_on(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def stops(*_: object) -> Outcome:
        raise KeyboardInterrupt

    monkeypatch.setattr(campaign, "execute", stops)
    assert cli.main(["campaign", "x", "--out", "y"]) == 130
    assert one_line(capsys) == "camtorque: stopped; the same command goes on where it was"


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (
            "check a b c",
            "camtorque check: found b, c, expected one RECORDING; camtorque campaign takes a folder of them;",
        ),
        ("run a --outt b", "camtorque run: found --outt, expected options of this command; see camtorque run --help"),
        ("completion bash zsh", "camtorque completion: found zsh, expected no more arguments; see"),
    ],
)
def test_arguments_beyond_what_a_command_takes(capsys: pytest.CaptureFixture[str], arguments: str, said: str) -> None:
    with pytest.raises(SystemExit, match="2"):
        cli.main(arguments.split())
    assert capsys.readouterr().err.startswith(said)


def test_wrong_arguments_are_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        cli.main(["align", "somewhere"])
    assert "--out" in one_line(capsys)
    with pytest.raises(SystemExit, match="2"):
        cli.main(["predict", "--from", "x", "--clearance", "-1um"])
    assert "expected one argument (a value that begins with a minus is joined to its option by =)" in one_line(capsys)


def test_check_tells_what_a_recording_holds(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["check", str(EXAMPLES / "A_1000rpm")]) == 0
    printed = capsys.readouterr().out
    for word in ("torque", "pressure", "trigger", "rpm by its pulses"):
        assert word in printed


@pytest.mark.parametrize(("revolutions", "number", "noun"), [(4.2, 3, "cycles"), (2.2, 1, "cycle")])
def test_check_says_what_a_short_recording_lacks_for_run(
    tmp_path: Path, revolutions: float, number: int, noun: str
) -> None:
    recording = read_recording(write_folder(tmp_path / "r", [clean_log(revolutions=revolutions)], PLANS["hdf5"]))
    cycles = align(recording)
    assert check.missing_for_run(recording, cycles) == [f"{number} used {noun}, at least 4 are needed"]
    with pytest.raises(Refusal, match=f"{number} usable {noun}, at least {check.LEAST_CYCLES} are needed"):
        mean_cycles(cycles)


def test_check_lists_every_error(copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    edit(copy / "recording.toml", "plunger_diameter_m = 0.008", "plunger_diameter_m = 8")
    edit(copy / "recording.toml", 'edge = "rising"', 'edge = "up"')
    edit(copy / "recording.toml", 'unit = "V"', 'unit = "furlong"')
    assert cli.main(["check", str(copy)]) == 2
    printed = capsys.readouterr().out
    n_channels = printed.count("unknown unit 'furlong'")
    assert n_channels > 0, "a unit was told in a second round, when every key was right"
    assert printed.startswith(f"{2 + n_channels} things have to be put right:")
    assert "did you mean 8 mm = 0.008?" in printed
    assert "expected one of rising, falling" in printed


def test_check_lists_what_is_wrong_with_files_and_sheets_together(
    copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    edit(copy / "recording.toml", 'channel = "Geber"', 'channel = "Gebre"')
    (copy.parent.parent / "calibration" / "torque_T22-40117.csv").unlink()
    assert cli.main(["check", str(copy), "--json"]) == 2
    refused_by = json.loads(capsys.readouterr().out)["refused"]
    assert ["did you mean 'Geber'" in refused_by[0], "no such file" in refused_by[1]] == [True, True]


def test_check_names_every_column_that_is_not_there(copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    edit(copy / "recording.toml", 'channel = "Geber"', 'channel = "Gebre"')
    edit(copy / "recording.toml", 'channel = "Drehmoment"', 'channel = "Moment"')
    assert cli.main(["check", str(copy), "--json"]) == 2
    refused_by = json.loads(capsys.readouterr().out)["refused"]
    assert ["no column 'Moment'" in refused_by[0], "no column 'Gebre'" in refused_by[1]] == [True, True]


@pytest.mark.parametrize(
    ("samples", "said"),
    [
        (2600, "found 1 trigger pulse of .* expected at least two pulses"),
        (6000, "align; run refuses it: 1 used cycle, at"),
    ],
)
def test_two_pulses_are_enough_to_align(
    copy: Path, capsys: pytest.CaptureFixture[str], samples: int, said: str
) -> None:
    log = next(copy.glob("*.csv"))
    lines = log.read_bytes().split(b"\n")
    log.write_bytes(b"\n".join(lines[: samples + 10]) + b"\n")
    assert cli.main(["check", str(copy)]) == (2 if samples < 6000 else 0)
    assert re.search(said, capsys.readouterr().out)


def test_check_never_passes_what_align_refuses(copy: Path, capsys: pytest.CaptureFixture[str]) -> None:
    edit(copy / "recording.toml", "pulses_per_rev = 1", "pulses_per_rev = 60\nmissing_teeth = 2")
    assert cli.main(["check", str(copy)]) == 2
    last = capsys.readouterr().out.strip().splitlines()[-1]
    assert last.startswith("refused")
    assert cli.main(["align", str(copy), "--out", str(copy.parent / "o")]) == 2


def test_align_needs_no_model(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["align", str(EXAMPLES / "A_1000rpm"), "--out", str(tmp_path / "o"), "--quiet"]) == 0
    assert "cycles used" in capsys.readouterr().out
    assert {p.name for p in (tmp_path / "o").iterdir()} == {
        "align.html",
        "align.json",
        "aligned.h5",
        "figures",
        *SEALED,
    }


def test_align_tells_a_speed_far_from_nominal(tmp_path: Path, capsys):
    text = (EXAMPLES / "A_1000rpm" / "recording.toml").read_text(encoding="utf-8")
    text = text.replace("nominal_speed_rpm = 1000.0", "nominal_speed_rpm = 500.0")
    text = text.replace("../../calibration", (EXAMPLES.parent / "calibration").as_posix())
    text = text.replace('file = "', f'file = "{(EXAMPLES / "A_1000rpm").as_posix()}/')
    (tmp_path / "recording.toml").write_text(text, encoding="utf-8")
    assert cli.main(["align", str(tmp_path), "--out", str(tmp_path / "o"), "--quiet"]) == 0
    assert "the pulses give 1000 rpm, the nominal speed is 500 rpm" in capsys.readouterr().out


def test_predict_prints_a_sweep_and_leaves_a_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sheets = EXAMPLES.parent / "calibration"
    arguments = ["predict", str(sheets / "paper_pump.toml"), "--pressure", str(sheets / "paper_pressure.csv")]
    assert cli.main([*arguments, "--speed", "300", "500", "--out", str(tmp_path / "o")]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines if line[:8].strip()[:1].isdigit()] == ["300.0", "500.0"]
    assert {path.name for path in (tmp_path / "o").iterdir()} == {"predict.html", "predict.json", "SHA256SUMS"}


def test_predict_leaves_out_speeds_at_which_the_follower_flies_on(capsys: pytest.CaptureFixture[str]) -> None:
    pump = str(EXAMPLES.parent / "calibration" / "paper_pump.toml")
    assert cli.main(["predict", pump, "--speed", "1000", "3000", "15000"]) == 1
    text = capsys.readouterr().out
    assert "no row: after 5 revolutions at 15000 rpm the follower has not landed, or flies otherwise" in text
    assert [line.split()[0] for line in text.splitlines()[-2:]] == ["1000.0", "3000.0"]
    assert text.splitlines()[-1].endswith("THE FOLLOWER LEAVES THE CAM, see above")
    assert cli.main(["predict", pump, "--speed", "15000"]) == 2
    assert "after 5 revolutions at 15000 rpm the follower has not landed, or flies otherwise" in capsys.readouterr().err


def test_a_cam_that_cannot_be_made_has_no_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = (EXAMPLES.parent / "calibration" / "paper_pump.toml").read_text(encoding="utf-8")
    text = text.replace("roller_radius_m = 0.008", "roller_radius_m = 0.020")
    text = text.replace("angle_deg = 55.0", "angle_deg = 30.0").replace("angle_deg = 225.0", "angle_deg = 250.0")
    (tmp_path / "pump.toml").write_text(text, encoding="utf-8")
    assert cli.main(["predict", str(tmp_path / "pump.toml"), "--speed", "500"]) == 1
    printed = capsys.readouterr().out
    assert "error     the roller is too large: no cam can drive this lift; take a smaller roller" in printed
    assert "torque max" not in printed


def test_tolerance_of_a_prediction_stands_on_its_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pump = EXAMPLES.parent / "calibration" / "paper_pump.toml"
    assert cli.main(["predict", str(pump), "--speed", "500", "--tolerance", "1e-3", "--out", str(tmp_path / "o")]) == 0
    text = "360 points per revolution leave at most 2.1e-05"
    assert text in capsys.readouterr().out
    assert text.replace("e-05", "·10⁻⁵") in (tmp_path / "o" / "predict.html").read_text(encoding="utf-8")
    doc = json.loads((tmp_path / "o" / "predict.json").read_text(encoding="utf-8"))
    assert "grid_error" in {row["code"] for row in doc["findings"]}
    assert len(doc["curves"]["theta_deg"]) == 360


def test_tolerance_of_a_run_is_a_finding() -> None:
    parsed = cli.build_parser().parse_args(["run", "r", "--out", "o", "--quiet", "--tolerance", "1e-4"])
    (note,) = run.run_options(parsed, silent).align.notes
    assert note.code == "grid_error"


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="0"):
        cli.main(["--version"])
    assert __version__ in capsys.readouterr().out


@pytest.mark.parametrize(
    ("module", "unwanted"),
    [
        ("camtorque.cli", {"numpy"}),
        ("camtorque.commands.check", {"pandas", "matplotlib", "h5py", "nptdms", "asammdf"}),
        ("camtorque.commands.run", {"pandas", "lmfit", "scipy.special", "asammdf", "emcee", "camtorque.studies"}),
        ("camtorque.commands.predict", {"pandas", "camtorque.studies"}),
    ],
)
def test_a_command_imports_what_it_needs_alone(module: str, unwanted: set[str]) -> None:
    code = f"import sys, {module}; print(*(name for name in {sorted(unwanted)} if name in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


@pytest.mark.parametrize("command", ["check", "align"])
def test_short_recordings_are_checked_and_aligned_without_compiled_code(command: str, tmp_path: Path) -> None:
    words = [
        command,
        str(EXAMPLES / "A_1000rpm"),
        "--quiet",
        *(["--out", str(tmp_path / "out")] if command == "align" else []),
    ]
    code = (
        f"import sys; from camtorque.cli import main; main({words!r}); "
        "print(*(name for name in ('numba', 'scipy', 'pandas', 'matplotlib') if name in sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == ""


def test_compiled_code_begins_without_scipy_and_leaves_it_to_be_imported() -> None:
    code = (
        "import sys; from camtorque.compiled import njit; assert njit(lambda x: x + 1.0)(1.0) == 2.0; "
        "assert 'scipy.linalg' not in sys.modules; import scipy.linalg.cython_blas; "
        "from numba import njit; import numpy as np; print(njit(lambda a: a @ a)(np.eye(2))[0, 0])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "1.0"


def test_every_command_keeps_the_numerical_libraries_on_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[int] = []

    def counts(*_: object) -> Outcome:
        seen.extend(pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas")
        return Outcome("", {})

    monkeypatch.setattr(check, "execute", counts)
    with threadpool_limits(2):
        assert cli.main(["check", "x"]) == 0
    assert seen
    assert set(seen) == {1}


def test_the_grid_is_within_what_fit_and_alignment_need() -> None:
    assert (LEAST_GRID, LARGEST_GRID) == (BINS, LARGEST_ALIGNED)


def test_the_command_line_knows_the_fastest_cam_of_recordings() -> None:
    assert CAM_SPEED.high == FASTEST_RPM
