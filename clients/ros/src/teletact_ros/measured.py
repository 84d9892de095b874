"""An arm's measured_cp, as far as it says where the arm is. Knows neither ROS nor the scene; time is an argument."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from teletact.arrays import Floats

from teletact_ros.freshness import FreshnessWatch, Stamps

_VELOCITY_S = 0.05  # a velocity that is older says nothing


@dataclass(frozen=True)
class Pose:
    """``turn``: rotates vectors of the tool's frame into the frame that the pose is in."""

    position_m: Floats
    turn: Floats
    frame: str


@dataclass(frozen=True)
class Verdict:
    """Of one message: its pose, or why there is none. ``fault``: it contradicts itself."""

    pose: Pose | None = None
    why: str = ""
    fault: bool = False


def turn_of(quaternion: Floats) -> Floats:
    """The rotation matrix of a unit quaternion x, y, z, w."""
    x, y, z, w = quaternion
    return np.array([[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                     [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                     [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]])


class Measured:
    """``late_s``: how much later than the quickest a message may come."""

    def __init__(self, late_s: float, has_noise: bool = True) -> None:
        self._stamps = Stamps(late_s)
        self._watch = FreshnessWatch(has_noise)
        self._velocity: Floats | None = None
        self._velocity_s = -math.inf

    def velocity(self, now: float, velocity_m_s: Floats) -> None:
        """Of measured_cv, where there is one."""
        self._velocity, self._velocity_s = velocity_m_s, now

    def take(self, now: float, stamp_s: float, frame: str, position_m: Floats, quaternion: Floats,
             under_force: bool) -> Verdict:
        """What a message says. A stamp of zero and a position of zeros are an arm that does not know yet."""
        if why := self._stamps.stale(now, stamp_s):
            return Verdict(why=why)
        if not np.isfinite(position_m).all():
            return Verdict(why="measured_cp is not finite", fault=True)
        if not position_m.any():
            return Verdict(why="its position is all zeros")
        size = float(np.linalg.norm(quaternion))
        if not abs(size - 1) < 1e-2:
            return Verdict(why="its orientation is not a unit quaternion")
        orientation = quaternion / size
        velocity = self._velocity if now - self._velocity_s < _VELOCITY_S else None
        if why := self._watch.judge(now, position_m, velocity, orientation, under_force):
            return Verdict(why=f"measured_cp is frozen: {why}", fault=True)
        return Verdict(Pose(position_m, turn_of(orientation), frame))
