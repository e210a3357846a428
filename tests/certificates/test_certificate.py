"""Certificates: all answers together, the verdict, the command, the picture."""

from __future__ import annotations

import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.text import Text
from pictures import inked
from PIL import Image

import comwalk
from comwalk.certificates.bounds import sampled_weights, sampled_worst_case
from comwalk.certificates.certificate import SoleRoom, certify
from comwalk.certificates.defaults import default_control, default_pendulum, sole_room
from comwalk.certificates.gain_check import sampled_loop_of
from comwalk.certificates.gain_design import PUBLISHED
from comwalk.certificates.ideal_loop import is_hurwitz, proof_condition
from comwalk.certificates.largest_errors import worst_case
from comwalk.certificates.sampled_loop import SampledLoop, spectral_radius
from comwalk.cli.app import main
from comwalk.cli.certificate_table import (
    numbers_of_certificate,
    sections_of_certificate,
)
from comwalk.control.gains import Gains
from comwalk.errors import ParameterError
from comwalk.pattern.pendulum import Pendulum
from comwalk.robot.model import load_robot
from comwalk.views.gain_plane import loop_region, plot_gain_plane

PAPER, LOOP = Pendulum(), SampledLoop()
ROOM = SoleRoom(walking=(0.12, 0.065), standing=(0.12, 0.155))


@pytest.fixture(scope="module")
def paper():
    """Return the certificate of the paper's gains."""
    return certify(PAPER, Gains(), LOOP, room=ROOM)


def test_each_axis_has_its_answers(paper):
    """Theorem 1 and beyond: the paper's gains, walking x and y, standing x and y."""
    names = [x.name for x in paper.axes]
    assert names == ["walking x", "walking y", "standing x", "standing y"]
    x, y, *standing = (x.ideal for x in paper.axes)
    assert (x.theorem_1, x.remark_1, x.stable) == (True, True, True)
    assert x.proof is None  # the gap of the proof
    assert y.proof is not None
    assert [s.theorem_1 for s in standing] == [False, False]  # k_c = 3 < omega
    assert [s.stable for s in standing] == [True, True]
    assert x.natural_frequency == pytest.approx(4.139, abs=5e-4)
    assert y.damping == pytest.approx(0.996, abs=5e-4)
    assert x.poles[0] == pytest.approx(-2.380 + 3.387j, abs=1e-3)


def test_bounds_are_those_of_their_functions(paper):
    """Theorem 1: a certificate computes nothing twice, and mixes nothing up."""
    for x in paper.axes:
        for k, output in enumerate(("com", "zmp")):
            ideal, loop = getattr(x.ideal, output), getattr(x.loop, output)
            worst = worst_case(PAPER, x.k_p, x.k_c, 0.05, 0.5, output)
            assert ideal.worst.bound == worst.bound
            assert worst.bound <= ideal.peak <= ideal.invariant
            assert worst.bound <= ideal.ellipsoid <= (ideal.paper or math.inf)
            weights = sampled_weights(PAPER, x.k_p, x.k_c, LOOP)[k]
            assert loop.bound == sampled_worst_case(weights, LOOP, 0.05, 0.5).bound
            assert loop.bound == loop.worst.bound


def test_what_it_survives_is_the_sole_over_the_bound(paper):
    """|e_p| <= sole: the bound grows with a (and b with it), so it can be inverted."""
    for x in paper.axes:
        room = ROOM[x.standing]["xy".index(x.axis)]
        weights = sampled_weights(PAPER, x.k_p, x.k_c, LOOP)[1]
        a = x.loop.survives
        bound = sampled_worst_case(weights, LOOP, a, 10.0 * a).bound
        assert bound == pytest.approx(room, rel=1e-6)
    assert paper.survives == (paper.axes[1].loop.survives, "walking y")
    assert paper.delay_margin == (paper.axes[0].loop.margins.delay, "walking x")


def test_verdict_says_what_to_act_on(paper):
    survived, delay = paper.survives[0], 1e3 * paper.delay_margin[0]
    assert paper.verdict == (
        f"stable; survives {survived:.3f} m/s of CoM velocity error inside the sole "
        f"(walking y); the loop tolerates {delay:.1f} ms more delay (walking x)"
    )
    assert "survives" not in certify(PAPER, Gains(), LOOP, exact=False).verdict


def test_delay_margin_of_the_verdict_is_real(paper):
    """Ticks within it are stable, one tick more is not."""
    delay, _ = paper.delay_margin
    ticks = math.floor(delay / LOOP.period)
    for more, stable in ((ticks, True), (ticks + 1, False)):
        late = replace(LOOP, delay=LOOP.delay + more)
        assert certify(PAPER, Gains(), late, exact=False).stable == stable


def test_without_linear_programs_bounds_are_safe(paper):
    quick = certify(PAPER, Gains(), LOOP, room=ROOM, exact=False)
    for x, y in zip(quick.axes, paper.axes, strict=True):
        assert x.ideal.zmp.worst is None
        assert x.loop.zmp.worst is None
        assert x.loop.zmp.bound > y.loop.zmp.bound
        assert x.loop.com.bound > y.loop.com.bound
        assert x.loop.survives < y.loop.survives
        assert x.loop.margins == y.loop.margins


@pytest.mark.parametrize(
    ("gains", "loop", "words"),
    [
        (Gains(zmp=(7.0, 1.8)), LOOP, "must be below gains.com"),
        (Gains(), replace(LOOP, zmp_cutoff=20.0), "set zmp_cutoff to 4.4 Hz"),
        (Gains(), replace(LOOP, dead_time=0.006), "errors grow"),
    ],
)
def test_unstable_gains_are_told_with_the_remedy(gains, loop, words):
    found = certify(PAPER, gains, loop, room=ROOM)
    assert not found.stable
    assert found.verdict.startswith("UNSTABLE: ")
    assert words in found.verdict
    x = found.axes[0].loop
    assert (x.margins, x.zmp, x.survives) == (None, None, None)
    assert not x.stable


def test_open_loop_and_feedback_of_the_com_alone():
    open_loop = certify(PAPER, Gains(zmp=(0, 0), com=(0, 0)), LOOP)
    assert open_loop.stable
    assert "nothing is fed back" in open_loop.verdict
    assert all(x.ideal is x.loop is None for x in open_loop.axes)
    com = certify(PAPER, Gains(zmp=(0, 0)), LOOP, room=ROOM)
    assert com.stable
    assert com.axes[0].ideal is None
    assert com.axes[0].loop.margins.gain_up > 3.0
    assert com.axes[0].loop.com.bound == pytest.approx(0.05 / 6.6, rel=0.02)


@pytest.mark.parametrize("name", ["a", "b"])
@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan])
def test_bad_bounds_are_refused(name, bad):
    with pytest.raises(ParameterError, match=f"{name} must be"):
        certify(PAPER, Gains(), LOOP, **{name: bad})


def test_the_certificate_of_a_run_is_of_its_loop():
    """What is checked before a walk and what is certified is one loop."""
    robot = load_robot("paper")
    control, room = default_control(robot), sole_room(robot)
    assert sampled_loop_of(control) == SampledLoop(period=control.period, delay=1)
    assert room.walking == pytest.approx((0.12, 0.065))
    assert room.standing[1] == pytest.approx(0.065 + 0.09)
    assert default_pendulum(robot) == PAPER


# --- For people and for programs -----------------------------------------------------


def test_table_and_numbers_say_the_same(paper):
    numbers = json.loads(json.dumps(numbers_of_certificate(paper), allow_nan=False))
    rows = {row[0]: row[1:] for s in sections_of_certificate(paper) for row in s.rows}
    loops = [axis["loop"] for axis in numbers["axes"]]
    assert rows["gain margin"] == tuple(f"{x['margins']['gain_up']:.3g}" for x in loops)
    assert rows["ZMP error [mm]"] == tuple(
        f"{1e3 * x['zmp']['bound']:.1f}" for x in loops
    )
    assert rows["proved by the paper's V"] == ("no", "yes", "no", "no")
    assert numbers["survives_m_s"] == paper.survives[0]
    assert numbers["axes"][0]["ideal"]["zmp"]["peak_gain"] == pytest.approx(1.14359)
    assert all(len(row) == 4 for row in rows.values())


def test_published_gains_are_where_they_are_said_to_be():
    """Their own ideal loops: all but one are stable; some break the paper's proof."""
    unstable = [g.robot for g in PUBLISHED if not is_hurwitz(g.k_p, g.k_c)]
    assert unstable == ["G1, FrJoCo"]
    proved = [g for g in PUBLISHED if proof_condition(g.pendulum, g.k_p, g.k_c)]
    assert len(PUBLISHED) - len(unstable) - len(proved) == 7
    assert len({(g.robot, g.use) for g in PUBLISHED}) == len(PUBLISHED)


def test_region_of_the_loop_is_where_it_is_stable():
    """Sampled Eq. (31): inside the edge and outside of it, by eigenvalues."""
    k_c = np.array([2.0, 6.6, 12.0])
    edge, half = loop_region(PAPER, LOOP, k_c)
    for k, p, p_half in zip(k_c, edge, half, strict=True):
        assert spectral_radius(PAPER, 0.99 * p, k, LOOP) < 1.0
        assert spectral_radius(PAPER, 1.01 * p, k, LOOP) > 1.0
        assert spectral_radius(PAPER, 1.98 * p_half, 2.0 * k, LOOP) < 1.0


def test_picture_has_all_gains_and_regions(paper, tmp_path):
    path = tmp_path / "gains.png"
    figure = plot_gain_plane(paper, path, title="paper")
    text = "\n".join(t.get_text() for t in figure.findobj(Text))
    for words in ("Theorem 1 and Remark 1", "proved by", "walk x", "ergoCubSN000"):
        assert words in text
    for number in range(1, len(PUBLISHED) + 1):
        assert f"\n{number}  {PUBLISHED[number - 1].robot}" in text
    stars = [x for x in figure.axes[0].get_lines() if x.get_marker() == "*"]
    places = {(float(x.get_xdata()[0]), float(x.get_ydata()[0])) for x in stars}
    expected = {(x.k_p / PAPER.omega, x.k_c / PAPER.omega) for x in paper.axes}
    assert places == expected
    with Image.open(path) as image:
        assert image.width > 1000


def test_command_prints_verdict_and_table(capsys):
    assert main(["certify"]) == 0
    out = capsys.readouterr().out
    assert out.startswith("paper: stable; survives 0.035 m/s of CoM velocity error")
    assert "largest" not in out.splitlines()[0]
    assert max(map(len, out.splitlines()[1:])) <= 88
    for words in ("gain margin", "L1 gain", "4 Hz filter", "standing y"):
        assert words in out


def test_command_for_programs_and_files(tmp_path, capsys):
    words = ["certify", "jvrc1", "--json", "--no-exact", "--out", str(tmp_path)]
    assert main([*words, "--loop.servo-lag", "0.03", "--loop.dead-time", "0.003"]) == 0
    numbers = json.loads(capsys.readouterr().out)
    assert numbers["robot"] == "jvrc1"
    assert numbers["loop"]["servo_lag"] == 0.03
    assert numbers["loop"]["dead_time"] == 0.003
    written = json.loads((tmp_path / "certificate.json").read_text())
    assert written["axes"] == numbers["axes"]
    files = sorted(Path(file).name for file in numbers["files"])
    assert files == ["certificate.json", "gains.png"]
    assert inked(tmp_path / "gains.png") > 0.02


def test_command_with_unstable_gains_fails(capsys):
    assert (
        main(["certify", "--no-exact", "--gains.zmp", "3", "--gains.com", "2.5"]) == 1
    )
    assert "UNSTABLE" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--loop.servo-lag", "-1"], "loop.servo_lag must be"),
        (["--loop.dead-time", "100"], "dead_time must be"),
        (["--loop.mode-frequency", "0"], "loop.mode_frequency must be"),
        (["--loop.mode-damping", "0"], "loop.mode_damping must be"),
        (["--loop.period", "nan"], "loop.period must be"),
        (["--disturbance", "0,1"], "disturbance (a) must be"),
        (["nobody"], 'unknown robot "nobody"'),
    ],
)
def test_command_refuses_in_one_line(words, message, capsys):
    assert main(["certify", *words]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_command_reads_a_file(tmp_path, capsys):
    file = tmp_path / "loop.toml"
    file.write_text("exact = false\n[loop]\nservo_lag = 0.04\n[gains]\nzmp = 2\n")
    assert main(["certify", "--config", str(file), "--json"]) == 0
    numbers = json.loads(capsys.readouterr().out)
    assert numbers["loop"]["servo_lag"] == 0.04
    assert [x["k_p"] for x in numbers["axes"][:2]] == [2.0, 2.0]


def test_a_stance_leg_that_yields_is_not_called_stable():
    """Below m g / h the robot tips over by itself, whatever the gains."""
    parts = PAPER, Gains(), LOOP
    fine, soft, tips = (
        certify(*parts, stance=ratio, exact=False) for ratio in (2.0, 1.3, 0.8)
    )
    assert fine.verdict == certify(*parts, exact=False).verdict
    assert soft.stable
    assert "holds 1.30 of m g / h, at least 1.5" in soft.verdict
    assert not tips.stable
    assert tips.verdict.startswith("UNSTABLE: the servos of a stance leg hold")
    assert "1.88 times as stiff" in tips.verdict


POSITION = ("--actuation", "position")


def test_a_file_with_soft_servos_is_not_certified(tmp_path, capsys):
    """`comwalk certify` of servos that the body sinks on; a profile mends it."""
    text = (Path(comwalk.__file__).parent / "robots" / "paper.xml").read_text()
    (tmp_path / "soft.xml").write_text(re.sub(r'kp="[\d.]+"', 'kp="150"', text))
    assert main(["certify", str(tmp_path / "soft.xml"), *POSITION, "--json"]) == 1
    told = json.loads(capsys.readouterr().out)
    assert told["verdict"].startswith("UNSTABLE: the servos of a stance leg")
    assert told["stance_stiffness_ratio"] < 1.0
    assert main(["walk", str(tmp_path / "soft.xml"), *POSITION, "--steps", "2"]) == 2
    assert "times as stiff" in capsys.readouterr().err
