"""The walking law and its loop, Eqs. (29)-(31) and Fig. 4: gains, sensing, plants."""

from typing import TYPE_CHECKING

from ..lazy import exports_of

if TYPE_CHECKING:
    from .filters import low_pass_coefficient as low_pass_coefficient
    from .filters import servo_response as servo_response
    from .gains import PAPER_GAINS as PAPER_GAINS
    from .gains import Gains as Gains
    from .gains import Pair as Pair
    from .guard import GUARD as GUARD
    from .guard import WALKS as WALKS
    from .guard import WATCH as WATCH
    from .guard import End as End
    from .guard import Outcome as Outcome
    from .guard import Watch as Watch
    from .guard import check_fall as check_fall
    from .guard import check_sensors as check_sensors
    from .guard import com_diverged as com_diverged
    from .guard import completed as completed
    from .guard import contact_lost as contact_lost
    from .guard import guard_of as guard_of
    from .guard import interrupted as interrupted
    from .guard import outcome_of as outcome_of
    from .guard import sensor_failed as sensor_failed
    from .guard import tilted as tilted
    from .guard import usual_watch as usual_watch
    from .law import LAW as LAW
    from .law import LAW_STATE as LAW_STATE
    from .law import Controller as Controller
    from .law import ControlOutput as ControlOutput
    from .law import ControlSettings as ControlSettings
    from .law import Value as Value
    from .law import WalkingController as WalkingController
    from .law import apply_law as apply_law
    from .loop import PROGRESS_ROWS as PROGRESS_ROWS
    from .loop import Body as Body
    from .loop import Link as Link
    from .loop import PointBody as PointBody
    from .loop import Progress as Progress
    from .loop import Tick as Tick
    from .loop import Walkable as Walkable
    from .loop import check_plant as check_plant
    from .loop import walk as walk
    from .payload import RISE_TIME as RISE_TIME
    from .payload import WEIGHING_TIME as WEIGHING_TIME
    from .payload import weigh_standing as weigh_standing
    from .plant import Actuation as Actuation
    from .plant import Command as Command
    from .plant import Disturbance as Disturbance
    from .plant import JointServos as JointServos
    from .plant import PendulumPlant as PendulumPlant
    from .plant import Plant as Plant
    from .plant import Sensors as Sensors
    from .plant import no_disturbance as no_disturbance
    from .plant import random_bounded as random_bounded
    from .sensing import Contact as Contact
    from .sensing import Measurement as Measurement
    from .sensing import zmp_from_wrenches as zmp_from_wrenches
    from .settings import GROUND_SENSORS as GROUND_SENSORS
    from .settings import BodySettings as BodySettings
    from .settings import Control as Control
    from .settings import Push as Push
    from .settings import SimulatorSettings as SimulatorSettings

__getattr__, __dir__ = exports_of(__name__, __file__)
