"""The two hands: their names, in the order of everything that has a row for each, and their classes."""

from __future__ import annotations

from typing import Literal

Hand = Literal["left", "right"]
SIDES: tuple[Hand, Hand] = ("left", "right")
OTHER = {"left": "right", "right": "left"}
HAND_CLASS: dict[Hand, int] = {"left": 300, "right": 301}
"""EPIC noun classes v2: hand:left, hand:right"""
