"""Cams from sections: textbook peaks, continuity, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from camtorque.mechanism.sections import FLANKS, Section, dwell, flank, section_law, tangent_sections
from camtorque.records import Refusal
from camtorque.units import TURN
from mechanism_cases import DEGREE, analytic_law

# Peak velocity and acceleration of a unit flank (Norton 2009, Table 3-5; Neklutin's modified sine 1.760, 5.528)
PEAKS = {
    "simple_harmonic": (np.pi / 2.0, np.pi**2 / 2.0),
    "cycloidal": (2.0, 2.0 * np.pi),
    "modified_sine": (1.7596, 5.5280),
    "polynomial_345": (1.875, 10.0 / np.sqrt(3.0)),
    "polynomial_4567": (2.1875, 7.5132),
}


def test_every_flank_has_its_textbook_peaks():
    assert set(PEAKS) == set(FLANKS)


@pytest.mark.parametrize("kind", FLANKS)
def test_peaks_are_those_of_the_textbook(kind):
    law = analytic_law(kind)
    width, lift = 60.0 * DEGREE, 8e-3
    rise = np.linspace(1e-9, width - 1e-9, 20001)
    velocity, acceleration = PEAKS[kind]
    # the table gives four digits
    assert np.max(law.evaluate(rise, 1)) * width / lift == pytest.approx(velocity, rel=1e-4)
    assert np.max(np.abs(law.evaluate(rise, 2))) * width**2 / lift == pytest.approx(acceleration, rel=1e-4)
    assert law.evaluate(np.array([70.0 * DEGREE]))[0] == pytest.approx(lift, abs=1e-15)


@pytest.mark.parametrize("kind", FLANKS)
def test_derivatives_are_consistent(kind):
    law, h = analytic_law(kind), 1e-5
    angle = np.random.default_rng(0).uniform(0.05, 2.3, 200)
    for derivative in (1, 2):
        difference = (law.evaluate(angle + h, derivative - 1) - law.evaluate(angle - h, derivative - 1)) / (2.0 * h)
        expected = law.evaluate(angle, derivative)
        # central difference, except within h of a knot where the jerk jumps
        close = np.abs(difference - expected) < 1e-5 * np.max(np.abs(expected))
        assert np.mean(close) > 0.98


def test_continuity_tells_the_flanks_apart():
    jumps = {kind: analytic_law(kind).continuity_at_knots().max(axis=1) for kind in FLANKS}
    smooth = 1e-9
    assert all(jump[1] < smooth for jump in jumps.values())
    assert jumps["simple_harmonic"][2] > 0.01
    assert all(jumps[kind][2] < smooth for kind in FLANKS if kind != "simple_harmonic")
    assert jumps["polynomial_4567"][3] < 1e-6 < jumps["cycloidal"][3]


def test_tangent_cam_has_its_lift_and_a_straight_flank():
    sections = tangent_sections(0.02, 0.008, 8e-3, 5e-3)
    law = section_law([*sections, dwell(TURN - sum(s.angle for s in sections))])
    angle = np.array([0.1, 0.2])
    assert angle[1] < sections[0].angle
    assert np.allclose(law.evaluate(angle), 0.028 * (1.0 / np.cos(angle) - 1.0), rtol=1e-12)
    top = sum(s.angle for s in sections) / 2.0
    assert law.evaluate(np.array([top]))[0] == pytest.approx(8e-3, rel=1e-12)
    assert law.evaluate(np.array([top]), 1)[0] == pytest.approx(0.0, abs=1e-12)
    assert law.continuity_at_knots()[2].max() > 0.01


def test_lobe_may_start_anywhere():
    rest = dwell(TURN - 2.0)
    plain = section_law([flank("cycloidal", 1.0, 8e-3), flank("cycloidal", 1.0, -8e-3), rest])
    moved = section_law([flank("cycloidal", 1.0, 8e-3), flank("cycloidal", 1.0, -8e-3), rest], start=5.5)
    angle = np.linspace(0.0, 7.0, 60)
    assert np.allclose(moved.evaluate(angle + 5.5), plain.evaluate(angle), atol=1e-15)


def test_refusals_say_what_to_do():
    with pytest.raises(Refusal, match=r"add up to 57\.\d+ deg, expected 360"):
        section_law([dwell(1.0)])
    with pytest.raises(Refusal, match="kind 'parabola' is unknown, expected one of simple_harmonic"):
        flank("parabola", 1.0, 1e-3)
    with pytest.raises(Refusal, match="angle is 0 rad, expected more than 0"):
        dwell(0)
    with pytest.raises(Refusal, match=r"lift jumps by 0\.001"):
        section_law([flank("cycloidal", 1.0, 1e-3), dwell(TURN - 1.0)])
    fall, rise = flank("cycloidal", 1.0, -8e-3), flank("cycloidal", 1.0, 8e-3)
    with pytest.raises(Refusal, match=r"the lift goes down to -8 mm at 57\.296 deg, expected 0 mm or more"):
        section_law([fall, rise, dwell(TURN - 2.0)])
    ramp = Section("ramp", 1.0, lambda x: 1e-3 * x)
    back = Section("ramp", 1.0, lambda x: -1e-3 * x)
    with pytest.raises(Refusal, match=r"velocity jumps by 0\.00\d+ at"):
        section_law([ramp, back, dwell(TURN - 2.0)])
    with pytest.raises(Refusal, match=r"nose radius 0\.03 m does not fit"):
        tangent_sections(0.02, 0.008, 8e-3, 0.03)
