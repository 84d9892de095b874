"""The ROS 2 bridge gives no force to an arm that is off, or that a teleoperation has."""

import numpy as np
import ros_stubs
from ros_node import act_on_an_arm, resumed, said, state_of, ticks, touched, word
from teletact_ros.felt import DISABLED, ENABLED, PAUSED


def test_a_teleoperation_that_follows_has_the_arm(liar):
    def act(node, arm):
        ros_stubs.Ros.topics = {"/MTM_PSM1/following": ("std_msgs/msg/Bool", "transient local", "best effort"),
                                "/MTML_PSM2/following": ("std_msgs/msg/Bool", "transient local", "reliable"),
                                "/MTM_PSM3/following": ("std_msgs/msg/String", "volatile", "reliable")}
        node._searched_s = -np.inf  # not in a second
        follows = ros_stubs.Bool()
        touched(node, arm)
        assert [topic for topic in node.heard if topic.endswith("following")] == ["/MTM_PSM1/following"]
        heard_with = node.heard_with["/MTM_PSM1/following"]
        assert (heard_with.durability, heard_with.reliability) == ("transient local", "best effort"), "as it is published"
        follows.data = True
        node.tell("/MTM_PSM1/following", follows)
        wrenches = arm.wrenches
        ticks(node, arm, 0.001)
        assert state_of(node) == PAUSED and "MTM_PSM1/following" in said(node)[-1]
        assert arm.wrenches == wrenches + 1 and not arm.force.any()
        ticks(node, arm, -0.001)
        node.tell("teletact/state_command", word("resume"))
        assert state_of(node) == PAUSED and "a teleoperation has the arm" in said(node)[-1]
        follows.data = False
        node.tell("/MTM_PSM1/following", follows)
        ticks(node, arm, -0.001)
        assert state_of(node) == PAUSED
        resumed(node, arm, "resume")

    act_on_an_arm(liar, act)


def test_an_arm_that_is_off_or_not_homed_gets_no_force(liar):
    def act(node, arm):
        ros_stubs.Ros.topics = {"/MTM/operating_state": ("crtk_msgs/msg/OperatingState", "transient local", "reliable")}
        node._searched_s = -np.inf  # not in a second
        touched(node, arm)
        assert node.heard_with["MTM/operating_state"].durability == "transient local", "what it said before counts"
        for state, is_homed, why in ((DISABLED, True, "the arm says DISABLED"), (ENABLED, False, "ENABLED, not homed")):
            says = ros_stubs.OperatingState()
            says.state, says.is_homed = state, is_homed
            wrenches = arm.wrenches
            node.tell("MTM/operating_state", says)
            ticks(node, arm, 0.001)
            assert state_of(node) == PAUSED and why in said(node)[-1]
            assert arm.wrenches == wrenches + 1 and not arm.force.any(), "one zero"
            ticks(node, arm, -0.001)
            node.tell("teletact/state_command", word("resume"))
            assert why in said(node)[-1] and state_of(node) == PAUSED
            says.state, says.is_homed = ENABLED, True
            node.tell("MTM/operating_state", says)
            ticks(node, arm, -0.001)
            assert state_of(node) == PAUSED, "it came back by itself"
            resumed(node, arm, "resume")

    act_on_an_arm(liar, act)
