"""Control laws for reaction wheels, chosen by name: one protocol, one law per file."""

from swarm_mj.spacecraft.control.base import ControlInput, Controller
from swarm_mj.spacecraft.control.feedback import MrpFeedback
from swarm_mj.spacecraft.control.sliding_mode import MrpSlidingMode

__all__ = ["ControlInput", "Controller", "MrpFeedback", "MrpSlidingMode"]
