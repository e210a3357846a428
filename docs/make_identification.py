"""Write the tables of docs/identification.md: `python docs/make_identification.py`.

Each robot is identified with a dead time and a servo lag that were built in, and with
noise; the delay that its measured loop bears is compared with what physics shows.
"""

from __future__ import annotations

import math
import os
import sys
from dataclasses import dataclass, replace
from pathlib import Path

from comwalk.certificates import sampled_loop_of

os.environ.setdefault("OMP_NUM_THREADS", "1")

import mujoco
import numpy as np

from comwalk.certificates import (
    SampledLoop,
    default_control_settings,
    default_pendulum,
    margins,
    observe,
    similar_gains,
    walk_pattern,
)
from comwalk.certificates.identification import (
    Identified,
    equivalent_loop,
    identify,
    measured_margin,
)
from comwalk.config import IdentifyConfig
from comwalk.control import (
    Actuation,
    Control,
    ControlOutput,
    Gains,
    Push,
    SimulatorSettings,
)
from comwalk.robot import Robot, load_robot
from comwalk.run import simulate
from comwalk.setup import IdentifySetup, build_identify
from comwalk.views import plot_identified

ROBOTS = ("paper", "talos", "g1")
LATE = 0.010
"""Dead time that is built in [s]."""
DAMPED = 2.0
"""Factor on the dampers of all motors, of which the controller knows nothing."""
PUSH_SHARE = 0.02
"""Push on the trunk for 0.1 s, in units of the robot's weight."""
PUSH_OBSERVED = 0.08
"""Push sideways in the table of bounds, at `PUSH_TIME`."""
PUSH_TIME = 4.0
"""When it begins [s]."""
GROWN = 0.01
"""Size of u, rms over a second, that tells a swing which grows [m/s]."""


@dataclass(frozen=True)
class Built:
    """What was built into a simulated robot."""

    latency: float = 0.0
    damped: float = 1.0
    noise: float = 0.0

    def setup(self, robot: str) -> IdentifySetup:
        """Return the robot that has it."""
        physics = SimulatorSettings(latency=self.latency, noise=self.noise)
        setup = build_identify(
            IdentifyConfig(robot=robot, actuation=Actuation.POSITION, simulator=physics)
        )
        plant, servo = setup.plant, setup.robot.servo
        plant.model.actuator_biasprm[servo.actuators, 2] *= self.damped
        return setup


def found_in(robot: str, built: Built) -> Identified:
    """Identify a robot with something built in."""
    setup = built.setup(robot)
    return identify(setup.plant, setup.body, setup.standing)


# ---- The lag, by linearised physics --------------------------------------------------


def linear_lags(robot: str, built: Built) -> list[float]:
    """Return the lags of the CoM in x and y by linearised physics, no experiment [s].

    MuJoCo's own derivatives of one physics step, at rest, driven by the set-points that
    the body makes for a slow ramp of the CoM; the phase is taken at 0.1 Hz.
    """
    setup = built.setup(robot)
    plant, period = setup.plant, setup.plant.period
    reference = setup.standing(1.0).at(0.0)
    plant.start(setup.body.start(reference))
    m, d = plant.model, plant.data
    mujoco.mj_step(m, d, 2000)
    nv, dt = m.nv, m.opt.timestep
    A, B = np.zeros((2 * nv, 2 * nv)), np.zeros((2 * nv, m.nu))
    mujoco.mjd_transitionFD(m, d, 1e-6, True, A, B, None, None)
    J = np.zeros((3, nv))
    mujoco.mj_jacSubtreeCom(m, d, J, plant.robot.base_body)
    z = np.exp(2j * math.pi * 0.1 * dt)
    s = 2j * math.pi * 0.1
    lags = []
    for axis in range(2):
        still, moving = set_points(setup, axis)
        u = np.zeros(m.nu, complex)
        u[plant.robot.servo.actuators] = still + s * moving
        x = np.linalg.solve(z * np.eye(2 * nv) - A, B @ u)
        phase = np.angle(J[axis] @ x[:nv])
        # the set-point of the period's end is held from its start: half a period early
        lags.append(-phase / (2.0 * math.pi * 0.1) - 0.5 * period)
    return lags


def set_points(setup: IdentifySetup, axis: int) -> tuple[np.ndarray, np.ndarray]:
    """Return how the set-points depend on the commanded CoM, and on its rate."""
    body, speed, ticks = setup.body, 0.01, 100
    reference = setup.standing(1.0).at(0.0)
    first = body.start(reference).positions
    u, com = np.zeros(2), reference.com[:2].copy()
    u[axis] = speed
    output = ControlOutput.still(reference)
    for _ in range(ticks):
        moving = body.act(replace(output, u=u, com_command=com.copy()), reference)
        com += u * body.period
    for _ in range(400):
        still = body.act(replace(output, com_command=com), reference)
    way = speed * ticks * body.period
    slope = (still.positions - first) / way
    return slope, (moving.positions - first - slope * way) / speed


# ---- The delay that it bears, in physics --------------------------------------------


def control_of(robot: Robot) -> Control:
    """Return the paper's gains for a robot's natural frequency, with their filter."""
    gains = similar_gains(default_pendulum(robot))
    return Control(gains=gains, settings=default_control_settings(robot, gains))


def one_axis(gains: Gains, axis: int) -> Gains:
    """Return the walking gains in one axis, for standing, and none in the other."""
    k_p, k_c = ([0.0, 0.0], [0.0, 0.0])
    k_p[axis], k_c[axis] = gains.zmp[axis], gains.com[axis]
    pairs = (tuple(k_p), tuple(k_c))
    return Gains(
        zmp=pairs[0], com=pairs[1], standing_zmp=pairs[0], standing_com=pairs[1]
    )


def grows(robot: str, axis: int, ticks: int) -> tuple[bool, float]:
    """Push a standing robot; tell whether its swing grows, and how fast it is [Hz].

    A swing that decays is below a tenth of the threshold a second after the push.
    """
    setup = build_identify(IdentifyConfig(robot=robot, actuation=Actuation.POSITION))
    control = control_of(setup.robot)
    force = np.zeros(3)
    force[axis] = PUSH_SHARE * setup.robot.mass * setup.robot.gravity
    run = simulate(
        setup.robot,
        setup.standing(7.0),
        control=replace(control, gains=one_axis(control.gains, axis)),
        physics=SimulatorSettings(
            latency=ticks * control.period,
            pushes=(Push(start=1.0, force=tuple(force.tolist())),),
        ),
    )
    if not run.outcome.ok:
        return True, math.nan
    u, period = run.log["u"][:, axis], control.period
    for second in range(2, 7):
        part = u[round(second / period) : round((second + 1) / period)]
        if float(np.sqrt(np.mean(part**2))) > GROWN:
            spectrum = np.abs(np.fft.rfft((part - part.mean()) * np.hanning(len(part))))
            return True, float(np.argmax(spectrum)) / (len(part) * period)
    return False, math.nan


def found_delay(robot: str, axis: int, guess: float) -> tuple[float, float]:
    """Return the least delay that makes a standing robot swing for ever, and how."""
    low, high = 0, 2 * max(round(guess / 0.002), 4)
    frequency = math.nan
    while high - low > 1:
        middle = (low + high) // 2
        bad, f = grows(robot, axis, middle)
        if bad:
            high, frequency = middle, f
        else:
            low = middle
    return 0.002 * high, frequency


def walks(robot: str, ticks: int) -> bool:
    """Walk six steps with late sensors, of which the controller knows."""
    setup = build_identify(IdentifyConfig(robot=robot, actuation=Actuation.POSITION))
    control = control_of(setup.robot)
    settings = replace(control.settings, delay=ticks)
    known = replace(control, settings=settings)
    physics = SimulatorSettings(latency=ticks * control.period)
    pattern = walk_pattern(setup.robot, 6)
    run = simulate(setup.robot, pattern, control=unchecked(known), physics=physics)
    error = run.log["zmp_ref_filtered"] - run.log["zmp_filtered"]
    return run.outcome.ok and float(np.sqrt(np.mean(error[:, 1] ** 2))) < 0.03


def unchecked(control: Control) -> Control:
    """Return the same controller without a check of its loop: that is what we try."""
    object.__setattr__(control, "check", lambda *words: None)
    return control


def walking_delay(robot: str, guess: float) -> float:
    """Return the least delay with which six steps fail [s]."""
    low, high = 0, 3 * max(round(guess / 0.002), 4)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if walks(robot, middle) else (low, middle)
    return 0.002 * high


# ---- Tables ----------------------------------------------------------------------


def ms(x: float, digits: int = 1) -> str:
    """Return a time."""
    return f"{1e3 * x:.{digits}f}"


def lag_rows(robot: str, plain: Identified) -> list[str]:
    """Return the rows of one robot in the table of lags and dead times."""
    rows = []
    for built in (
        Built(),
        Built(latency=LATE),
        Built(damped=DAMPED),
        Built(latency=LATE, noise=0.3),
    ):
        found = plain if built == Built() else found_in(robot, built)
        exact = linear_lags(robot, built)
        dead = found.dead_time
        cells = [
            robot,
            ms(built.latency),
            f"{ms(dead.value)} +- {ms(dead.deviation)}",
            f"{built.damped:g}",
            f"{built.noise:g}",
            *(
                f"{ms(lag)}, {ms(fit.lag.value)} +- {ms(fit.lag.deviation)}"
                for lag, fit in zip(exact, found.axes, strict=True)
            ),
        ]
        rows.append("| " + " | ".join(cells) + " |")
        print(rows[-1], flush=True)
    return rows


def mode_row(robot: str, found: Identified) -> str:
    """Return the row of one robot in the table of modes."""
    cells = [robot]
    for fit in found.axes:
        f, damping = fit.frequency, fit.damping
        cells.append(
            "none"
            if f is None or damping is None
            else f"{f.value:.2f} +- {f.deviation:.2f} Hz, "
            f"{damping.value:.3f} +- {damping.deviation:.3f}"
        )
    cells += [f"{100 * fit.gain.value:.1f} %" for fit in found.axes]
    cells += [f"{fit.omega.value:.2f}" for fit in found.axes]
    return "| " + " | ".join(cells) + " |"


def delay_rows(robot: str, found: Identified) -> list[str]:
    """Return the rows of one robot in the table of delays."""
    setup = build_identify(IdentifyConfig(robot=robot, actuation=Actuation.POSITION))
    control, rows = control_of(setup.robot), []
    cutoff = control.settings.zmp_cutoff
    guesses = []
    for k, fit in enumerate(found.axes):
        pair = control.gains.zmp[k], control.gains.com[k]
        predicted = measured_margin(fit, *pair, cutoff)
        guesses.append(predicted.delay)
        near = equivalent_loop(fit, setup.pendulum, cutoff)
        rigid = SampledLoop(period=control.period, zmp_cutoff=cutoff, delay=0)
        models = [margins(setup.pendulum, *pair, x).delay for x in (rigid, near)]
        seen, frequency = found_delay(robot, k, predicted.delay)
        cells = [
            f"{robot} {'xy'[k]}",
            f"{pair[0]:g} / {pair[1]:g}",
            *(ms(x) for x in models),
            f"**{ms(predicted.delay)}**, {predicted.frequency:.1f} Hz",
            f"**{ms(seen, 0)}**, {frequency:.1f} Hz",
            "",
        ]
        rows.append(cells)
    walking = ms(walking_delay(robot, min(guesses)), 0)
    for cells in rows:
        cells[-1] = walking
    lines = ["| " + " | ".join(cells) + " |" for cells in rows]
    print(*lines, sep="\n", flush=True)
    return lines


def observed_rows(robot: str) -> list[str]:
    """Return the rows of one robot in the table of bounds and errors."""
    loaded, rows = load_robot(robot, actuation=Actuation.POSITION), []
    pattern, control = walk_pattern(loaded, 6), control_of(loaded)
    for push in (0.0, PUSH_OBSERVED):
        force = (0.0, push * loaded.mass * loaded.gravity, 0.0)
        pushes = (Push(start=PUSH_TIME, force=force),) if push else ()
        run = simulate(loaded, pattern, physics=SimulatorSettings(pushes=pushes))
        axes = observe(
            run.log.columns, pattern.pendulum, control.gains, sampled_loop_of(control)
        )
        for x in axes:
            pairs = []
            for c in (x.ideal, x.loop):
                if c is None or not c.holds:
                    raise SystemExit(f"{robot} {x.axis}: a bound does not hold: {c}")
                pairs += [(c.com, c.com_bound), (c.zmp, c.zmp_bound)]
            cells = [
                f"{robot} {x.axis}{', pushed' if push else ''}",
                f"{x.a:.3f}, {x.b:.2f}",
                *(f"{1e3 * e:.1f} <= {1e3 * m:.1f} ({e / m:.2f})" for e, m in pairs),
                f"{1e3 * x.sensed_zmp:.1f}",
            ]
            rows.append("| " + " | ".join(cells) + " |")
        print(*rows[-2:], sep="\n", flush=True)
    return rows


HEADS = {
    "lags": "| robot | dead time set [ms] | found [ms] | dampers times | noise times | "
    "lag x: linearised, found [ms] | lag y: linearised, found [ms] |",
    "modes": "| robot | mode x | mode y | CoM goes x | y | omega_n x [rad/s] | y |",
    "delays": "| axis | k_p / k_c [1/s] | rigid, servo 20 ms [ms] | loop.toml [ms] | "
    "measured response | found standing [ms] | found walking [ms] |",
    "observed": "| axis | eps = c' - u [m/s], rate [m/s^2] | ideal: e_c [mm] | e_p | "
    "as it runs: e_c [mm] | e_p | e_p sensed [mm] |",
}


def tables_of(wanted: set[str]) -> dict[str, list[str]]:
    """Return the rows of the tables that are wanted."""
    tables: dict[str, list[str]] = {name: [] for name in HEADS if name in wanted}
    for robot in ROBOTS:
        if "observed" in wanted:
            tables["observed"] += observed_rows(robot)
        if wanted <= {"observed"}:
            continue
        found = found_in(robot, Built())
        if robot == "paper":
            noisy = found_in(robot, Built(noise=0.3))
            picture = Path(__file__).parent / "images" / "identify.png"
            plot_identified(noisy, "paper, a third of the usual noise", picture)
        if "modes" in wanted:
            tables["modes"].append(mode_row(robot, found))
        if "lags" in wanted:
            tables["lags"] += lag_rows(robot, found)
        if "delays" in wanted:
            tables["delays"] += delay_rows(robot, found)
    return tables


def main() -> None:
    """Replace what stands between the markers in the document, or some of it."""
    document = Path(__file__).parent / "identification.md"
    tables = tables_of(set(sys.argv[1:]) or set(HEADS))
    text = document.read_text(encoding="utf-8")
    for name, rows in tables.items():
        head = HEADS[name]
        line = "|" + "---|" * (head.count("|") - 1)
        before, rest = text.split(f"<!-- {name} -->\n")
        after = rest.split(f"<!-- /{name} -->")[1]
        table = "\n".join([head, line, *rows])
        text = f"{before}<!-- {name} -->\n{table}\n<!-- /{name} -->{after}"
    document.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
