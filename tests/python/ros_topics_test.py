"""The ROS 2 bridge: what it hears and says on which topic, in which frame, and which options it takes."""

import numpy as np
import pytest
import ros_stubs
from ros_node import (Arm, StillWatchdog, Tissue, act_on_an_arm, hold, program, resumed, run, said, state_of, ticks, touched,
                      word)
from teletact_ros.felt import DISABLED, FAULT, PAUSED

HUNG_MACHINE_S = 5.0  # that a test may be kept waiting


def test_a_touch_through_the_node(liar, clock):
    tissue = Tissue()
    liar.touch = tissue.touch

    def waited():
        clock.ahead_s += 0.05
        return True

    arms = []

    def act(node):
        arm = Arm()
        arms.append(arm)
        touched(node, arm)
        tissue.silent.set()  # the stream is open, and says nothing
        hold(node, arm, 0.001, lambda: waited() and state_of(node) == PAUSED)
        assert not arm.force.any() and any("no answer of the service" in text for text in said(node))
        tissue.silent.clear()
        hold(node, arm, 0.001, lambda: node.publishers["teletact/operating_state"].sent[-1].is_homed)
        assert state_of(node) == PAUSED and not arm.force.any(), "it came back by itself"
        node.tell("teletact/state_command", word("resume"))
        assert state_of(node) == PAUSED and "lift it first" in said(node)[-1]
        resumed(node, arm, "resume")
        hold(node, arm, 0.001, lambda: arm.force.any())

    node = run(liar, act, "--origin-m", "0.03", "0", "0", "--ros-args", "-r", "a:=b")
    assert state_of(node) == DISABLED and not arms[0].force.any(), "the last word is zero"
    assert StillWatchdog.newest.closed and StillWatchdog.newest.beats[-1] is None
    assert not ros_stubs.Ros.up and not ros_stubs.Ros.nodes


def test_a_service_that_lies_or_ends_is_a_fault(liar):
    tissue = Tissue()
    liar.touch = tissue.touch

    def act(node):
        arm = Arm()
        touched(node, arm)
        tissue.lie = {"force_n": [0.0, float("nan"), 0.0]}
        hold(node, arm, 0.001, lambda: state_of(node) == FAULT)
        assert not arm.force.any() and any("the touch has ended: Touch: DATA_LOSS" in text for text in said(node))

    assert state_of(run(liar, act)) == FAULT


def test_off_is_silence_but_for_one_zero(liar):
    def act(node, arm):
        ticks(node, arm, -0.001)
        assert not arm.effort_mode, "DISABLED: a wrench of zero is a command, too"
        for command in ("pause", "disable"):
            touched(node, arm)
            wrenches = arm.wrenches
            node.tell("teletact/state_command", word(command))
            ticks(node, arm, 0.001)
            assert arm.wrenches == wrenches + 1 and not arm.force.any(), command
            arm.effort_mode = False
            node.tell("teletact/state_command", word("disable"))
            ticks(node, arm, -0.001)
            assert not arm.effort_mode
        resumed(node, arm)
        hold(node, arm, 0.001, lambda: arm.force.any())
        act.before_the_end = arm.wrenches
        act.arm = arm

    act_on_an_arm(liar, act)
    assert act.arm.wrenches == act.before_the_end + 1 and not act.arm.force.any()


@pytest.mark.parametrize("topics", [("body/servo_cf", "spatial/servo_cf"), ("spatial/servo_cf",), ("servo_cf",)])
def test_the_force_keeps_its_direction_while_the_tool_turns(liar, topics):
    def act(node, arm):
        arm.leave()
        arm.topics = topics
        arm.connect()
        touched(node, arm)
        assert arm.heard == {topics[0]}, "the arm's own topic, and no other"
        for axis in range(3):
            arm.roll(np.pi / 2, axis)
            ticks(node, arm, 0.001, 3)
            np.testing.assert_allclose(arm.force, [0, 0, -0.2], atol=1e-4, err_msg=str(axis))
            np.testing.assert_allclose(arm.torque, 0, atol=1e-9)
        assert arm.frames == ({"MTM"} if topics[0].startswith("body") else {"MTM_base"})
        absolute = node.publishers["MTM/body/set_cf_orientation_absolute"].sent
        assert [message.data for message in absolute] == [False] * len(absolute)
        assert bool(absolute) == topics[0].startswith("body")

    act_on_an_arm(liar, act)


def test_nobody_who_hears_is_said_and_gets_no_force(liar, clock):
    def act(node, arm):
        arm.leave()
        begin = clock.monotonic()

        def heard():
            clock.ahead_s += 0.02
            return any("no force: nobody hears MTM/body/servo_cf or" in text for text in said(node))

        hold(node, arm, -0.001, heard)
        assert clock.monotonic() - begin < 1 + HUNG_MACHINE_S
        node.tell("teletact/state_command", word("enable"))
        assert "enable: nobody hears" in said(node)[-1] and not node.publishers["MTM/body/servo_cf"].sent
        arm.connect()
        hold(node, arm, -0.001, lambda: "the arm hears MTM/body/servo_cf" in said(node))
        touched(node, arm)
        arm.leave()  # its node ends
        clock.ahead_s += 0.2
        ticks(node, arm, 0.001, 2)
        clock.ahead_s += 0.2
        ticks(node, arm, 0.001, 2)
        assert any(text.startswith("PAUSED: nobody hears MTM/body/servo_cf") for text in said(node))
        arm.connect()  # and comes back
        wrenches = arm.wrenches
        clock.ahead_s += 0.2
        ticks(node, arm, -0.001)
        assert state_of(node) == PAUSED and arm.wrenches == wrenches, "force came back by itself"
        resumed(node, arm)

    act_on_an_arm(liar, act)


def test_a_frame_that_changes_under_force_is_a_fault(liar):
    def act(node, arm):
        touched(node, arm)
        arm.frame = "Cart"
        hold(node, arm, 0.001, lambda: state_of(node) == FAULT)
        assert not arm.force.any() and "from 'MTM_base' to 'Cart'" in said(node)[-1]

    act_on_an_arm(liar, act)


@pytest.mark.parametrize("options, why", [(["--axes", "x,y,-z"], "mirror"), (["--rate-hz", "5000"], "--rate-hz"),
                                          (["--max-force-n", "nan"], "force_n"), (["--scenery", "1"], "unrecognized")])
def test_options_that_are_refused(options, why, capsys):
    with pytest.raises(SystemExit):
        program.main(["ros", "--service", "unix:/nowhere", "--scene", "s", "--arm", "MTM", *options])
    assert why in capsys.readouterr().err


def test_no_service(capsys, impatient, monkeypatch):
    monkeypatch.setattr(program, "Watchdog", StillWatchdog)
    assert program.main(["ros", "--service", "unix:/nowhere", "--scene", "s", "--arm", "MTM"]) == 1
    assert "no service at unix:/nowhere" in capsys.readouterr().err
