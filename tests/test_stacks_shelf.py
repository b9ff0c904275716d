"""Arrays that go to disk come back as they were, also where the disk gives no room."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from camtorque.stacks import Shelf


def test_few_arrays_stay_in_memory_and_more_go_to_disk():
    shelf = Shelf(held=8 * 10)
    first, second = np.arange(10.0), np.arange(12.0).reshape(3, 4)[:, ::2]
    kept, parked = shelf.put(first), shelf.put(second)
    assert kept() is first
    assert parked() is not second
    np.testing.assert_array_equal(parked(), second)
    assert shelf.put(np.zeros((0, 3)))().shape == (0, 3)


def test_threads_may_share_a_shelf():
    shelf = Shelf(held=0)
    arrays = [np.full((50, 7), float(k)) for k in range(60)]
    with ThreadPoolExecutor(4) as pool:
        parked = list(pool.map(shelf.put, arrays))
        found = list(pool.map(lambda give: give(), parked))
    for array, back in zip(arrays, found, strict=True):
        np.testing.assert_array_equal(back, array)


@pytest.mark.parametrize("written", [OSError("No space left on device"), 5])
def test_where_the_disk_gives_no_room_arrays_stay_in_memory(monkeypatch: pytest.MonkeyPatch, written):
    def full(*_: object) -> int:
        if isinstance(written, OSError):
            raise written
        return written

    monkeypatch.setattr(os, "pwrite", full)
    array = np.arange(4.0)
    assert Shelf(held=0).put(array)() is array
