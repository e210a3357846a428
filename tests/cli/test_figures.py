"""Section VI: each figure of the paper beside ours."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest
from PIL import Image

from comwalk.cli import figures
from comwalk.errors import RunError
from comwalk.pattern.closed_form import transfer_zmp
from comwalk.pattern.footsteps import Gait
from comwalk.pattern.pendulum import Pendulum
from comwalk.pattern.plans import plan_steps
from comwalk.pattern.walk_pattern import make_pattern
from comwalk.setup import build_dance, build_walk


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    """The figures of a walk of 4 steps and a dance of 4 s; and what was said."""
    folder, said = tmp_path_factory.mktemp("figures") / "new", []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(figures, "build_walk", lambda c: build_walk(replace(c, steps=4)))
        patch.setattr(
            figures,
            "build_dance",
            lambda c: build_dance(replace(c, duration=4.0, blend=1.0)),
        )
        numbers = figures.draw_figures(folder, said.append)
    return folder, numbers, said


def test_pattern_quantities_are_the_closed_form():
    """Eqs. (8), (13): K_x and K_y measured on a long walk."""
    gait, pendulum = Gait(), Pendulum()
    pattern = make_pattern(plan_steps(gait, 30), pendulum)
    ours = {q.name: q.ours for q in figures.pattern_quantities(pattern)}
    K_x, K_y = transfer_zmp(gait, pendulum.omega)
    expected = {"T": 1.0, "t_d": 0.1, "A": 0.09, "B": 0.1, "K_x": K_x, "K_y": K_y}
    for name, value in expected.items():
        assert ours[name] == pytest.approx(value, rel=1e-9)


def test_paper_figures_are_stated():
    """Fig. 3: the paper's omega_n to its three digits, and K of its own equations."""
    pattern = make_pattern(plan_steps(Gait(), 20), Pendulum())
    table = {q.name: q for q in figures.pattern_quantities(pattern)}
    assert table["omega_n"].paper == 3.78
    assert round(table["omega_n"].ours, 2) == 3.78
    for name in ("K_x", "K_y"):
        assert table[name].ours == pytest.approx(table[name].paper, rel=5e-4)


def test_files(drawn):
    """All four figures and both tables are written."""
    folder, numbers, said = drawn
    assert set(numbers) == {"fig3", "fig5", "fig6", "fig7"}
    for name in numbers:
        with Image.open(folder / f"{name}.png") as image:
            assert image.width >= 1300
    assert json.loads((folder / "figures.json").read_text()) == numbers
    lines = (folder / "figures.md").read_text().splitlines()
    assert len(lines) == 2 + sum(len(table) for table in numbers.values())
    assert any("walking" in text for text in said)


def test_dance_holds_the_com(drawn):
    """Fig. 6: ZMP within 10 mm, CoM held far better than if the arms are ignored."""
    table = drawn[1]["fig6"]
    assert table["zmp_max"]["paper"] == 10.0
    assert table["zmp_max"]["ours"] < 10.0
    assert table["com_max"]["ours"] < 1.0
    assert table["com_max_ignoring"]["ours"] > 4.0 * table["com_max"]["ours"]


def test_walk_states_the_papers_settings(drawn):
    """Fig. 7: mass, height, gait and gains are the paper's."""
    table = drawn[1]["fig7"]
    stated = {k: v for k, v in table.items() if v["paper"] is not None}
    assert {"m", "c_z", "T", "t_d", "A", "B", "k_px", "k_py", "k_cx", "k_cy"} <= set(
        stated
    )
    for value in stated.values():
        assert value["ours"] == pytest.approx(value["paper"], rel=1e-3)
    assert table["com_rms_x"]["unit"] == "mm"
    assert 0.0 < table["com_rms_x"]["ours"] < 20.0


def test_arms_follow(drawn):
    """Fig. 5: the arms' joints dance, by half a radian."""
    table = drawn[1]["fig5"]
    assert table["joints"]["ours"] == 6
    assert table["swing"]["ours"] == pytest.approx(0.5, abs=0.05)


def test_unwritable_folder(tmp_path):
    """A folder that cannot be made is refused before anything is simulated."""
    (tmp_path / "file").write_text("")
    with pytest.raises(RunError, match="cannot write"):
        figures.draw_figures(tmp_path / "file" / "figures")
