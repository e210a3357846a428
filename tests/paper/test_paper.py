"""The paper map `docs/paper.md` is complete and true, and the errata are executed."""

from __future__ import annotations

import ast
import contextlib
import importlib
import inspect
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from robots import jvrc, paper, posture_of, random_configuration, random_task

import comwalk
from comwalk.certificates.ideal_loop import error_dynamics, zmp_error_from_com
from comwalk.control.gains import PAPER_GAINS
from comwalk.control.law import ControlSettings, WalkingController, walking_control
from comwalk.control.plant import PAPER_MASS, Command, PendulumPlant
from comwalk.embedding.elimination import embed, resolve_by_elimination
from comwalk.embedding.rotations import shift, skew
from comwalk.embedding.task import (
    CartesianMotion,
    JointMotion,
    Task,
    motion_of,
)
from comwalk.pattern.closed_form import transfer_zmp
from comwalk.pattern.footsteps import PAPER_GAIT
from comwalk.pattern.pendulum import PAPER_PENDULUM, zmp_of_motion
from comwalk.pattern.plans import plan_steps
from comwalk.pattern.reference import Phase
from comwalk.pattern.walk_pattern import make_pattern
from comwalk.robot.kinematics import Kinematics

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "paper.md").read_text(encoding="utf-8")
ROBOTS = {"paper": paper, "jvrc1": jvrc}


@pytest.fixture(params=ROBOTS)
def robot(request):
    return ROBOTS[request.param]()


# ---- The page ---------------------------------------------------------------------


def section(title: str) -> str:
    """Return the text of one section of the page."""
    return PAGE.split(f"## {title}\n", 1)[1].split("\n## ", 1)[0]


def rows_of(title: str) -> list[list[str]]:
    """Return the cells of a section's table, without its head."""
    lines = [x for x in section(title).splitlines() if x.startswith("|")]
    return [[c.strip() for c in x.strip("|").split("|")] for x in lines[2:]]


def names_in(cell: str) -> list[str]:
    """Return what stands in backticks."""
    return re.findall(r"`([^`]+)`", cell)


def numbers_in(text: str) -> set[int]:
    """Return the equations that a text names: Eq. (1); Eqs. (4), (6)-(8) and (10)."""
    found: set[int] = set()
    joint = r"(?:\(\d+\)(?:\s*(?:,|-|to|and|or)\s*)*)+"
    for match in re.finditer(rf"Eqs?\.\s+({joint})", text):
        last, ranging = 0, False
        for token in re.findall(r"\(\d+\)|-|to", match[1]):
            if token in ("-", "to"):
                ranging = True
                continue
            number = int(token[1:-1])
            found |= set(range(last + 1 if ranging else number, number + 1))
            last, ranging = number, False
    return found


def resolve(name: str) -> object:
    """Return what a dotted name under comwalk stands for; None for a plain field."""
    value: object = comwalk
    for part in name.split("."):
        if inspect.ismodule(value):
            with contextlib.suppress(ImportError):
                importlib.import_module(f"{value.__name__}.{part}")
        if part in getattr(value, "__annotations__", {}):
            return None
        value = getattr(value, part)
    return value


@cache
def docstrings_of(file: str) -> dict[str, str]:
    """Return the tests of a file with their docstrings."""
    tree = ast.parse((ROOT / "tests" / file).read_text(encoding="utf-8"))
    return {
        node.name: ast.get_docstring(node) or ""
        for node in tree.body
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_")
    }


EQUATIONS = rows_of("Equations")


def test_reading_numbers():
    """The reader of this file, on all ways in which docstrings name equations."""
    assert numbers_in("Eq. (8), and p. (9)") == {8}
    assert numbers_in("Eqs. (6), (7), (11) and\n (12).") == {6, 7, 11, 12}
    assert numbers_in("Eqs. (4)-(6); Eqs. (32) to (34), Eq. (36)") == {
        4, 5, 6, 32, 33, 34, 36,
    }  # fmt: skip
    assert numbers_in("Figs. (1)") == set()


def test_every_equation_has_one_row():
    """(1) to (38), in order."""
    assert [row[0] for row in EQUATIONS] == [f"({n})" for n in range(1, 39)]


@pytest.mark.parametrize("row", EQUATIONS, ids=[row[0] for row in EQUATIONS])
def test_every_equation_has_a_function_and_a_test(row):
    """They exist, and both name the equation in their docstrings."""
    number, _, functions, tests = row
    n = int(number[1:-1])
    assert names_in(functions)
    assert names_in(tests)
    for name in names_in(functions):
        value = resolve(name)
        assert callable(value) or isinstance(value, property), name
        assert n in numbers_in(value.__doc__ or ""), f"{name} does not name Eq. ({n})"
    for name in names_in(tests):
        file, test = name.split("::")
        assert test in docstrings_of(file), name
        told = numbers_in(docstrings_of(file)[test])
        assert n in told, f"{name} does not name Eq. ({n})"


@pytest.mark.parametrize("row", rows_of("Symbols"), ids=lambda row: row[0])
def test_every_symbol_has_a_name(row):
    """The public names exist; the letters are those of some function body."""
    assert names_in(row[1])
    for name in names_in(row[1]):
        resolve(name)
    code = "".join(p.read_text() for p in (ROOT / "src" / "comwalk").rglob("*.py"))
    for letters in names_in(row[2]):
        assert re.search(rf"\b{re.escape(letters)}\b", code), letters


@pytest.mark.parametrize("row", rows_of("Errata"), ids=lambda row: row[0])
def test_every_erratum_is_executed(row):
    """Each names a test that exists."""
    assert names_in(row[3])
    for name in names_in(row[3]):
        file, test = name.split("::")
        assert test in docstrings_of(file), name


def test_every_other_name_on_the_page_exists():
    """Settings and functions that the text mentions."""
    for title in ("Figures printed in Section VI", "What comwalk adds"):
        for name in names_in(section(title)):
            if re.fullmatch(r"[a-z_]+\.\w+(\.\w+)*", name):
                resolve(name)


# ---- Figures that the paper prints ------------------------------------------------


def test_printed_gait():
    """Section VI: T, t_d, A, B; and c_z, omega_n, m."""
    gait = PAPER_GAIT
    assert (gait.period, gait.transfer_time) == (1.0, 0.1)
    assert (gait.half_width, gait.half_step) == (0.09, 0.1)
    assert PAPER_PENDULUM.height == 0.687
    assert round(PAPER_PENDULUM.omega, 2) == 3.78
    assert PAPER_MASS == 67.68


def test_printed_gains():
    """Section VI: k_p = {3.0, 1.8}, k_c = {6.6, 3.8} for x, y."""
    assert PAPER_GAINS.zmp == (3.0, 1.8)
    assert PAPER_GAINS.com == (6.6, 3.8)


def test_printed_robot():
    """Section VI: 67.68 kg, CoM at 0.687 m, feet 2 x 0.09 m apart."""
    robot = paper()
    posture = Kinematics(robot).posture(robot.home)
    assert robot.mass == pytest.approx(67.68, abs=1e-9)
    assert posture.com[2] == pytest.approx(0.687, abs=1e-4)
    left, right = posture.ends[0], posture.ends[1]
    assert left[1] - right[1] == pytest.approx(2 * 0.09, abs=1e-9)


def test_printed_step():
    """Fig. 2: footprints are 2B = 0.2 m apart and 2A = 0.18 m wide."""
    plan = plan_steps(PAPER_GAIT, 6)
    x = [step.x for step in plan.steps[:6]]
    assert np.diff([0.0, *x]) == pytest.approx(np.full(6, 0.2), abs=1e-12)
    assert {abs(step.y) for step in plan.steps} == {0.09}


# ---- Equations that are steps of a derivation -------------------------------------


def index_of(robot, name):
    return [limb.name for limb in robot.limbs].index(name)


def columns_of(robot, posture, name):
    """Return X_i and J_i, J_ci of a limb, world."""
    i = index_of(robot, name)
    own = robot.limbs[i].columns
    X = shift(posture.ends[i] - posture.position)
    return X, posture.end_jacobian(i)[:, own], posture.com_jacobian[:, own]


def random_case(robot, seed):
    """Return a posture and a task with a moving base foot."""
    rng = np.random.default_rng(seed)
    posture = posture_of(robot, random_configuration(robot, rng))
    return posture, random_task(robot, rng, base_twist=rng.normal(size=6))


@pytest.mark.parametrize("seed", range(5))
def test_all_limbs_share_the_body_twist(robot, seed):
    """Eqs. (18), (19), (22): of the resolved motion, whichever limb gives it."""
    posture, task = random_case(robot, seed)
    result = resolve_by_elimination(robot.limbs, posture, task)
    X_1, J_1, _ = columns_of(robot, posture, "left_leg")
    dq_1 = result.velocity[robot.limbs[index_of(robot, "left_leg")].columns]
    x_o = X_1 @ (task.base_twist - J_1 @ dq_1)
    assert np.abs(x_o - result.body_twist).max() < 1e-9
    X_2, J_2, _ = columns_of(robot, posture, "right_leg")
    dq_2 = result.velocity[robot.limbs[index_of(robot, "right_leg")].columns]
    x_2 = task.motions["right_leg"].twist
    assert np.abs(X_2 @ (x_2 - J_2 @ dq_2) - result.body_twist).max() < 1e-9
    X_21 = np.linalg.inv(X_2) @ X_1
    J_inv = np.linalg.inv(J_2)
    printed = J_inv @ x_2 - J_inv @ X_21 @ (task.base_twist - J_1 @ dq_1)
    assert np.abs(printed - dq_2).max() < 1e-9


def printed_com_velocity(robot, posture, task, dq_1, moving_base):
    """Return the right side of (23), or of (24) without the base limb's motion."""
    X_1, J_1, J_c1 = columns_of(robot, posture, "left_leg")
    r_c1 = posture.com - posture.ends[index_of(robot, "left_leg")]
    x_1 = task.base_twist
    cdot = -J_1[:3] @ dq_1 + skew(r_c1) @ J_1[3:] @ dq_1 + J_c1 @ dq_1
    if moving_base:
        cdot = cdot + x_1[:3] + np.cross(x_1[3:], r_c1)
    for limb in robot.limbs:
        motion = motion_of(task, limb.name)
        if limb.name == "left_leg":
            continue
        X_i, J_i, J_ci = columns_of(robot, posture, limb.name)
        if isinstance(motion, JointMotion):
            cdot = cdot + J_ci @ motion.rates
            continue
        X_i1 = np.linalg.inv(X_i) @ X_1
        J_inv = np.linalg.inv(J_i)
        cdot = cdot + J_ci @ J_inv @ (motion.twist - X_i1 @ x_1 + X_i1 @ J_1 @ dq_1)
    return cdot


@pytest.mark.parametrize("seed", range(5))
def test_com_velocity_by_the_base_limb_alone(robot, seed):
    """Eqs. (23), (24): term by term, against the CoM Jacobian of the whole body."""
    posture, task = random_case(robot, seed)
    stuck = Task(
        task.com_velocity, task.base, np.zeros(6), task.trunk_rate, task.motions
    )
    own = robot.limbs[index_of(robot, "left_leg")].columns
    for case, moving_base in ((task, True), (stuck, False)):
        v = resolve_by_elimination(robot.limbs, posture, case).velocity
        cdot = posture.com_jacobian @ v
        terms = printed_com_velocity(robot, posture, case, v[own], moving_base)
        assert np.abs(cdot - terms).max() < 1e-9


def test_law_on_the_model_gives_the_zmp_error():
    """Eq. (34): put u of (31) into (30); and (35) is the same equation."""
    rng = np.random.default_rng(0)
    for k_p, k_c in zip(*PAPER_GAINS.walking, strict=True):
        cdot_d, e_c, e_p, eps = rng.normal(size=4)
        cdot = walking_control(cdot_d, e_p, e_c, k_p, k_c) + eps
        edot_c = cdot_d - cdot
        assert zmp_error_from_com(k_p, k_c, e_c, edot_c, eps) == pytest.approx(e_p)
        A, B = error_dynamics(PAPER_PENDULUM, k_p, k_c)
        rate = A[0] @ [e_c, e_p] + B[0] @ [eps, 0.0]
        assert rate == pytest.approx(edot_c, abs=1e-12)


# ---- Errata -----------------------------------------------------------------------


def test_desired_zmp_jumps():
    """Eqs. (4), (9): 7.06 cm in x and 6.70 cm in y whenever a foot lifts or lands."""
    pattern = make_pattern(plan_steps(PAPER_GAIT, 8), PAPER_PENDULUM)
    K_x, K_y = transfer_zmp(PAPER_GAIT, PAPER_PENDULUM.omega)
    expected = (0.1 - K_x, 0.09 - K_y)
    assert expected == pytest.approx((0.0706, 0.0670), abs=5e-5)
    singles = [s for s in pattern.phases if s.phase.name.startswith("SINGLE")]
    span = singles[4]
    for t in (span.start, span.start + span.duration):
        before, after = pattern.at(t - 1e-9), pattern.at(t + 1e-9)
        assert np.abs(after.zmp - before.zmp) == pytest.approx(expected, abs=1e-4)
        jump = after.com_acceleration - before.com_acceleration
        assert np.abs(jump[:2]) == pytest.approx([1.0081, 0.9571], abs=1e-3)
        assert np.abs(after.com - before.com).max() < 1e-8
        assert np.abs(after.com_velocity - before.com_velocity).max() < 1e-7
    assert pattern.at(span.start - 0.05).phase is Phase.DOUBLE


def test_printed_cdot_emc_forgets_the_moving_base(robot):
    """Eq. (26) as printed: the CoM misses r_1' + omega_1 x r_c1, and nothing else."""
    posture, task = random_case(robot, 11)
    X_1, J_1, _ = columns_of(robot, posture, "left_leg")
    embedding = embed(robot.limbs, posture, task)
    x_1 = task.base_twist
    r_c1 = posture.com - posture.ends[index_of(robot, "left_leg")]
    dropped = x_1[:3] + np.cross(x_1[3:], r_c1)
    printed = embedding.cdot_emc + dropped
    A = np.vstack([embedding.J_emc, -J_1[3:]])
    dq_1 = np.linalg.solve(A, np.concatenate([printed, task.trunk_rate - x_1[3:]]))
    v = whole_velocity(robot, embedding, "left_leg", dq_1, X_1 @ (x_1 - J_1 @ dq_1))
    miss = posture.com_jacobian @ v - task.com_velocity
    assert np.abs(miss - dropped).max() < 1e-9
    assert np.abs(dropped).max() > 0.1


def whole_velocity(robot, embedding, base, dq_1, x_o):
    """Return v from the base limb's rates and the body twist."""
    v = np.zeros(6 + len(robot.joints))
    v[:6] = x_o
    for limb in robot.limbs:
        own = dq_1
        if limb.name != base:
            own = embedding.a[limb.name] + embedding.B[limb.name] @ x_o
        v[limb.columns] = own
    return v


def test_printed_frame_of_j_emc_is_wrong(robot):
    """Eq. (27) as printed: r_c1 in world axes inside R_o[...] is 0.05 to 1.7 m off."""
    rng, i = np.random.default_rng(4), index_of(robot, "left_leg")
    errors = []
    for _ in range(50):
        posture = posture_of(robot, random_configuration(robot, rng))
        R_o, r_c1 = posture.rotation, posture.com - posture.ends[i]
        o_J_w = R_o.T @ posture.end_jacobian(i)[3:, robot.limbs[i].columns]
        true = skew(r_c1) @ R_o @ o_J_w
        assert np.abs(R_o @ skew(R_o.T @ r_c1) @ o_J_w - true).max() < 1e-12
        errors.append(np.abs(R_o @ skew(r_c1) @ o_J_w - true).max())
    assert min(errors) > 0.05
    assert 1.0 < max(errors) < 1.7


def test_bare_j_emc_depends_on_the_base_limb(robot):
    """Eq. (25) alone, by pseudo-inverse: the CoM is met, but left and right differ."""
    rng, bare, stacked = np.random.default_rng(4), [], []
    still = CartesianMotion(np.zeros(6))
    for _ in range(50):
        posture = posture_of(robot, random_configuration(robot, rng))
        asked = random_task(robot, rng)
        others = {n: m for n, m in asked.motions.items() if "leg" not in n}
        pair = []
        for base, swing in (("left_leg", "right_leg"), ("right_leg", "left_leg")):
            motions = {**others, swing: still}
            task = Task(
                asked.com_velocity, base, np.zeros(6), asked.trunk_rate, motions
            )
            embedding = embed(robot.limbs, posture, task)
            X_1, J_1, _ = columns_of(robot, posture, base)
            dq_1 = np.linalg.pinv(embedding.J_emc) @ embedding.cdot_emc
            v = whole_velocity(robot, embedding, base, dq_1, -X_1 @ J_1 @ dq_1)
            assert np.abs(posture.com_jacobian @ v - task.com_velocity).max() < 1e-8
            full = resolve_by_elimination(robot.limbs, posture, task).velocity
            pair.append((v, full))
        (v_l, full_l), (v_r, full_r) = pair
        bare.append(np.abs(v_l - v_r)[6:].max())
        stacked.append(np.abs(full_l - full_r).max())
    assert np.median(bare) > 1.0
    assert 4.0 < max(bare) < 8.0
    assert max(stacked) < 1e-9


class Still:
    """A reference at rest in the world's origin."""

    com, com_velocity, zmp = np.zeros(2), np.zeros(2), np.zeros(2)
    heading, walking = 0.0, 1.0


@pytest.mark.parametrize(
    ("com_bias", "zmp_bias", "factors"),
    [(0.005, 0.0, (1.8333, 1.9)), (0.0, 0.005, (-0.8333, -0.9))],
)
def test_sensor_biases_are_amplified(com_bias, zmp_bias, factors):
    """Eq. (31): e_c = (k_c b_c - k_p b_p) / (k_c - k_p), on the pendulum at rest."""
    plant = PendulumPlant(PAPER_PENDULUM)
    controller = WalkingController(PAPER_GAINS, ControlSettings(), plant.period)
    sensors = plant.start(Command(np.zeros(2), np.zeros(2)))
    for _ in range(4000):
        f_z, m_x, m_y = sensors.wrenches[0, 2:5]
        zmp = np.array([-m_y, m_x]) / f_z
        out = controller.step(Still, sensors.positions + com_bias, zmp + zmp_bias)
        plant.write(Command(out.com_command, out.u))
        sensors = plant.read()
    e_c = Still.com - sensors.positions
    (k_p, k_c) = np.array(PAPER_GAINS.walking)
    exact = (k_c * com_bias - k_p * zmp_bias) / (k_c - k_p)
    assert e_c == pytest.approx(exact, abs=1e-6)
    assert e_c == pytest.approx(0.005 * np.array(factors), abs=1e-6)
    assert zmp_of_motion(PAPER_PENDULUM, e_c, np.zeros(2)) == pytest.approx(e_c)
