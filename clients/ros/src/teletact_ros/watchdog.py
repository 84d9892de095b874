"""A second process, which takes the force away when the bridge can not: an arm keeps the last wrench of a dead client.

The bridge writes a byte with each tick: which topic has a force, or that none has. When the pipe ends or falls silent with a
force on, zero is sent, and at once when the bridge was killed: on a busy machine a killed process has its pipe, and its
place among processes, for another tenth of a second or two, until each of its threads had a turn to end.
It has publishers of its own, and says each tenth of a second which of them reach the arm.
"""

from __future__ import annotations

import os
import re
import select
import signal
import subprocess
import sys
import time
from typing import Any

HUNG_S = 0.1  # a bridge that says nothing for so long with a force on
_SAY_S = 0.1
_DEAF_S = 1.0  # a watchdog that says nothing
_NONE = 255


class Watchdog:
    """The bridge's side. No call waits. ``topics``: where an arm takes wrenches; a topic is its number in them."""

    def __init__(self, topics: list[str], ros_arguments: list[str], now: float, hung_s: float = HUNG_S) -> None:
        self._process = subprocess.Popen([sys.executable, "-m", "teletact_ros.watchdog", str(os.getpid()), str(hung_s),
                                          *topics, *ros_arguments], stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True)
        assert self._process.stdin and self._process.stdout
        self._to, self._from = self._process.stdin.fileno(), self._process.stdout.fileno()
        os.set_blocking(self._to, False)
        os.set_blocking(self._from, False)
        self._reaches, self._said_s, self._ended = 0, now, False

    def beat(self, topic: int | None) -> None:
        """With each tick. ``topic``: that has a force, or None."""
        try:
            os.write(self._to, bytes([_NONE if topic is None else topic]))
        except BlockingIOError:
            pass  # it is deaf
        except OSError:
            self._ended = True

    def trouble(self, now: float, topic: int) -> str:
        """Why it could not take a force away that is on that topic; "" where it could."""
        try:
            said = os.read(self._from, 4096)
            if said:
                self._reaches, self._said_s = said[-1], now
            else:
                self._ended = True
        except BlockingIOError:
            pass
        if self._ended:
            return "the watchdog has ended; start the bridge again"
        if now - self._said_s > _DEAF_S:
            return "the watchdog says nothing"
        return "" if self._reaches >> topic & 1 else "the watchdog does not reach the arm yet"

    def close(self) -> None:
        """After the last zero."""
        self._process.stdin.close()  # type: ignore[union-attr]
        try:
            self._process.wait(2)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._process.stdout.close()  # type: ignore[union-attr]


def killed(process: int) -> bool:
    """Whether it must end: SIGKILL has come, whatever of it still goes on. By Linux's /proc; elsewhere nobody tells."""
    try:
        with open(f"/proc/{process}/status") as file:
            pending = re.search(r"^ShdPnd:\s*([0-9a-f]+)$", file.read(), re.MULTILINE)
    except OSError:
        return False  # it has ended, and its pipe with it
    return pending is not None and int(pending[1], 16) >> (signal.SIGKILL - 1) & 1 == 1


def watch(source: int, to: int, publishers: list[Any], zero: Any, bridge: int, hung_s: float) -> None:
    """Until the pipe ``source`` ends, or the process ``bridge`` was killed."""
    topic, heard_s, said_s = _NONE, time.monotonic(), 0.0
    while True:
        now = time.monotonic()
        if now - said_s > _SAY_S:
            said_s = now
            reaches = sum(1 << k for k, one in enumerate(publishers) if one.get_subscription_count() > 0)
            try:
                os.write(to, bytes([reaches]))
            except OSError:
                pass  # the bridge is gone: its pipe says so, too
        ready, _, _ = select.select([source], [], [], 0.01)
        if ready:
            beats = os.read(source, 4096)
            heard_s = time.monotonic()
            if not beats:
                return _zero(publishers, topic, zero)
            topic = beats[-1]
        elif killed(bridge):
            return _zero(publishers, topic, zero)
        elif topic != _NONE and time.monotonic() - heard_s > hung_s:
            _zero(publishers, topic, zero)
            topic = _NONE


def _zero(publishers: list[Any], topic: int, zero: Any) -> None:
    for attempt in range(3 if topic != _NONE else 0):  # what the dead one sent may still be under way
        if attempt:
            time.sleep(0.01)
        publishers[topic].publish(zero)


def main(arguments: list[str]) -> int:
    import rclpy
    from geometry_msgs.msg import WrenchStamped
    from rclpy.node import Node
    from rclpy.signals import SignalHandlerOptions
    from rclpy.utilities import remove_ros_args

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the terminal's are the bridge's
    rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    node = Node("teletact_watchdog")
    bridge, hung_s, *topics = remove_ros_args(arguments)[1:]
    publishers = [node.create_publisher(WrenchStamped, topic, 1) for topic in topics]
    watch(sys.stdin.fileno(), sys.stdout.fileno(), publishers, WrenchStamped(), int(bridge), float(hung_s))
    time.sleep(0.1)  # for what was sent to arrive
    node.destroy_node()
    rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv))
