"""The modules that the user's nodes import: ``rclpy``, ``tf2_ros``, messages, and a few more."""

from __future__ import annotations

from importlib.abc import Loader
from importlib.machinery import ModuleSpec
from types import ModuleType
from typing import Any

from simulator_interface.foreign.ros_nodes import (
    executing,
    futures,
    navigator,
    quality,
    rclpy_functions,
    ros_action_client,
    ros_action_server,
    ros_graph,
    ros_logging,
    ros_node,
    ros_parameters,
    ros_services,
    ros_time,
    transforms,
)
from simulator_interface.foreign.ros_nodes.missing import refusing
from simulator_interface.foreign.ros_nodes.ros_messages import DEFINITIONS, interface_module

FOLDERS = ("msg", "srv", "action")
_TIME = "Time Duration Clock ROSClock ClockType Timer Rate"
_TF = (
    "Buffer TransformListener TransformBroadcaster StaticTransformBroadcaster TransformException "
    "LookupException ConnectivityException ExtrapolationException InvalidArgumentException "
    "TimeoutException"
)
_RCLPY = (
    "init ok shutdown try_shutdown create_node spin spin_once spin_until_future_complete "
    "get_default_context get_global_executor Context"
)
_ERRORS = (
    "ParameterException ParameterNotDeclaredException ParameterAlreadyDeclaredException "
    "ParameterUninitializedException InvalidParameterTypeException InvalidParameterValueException"
)
_QOS = (
    "HistoryPolicy ReliabilityPolicy DurabilityPolicy LivelinessPolicy QoSHistoryPolicy "
    "QoSReliabilityPolicy QoSDurabilityPolicy QoSLivelinessPolicy QoSProfile QoSPresetProfiles "
    "qos_profile_sensor_data qos_profile_system_default qos_profile_services_default "
    "qos_profile_parameters qos_profile_parameter_events qos_profile_action_status_default"
)
_SERVER = (
    "ActionServer GoalResponse CancelResponse ServerGoalHandle GoalStatus default_goal_callback "
    "default_cancel_callback default_handle_accepted_callback"
)
#: modules by name, and what each has: names, and where they are defined
MODULES: dict[str, dict[str, ModuleType]] = {
    "rclpy": {_RCLPY: rclpy_functions, "Parameter": ros_parameters},
    "rclpy.action": {
        "ActionServer GoalResponse CancelResponse": ros_action_server,
        "ActionClient": ros_action_client,
    },
    "rclpy.action.client": {
        "ActionClient ClientGoalHandle": ros_action_client,
        "GoalStatus": ros_action_server,
    },
    "rclpy.action.server": {_SERVER: ros_action_server},
    "rclpy.callback_groups": {
        "CallbackGroup MutuallyExclusiveCallbackGroup ReentrantCallbackGroup": executing,
    },
    "rclpy.client": {"Client": ros_services},
    "rclpy.clock": {_TIME: ros_time},
    "rclpy.context": {"Context": rclpy_functions},
    "rclpy.duration": {"Duration": ros_time},
    "rclpy.exceptions": {_ERRORS: ros_parameters, "ROSInterruptException": executing},
    "rclpy.executors": {
        "Executor SingleThreadedExecutor MultiThreadedExecutor ExternalShutdownException "
        "ShutdownException TimeoutException": executing,
    },
    "rclpy.logging": {"LoggingSeverity": ros_logging, "get_logger": rclpy_functions},
    "rclpy.node": {"Node": ros_node, "Parameter": ros_parameters},
    "rclpy.parameter": {"Parameter": ros_parameters},
    "rclpy.publisher": {"Publisher": ros_graph},
    "rclpy.qos": {_QOS: quality, "Duration": ros_time},
    "rclpy.service": {"Service": ros_services},
    "rclpy.subscription": {"Subscription": ros_graph},
    "rclpy.task": {"Future Task": futures},
    "rclpy.time": {_TIME: ros_time},
    "rclpy.timer": {"Timer Rate": ros_time},
    "rclpy.utilities": {"remove_ros_args ok get_default_context": rclpy_functions},
    "nav2_simple_commander": {},
    "nav2_simple_commander.robot_navigator": {"BasicNavigator TaskResult": navigator},
    "tf2_ros": {_TF: transforms},
    "tf2_ros.buffer": {_TF: transforms},
    "tf2_ros.static_transform_broadcaster": {"StaticTransformBroadcaster": transforms},
    "tf2_ros.transform_broadcaster": {"TransformBroadcaster": transforms},
    "tf2_ros.transform_listener": {"TransformListener": transforms},
}


def _members(name: str) -> dict[str, Any]:
    return {
        member: getattr(source, member)
        for members, source in MODULES[name].items()
        for member in members.split()
    }


class StandIns(Loader):
    """Finds the modules of this file, and of message packages; for ``sys.meta_path``."""

    def __init__(self) -> None:
        self._packages = DEFINITIONS.packages()  # not later: to read them, modules are imported

    def find_spec(self, fullname: str, path: Any = None, target: Any = None) -> ModuleSpec | None:
        """Find a module; None: it is none of these, or a real one is needed."""
        top, _, rest = fullname.partition(".")
        if fullname in MODULES or top in MODULES:
            return ModuleSpec(fullname, self, is_package=True)
        if rest in ("", *FOLDERS) and top in self._packages:
            return ModuleSpec(fullname, self, is_package=True)
        return None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        """Make a module.

        Raises:
            ImportError: there is no such module of a package that is stood in for.
        """
        name = spec.name
        if name in MODULES:
            return refusing(name, _members(name), MODULES)
        top, _, rest = name.partition(".")
        if top in MODULES:
            raise ImportError(f"the stand-in for ROS 2 has no module {name}", name=name)
        return interface_module(top, rest) if rest else refusing(name, {}, ())

    def exec_module(self, module: ModuleType) -> None:
        """Do nothing more."""
