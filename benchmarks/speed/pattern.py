"""The closed-form pattern beside two other ways to CoM trajectories, and its planning.

A preview controller (Kajita et al. 2003: a cart on a table, jerk input, 1.6 s ahead)
and model predictive control (Wieber 2006: the same, 16 intervals of 0.1 s, the ZMP in a
box) follow the ZMP of the same footsteps; how far their CoM is from ours says that they
do the same.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from typing import Any

import numpy as np
from measure import interleaved
from scipy.linalg import solve_discrete_are

import comwalk as cw
from comwalk.compiled import kernel
from comwalk.pattern import (
    PHASE,
    REFERENCE,
    WORK,
    OnlinePattern,
    fill_plan,
    fill_references,
    step_records,
)

STEPS = (1, 4, 20, 100, 1000, 10000)
WALK = 20
"""Steps of the walk that the others follow."""
_DT, _AHEAD = 0.005, 320  # preview: sample time [s], samples ahead
_INTERVAL, _HORIZON = 0.1, 16  # MPC: held jerks [s], how many
_BOX = np.array([0.05, 0.03])  # the ZMP's freedom in x and y [m]
_EFFORT = 1e-6  # weight of the jerk against the ZMP's error

Follow = Callable[[np.ndarray], np.ndarray]
"""Turn the ZMP at samples, (n, 2) [m], into the CoM at them, (n, 2) [m]."""


def planning(rounds: int) -> list[dict[str, Any]]:
    """Return the time to plan n steps from scratch, and to plan anew while walking."""
    gait, pendulum = cw.Gait(), cw.Pendulum()
    calls: dict[str, Callable[[int], Any]] = {}
    for n in STEPS:
        plan = cw.plan_steps(gait, n)
        calls[f"compiled {n}"] = _compiled_plan(plan, pendulum.omega)
        calls[f"objects {n}"] = lambda k, plan=plan: cw.make_pattern(plan, pendulum)
    found = interleaved(calls, "compiled 1", rounds=rounds)
    rows = []
    for n in STEPS:
        row = {key: found[f"{key} {n}"]["median"] for key in ("compiled", "objects")}
        rows.append({"steps": n, **row})
    return rows


def replanning(rounds: int) -> dict[str, float]:
    """Return the time of a new plan for four steps ahead, in the middle of a walk."""
    online = OnlinePattern()
    gaits = [cw.Gait(half_step=step) for step in (0.08, 0.1)]
    online.walk_on(gaits[0])
    for time in np.arange(0.0, 5.3, 0.01):
        online.fill(float(time))
    calls = {
        "a command, and the plan to the next stop": lambda k: online.walk_on(gaits[k]),
        "one tick's reference": lambda k: online.fill(online.time),
    }
    found = interleaved(calls, "one tick's reference", rounds=rounds, states=2)
    return {name: row["median"] for name, row in found.items()}


def _compiled_plan(plan: cw.FootstepPlan, omega: float) -> Callable[[int], Any]:
    """Return what fills the table of a plan that lies in arrays."""
    steps = step_records(plan)
    table = np.zeros(2 * len(steps) + 5, PHASE)
    work = np.zeros(len(table), WORK)
    feet = np.array([(foot.x, foot.y, foot.yaw) for foot in (plan.left, plan.right)])
    times = np.array([plan.stand_time, plan.start_time, plan.stop_time])

    def fill(k: int) -> np.ndarray:
        fill_plan(table, steps, feet, times, omega, False, work)
        return table

    return fill


def others(rounds: int) -> list[dict[str, Any]]:
    """Return times of a walk's CoM by each way, and how far it is from ours."""
    pendulum = cw.Pendulum()
    plan = cw.plan_steps(cw.Gait(), WALK)
    pattern = cw.make_pattern(plan, pendulum)
    times = np.arange(0.0, pattern.duration, _DT)
    found = pattern.sample(times)
    zmp, com = found.zmp, found.com[:, :2]
    ways: dict[str, Follow] = {
        "preview control, compiled": preview(pendulum.omega, kernel(_previewed)),
        "preview control, numpy": preview(pendulum.omega, _previewed),
    }
    if importlib.util.find_spec("quadprog"):
        ways["QP-MPC, quadprog, a QP each 0.1 s"] = predictive(pendulum.omega)
    ours, rows = "closed form, compiled", np.zeros(len(times), REFERENCE)
    fill = _compiled_plan(plan, pendulum.omega)

    def closed_form(k: int) -> np.ndarray:
        table = fill(k)
        fill_references(table, pendulum.omega, pendulum.height, times, rows)
        return rows["com"][:, :2]

    calls: dict[str, Callable[[int], Any]] = {ours: closed_form}
    calls["closed form, as objects"] = lambda k: cw.make_pattern(plan, pendulum).sample(
        times
    )
    calls |= {name: lambda k, way=way: way(zmp) for name, way in ways.items()}
    away = {name: float(np.abs(way(zmp) - com).max()) for name, way in ways.items()}
    away[ours] = float(np.abs(closed_form(0) - com).max())
    spread = interleaved(calls, ours, rounds=rounds)
    return [{"name": name, "away": away.get(name), **spread[name]} for name in calls]


def _cart(omega: float, dt: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return A, B of (c, c', c'') under a held jerk, and the row that gives the ZMP."""
    A = np.array([[1.0, dt, dt * dt / 2.0], [0.0, 1.0, dt], [0.0, 0.0, 1.0]])
    B = np.array([dt**3 / 6.0, dt * dt / 2.0, dt])
    return A, B, np.array([1.0, 0.0, -1.0 / omega**2])


def preview(omega: float, loop: Callable) -> Follow:
    """Return preview control with an integrator, its gains by the Riccati equation."""
    A, B, C = _cart(omega, _DT)
    big = np.block([[np.ones((1, 1)), (C @ A)[None]], [np.zeros((3, 1)), A]])
    b = np.concatenate([[C @ B], B])[:, None]
    Q = np.zeros((4, 4))
    Q[0, 0] = 1.0
    P = solve_discrete_are(big, b, Q, np.array([[_EFFORT]]))
    scale = _EFFORT + float((b.T @ P @ b).item())
    K = ((b.T @ P @ big) / scale)[0]
    closed, gains = big - b @ K[None], np.zeros(_AHEAD)
    X = closed.T @ P[:, :1]
    gains[0] = K[0]
    for k in range(1, _AHEAD):
        gains[k] = float((b.T @ X).item()) / scale
        X = closed.T @ X

    def follow(zmp: np.ndarray) -> np.ndarray:
        ahead = np.concatenate([zmp, np.repeat(zmp[-1:], _AHEAD, axis=0)])
        com = np.empty_like(zmp)
        loop(A, B, C, K, gains, ahead[:, 0].copy(), com[:, 0])
        loop(A, B, C, K, gains, ahead[:, 1].copy(), com[:, 1])
        return com

    return follow


def _previewed(
    A: np.ndarray,
    B: np.ndarray,
    C: np.ndarray,
    K: np.ndarray,
    gains: np.ndarray,
    zmp: np.ndarray,
    com: np.ndarray,
) -> None:
    """Write the CoM of one axis that follows a ZMP, which goes on beyond its end."""
    x, total = np.zeros(3), 0.0
    x[0] = zmp[0]
    for k in range(len(com)):
        com[k] = x[0]
        total += C @ x - zmp[k]
        u = gains @ zmp[k + 1 : k + 1 + len(gains)]
        u -= K[0] * total + K[1:] @ x
        x = A @ x + B * u


def predictive(omega: float) -> Follow:
    """Return model predictive control with the ZMP in a box."""
    from quadprog import solve_qp

    A, B, C = _cart(omega, _INTERVAL)
    free, forced, power = np.zeros((_HORIZON, 3)), np.zeros((_HORIZON,) * 2), A
    for i in range(_HORIZON):
        free[i] = C @ power
        for j in range(i + 1):
            forced[i, j] = C @ np.linalg.matrix_power(A, i - j) @ B
        power = A @ power
    H = forced.T @ forced + _EFFORT * np.eye(_HORIZON)
    sides = np.hstack([forced.T, -forced.T])
    every = round(_INTERVAL / _DT)
    a, b, _ = _cart(omega, _DT)

    def follow(zmp: np.ndarray) -> np.ndarray:
        more = np.repeat(zmp[-1:], every * (_HORIZON + 1), axis=0)
        ahead, x = np.concatenate([zmp, more]), np.zeros((3, 2))
        com, u = np.empty_like(zmp), np.zeros(2)
        x[0] = zmp[0]
        for k in range(len(zmp)):
            if k % every == 0:
                wanted = ahead[k + every : k + every * (_HORIZON + 1) : every]
                for axis in range(2):
                    miss = wanted[:, axis] - free @ x[:, axis]
                    bounds = np.concatenate([miss, -miss]) - _BOX[axis]
                    u[axis] = solve_qp(H, forced.T @ miss, sides, bounds)[0][0]
            com[k] = x[0]
            x = a @ x + b[:, None] * u
        return com

    return follow
