"""The node: an arm's measured_cp in, servo_cf out, and an operating_state of its own."""

from __future__ import annotations

import threading
import time
from typing import Any

import numpy as np
from crtk_msgs.msg import OperatingState, StringStamped
from geometry_msgs.msg import PoseStamped, WrenchStamped
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from teletact import TeletactError, Touch
from teletact.arrays import Floats

from teletact_ros.axes import Axes
from teletact_ros.felt import DISABLED, FAULT, Felt, Limits

_STATE_S = 0.1   # operating_state comes at least so often
_REMARK_S = 1.0  # remarks come at most so often


class Bridge(Node):  # type: ignore[misc]
    """Runs as long as it is spun. The callbacks never wait for the network: one thread sends the newest pose, one takes
    answers. ``touch``: open; it is closed by ``close``."""

    def __init__(self, touch: Touch, arm: str, axes: Axes, limits: Limits, rate_hz: float) -> None:
        super().__init__("teletact")
        self._touch, self._axes, self._frame = touch, axes, ""
        self._felt = Felt(limits, touch.opened)
        self._lock = threading.Lock()  # of what follows, and of the force's state
        self._said, self._said_s = (DISABLED, ""), 0.0
        self._remark, self._remark_s = "", 0.0
        self._pose: Floats | None = None  # not sent yet
        self._news = threading.Condition(self._lock)
        self._closed = False
        self._servo_cf = self.create_publisher(WrenchStamped, f"{arm}/servo_cf", 1)
        self._state = self.create_publisher(OperatingState, "~/operating_state", 1)
        self._warning = self.create_publisher(StringStamped, "~/warning", 1)
        self.create_subscription(PoseStamped, f"{arm}/measured_cp", self._take_pose, qos_profile_sensor_data)
        self.create_subscription(StringStamped, "~/state_command", self._take_command, 1)
        self.create_timer(1 / rate_hz, self._tick)
        for work in (self._send, self._receive):
            threading.Thread(target=work, name=work.__name__, daemon=True).start()

    def close(self) -> None:
        """Zero force, DISABLED, and the end of the touch."""
        with self._lock:
            self._closed = True
            if self._felt.state != FAULT:
                self._felt.command(time.monotonic(), "disable")
            self._news.notify_all()
        self._tick()
        self._touch.close()

    # --- callbacks --------------------------------------------------------------------------------------------

    def _take_pose(self, message: Any) -> None:
        place = message.pose.position
        position = self._axes.to_scene(np.array([place.x, place.y, place.z], np.float64))
        with self._lock:
            self._frame = message.header.frame_id
            self._felt.pose(time.monotonic(), position)
            if np.isfinite(position).all():
                self._pose = position
                self._news.notify_all()

    def _take_command(self, message: Any) -> None:
        with self._lock:
            refused = self._felt.command(time.monotonic(), message.string)
        if refused:
            self._warn(f"{message.string}: {refused}")

    def _tick(self) -> None:
        now = time.monotonic()
        with self._lock:
            force = self._axes.to_arm(self._felt.force(now))
            state, ready = (self._felt.state, self._felt.why), self._felt.ready(now)
            remark = self._felt.remark()
        wrench = WrenchStamped()
        wrench.header.stamp, wrench.header.frame_id = self.get_clock().now().to_msg(), self._frame
        wrench.wrench.force.x, wrench.wrench.force.y, wrench.wrench.force.z = map(float, force)
        self._servo_cf.publish(wrench)
        changed, self._said = state != self._said, state
        if changed or now - self._said_s > _STATE_S:
            self._said_s = now
            message = OperatingState()
            message.header.stamp = wrench.header.stamp
            message.state, message.is_homed, message.is_busy = state[0], ready, False
            self._state.publish(message)
        if changed:
            self._warn(f"{state[0]}: {state[1]}")
        if remark != self._remark and now - self._remark_s > _REMARK_S:
            self._remark, self._remark_s = remark, now
            if remark:
                self._warn(remark)

    def _warn(self, text: str) -> None:
        self.get_logger().warning(text)
        message = StringStamped()
        message.header.stamp, message.string = self.get_clock().now().to_msg(), text
        self._warning.publish(message)

    # --- the touch --------------------------------------------------------------------------------------------

    def _send(self) -> None:
        while True:
            with self._lock:
                self._news.wait_for(lambda: self._pose is not None or self._closed)
                pose, self._pose = self._pose, None
                if self._closed:
                    return
            try:
                self._touch.move(pose)
            except TeletactError as error:
                return self._fail(error)

    def _receive(self) -> None:
        try:
            for answer in self._touch:
                with self._lock:
                    self._felt.answer(time.monotonic(), answer)
        except TeletactError as error:
            self._fail(error)

    def _fail(self, error: TeletactError) -> None:
        with self._lock:
            if not self._closed:
                self._felt.fail(f"the touch has ended: {error}")
