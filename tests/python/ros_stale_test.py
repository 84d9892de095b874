"""The ROS 2 bridge: poses that are not of now, and a bridge or watchdog that is not, are no force."""

import functools
import json

import numpy as np
import pytest
from conftest import SOURCE
from ros_node import StillWatchdog, act_on_an_arm, bridge, pose, said, state_of, ticks, touched, word
from teletact_ros.felt import DISABLED, ENABLED, FAULT, PAUSED
from teletact_ros.freshness import FreshnessWatch, Stamps
from teletact_ros.measured import Measured


def test_what_is_no_pose_is_none(liar, clock):
    def act(node, arm):
        for none in (lambda: pose(0.02, 0, -0.001, stamp=0), lambda: pose(0, 0, 0, stamp=clock.monotonic()),
                     lambda: pose(0.02, 0, -0.001, quaternion=(0, 0, 0, 0))):
            for _ in range(30):
                node.tell("MTM/measured_cp", none())
                node.tick()
            node.tell("teletact/state_command", word("enable"))
            assert state_of(node) == DISABLED and "enable: no measured_cp" in said(node)[-1]
        # one that is true, and then the same again
        touched(node, arm)
        same = pose(0.02, 0, 0.001)
        for _ in range(40):
            clock.ahead_s += 0.1
            node.tell("MTM/measured_cp", same)
            node.tick()
        assert state_of(node) == PAUSED and not arm.force.any()
        node.tell("teletact/state_command", word("resume"))
        assert said(node)[-1] == "resume: no measured_cp for 3.0 s: its stamp is repeated"

    act_on_an_arm(liar, act)


def test_a_frozen_position_is_a_fault(liar, clock):
    def act(node, arm):
        touched(node, arm)
        at = clock.monotonic()
        for k in range(25):  # new stamps, a position to the bit the same
            clock.monotonic = functools.partial(float, at + 0.01 * k)
            message = pose(0.02, 0, 0.001, stamp=clock.monotonic())
            node.tell("MTM/measured_cp", message)
            node.tick()
            if k < 9:
                assert state_of(node) == ENABLED and arm.force.any()
            if k > 12:
                assert state_of(node) == FAULT and not arm.force.any()
        assert any("FAULT: measured_cp is frozen: its position stands still to the last bit" in text for text in said(node))

    act_on_an_arm(liar, act)


def test_a_velocity_that_contradicts_is_a_fault():
    measured = Measured(0.15, has_noise=False)
    at, turn = np.array([0.1, 0.0, 0.1]), np.array([0, 0, 0, 1.0])
    for k in range(200):
        now = 1 + 0.005 * k
        measured.velocity(now, np.array([0, 0, -0.05]))
        verdict = measured.take(now, now, "base", at, turn, False)
        if verdict.fault:
            break
    assert "while its velocity says that it moves" in verdict.why and 0.1 <= now - 1 <= 0.11
    measured.velocity(now, np.zeros(3))
    assert measured.take(now + 1, now + 1, "base", np.full(3, np.nan), turn, False).fault


def test_stamps():
    stamps = Stamps(0.15)
    assert stamps.stale(100.0, 0.0) and not stamps.stale(100.0, 7.0), "two clocks need not be one"
    assert "repeated" in stamps.stale(100.01, 7.0) and "older" in stamps.stale(100.02, 6.99)
    assert not stamps.stale(100.1, 7.02), "80 ms later than the quickest"
    assert "170 ms old" in stamps.stale(100.2, 7.03)
    assert not stamps.stale(100.25, 7.24)
    for k in range(300):  # one message, again and again
        assert "repeated" in stamps.stale(100.3 + 0.01 * k, 7.24)
    assert not stamps.stale(104.0, 1.0), "the arm's clock was set back, and the hand has felt nothing since"


@pytest.mark.parametrize("case", json.loads((SOURCE / "tests/haptic/freshness_cases.json").read_text()), ids=str)
def test_a_watch_judges_as_that_of_the_devices(case):
    """Each is pressed, and stands then for 5 s at most."""
    watch, step_m, under_force = FreshnessWatch(case.get("noise", True)), case.get("step_m"), case.get("force", True)
    velocity = np.array([0, 0, case["velocity_m_s"]]) if "velocity_m_s" in case else None
    for k in range(1000):
        way_m = 8e-6 * k
        at = np.array([0.1, round(way_m / step_m) * step_m if step_m else way_m, 0.1])
        assert watch.judge(1e-3 * k, at, None, np.array([0, 0, 0, 1.0]), True) == ""
    why, k = "", 0
    while not why and k < 5000:
        k += 1
        angle = 1e-3 * k * case.get("turns_rad_s", 0)
        orientation = np.array([0, 0, np.sin(angle / 2), np.cos(angle / 2)])
        why = watch.judge(1 + 1e-3 * (k - 1), at, velocity, orientation, under_force)
    assert bool(why) == bool(case["against"]) and case["against"] in why
    assert k == pytest.approx(100 if why else 5000, abs=1)


def test_a_program_that_stalled_asks_the_operator(liar, clock, monkeypatch):
    def act(node, arm):
        touched(node, arm)
        monkeypatch.setattr(bridge, "HUNG_S", 0.5)
        clock.ahead_s += 1  # the watchdog has sent zero meanwhile
        node.tick()
        assert not arm.force.any() and "PAUSED: this program stalled for" in said(node)[-1]

    act_on_an_arm(liar, act)


def test_without_its_watchdog_there_is_no_force(liar, clock):
    def act(node, arm):
        touched(node, arm)
        assert StillWatchdog.newest.beats[-1] == 0
        StillWatchdog.newest.says = "the watchdog has ended"
        clock.ahead_s += 0.2
        ticks(node, arm, 0.001, 3)
        assert state_of(node) == PAUSED and not arm.force.any() and StillWatchdog.newest.beats[-1] is None
        ticks(node, arm, -0.001)
        node.tell("teletact/state_command", word("resume"))
        assert "resume: the watchdog has ended" in said(node)[-1]

    act_on_an_arm(liar, act)
