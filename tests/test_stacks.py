"""Stacks of cycles: on disk or in memory, sums over cycles are those of numpy."""

from __future__ import annotations

import numpy as np
import pytest
from camtorque import stacks
from camtorque.stacks import distance_of, empty_stack, give_back, mean_of, products_of, std_of


@pytest.fixture(params=["memory", "nameless file"])
def stack(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> np.ndarray:
    if request.param == "nameless file":
        monkeypatch.setattr(stacks, "LARGEST_IN_MEMORY", 1000)
    monkeypatch.setattr(stacks, "GIVEN_BACK", 4000)
    monkeypatch.setattr(stacks, "PIECE_VALUES", 500)
    rows = empty_stack(31, 90)
    assert isinstance(rows, np.memmap) == (request.param != "memory")
    rows[:] = 5.0 + np.random.default_rng(1).standard_normal(rows.shape)
    return rows


def test_sums_over_cycles_are_those_of_numpy(stack: np.ndarray) -> None:
    chosen = np.arange(31) % 3 == 1
    np.testing.assert_allclose(mean_of(stack), np.mean(stack, axis=0), rtol=1e-13)
    np.testing.assert_allclose(mean_of(stack, chosen), np.mean(stack[chosen], axis=0), rtol=1e-13)
    for ddof in (0, 1):
        np.testing.assert_allclose(std_of(stack, mean_of(stack), ddof), np.std(stack, axis=0, ddof=ddof), rtol=1e-12)


def test_distance_from_a_cycle_is_that_of_numpy(stack: np.ndarray) -> None:
    centre = np.asarray(stack[3])
    for stride in (1, 7):
        expected = np.sqrt(np.mean((stack - centre)[:, ::stride] ** 2, axis=1))
        np.testing.assert_allclose(distance_of(stack, centre[::stride], stride), expected, rtol=1e-12)


def test_products_with_weights_are_those_of_numpy(stack: np.ndarray) -> None:
    weights = np.linspace(-1.0, 2.0, 90)
    np.testing.assert_allclose(products_of(stack, weights), stack @ weights, rtol=1e-12)


def test_values_are_kept_when_their_memory_is_given_back(stack: np.ndarray) -> None:
    before = np.array(stack)
    give_back(stack[3:])
    np.testing.assert_array_equal(stack, before)


def test_without_room_on_disk_a_stack_lies_in_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*arguments: object) -> None:
        raise OSError("no space left on device")

    monkeypatch.setattr(stacks, "LARGEST_IN_MEMORY", 1000)
    monkeypatch.setattr("os.posix_fallocate", full)
    rows = empty_stack(31, 90)
    assert not isinstance(rows, np.memmap)
