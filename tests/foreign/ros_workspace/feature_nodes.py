"""Nodes as a user writes them: each program shows some features of rclpy in its log."""

import threading
import time
from threading import Thread

import numpy as np
import rclpy
from action_msgs.msg import GoalStatus
from builtin_interfaces.msg import Duration as DurationMsg
from geometry_msgs.msg import PoseStamped, TransformStamped, Twist
from nav2_msgs.action import NavigateToPose
from rcl_interfaces.msg import SetParametersResult
from rclpy.action import ActionClient, ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.duration import Duration
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from rclpy.time import Time
from std_msgs.msg import Bool, Float32, String
from std_srvs.srv import SetBool, Trigger
from tf2_ros import TransformException
from tf2_ros.buffer import Buffer
from tf2_ros.static_transform_broadcaster import StaticTransformBroadcaster
from tf2_ros.transform_broadcaster import TransformBroadcaster
from tf2_ros.transform_listener import TransformListener

COUNT = {"made": 0}  # a program has its own


def spun(make):
    """A program's usual main."""

    def main():
        rclpy.init()
        node = make()
        rclpy.spin(node)

    return main


# --- timers, topics ------------------------------------------------------------------------------


class Ticker(Node):
    def __init__(self):
        super().__init__("ticker")
        COUNT["made"] += 1
        self.get_logger().info(f"made {COUNT['made']}")
        self.out = self.create_publisher(String, "ticks", 10)
        self.timer = self.create_timer(0.1, self.tick)
        self.number = 0

    def tick(self):
        self.number += 1
        self.out.publish(String(data=f"{self.number} at {self.get_clock().now().nanoseconds}"))
        if self.number == 5:
            self.timer.cancel()


class Listener(Node):
    def __init__(self):
        super().__init__("listener")
        self.create_subscription(String, "/ticks", self.hear, 10)

    def hear(self, message):
        self.get_logger().info(f"heard {message.data}")


ticker, listener = spun(Ticker), spun(Listener)


class Sleeper(Node):
    """Sleeps through ticks: messages wait, as many as the depth, and timers skip."""

    def __init__(self):
        super().__init__("sleeper")
        self.create_subscription(String, "ticks", self.hear, 2)
        self.create_timer(0.1, self.tick)

    def hear(self, message):
        self.get_logger().info(f"{time.time():.2f} {message.data.split()[0]}")
        if message.data.startswith("1 "):
            time.sleep(0.35)

    def tick(self):
        self.get_logger().info(f"{time.monotonic():.2f} tick")


sleeper = spun(Sleeper)


class Latched(Node):
    def __init__(self):
        super().__init__("latched")
        qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.out = self.create_publisher(Float32, "latched", qos)
        self.out.publish(Float32(data=0.1))
        self.out.publish(Float32(data=0.2))


class Late(Node):
    def __init__(self):
        super().__init__("late")
        self.create_timer(1.0, self.subscribe)
        self.heard = False

    def subscribe(self):
        if self.heard:
            return
        self.heard = True
        qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.create_subscription(Float32, "latched", lambda m: self.say("durable", m), qos)
        self.create_subscription(Float32, "latched", lambda m: self.say("volatile", m), 1)
        self.create_subscription(Bool, "latched", lambda m: self.say("other type", m), 1)

    def say(self, kind, message):
        self.get_logger().info(f"{kind} {message.data!r}")


latched, late = spun(Latched), spun(Late)


class Fussy(Node):
    def __init__(self):
        super().__init__("fussy")
        self.create_publisher(String, "scans", qos_profile_sensor_data)
        self.create_subscription(
            String, "scans", print, QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
        )


fussy = spun(Fussy)

# --- services ------------------------------------------------------------------------------------


class Server(Node):
    def __init__(self):
        super().__init__("server")
        self.create_service(SetBool, "~/set", self.set)

    def set(self, request, response):
        response.success, response.message = request.data, "as asked"
        return response


def asking():
    """A program that waits for its answer before it spins."""
    rclpy.init()
    node = Node("asking")
    client = node.create_client(SetBool, "/server/set")
    nobody = node.create_client(Trigger, "/nobody")
    assert not nobody.wait_for_service(timeout_sec=0.01)
    assert client.wait_for_service()
    future = client.call_async(SetBool.Request(data=True))
    rclpy.spin_until_future_complete(node, future)
    node.get_logger().info(f"{future.result().success} {future.result().message}")
    future = nobody.call_async(Trigger.Request())
    rclpy.spin_until_future_complete(node, future, timeout_sec=0.5)
    node.get_logger().info(f"nobody {future.done()} {node.get_clock().now().nanoseconds}")


class Blocked(Node):
    """Asks and waits inside a callback, which nobody can answer on one thread."""

    def __init__(self, group):
        super().__init__("blocked")
        self.client = self.create_client(SetBool, "/server/set", callback_group=group)
        self.timer = self.create_timer(0.2, self.ask)

    def ask(self):
        self.timer.cancel()
        self.get_logger().info("asks")
        answer = self.client.call(SetBool.Request(data=True))
        self.get_logger().info(f"got {answer.message}")


def blocked():
    rclpy.init()
    rclpy.spin(Blocked(None))


def unblocked():
    rclpy.init()
    executor = MultiThreadedExecutor()
    executor.add_node(Blocked(MutuallyExclusiveCallbackGroup()))
    executor.spin()


class Coroutines(Node):
    def __init__(self):
        super().__init__("coroutines")
        self.client = self.create_client(SetBool, "/server/set")
        self.timer = self.create_timer(0.2, self.ask)

    async def ask(self):
        self.timer.cancel()
        answer = await self.client.call_async(SetBool.Request(data=False))
        self.get_logger().info(f"awaited {answer.success}")


server, coroutines = spun(Server), spun(Coroutines)

# --- callback groups -----------------------------------------------------------------------------


class Busy(Node):
    def __init__(self, group):
        super().__init__("busy")
        self.running = 0
        for _ in range(2):
            self.create_timer(0.5, self.work, callback_group=group)

    def work(self):
        self.running += 1
        time.sleep(0.1)
        self.get_logger().info(f"{time.time():.1f} {self.running} at once")
        self.running -= 1


def _busy(group):
    rclpy.init()
    executor = MultiThreadedExecutor(num_threads=4)
    executor.add_node(Busy(group))
    executor.spin()


def exclusive():
    _busy(None)


def reentrant():
    _busy(ReentrantCallbackGroup())


# --- actions -------------------------------------------------------------------------------------


class Drives(Node):
    def __init__(self):
        super().__init__("drives")
        group = ReentrantCallbackGroup()
        ActionServer(
            self,
            NavigateToPose,
            "navigate_to_pose",
            self.drive,
            goal_callback=self.accepts,
            cancel_callback=lambda goal: CancelResponse.ACCEPT,
            callback_group=group,
        )

    def accepts(self, goal):
        is_there = goal.pose.pose.position.x >= 0.0
        return GoalResponse.ACCEPT if is_there else GoalResponse.REJECT

    def drive(self, goal):
        for left in range(3, 0, -1):
            if goal.is_cancel_requested:
                goal.canceled()
                return NavigateToPose.Result()
            goal.publish_feedback(NavigateToPose.Feedback(distance_remaining=float(left)))
            time.sleep(0.5)
        goal.succeed()
        return NavigateToPose.Result()


def drives():
    rclpy.init()
    executor = MultiThreadedExecutor()
    executor.add_node(Drives())
    executor.spin()


class Sends(Node):
    def __init__(self, x, cancels):
        super().__init__("sends")
        self.client = ActionClient(self, NavigateToPose, "navigate_to_pose")
        self.x, self.cancels = x, cancels
        self.timer = self.create_timer(0.1, self.send)

    def send(self):
        self.timer.cancel()
        self.client.wait_for_server()
        goal = NavigateToPose.Goal(pose=PoseStamped())
        goal.pose.pose.position.x = self.x
        self.client.send_goal_async(goal, self.feedback).add_done_callback(self.accepted)

    def feedback(self, message):
        self.get_logger().info(f"{message.feedback.distance_remaining} m left")

    def accepted(self, future):
        handle = future.result()
        self.get_logger().info(f"accepted {handle.accepted}")
        if not handle.accepted:
            return
        handle.get_result_async().add_done_callback(self.ended)
        if self.cancels:
            self.once = self.create_timer(0.7, lambda: self.cancel(handle))

    def cancel(self, handle):
        self.once.cancel()
        handle.cancel_goal_async()

    def ended(self, future):
        status = future.result().status
        name = {4: "succeeded", 5: "canceled"}[status]
        assert status in (GoalStatus.STATUS_SUCCEEDED, GoalStatus.STATUS_CANCELED)
        self.get_logger().info(f"{name} at {time.time():.1f}")


sends = spun(lambda: Sends(1.0, cancels=False))
cancels = spun(lambda: Sends(1.0, cancels=True))
refused = spun(lambda: Sends(-1.0, cancels=False))

# --- parameters, names ---------------------------------------------------------------------------


class Configured(Node):
    def __init__(self):
        super().__init__("configured")
        say = self.get_logger().info
        self.declare_parameter("gain", 1.0)
        self.declare_parameter("names", rclpy.Parameter.Type.STRING_ARRAY)
        self.declare_parameters("limits", [("speed", 0.5), ("turn", 1.0)])
        say(f"{self.get_parameter('gain').value} {self.get_parameter('names').value}")
        say(f"{[p.value for p in self.get_parameters_by_prefix('limits').values()]}")
        self.add_on_set_parameters_callback(self.check)
        for value in (2.0, -1.0, "fast"):
            result = self.set_parameters([Parameter("gain", value=value)])[0]
            say(f"{value} {result.successful} {self.get_parameter('gain').value}")
        try:
            self.get_parameter("unknown")
        except Exception as error:
            say(type(error).__name__)
        say(self.resolve_topic_name("scan"))
        say(self.resolve_topic_name("~/state"))
        say(self.get_fully_qualified_name())

    def check(self, parameters):
        return SetParametersResult(successful=all(p.value > 0.0 for p in parameters))


configured = spun(Configured)

# --- tf2 -----------------------------------------------------------------------------------------


class Sender(Node):
    def __init__(self):
        super().__init__("sender")
        fixed = TransformStamped(child_frame_id="odom")
        fixed.header.frame_id = "map"
        fixed.transform.translation.x = 10.0
        StaticTransformBroadcaster(self).sendTransform(fixed)
        self.moving = TransformBroadcaster(self)
        self.create_timer(0.1, self.send)

    def send(self):
        now = self.get_clock().now()
        made = TransformStamped(child_frame_id="base_link")
        made.header.frame_id, made.header.stamp = "odom", now.to_msg()
        made.transform.translation.x = now.nanoseconds * 1e-9
        made.transform.rotation.z = made.transform.rotation.w = float(np.sqrt(0.5))
        self.moving.sendTransform(made)


class LooksUp(Node):
    def __init__(self):
        super().__init__("looks_up")
        self.buffer = Buffer()
        self.listener = TransformListener(self.buffer, self)
        self.create_timer(0.25, self.look)

    def look(self):
        say = self.get_logger().info
        try:
            now = self.buffer.lookup_transform("map", "base_link", Time())
            past = Time.from_msg(now.header.stamp) - Duration(seconds=0.05)
            old = self.buffer.lookup_transform("map", "base_link", past)
            back = self.buffer.lookup_transform("base_link", "map", Time())
        except TransformException as error:
            say(type(error).__name__)
            return
        x, y = now.transform.translation.x, back.transform.translation.y
        say(f"{x:.2f} {old.transform.translation.x:.2f} {y:.2f}")
        for frame, time_ in (("nowhere", Time()), ("base_link", Time(seconds=99.0))):
            try:
                self.buffer.lookup_transform("map", frame, time_)
            except TransformException as error:
                say(type(error).__name__)


sender, looks_up = spun(Sender), spun(LooksUp)

# --- threads, scripts ----------------------------------------------------------------------------


def threaded():
    """The main thread works while another one spins."""
    rclpy.init()
    node = rclpy.create_node("threaded")
    heard = threading.Event()
    node.create_subscription(String, "ticks", lambda message: heard.set(), 10)
    Thread(target=rclpy.spin, args=(node,), daemon=True).start()
    rate = node.create_rate(4)
    for _ in range(2):
        rate.sleep()
        node.get_logger().info(f"{time.time():.2f} {heard.wait(0.0)}")
    rclpy.shutdown()
    node.get_logger().info(f"ok {rclpy.ok()}")


def polling():
    """A loop that never waits."""
    rclpy.init()
    node = rclpy.create_node("polling")
    node.create_subscription(String, "ticks", lambda m: node.get_logger().info(m.data), 10)
    while rclpy.ok():
        rclpy.spin_once(node, timeout_sec=0)
        time.sleep(0)


def two_nodes():
    rclpy.init()
    executor = SingleThreadedExecutor()
    for node in (Ticker(), Listener()):
        executor.add_node(node)
    executor.spin()


# --- what goes wrong -----------------------------------------------------------------------------


class Broken(Node):
    def __init__(self):
        super().__init__("broken")
        self.create_timer(0.5, lambda: {}["left"])


class WrongType(Node):
    def __init__(self):
        super().__init__("wrong_type")
        self.create_publisher(Twist, "cmd_vel", 1).publish(String())


class IntForFloat(Node):
    def __init__(self):
        super().__init__("int_for_float")
        Twist().linear.x = 1


class Asks(Node):
    def __init__(self):
        super().__init__("asks")
        self.get_publishers_info_by_topic("/ticks")


def imports():
    import rclpy.lifecycle  # noqa: F401


def uses_lock():
    threading.Barrier(2)


broken, wrong_type, int_for_float, asks = (
    spun(kind) for kind in (Broken, WrongType, IntForFloat, Asks)
)
SPAN = DurationMsg(sec=1)
