"""Whether an arm's poses are of now, by what they say and not by when they come. Time is an argument.

FreshnessWatch has the rules of client/haptic/freshness_watch.h; the tests of both judge tests/haptic/freshness_cases.json.
"""

from __future__ import annotations

import math

import numpy as np
from teletact.arrays import Floats

STANDS_S = 0.1     # to the last bit: a stand
_LATE_S = 0.03     # poses that come later count as so far apart: a stall is no stand
_WAY_M = 3e-4      # that the velocity may say of a stand
_TURN_RAD = 0.09   # that a tool may turn meanwhile, in place
_FINE_M = 1e-5     # what moves by less is no coarse step
_SLOW_M_S = 0.02   # what moves faster tells nothing of its steps


class FreshnessWatch:
    """``has_noise``: of an arm whose positions never stand still to the last bit in a hand."""

    def __init__(self, has_noise: bool = True) -> None:
        self._has_noise = has_noise
        self._position: Floats | None = None
        self._half_began: Floats | None = None  # how the tool was turned when this half of a stand began
        self._earlier_began: Floats | None = None
        self._last_s = -math.inf
        self._fine = self._coarse = 0  # steps so far
        self._begin(None)

    def judge(self, now: float, position_m: Floats, velocity_m_s: Floats | None, orientation: Floats | None,
              under_force: bool) -> str:
        """Why the position is not of now; "" where it may be. ``orientation``: a unit quaternion."""
        elapsed_s = min(max(now - self._last_s, 0.0), _LATE_S)
        self._last_s = now
        if self._position is None or not np.array_equal(position_m, self._position):
            if self._position is not None:
                self._learn(float(np.linalg.norm(position_m - self._position)))
            self._position = position_m
            self._begin(orientation)
            return ""
        self._stand(elapsed_s, velocity_m_s, orientation)
        if self._stands_s < STANDS_S - 1e-9:
            return ""
        if not np.linalg.norm(self._earlier_way + self._way) <= _WAY_M:
            return "its position stands still while its velocity says that it moves"
        if under_force and self._turned(orientation):
            return "its position stands still while its orientation turns"
        coarse = self._coarse >= 10 and self._coarse > 20 * self._fine
        if under_force and self._has_noise and not coarse:
            return "its position stands still to the last bit in a hand that is pushed"
        return ""

    def _begin(self, orientation: Floats | None) -> None:
        self._stands_s, self._stood = 0.0, 0
        self._half_s, self._way, self._earlier_way = 0.0, np.zeros(3), np.zeros(3)
        self._half_began, self._earlier_began = orientation, None

    def _learn(self, step_m: float) -> None:
        if step_m < _FINE_M:
            self._fine += 1
        elif self._stood >= 3 and step_m < _SLOW_M_S * self._stands_s:
            self._coarse += 1

    def _stand(self, elapsed_s: float, velocity_m_s: Floats | None, orientation: Floats | None) -> None:
        self._stood += 1
        self._stands_s += elapsed_s
        if self._half_s >= STANDS_S / 2 - 1e-9:
            self._earlier_way, self._earlier_began = self._way, self._half_began
            self._half_s, self._way, self._half_began = 0.0, np.zeros(3), orientation
        self._half_s += elapsed_s
        if velocity_m_s is not None:
            self._way = self._way + elapsed_s * velocity_m_s

    def _turned(self, orientation: Floats | None) -> bool:
        if orientation is None or self._earlier_began is None:
            return False
        return 2 * math.acos(min(1.0, abs(float(orientation @ self._earlier_began)))) > _TURN_RAD


class Stamps:
    """Of one publisher, in its order. Its clock needs not be ours: what counts as late is measured against the quickest."""

    _FORGET_S_S = 1e-3  # by so much clocks may drift apart
    _ANEW_S = 1.0       # after so long without a fresh one the publisher's clock may have been set back

    def __init__(self, late_s: float) -> None:
        self._late_s = late_s
        self._newest_s = self._fresh_s = self._seen_s = -math.inf
        self._min_s = math.inf

    def stale(self, now: float, stamp_s: float) -> str:
        """Why a message of that stamp is not of now; "" where it is."""
        if stamp_s == 0:
            return "its stamp is zero"
        if stamp_s == self._newest_s:
            return "its stamp is repeated"
        if stamp_s < self._newest_s:
            if now - self._fresh_s < self._ANEW_S:
                return "its stamp is older than the one before"
            self._min_s = math.inf
        delay_s = now - stamp_s
        drifted_s = self._FORGET_S_S * (now - self._seen_s) if self._min_s < math.inf else 0.0
        self._min_s = min(self._min_s + drifted_s, delay_s)
        self._newest_s, self._seen_s = stamp_s, now
        if delay_s - self._min_s > self._late_s:
            return f"its stamp is {1e3 * (delay_s - self._min_s):.0f} ms old"
        self._fresh_s = now
        return ""
