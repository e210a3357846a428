"""A live walk: it obeys between two ticks, and waits for nobody."""

from __future__ import annotations

import math
import time
from threading import Thread

import numpy as np
import pytest

from comwalk.cli.live import LiveWalk, Pacer
from comwalk.cli.live_page import _as_it_is
from comwalk.config import Given, WalkConfig
from comwalk.control.gains import Gains
from comwalk.control.guard import End
from comwalk.errors import ParameterError, PlanError
from comwalk.pattern.footsteps import Gait
from comwalk.replay import replay
from comwalk.setup import build_walk

SHORT = {"stand_time": 0.1, "start_time": 0.4, "stop_time": 0.4}


def short_walk(steps=1, **more):
    """Return the setup of a short walk."""
    return build_walk(WalkConfig(gait=Given(Gait, SHORT), steps=steps, **more))


def wait_for(condition, seconds=60.0):
    """Wait until something holds."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.005)


@pytest.fixture
def driven():
    """Return what runs a live walk as fast as it can while a script drives it."""

    def run(live, script):
        faults = []

        def drive():
            try:
                script()
            except BaseException as error:
                faults.append(error)
            finally:
                live.quit()

        live.go_at(1e3)
        driver = Thread(target=drive, daemon=True)
        driver.start()
        result = live.run()
        driver.join()
        if faults:
            raise faults[0]
        return result

    return run


def test_new_gains_keep_the_integral(driven):
    """The controller gets them within a walk; its CoM command does not jump."""
    live = LiveWalk(short_walk())
    gains = Gains(zmp=(1.0, 1.2), com=(4.0, 3.1))

    def script():
        wait_for(lambda: live.latest and live.latest.moment.time > 0.8)
        live.set_gains(gains)
        wait_for(lambda: live.latest.gains == gains)
        assert live.latest.outcome is None
        wait_for(lambda: live.latest.outcome)

    run = driven(live, script)
    assert run.outcome.end is End.COMPLETED
    offset = run.log["com_command"] - run.log["com_ref"][:, :2]
    assert np.abs(offset).max() > 1e-4
    fastest = 0.5 * live.setup.control.period  # max_correction over a tick
    assert np.abs(np.diff(offset, axis=0)).max() <= fastest + 1e-12


def test_unstable_gains_are_refused_and_nothing_changes(driven):
    """With the reason; the controller goes on with what it had."""
    live = LiveWalk(short_walk())
    before = live.setup.control.gains

    def script():
        wait_for(lambda: live.latest)
        with pytest.raises(ParameterError, match="must be below"):
            live.set_gains(Gains(zmp=(5.0, 1.0), com=(4.0, 4.0)))
        assert live.setup.control.gains == before
        wait_for(lambda: live.latest.outcome)
        assert live.latest.gains == before

    driven(live, script)


def test_a_push_pushes_and_the_run_is_replayed(driven, tmp_path):
    """0.1 s of the impulse, to the left of the heading; MuJoCo repeats all of it."""
    live = LiveWalk(short_walk())

    def script():
        wait_for(lambda: live.latest and live.latest.moment.time > 0.8)
        live.push(0.5 * math.pi, 5.0)
        wait_for(lambda: live.latest.outcome)

    run = driven(live, script)
    force = run.log["xfrc_applied"][:, :, :3].sum(axis=1)
    impulse = force.sum(axis=0) * live.setup.control.period
    np.testing.assert_allclose(impulse, [0.0, 5.0, 0.0], atol=1e-9)
    assert (np.abs(force[:, 1]) > 0).sum() * live.setup.control.period == (
        pytest.approx(0.1)
    )
    moved = run.log["com_true"][:, 1] - run.log["com_ref"][:, 1]
    assert np.ptp(moved) > 2e-3
    run.save(tmp_path)
    assert replay(tmp_path).position_difference < 1e-9


def test_pause_holds_still_and_a_step_goes_on(driven):
    """20 ms a step; nothing in between."""
    live = LiveWalk(short_walk())

    def script():
        wait_for(lambda: live.latest and live.latest.moment.time > 0.3)
        live.pause(True)
        wait_for(lambda: live.paused)
        live.advance(0.002)  # show the very last tick
        time.sleep(0.1)
        held = live.latest.moment.time
        time.sleep(0.1)
        assert live.latest.moment.time == held
        live.advance(0.02)
        wait_for(lambda: live.latest.moment.time > held + 0.015)
        time.sleep(0.1)
        assert live.latest.moment.time == pytest.approx(held + 0.02, abs=1e-9)
        live.pause(False)
        wait_for(lambda: live.latest.outcome)

    driven(live, script)


def test_restart_walks_another_gait(driven):
    """From the start, with more steps; what cannot be walked is refused before."""
    live = LiveWalk(short_walk())

    def script():
        wait_for(lambda: live.latest and live.latest.moment.time > 0.3)
        live.restart(short_walk(steps=40))
        wait_for(lambda: live.latest.walk == 2 and live.latest.moment.time > 0.2)
        gait = Given(Gait, {"half_step": 0.2, "period": 0.5})
        fast = build_walk(WalkConfig(gait=gait, steps=3))
        with pytest.raises(PlanError):
            live.restart(fast)
        live.restart(short_walk(steps=2))
        wait_for(lambda: live.latest.walk == 3 and live.latest.outcome)

    run = driven(live, script)
    assert run.pattern.plan.count == 2
    assert run.outcome.step == 3


def test_a_fallen_robot_lies_until_it_walks_again(driven):
    """Physics goes on after a fall, and a restart stands the robot up."""
    live = LiveWalk(short_walk(steps=4))

    def script():
        wait_for(lambda: live.latest and live.latest.moment.time > 1.0)
        live.push(0.5 * math.pi, 90.0)
        wait_for(lambda: live.latest.outcome)
        assert live.latest.outcome.end is End.FELL
        wait_for(lambda: live.latest.moment.qpos[2] < 0.45)
        live.restart()
        wait_for(lambda: live.latest.walk == 2 and live.latest.moment.time > 0.1)
        assert live.latest.moment.qpos[2] > 0.55

    driven(live, script)


def test_an_end_before_the_first_tick_is_an_interruption():
    """There is nothing to save."""
    live = LiveWalk(short_walk())

    original = live.setup.pattern.at
    calls = []

    def at(time):
        calls.append(time)
        if len(calls) > 1:
            raise KeyboardInterrupt
        return original(time)

    object.__setattr__(live.setup.pattern, "at", at)
    with pytest.raises(KeyboardInterrupt):
        live.run()


def test_a_live_walk_needs_a_robot():
    """The simplified model has none."""
    with pytest.raises(ParameterError, match="needs a robot"):
        LiveWalk(build_walk(WalkConfig(plant="pendulum")))


def test_deadlines_are_absolute(monkeypatch):
    """A late tick is made up for; what is far too late is given up."""
    now = [0.0]
    monkeypatch.setattr(time, "perf_counter", lambda: now[0])
    monkeypatch.setattr(time, "sleep", lambda s: now.__setitem__(0, now[0] + s))
    pacer = Pacer(0.01)
    for work in (0.002, 0.013, 0.002, 0.002):
        now[0] += work
        pacer.wait()
    assert now[0] == pytest.approx(0.04)
    assert (pacer.ticks, pacer.late) == (4, 0)
    now[0] += 1.0
    pacer.wait()
    assert pacer.late == 1
    pacer.wait()
    assert now[0] == pytest.approx(1.05)


def test_names_in_messages_of_the_page_are_no_markup():
    """The page shows Markdown as it is, scripts included; names come from files."""
    text = _as_it_is("joint <script>*a*</script> {x} `y` [z](u) needs 3 N m")
    assert text == (
        r"joint \<script\>\*a\*\</script\> \{x\} \`y\` \[z\](u) needs 3 N m"
    )
