"""The way over lmfit: the residual is that of the fit, the derivative is exact, bounds and ties hold."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import camtorque
import lmfit
import numpy as np
import pytest
from camtorque import cli
from camtorque.commands import fit as command
from camtorque.fit.prepare import fit_data, mean_cycles
from camtorque.fit.problem import build_problem
from camtorque.fit.solver import lift_at, try_at
from camtorque.fit.starts import refined
from camtorque.lmfit_fit import OwnFit, changed, read_changes
from camtorque.mechanism.lift_laws import spectral_law
from camtorque.records import Refusal

EXAMPLE = Path(__file__).resolve().parents[2] / "raw_examples" / "A_1000rpm"
FREE = ("dead_volume", "shaft_drag", "bearing_arm", "pin_arm", "trigger_offset")


@pytest.fixture(scope="module")
def own() -> OwnFit:
    """The example's problem at its start with a second tooth, its torque replaced by that of the start with noise."""
    recording = camtorque.read(EXAMPLE)
    cycles = camtorque.align(recording, n_theta=1800)
    means = mean_cycles(cycles)
    law = spectral_law(recording.cam_table)
    data = fit_data(recording, cycles, law, means)
    first = build_problem([data])
    data = refined(data, first.values(first.start, 0)[0])
    problem = build_problem([data])
    own = OwnFit(problem, problem.start, lift_at(problem, problem.start))
    model = -own._left(problem.start)[0] / data.weight + data.torque
    noise = np.random.default_rng(11).normal(0.0, 1.0, data.torque.size) / data.weight
    second = np.array([[data.chain.trigger_angle + 1.0, 2e-4, 1e-3]])
    problem = build_problem([replace(data, torque=model + noise, teeth=second)])
    return OwnFit(problem, problem.start, own.lift)


def some_free(own: OwnFit) -> lmfit.Parameters:
    parameters = own.parameters()
    for name in parameters:
        parameters[name].set(vary=name in FREE)
    return parameters


def test_the_residual_is_that_of_the_fit(own: OwnFit) -> None:
    trial = try_at(own.problem, own.problem.start, own.lift)
    for _ in range(5):  # until the torque is linearised about the linear parameters that are found
        trial = try_at(own.problem, trial.z, own.lift)
    parameters = own.parameters()
    for name, value in zip(own.names, trial.z / own.units, strict=True):
        parameters[name].set(value=value)
    assert np.sum(own.residual(parameters) ** 2) == pytest.approx(trial.chi_square, rel=1e-9)


def test_what_python_prints_of_it_is_a_line(own: OwnFit) -> None:
    assert repr(own) == f"<OwnFit {own.problem.data[0].name}: {len(own.names)} free parameters>"


def test_the_derivative_is_exact_through_ties_too(own: OwnFit) -> None:
    parameters = some_free(own)
    parameters["bearing_arm"].set(value=200.0)
    parameters["shaft_drag"].set(value=0.1)
    parameters["pin_arm"].set(expr="0.05 * bearing_arm")
    exact = own.jacobian(parameters)
    names = [name for name in own.names if parameters[name].vary]
    assert exact.shape[1] == len(names) == 4
    for column, name in enumerate(names):
        middle, step = parameters[name].value, 1e-4 * max(1.0, abs(parameters[name].value))
        ends = []
        for value in (middle + step, middle - step):
            parameters[name].set(value=value)
            ends.append(own.residual(parameters))
        parameters[name].set(value=middle)
        numeric = (ends[0] - ends[1]) / (2.0 * step)
        # central differences over 1e-4 of a value; the valve's steps are not smooth to more
        assert np.max(np.abs(numeric - exact[:, column])) < 2e-3 * np.max(np.abs(exact[:, column])), name


def test_bounds_ties_and_fixed_values_hold(own: OwnFit) -> None:
    changes = {"pin_arm": {"expr": "0.05 * bearing_arm"}, "shaft_drag": {"min": 0.2, "max": 0.3, "value": 0.25}}
    parameters = changed(some_free(own), changes)
    minimizer = own.minimizer(parameters)
    result = minimizer.minimize()
    assert result.success
    assert result.params["pin_arm"].value == pytest.approx(0.05 * result.params["bearing_arm"].value)
    assert 0.2 <= result.params["shaft_drag"].value <= 0.3
    assert result.params["cutoff"].value == own.parameters()["cutoff"].value
    assert "dead_volume" in lmfit.fit_report(result)


def test_narrower_bounds_take_the_start_along(own: OwnFit) -> None:
    start = own.parameters()["dead_volume"].value
    assert changed(own.parameters(), {"dead_volume": {"max": 0.5 * start}})["dead_volume"].value == 0.5 * start
    with pytest.raises(Refusal, match=f"found {start:g}, expected a value from"):
        changed(own.parameters(), {"dead_volume": {"max": 0.5 * start, "value": start}})
    with pytest.raises(Refusal, match="found min 2 above max 1, expected it below; exchange them"):
        changed(own.parameters(), {"dead_volume": {"min": 2.0, "max": 1.0}})
    with pytest.raises(Refusal, match="expected it below; give min too, it is the fit's own"):
        changed(own.parameters(), {"dead_volume": {"max": -1.0}})


def test_uncertainties_and_intervals(own: OwnFit) -> None:
    parameters = some_free(own)
    minimizer = own.minimizer(parameters)
    result = minimizer.minimize()
    jacobian = own.jacobian(result.params)
    expected = np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    names = [name for name in own.names if parameters[name].vary]
    for name, std in zip(names, expected, strict=True):
        assert result.params[name].stderr == pytest.approx(std, rel=0.02), name
    true = own.parameters()["trigger_offset"].value
    assert abs(result.params["trigger_offset"].value - true) < 4.0 * result.params["trigger_offset"].stderr
    # the weights are absolute, which lmfit's own F-test takes no notice of
    for function, scale in ((own.probability, 1.0), (None, np.sqrt(result.redchi))):
        found = lmfit.conf_interval(minimizer, result, p_names=["trigger_offset"], sigmas=[1], prob_func=function)
        rows = found["trigger_offset"]
        width = 0.5 * (rows[2][1] - rows[0][1])
        assert width == pytest.approx(result.params["trigger_offset"].stderr * scale, rel=0.05)


TIED: dict[str, dict[str, object]] = {
    "leakage": {"max": 0.05}, "pin_arm": {"expr": "0.05 * bearing_arm"}, "gain_error": {"value": 0.0, "vary": False},
}  # fmt: skip
"""The example of docs/own_fit.md."""


def test_a_refit_follows_the_valley(own: OwnFit) -> None:
    parameters = changed(own.parameters(), TIED)
    minimizer = own.minimizer(parameters)
    result = minimizer.minimize()
    best = result.params["dead_volume"]
    for deviations in (-3.0, -2.0, 2.0, 3.0):
        held = result.params.copy()
        held["dead_volume"].set(value=best.value + deviations * best.stderr, vary=False)
        risen = minimizer.minimize(params=held).chisqr - result.chisqr
        # 1 where all is linear; a trust region from where the others were stopped at 2.7
        assert 0.8 < risen / deviations**2 < 1.4, deviations


def test_an_end_that_a_bound_cuts_off_is_told(own: OwnFit) -> None:
    start = own.parameters()["trigger_offset"].value
    parameters = changed(some_free(own), {"trigger_offset": {"max": start}})
    minimizer = own.minimizer(parameters)
    found = minimizer.intervals(minimizer.minimize(), ["trigger_offset"])
    (confidence, upper) = found.rows["trigger_offset"][-1]
    assert upper == np.inf
    assert confidence > 0.99
    assert found.notes[-1].endswith("99.73 %: its bound comes first")


def test_a_lower_minimum_of_a_refit_is_the_fit(own: OwnFit, monkeypatch: pytest.MonkeyPatch) -> None:
    minimizer = own.minimizer(some_free(own))
    result = minimizer.minimize()
    calls = []

    def conf_interval(_: object, best: object, p_names: list[str], prob_func: Callable[..., float]) -> dict:
        calls.append(best)
        lower = SimpleNamespace(chisqr=result.chisqr - 1.0, params=result.params.copy())
        lower.params["dead_volume"].set(vary=False)
        assert len(calls) > 1 or prob_func(best, lower)
        return {p_names[0]: [(0.68, 1.0), (0.0, 1.5), (0.68, 2.0), (0.95, 2.001)]}

    monkeypatch.setattr(lmfit, "conf_interval", conf_interval)
    found = minimizer.intervals(result, ["dead_volume"])
    assert len(calls) == 2
    assert found.result is calls[1] is not result
    assert found.result.params["dead_volume"].vary
    assert found.notes == ("dead_volume: two upper ends are one, where refits fall into another minimum",)


def test_intervals_that_refits_do_not_find_are_refused(own: OwnFit, monkeypatch: pytest.MonkeyPatch) -> None:
    parameters = own.parameters()
    for name in parameters:
        parameters[name].set(vary=name == "shaft_drag")
    minimizer = own.minimizer(parameters)
    with pytest.raises(Refusal, match="found one varying parameter, expected two"):
        minimizer.intervals(minimizer.minimize(), ["shaft_drag"])

    def conf_interval(*_: object, **__: object) -> dict:
        raise ValueError("f(a) and f(b) must have different signs")

    monkeypatch.setattr(lmfit, "conf_interval", conf_interval)
    minimizer = own.minimizer(some_free(own))
    with pytest.raises(Refusal, match="dead_volume has none by refits"):
        minimizer.intervals(minimizer.minimize(), ["dead_volume"])


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ('schema = "x"\n', "schema is 'x', expected 'camtorque-parameters/1'"),
        ('schema = "camtorque-parameters/1"\n', r"expected tables \[parameters.NAME\]"),
        (
            'schema = "camtorque-parameters/1"\n[parameters.leakage]\nmaximum = 1\n',
            "unknown key 'maximum', did you mean 'max'",
        ),
    ],
)
def test_a_parameters_file_that_cannot_be_used(tmp_path: Path, text: str, told: str) -> None:
    (tmp_path / "p.toml").write_text(text, encoding="utf-8")
    with pytest.raises(Refusal, match=told):
        read_changes(tmp_path / "p.toml")


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"leakge": {"max": 1.0}}, "parameter 'leakge': not free here, did you mean 'leakage'"),
        ({"leakage": {"expr": "2 * nothing"}}, "parameter 'leakage': .*nothing"),
        ({"leakage": {"min": 3.0, "max": 2.0}}, "parameter 'leakage'"),
        ({"leakage": {"expr": "leakage*2"}}, "the ties go in a circle, leakage -> leakage"),
        ({"leakage": {"vary": "false"}}, "parameter 'leakage' vary: found 'false', expected true or false"),
        ({"leakage": {"min": "x"}}, "parameter 'leakage' min: found 'x', expected a number"),
        ({"leakage": {"value": True}}, "parameter 'leakage' value: found True, expected a number"),
    ],
)
def test_changes_that_cannot_be_made(own: OwnFit, changes: dict[str, dict[str, object]], told: str) -> None:
    with pytest.raises(Refusal, match=told):
        changed(own.parameters(), changes)


def test_a_fit_of_nothing_or_of_other_parameters_is_refused(own: OwnFit) -> None:
    with pytest.raises(Refusal, match="are fixed or tied, expected one to vary at least"):
        changed(own.parameters(), {name: {"vary": False} for name in own.names})
    with pytest.raises(Refusal, match=r"found no parameter '.*', expected all of own.parameters"):
        own.minimizer(type(own.parameters())())
    with pytest.raises(Refusal, match=r"found parameters of type dict, expected those of own.parameters\(\)"):
        own.minimizer({"leakage": 0.1})


def test_the_command_tells_what_lmfit_tells(
    own: OwnFit, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(command, "own_fit", lambda path: own)
    fixed = "".join(f"[parameters.{name}]\nvary = false\n" for name in own.names if name not in FREE)
    (tmp_path / "p.toml").write_text(f'schema = "camtorque-parameters/1"\n{fixed}', encoding="utf-8")
    arguments = ["fit", str(EXAMPLE), "--parameters", str(tmp_path / "p.toml")]
    assert cli.main([*arguments, "--json"]) == 0
    doc = json.loads(capsys.readouterr().out)
    assert doc["parameters"]["dead_volume"]["unit"].startswith("mm")
    assert {name for name, row in doc["parameters"].items() if row["vary"]} == set(FREE)
    assert cli.main([*arguments, "--intervals", "cutoff"]) == 2
    told = capsys.readouterr().err
    assert "'cutoff' is not a varying parameter" in told
    assert "there are " in told


def test_an_error_of_many_times_a_value_is_told_without_percent() -> None:
    kept = "    leakage:  0.51 +/- 0.02 (3.92%) (init = 0.5)"
    assert command.plain_percent(kept) == kept
    beyond = "    outlet_return:  1.07e-11 +/- 0.597 (5572945809969.34%) (init = 0)"
    assert command.plain_percent(beyond) == "    outlet_return:  1.07e-11 +/- 0.597 (init = 0)"
