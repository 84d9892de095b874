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
from teletact_ros.axes import Axes  # noqa: E402
from teletact_ros.felt import DISABLED, ENABLED, FAULT, PAUSED, Felt, Limits  # noqa: E402

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
    before = signal.getsignal(signal.SIGTERM)
    usual, program.Limits = program.Limits, functools.partial(Limits, silence_s=3.0, age_s=30.0)  # of a loaded machine
    try:
        yield lambda: (program.main(["ros", "--service", servant.address, "--scene", "s", "--arm", "MTM", *options]),
                       nodes[0] if nodes else None)
    finally:
        signal.signal(signal.SIGTERM, before)
        program.Limits = usual


def pose(x, y, z):
    out = ros_stubs.PoseStamped()
    out.pose.position.x, out.pose.position.y, out.pose.position.z = float(x), float(y), float(z)
    return out


def word(text):
    out = ros_stubs.StringStamped()
    out.string = text
    return out


def newest(node):
    force = node.publishers["MTM/servo_cf"].sent[-1].wrench.force
    return np.array([force.x, force.y, force.z]), node.publishers["teletact/operating_state"].sent[-1].state


def hold(node, y, met, seconds=30):
    """The finger stays at y, and the node ticks, until that is met."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        node.tell("MTM/measured_cp", pose(0.02, 0.0, y))
        node.tick()
        if met():
            return
        time.sleep(0.002)
    raise AssertionError(f"not met; {newest(node)}, {node.logged}")


def touched(node):
    """Enabled in the air, then 1 mm deep, then felt. The scene's y is the arm's z."""
    node.tick()
    assert newest(node)[1] == DISABLED and not newest(node)[0].any()
    hold(node, -0.001, lambda: node.tell("teletact/state_command", word("enable")) or newest(node)[1] == ENABLED)
    assert node.publishers["teletact/operating_state"].sent[-1].is_homed
    for k in range(1, 20):
        node.tell("MTM/measured_cp", pose(0.02, 0.0, -0.001 + k * 1e-4))
    hold(node, 0.001, lambda: abs(newest(node)[0][2] + 0.2) < 1e-6)


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
        clock.ahead_s += 0.1
        return True

    def act(node):
        touched(node)
        tissue.silent.set()  # the stream is open, and says nothing
        hold(node, 0.001, lambda: waited() and newest(node)[1] == PAUSED)
        assert not newest(node)[0].any() and any("no answer of the service" in text for text in said(node))
        tissue.silent.clear()
        hold(node, 0.001, lambda: node.publishers["teletact/operating_state"].sent[-1].is_homed)
        assert newest(node)[1] == PAUSED and not newest(node)[0].any(), "it came back by itself"
        node.tell("teletact/state_command", word("resume"))
        assert newest(node)[1] == PAUSED and "lift it first" in said(node)[-1]
        hold(node, -0.001, lambda: node.tell("teletact/state_command", word("resume")) or newest(node)[1] == ENABLED)
        hold(node, 0.001, lambda: newest(node)[0].any())

    with running(liar, act, "--axes", "x,z,-y", "--origin-m", "0.03", "0", "0", "--ros-args", "-r", "a:=b") as run:
        status, node = run()
    assert status == 0
    assert newest(node)[1] == DISABLED and not newest(node)[0].any(), "the last word is zero"
    assert not ros_stubs.Ros.up and not ros_stubs.Ros.nodes


def test_a_service_that_lies_or_ends_is_a_fault(liar):
    tissue = Tissue()
    liar.touch = tissue.touch

    def act(node):
        touched(node)
        tissue.lie = {"force_n": [0.0, float("nan"), 0.0]}
        hold(node, 0.001, lambda: newest(node)[1] == FAULT)
        assert not newest(node)[0].any() and any("the touch has ended: Touch: DATA_LOSS" in text for text in said(node))

    with running(liar, act, "--axes", "x,z,-y") as run:
        status, node = run()
    assert status == 0 and newest(node)[1] == FAULT and not newest(node)[0].any()


@pytest.mark.parametrize("options, why", [(["--axes", "x,y,-z"], "mirror"), (["--rate-hz", "5000"], "--rate-hz"),
                                          (["--most-force-n", "nan"], "force_n"), (["--scenery", "1"], "unrecognized")])
def test_options_that_are_refused(options, why, capsys):
    with pytest.raises(SystemExit):
        program.main(["ros", "--service", "unix:/nowhere", "--scene", "s", "--arm", "MTM", *options])
    assert why in capsys.readouterr().err


def test_no_service(capsys, impatient):
    assert program.main(["ros", "--service", "unix:/nowhere", "--scene", "s", "--arm", "MTM"]) == 1
    assert "no service at unix:/nowhere" in capsys.readouterr().err
