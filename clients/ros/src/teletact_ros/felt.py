"""The force that an arm may be given, and the state that goes with it. Knows neither ROS nor the network; time is an
argument. Whatever is old, missing or wrong is zero force, and only an operator brings force back.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from teletact import Answer, Opened
from teletact.arrays import Floats

_LATE_S = 0.01  # a tick that comes later lets the force rise no further
DISABLED, ENABLED, PAUSED, FAULT = "DISABLED", "ENABLED", "PAUSED", "FAULT"  # CRTK's


@dataclass(frozen=True)
class Limits:
    """What an arm is given at most. The defaults are cautious for a hand-sized arm, of no data sheet."""

    force_n: float = 2.0
    stiffness_n_m: float = 400.0  # times how far the finger is in the tissue
    slew_n_s: float = 20.0        # how fast a force may rise; it falls at once
    speed_m_s: float = 1.0        # a finger that is faster is a FAULT
    silence_s: float = 0.15       # without an answer, or without a pose
    age_s: float = 0.25           # of the pose that an answer belongs to

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not 0 < value < math.inf:
                raise ValueError(f"{name}: {value}; it must be finite and above 0")


class Felt:
    """All vectors are the scene's, (3,), in m, N and N/m. ``now``: seconds of one steady clock."""

    def __init__(self, limits: Limits, opened: Opened) -> None:
        self._limits = limits
        self._normal, self._depth_m = opened.layer_normal, opened.layer_depth_m
        self._position: Floats | None = None
        self._answer: Answer | None = None
        self._pose_s = self._answer_s = -math.inf
        self._force, self._force_s = np.zeros(3), -math.inf
        self._unusable = ""
        self.blocked = ""  # why nobody may be given a force, whatever poses and answers say
        self.state, self.why = DISABLED, "not enabled yet"

    # --- what comes in ----------------------------------------------------------------------------------------

    def pose(self, now: float, position_m: Floats) -> None:
        """Where the finger is."""
        if not np.isfinite(position_m).all():
            return self.fail("measured_cp is not finite")
        if now - self._pose_s > self._limits.silence_s:
            self.pause(self._missing(now))  # whether or not a tick has seen it
        self._unusable = ""
        if self._position is not None and now - self._pose_s < self._limits.silence_s:
            moved_m = float(np.linalg.norm(position_m - self._position))
            # Poses that the network has bunched: 10 ms of the speed limit are none.
            if moved_m > self._limits.speed_m_s * (now - self._pose_s + 0.01):
                return self.fail(f"the finger ran away, by {1e3 * moved_m:.1f} mm at once")
        self._position, self._pose_s = position_m, now

    def unusable(self, why: str) -> None:
        """A message of the arm that says not where it is."""
        self._unusable = why

    def answer(self, now: float, answer: Answer) -> None:
        """The newest force of the service."""
        self._answer, self._answer_s = answer, now

    def pause(self, why: str) -> None:
        """No force until the operator resumes."""
        if self.state == ENABLED:
            self.state, self.why = PAUSED, why

    def fail(self, why: str) -> None:
        """No force until the operator disables and enables again."""
        self.state, self.why = FAULT, why
        self._position = None

    def command(self, now: float, word: str) -> str:
        """CRTK's state_command. Returns why it was not done; "" where it was."""
        if word == "disable":
            self.state, self.why = DISABLED, "by the operator"
        elif word == "pause":
            self.pause("by the operator")
        elif word in ("enable", "resume"):
            if self.state == FAULT:
                return f"after a FAULT ({self.why}) disable first"
            missing = self._missing(now)
            if missing or self.indentation_m() > 0:
                return missing or "the finger is in the tissue: lift it first"
            self.state, self.why = ENABLED, "by the operator, out of contact"
        else:
            return f"{word!r} is none of enable, disable, pause and resume"
        return ""

    # --- what goes out ----------------------------------------------------------------------------------------

    def ready(self, now: float) -> bool:
        """Whether poses and answers flow."""
        return not self._missing(now)

    def remark(self) -> str:
        """What is to be said of the newest answer; "" where it is well."""
        return "" if self._answer is None or self._answer.status == "ok" else f"the service's answer: {self._answer.status}"

    def under_force(self) -> bool:
        """Whether the newest force was one."""
        return bool(self._force.any())

    def indentation_m(self) -> float:
        """How far the finger is beyond the touched layer."""
        return -math.inf if self._position is None else float(self._position @ self._normal) - self._depth_m

    def force(self, now: float) -> Floats:
        """What the arm may be given at this moment; zero whenever the state is not ENABLED."""
        if missing := self._missing(now):
            self.pause(missing)
        force = self._limited(now) if self.state == ENABLED else np.zeros(3)
        self._force, self._force_s = force, now
        return force

    def _missing(self, now: float) -> str:
        limit_s = self._limits.silence_s
        if self.blocked:
            return self.blocked
        if now - self._pose_s > limit_s:
            return f"no measured_cp for {limit_s} s" + (f": {self._unusable}" if self._unusable else "")
        if self._answer is None or now - self._answer_s > limit_s:
            return f"no answer of the service for {limit_s} s"
        age_s = now - self._answer_s + self._answer.round_trip_s
        if age_s > self._limits.age_s:
            return f"what the service answers is {1e3 * age_s:.0f} ms old"
        if self._answer.status == "failed":
            return f"the service has no force: {self._answer.warning or 'failed'}"
        return ""

    def _limited(self, now: float) -> Floats:
        """The answer's force, carried to where the finger is now by its tangent, within the limits."""
        indentation_m = self.indentation_m()
        if indentation_m <= 0 or self._answer is None or not self._answer.has_force or self._position is None:
            return np.zeros(3)
        moved = self._position - self._answer.position_m
        force = self._answer.force_n + self._answer.tangent_n_m @ moved
        max_n = min(self._limits.force_n, self._limits.stiffness_n_m * indentation_m,
                     float(np.linalg.norm(self._force)) + self._limits.slew_n_s * min(now - self._force_s, _LATE_S))
        size_n = float(np.linalg.norm(force))
        if force @ self._normal > 0:  # it would draw the finger in
            return np.zeros(3)
        return np.asarray(force * min(1.0, max_n / size_n)) if size_n > 0 else np.zeros(3)
