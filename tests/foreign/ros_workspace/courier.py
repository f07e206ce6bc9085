"""A courier as a user writes one: takes its robot's tasks in turn, plans, follows, claims stops."""

import json
import math

import rclpy
from geometry_msgs.msg import PoseStamped, Twist
from nav2_simple_commander.robot_navigator import BasicNavigator
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

REACHED = 0.3  # m
STANDS = 0.02  # m/s


class Courier(Node):
    def __init__(self):
        super().__init__("courier")
        self.robot = self.declare_parameter("robot", "").value
        self.gain = self.declare_parameter("gain", 1.5).value
        self.navigator = BasicNavigator()
        self.stops, self.path, self.pose = [], [], None
        self.speed = 0.0
        latched = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.create_subscription(String, "/tasks", self.hear_task, latched)
        self.create_subscription(Odometry, "odom", self.hear_pose, 10)
        self.command = self.create_publisher(Twist, "cmd_vel", 10)
        self.goal = self.create_publisher(PoseStamped, "goal_pose", 10)
        self.events = self.create_publisher(String, "/events", 10)
        self.create_timer(0.1, self.drive)

    def hear_task(self, message):
        task = json.loads(message.data)
        if task["robot"] in ("", self.robot):
            self.stops.append((task["task"], "picked-up", task["start_point"]))
            self.stops.append((task["task"], "dropped-off", task["end_point"]))

    def hear_pose(self, message):
        turn = message.pose.pose.orientation
        place = message.pose.pose.position
        self.pose = place.x, place.y, 2.0 * math.atan2(turn.z, turn.w)
        self.speed = abs(message.twist.twist.linear.x)

    def drive(self):
        if self.pose is None or not self.stops:
            return
        x, y, yaw = self.pose
        task, kind, stop = self.stops[0]
        if math.dist((x, y), stop) < REACHED:
            self.command.publish(Twist())
            if self.speed > STANDS:
                return
            self.events.publish(
                String(data=json.dumps({"kind": kind, "robot": self.robot, "task": task}))
            )
            self.stops.pop(0)
            self.path = []
            return
        if not self.path:
            self.plan(stop)
        while len(self.path) > 1 and math.dist((x, y), self.path[0]) < 2 * REACHED:
            self.path.pop(0)
        ahead = self.path[0] if self.path else stop
        error = math.atan2(ahead[1] - y, ahead[0] - x) - yaw
        error = math.atan2(math.sin(error), math.cos(error))
        twist = Twist()
        twist.angular.z = self.gain * error
        twist.linear.x = 0.4 * max(0.0, math.cos(error))
        self.command.publish(twist)

    def plan(self, stop):
        ends = []
        for point in (self.pose, stop):
            pose = PoseStamped()
            pose.header.frame_id = "map"
            pose.pose.position.x, pose.pose.position.y = float(point[0]), float(point[1])
            ends.append(pose)
        self.goal.publish(ends[1])
        path = self.navigator.getPath(*ends)
        self.path = [(p.pose.position.x, p.pose.position.y) for p in path.poses] if path else []


def main(args=None):
    rclpy.init(args=args)
    node = Courier()
    rclpy.spin(node)
    node.destroy_node()
    rclpy.shutdown()
