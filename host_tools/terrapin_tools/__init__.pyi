from terrapin_tools import errors as errors
from terrapin_tools.door.answer import Answer as Answer
from terrapin_tools.door.case import Case as Case
from terrapin_tools.door.effect import Effect as Effect
from terrapin_tools.door.link import Link as Link
from terrapin_tools.door.log import Log as Log
from terrapin_tools.door.robot import Robot as Robot
from terrapin_tools.door.session import Session as Session

__all__ = ["Answer", "Case", "Effect", "Link", "Log", "Robot", "Session", "errors"]
__version__: str
