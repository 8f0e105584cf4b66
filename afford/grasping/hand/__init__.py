"""The robot hand: description files, joints, coupling, kinematics."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Urdf:
    """Parameters of `urdf`: what a description file may leave open."""

    fingers: tuple[str, ...] = ()
    """finger=last link of thumb, index, middle, ring, little, where names of links do not tell"""
    coupled: tuple[str, ...] = ()
    """follower=driver of joints without a motor that have no <mimic>"""
