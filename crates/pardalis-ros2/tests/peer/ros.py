"""A node of ROS 2 without ROS: CycloneDDS with the message definitions of the package rosbags."""

import os
from pathlib import Path

# Over the loopback interface alone, which knows no multicast.
os.environ["CYCLONEDDS_URI"] = """<CycloneDDS><Domain>
<General><AllowMulticast>false</AllowMulticast><Interfaces><NetworkInterface name="lo"/></Interfaces></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>30</MaxAutoParticipantIndex>
<Peers><Peer address="127.0.0.1"/></Peers></Discovery></Domain></CycloneDDS>"""

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import make_idl_struct, types
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

# Of vision_msgs 4.1, which is no part of ROS itself.
VISION = {
    "ObjectHypothesis": "string class_id\nfloat64 score\n",
    "ObjectHypothesisWithPose": "vision_msgs/ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose\n",
    "Point2D": "float64 x\nfloat64 y\n",
    "Pose2D": "vision_msgs/Point2D position\nfloat64 theta\n",
    "BoundingBox2D": "vision_msgs/Pose2D center\nfloat64 size_x\nfloat64 size_y\n",
    "Detection2D": "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\nvision_msgs/BoundingBox2D bbox\nstring id\n",
    "Detection2DArray": "std_msgs/Header header\nvision_msgs/Detection2D[] detections\n",
    "BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size\n",
    "Detection3D": "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\nvision_msgs/BoundingBox3D bbox\nstring id\n",
    "Detection3DArray": "std_msgs/Header header\nvision_msgs/Detection3D[] detections\n",
}
STORE = get_typestore(Stores.ROS2_HUMBLE)
for name, text in VISION.items():
    STORE.register(get_types_from_msg(text, f"vision_msgs/msg/{name}"))

BASIC = {
    "bool": bool,
    "string": str,
    "byte": types.uint8,
    **{name: getattr(types, name) for name in "int8 uint8 int16 uint16 int32 uint32 int64 uint64 float32 float64".split()},
}
made = {}


def message(name):
    """The class of a message, such as "sensor_msgs/msg/Image"."""
    if name in made:
        return made[name]

    def type_of(definition):
        kind, of = definition
        if kind.name == "BASE":
            return BASIC[of[0]]
        if kind.name == "NAME":
            return message(of)
        element, length = of
        return types.array[type_of(element), length] if kind.name == "ARRAY" else types.sequence[type_of(element)]

    fields = {field: type_of(definition) for field, definition in STORE.fielddefs[name][1]}
    package, _, short = name.split("/")
    # Under the name by which ROS knows it.
    made[name] = make_idl_struct(short, f"{package}::msg::dds_::{short}_", fields)
    return made[name]


RELIABLE = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(30), Policy.Durability.Volatile)
LATCHED = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepLast(1), Policy.Durability.TransientLocal)
SENSOR = Qos(Policy.Reliability.BestEffort, Policy.History.KeepLast(5), Policy.Durability.Volatile)


class Peer:
    """Publishes and subscribes."""

    def __init__(self, domain):
        self.participant = DomainParticipant(domain)

    def publisher(self, topic, name, qos=RELIABLE):
        return DataWriter(self.participant, Topic(self.participant, f"rt{topic}", message(name), qos=qos), qos=qos)

    def subscription(self, topic, name, qos=RELIABLE):
        return DataReader(self.participant, Topic(self.participant, f"rt{topic}", message(name), qos=qos), qos=qos)


def stamp(ns):
    return message("builtin_interfaces/msg/Time")(sec=ns // 10**9, nanosec=ns % 10**9)


def header(ns, frame_id="lens"):
    return message("std_msgs/msg/Header")(stamp=stamp(ns), frame_id=frame_id)


def nanoseconds(header):
    return header.stamp.sec * 10**9 + header.stamp.nanosec


DATA = Path(__file__).resolve().parents[4] / "data"
