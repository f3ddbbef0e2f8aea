"""Control laws for reaction wheels, chosen by name: one protocol, one law per file."""

from swarm_mj.attitude.controllers.base import ControlInput, Controller
from swarm_mj.attitude.controllers.feedback import MrpFeedback
from swarm_mj.attitude.controllers.sliding_mode import MrpSlidingMode

__all__ = ["ControlInput", "Controller", "MrpFeedback", "MrpSlidingMode"]
