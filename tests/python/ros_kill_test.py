"""The bridge and its watchdog as two processes, and an arm that keeps the last wrench: what is left in the hand."""

import contextlib
import os
import signal
import socket
import struct
import subprocess
import sys
import threading
import time

import pytest
from conftest import SOURCE
from lying_service import answer_to, opened

sys.path.insert(0, str(SOURCE / "clients/ros/src"))
from teletact_ros import watchdog  # noqa: E402

# In each process: ROS is a stub, whose publishers of one topic reach this test.
INSTALL = """
import contextlib, os, socket, struct, sys, time
sys.path[:0] = [{tests!r}]
import ros_stubs
ros_stubs.install()
arm = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
arm.connect({arm!r})
def send(message):
    force = message.wrench.force
    with contextlib.suppress(OSError):  # the test is over
        arm.send(struct.pack("=i4d", os.getpid(), time.monotonic(), force.x, force.y, force.z))
ros_stubs.Ros.listeners["MTM/body/servo_cf"] = [send]
"""

BRIDGE = """
import functools, sys, time
import ros_stubs
from teletact_ros import __main__ as program
program.Limits = functools.partial(program.Limits, silence_s=3.0, age_s=30.0)
program.Watchdog = functools.partial(program.Watchdog, **eval(sys.argv[2]))

def spin(node):
    y, n = -0.001, 0
    while True:
        n += 1
        enabled = node._felt.state == "ENABLED"
        y = min(y + 1e-5, 0.001) if enabled else -0.001
        pose, command = ros_stubs.PoseStamped(), ros_stubs.StringStamped()
        now, command.string = time.monotonic(), "enable"
        pose.header.stamp.sec, pose.header.stamp.nanosec = int(now), int(1e9 * (now % 1))
        pose.pose.position.x, pose.pose.position.z, pose.pose.orientation.w = 0.02, y + 1e-8 * (n % 2), 1.0
        node.tell("MTM/measured_cp", pose)
        if not enabled and n % 10 == 0:
            node.tell("teletact/state_command", command)
        node.tick()
        time.sleep(0.002)

ros_stubs.Ros.spin = staticmethod(spin)
sys.exit(program.main(["ros", "--service", sys.argv[1], "--scene", "s", "--arm", "MTM", "--axes", "x,z,-y"]))
"""


def touch(requests, context):
    next(requests)
    yield opened()
    number = 0
    for request in requests:
        if request.HasField("pose"):
            number += 1
            yield answer_to(request, number, force_n=[0.0, -200.0 * max(request.pose.position_m[1], 0), 0.0])


class Arm:
    """Keeps the last wrench; knows who sent it."""

    def __init__(self, path):
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind(path)
        self.socket.settimeout(30)

    def take(self, wanted):
        """The next wrench that is wanted: who, when, and the force's size."""
        while True:
            who, when_s, *force = struct.unpack("=i4d", self.socket.recv(256))
            size_n = max(map(abs, force))
            if wanted(who, size_n):
                return who, when_s, size_n


@contextlib.contextmanager
def pushed(liar, folder, **of_watchdog):
    """A bridge that pushes an arm."""
    liar.touch = touch
    folder.mkdir()
    arm = Arm(str(folder / "arm"))
    (folder / "sitecustomize.py").write_text(INSTALL.format(tests=str(SOURCE / "tests/python"), arm=str(folder / "arm")))
    paths = [str(folder), str(SOURCE / "clients/ros/src"), os.environ["PYTHONPATH"]]
    process = subprocess.Popen([sys.executable, "-c", BRIDGE, liar.address, repr(of_watchdog)], env={**os.environ, "PYTHONPATH": ":".join(paths)})
    try:
        arm.take(lambda who, size_n: who == process.pid and size_n > 0.1)
        yield process, arm
    finally:
        process.kill()
        process.wait()


def await_zero(process, arm, end):
    ended_s = time.monotonic()
    process.send_signal(end)
    _, when_s, size_n = arm.take(lambda who, size_n: who != process.pid)
    assert size_n == 0
    print(f"zero force {1e3 * (when_s - ended_s):.1f} ms after {end.name}")


def test_a_killed_bridge_leaves_no_force(liar, tmp_path):
    with pushed(liar, tmp_path / "0", hung_s=3600.0) as (process, arm):  # nothing is told by silence
        await_zero(process, arm, signal.SIGKILL)


class Publisher:
    def __init__(self):
        self.sent = []

    def get_subscription_count(self):
        return 1

    def publish(self, message):
        self.sent.append(message)


@pytest.mark.parametrize("topic, zeros", [(0, 3), (255, 0)])
def test_a_pipe_that_ends_takes_the_force_that_is_on(topic, zeros):
    (source, to_it), (from_it, to) = os.pipe(), os.pipe()
    publisher = Publisher()
    os.write(to_it, bytes([topic]))
    os.close(to_it)
    watchdog.watch(source, to, [publisher], "zero", os.getpid(), 3600.0)
    for end in (from_it, source, to):
        os.close(end)
    assert publisher.sent == ["zero"] * zeros


def test_a_kill_is_known_before_the_pipe_ends():
    bridge = subprocess.Popen([sys.executable, "-c", "import signal; signal.pause()"])
    (source, to_it), (from_it, to) = os.pipe(), os.pipe()
    publisher = Publisher()
    thread = threading.Thread(target=watchdog.watch, args=(source, to, [publisher], "zero", bridge.pid, 3600.0))
    try:
        os.write(to_it, bytes([0]))
        thread.start()
        os.read(from_it, 1)
        for harmless in (signal.SIGSTOP, signal.SIGCONT):
            bridge.send_signal(harmless)
            assert not watchdog.killed(bridge.pid)
        os.read(from_it, 1)  # a tenth of a second
        assert publisher.sent == []
        bridge.kill()  # who has killed it has not waited for it: so it stands there, as one does that gets no turn to end
        thread.join(30)
        assert not thread.is_alive() and publisher.sent == ["zero"] * 3
        assert watchdog.killed(bridge.pid)
    finally:
        bridge.kill()
        bridge.wait()
        for end in (to_it, from_it, source, to):
            os.close(end)
    assert not watchdog.killed(bridge.pid)


def test_a_bridge_that_hangs_has_its_force_taken_and_asks(liar, tmp_path):
    with pushed(liar, tmp_path / "0") as (process, arm):
        await_zero(process, arm, signal.SIGSTOP)
        process.send_signal(signal.SIGCONT)
        arm.take(lambda who, size_n: who == process.pid and size_n == 0)


def test_an_orderly_end_needs_no_watchdog(liar, tmp_path):
    with pushed(liar, tmp_path / "0") as (process, arm):
        process.send_signal(signal.SIGTERM)
        assert process.wait(30) == 0
        arm.take(lambda who, size_n: who == process.pid and size_n == 0)
        arm.socket.settimeout(0.2)
        with pytest.raises(TimeoutError):
            arm.take(lambda who, size_n: True)
