"""What a touch stream's messages say, checked: whatever comes from the network may be wrong."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Sequence

import numpy as np

from teletact.arrays import Floats, array_from
from teletact.errors import BadAnswer
from teletact.scenes import Region, region_from
from teletact.v1 import palpation_pb2 as palpation

_CALL = "Touch"
_MOST_CREDIT = 256
_FARTHEST_M = 10.0
STATUSES = {
    palpation.TOUCH_STATUS_OK: "ok",
    palpation.TOUCH_STATUS_NOT_COVERED: "not covered",
    palpation.TOUCH_STATUS_DEGRADED: "degraded",
    palpation.TOUCH_STATUS_FAILED: "failed",
    palpation.TOUCH_STATUS_PREPARING: "preparing",
}
PATH_NAMES = {
    palpation.SOLVE_PATH_UNSPECIFIED: "",
    palpation.SOLVE_PATH_COMPLIANCE: "compliance",
    palpation.SOLVE_PATH_GRADIENTS: "gradients",
    palpation.SOLVE_PATH_SHARES: "shares",
}
PATHS = {name: number for number, name in PATH_NAMES.items() if name}


@dataclass(frozen=True)
class TactileImage:
    """The pressure around the tip. ``pressure_pa``: (taxels_z, taxels_x), 0 or more, along the layer's normal."""

    centre_m: Floats
    pitch_m: float
    pressure_pa: Floats
    beyond_homogeneous_pa: Floats | None  # of it, what layered tissue alone would not show; None: in a plane
    force_n: float
    outside_n: float


@dataclass(frozen=True)
class Opened:
    """How the service opened a stream."""

    period_s: float
    credit: int
    instance: int
    layer_depth_m: float
    layer_normal: Floats
    covered: Region
    steers: bool


@dataclass(frozen=True)
class Answer:
    """The force at one pose.

    ``status``: "ok"; "degraded": not to be trusted, see ``warning``; "not covered", "failed", "preparing": there is
    none, and force, tangent and energy are NaN. ``half_width``: half of the interval that holds the force in 95 of
    100, over the force; NaN where the model states none. ``above``: what it reaches further up than down, where the
    scene is not stated to be ``linear``. ``message``: all that was sent.
    """

    sequence: int
    position_m: Floats   # (3,) of the pose
    status: str
    force_n: Floats      # (3,) on the finger
    tangent_n_m: Floats  # (3, 3) dF/dposition
    energy_j: float
    warning: str
    half_width: float
    above: float
    window_id: int
    model_version: int
    path: str            # which model answered; "" out of contact
    covered: Region
    round_trip_s: float  # from the pose's leaving to here
    message: palpation.TouchAnswer = field(repr=False)

    @property
    def has_force(self) -> bool:
        return self.status in ("ok", "degraded")

    @property
    def tactile(self) -> TactileImage | None:
        """The newest tactile image, with some of the answers where they were asked for."""
        return _tactile_from(self.message.tactile) if self.message.HasField("tactile") else None


def _wrong(name: str, value: Any) -> BadAnswer:
    return BadAnswer(f"{value}", field=name, call=_CALL)


def _finite(name: str, values: Sequence[float], *counts: int) -> Floats:
    if len(values) not in counts:
        raise _wrong(name, f"{len(values)} values")
    out = np.array(values, np.float64)
    if not np.isfinite(out).all():
        raise _wrong(name, "not finite")
    return out


def _position(name: str, values: Sequence[float]) -> Floats:
    out = _finite(name, values, 2, 3)
    return np.append(out, 0.0) if out.size == 2 else out


def opened_from(message: palpation.TouchOpened) -> Opened:
    if not 0 < message.period_s <= _FARTHEST_M:
        raise _wrong("opened.period_s", message.period_s)
    if not 1 <= message.credit <= _MOST_CREDIT:
        raise _wrong("opened.credit", message.credit)
    if not abs(message.layer.depth_m) <= _FARTHEST_M:
        raise _wrong("opened.layer.depth_m", message.layer.depth_m)
    normal = _position("opened.layer.normal", message.layer.normal or (0.0, 1.0, 0.0))
    if not abs(float(np.linalg.norm(normal)) - 1) <= 1e-6:
        raise _wrong("opened.layer.normal", normal.tolist())
    return Opened(message.period_s, message.credit, message.instance, message.layer.depth_m, normal,
                  region_from(message.covered, _CALL), message.steers)


def answer_from(message: palpation.TouchAnswer, round_trip_s: float) -> Answer:
    status = STATUSES.get(message.status)
    if status is None:
        raise _wrong("answer.status", message.status)
    position = _position("answer.position_m", message.position_m)
    force, tangent, energy = np.full(3, np.nan), np.full((3, 3), np.nan), math.nan
    if status in ("ok", "degraded"):
        force = _position("answer.force_n", message.force_n)
        if force.any() or message.tangent_n_m:
            tangent = _finite("answer.tangent_n_m", message.tangent_n_m, 9).reshape(3, 3)
        else:
            tangent = np.zeros((3, 3))
        energy = float(_finite("answer.energy_j", [message.energy_j], 1)[0])
    half_width, above = math.nan, math.nan
    if message.HasField("budget"):
        half_width, above = message.budget.half_width, message.budget.above
    return Answer(message.sequence, position, status, force, tangent, energy, message.warning, half_width, above,
                  message.window_id, message.model_version, PATH_NAMES.get(message.path, ""),
                  region_from(message.covered, _CALL), round_trip_s, message)


def _tactile_from(message: palpation.TactileImage) -> TactileImage:
    pressure = array_from(message.pressure_pa, "tactile.pressure_pa", _CALL).astype(np.float64)
    if pressure.ndim != 2 or not (np.isfinite(pressure).all() and (pressure >= 0).all()):
        raise _wrong("tactile.pressure_pa", "not finite, below 0, or no image")
    beyond = None
    if message.HasField("beyond_homogeneous_pa"):
        beyond = array_from(message.beyond_homogeneous_pa, "tactile.beyond_homogeneous_pa", _CALL).astype(np.float64)
        if beyond.shape != pressure.shape or not np.isfinite(beyond).all():
            raise _wrong("tactile.beyond_homogeneous_pa", "not finite, or of another shape")
    return TactileImage(_position("tactile.centre_m", message.centre_m), message.pitch_m, pressure, beyond,
                        message.force_n, message.outside_n)
