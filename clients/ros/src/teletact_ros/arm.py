"""Where an arm takes wrenches, and what it is sent there so that its tool is pushed by a force."""

from __future__ import annotations

import numpy as np
from teletact.arrays import Floats

from teletact_ros.measured import Pose

# In the order of preference. Of ``body`` a wrench is along the tool's axes; of ``spatial`` along the base's, about the
# base's origin; plain ``servo_cf`` is as its header says.
TOPICS = ("body/servo_cf", "spatial/servo_cf", "servo_cf")
BODY, SPATIAL, PLAIN = range(3)


def wrench_at(topic: int, pose: Pose, force_n: Floats) -> tuple[Floats, Floats]:
    """The force and torque that push the tool's tip by ``force_n``, which is along the axes that the pose is in."""
    if topic == BODY:
        return np.asarray(pose.turn.T @ force_n), np.zeros(3)
    if topic == SPATIAL:
        return force_n, np.cross(pose.position_m, force_n)
    return force_n, np.zeros(3)
