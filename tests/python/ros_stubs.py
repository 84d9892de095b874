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
Bool = message("Bool", data=bool)
Twist = message("Twist", linear=Vector, angular=Vector)
TwistStamped = message("TwistStamped", header=Header, twist=Twist)


@dataclasses.dataclass
class QoSProfile:
    depth: int
    durability: str
    reliability: str


@dataclasses.dataclass
class Publisher:
    kind: type
    topic: str
    sent: list = dataclasses.field(default_factory=list)

    def publish(self, value):
        assert type(value) is self.kind
        assert Ros.up, "published after the context was shut down"
        self.sent.append(value)
        for take in Ros.listeners.get(self.topic, []):
            take(value)

    def get_subscription_count(self):
        return len(Ros.listeners.get(self.topic, []))


class Node:
    def __init__(self, name):
        self.name, self.publishers, self.heard, self.heard_with, self.timers, self.logged = name, {}, {}, {}, [], []
        Ros.nodes.append(self)

    def _name(self, topic):
        return topic.replace("~", self.name)

    def create_publisher(self, kind, topic, qos):
        return self.publishers.setdefault(self._name(topic), Publisher(kind, self._name(topic)))

    def create_subscription(self, kind, topic, callback, qos):
        self.heard[self._name(topic)] = (kind, callback)
        self.heard_with[self._name(topic)] = qos

    def get_topic_names_and_types(self):
        return [(topic, [kind]) for topic, (kind, *_) in Ros.topics.items()]

    def get_publishers_info_by_topic(self, topic):
        found = [offer for name, (_, *offer) in Ros.topics.items() if name.lstrip("/") == topic.lstrip("/")]
        return [types.SimpleNamespace(qos_profile=QoSProfile(0, *offer)) for offer in found]

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
    listeners = {}  # of other nodes: those that are called with what is published, by topic
    topics = {}     # of other nodes: type, durability and reliability, by name
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
    module("rclpy.qos", QoSProfile=QoSProfile, qos_profile_sensor_data="best effort")
    module("rclpy.signals", SignalHandlerOptions=types.SimpleNamespace(NO="NO"))
    module("rclpy.utilities", remove_ros_args=lambda args: args[:args.index("--ros-args")] if "--ros-args" in args else args)
    module("geometry_msgs")
    module("geometry_msgs.msg", PoseStamped=PoseStamped, TwistStamped=TwistStamped, WrenchStamped=WrenchStamped)
    module("std_msgs")
    module("std_msgs.msg", Bool=Bool)
    module("crtk_msgs")
    module("crtk_msgs.msg", OperatingState=OperatingState, StringStamped=StringStamped)
