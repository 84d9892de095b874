"""As much of ROS 2 as the bridge uses, written from its published interfaces; ROS is not packaged by Debian 12.

Messages take no field and no type that the real ones do not have.
"""

import dataclasses
import sys
import types


class Message:
    """Raises where a field does not exist, or has another type, as rclpy's messages do."""

    FIELDS = {}

    def __init__(self):
        for name, kind in self.FIELDS.items():
            object.__setattr__(self, name, kind())

    def __setattr__(self, name, value):
        assert name in self.FIELDS, f"{type(self).__name__} has no field {name}"
        assert type(value) is self.FIELDS[name], f"{type(self).__name__}.{name}: {value!r}"
        object.__setattr__(self, name, value)


def message(name, **fields):
    return type(name, (Message,), {"FIELDS": fields})


Time = message("Time", sec=int, nanosec=int)
Header = message("Header", stamp=Time, frame_id=str)
Vector = message("Vector3", x=float, y=float, z=float)
Pose = message("Pose", position=Vector, orientation=message("Quaternion", x=float, y=float, z=float, w=float))
PoseStamped = message("PoseStamped", header=Header, pose=Pose)
Wrench = message("Wrench", force=Vector, torque=Vector)
WrenchStamped = message("WrenchStamped", header=Header, wrench=Wrench)
OperatingState = message("OperatingState", header=Header, state=str, is_homed=bool, is_busy=bool)
StringStamped = message("StringStamped", header=Header, string=str)


@dataclasses.dataclass
class Publisher:
    kind: type
    sent: list = dataclasses.field(default_factory=list)

    def publish(self, value):
        assert type(value) is self.kind
        assert Ros.up, "published after the context was shut down"
        self.sent.append(value)


class Node:
    def __init__(self, name):
        self.name, self.publishers, self.heard, self.timers, self.logged = name, {}, {}, [], []
        Ros.nodes.append(self)

    def _name(self, topic):
        return topic.replace("~", self.name)

    def create_publisher(self, kind, topic, qos):
        return self.publishers.setdefault(self._name(topic), Publisher(kind))

    def create_subscription(self, kind, topic, callback, qos):
        self.heard[self._name(topic)] = (kind, callback)

    def create_timer(self, period_s, callback):
        self.timers.append((period_s, callback))

    def get_clock(self):
        return types.SimpleNamespace(now=lambda: types.SimpleNamespace(to_msg=Time))

    def get_logger(self):
        return types.SimpleNamespace(warning=self.logged.append)

    def destroy_node(self):
        Ros.nodes.remove(self)

    # What other nodes would do.

    def tell(self, topic, value):
        kind, callback = self.heard[topic]
        assert type(value) is kind
        callback(value)

    def tick(self):
        for _, callback in self.timers:
            callback()


class Ros:
    """The context of this process."""

    up = False
    nodes = []
    spin = staticmethod(lambda node: None)  # a test puts another there

    @classmethod
    def init(cls, args=None, signal_handler_options=None):
        assert signal_handler_options == "NO"
        cls.up = True

    @classmethod
    def try_shutdown(cls):
        cls.up = False


def install():
    """Puts them where the bridge imports them from."""
    def module(name, **names):
        sys.modules[name] = types.ModuleType(name)
        vars(sys.modules[name]).update(names)

    module("rclpy", init=Ros.init, try_shutdown=Ros.try_shutdown, spin=lambda node: Ros.spin(node))
    module("rclpy.node", Node=Node)
    module("rclpy.qos", qos_profile_sensor_data="best effort")
    module("rclpy.signals", SignalHandlerOptions=types.SimpleNamespace(NO="NO"))
    module("rclpy.utilities", remove_ros_args=lambda args: args[:args.index("--ros-args")] if "--ros-args" in args else args)
    module("geometry_msgs")
    module("geometry_msgs.msg", PoseStamped=PoseStamped, WrenchStamped=WrenchStamped)
    module("crtk_msgs")
    module("crtk_msgs.msg", OperatingState=OperatingState, StringStamped=StringStamped)
