"""Half of the work in a second process: the same results in order, whatever becomes of it, no trace of it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from camtorque.process.second_process import in_two, second_process
from camtorque.records import Array

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="a fork beside threads is safe on Linux alone")
HOME = os.getpid()


@pytest.fixture(autouse=True)
def two_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever machine this is."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1})


def squared(number: int) -> tuple[int, int]:
    time.sleep(0.02)  # so that one process does not do them all
    return number**2, os.getpid()


def weighing(weight: int) -> tuple[int, int]:
    time.sleep(0.02 * weight)
    return weight, os.getpid()


def beginning(_: int) -> tuple[int, float]:
    begun = time.monotonic()
    time.sleep(0.4)
    return os.getpid(), begun


def dying(number: int) -> int:
    if os.getpid() != HOME:
        os._exit(1)
    time.sleep(0.02)
    return number


def failing(number: int) -> int:
    raise FloatingPointError(f"number {number}")


def divided(number: int) -> list[tuple[int, int]]:
    return in_two(squared, [number, number + 1])


def read_only(size: int) -> Array:
    found = np.zeros(size)
    found.setflags(write=False)
    return found


def test_results_come_in_order_from_two_processes_again_and_again() -> None:
    with second_process():
        for count in (5, 2, 4):
            found = in_two(squared, range(count))
            assert [value for value, _ in found] == [k**2 for k in range(count)]
            assert len({number for _, number in found}) == 2
    assert {number for _, number in in_two(squared, range(3))} == {os.getpid()}


def test_a_process_begins_the_next_item_as_soon_as_it_has_done_one() -> None:
    with second_process():
        found = in_two(weighing, [1, 20, 1, 1, 1, 1])
    (long,) = [number for weight, number in found if weight == 20]
    assert [number for weight, number in found[2:] if number == long] == []


def test_the_first_item_goes_before_the_others_unless_both_begin_at_once() -> None:
    with second_process():
        found = in_two(beginning, [0, 1], at_once=True)
    assert found[0][0] != found[1][0]
    with second_process():
        (_, first), (_, second) = in_two(beginning, [0, 1])
    assert second - first >= 0.4


def test_one_core_or_one_item_needs_no_second_process(monkeypatch: pytest.MonkeyPatch) -> None:
    with second_process():
        assert in_two(squared, [3]) == [(9, os.getpid())]
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0})
    with second_process():
        assert {number for _, number in in_two(squared, range(4))} == {os.getpid()}


def test_no_process_is_left_behind() -> None:
    with second_process():
        (child,) = {number for _, number in in_two(squared, range(4))} - {os.getpid()}
        assert Path(f"/proc/{child}").exists()
    assert not Path(f"/proc/{child}").exists()


def test_where_it_dies_this_process_does_its_part() -> None:
    with second_process():
        assert in_two(dying, range(5)) == list(range(5))
        assert {number for _, number in in_two(squared, range(4))} == {os.getpid()}


def test_an_error_is_that_of_one_process() -> None:
    with second_process(), pytest.raises(FloatingPointError, match="number 0"):
        in_two(failing, range(4))
    with second_process():
        assert in_two(squared, range(2))[1][0] == 1
        with pytest.raises(FloatingPointError, match="number 1"):
            in_two(partial(_failing_later), range(2))
        assert [value for value, _ in in_two(squared, range(3))] == [0, 1, 4]


def _failing_later(number: int) -> int:
    return failing(number) if number else number


def test_work_is_not_divided_twice() -> None:
    with second_process():
        for pair in in_two(divided, range(4)):
            assert len({number for _, number in pair}) == 1


def test_arrays_stay_read_only() -> None:
    with second_process():
        assert [array.flags.writeable for array in in_two(read_only, (3, 4))] == [False, False]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_a_stopped_process_leaves_no_second_one(number: int) -> None:
    code = (
        "import os, sys, time\n"
        "from camtorque.process.second_process import in_two, second_process\n"
        "from camtorque.process.stopping import stoppable\n"
        "os.sched_getaffinity = lambda _: {0, 1}\n"
        "def told(item):\n"
        "    os.write(1, b'%d\\n' % os.getpid())\n"
        "    time.sleep(0.01 if item < 1 else 60)\n"
        "with stoppable(), second_process():\n"
        "    in_two(told, [0, 1, 2])\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True
    ) as process:
        assert process.stdout
        numbers = {int(process.stdout.readline()) for _ in range(3)}
        (child,) = numbers - {process.pid}
        process.send_signal(number)
        assert process.wait(20) != 0
    end = time.monotonic() + 10.0
    while Path(f"/proc/{child}/exe").exists() and time.monotonic() < end:
        time.sleep(0.02)
    assert not Path(f"/proc/{child}/exe").exists()
