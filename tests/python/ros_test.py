"""The ROS 2 bridge against stubs of ROS and a service of the test's: no force that is old, missing or wrong goes out."""

import contextlib
import functools
import signal
import sys
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest
import ros_stubs
from conftest import SOURCE
from lying_service import answer_to, opened

import teletact
from teletact.v1 import palpation_pb2 as palpation

ros_stubs.install()
sys.path.insert(0, str(SOURCE / "clients/ros/src"))
from teletact_ros import __main__ as program  # noqa: E402
from teletact_ros import bridge  # noqa: E402
from teletact_ros.axes import Axes  # noqa: E402
from teletact_ros.felt import DISABLED, ENABLED, FAULT, PAUSED, Felt, Limits  # noqa: E402
from teletact_ros.freshness import FreshnessWatch, Stamps  # noqa: E402
from teletact_ros.measured import Measured  # noqa: E402

HUNG_MACHINE_S = 5.0  # that a test may be kept waiting
STIFFNESS = 200.0  # N/m of the test's tissue
LIMITS = Limits(slew_n_s=1e6)


def answer_at(position, status="ok", round_trip_s=0.01, tangent=STIFFNESS):
    position = np.array(position, float)
    has_force = status in ("ok", "degraded")
    force = np.array([0, -STIFFNESS * max(position[1], 0), 0]) if has_force else np.full(3, np.nan)
    tangent_n_m = np.diag([0, -tangent, 0.0]) if position[1] > 0 else np.zeros((3, 3))
    region = teletact.Region(0, 0.1)
    return teletact.Answer(1, position, status, force, tangent_n_m, 0.0, "", np.nan, 1, 1, "", region, round_trip_s, None)


def felt(limits=LIMITS):
    """One that is enabled at 0 s, 1 mm above the tissue."""
    out = Felt(limits, teletact.Opened(0.002, 2, 5, 0.0, np.array([0.0, 1.0, 0.0]), teletact.Region(0, 0.1), True))
    step(out, 0.0, -0.001)
    assert out.command(0.0, "enable") == "" and out.state == ENABLED
    return out


def step(out, now, y_m, **answer):
    out.pose(now, np.array([0.05, y_m, 0.0]))
    out.answer(now, answer_at([0.05, y_m, 0.0], **answer))
    return out.force(now)


def test_a_force_is_given_and_carried_to_where_the_finger_is():
    out = felt()
    assert step(out, 0.02, -0.0005).tolist() == [0, 0, 0], "in the air"
    np.testing.assert_allclose(step(out, 0.04, 0.002), [0, -0.4, 0])
    out.pose(0.045, np.array([0.05, 0.003, 0.0]))
    np.testing.assert_allclose(out.force(0.045), [0, -0.6, 0])
    out.pose(0.05, np.array([0.05, -0.001, 0.0]))
    assert not out.force(0.05).any(), "the finger is in the air, whatever the answer was"


@pytest.mark.parametrize("silent, why", [("answer", "no answer of the service"), ("pose", "no measured_cp")])
def test_silence_is_zero_force_and_comes_back_by_the_operator_alone(silent, why):
    out = felt()
    assert step(out, 0.02, 0.002).any()
    for k in range(1, 40):
        now = 0.02 + 0.01 * k
        if silent == "answer":
            out.pose(now, np.array([0.05, 0.002, 0.0]))
        else:
            out.answer(now, answer_at([0.05, 0.002, 0.0]))
        force = out.force(now)
        if now - 0.02 > LIMITS.silence_s:
            assert not force.any() and out.state == PAUSED and why in out.why
        else:
            assert force.any() and out.state == ENABLED
    assert not out.ready(now)
    assert not step(out, 1.0, 0.002).any() and out.state == PAUSED, "both flow again"
    assert "lift it first" in out.command(1.0, "resume") and out.state == PAUSED
    assert not step(out, 1.01, -0.001).any()
    assert out.command(1.01, "resume") == "" and step(out, 1.02, 0.001).any()


def test_what_is_old_or_failed_is_zero_force():
    out = felt()
    assert step(out, 0.02, 0.002).any()
    assert not step(out, 0.03, 0.002, round_trip_s=0.3).any() and "ms old" in out.why and out.state == PAUSED
    out = felt()
    assert not step(out, 0.02, 0.002, status="failed").any() and out.state == PAUSED
    for status in ("not covered", "preparing"):
        out = felt()
        assert not step(out, 0.02, 0.002, status=status).any() and status in out.remark()
        assert step(out, 0.03, 0.002).any() and out.remark() == ""
    out = felt()
    assert step(out, 0.02, 0.002, status="degraded").any() and "degraded" in out.remark()


def test_a_pose_after_a_gap_is_no_force_though_no_tick_saw_the_gap():
    out = felt()
    step(out, 0.02, -0.001)
    out.answer(0.18, answer_at([0.05, 0.006, 0.0]))
    out.pose(0.18, np.array([0.05, 0.006, 0.0]))
    assert out.state == PAUSED and "no measured_cp" in out.why
    assert not step(out, 0.19, 0.006).any()


def test_what_blocks_is_no_force_until_the_operator_resumes():
    out = felt()
    assert step(out, 0.02, 0.002).any()
    out.blocked = "nobody hears"
    assert not step(out, 0.03, 0.002).any() and (out.state, out.why) == (PAUSED, "nobody hears")
    assert out.command(0.04, "resume") == "nobody hears"
    out.blocked = ""
    assert not step(out, 0.05, 0.002).any() and out.state == PAUSED


def test_limits():
    hard = Limits(force_n=1.0, stiffness_n_m=100.0, slew_n_s=1e6)
    out = felt(hard)
    np.testing.assert_allclose(np.linalg.norm(step(out, 0.02, 0.002)), 0.2, err_msg="100 N/m times 2 mm")
    np.testing.assert_allclose(np.linalg.norm(step(out, 0.05, 0.02)), 1.0)
    out = felt(Limits(slew_n_s=10.0))
    np.testing.assert_allclose(np.linalg.norm(step(out, 0.001, 0.005)), 0.01, rtol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(step(out, 0.1, 0.005)), 0.11, rtol=1e-6, err_msg="a late tick")
    out = felt()
    out.pose(0.02, np.array([0.05, 0.001, 0.0]))
    out.answer(0.02, answer_at([0.05, 0.004, 0.0], tangent=1000.0))
    assert not out.force(0.02).any(), "that would draw the finger in"
    for name in ("force_n", "silence_s"):
        for value in (0.0, -1.0, float("nan"), float("inf")):
            with pytest.raises(ValueError, match=name):
                Limits(**{name: value})


@pytest.mark.parametrize("place", [[np.nan, 0, 0], [np.inf, 0, 0], [0.05, 0.1, 0.0]])
def test_a_finger_that_cannot_be_is_a_fault(place):
    out = felt()
    assert step(out, 0.02, 0.002).any()
    out.pose(0.021, np.array(place, float))
    assert not out.force(0.021).any() and out.state == FAULT
    assert not step(out, 0.5, -0.001).any()
    assert "disable first" in out.command(0.5, "enable") and out.state == FAULT
    assert out.command(0.5, "disable") == "" and out.command(0.5, "enable") == "" and out.state == ENABLED


def test_commands():
    out = felt()
    assert "none of" in out.command(0.0, "home") and out.state == ENABLED
    assert out.command(0.0, "pause") == "" and out.state == PAUSED
    assert out.command(0.0, "disable") == "" and out.state == DISABLED
    assert out.command(0.0, "pause") == "" and out.state == DISABLED
    assert "no measured_cp" in out.command(9.0, "enable") and out.state == DISABLED


def test_axes():
    axes = Axes("x,-z,y", [0.05, 0.01, 0.0])
    np.testing.assert_allclose(axes.to_scene(np.array([1.0, 2.0, 3.0])), [1.05, -2.99, 2.0])
    force, moved = np.array([0.1, -0.7, 0.2]), np.array([1.0, 2.0, 3.0])
    work = force @ (axes.to_scene(moved) - axes.to_scene(np.zeros(3)))
    np.testing.assert_allclose(axes.to_arm(force) @ moved, work)
    for words in ("x,y", "x,y,z,x", "x,x,z", "x,y,w", "", "-x,y,z", "x,y,zz"):
        with pytest.raises(ValueError, match="axes"):
            Axes(words, [0, 0, 0])
    with pytest.raises(ValueError, match="origin_m"):
        Axes("x,y,z", [0, float("nan"), 0])


# --- the node, its touch, a service -----------------------------------------------------------------------------


class Tissue:
    """200 N/m below y = 0, as long as it is not told otherwise."""

    def __init__(self):
        self.silent = threading.Event()
        self.lie = None

    def touch(self, requests, context):
        next(requests)
        yield opened()
        number = 0
        for request in requests:
            if self.silent.is_set() or not request.HasField("pose"):
                continue
            number += 1
            force_n = -STIFFNESS * max(request.pose.position_m[1], 0)
            changes = {"force_n": [0.0, force_n, 0.0], **(self.lie or {})}
            yield answer_to(request, number, **changes)


@contextlib.contextmanager
def running(servant, act, *options):
    """The program, with ``act(node)`` in the place of spinning. Its result: exit status and the node."""
    nodes = []

    def spin(node):
        nodes.append(node)
        act(node)
        raise KeyboardInterrupt

    ros_stubs.Ros.spin = staticmethod(spin)
    ros_stubs.Ros.listeners, ros_stubs.Ros.topics = {}, {}
    before = signal.getsignal(signal.SIGTERM)
    usual, program.Limits = program.Limits, functools.partial(Limits, silence_s=3.0, age_s=30.0)  # of a loaded machine
    watchdog, program.Watchdog = program.Watchdog, StillWatchdog
    hung_s, bridge.HUNG_S = bridge.HUNG_S, 3.0
    try:
        yield lambda: (program.main(["ros", "--service", servant.address, "--scene", "s", "--arm", "MTM", *options]),
                       nodes[0] if nodes else None)
    finally:
        signal.signal(signal.SIGTERM, before)
        program.Limits, program.Watchdog, bridge.HUNG_S = usual, watchdog, hung_s


class StillWatchdog:
    """In the place of the second process."""

    def __init__(self, arm, ros_arguments, now):
        StillWatchdog.newest, self.beats, self.says, self.closed = self, [], "", False

    def beat(self, topic):
        self.beats.append(topic)

    def trouble(self, now, topic):
        return self.says

    def close(self):
        self.closed = True


class Arm:
    """As dVRK 2.4 has it: it hears the wrenches of its own topics, each is a command into effort mode, and it keeps the
    last."""

    def __init__(self, topics=("body/servo_cf", "spatial/servo_cf"), name="MTM"):
        self.turn, self.position, self.frame = np.eye(3), np.zeros(3), "MTM_base"
        self.effort_mode, self.wrenches, self.force, self.torque = False, 0, np.zeros(3), np.zeros(3)
        self.name, self.topics, self.heard, self.frames = name, topics, set(), set()
        self.connect()

    def connect(self):
        for topic in self.topics:
            ros_stubs.Ros.listeners[f"{self.name}/{topic}"] = [functools.partial(self.take, topic)]

    def leave(self):
        for topic in self.topics:
            del ros_stubs.Ros.listeners[f"{self.name}/{topic}"]

    def take(self, topic, message):
        wrench, self.effort_mode = message.wrench, True
        self.wrenches += 1
        self.heard.add(topic)
        self.frames.add(message.header.frame_id)
        force = np.array([wrench.force.x, wrench.force.y, wrench.force.z])
        torque = np.array([wrench.torque.x, wrench.torque.y, wrench.torque.z])
        if topic == "body/servo_cf":
            force, torque = self.turn @ force, self.turn @ torque
        if topic == "spatial/servo_cf":  # about the base's origin
            torque = torque - np.cross(self.position, force)
        self.force, self.torque = force, torque  # on the tool's tip, along the base's axes

    def roll(self, angle, axis=2):
        """Turns the tool about an axis of the base."""
        c, s = np.cos(angle), np.sin(angle)
        self.turn = np.roll(np.roll(np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]), axis + 1, 0), axis + 1, 1)
        out = np.zeros(4)
        out[axis], out[3] = np.sin(angle / 2), np.cos(angle / 2)
        self.quaternion = out

    quaternion = np.array([0.0, 0.0, 0.0, 1.0])


def pose(x, y, z, stamp=None, quaternion=(0.0, 0.0, 0.0, 1.0), frame="MTM_base"):
    """Of a hand, which never holds still to the last bit."""
    out = ros_stubs.PoseStamped()
    stamp_s = bridge.time.monotonic() if stamp is None else stamp  # of one clock with the node's
    out.header.stamp.sec, out.header.stamp.nanosec = int(stamp_s), int(1e9 * (stamp_s % 1))
    out.header.frame_id = frame
    noise = 0.0 if stamp is not None else 1e-8 * np.sin(1e6 * stamp_s)
    out.pose.position.x, out.pose.position.y, out.pose.position.z = float(x), float(y), float(z + noise)
    out.pose.orientation.x, out.pose.orientation.y, out.pose.orientation.z, out.pose.orientation.w = map(float, quaternion)
    return out


def word(text):
    out = ros_stubs.StringStamped()
    out.string = text
    return out


def state_of(node):
    return node.publishers["teletact/operating_state"].sent[-1].state


def hold(node, arm, y, met, seconds=30):
    """The finger stays at y, and the node ticks, until that is met."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        arm.position = np.array([0.02, 0.0, y])
        node.tell("MTM/measured_cp", pose(*arm.position, quaternion=arm.quaternion, frame=arm.frame))
        node.tick()
        if met():
            return
        time.sleep(0.002)
    raise AssertionError(f"not met; {state_of(node)}, {arm.force}, {node.logged}")


def resumed(node, arm, command="enable"):
    """Out of the tissue."""
    hold(node, arm, -0.001, lambda: node.tell("teletact/state_command", word(command)) or state_of(node) == ENABLED)
    assert node.publishers["teletact/operating_state"].sent[-1].is_homed


def touched(node, arm):
    """Enabled in the air, then 1 mm deep, then felt. The scene's y is the arm's z."""
    node.tick()
    assert state_of(node) == DISABLED and not arm.effort_mode
    resumed(node, arm)
    for k in range(1, 20):
        node.tell("MTM/measured_cp", pose(0.02, 0.0, -0.001 + k * 1e-4, quaternion=arm.quaternion, frame=arm.frame))
    hold(node, arm, 0.001, lambda: np.abs(arm.force - [0, 0, -0.2]).max() < 1e-4)


def said(node):
    return [message.string for message in node.publishers["teletact/warning"].sent]


@pytest.fixture
def clock(monkeypatch):
    """The node's, which may be put forward."""
    clock = SimpleNamespace(ahead_s=0.0)
    clock.monotonic = lambda: time.monotonic() + clock.ahead_s
    monkeypatch.setattr("teletact_ros.bridge.time", clock)
    return clock


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

    with running(liar, act, "--axes", "x,z,-y", "--origin-m", "0.03", "0", "0", "--ros-args", "-r", "a:=b") as run:
        status, node = run()
    assert status == 0
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

    with running(liar, act, "--axes", "x,z,-y") as run:
        status, node = run()
    assert status == 0 and state_of(node) == FAULT


def acted(liar, act, *options):
    """Runs ``act(node, arm)`` on an arm of dVRK 2.4 and 200 N/m; returns the node."""
    liar.touch = Tissue().touch
    with running(liar, lambda node: act(node, Arm()), "--axes", "x,z,-y", *options) as run:
        status, node = run()
    assert status == 0
    return node


def ticks(node, arm, y, count=60):
    for _ in range(count):
        arm.position = np.array([0.02, 0.0, y])
        node.tell("MTM/measured_cp", pose(*arm.position, quaternion=arm.quaternion))
        node.tick()


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

    acted(liar, act)
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

    acted(liar, act)


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

    acted(liar, act)


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

    acted(liar, act)


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

    acted(liar, act)


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

    acted(liar, act)


def test_a_frame_that_changes_under_force_is_a_fault(liar):
    def act(node, arm):
        touched(node, arm)
        arm.frame = "Cart"
        hold(node, arm, 0.001, lambda: state_of(node) == FAULT)
        assert not arm.force.any() and "from 'MTM_base' to 'Cart'" in said(node)[-1]

    acted(liar, act)


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

    acted(liar, act)


def test_a_program_that_stalled_asks_the_operator(liar, clock, monkeypatch):
    def act(node, arm):
        touched(node, arm)
        monkeypatch.setattr(bridge, "HUNG_S", 0.5)
        clock.ahead_s += 1  # the watchdog has sent zero meanwhile
        node.tick()
        assert not arm.force.any() and "PAUSED: this program stalled for" in said(node)[-1]

    acted(liar, act)


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

    acted(liar, act)


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


def test_a_watch_judges_as_that_of_the_devices():
    def frozen(watch, under_force=True, velocity=None, turns=0.0, step=8e-6, stands=1):
        at, why = np.array([0.1, 0.0, 0.1]), ""
        for k in range(1000):
            if k % stands == 0:
                at = at + [0, step, 0]
            assert watch.judge(1e-3 * k, at, None, np.array([0, 0, 0, 1.0]), under_force) == ""
        for k in range(1000, 3000):
            angle = turns * 1e-3 * (k - 1000) / 2
            why = watch.judge(1e-3 * k, at, velocity, np.array([0, 0, np.sin(angle), np.cos(angle)]), under_force)
            if why:
                return round(1e-3 * (k - 999), 3), why
        return None, why

    after_s, why = frozen(FreshnessWatch())
    assert after_s == pytest.approx(0.1, abs=0.002) and "last bit" in why
    assert frozen(FreshnessWatch(), under_force=False) == (None, "")
    assert frozen(FreshnessWatch(has_noise=False)) == (None, "")
    assert frozen(FreshnessWatch(), step=1e-4, stands=13) == (None, ""), "coarse steps"
    after_s, why = frozen(FreshnessWatch(has_noise=False), under_force=False, velocity=np.array([0, 0, -0.25]))
    assert after_s == pytest.approx(0.1, abs=0.002) and "velocity" in why
    after_s, why = frozen(FreshnessWatch(has_noise=False), turns=2.0)
    assert after_s <= 0.11 and "orientation" in why


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


@pytest.mark.parametrize("options, why", [(["--axes", "x,y,-z"], "mirror"), (["--rate-hz", "5000"], "--rate-hz"),
                                          (["--most-force-n", "nan"], "force_n"), (["--scenery", "1"], "unrecognized")])
def test_options_that_are_refused(options, why, capsys):
    with pytest.raises(SystemExit):
        program.main(["ros", "--service", "unix:/nowhere", "--scene", "s", "--arm", "MTM", *options])
    assert why in capsys.readouterr().err


def test_no_service(capsys, impatient, monkeypatch):
    monkeypatch.setattr(program, "Watchdog", StillWatchdog)
    assert program.main(["ros", "--service", "unix:/nowhere", "--scene", "s", "--arm", "MTM"]) == 1
    assert "no service at unix:/nowhere" in capsys.readouterr().err
