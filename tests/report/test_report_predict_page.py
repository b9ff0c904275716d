"""The page of a prediction stands on its own."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from camtorque.config.pump import load_pump_config
from camtorque.ingest.pump_file import read_pressure_curve, read_pump
from camtorque.mechanism.contact import ContactLoss
from camtorque.mechanism.predict import predict, sweep_rows
from camtorque.report.predict_page import FIGURES, SWEEP, chart_of, prediction_page
from camtorque.units import RPM

CALIBRATION = Path(__file__).resolve().parents[2] / "calibration"


def paper_prediction():
    curve = read_pressure_curve(CALIBRATION / "paper_pressure.csv")
    return predict(load_pump_config(CALIBRATION / "paper_pump.toml"), np.array([500.0, 3000.0]) * RPM, curve)


@pytest.fixture(scope="module")
def prediction():
    return paper_prediction()


def test_page_is_self_contained_and_small(prediction):
    page = prediction_page(prediction, "pump <1>")
    assert page.count("<svg") == len(FIGURES)
    assert 'src="' not in page
    assert "<h1>pump &lt;1&gt;</h1>" in page
    assert len(page) < 1_000_000


def test_page_says_what_the_model_found(prediction):
    page = prediction_page(prediction, "pump").replace("\u00a0", " ")
    assert f"leaves the cam from {prediction.jump.speed / RPM:.0f} rpm" in page
    assert "The follower leaves the cam at" in page
    assert "<small><code>contact_lost</code></small></td><td>3000 rpm</td>" in page
    assert '<th scope="row">Hertz pressure, largest [GPa]</th><td class="n">2.143</td>' in page
    several = prediction_page(replace(prediction, on_shaft=2), "pumps")
    for heading in ("Torque of the first pump by cause", "Forces of the first pump", "Hertz pressure of the first"):
        assert heading in several
        assert heading not in page
    assert "Torque by cause, at the last speed" in page
    assert '<th scope="row">contact lost</th><td class="n">no</td><td class="n">yes</td>' in page


def test_every_figure_of_the_sweep_has_a_name_on_the_page(prediction):
    assert set(SWEEP) == set(sweep_rows(prediction)[0])


def test_a_mean_torque_that_is_rounding_alone_reads_zero():
    dry = predict(read_pump(CALIBRATION / "pump_A.toml")[0], np.array([500.0]) * RPM)
    assert abs(sweep_rows(dry)[0]["shaft_torque_mean_nm"]) < 1e-12
    assert '<th scope="row">shaft torque, mean [N m]</th><td class="n">0</td>' in prediction_page(dry, "pump")


def test_page_of_a_follower_that_never_jumps(prediction):
    calm = replace(prediction, jump=ContactLoss(float("inf"), float("nan")))
    assert "stays on the cam at every speed" in prediction_page(calm, "pump")


@pytest.mark.parametrize("name", FIGURES)
def test_every_panel_names_its_quantity_and_unit(prediction, name):
    chart = chart_of(name, prediction)
    assert chart.abscissa == "cam angle [deg]"
    for panel in chart.panels:
        assert panel.ordinate.endswith("]")
        assert len(panel.lines) >= 1
