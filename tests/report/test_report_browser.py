"""The pages in a real browser: curves drawn, zoomed, switched and read out; no request, no violation, no barrier."""

from __future__ import annotations

import base64
import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from camtorque.report.alignment import write_alignment
from camtorque.report.compare_page import write_compare
from camtorque.report.plan_page import plan_page
from camtorque.report.predict_page import prediction_page
from camtorque.report.write import write_run
from report_cases import run_result
from test_report_campaign import page_of_many
from test_report_compare import document, pair
from test_report_plan_page import plan_document
from test_report_predict_page import paper_prediction

webdriver = pytest.importorskip("selenium.webdriver")
from selenium.webdriver.chrome.service import Service  # noqa: E402
from selenium.webdriver.common.action_chains import ActionChains  # noqa: E402
from selenium.webdriver.common.by import By  # noqa: E402
from selenium.webdriver.common.keys import Keys  # noqa: E402
from selenium.webdriver.support.ui import Select  # noqa: E402

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
CHROMEDRIVER = shutil.which("chromedriver")
pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(CHROMIUM is None or CHROMEDRIVER is None, reason="no chromium with chromedriver here"),
]
FLAGS = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--disable-dev-shm-usage",
    "--disable-background-networking", "--disable-component-update", "--disable-sync", "--no-first-run",
)  # fmt: skip
AXE = (Path(__file__).parent / "vendor" / "axe.min.js").read_text(encoding="utf-8")
WATCH = """window.violations = []; document.addEventListener("securitypolicyviolation",
  (e) => window.violations.push(e.violatedDirective + " " + e.blockedURI));"""
WINDOW = "return [...camtorque.groups.get('theta').plots].map(({u}) => [u.scales.x.min, u.scales.x.max])"
Window = list[list[float]]


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    options = webdriver.ChromeOptions()
    options.binary_location = str(CHROMIUM)
    for flag in FLAGS:
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options, Service(str(CHROMEDRIVER)))
    driver.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": WATCH})
    yield driver
    driver.quit()


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("pages")
    for name in ("run", "unexplained", "compare", "campaign", "align"):
        (folder / name).mkdir()
    write_run(run_result(), folder / "run")
    write_run(run_result(explained=False), folder / "unexplained")
    write_compare(document(), [pair()], folder / "compare")
    case = run_result()
    write_alignment(case.recording, case.cycles, case.created, folder / "align")
    (folder / "predict.html").write_text(prediction_page(paper_prediction(), "pump"), encoding="utf-8")
    (folder / "plan.html").write_text(plan_page(plan_document(), "plan"), encoding="utf-8")
    (folder / "campaign" / "campaign.html").write_text(page_of_many(7), encoding="utf-8")
    for name in ("0" * 15 + str(k) for k in range(7)):
        (folder / "campaign" / "runs" / name).mkdir(parents=True)
        (folder / "campaign" / "runs" / name / "report.html").write_text("<title>opened</title>", encoding="utf-8")
    return {
        "align": folder / "align" / "align.html", "predict": folder / "predict.html",
        "plan": folder / "plan.html",
        "campaign": folder / "campaign" / "campaign.html",
        "run": folder / "run" / "report.html", "unexplained": folder / "unexplained" / "report.html",
        "compare": folder / "compare" / "compare.html",
    }  # fmt: skip


def opened(browser: Any, path: Path, width: int = 1280, dark: bool = False) -> Any:
    """Open a page in a window of some width and return the browser; what was logged before is forgotten."""
    size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    scheme = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": scheme})
    for kind in ("browser", "performance"):
        browser.get_log(kind)
    browser.get(path.as_uri())
    return browser


@pytest.mark.parametrize("name", ["run", "unexplained", "compare", "campaign", "align", "predict", "plan"])
def test_nothing_is_requested_and_nothing_is_forbidden(browser: Any, pages: dict[str, Path], name: str) -> None:
    opened(browser, pages[name])
    assert browser.get_log("browser") == []
    assert browser.execute_script("return window.violations") == []
    events = [json.loads(row["message"])["message"] for row in browser.get_log("performance")]
    asked = {row["params"]["request"]["url"] for row in events if row["method"] == "Network.requestWillBeSent"}
    assert {url for url in asked if not url.startswith("data:")} == {pages[name].as_uri()}


def test_every_curve_is_drawn(browser: Any, pages: dict[str, Path]) -> None:
    opened(browser, pages["run"])
    drawn = browser.execute_script("""
      const found = [];
      const probe = document.createElement("canvas").getContext("2d");
      const rgb = (tone) => { probe.fillStyle = getComputedStyle(document.documentElement)
        .getPropertyValue("--" + tone).trim();
        return [1, 3, 5].map((k) => parseInt(probe.fillStyle.slice(k, k + 2), 16)); };
      for (const group of camtorque.groups.values()) for (const {u, panel, chart} of group.plots) {
        const all = u.ctx.getImageData(u.bbox.left, u.bbox.top, u.bbox.width, u.bbox.height).data;
        for (const item of panel.lines) {
          const [r, g, b] = rgb(item.t); let n = 0;
          for (let i = 0; i < all.length; i += 4)
            n += all[i + 3] > 200 && Math.abs(all[i] - r) + Math.abs(all[i + 1] - g) + Math.abs(all[i + 2] - b) < 40;
          found.push([chart.id + ", " + item.l, n]);
        }
      }
      return found;""")
    assert len(drawn) >= 20
    assert [name for name, pixels in drawn if pixels < 10] == []


def drawn_window(browser: Any) -> list[float]:
    """Return the window of all linked curves, which has to be one."""
    found: Window = browser.execute_script(WINDOW)
    assert all(part == pytest.approx(found[0]) for part in found), found
    return found[0]


def test_zoom_by_button_mouse_and_back(browser: Any, pages: dict[str, Path]) -> None:
    opened(browser, pages["run"])
    assert drawn_window(browser) == [0, 360]
    buttons = {item.text: item for item in browser.find_elements(By.CSS_SELECTOR, ".tools button")}
    buttons["Forward stroke"].click()
    low, high = drawn_window(browser)
    assert 0.0 <= low < 10.0
    assert 80.0 < high < 120.0
    field = browser.find_element(By.CSS_SELECTOR, "#fig-pressure .u-over")
    ActionChains(browser).move_to_element_with_offset(field, -100, 0).click_and_hold().move_by_offset(
        200, 0
    ).release().perform()
    closer = drawn_window(browser)
    assert closer[1] - closer[0] < 0.5 * (high - low)
    ActionChains(browser).double_click(field).perform()
    assert drawn_window(browser) == [0, 360]


def test_a_curve_is_switched_off_and_on(browser: Any, pages: dict[str, Path]) -> None:
    opened(browser, pages["run"])
    shown = "const u = camtorque.groups.get('theta').plots[0].u; return u.series.filter((s, k) => k && s.show).length"
    before = browser.execute_script(shown)
    key = browser.find_element(By.XPATH, "//button[contains(., 'rigid model')]")
    key.click()
    assert key.get_attribute("aria-pressed") == "false"
    assert browser.execute_script(shown) == before - 1
    key.click()
    assert browser.execute_script(shown) == before


def test_the_cursor_is_linked_and_read_out(browser: Any, pages: dict[str, Path]) -> None:
    opened(browser, pages["run"])
    field = browser.find_element(By.CSS_SELECTOR, "#fig-torque_full .u-over")
    ActionChains(browser).move_to_element_with_offset(field, 40, 0).perform()
    places = browser.execute_script("return camtorque.groups.get('theta').plots.map(({u}) => u.cursor.idx)")
    assert len(set(places)) == 1
    assert places[0] is not None
    assert re.match(r"[\d.]+ deg, ", browser.find_element(By.CSS_SELECTOR, ".readout").text)
    live = browser.find_element(By.CSS_SELECTOR, "#fig-pressure .live")
    browser.execute_script("arguments[0].scrollIntoView({block: 'center'})", live)
    browser.execute_cdp_cmd("Input.dispatchMouseEvent", {"type": "mouseMoved", "x": 2, "y": 2})  # off all curves
    live.send_keys(Keys.ARROW_RIGHT)
    moved = browser.execute_script("return camtorque.groups.get('theta').plots.map(({u}) => u.cursor.idx)")
    assert len(set(moved)) == 1
    assert moved[0] > places[0]
    said = browser.execute_async_script("""const wait = () => announcer.textContent
      ? arguments[0](announcer.textContent) : setTimeout(wait, 20); wait();""")
    assert re.search(r"cam angle [\d.]+ deg: line pressure, measured [\d.]+ bar, chamber", said), said


@pytest.mark.parametrize("width", [375, 1280])
@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("name", ["run", "unexplained", "compare", "campaign"])
def test_no_barrier_and_no_overflow(browser: Any, pages: dict[str, Path], name: str, dark: bool, width: int) -> None:
    opened(browser, pages[name], width, dark)
    browser.execute_script("document.querySelectorAll('details').forEach((item) => { item.open = true; })")
    assert browser.execute_script("return document.documentElement.scrollWidth") <= width
    browser.execute_script(AXE)
    found = browser.execute_async_script("axe.run().then((all) => arguments[0](all.violations))")
    serious = [(row["id"], row["nodes"][0]["html"][:200]) for row in found if row["impact"] in ("serious", "critical")]
    assert serious == []


@pytest.mark.parametrize("name", ["align", "predict", "plan"])
def test_the_smaller_pages_have_no_barrier(browser: Any, pages: dict[str, Path], name: str) -> None:
    opened(browser, pages[name], 375)
    assert browser.execute_script("return document.documentElement.scrollWidth") <= 375
    browser.execute_script(AXE)
    found = browser.execute_async_script("axe.run().then((all) => arguments[0](all.violations))")
    assert [row["id"] for row in found if row["impact"] in ("serious", "critical")] == []


def test_without_a_script_the_drawings_stand(browser: Any, pages: dict[str, Path]) -> None:
    browser.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": True})
    try:
        opened(browser, pages["run"])
        for name in ("torque_full", "torque_return", "pressure"):
            drawing = browser.find_element(By.CSS_SELECTOR, f"#fig-{name} .plot svg")
            assert drawing.rect["width"] > 300
        assert browser.find_element(By.CSS_SELECTOR, "#fig-torque_full .live").rect["height"] == 0
    finally:
        browser.execute_cdp_cmd("Emulation.setScriptExecutionDisabled", {"value": False})


def test_on_paper_the_drawings_stand_on_few_pages(browser: Any, pages: dict[str, Path]) -> None:
    opened(browser, pages["run"])
    data = browser.execute_cdp_cmd("Page.printToPDF", {"preferCSSPageSize": True, "printBackground": True})["data"]
    assert 2 <= len(re.findall(rb"/Type\s*/Page\b", base64.b64decode(data))) <= 6


def test_trends_and_maps_of_a_campaign_open_their_recordings(browser: Any, pages: dict[str, Path]) -> None:
    opened(browser, pages["campaign"])
    assert browser.execute_script("return explore.rows().length") == 7
    drawn = "const u = explore.plot(); return [u.axes[0].label, u.axes[1].label]"
    assert browser.execute_script(drawn) == ["speed [rpm]", "parameter: p0 [bar]"]
    Select(browser.find_element(By.ID, "explore-quantity")).select_by_visible_text("number 3 [N m]")
    Select(browser.find_element(By.ID, "explore-by")).select_by_visible_text("peak line pressure [bar] (map)")
    assert browser.execute_script(drawn) == ["speed [rpm]", "peak line pressure [bar]"]
    field = browser.find_element(By.ID, "explore-field")
    field.send_keys(Keys.ARROW_RIGHT)
    told = browser.find_element(By.ID, "explore-readout").text
    assert re.search(r"2026-11-\d{4} pump A.*: number 3 [\d.]+ N m ± 0.1.*, speed [\d.]+ rpm, peak line pressure", told)
    place = browser.execute_script("""const u = explore.plot(), k = 3;
      return [u.valToPos(u.data[0][k], "x") - u.over.clientWidth / 2,
              u.valToPos(u.data[1][k], "y") - u.over.clientHeight / 2]""")
    over = browser.find_element(By.CSS_SELECTOR, "#explore-field .u-over")
    ActionChains(browser).move_to_element_with_offset(over, round(place[0]) + 3, round(place[1]) - 2).perform()
    assert browser.execute_script("return explore.at() === explore.rows()[3]")
    ActionChains(browser).click().perform()
    assert browser.title == "opened"


def test_the_nearest_curve_of_a_campaign_is_named(browser: Any, pages: dict[str, Path]) -> None:
    opened(browser, pages["campaign"])
    place = browser.execute_script("""const {u} = camtorque.groups.get("theta").plots[0], k = 30;
      const s = u.data.slice(1).reduce((best, all, at) => (all[k] > u.data[best][k] ? at + 1 : best), 1);
      return [u.valToPos(u.data[0][k], "x") - u.over.clientWidth / 2,
              u.valToPos(u.data[s][k], "y") - u.over.clientHeight / 2, u.series[s].label]""")
    over = browser.find_element(By.CSS_SELECTOR, "#fig-overlay .u-over")
    ActionChains(browser).move_to_element_with_offset(over, round(place[0]), round(place[1])).perform()
    assert place[2] in browser.find_element(By.CSS_SELECTOR, ".tools .readout").text
    ActionChains(browser).click().perform()
    assert browser.title == "opened"


def fingers(browser: Any, kind: str, *places: tuple[float, float]) -> None:
    """Send one event of a touch screen with the fingers at some places of the window."""
    points = [{"x": x, "y": y, "id": k} for k, (x, y) in enumerate(places)]
    browser.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})


def test_two_fingers_zoom_one_moves_a_double_tap_shows_all(browser: Any, pages: dict[str, Path]) -> None:
    opened(browser, pages["run"], 375)
    browser.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": True, "maxTouchPoints": 2})
    try:
        browser.execute_script("document.querySelector('#fig-torque_full .u-over').scrollIntoView({block: 'center'})")
        left, top, width = browser.execute_script("""const box = document.querySelector('#fig-torque_full .u-over')
          .getBoundingClientRect(); return [box.left, box.top + 40, box.width]""")

        def at(share: float) -> tuple[float, float]:
            return left + share * width, top

        fingers(browser, "touchStart", at(0.4), at(0.6))
        fingers(browser, "touchMove", at(0.3), at(0.7))
        fingers(browser, "touchMove", at(0.2), at(0.8))
        fingers(browser, "touchEnd")
        closer = drawn_window(browser)
        assert closer == pytest.approx([120.0, 240.0], abs=8.0)  # what was under the fingers stays there
        fingers(browser, "touchStart", at(0.7))
        fingers(browser, "touchMove", at(0.5))
        fingers(browser, "touchMove", at(0.2))
        fingers(browser, "touchEnd")
        moved = drawn_window(browser)
        assert moved[1] - moved[0] == pytest.approx(closer[1] - closer[0], abs=1.0)
        assert moved[0] == pytest.approx(closer[0] + 0.5 * (closer[1] - closer[0]), abs=8.0)
        for _ in range(2):
            fingers(browser, "touchStart", at(0.5))
            fingers(browser, "touchEnd")
        assert drawn_window(browser) == [0, 360]
        assert re.match(r"[\d.]+ deg", browser.find_element(By.CSS_SELECTOR, ".readout").text)
    finally:
        browser.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": False})


@pytest.mark.parametrize("name", ["run", "plan", "campaign"])
def test_on_a_narrow_screen_every_drawing_is_seen_whole(browser: Any, pages: dict[str, Path], name: str) -> None:
    opened(browser, pages[name], 375)
    cut = browser.execute_script("""document.querySelectorAll('details').forEach((item) => { item.open = true; });
      return [...document.querySelectorAll('.plot')].filter((item) => item.closest('figure').className !== 'on'
        && item.clientWidth > 1 && item.scrollWidth > item.clientWidth).map((item) => item.ariaLabel)""")
    assert cut == []


def test_on_a_narrow_screen_rows_of_wide_tables_name_their_columns(browser: Any, pages: dict[str, Path]) -> None:
    opened(browser, pages["run"], 375)
    shown = """const cell = document.querySelector('table.parameters tbody td:nth-child(5)');
      return [getComputedStyle(cell, '::before').content, cell.closest('.scroll').scrollWidth, innerWidth]"""
    label, wide, window = browser.execute_script(shown)
    assert label == '"95 % interval"'
    assert wide <= window
    opened(browser, pages["run"], 1280)
    assert browser.execute_script(shown)[0] == "none"
