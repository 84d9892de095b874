"""python3 -m teletact_ros --service ADDRESS --scene NAME --arm NAME"""

from __future__ import annotations

import argparse
import math
import signal
import sys
import time

import rclpy
import teletact
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from teletact_ros.arm import TOPICS
from teletact_ros.axes import Axes
from teletact_ros.bridge import Bridge
from teletact_ros.felt import Limits
from teletact_ros.watchdog import Watchdog


def ros_arguments(arguments: list[str]) -> list[str]:
    """Those that are ROS's."""
    return arguments[arguments.index("--ros-args"):] if "--ros-args" in arguments else []


def main(arguments: list[str]) -> int:
    usual = Limits()
    parser = argparse.ArgumentParser(prog="teletact_ros", description="An arm that speaks CRTK feels a scene.")
    parser.add_argument("--service", required=True, help="HOST:PORT or unix:/path")
    parser.add_argument("--scene", required=True)
    parser.add_argument("--arm", required=True, help="the namespace of its measured_cp and servo_cf, such as MTMR")
    parser.add_argument("--axes", default="x,y,z", help="which of the arm's axes moves the finger along the scene's"
                        " x, y and z; y goes into the tissue (--axes=x,-z,y)")
    parser.add_argument("--origin-m", type=float, nargs=3, default=[0.0, 0.0, 0.0], metavar=("X", "Y", "Z"),
                        help="where in the scene the arm's zero lies")
    parser.add_argument("--max-force-n", type=float, default=usual.force_n)
    parser.add_argument("--max-stiffness-n-m", type=float, default=usual.stiffness_n_m)
    parser.add_argument("--rate-hz", type=float, default=500.0, help="of servo_cf, 10 to 1000")
    parser.add_argument("--without-noise", action="store_true", help="the arm's positions have no noise: standing still"
                        " to the last bit is not a FAULT")
    parser.add_argument("--tls-ca")
    parser.add_argument("--token-file")
    given = parser.parse_args(remove_ros_args(arguments)[1:])
    if not 10 <= given.rate_hz <= 1000:
        parser.error(f"--rate-hz: {given.rate_hz}; give 10 to 1000")
    try:
        axes = Axes(given.axes, given.origin_m)
        limits = Limits(force_n=given.max_force_n, stiffness_n_m=given.max_stiffness_n_m)
    except ValueError as error:
        parser.error(str(error))
    # Signals are ours: rclpy's handler would end the context before the last zero force is out.
    rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
    signal.signal(signal.SIGTERM, lambda *_: signal.raise_signal(signal.SIGINT))
    watchdog = Watchdog([f"{given.arm}/{topic}" for topic in TOPICS], ros_arguments(arguments), time.monotonic())
    try:
        with teletact.connect(given.service, tls_ca=given.tls_ca, token_file=given.token_file) as service:
            bridge = Bridge(service.touch(given.scene, resume_s=math.inf), given.arm, axes, limits, given.rate_hz,
                            watchdog, has_noise=not given.without_noise)
            try:
                rclpy.spin(bridge)
            except KeyboardInterrupt:
                pass
            finally:
                bridge.close()
                bridge.destroy_node()
    except teletact.TeletactError as error:
        print(f"teletact_ros: {error}", file=sys.stderr)
        return 1
    finally:
        watchdog.close()
        rclpy.try_shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv))
