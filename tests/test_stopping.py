"""Ctrl-C and termination: the status says which, workers are ended, nothing unfinished stays, an older result does."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from camtorque.process import stopping
from camtorque.process.stopping import Stopped, before_leaving, stoppable
from camtorque.process.threads import on_one_thread

EXAMPLES = Path(__file__).resolve().parents[1] / "raw_examples"
LIMIT = 60
"""Seconds after which a process that should have ended counts as hanging."""
BLOCKED = """
import hashlib, shutil, sys, time
from pathlib import Path
from camtorque.process import stopping
folder = Path(sys.argv[1])
folder.mkdir()
with stopping.stoppable(), stopping.before_leaving(lambda: shutil.rmtree(folder)):
    Path(sys.argv[1] + ".ready").touch()
    hashlib.pbkdf2_hmac("sha256", b"", b"", 2**31 - 1)
"""


def wait_for(path: Path, process: subprocess.Popen[str]) -> None:
    """Return as soon as a path exists."""
    for _ in range(LIMIT * 20):
        if path.exists():
            return
        assert process.poll() is None, process.communicate()
        time.sleep(0.05)
    raise AssertionError(f"{path} did not appear")


def camtorque(*arguments: object) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "camtorque.cli", *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_a_stopped_run_leaves_the_older_result_and_nothing_else(
    tmp_path: Path, number: signal.Signals, status: int
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "result.json").write_text('{"schema": "camtorque.result/1"}')
    process = camtorque("run", EXAMPLES / "A_1250rpm", "--out", out)
    wait_for(tmp_path / ".out.partial", process)
    process.send_signal(number)
    printed, errors = process.communicate(timeout=LIMIT)
    assert process.returncode == status
    assert printed == ""
    assert "Traceback" not in errors
    assert [path.name for path in tmp_path.iterdir()] == ["out"]
    assert [path.name for path in out.iterdir()] == ["result.json"]


def test_a_stopped_study_leaves_no_folder(tmp_path: Path) -> None:
    out = tmp_path / "parent" / "out"
    command = [sys.executable, "-m", "camtorque.cli", "study", "stability", "--out", str(out)]
    process = subprocess.Popen(command, cwd=EXAMPLES.parent, stderr=subprocess.PIPE, text=True)
    wait_for(out.with_name(".out.partial"), process)
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=LIMIT)
    assert process.returncode == 143
    assert list(tmp_path.iterdir()) == []


def test_a_long_call_of_compiled_code_does_not_hold_the_end_back(tmp_path: Path) -> None:
    folder = tmp_path / "unfinished"
    process = subprocess.Popen([sys.executable, "-c", BLOCKED, str(folder)], text=True)
    wait_for(tmp_path / "unfinished.ready", process)
    process.send_signal(signal.SIGTERM)
    process.communicate(timeout=LIMIT)
    assert process.returncode == 143
    assert not folder.exists()


def test_a_second_signal_does_not_interrupt_the_tidying_up() -> None:
    code = (
        "import os, signal\nfrom camtorque.process.stopping import Stopped, stoppable\n"
        "try:\n with stoppable():\n  try:\n   os.kill(os.getpid(), signal.SIGTERM)\n   import time; time.sleep(60)\n"
        "  finally:\n   os.kill(os.getpid(), signal.SIGINT)\n   print('tidy')\n"
        "except Stopped as stop:\n raise SystemExit(stop.status)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=LIMIT)
    assert (done.returncode, done.stdout.strip()) == (143, "tidy")


def test_what_compiled_code_makes_of_the_signal_is_still_a_stop() -> None:
    code = (
        "import os, signal\nfrom camtorque import cli\nfrom camtorque.process.stopping import Stopped\n"
        "def execute(parsed):\n try:\n  os.kill(os.getpid(), signal.SIGTERM)\n  import time; time.sleep(60)\n"
        " except Stopped as stop:\n  raise SystemError('returned a result with an exception set') from stop\n"
        "cli.execute = execute\nraise SystemExit(cli.main(['check', 'x']))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, timeout=LIMIT)
    assert (done.returncode, done.stderr) == (143, "camtorque: stopped\n")


def test_an_interruption_reaches_a_notebook_as_one_whatever_compiled_code_makes_of_it() -> None:
    """A fit that was interrupted while numba unpacked an array ended as SystemError, which `except` did not expect."""

    @on_one_thread
    def fit(stop: BaseException | None) -> None:
        try:
            raise SystemError("unpacking returned a result with an exception set") from stop
        except SystemError as error:
            raise SystemError("integrate returned a result with an exception set") from error

    with pytest.raises(KeyboardInterrupt):
        fit(KeyboardInterrupt())
    with pytest.raises(SystemError, match="integrate"):
        fit(None)


def test_an_error_after_an_interruption_that_was_handled_is_that_error() -> None:
    """A notebook that went on in its `except KeyboardInterrupt` was told of another interruption, not of the fault."""

    @on_one_thread
    def fit() -> None:
        raise ValueError("no such file")

    try:
        raise KeyboardInterrupt
    except KeyboardInterrupt:
        with pytest.raises(ValueError, match="no such file"):
            fit()


def test_handlers_are_given_back() -> None:
    before = signal.getsignal(signal.SIGTERM)
    with stoppable():
        assert signal.getsignal(signal.SIGTERM) is not before
    assert signal.getsignal(signal.SIGTERM) is before


def test_a_last_step_is_forgotten_after_its_block() -> None:
    with before_leaving(print):
        assert stopping._last_steps == [print]
    assert stopping._last_steps == []


def test_stopped_knows_its_status() -> None:
    assert Stopped(signal.SIGTERM).status == 143
    assert isinstance(Stopped(signal.SIGINT), KeyboardInterrupt)


def command_line(arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run a command of the shell; ``camtorque`` in it means this package."""
    text = arguments.replace("camtorque", f"{sys.executable} -m camtorque.cli")
    return subprocess.run(
        ["/bin/sh", "-c", text], capture_output=True, text=True, check=False, timeout=LIMIT, cwd=EXAMPLES,
        env={**os.environ, **environment},
    )  # fmt: skip


@pytest.mark.parametrize(
    ("tail", "status", "message"),
    [
        (">&-", 0, ""),
        ("2>&-", 0, ""),
        ("| true", 0, ""),
        (">/dev/full", 2, "camtorque check: No space left on device: standard output; free some space and run again"),
    ],
)
def test_closed_and_full_streams(tail: str, status: int, message: str) -> None:
    done = command_line(f"camtorque check A_1250rpm {tail}")
    assert (done.returncode, done.stderr.strip()) == (status, message)
    done = command_line(f"camtorque --help {tail}")
    assert (done.returncode, done.stderr.strip()) == (status, message.replace(" check", ""))


def test_odd_locale_and_unwritable_home(tmp_path: Path) -> None:
    place = tmp_path / os.fsdecode(b"Pr\xfcfstand \xc2\xb5")  # one byte of it is no UTF-8
    shutil.copytree(EXAMPLES.parent / "calibration", place / "calibration")
    shutil.copytree(EXAMPLES / "A_1250rpm", place / "raw" / "A")
    out = tmp_path / ("long" * 62)
    process = subprocess.run(
        [sys.executable, "-m", "camtorque.cli", "align", place / "raw" / "A", "--out", out, "--quiet"],
        capture_output=True, check=False, timeout=LIMIT,
        env={**os.environ, "HOME": "/proc/none", "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONIOENCODING": "ascii"},
    )  # fmt: skip
    assert process.returncode == 0, process.stderr
    assert process.stderr == b""
    assert (out / "align.json").exists()


def test_a_locale_without_umlauts_is_named_as_the_cause(tmp_path: Path) -> None:
    """A log that is there was told as missing, its name in escapes."""
    shutil.copytree(EXAMPLES.parent / "calibration", tmp_path / "calibration")
    folder = tmp_path / "raw" / "Prüfling"
    shutil.copytree(EXAMPLES / "A_1250rpm", folder)
    (folder / "A_1250rpm_all.csv").rename(folder / "Läufe.csv")
    config = (folder / "recording.toml").read_text(encoding="utf-8").replace("A_1250rpm_all.csv", "Läufe.csv")
    (folder / "recording.toml").write_text(config, encoding="utf-8")
    process = subprocess.run(
        [sys.executable, "-m", "camtorque.cli", "check", folder],
        capture_output=True, check=False, timeout=LIMIT, env={**os.environ, "LC_ALL": "C", "PYTHONUTF8": "0"},
    )  # fmt: skip
    assert process.returncode == 2
    text = process.stderr.decode()
    assert "Prüfling/Läufe.csv: cannot be looked for: this system takes names of files in ascii alone; set LC" in text
    assert "did you mean 'Läufe.csv'" in text
