"""The paper's figures: what is drawn is what was recorded."""

from __future__ import annotations

from dataclasses import replace

import matplotlib
import numpy as np
import pytest
from matplotlib.colors import to_rgba
from matplotlib.text import Text
from pictures import inked
from PIL import Image

from comwalk.control.guard import End, Outcome
from comwalk.embedding.dances import builtin_motion
from comwalk.embedding.motion import embed_in
from comwalk.errors import ComwalkError, RunError
from comwalk.pattern.closed_form import coefficients, transfer_zmp
from comwalk.pattern.footsteps import Foothold, FootstepPlan, Gait
from comwalk.pattern.pendulum import Pendulum
from comwalk.pattern.plans import plan_steps
from comwalk.pattern.reference import Phase
from comwalk.pattern.walk_pattern import make_pattern
from comwalk.run import Run, simulate_pendulum
from comwalk.views.matplotlib_figures import Row, plot_arms, plot_dance, plot_run
from comwalk.views.pattern_figure import plot_pattern


@pytest.fixture(scope="module")
def walked() -> Run:
    """Six steps of the simplified model."""
    return simulate_pendulum(make_pattern(plan_steps(Gait(), 6), Pendulum()))


@pytest.fixture(scope="module")
def stood() -> Run:
    """One second of standing of the simplified model."""
    plan = FootstepPlan(
        left=Foothold(0, 0.09), right=Foothold(0, -0.09), stand_time=0.5
    )
    return simulate_pendulum(make_pattern(plan, Pendulum()))


def curve(ax, label):
    """Return the points of the one line with a label."""
    (line,) = [line for line in ax.get_lines() if line.get_label() == label]
    return line.get_xdata(), line.get_ydata()


def texts(figure):
    """Return all that is written in a figure, its legend too."""
    found = figure.findobj(Text)
    return "\n".join(text.get_text() for text in found)


def test_run_shows_columns(walked):
    """Fig. 7: CoM and ZMP, desired and actual, are the log's columns."""
    axes = plot_run(walked).axes
    left = axes[::2]
    log = walked.log
    for i in range(2):
        for label, column in (
            ("CoM", "com"),
            ("CoM, plan", "com_ref"),
            ("ZMP", "zmp_filtered"),
            ("ZMP, plan", "zmp_ref"),
        ):
            t, values = curve(left[i], label)
            assert np.array_equal(t, log["t"])
            assert np.array_equal(values, log[column][:, i])


def test_run_errors_are_desired_minus_actual(walked):
    """Eq. (31): e_c = c^d - c and e_p = p^d - p, in mm."""
    axes = plot_run(walked).axes[::2]
    log = walked.log
    for i in range(2):
        _, e_c = curve(axes[2 + i], "CoM")
        _, e_p = curve(axes[2 + i], "ZMP")
        com = 1e3 * (log["com_ref"] - log["com"])[:, i]
        zmp = 1e3 * (log["zmp_ref_filtered"] - log["zmp_filtered"])[:, i]
        assert np.allclose(e_c, com, atol=1e-9)
        assert np.allclose(e_p, zmp, atol=1e-9)


def test_run_enlarges_two_steps(walked):
    """The right column shows two single supports from its beginning to its end."""
    axes = plot_run(walked).axes
    begin, end = axes[1].get_xlim()
    inside = [
        span
        for span in walked.pattern.phases
        if span.phase in (Phase.SINGLE_LEFT, Phase.SINGLE_RIGHT)
        and begin <= span.start
        and span.start + span.duration <= end
    ]
    assert len(inside) == 2
    assert end - begin < 3.0
    assert len(axes[1].patches) == 2


def test_run_shades_each_single_support(walked):
    """Each single support is shaded once, by its own length."""
    ax = plot_run(walked).axes[0]
    patches = ax.patches
    spans = [s for s in walked.pattern.phases if "SINGLE" in s.phase.name]
    assert len(patches) == len(spans)
    for patch, span in zip(patches, spans, strict=True):
        low, high = patch.get_extents().transformed(ax.transData.inverted()).intervalx
        assert low == pytest.approx(span.start, abs=1e-6)
        assert high == pytest.approx(span.start + span.duration, abs=1e-6)
    assert len({to_rgba(p.get_facecolor()) for p in patches}) == 2


def test_short_run_has_one_column(stood):
    """A short run has nothing to enlarge."""
    figure = plot_run(stood)
    assert len(figure.axes) == 4
    assert "completed in 1.00 s" in texts(figure)


def test_run_marks_a_fall(walked):
    """A fall is named in the title and marked at its time in every panel."""
    outcome = Outcome(End.FELL, 5.5, Phase.SINGLE_LEFT, 3, "the trunk tilted by 40 deg")
    figure = plot_run(replace(walked, outcome=outcome))
    assert "fell at 5.50 s" in texts(figure)
    assert "tilted by 40 deg" in texts(figure)
    for ax in figure.axes:
        marks = [line.get_xdata() for line in ax.get_lines()]
        assert [5.5, 5.5] in [np.asarray(x).tolist() for x in marks]


def test_run_of_nan_is_drawn(walked, tmp_path):
    """A run that ended in no numbers can still be looked at."""
    columns = walked.log.columns
    kept = columns["com"].copy()
    try:
        columns["com"][-5:] = np.nan
        figure = plot_run(walked, tmp_path / "nan.png")
    finally:
        columns["com"][:] = kept
    assert inked(tmp_path / "nan.png") > 0.02
    drawn = [np.asarray(x.get_ydata()) for a in figure.axes for x in a.get_lines()]
    missing = [int(np.isnan(y).sum()) for y in drawn if len(y) == len(kept)]
    assert max(missing) == 5


def test_picture_is_written_with_table(walked, tmp_path):
    """The file holds the figure at 150 dpi; a table makes it higher."""
    plain, table = tmp_path / "plain.png", tmp_path / "table.png"
    plot_run(walked, plain)
    figure = plot_run(walked, table, table=[Row("$T$", "1", "1.25", "s")])
    with Image.open(plain) as a, Image.open(table) as b:
        assert a.width == b.width == 1800
        assert b.height > a.height
    assert "1.25 s" in texts(figure)


@pytest.mark.parametrize("name", ["no/such/folder/a.png", "a.xyz", "a.png/b.png"])
def test_unwritable_picture(walked, tmp_path, name):
    """A picture that cannot be written gives one line that names the file."""
    (tmp_path / "a.png").write_bytes(b"")
    with pytest.raises(RunError) as caught:
        plot_run(walked, tmp_path / name)
    assert str(tmp_path / name) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert isinstance(caught.value, ComwalkError)


def test_global_state_of_matplotlib_is_untouched(walked, tmp_path):
    """Plotting changes no setting of a user's own plots."""
    before = dict(matplotlib.rcParams)
    plot_run(walked, tmp_path / "a.png")
    assert dict(matplotlib.rcParams) == before


def test_pattern_marks_the_papers_numbers():
    """Eqs. (8), (13): K_x and K_y stand in Fig. 3, with A and B."""
    gait, pendulum = Gait(), Pendulum()
    figure = plot_pattern(make_pattern(plan_steps(gait, 20), pendulum))
    K_x, K_y = transfer_zmp(gait, pendulum.omega)
    written = texts(figure)
    assert f"$K_x$ = {1e3 * K_x:.2f} mm" in written
    assert f"$K_y$ = {1e3 * K_y:.2f} mm" in written
    assert "$A$ = 90 mm" in written
    assert "$B$ = 100 mm" in written
    assert "$T-t_d$\n0.9" in written


def test_pattern_curves_are_those_of_the_paper():
    """Eqs. (5), (10): the CoM in Fig. 3 is the paper's closed form."""
    gait, pendulum = Gait(), Pendulum()
    figure = plot_pattern(make_pattern(plan_steps(gait, 30), pendulum))
    omega, t_d = pendulum.omega, gait.transfer_time
    C = coefficients(gait, omega)
    ax_x, ax_y = figure.axes[:2]
    for ax, C_1, C_2, foot in (
        (ax_x, C.C_x1, C.C_x2, gait.half_step),
        (ax_y, C.C_y1, C.C_y2, gait.half_width),
    ):
        t, c = curve(ax, "CoM $c^d$")
        single = (t >= t_d) & (t <= gait.period - t_d)
        s = omega * (t[single] - t_d)
        closed = C_1 * np.cosh(s) + C_2 * np.sinh(s) + foot
        assert np.abs(c[single] - closed).max() < 1e-9


def test_pattern_of_a_turn_is_seen_from_the_body():
    """In a curve the two steps are drawn from the middle of the feet, straight on."""
    plan = plan_steps(Gait(turn=0.25), 12)
    figure = plot_pattern(make_pattern(plan, Pendulum()))
    for ax in figure.axes[:2]:
        _, c = curve(ax, "CoM $c^d$")
        assert abs(c[0]) < 0.005
    _, c_x = curve(figure.axes[0], "CoM $c^d$")
    assert 0.1 < c_x[-1] < 0.25


def test_pattern_without_paper_double_support_has_no_K():
    """The minimum-jerk ZMP ends double support on the foot: there is no K."""
    gait = Gait(double_support="minjerk")
    figure = plot_pattern(make_pattern(plan_steps(gait, 4), Pendulum()))
    assert "K_x" not in texts(figure)
    assert "$B$ = 100 mm" in texts(figure)


@pytest.mark.parametrize("steps", [1, 2, 3])
def test_short_pattern(steps, tmp_path):
    """Plans of a few steps are drawn too."""
    path = tmp_path / "short.png"
    pattern = make_pattern(plan_steps(Gait(), steps), Pendulum())
    figure = plot_pattern(pattern, path)
    assert inked(path) > 0.02
    feet = [a for a in figure.axes if len(a.patches) == len(pattern.plan.steps) + 2]
    assert len(feet) == 1  # each footprint once


def test_standing_pattern_is_only_footprints(stood):
    """A plan without steps has nothing of Fig. 3."""
    figure = plot_pattern(stood.pattern)
    assert len(figure.axes) == 1
    assert len(figure.axes[0].patches) == 2


def test_arms_of_a_motion():
    """Fig. 5: the curves are the motion's own angles, each arm in its panel."""
    dance = builtin_motion("paper", amplitude=0.7)
    embedded = embed_in(dance, dict.fromkeys(dance.joints, 0.1), start=1.0, stop=6.0)
    figure = plot_arms(embedded)
    assert [ax.get_title(loc="left") for ax in figure.axes] == ["left arm", "right arm"]
    for ax, side in zip(figure.axes, "lr", strict=True):
        names = [name for name in dance.joints if name[0] == side]
        for name in names:
            t, angles = curve(ax, name)
            j = dance.joints.index(name)
            assert angles[500] == embedded.at(float(t[500]))[0][j]


def test_arms_of_the_simplified_model(walked):
    """A run without arms is refused."""
    with pytest.raises(RunError, match="simplified model"):
        plot_arms(walked)


def test_dance_shows_distances_in_mm(stood, walked):
    """Fig. 6: distances from where the CoM began, beside another run, with the band."""
    figure = plot_dance(walked, without=stood)
    log = walked.log
    for i, ax in enumerate(figure.axes):
        _, com = curve(ax, "CoM")
        assert np.allclose(com, 1e3 * (log["com"][:, i] - log["com_ref"][0, i]))
    assert "10 mm" in texts(figure)
    assert "ignoring the arms" in texts(figure)
    band = figure.axes[0].patches[0].get_extents()
    low, high = band.transformed(figure.axes[0].transData.inverted()).intervaly
    assert (low, high) == pytest.approx((-10.0, 10.0))
