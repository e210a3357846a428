"""Pictures: the robot is where it was recorded, and files are what they say."""

from __future__ import annotations

import math
import os
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

from comwalk.errors import ComwalkError, ParameterError, RunError
from comwalk.pattern.footsteps import Gait
from comwalk.pattern.pendulum import Pendulum
from comwalk.pattern.plans import plan_steps
from comwalk.pattern.reference import Phase
from comwalk.pattern.walk_pattern import make_pattern
from comwalk.robot.model import load_robot
from comwalk.run import simulate, simulate_pendulum
from comwalk.runs.columns import save_columns
from comwalk.sides import Side
from comwalk.views import gl, render
from comwalk.views.render import View, render_run, render_still, still

SMALL = View(width=96, height=96)


@pytest.fixture(scope="module")
def walked():
    """A robot's single step."""
    gait = Gait(stand_time=0.1, start_time=0.4, stop_time=0.4)
    pattern = make_pattern(plan_steps(gait, 1), Pendulum())
    return simulate(load_robot("paper"), pattern)


@pytest.fixture(scope="module")
def opengl():
    """Skip where nothing can be drawn at all."""
    if gl.choose_backend() not in ("egl", "osmesa"):
        pytest.skip("neither libEGL nor libOSMesa loads here")


def is_orange(picture):
    """Return which pixels have the colour of the robot's accents."""
    r, g, b = picture[..., 0] / 255, picture[..., 1] / 255, picture[..., 2] / 255
    return (r > 0.5) & (g < 0.6 * r) & (b < 0.5 * r)


@pytest.mark.usefixtures("opengl")
def test_still(walked, tmp_path):
    """A still shows the robot in the middle, and is what the file holds."""
    path = tmp_path / "robot.png"
    picture = still(walked.scene, walked.log["qpos"][0], path, view=SMALL)
    assert picture.shape == (96, 96, 3)
    with Image.open(path) as image:
        assert np.array_equal(np.asarray(image), picture)
    columns = np.flatnonzero(is_orange(picture).any(axis=0))
    assert 30 < columns.mean() < 66


@pytest.mark.usefixtures("opengl")
def test_camera_follows(walked):
    """The robot stays in the middle however far it is moved."""
    q = walked.log["qpos"][0].copy()
    view = View(width=96, height=96, overlays=False)
    here = is_orange(still(walked.scene, q, view=view))
    q[:2] += (3.0, -2.0)
    there = is_orange(still(walked.scene, q, view=view))
    assert here.sum() > 10
    assert (here == there).mean() > 0.97


@pytest.mark.usefixtures("opengl")
def test_overlays_are_drawn(walked):
    """Footprints and paths change the floor, not the size of the picture."""
    time = 1.2
    with_them = render_still(walked, None, time, view=SMALL)
    view = View(width=96, height=96, overlays=False)
    without = render_still(walked, None, time, view=view)
    assert 0.002 < (with_them != without).any(axis=2).mean() < 0.5


@pytest.mark.usefixtures("opengl")
def test_animation_and_strip(walked, tmp_path):
    """An animation has a picture per period, a strip its pictures side by side."""
    film, strip, done = tmp_path / "a.webp", tmp_path / "a.png", []
    n = render_run(walked, film, view=SMALL, stop=1.0, fps=5.0, progress=done.append)
    assert n == 6
    assert done == pytest.approx([k / 6 for k in range(1, 7)])
    with Image.open(film) as image:
        assert getattr(image, "n_frames", 1) == 6
        assert image.size == (96, 96)
        assert image.info["loop"] == 0
    assert render_run(walked, strip, view=SMALL, count=3) == 3
    with Image.open(strip) as image:
        assert image.size == (288, 96)


@pytest.mark.usefixtures("opengl")
def test_saved_run_looks_the_same(walked, tmp_path):
    """A run folder gives the same picture as the run itself."""
    import mujoco

    mujoco.mj_saveModel(walked.scene, str(tmp_path / "scene.mjb"))
    columns = {**walked.log.columns, "substeps": np.array(walked.substeps)}
    save_columns(tmp_path / "run.npz", columns)
    a = render_still(walked, None, 0.8, view=SMALL)
    b = render_still(tmp_path, None, 0.8, view=SMALL)
    assert np.array_equal(a, b)


@pytest.mark.usefixtures("opengl")
def test_the_scene_is_left_alone(walked):
    """Drawing changes nothing in the user's model."""
    model = walked.scene
    before = (
        model.vis.global_.offwidth,
        model.light_pos.copy(),
        model.light_type.copy(),
    )
    still(model, walked.log["qpos"][0], view=SMALL)
    assert model.vis.global_.offwidth == before[0]
    assert np.array_equal(model.light_pos, before[1])
    assert np.array_equal(model.light_type, before[2])


@pytest.mark.usefixtures("opengl")
@pytest.mark.parametrize("name", ["missing/a.png", "a.xyz"])
def test_unwritable_picture(walked, tmp_path, name):
    """A picture that cannot be written gives one line."""
    with pytest.raises(RunError, match="cannot write the picture") as caught:
        render_still(walked, tmp_path / name, 0.0, view=SMALL)
    assert "\n" not in str(caught.value)


def test_footprints_are_where_the_soles_stood(walked):
    """Each stance leaves one print: its place is the plan's, its time the phase's."""
    recording = render._recording(walked)
    plan, log = walked.pattern.plan, walked.log
    assert len(recording.prints) == 2 + len(plan.steps)
    landed = {
        side: [p for p in recording.prints if p.side is side and p.landed > 0.0]
        for side in Side
    }
    for step in plan.steps:
        (mark,) = [p for p in landed[step.side] if abs(p.center[0] - step.x) < 0.02]
        assert mark.center[:2] == pytest.approx((step.x, step.y), abs=0.01)
        assert np.ptp(mark.corners, axis=0) == pytest.approx((0.24, 0.13), abs=0.01)
        row = int(np.searchsorted(log["t"], mark.landed))
        assert log["phase"][row] in (Phase.DOUBLE, Phase.STOP)


def test_simplified_model_cannot_be_drawn(tmp_path):
    """A run without a robot is refused."""
    run = simulate_pendulum(make_pattern(plan_steps(Gait(), 1), Pendulum()))
    with pytest.raises(RunError, match="simplified model"):
        render_run(run, tmp_path / "a.webp")


@pytest.mark.parametrize(
    "values",
    [
        {"width": 8},
        {"height": 1e6},
        {"elevation": 2.0},
        {"smooth": 0},
        {"distance": math.nan},
        {"azimuth": math.inf},
    ],
)
def test_bad_view(values):
    """A view out of range is refused by name."""
    with pytest.raises(ParameterError, match=next(iter(values))):
        View(**values)


@pytest.mark.parametrize(
    "values", [{"start": 1e3}, {"stop": -1.0}, {"fps": 0.0}, {"count": 0}]
)
def test_bad_span(walked, tmp_path, values):
    """A span or a rate out of range is refused by name."""
    with pytest.raises(ParameterError, match=next(iter(values))):
        render_run(walked, tmp_path / "a.png", **values)


class TestBackend:
    """The choice of MUJOCO_GL."""

    @pytest.fixture(autouse=True)
    def linux(self, monkeypatch):
        monkeypatch.setattr(sys, "platform", "linux")
        monkeypatch.setenv("MUJOCO_GL", "")

    def loads(self, monkeypatch, *names):
        monkeypatch.setattr(gl, "_loads", lambda name: name in names)

    @pytest.mark.parametrize(
        ("there", "chosen"),
        [(("egl", "osmesa"), "egl"), (("osmesa",), "osmesa"), ((), "")],
    )
    def test_order(self, monkeypatch, there, chosen):
        """EGL before OSMesa before what MuJoCo does by itself."""
        self.loads(monkeypatch, *there)
        assert gl.choose_backend() == chosen
        assert os.environ["MUJOCO_GL"] == chosen

    @pytest.mark.parametrize("wish", ["osmesa", "glfw", "disable"])
    def test_wish_is_kept(self, monkeypatch, wish):
        """What the user set is kept where it can work."""
        self.loads(monkeypatch, "egl", "osmesa")
        monkeypatch.setenv("MUJOCO_GL", wish)
        assert gl.choose_backend() == wish

    @pytest.mark.parametrize("wish", ["osmesa", "nonsense"])
    def test_wish_that_breaks_mujoco_is_replaced(self, monkeypatch, wish):
        """A value that would make the import of MuJoCo fail is replaced."""
        self.loads(monkeypatch, "egl")
        monkeypatch.setenv("MUJOCO_GL", wish)
        assert gl.choose_backend() == "egl"

    def test_other_systems_need_no_choice(self, monkeypatch):
        """On macOS and Windows MuJoCo knows best."""
        monkeypatch.setattr(sys, "platform", "darwin")
        self.loads(monkeypatch, "egl")
        assert gl.choose_backend() == ""

    def test_no_opengl_is_one_line(self, monkeypatch, walked, tmp_path):
        """Without OpenGL there is one line that says so, and what to install."""
        monkeypatch.setenv("MUJOCO_GL", "disable")
        with pytest.raises(
            ComwalkError, match=r"no OpenGL: .*everything else"
        ) as error:
            render_run(walked, tmp_path / "a.png", view=SMALL)
        assert "\n" not in str(error.value)


def test_choice_needs_no_mujoco():
    """`comwalk.views.gl` can be imported before MuJoCo."""
    code = "import sys, comwalk.views.gl; sys.exit('mujoco' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
