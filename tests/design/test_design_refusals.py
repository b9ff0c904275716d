"""Every way a design task can be wrong is said in one line."""

from __future__ import annotations

import pytest
from camtorque.cli import main
from camtorque.design import read_task
from camtorque.design.front import find_front
from camtorque.ingest.pump_file import read_pump
from camtorque.records import Refusal
from design_cases import LIFT, PAPER, design_file, task_of

AIM = 'peak_torque_nm = "least"'
OFFSET = "follower_offset_mm = [-6, 9]"

REFUSED = [
    ({"free": "follower_offset_mm = 3"}, r"follower_offset_mm: found 3, expected two bounds .* without bounds cannot"),
    ({"free": "follower_offset_mm = [5, -5]"}, r"found \[5, -5\], expected two bounds"),
    ({"free": 'rise_deg = ["a", 3]'}, "expected two bounds"),
    ({"free": f"rise_deg = [10, 1{'0' * 400}]"}, "expected two bounds"),
    ({"free": "base_circle_radius_mm = [0.018, 0.025]"}, r"bounds 0\.018 to 0\.025, but the pump has 20 .* the unit"),
    ({"free": "plunger_diameter_mm = [6000, 9000]"}, r"found bounds 6000 to 9000, but the pump has 8 "),
    ({"free": "base_circle_radius_m = [0.018, 0.025]"}, "did you mean 'base_circle_radius_mm'"),
    ({"free": "rise_deg = [-10, 60]"}, "found a lower bound of -10, expected at least 1"),
    ({"free": "phase_2_deg = [0, 90]"}, r"phase_2_deg: nothing .* free; the pump file has 1 pump on the shaft: give"),
    ({"free": "follower_offset_mm = [-0.006, 0.009]"}, "-0.006 to 0.009, but the base circle has 20 .* check the unit"),
    ({"free": "follower_offset_mm = [-30, 9]"}, "reaches 30 mm, but base circle and roller may be as small as 28 mm"),
    ({"free": ""}, r"\[free\]: nothing is free"),
    ({"aims": ""}, r"\[aims\]: is empty, expected at least one of peak_torque_nm"),
    ({"aims": 'peak_torque = "least"'}, "peak_torque: unknown, did you mean 'peak_torque_nm'"),
    ({"aims": 'jump_speed_rpm = "least"'}, "jump_speed_rpm: found 'least', expected 'most'"),
    ({"aims": 'friction_work_j = "least"'}, r"friction_work_j is asked for, but .* has no \[friction\]"),
    ({"limits": "hertz_gpa = 2.0"}, r"hertz_gpa: found 2\.0, expected \{ most = number \}"),
    ({"limits": "hertz_gpa = { least = 2.0 }"}, r"expected \{ most = number \}"),
    ({"limits": 'delivery_mm3 = { equal = "much" }'}, "equal: found 'much', expected a number"),
    ({"limits": "cam_size_mm = { most = 2.0 }"}, "cam_size_mm: unknown"),
    ({"lift": '[lift]\nlaw = "sine"\n'}, "found 'sine', expected one or a list of bspline, simple_harmonic"),
    ({"lift": "[lift]\ndegre = 3\n"}, "unknown key 'degre', did you mean 'degree'"),
    ({"load": "[[load]]\nspeed_rpm = 500\n"}, "pressure_bar: this key is missing; give it, or a pressure_file"),
    ({"load": "[[load]]\nspeed_rpm = 5\npressure_bar = 6\nspills_mm = 0.1\n"}, r"found 0\.1 mm, expected at least"),
    ({"load": "[[load]]\npressure_bar = 6\nspills_mm = 3\n"}, "speed_rpm: this key is missing; cam speeds"),
    ({"load": "[[load]]\nspeed_rpm = 5\npressure_bar = 6\nspills_mm = 3\npressure_file = 'p.csv'\n"},
     "pressure_bar: found pressure_bar and pressure_file in one load, expected one of them"),
    ({"load": "[[load]]\nspeed_rpm = 5\nspills_mm = 3\nrecording = 'A'\n"}, "found spills_mm and recording in one"),
    ({"load": "[[load]]\nspeed_rpm = 5\npressure_file = 5\n"}, "pressure_file: found 5, expected"),
    ({"load": ""}, r"expected at least one \[\[load\]\] table"),
    ({"more": '[answer]\nchoose = "best"\n'}, "choose: found 'best', expected 'knee' or one of the aims"),
    ({"more": "[tolerances]\nlift_um = -1\n"}, "lift_um: found -1, expected a number from 0"),
    ({"more": "[limit]\n"}, "unknown key 'limit', did you mean 'limits'"),
]  # fmt: skip


@pytest.mark.parametrize(("parts", "message"), REFUSED)
def test_wrong_design_file_is_refused(tmp_path, parts, message):
    with pytest.raises(Refusal, match=message):
        task_of(tmp_path, **{"free": OFFSET, "aims": AIM, **parts})


def test_another_file_is_known_by_its_schema(tmp_path):
    pump = PAPER.read_text(encoding="utf-8")
    (tmp_path / "pump.toml").write_text(pump, encoding="utf-8")
    with pytest.raises(Refusal, match=r"schema is 'camtorque-pump/1', expected 'camtorque-design/1'"):
        read_task(tmp_path / "pump.toml")
    with pytest.raises(Refusal, match=r"schema is 'camtorque-design/1', expected 'camtorque-pump/1'"):
        read_pump(design_file(tmp_path, free=OFFSET, aims=AIM))


def test_a_pump_of_impossible_or_unusual_sizes_is_told(tmp_path):
    text = PAPER.read_text(encoding="utf-8")
    pump = tmp_path / "pump.toml"
    pump.write_text(text.replace("follower_mass_kg = 0.075", "follower_mass_kg = 0.75"), encoding="utf-8")
    found = task_of(tmp_path, free=OFFSET, aims=AIM, pump=pump).findings
    assert {row.code for row in found} == {"pump_unusual"}
    pump.write_text(text.replace("follower_mass_kg = 0.075", "follower_mass_kg = 75"), encoding="utf-8")
    with pytest.raises(Refusal, match="follower mass over that of a steel cube"):
        task_of(tmp_path, free=OFFSET, aims=AIM, pump=pump)


def test_limits_that_collide_are_named_with_what_is_missing(tmp_path):
    limits = "pressure_angle_deg = { most = 20 }\ncam_radius_mm = { most = 26 }"
    free = "base_circle_radius_mm = [15, 30]\nfollower_offset_mm = [-6, 9]"
    task = task_of(tmp_path, free=free, aims=AIM, limits=limits)
    with pytest.raises(Refusal, match="no design keeps all limits") as caught:
        find_front(task, lambda text: None)
    text = str(caught.value)
    assert "pressure angle deg most 20 (reached" in text
    assert "cam radius mm most 26 (reached" in text
    assert "collide" in text
    assert "\n" not in text


def test_limit_that_no_design_can_meet_names_the_bound_it_meets(tmp_path):
    task = task_of(tmp_path, free="base_circle_radius_mm = [18, 22]", aims=AIM, limits="cam_radius_mm = { most = 25 }")
    with pytest.raises(Refusal, match=r"cam radius mm most 25 \(reached 26, missed by 1 mm\) cannot be met within the "
                                      "lower bound of base_circle_radius_mm"):  # fmt: skip
        find_front(task, lambda text: None)


def test_a_limit_of_nothing_names_the_limit_that_gives_way_to_it(tmp_path):
    """Contact at 4000 rpm asks for a spring that its limit forbids."""
    load = "[[load]]\nspeed_rpm = 4000\npressure_bar = 600\ncloses_mm = 1.5\nspills_mm = 4.5\n"
    free = "spring_preload_N = [5, 110]\nspring_stiffness_N_per_mm = [1, 20]"
    limits = "contact_force_n = { least = -1000 }\nspring_force_n = { most = 60 }"
    task = task_of(tmp_path, free=free, aims=AIM, limits=limits, load=load)
    with pytest.raises(Refusal, match=r"contact force n least 0 \(reached -.* and spring force n most 60 \(reached 2.*"
                                      "collide within the upper bound of spring_preload_N"):  # fmt: skip
        find_front(task, lambda text: None)


@pytest.mark.parametrize("limit", ["least = 340", "most = 700"])
def test_a_looser_limit_of_the_user_leaves_the_cam_its_rest_on_the_base_circle(tmp_path, limit):
    free = "rise_deg = [150, 220]\nreturn_deg = [150, 220]"
    task = task_of(
        tmp_path, free=free, aims=AIM, limits=f"lobe_angle_deg = {{ {limit} }}", more="[answer]\nstarts = 1\n"
    )
    (point,) = find_front(task, lambda text: None).points[:1]
    assert 340.0 <= sum(point.design.values[name] for name in ("rise_deg", "top_dwell_deg", "return_deg")) < 359.01


@pytest.mark.parametrize(("limit", "message"), [
    ("hertz_gpa = { most = 1800 }", r"hertz_gpa: found most 1800 GPa, but the first guess has .* limit nothing; check"),
    ("convex_radius_mm = { least = 0.005 }", r"found least 0\.005 mm, but the first guess has .* check the unit"),
])  # fmt: skip
def test_a_limit_in_another_unit_that_limits_nothing_is_refused(tmp_path, limit, message):
    task = task_of(tmp_path, free=OFFSET, aims=AIM, limits=limit)
    with pytest.raises(Refusal, match=message):
        find_front(task, lambda text: None)


def test_the_friction_of_a_fit_is_asked_for_by_the_command(tmp_path):
    with pytest.raises(Refusal, match=r"unknown key 'fit'"):
        task_of(tmp_path, lift='fit = "result.json"\n' + LIFT, free=OFFSET, aims=AIM)


def test_command_refuses_in_one_line_and_writes_nothing(tmp_path, capsys):
    path = design_file(tmp_path, free="follower_offset_mm = 3", aims=AIM)
    assert main(["design", str(path), "--out", str(tmp_path / "out")]) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()
