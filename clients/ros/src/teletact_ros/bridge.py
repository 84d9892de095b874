"""The node: an arm's measured_cp in, a wrench out where the arm takes one, and an operating_state of its own."""

from __future__ import annotations

import math
import threading
import time
from typing import Any

import numpy as np
from crtk_msgs.msg import OperatingState, StringStamped
from geometry_msgs.msg import PoseStamped, TwistStamped, WrenchStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from std_msgs.msg import Bool
from teletact import TeletactError, Touch
from teletact.arrays import Floats

from teletact_ros.arm import BODY, TOPICS, wrench_at
from teletact_ros.axes import Axes
from teletact_ros.felt import DISABLED, ENABLED, FAULT, Felt, Limits
from teletact_ros.measured import Measured, Pose
from teletact_ros.watchdog import HUNG_S, Watchdog

_STATE_S = 0.1   # operating_state comes at least so often
_LOOK_S = 0.1    # the arm is looked for so often
_SEARCH_S = 1.0  # and teleoperations
_REMARK_S = 1.0  # remarks come at most so often
_SAY_S = 0.5     # what keeps force away is said when it lasts so long


class Bridge(Node):  # type: ignore[misc]
    """Runs as long as it is spun. The callbacks never wait for the network: one thread sends the newest pose, one takes
    answers. ``touch``: open; it is closed by ``close``. A wrench goes out in ENABLED alone, and one zero when that ends: to
    an arm each wrench is a command into effort mode."""

    def __init__(self, touch: Touch, arm: str, axes: Axes, limits: Limits, rate_hz: float, watchdog: Watchdog,
                 has_noise: bool) -> None:
        super().__init__("teletact")
        self._touch, self._arm, self._axes = touch, arm, axes
        self._felt = Felt(limits, touch.opened)
        self._measured = Measured(limits.silence_s, has_noise)
        self._watchdog = watchdog
        self._lock = threading.Lock()  # of what follows, and of the force's state
        self._said, self._said_s = (DISABLED, ""), 0.0
        self._remark, self._remark_s = "", 0.0
        self._blocked_said, self._blocked_s = "", time.monotonic()
        self._at: Pose | None = None  # the newest
        self._topic, self._pushes = BODY, False
        self._following: dict[str, bool] = {}  # by topic
        self._hears_arm, self._arm_says = False, ""  # of its own operating_state: why it takes no force
        self._looked_s = self._searched_s = -math.inf
        self._ticked_s = time.monotonic()
        self._pose: Floats | None = None  # not sent yet
        self._news = threading.Condition(self._lock)
        self._closed = False
        self._wrenches = [self.create_publisher(WrenchStamped, f"{arm}/{topic}", 1) for topic in TOPICS]
        self._set_absolute = self.create_publisher(Bool, f"{arm}/body/set_cf_orientation_absolute", 1)
        self._state = self.create_publisher(OperatingState, "~/operating_state", 1)
        self._warning = self.create_publisher(StringStamped, "~/warning", 1)
        self.create_subscription(PoseStamped, f"{arm}/measured_cp", self._take_pose, qos_profile_sensor_data)
        self.create_subscription(TwistStamped, f"{arm}/measured_cv", self._take_velocity, qos_profile_sensor_data)
        self.create_subscription(StringStamped, "~/state_command", self._take_command, 1)
        self.create_timer(1 / rate_hz, self._tick)
        for work in (self._send, self._receive):
            threading.Thread(target=work, name=work.__name__, daemon=True).start()

    def close(self) -> None:
        """A last zero where there was a force, DISABLED, and the end of the touch."""
        with self._lock:
            self._closed = True
            if self._felt.state != FAULT:
                self._felt.command(time.monotonic(), "disable")
            self._news.notify_all()
        self._tick()
        self._touch.close()

    # --- callbacks --------------------------------------------------------------------------------------------

    def _take_pose(self, message: Any) -> None:
        now, stamp = time.monotonic(), message.header.stamp
        place, turn = message.pose.position, message.pose.orientation
        with self._lock:
            verdict = self._measured.take(now, stamp.sec + 1e-9 * stamp.nanosec, message.header.frame_id,
                                          np.array([place.x, place.y, place.z], np.float64),
                                          np.array([turn.x, turn.y, turn.z, turn.w], np.float64), self._felt.under_force())
            if verdict.pose is None:
                return self._felt.fail(verdict.why) if verdict.fault else self._felt.unusable(verdict.why)
            before, self._at = self._at, verdict.pose
            if before and before.frame != self._at.frame and self._felt.state == ENABLED:
                return self._felt.fail(f"measured_cp changed its frame, from {before.frame!r} to {self._at.frame!r}")
            position = self._axes.to_scene(verdict.pose.position_m)
            self._felt.pose(now, position)
            self._pose = position
            self._news.notify_all()

    def _take_velocity(self, message: Any) -> None:
        linear = message.twist.linear
        with self._lock:
            self._measured.velocity(time.monotonic(), np.array([linear.x, linear.y, linear.z], np.float64))

    def _take_command(self, message: Any) -> None:
        now = time.monotonic()
        with self._lock:
            self._look(now)
            refused = self._felt.command(now, message.string)
            along_tool = self._felt.state == ENABLED and self._topic == BODY
        if refused:
            self._warn(f"{message.string}: {refused}")
        elif along_tool:  # whoever asked for other axes before
            self._set_absolute.publish(Bool())

    def _tick(self) -> None:
        now = time.monotonic()
        with self._lock:
            if now - self._ticked_s > HUNG_S:
                self._felt.pause(f"this program stalled for {1e3 * (now - self._ticked_s):.0f} ms")
            self._ticked_s = now
            if now - self._looked_s > _LOOK_S:
                self._look(now)
            self._push(self._axes.to_arm(self._felt.force(now)))
            state, ready = (self._felt.state, self._felt.why), self._felt.ready(now)
            remark, blocked = self._felt.remark(), self._felt.blocked
        changed, self._said = state != self._said, state
        if changed or now - self._said_s > _STATE_S:
            self._said_s = now
            message = OperatingState()
            message.header.stamp = self.get_clock().now().to_msg()
            message.state, message.is_homed, message.is_busy = state[0], ready, False
            self._state.publish(message)
        if changed:
            self._warn(f"{state[0]}: {state[1]}")
        if remark != self._remark and now - self._remark_s > _REMARK_S:
            self._remark, self._remark_s = remark, now
            if remark:
                self._warn(remark)
        self._say_blocked(now, blocked)

    def _push(self, force: Floats) -> None:
        """Sends the force in ENABLED, a single zero when that ends, and else nothing."""
        pushes = self._felt.state == ENABLED and self._at is not None
        if pushes:
            self._watchdog.beat(self._topic)  # before the arm has anything to keep
        if (pushes or self._pushes) and self._at is not None:
            wrench = WrenchStamped()
            wrench.header.stamp = self.get_clock().now().to_msg()
            wrench.header.frame_id = self._arm.split("/")[-1] if self._topic == BODY else self._at.frame
            force_n, torque = wrench_at(self._topic, self._at, force)
            wrench.wrench.force.x, wrench.wrench.force.y, wrench.wrench.force.z = map(float, force_n)
            wrench.wrench.torque.x, wrench.wrench.torque.y, wrench.wrench.torque.z = map(float, torque)
            self._wrenches[self._topic].publish(wrench)
        self._pushes = pushes
        if not pushes:
            self._watchdog.beat(None)

    def _warn(self, text: str) -> None:
        self.get_logger().warning(text)
        message = StringStamped()
        message.header.stamp, message.string = self.get_clock().now().to_msg(), text
        self._warning.publish(message)

    # --- the arm ----------------------------------------------------------------------------------------------

    def _look(self, now: float) -> None:
        """Who hears us, and who else moves the arm."""
        self._looked_s = now
        heard = [k for k, one in enumerate(self._wrenches) if one.get_subscription_count() > 0]
        if heard and self._felt.state != ENABLED and not self._pushes:
            self._topic = heard[0]
        if now - self._searched_s > _SEARCH_S:
            self._searched_s = now
            self._look_for_arm_state()
            self._look_for_teleoperation()
        follows = [topic for topic, whether in self._following.items() if whether]
        if self._topic not in heard:
            names = [self._topic] if self._felt.state == ENABLED else list(range(len(TOPICS)))
            self._felt.blocked = "nobody hears " + " or ".join(f"{self._arm}/{TOPICS[k]}" for k in names)
        elif self._arm_says:
            self._felt.blocked = self._arm_says
        elif follows:
            self._felt.blocked = f"a teleoperation has the arm: {follows[0]}"
        else:
            self._felt.blocked = self._watchdog.trouble(now, self._topic)

    def _offered(self, topic: str) -> QoSProfile | None:
        """As the topic is published; who asks for more hears nothing of it. None where nobody publishes it."""
        for offer in self.get_publishers_info_by_topic(topic):
            return QoSProfile(depth=1, durability=offer.qos_profile.durability, reliability=offer.qos_profile.reliability)
        return None

    def _look_for_arm_state(self) -> None:
        topic = f"{self._arm}/operating_state"
        if not self._hears_arm and (offered := self._offered(topic)) is not None:
            self._hears_arm = True
            self.create_subscription(OperatingState, topic, self._take_arm_state, offered)

    def _take_arm_state(self, message: Any) -> None:
        """An arm that is off drops wrenches, and would have the whole force at once when it is back."""
        with self._lock:
            ready = message.state == ENABLED and message.is_homed
            self._arm_says = "" if ready else f"the arm says {message.state}" + ("" if message.is_homed else ", not homed")
            self._look(time.monotonic())

    def _look_for_teleoperation(self) -> None:
        """Topics such as MTMR_PSM1/following, of the arm MTMR."""
        arm = self._arm.split("/")[-1]
        for topic, kinds in self.get_topic_names_and_types():
            words = topic.split("/")
            if topic in self._following or words[-1] != "following" or "std_msgs/msg/Bool" not in kinds:
                continue
            if len(words) < 2 or arm not in words[-2].split("_"):
                continue
            if (offered := self._offered(topic)) is None:
                continue
            self._following[topic] = False
            self.create_subscription(Bool, topic, lambda message, topic=topic: self._take_following(topic, message), offered)

    def _take_following(self, topic: str, message: Any) -> None:
        with self._lock:
            self._following[topic] = message.data
            self._look(time.monotonic())

    def _say_blocked(self, now: float, blocked: str) -> None:
        """What keeps force away, when it lasts; and, where that is over, what the arm is given."""
        if blocked == self._blocked_said:
            self._blocked_s = now
        elif now - self._blocked_s > _SAY_S:
            self._blocked_said, self._blocked_s = blocked, now
            self._warn(f"no force: {blocked}" if blocked else f"the arm hears {self._arm}/{TOPICS[self._topic]}")

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
