"""The force that an arm may be given: what is old, missing or wrong is zero force, and comes back by the operator alone."""

import numpy as np
import pytest
from ros_node import STIFFNESS
from teletact_ros.axes import Axes
from teletact_ros.felt import DISABLED, ENABLED, FAULT, PAUSED, Felt, Limits

import teletact

LIMITS = Limits(slew_n_s=1e6)


def answer_at(position, status="ok", round_trip_s=0.01, tangent=STIFFNESS):
    position = np.array(position, float)
    has_force = status in ("ok", "degraded")
    force = np.array([0, -STIFFNESS * max(position[1], 0), 0]) if has_force else np.full(3, np.nan)
    tangent_n_m = np.diag([0, -tangent, 0.0]) if position[1] > 0 else np.zeros((3, 3))
    region = teletact.Region(0, 0.1)
    return teletact.Answer(1, position, status, force, tangent_n_m, 0.0, "", np.nan, np.nan, 1, 1, "", region, round_trip_s, None)


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
