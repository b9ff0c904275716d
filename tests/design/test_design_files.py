"""A design file in; a front, a page and files that are read back out."""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path

import numpy as np
import pytest
from camtorque.cli import main
from camtorque.design import read_task
from camtorque.design.answer import lift_table_text, pump_text, solve_task, write_chosen
from camtorque.design.explain import shifted_follower, spreads
from camtorque.design.front import find_front, references
from camtorque.design.problem import Problem
from camtorque.design.responses import RESPONSES
from camtorque.design.schema import QUANTITIES
from camtorque.ingest.pump_file import read_pressure_curve, read_pump
from camtorque.mechanism.friction import Friction
from camtorque.mechanism.kinematics import kinematics
from camtorque.mechanism.mounting import PumpUnit
from camtorque.mechanism.predict import cam_of, mounting_of, pressure_at
from camtorque.mechanism.shaft import solve_shaft
from camtorque.mechanism.solve import solve_rigid
from camtorque.mechanism.torque import closed_form_tables
from camtorque.progress import silent
from camtorque.records import Refusal
from camtorque.units import RPM
from design_cases import PAPER, design_file, shaft, task_of

FREE = "follower_offset_mm = [-6, 9]\nrise_deg = [50, 70]\nroller_radius_mm = [7, 11]"
AIMS = 'peak_torque_nm = "least"\nhertz_gpa = "least"'
LIMITS = "convex_radius_mm = { least = 4 }\njump_speed_rpm = { least = 2400 }\ndelivery_angle_deg = { most = 16 }"
FEW = "[answer]\npoints = 6\nstarts = 1\n"


def test_the_paper_pump_is_evaluated_as_the_mechanism_does(tmp_path):
    task = task_of(tmp_path, lift='[lift]\nlaw = "polynomial_4567"\n', free="follower_offset_mm = [-6, 9]", aims=AIMS)
    problem = Problem(task, task.families[0])
    design = problem.evaluated(problem.start())
    law = design.lobe.law()
    theta = np.linspace(0.0, 2.0 * np.pi, 20001)
    lift = law.evaluate(theta)
    corners = design.loads[0]
    pressure = np.where(law.evaluate(theta, 1) > 0.0, corners.on_rise(lift), 0.0)
    solved = solve_rigid(task.config.pump, law, theta, pressure, 500.0 * RPM)
    expected = {
        "peak_torque_nm": np.max(solved.torque),
        "torque_ripple_nm": np.ptp(solved.torque),
        "hertz_gpa": 1e-9 * np.max(solved.forces.hertz),
        "side_force_n": np.max(np.abs(solved.forces.guide)),
        "contact_force_n": np.min(solved.forces.contact_normal),
        "jump_speed_rpm": closed_form_tables(task.config.pump, law, theta).jump().speed / RPM,
        "convex_radius_mm": 5.013,
        "delivery_mm3": 150.8,
        "cam_radius_mm": 28.0,
    }
    for name, value in expected.items():
        assert RESPONSES[name].value(design) == pytest.approx(value, rel=1e-3), name


def test_front_is_a_front_and_the_same_again(tmp_path):
    task = task_of(tmp_path, free=FREE, aims=AIMS, limits=LIMITS, more=FEW)
    front = find_front(task, silent)
    aims = np.array([point.aims for point in front.points])
    assert len(aims) == 6
    for point in aims:
        assert not np.any(np.all(aims < point - 1e-6, axis=1))
    assert np.all(np.diff(aims[:, 0]) > 0.0)
    assert np.all(np.diff(aims[:, 1]) < 0.0)
    again = find_front(task, silent)
    assert np.array_equal(aims, np.array([point.aims for point in again.points]))
    for point in front.points:
        design = point.evaluated
        assert RESPONSES["jump_speed_rpm"].value(design) > 2400.0 * (1.0 - 1e-4)
        assert RESPONSES["convex_radius_mm"].value(design) > 4.0 * (1.0 - 1e-4)


def test_flanks_compete_on_one_front(tmp_path):
    lift = '[lift]\nlaw = ["polynomial_4567", "modified_sine"]\n'
    front = find_front(task_of(tmp_path, lift=lift, free=FREE, aims=AIMS, limits=LIMITS, more=FEW), silent)
    assert {point.problem.family.name for point in front.points} == {"modified_sine"}


def test_a_fixed_flank_competes_where_nothing_but_the_other_flank_is_free(tmp_path):
    lift = '[lift]\nlaw = ["bspline", "modified_sine"]\npieces = 4\n'
    front = find_front(task_of(tmp_path, lift=lift, aims='peak_torque_nm = "least"', more=FEW), silent)
    assert {point.problem.family.name for point in front.points} == {"bspline"}


def test_an_acceleration_that_jumps_is_that_of_the_flank_alone(tmp_path):
    rough = tmp_path / "rough.toml"
    friction = "[friction]\nguide = 0.1\nbearing_arm_um = 100\npin_arm_um = 30\n"
    rough.write_text(PAPER.read_text().replace("follower_offset_m = 0.0", "follower_offset_m = -0.003") + friction)
    task = task_of(tmp_path, pump=rough, lift='[lift]\nlaw = "simple_harmonic"\n', free=FREE, aims=AIMS,
                   load="[[load]]\nspeed_rpm = 2000\npressure_bar = 0\nspills_mm = 4\n")  # fmt: skip
    problem = Problem(task, task.families[0])
    design = problem.evaluated(problem.start())
    theta = np.linspace(0.0, 2.0 * np.pi, 36000, endpoint=False)
    tables = closed_form_tables(
        design.pump, design.lobe.law(), theta, mounting_of(task.config), Friction(*task.config.friction)
    )
    causes = tables.torque_by_cause(np.zeros(theta.size), 2000.0 * RPM, 0.0)
    work = 2.0 * np.pi * sum(np.mean(causes[name]) for name in causes if name.endswith("_friction"))
    assert RESPONSES["friction_work_j"].value(design) == pytest.approx(work, rel=2e-3)
    hollow = -1e3 / np.min(tables.kinematics.surface_curvature)
    assert RESPONSES["hollow_radius_mm"].value(design) == pytest.approx(hollow, rel=1e-4)


@pytest.mark.parametrize("offset", [0.0, 9.0, -9.0])
def test_radius_of_a_cam_is_that_of_its_farthest_contact(tmp_path, offset):
    task = task_of(tmp_path, free=f"follower_offset_mm = [{offset - 1.0}, {offset + 1.0}]", aims=AIMS)
    design = Problem(task, task.families[0]).evaluated(np.array([0.5]))
    x, y = kinematics(design.pump, design.lobe.law(), np.linspace(0.0, 2.0 * np.pi, 3601)).contact_point
    assert RESPONSES["cam_radius_mm"].value(design) == pytest.approx(1e3 * np.max(np.hypot(x, y)), rel=1e-6)


def test_price_of_a_limit_is_what_loosening_it_brings(tmp_path):
    free = "roller_radius_mm = [7, 11]"
    limits = "convex_radius_mm = {{ least = {} }}\ndelivery_angle_deg = {{ most = 20 }}"
    aim = 'hertz_gpa = "least"'
    answers = [solve_task(task_of(tmp_path, free=free, aims=aim, limits=limits.format(radius), more=FEW), silent)
               for radius in (7.0, 6.99)]  # fmt: skip
    values = [RESPONSES["hertz_gpa"].value(a.chosen.evaluated) for a in answers]
    price = {p.what: p.per_aim["hertz_gpa"] for p in answers[0].prices}
    assert price["convex radius at least 7 mm"] == pytest.approx((values[1] - values[0]) / 0.01, rel=0.02)
    assert price["convex radius at least 7 mm"] < 0.0


def test_price_at_the_best_design_of_one_of_two_aims_is_that_of_this_aim(tmp_path):
    answers = []
    for delivery in (150.0, 149.5):
        task = task_of(tmp_path, free="base_circle_radius_mm = [15, 25]\nplunger_diameter_mm = [7, 9]",
                       aims='cam_radius_mm = "least"\nhertz_gpa = "least"',
                       limits=f"delivery_mm3 = {{ least = {delivery} }}",
                       more='[answer]\npoints = 4\nstarts = 1\nchoose = "hertz_gpa"')  # fmt: skip
        answers.append(solve_task(task, silent))
    values = [answer.chosen.responses["hertz_gpa"] for answer in answers]
    price = {p.what: p.per_aim for p in answers[0].prices}["delivery at least 150 mm³"]
    assert list(price) == ["hertz_gpa"]
    assert price["hertz_gpa"] == pytest.approx((values[1] - values[0]) / 0.5, rel=0.02)


@pytest.mark.parametrize(
    ("aim", "side", "moved"), [("peak_torque_nm", "upwards", 0.01), ("lobe_angle_deg", "downwards", -0.01)]
)
def test_a_limit_that_is_met_exactly_is_loosened_to_the_better_side(tmp_path, aim, side, moved):
    values, found = [], []
    for angle in (14.0, 14.0 + moved):
        task = task_of(tmp_path, free="rise_deg = [50, 75]", aims=f'{aim} = "least"',
                       limits=f"delivery_angle_deg = {{ equal = {angle} }}", more="[answer]\nstarts = 1")  # fmt: skip
        answer = solve_task(task, silent)
        values.append(answer.chosen.responses[aim])
        found.append({p.what: p.per_aim[aim] for p in answer.prices})
    price = found[0][f"delivery angle equal to 14 deg ({side})"]
    assert price == pytest.approx((values[1] - values[0]) / 0.01, rel=0.02)
    assert price < 0.0


def test_command_leaves_files_that_predict_and_check_take(tmp_path, capsys):
    more = FEW + "[tolerances]\nlift_um = 2\nfollower_offset_mm = 0.05\nplunger_clearance_um = 4\nsamples = 10\n"
    path = design_file(tmp_path, free=FREE, aims=AIMS, limits=LIMITS, more=more)
    out = tmp_path / "out"
    assert main(["design", str(path), "--out", str(out), "--debug"]) == 0
    printed = capsys.readouterr().out
    assert "first guess" in printed
    document = json.loads((out / "design.json").read_text())
    assert document["schema"] == "camtorque.design/1"
    assert {row["path"]: row["sha256"] for row in document["inputs"]} == {
        str(file): hashlib.sha256(file.read_bytes()).hexdigest() for file in (path, PAPER)
    }
    chosen = document["points"][document["chosen"]]["responses"]
    config, findings = read_pump(out / "pump.toml")
    assert findings == ()
    curve = read_pressure_curve(out / "pressure_1.csv")
    theta = np.linspace(0.0, 2.0 * np.pi, 7200)
    solved = solve_rigid(config.pump, cam_of(config), theta, pressure_at(curve, theta), 500.0 * RPM)
    assert np.max(solved.torque) == pytest.approx(chosen["peak_torque_nm"], rel=2e-3)
    assert 1e-9 * np.nanmax(solved.forces.hertz) == pytest.approx(chosen["hertz_gpa"], rel=2e-3)
    assert document["as_predict_reads_it"][0]["peak_torque_nm"] == pytest.approx(chosen["peak_torque_nm"], rel=5e-3)
    spread = document["tolerances"]["hertz_gpa"]
    assert spread["low"] < spread["high"] < 1.1 * spread["nominal"]
    # again into the same folder: it is the product's own
    capsys.readouterr()
    pressure = str(out / "pressure_1.csv")
    assert main(["predict", str(out / "pump.toml"), "--speed", "500", "--pressure", pressure, "--json"]) == 0
    named = [Path(row["path"]).name for row in json.loads(capsys.readouterr().out)["inputs"]]
    assert named == ["pump.toml", "cam.csv", "pressure_1.csv"]


def test_files_of_a_design_count_from_the_start_of_the_rise_wherever_the_pump_file_begins(tmp_path):
    turned = tmp_path / "turned.toml"
    turned.write_text(PAPER.read_text().replace("start_deg = 0.0", "start_deg = 300.0"))
    texts = []
    for pump in (PAPER, turned):
        path = design_file(tmp_path, free=FREE, aims='peak_torque_nm = "least"', limits=LIMITS, more=FEW, pump=pump)
        answer = solve_task(read_task(path), silent)
        folder = tmp_path / pump.stem
        folder.mkdir()
        write_chosen(answer.chosen.evaluated, folder)
        texts.append([(folder / name).read_text() for name in ("cam.csv", "pressure_1.csv")])
    assert texts[0] == texts[1]


def test_page_opens_every_design_without_a_script(tmp_path):
    path = design_file(tmp_path, free=FREE, aims=AIMS, limits=LIMITS, more=FEW)
    assert main(["design", str(path), "--out", str(tmp_path / "out"), "--quiet"]) == 0
    page = (tmp_path / "out" / "design.html").read_text()
    links, sections = re.findall(r'href="#(d\d+)"', page), re.findall(r'<section id="(d\d+)"', page)
    # an image has no parts for a screen reader: a drawing of links is a group
    (front,) = re.findall(r'<svg[^>]*role="(\w+)" aria-label="Pareto front of [a-zA-Z ]+;', page)
    assert front == "group"
    assert links == sections
    assert len(links) >= 5
    assert page.count('class="design chosen"') == 1
    assert "script-src &#39;none&#39;" in page
    assert "<script" not in page
    # a style element beside the one whose hash the policy names would be ignored
    assert page.count("<style>") == 1


@pytest.mark.parametrize(
    "aims", ['side_force_n = "least"', AIMS + '\nside_force_n = "least"', AIMS + '\njump_speed_rpm = "most"']
)
def test_one_aim_or_three_make_a_page(tmp_path, aims):
    path = design_file(tmp_path, free=FREE, aims=aims, limits=LIMITS, more=FEW)
    assert main(["design", str(path), "--out", str(tmp_path / "out"), "--debug"]) == 0
    page = (tmp_path / "out" / "design.html").read_text()
    document = json.loads((tmp_path / "out" / "design.json").read_text())
    count = len(document["aims"])
    assert page.count("Pareto front of") == count * (count - 1) // 2
    assert len(document["points"]) >= count
    best = {name: RESPONSES[name].aim for name in document["aims"]}
    for name, way in best.items():
        values = [point["responses"][name] for point in document["points"]]
        assert (np.ptp(values) > 0.0) == (count > 1), (name, way)


def test_example_of_the_documentation_is_a_design_file(tmp_path):
    text = (PAPER.parents[1] / "docs" / "design.md").read_text(encoding="utf-8")
    example = text.split("```toml\n")[1].split("```")[0]
    path = tmp_path / "design.toml"
    path.write_text(example.replace('"paper_pump.toml"', f'"{PAPER}"'), encoding="utf-8")
    task = read_task(path)
    assert len(task.loads) == 2
    assert task.tolerances["lift_um"] == 2.0e-6
    assert read_task(PAPER.parent / "paper_design.toml").points == 50


def test_pump_with_a_lift_table_says_which_lobe_is_wanted(tmp_path):
    # the cam of a bench pump is a table: angles and lift of the lobe have to be given, or be free
    (tmp_path / "cam.csv").write_text((PAPER.parent / "cam_A.csv").read_text(encoding="utf-8"), encoding="utf-8")
    head, tail = PAPER.read_text(encoding="utf-8").split("[cam]")
    pump = tmp_path / "table_pump.toml"
    pump.write_text(head + 'cam_table = "cam.csv"\n[mounting]' + tail.split("[mounting]")[1], encoding="utf-8")
    with pytest.raises(
        Refusal,
        match=r"lift_mm: this key is missing, and the pump file does not give rise, dwell.*; give lift_mm, .*deg",
    ):
        task_of(tmp_path, pump=pump, free=FREE, aims=AIMS)
    lift = '[lift]\nlaw = "modified_sine"\nlift_mm = 8\ntop_dwell_deg = 20\nreturn_deg = 55\n'
    task = task_of(tmp_path, pump=pump, lift=lift, free=FREE, aims='hertz_gpa = "least"', more=FEW)
    answer = solve_task(task, silent)
    assert answer.chosen.design.values["lift_mm"] == 8.0
    curve = PAPER.parent / "paper_pressure.csv"
    load = f'[[load]]\nspeed_rpm = 500\npressure_file = "{curve}"\n'
    carried = task_of(tmp_path, pump=pump, lift=lift, free=FREE, load=load, aims=AIMS).loads[0]
    assert carried.pressures.max() == pytest.approx(6e7, rel=0.05)


def test_several_pumps_share_a_shaft(tmp_path):
    task = task_of(tmp_path, pump=shaft(tmp_path, 2), free="phase_2_deg = [0, 180]", aims='torque_ripple_nm = "least"')
    problem = Problem(task, task.families[0])
    values = [RESPONSES["peak_torque_nm"].value(problem.evaluated(np.array([x]))) for x in (0.0, 1.0)]
    # in phase both peaks fall together; half a turn apart the lobes of 135 degrees do not overlap at the peak
    assert values[0] == pytest.approx(2.0 * values[1], rel=0.05)
    design = problem.evaluated(np.array([1.0]))
    assert "phases_deg = [0.0, 180.0]" in pump_text(design)


def test_torque_of_unequal_phases_is_that_of_the_shaft(tmp_path):
    task = task_of(tmp_path, pump=shaft(tmp_path, 3), free="phase_2_deg = [0, 100]\nphase_3_deg = [0, 100]",
                   aims='peak_torque_nm = "least"')  # fmt: skip
    problem = Problem(task, task.families[0])
    design = problem.evaluated(np.array([0.25, 0.4]))
    theta, law = np.linspace(0.0, 2.0 * np.pi, 14401), design.lobe.law()
    units = [PumpUnit(task.config.pump, law, np.deg2rad(phase)) for phase in (0.0, 25.0, 40.0)]
    rows = []
    for unit in units:
        lift, slope, _ = law.derivatives(theta - unit.phase, 2)
        rows.append(np.where(slope > 0.0, design.loads[0].on_rise(lift), 0.0))
    torque = solve_shaft(units, theta, np.stack(rows), design.loads[0].speed).torque
    assert RESPONSES["peak_torque_nm"].value(design) == pytest.approx(torque.max(), rel=2e-3)
    assert RESPONSES["torque_ripple_nm"].value(design) == pytest.approx(np.ptp(torque), rel=2e-3)


def test_pressure_over_angle_is_carried_by_the_lift(tmp_path):
    curve = PAPER.parent / "paper_pressure.csv"
    load = f'[[load]]\nspeed_rpm = [500, 900]\npressure_file = "{curve}"\n'
    task = task_of(tmp_path, lift='[lift]\nlaw = "polynomial_4567"\n', free="rise_deg = [50, 70]", load=load, aims=AIMS)
    assert [round(load.speed / RPM) for load in task.loads] == [500, 900]
    problem = Problem(task, task.families[0])
    # with the reference's own cam the torque is that of the paper
    assert RESPONSES["peak_torque_nm"].value(problem.evaluated(problem.start())) == pytest.approx(53.6, rel=0.01)


def test_shifted_follower_is_the_same_cam_met_elsewhere(tmp_path):
    task = task_of(tmp_path, free="follower_offset_mm = [2, 4]", aims=AIMS)
    problem = Problem(task, task.families[0])
    design = problem.evaluated(np.array([0.5]))
    shift, e = 1e-5, design.constants.offset
    theta = np.linspace(0.01, 2.3, 3000)
    law = design.lobe.law()
    # exact: the roller centre at polar radius r passes x = e + shift at another angle
    height = design.constants.base + law.evaluate(theta)
    radius = np.hypot(height, e)
    rest = np.hypot(design.constants.base, e)
    moved = np.sqrt(radius**2 - (e + shift) ** 2) - np.sqrt(rest**2 - (e + shift) ** 2)
    turned = theta + (np.arcsin(e / radius) - np.arcsin((e + shift) / radius)) - (
        np.arcsin(e / rest) - np.arcsin((e + shift) / rest)
    )  # fmt: skip
    change = shifted_follower(design, shift)[0]
    inside = (design.theta > 0.1) & (design.theta < 2.2)
    exact = np.interp(design.theta[inside], turned, moved) - design.lift[0][inside]
    assert np.max(np.abs(exact - change[inside])) < 0.02 * np.max(np.abs(change))


def test_tolerances_are_drawn_by_their_seed(tmp_path):
    more = FEW + "[tolerances]\nroller_radius_mm = 0.1\nsamples = 20\n"
    task = task_of(tmp_path, free=FREE, aims=AIMS, limits=LIMITS, more=more)
    problem = Problem(task, task.families[0])
    start = problem.start()
    one, same, other = (spreads(problem, start, seed) for seed in (1, 1, 2))
    assert one == same
    assert one["hertz_gpa"] != other["hertz_gpa"]
    assert one["hertz_gpa"].low < one["hertz_gpa"].nominal < one["hertz_gpa"].high
    # what does not depend on the roller does not spread
    assert one["delivery_angle_deg"].low == pytest.approx(one["delivery_angle_deg"].high, rel=1e-9)


@pytest.mark.parametrize(("aims", "count"), [(2, 50), (3, 50), (4, 20)])
def test_references_are_a_lattice_of_sum_one(aims, count):
    rows = references(aims, count)
    assert len(rows) >= count
    assert np.allclose(rows.sum(axis=1), 1.0)
    assert len(np.unique(rows, axis=0)) == len(rows)
    assert np.all(np.max(rows, axis=0) == 1.0)


def test_table_closes_and_stays_above_the_base_circle(tmp_path):
    problem = Problem(task := task_of(tmp_path, free=FREE, aims=AIMS), task.families[0])
    rows = [line.split(",") for line in lift_table_text(problem.evaluated(problem.start())).splitlines()[2:]]
    lift = np.array([float(row[1]) for row in rows])
    assert lift.size == 720
    assert lift.min() == 0.0
    assert lift.max() == pytest.approx(8.0)


def test_every_quantity_and_response_is_documented():
    text = (PAPER.parents[1] / "docs" / "design.md").read_text(encoding="utf-8")
    for name in (*QUANTITIES, *RESPONSES):
        assert f"`{name}`" in text, name
