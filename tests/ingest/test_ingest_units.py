"""Units at the border: exact factors, refusals, and the nomenclature."""

import pytest
from camtorque.records import Refusal
from camtorque.units import BORDER_UNITS, SPELLINGS, is_known_unit, tidy_unit, unit_factor
from hypothesis import given
from hypothesis import strategies as st


@pytest.mark.parametrize(
    ("unit", "dimension", "factor"),
    [
        ("bar", "pressure", 1e5),
        ("kPa", "pressure", 1e3),
        ("MPa", "pressure", 1e6),
        ("psi", "pressure", 6894.757293168362),  # 4.4482216152605 N over (25.4 mm)^2
        ("ksi", "pressure", 6894757.293168362),
        ("bar(g)", "pressure", 1e5),
        ("PSIG", "pressure", 6894.757293168362),
        ("N m", "torque", 1.0),
        ("daNm", "torque", 10.0),
        ("Nm", "torque", 1.0),
        ("N·m", "torque", 1.0),
        ("kN m", "torque", 1e3),
        ("lbf in", "torque", 0.11298482902761670),  # 4.4482216152605 N times 25.4 mm
        ("oz-in", "torque", 0.11298482902761670 / 16.0),  # a sixteenth of a pound-force
        ("kgf cm", "torque", 0.0980665),
        ("kp/cm²", "pressure", 98066.5),
        ("kbar", "pressure", 1e8),  # no near word may stand for it: bar is a thousandth
        ("[mV]", "voltage", 1e-3),
        ("µs", "time", 1e-6),
    ],
)
def test_factors(unit: str, dimension: str, factor: float):
    assert unit_factor(unit, dimension, "here") == pytest.approx(factor, rel=1e-15)


def test_unknown_and_foreign_units_are_refused():
    with pytest.raises(Refusal, match="here: unknown unit 'baar', did you mean 'bar'"):
        unit_factor("baar", "pressure", "here")
    with pytest.raises(Refusal, match="unit 'bar' is a pressure, expected a torque unit"):
        unit_factor("bar", "torque", "here")


@pytest.mark.parametrize("unit", ["psia", "PSIA", "bar(a)", "kPa abs"])
def test_a_pressure_from_vacuum_is_refused_with_the_key_that_says_so(unit: str):
    with pytest.raises(Refusal, match='reference = "absolute" in its'):
        unit_factor(unit, "pressure", "here")


def test_millibar_and_megabar_are_not_mixed_up():
    # case carries meaning in SI: "MPA" or "mPa" must not become MPa
    assert not is_known_unit("mPa")
    assert not is_known_unit("MPA")


def test_spellings_lead_to_known_units():
    assert {tidy_unit(spelling) for spelling in SPELLINGS} <= set(BORDER_UNITS)


def test_a_current_is_no_pressure() -> None:
    """'mA' was taken for a slip of 'MPa'."""
    with pytest.raises(Refusal, match=r"unknown unit 'mA', a current: write 'V' and its sheet as if 1 mA were 1 V; a "):
        unit_factor("mA", "pressure", "here")


@pytest.mark.parametrize(
    ("unit", "dimension", "like"),
    [
        ("lbf-in", "torque", "lbf in"),
        ("ft.lbf", "torque", "lbf ft"),
        ("mN.m", "torque", "mN m"),
        ("mm³/stroke", "volume", "mm3"),
    ],
)
def test_further_spellings_of_the_bench(unit: str, dimension: str, like: str) -> None:
    assert unit_factor(unit, dimension, "") == unit_factor(like, dimension, "")


@given(st.text(max_size=12))
def test_no_text_breaks_the_table(text: str):
    if not is_known_unit(text):
        with pytest.raises(Refusal):
            unit_factor(text, "pressure", "here")
