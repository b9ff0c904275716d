"""Ends of delivery are looked for where a fit knows them, whatever it leaves open of how sharp they are."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from camtorque.fit.arrow import ArrowCovariance
from camtorque.fit.endings import LEAST_STD, load_for
from camtorque.fit.known_ends import END_OF, WIDTHS_OF, Curve, EndTradeOff, trade_offs_of
from camtorque.fit.known_fit import FittedAt, KnownFit, draws

THETA = np.linspace(0.0, 2.0 * np.pi, 1800, endpoint=False)
CHAIN = SimpleNamespace(
    theta=THETA, lobes=1, law=SimpleNamespace(evaluate=lambda theta, order: np.sin(np.minimum(theta, np.pi)))
)
SPEEDS, WIDTHS, END = {"a": 50.0, "b": 60.0, "c": 75.0}, [0.1, 0.2, 0.15], 0.8
OVER_WIDTH = [1.0 / width for width in WIDTHS]
TRADE_OFFS = {"land": EndTradeOff("land", 0.3), "spill": EndTradeOff("spill", -0.01, float(np.mean(OVER_WIDTH)))}
"""That land's line pressure falls where the port has closed by a size, that spill's as it begins to open."""


def falling(speed: float) -> Curve:
    """Return a line pressure that falls at `END`."""
    fall = 1.0 / (1.0 + np.exp((THETA - END) / (2e-4 * speed)))
    return Curve(THETA, 1e7 + 4e7 * fall * np.minimum(THETA, 1.0), speed)


def traded(trade_off: EndTradeOff, common: float = 0.0) -> KnownFit:
    """Return a fit that knows where three ends have opened by some size, and trades place against width.

    ``common`` : of a trade that is the same in all three and the other way round, relative to the first
    """
    firm = END if trade_off.structure == "land" else float(np.sin(END))
    places, slopes = zip(*((firm + trade_off.shift(w), trade_off.slope(w)) for w in WIDTHS), strict=True)
    root = np.zeros((6, 4))
    for k, slope in enumerate(slopes):
        root[[k, 3 + k], k] = 0.02 * slope, 0.02
        root[[k, 3 + k], 3] = -common * trade_off.pull, common * trade_off.pull / slope
    names = [
        f"{name}__{one}" for name in (END_OF[trade_off.structure], WIDTHS_OF[trade_off.structure][0]) for one in SPEEDS
    ]
    recordings = tuple(FittedAt(one, speed, trade_off.structure, 0.01, True) for one, speed in SPEEDS.items())
    covariance = ArrowCovariance.whole(root @ root.T + 1e-12 * np.eye(6))
    return KnownFit(tuple(names), np.array([*places, *WIDTHS]), covariance, recordings)


@pytest.mark.parametrize("structure", list(TRADE_OFFS))
def test_an_end_is_looked_for_where_the_fit_knows_it(structure: str) -> None:
    """Places differ by 2 degrees, and a fit leaves 0.3 of each open: where the port has opened is known."""
    trade_off = TRADE_OFFS[structure]
    fit = traded(trade_off)
    source, templates = fit.recordings[1], {item.id: falling(item.speed) for item in fit.recordings}
    load = load_for(fit, source, templates, CHAIN, falling(65.0))  # type: ignore[arg-type]
    name, by = END_OF[structure], WIDTHS_OF[structure][0]
    place, width = load.ends[name], load.ends[by]
    firm = END if structure == "land" else float(np.sin(END))
    assert place.value == pytest.approx(firm + trade_off.shift(width.value), abs=0.003)
    assert place.stderr < 1.5 * LEAST_STD, "misses are those of where it has opened"
    assert load.pulls == {name: (by, pytest.approx(trade_off.slope(width.value), rel=1e-3))}
    mean = {"torque_zero": 0.0, "pressure_zero": 0.0, **{name: end.value for name, end in load.ends.items()}}
    drawn = draws(fit, fit.own(source.id), mean, load, 1e-3, 60)
    moved = np.array([[item[one] - mean[one] for one in (name, by)] for item in drawn]) / 1e-3
    assert np.std(moved[:, 1]) > 0.01
    assert np.std(moved[:, 0] - trade_off.slope(width.value) * moved[:, 1]) < 1.3 * place.stderr, "the trade moves both"


@pytest.mark.parametrize("structure", list(TRADE_OFFS))
def test_what_a_fit_trades_in_all_recordings_alike_moves_no_end_against_another(structure: str) -> None:
    both = trade_offs_of(traded(TRADE_OFFS[structure], common=0.5), structure, traded(TRADE_OFFS[structure]).recordings)
    assert [known.pull for known in both] == pytest.approx(2 * [TRADE_OFFS[structure].pull], rel=1e-3)
    assert [known.middle for known in both] == pytest.approx(
        [np.mean(WIDTHS if structure == "land" else OVER_WIDTH), 0.0]
    )


def test_ends_without_widths_of_their_own_are_taken_as_they_are() -> None:
    recordings = tuple(FittedAt(one, speed, "land", 0.01, True) for one, speed in SPEEDS.items())
    fit = KnownFit(tuple(f"end_of_delivery__{one}" for one in SPEEDS), np.array([0.7, 0.8, 0.9]),
                   ArrowCovariance.whole(np.eye(3)), recordings)  # fmt: skip
    assert trade_offs_of(fit, "land", recordings) == (EndTradeOff("land"),)
    assert EndTradeOff("spill").shift(0.1) == 0.0
