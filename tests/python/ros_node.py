"""The ROS 2 bridge as a node against stubs of ROS, with a service, an arm and a hand of the test's."""

import functools
import signal
import sys
import threading
import time

import numpy as np
import ros_stubs
from conftest import SOURCE
from lying_service import answer_to, opened

ros_stubs.install()
sys.path.insert(0, str(SOURCE / "clients/ros/src"))
from teletact_ros import __main__ as program  # noqa: E402
from teletact_ros import bridge  # noqa: E402
from teletact_ros.felt import DISABLED, ENABLED, Limits  # noqa: E402

STIFFNESS = 200.0  # N/m of the test's tissue


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


class StillWatchdog:
    """In the place of the second process."""

    def __init__(self, topics, ros_arguments, now):
        StillWatchdog.newest, self.beats, self.says, self.closed = self, [], "", False

    def beat(self, topic):
        self.beats.append(topic)

    def trouble(self, now, topic):
        return self.says

    def close(self):
        self.closed = True


def run(servant, act, *options):
    """The program, with ``act(node)`` in the place of spinning. Returns the node."""
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
        assert program.main(["ros", "--service", servant.address, "--scene", "s", "--arm", "MTM", "--axes", "x,z,-y",
                             *options]) == 0
        return nodes[0]
    finally:
        signal.signal(signal.SIGTERM, before)
        program.Limits, program.Watchdog, bridge.HUNG_S = usual, watchdog, hung_s


def act_on_an_arm(liar, act):
    """Runs ``act(node, arm)`` on an arm of dVRK 2.4 and 200 N/m."""
    liar.touch = Tissue().touch
    run(liar, lambda node: act(node, Arm()))


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


def said(node):
    return [message.string for message in node.publishers["teletact/warning"].sent]


def ticks(node, arm, y, count=60):
    for _ in range(count):
        arm.position = np.array([0.02, 0.0, y])
        node.tell("MTM/measured_cp", pose(*arm.position, quaternion=arm.quaternion))
        node.tick()


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
