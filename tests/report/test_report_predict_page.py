"""The page of a prediction stands on its own."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from camtorque.config_pump import load_pump_config
from camtorque.ingest.pump_file import read_pressure_curve
from camtorque.mechanism.contact import ContactLoss
from camtorque.mechanism.predict import predict
from camtorque.report.predict_page import FIGURES, figure_of, prediction_page
from camtorque.units import RPM

CALIBRATION = Path(__file__).resolve().parents[2] / "calibration"


@pytest.fixture(scope="module")
def prediction():
    curve = read_pressure_curve(CALIBRATION / "paper_pressure.csv")
    return predict(load_pump_config(CALIBRATION / "paper_pump.toml"), np.array([500.0, 3000.0]) * RPM, curve)


def test_page_is_self_contained_and_small(prediction):
    page = prediction_page(prediction, "pump <1>")
    assert page.count("data:image/png;base64,") == len(FIGURES)
    assert "http" not in page
    assert "<h1>pump &lt;1&gt;</h1>" in page
    assert len(page) < 1_000_000


def test_page_says_what_the_model_found(prediction):
    page = prediction_page(prediction, "pump")
    assert f"leaves the cam from {prediction.jump.speed / RPM:.0f} rpm" in page
    assert "the follower leaves the cam (3000 rpm)" in page
    assert "<th>hertz_max_gpa</th><td>2.143</td>" in page
    assert "<th>contact_lost</th><td>no</td><td>yes</td>" in page


def test_page_of_a_follower_that_never_jumps(prediction):
    calm = replace(prediction, jump=ContactLoss(float("inf"), float("nan")))
    assert "stays on the cam at every speed" in prediction_page(calm, "pump")


@pytest.mark.parametrize("title", FIGURES)
def test_every_figure_names_its_axes(prediction, title):
    axis = figure_of(title, prediction).axes[0]
    assert axis.get_xlabel() == "cam angle [deg]"
    assert axis.get_ylabel() or axis.get_legend() is not None
    assert len(axis.lines) >= 1
