"""A run as one page: what it holds, what its figures say, and that browsers show it."""

from __future__ import annotations

import base64
import io
import json
import re
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from pictures import inked
from PIL import Image

from comwalk.cli.app import main
from comwalk.pattern.footsteps import Gait
from comwalk.pattern.pendulum import Pendulum
from comwalk.pattern.plans import plan_steps
from comwalk.pattern.walk_pattern import make_pattern
from comwalk.run import simulate_pendulum
from comwalk.runs.columns import save_columns
from comwalk.runs.run_data import RunData, data_of, read_columns
from comwalk.views import video
from comwalk.views.charts import (
    Chart,
    Curve,
    chart_html,
    chart_times,
    nice_ticks,
    on_times,
)
from comwalk.views.page import notebook_html, page_html
from comwalk.views.render import View, render_run
from comwalk.views.tables import changed_settings, figure_table, flat_settings

CHROMIUM = Path("/usr/bin/chromium")
SHORT = ["--steps", "1", "--gait.period", "0.8"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The folder of a short walk with its page."""
    path = tmp_path_factory.mktemp("runs") / "law"
    assert main(["walk", *SHORT, "--report", "--out", str(path)]) == 0
    return path


@pytest.fixture(scope="module")
def pendulum():
    """A run of the simplified model."""
    return simulate_pendulum(make_pattern(plan_steps(Gait(), 2), Pendulum()))


def test_a_run_of_one_row_is_drawn(folder, tmp_path, capsys):
    """As of a fall in the first period: it is told, and its point is in the figures."""
    for name in ("summary.json", "scene.mjb"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    columns = {k: v[:1] if v.ndim else v for k, v in read_columns(folder).items()}
    save_columns(tmp_path / "run.npz", columns)
    assert main(["report", str(tmp_path)]) == 0
    com = data_of(tmp_path).com[0, 0]
    page = (tmp_path / "report.html").read_text()
    for html in (page, notebook_html(data_of(tmp_path))):
        charts = [x for x in html.split("<figure")[1:] if "<b>CoM and ZMP, " in x]
        assert len(charts) == 2
        curves, digit = read_back(charts[0])
        x = [c[np.isfinite(c)] for c in curves]
        assert [len(values) for values in x] == [1, 1, 1, 1]
        assert np.abs(np.concatenate(x) - com).min() < digit
    assert main(["report", str(tmp_path), str(folder)]) == 0


def refused(capsys, *words):
    """Return the one line with which a command line is refused."""
    assert main(list(words)) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    return err


def read_back(html):
    """Return the values of each curve of a chart, as the script of a page does."""
    low, high = (float(re.search(rf'data-{k}="([^"]+)"', html)[1]) for k in _RANGE)
    width, height = map(int, re.search(r'viewBox="0 0 (\d+) (\d+)"', html).groups())
    curves = []
    for kind, d in re.findall(r'<path class="(cw-[^"]*)" d="([^"]*)"', html):
        if kind in ("cw-grid", "cw-zero"):
            continue
        values, x, y = np.full(width + 1, np.nan), 0, 0
        for word, a, b in re.findall(r"([Ml])(-?\d+) (-?\d+)", d):
            x, y = (int(a), int(b)) if word == "M" else (x + int(a), y + int(b))
            values[x] = high - y / height * (high - low)
        curves.append(values)
    return curves, (high - low) / height


_RANGE = ("low", "high")


# ---- Figures ----------------------------------------------------------------------


def test_curves_are_read_back_as_they_were():
    """Whole numbers keep every value to a step of the chart, gaps included."""
    t = chart_times(0.0, 5.0)
    gap = np.where((t > 2.0) & (t < 3.0), np.nan, np.cos(3.0 * t))
    lines = [Curve("a", "com", np.sin(t) * t), Curve("b", "zmp", gap)]
    html = chart_html(Chart(title="<x>", unit="m", t=t, curves=lines))
    curves, step = read_back(html)
    for line, values in zip(lines, curves, strict=True):
        np.testing.assert_allclose(values, line.values, atol=0.51 * step)
    assert "<x>" not in html


def test_values_outside_a_record_are_missing():
    """A run that ended early has no values after its end."""
    values = on_times(np.array([-1.0, 0.5, 2.0]), np.array([0.0, 1.0]), np.arange(2.0))
    np.testing.assert_array_equal(values, [np.nan, 0.5, np.nan])


@pytest.mark.parametrize(("low", "high"), [(0.0, 1.0), (-3e-4, 2e-4), (7.0, 9e5)])
def test_ticks_are_round_and_inside(low, high):
    """Between two and eight ticks, evenly spaced, none outside."""
    ticks = np.array(nice_ticks(low, high, 4))
    assert 2 <= len(ticks) <= 8
    assert low <= ticks[0]
    assert ticks[-1] <= high
    assert np.ptp(np.diff(ticks)) < 1e-9 * (high - low) + 1e-12


# ---- Tables -----------------------------------------------------------------------


def test_differences_say_which_run_is_better(folder):
    """The second run minus the first; less error is better, more margin too."""
    first = json.loads((folder / "summary.json").read_text())
    second = json.loads(json.dumps(first))
    second["zmp_error_rms_mm"]["x"] -= 1.0
    second["sole_margin_p5_mm"] -= 2.0
    html = figure_table([first, second], ["A: x", "B: y"])
    assert re.search(r"ZMP error rms, x</th>.*?cw-better\">-1.00 mm", html)
    assert re.search(r"5th percentile</th>.*?cw-worse\">-2.0 mm", html)
    assert html.count(">same<") > 10


def test_only_what_differs_is_listed(folder):
    """Two runs of the same settings have none; a changed gain is named."""
    first = json.loads((folder / "summary.json").read_text())
    second = json.loads(json.dumps(first))
    assert "<table>" not in changed_settings(first, second, ["a", "b"])
    second["settings"]["control"]["gains"]["com"] = [0.0, 0.0]
    rows = re.findall("<th>([^<]*)</th><td>", changed_settings(first, second, "ab"))
    assert rows == ["control.gains.com"]
    assert flat_settings(first)["gait.period"] == "0.8"


# ---- Pages ------------------------------------------------------------------------


def test_a_page_is_whole_and_needs_no_network(folder):
    """One file: film, player, figures, settings and command; nothing is fetched."""
    html = (folder / "report.html").read_text()
    assert len(html) < 1.5e6
    assert "default-src 'none'" in html
    own = re.sub(r'<script type="application/json".*?</script>', "", html, flags=re.S)
    assert not re.findall(r'(?:src|href)="(?!data:)[^"]*"|url\((?!data:)', own)
    stored = json.loads(re.search(r'id="films">(.*?)</script>', html, re.S)[1])
    assert len(stored["films"][0]) > 10_000
    assert "</head>" in stored["player"]
    for words in (
        "comwalk walk --steps 1",
        "completed in",
        "CoM and ZMP, x",
        "Settings",
    ):
        assert words in own
    (data,) = re.findall(r'href="data:application/json;base64,([^"]*)"', own)
    summary = json.loads(base64.b64decode(data))
    assert summary["settings"]["config"]["steps"] == 1


def test_the_configuration_in_a_page_repeats_the_run(folder, tmp_path):
    """What the page offers to save is what `--config` takes."""
    html = (folder / "report.html").read_text()
    data = re.search(r'href="data:application/json;base64,([^"]*)"', html)[1]
    file = tmp_path / "law.json"
    file.write_bytes(base64.b64decode(data))
    assert main(["walk", "--config", str(file), "--out", str(tmp_path / "again")]) == 0
    first, again = (data_of(p).columns["qpos"] for p in (folder, tmp_path / "again"))
    np.testing.assert_array_equal(first, again)


def test_the_simplified_model_has_a_page_without_a_scene(pendulum):
    """Figures and summary are there; the page says why there is no robot."""
    html = pendulum.view().html
    assert "no body to show" in html
    assert "Seen from above" in html
    assert len(html) < 4e5


def test_a_notebook_shows_a_run(pendulum):
    """Outcome and figures without any script; its page goes into a frame."""
    html = pendulum._repr_html_()
    assert html == notebook_html(data_of(pendulum))
    assert "completed in" in html
    assert html.count("<svg") == 2
    assert "<script" not in html
    assert "srcdoc=" in pendulum.view()._repr_html_()


def test_text_of_a_run_cannot_break_its_page(pendulum):
    """Names and causes are shown as they are."""
    evil = "</script><b>x"
    record = data_of(pendulum)
    summary = {**record.summary, "cause": evil, "outcome": "fell"}
    html = page_html([RunData(evil, summary, record.columns, None, None)], [None], "")
    assert evil not in html


def test_a_page_can_be_saved_and_opened(pendulum, tmp_path, monkeypatch):
    """A page is a file; opening it hands its address to the browser."""
    page, opened = pendulum.view(), []
    assert page.save(tmp_path / "a.html").read_text() == page.html
    monkeypatch.setattr("webbrowser.open", opened.append)
    path = page.open()
    assert opened == [path.as_uri()]
    path.unlink()


# ---- What is refused --------------------------------------------------------------


def test_broken_folders_are_told_in_one_line(folder, tmp_path, capsys):
    """Missing, without summary, with a broken archive, or without its columns."""
    assert "nowhere" in refused(capsys, "report", str(tmp_path / "nowhere"))
    for name, words in (("run.npz", "no archive"), ("scene.mjb", "no model")):
        for file in ("summary.json", "run.npz", "scene.mjb"):
            (tmp_path / file).write_bytes((folder / file).read_bytes())
        (tmp_path / name).write_bytes(b"rubbish")
        assert words in refused(capsys, "report", str(tmp_path))
    (tmp_path / "summary.json").write_text("{}")
    assert "summary.json" in refused(capsys, "report", str(tmp_path))
    assert "summary.json" in refused(capsys, "report", str(folder), str(tmp_path))
    target = str(tmp_path / "no" / "a.html")
    assert "cannot write" in refused(capsys, "report", str(folder), "--out", target)


def test_films_that_cannot_be_written_are_refused_first(tmp_path, capsys, monkeypatch):
    """Before anything is walked: an unknown ending, or a missing package."""
    out = ["--out", str(tmp_path / "run")]
    assert ".webp" in refused(capsys, "walk", *SHORT, *out, "--video", "a.avi")
    monkeypatch.setattr(video, "find_spec", lambda name: None)
    line = refused(capsys, "walk", *SHORT, *out, "--video", "a.mp4")
    assert "pip install 'comwalk[video]'" in line
    assert not (tmp_path / "run").exists()


def test_without_opengl_all_else_is_written(tmp_path, capsys, monkeypatch):
    """One line says what is missing; page, figure and record are there."""
    monkeypatch.setenv("MUJOCO_GL", "disable")
    words = ["--report", "--video", str(tmp_path / "a.webp"), "--out", str(tmp_path)]
    assert main(["walk", *SHORT, *words]) == 2
    err = capsys.readouterr().err
    assert re.fullmatch("comwalk: no OpenGL: .*everything else still works\n", err)
    assert "<svg" in (tmp_path / "report.html").read_text(encoding="utf-8")
    assert inked(tmp_path / "walk.png") > 0.02
    steps = json.loads((tmp_path / "summary.json").read_text())["steps_completed"]
    assert steps == 1
    assert read_columns(tmp_path)["step"][-1] == 2  # the feet come together
    assert not (tmp_path / "a.webp").exists()


@pytest.mark.skipif(find_spec("av") is None, reason="PyAV is missing")
def test_an_mp4_holds_every_picture(folder, tmp_path):
    """Its size is even, its pictures are as many as were drawn."""
    av = pytest.importorskip("av")
    from comwalk.views import gl

    if gl.choose_backend() not in ("egl", "osmesa"):
        pytest.skip("neither libEGL nor libOSMesa loads here")
    path = tmp_path / "a.mp4"
    n = render_run(folder, path, view=View(width=97, height=65), stop=0.5, fps=10)
    with av.open(str(path)) as file:
        pictures = [f.to_ndarray(format="rgb24") for f in file.decode(video=0)]
    assert len(pictures) == n == 6
    assert pictures[0].shape == (64, 96, 3)
    assert pictures[0].std() > 10


# ---- In a browser -----------------------------------------------------------------


@pytest.fixture(scope="module")
def browser():
    """Chromium without a window and without a network."""
    if not CHROMIUM.exists() or find_spec("playwright") is None:
        pytest.skip("needs chromium and playwright: apt-get install chromium")
    from playwright.sync_api import sync_playwright

    flags = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
    flags += ("--disable-background-networking", "--disable-quic")
    with sync_playwright() as play:
        chromium = play.chromium.launch(executable_path=CHROMIUM, args=list(flags))
        yield chromium
        chromium.close()


@pytest.fixture
def opened(browser):
    """Return what opens a file offline; nothing may fail or be fetched."""
    context = browser.new_context(offline=True, viewport={"width": 1200, "height": 760})
    context.set_default_timeout(90_000)
    faults, fetched = [], []

    def load(path):
        page = context.new_page()
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.on("request", lambda request: fetched.append(request.url))
        page.goto(path.as_uri())
        page.wait_for_function(READY)
        return page

    yield load
    context.close()
    assert faults == []
    assert [
        url for url in fetched if not url.startswith(("file:", "data:", "blob:"))
    ] == []


READY = """[...document.querySelectorAll("iframe")].every(frame => frame.contentDocument
    && frame.contentDocument.querySelector("[role=slider]"))"""
TIME = """k => Number(document.querySelectorAll("iframe")[k].contentDocument
    .querySelector("[role=slider]").getAttribute("aria-valuenow"))"""
BAR = """k => { const page = document.querySelectorAll("iframe")[k].contentDocument;
    return getComputedStyle(page.querySelector(".mantine-Slider-root").parentElement)
      .display; }"""
FIGURES = "() => Number(document.documentElement.dataset.time)"
CLICK = """share => { const plot = document.querySelector(".cw-plot");
    const box = plot.getBoundingClientRect();
    const where = {clientX: box.left + share * box.width, clientY: box.top + 9};
    for (const kind of ["pointerdown", "pointerup", "pointerleave"])
      plot.dispatchEvent(new PointerEvent(kind, where)); }"""
PAUSE = """() => document.querySelector("iframe").contentDocument
    .querySelector(".mantine-Slider-root").parentElement.querySelector("button").click()"""


def end_of(folder):
    return float(data_of(folder).columns["t"][-1])


def test_the_page_shows_the_robot_and_plays(opened, folder):
    """The film runs, figures follow it, a click into a figure goes there."""
    page = opened(folder / "report.html")
    start = page.evaluate(TIME, 0)
    page.wait_for_function(f"({TIME})(0) != {start}")  # it plays by itself
    page.evaluate(CLICK, 0.5)
    middle = 0.5 * end_of(folder)
    page.wait_for_function(f"Math.abs(({TIME})(0) - {middle}) < 0.02")
    page.wait_for_function(f"Math.abs(({FIGURES})() - {middle}) < 0.02")
    page.wait_for_timeout(1500)
    assert page.evaluate(TIME, 0) == pytest.approx(middle, abs=0.02)  # and rests
    said = page.locator(".cw-chart output").first.text_content()
    column = data_of(folder).columns
    row = int(np.searchsorted(column["t"], middle))
    assert float(said) == pytest.approx(column["zmp_filtered"][row, 0], abs=0.01)
    shot = page.locator("iframe").screenshot(timeout=90_000)
    picture = np.asarray(Image.open(io.BytesIO(shot)).convert("RGB")).astype(int)
    seen = (picture < 235).any(axis=2)
    height, width = seen.shape
    band = seen[int(0.2 * height) : int(0.6 * height)]
    assert band[:, int(0.35 * width) : int(0.65 * width)].mean() > 0.15
    assert band[:, int(0.85 * width) :].mean() < 0.1
    page.evaluate(PAUSE)
    page.wait_for_function(f"({TIME})(0) > {middle} + 0.05")


def test_two_runs_play_together(opened, folder, tmp_path):
    """The second scene follows the first, to its own end."""
    other = tmp_path / "open"
    words = ["--gains.zmp", "0", "--gains.com", "0", "--out", str(other)]
    assert main(["walk", *SHORT, *words]) == 0
    path = tmp_path / "pair.html"
    assert main(["report", str(folder), str(other), "--out", str(path)]) == 0
    page = opened(path)
    page.evaluate(CLICK, 0.4)
    goal = 0.4 * end_of(folder)
    for k in range(2):
        page.wait_for_function(f"Math.abs(({TIME})({k}) - {goal}) < 0.03")
    assert [page.evaluate(BAR, k) for k in range(2)] == ["flex", "none"]
    text = page.inner_text("body")
    assert "control.gains.zmp" in text
    assert "B: open" in text


@pytest.mark.skipif(sys.platform != "linux", reason="one system is enough")
def test_the_page_fits_a_phone(opened, folder):
    """Nothing is wider than a narrow screen."""
    page = opened(folder / "report.html")
    page.set_viewport_size({"width": 390, "height": 800})
    wide = page.evaluate("document.documentElement.scrollWidth")
    assert wide <= 390
