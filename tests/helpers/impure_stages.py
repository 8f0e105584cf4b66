"""Stages that are not pure, each in its own way: what test_purity must catch."""

from __future__ import annotations

import ctypes
import dataclasses
import datetime
import os
import random
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from schemas.video import Clip


@dataclass(frozen=True)
class Params:
    """Parameters of a stage without any."""


def environment(clip: Clip, params: Params) -> Clip:
    return _with(clip, os.environ.get("HOME"))


def working_directory(clip: Clip, params: Params) -> Clip:
    return _with(clip, Path.cwd())


def clock(clip: Clip, params: Params) -> Clip:
    return _with(clip, time.time() // 1e6)


def calendar(clip: Clip, params: Params) -> Clip:
    return _with(clip, datetime.date.today().year)


def random_state(clip: Clip, params: Params) -> Clip:
    return _with(clip, np.random.random())


def another_random_state(clip: Clip, params: Params) -> Clip:
    return _with(clip, random.random())


def random_state_of_opencv(clip: Clip, params: Params) -> Clip:
    return _with(clip, cv2.randu(np.zeros(4, np.uint8), 0, 255).tolist())


def hash_seed(clip: Clip, params: Params) -> Clip:
    return _with(clip, hash("a word"))


def undeclared_file(clip: Clip, params: Params) -> Clip:
    return _with(clip, Path("/etc/passwd").read_text())


def undeclared_folder(clip: Clip, params: Params) -> Clip:
    return _with(clip, os.listdir("/etc"))


def undeclared_source(clip: Clip, params: Params) -> Clip:
    return _with(clip, Path(__file__).with_name("command.py").read_text())


def file_behind_python(clip: Clip, params: Params) -> Clip:
    return _with(clip, bool(ctypes.CDLL(None).fopen(b"/etc/passwd", b"r")))


def writing(clip: Clip, params: Params) -> Clip:
    Path(tempfile.gettempdir(), "afford-impure").write_text("")
    return clip


def process(clip: Clip, params: Params) -> Clip:
    subprocess.run(["/bin/true"])
    return clip


def printing(clip: Clip, params: Params) -> Clip:
    sys.stdout.write("hello")
    return clip


def changed_input(clip: Clip, params: Params) -> Clip:
    clip.key_frames[0].annotations[0].polygons[0].points[:] += 1
    return clip


def _with(clip: Clip, what: object) -> Clip:
    return dataclasses.replace(clip, warnings=(str(what),))


CHEATS = (environment, working_directory, clock, calendar, random_state, another_random_state, random_state_of_opencv, hash_seed,
          undeclared_file, undeclared_folder, undeclared_source, file_behind_python, writing, process, printing, changed_input)
