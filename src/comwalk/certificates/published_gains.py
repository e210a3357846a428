"""Gains of the paper's law that others have published, with their sources.

The robots of the iCub family run this law as the last layer of
robotology/walking-controllers: k_ZMP and k_CoM of the files `zmpControllerParams.ini`
under `app/robots/<robot>/dcm_walking/`, the same for both axes, without a ZMP filter.
On some of them an outer loop moves the ZMP reference, which is not counted here.
"""

from __future__ import annotations

from typing import NamedTuple

from ..pattern import PAPER_PENDULUM, Pendulum

_WALKING_CONTROLLERS = "robotology/walking-controllers, app/robots"
_FRJOCO = "CheolMin-Yoon/FrJoCo, python/DCM_v2/config.py"


class PublishedGains(NamedTuple):
    """A published pair of gains."""

    robot: str
    """Whose they are."""
    use: str
    """What for."""
    k_p: float
    """ZMP gain [1/s]."""
    k_c: float
    """CoM gain [1/s]."""
    height: float
    """CoM height [m]."""
    source: str
    """Where they are published."""

    @property
    def pendulum(self) -> Pendulum:
        """The simplified model of that robot."""
        return Pendulum(height=self.height)


_PAPER = PAPER_PENDULUM.height, "Choi, Kim, You 2006, Section VI"
_ERGOCUB = 0.70, _WALKING_CONTROLLERS
_ICUB = 0.53, _WALKING_CONTROLLERS
_GENOVA_09 = 0.565, _WALKING_CONTROLLERS

PUBLISHED = (
    PublishedGains("the paper", "x", 3.0, 6.6, *_PAPER),
    PublishedGains("the paper", "y", 1.8, 3.8, *_PAPER),
    PublishedGains("ergoCubSN000", "walking", 1.8, 5.0, *_ERGOCUB),
    PublishedGains("ergoCubSN000", "standing", 0.5, 4.0, *_ERGOCUB),
    PublishedGains("ergoCubSN001", "walking", 1.3, 5.0, *_ERGOCUB),
    PublishedGains("ergoCubSN001", "standing", 0.1, 4.0, *_ERGOCUB),
    PublishedGains("ergoCubGazeboV1", "walking", 1.0, 3.0, *_ERGOCUB),
    PublishedGains("iCubGazeboV2_5", "walking", 3.5, 10.0, *_ICUB),
    PublishedGains("iCubGazeboV2_5", "standing", 0.9, 6.0, *_ICUB),
    PublishedGains("iCubGenova04, joypad", "walking", 3.5, 4.0, *_ICUB),
    PublishedGains("iCubGenova04, joypad", "standing", 0.9, 4.0, *_ICUB),
    PublishedGains("iCubGenova04, iFeel", "walking", 2.0, 10.0, *_ICUB),
    PublishedGains("iCubGenova09", "walking", 1.8, 5.0, *_GENOVA_09),
    PublishedGains("iCubGenova09", "standing", 0.5, 4.0, *_GENOVA_09),
    PublishedGains("G1, FrJoCo", "walking", 10.0, 1.0, 0.6846, _FRJOCO),
)
"""Published gains; CoM heights of the iCub family are nominal ones."""
