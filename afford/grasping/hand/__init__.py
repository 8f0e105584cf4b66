"""Robot hands: description files, joints, coupled joints, kinematics."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Urdf:
    """Parameters of the backend `urdf`: facts that a URDF may omit."""

    fingers: tuple[str, ...] = ()
    """finger=last link of thumb, index, middle, ring, little, for links whose names do not say it"""
    coupled: tuple[str, ...] = ()
    """follower=driver for joints that have neither a motor nor a <mimic>"""
