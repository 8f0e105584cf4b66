"""The recording of motions: the person's hand, the robot's, and how far apart they are."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from afford.grasping.env.rendering import placed_keypoints
from afford.recording.check_content import check_content
from afford.recording.check_file import check_file
from afford.recording.moments import moments
from afford.recording.motions import BONES, ERROR, IMAGE, LOG, TRANSFORMS
from schemas.hand import HandMotion, Retargeted
from stages.grasping import hand_retarget, motion_synthesise
from stages.recording import motion_record
from tests.helpers.made_hands import shadow
from tests.helpers.made_motions import rod
from tests.helpers.made_samples import Scratch

ANY = hand_retarget.Params(frame_steps=10, clip_steps=2, min_s=0.0, max_error_m=1.0, max_palm_m_s=100.0, max_joint_rad_s=1e4,
                           max_point_m_s=100.0)  # fmt: skip
SMALL = motion_record.Params("motion_synthesise", pictures_hz=2.0, width=64, height=48)


@pytest.fixture(scope="module")
def motions() -> tuple[HandMotion, ...]:
    return motion_synthesise.run(rod(), motion_synthesise.Params(clips=2, rate_hz=20.0))


@pytest.fixture(scope="module")
def clips(motions: tuple[HandMotion, ...]) -> tuple[Retargeted, ...]:
    """The first was fitted, the second dropped."""
    strict = replace(ANY, max_error_m=1e-6)
    return tuple(hand_retarget.run(motion, shadow(), params) for motion, params in zip(motions, (ANY, strict), strict=True))


def test_kept_and_dropped_clips(motions: tuple[HandMotion, ...], clips: tuple[Retargeted, ...],
                                                           tmp_path: Path) -> None:  # fmt: skip
    """A kept clip has transforms, errors in mm and degrees, and pictures; a dropped one the person and a warning."""
    made = motion_record.run(shadow(), motions, clips, SMALL, Scratch(tmp_path))
    path = made.files[0].path
    found = list(moments(path))
    count = {topic: sum(len(moment.values.get(topic, ())) for moment in found) for topic in
             (TRANSFORMS, ERROR, BONES, IMAGE, LOG, "/motion_synthesise/keypoints", "/motion_synthesise/bones")}
    (reference,) = clips[0].references
    rows, frames = len(reference.q), sum(len(motion.keypoints_m) for motion in motions)
    assert count[TRANSFORMS] == count[ERROR] == count[BONES] == rows and count[IMAGE] == -(-rows // 10)
    assert count["/motion_synthesise/keypoints"] == count["/motion_synthesise/bones"] == frames and count[LOG] == 2
    said = [(one.message, one.level) for moment in found for one in moment.values.get(LOG, ())]
    assert "kept" in said[0][0] and "dropped" in said[1][0] and said[1][1] > said[0][1]
    errors = [moment.one(ERROR).value for moment in found if ERROR in moment.values]
    assert np.allclose(errors, 1000 * reference.error_m)
    assert check_file(path) == check_content(path) == []


def test_the_persons_points_lie_where_the_reference_is(motions: tuple[HandMotion, ...], clips: tuple[Retargeted, ...]) -> None:
    """Turned and shifted as retargeting did it: fingertips of both hands are near each other."""
    (reference,) = clips[0].references
    theirs = placed_keypoints(motions[0], reference)
    assert theirs.shape == (len(reference.q), 21, 3)
    assert np.linalg.norm(theirs[:, 8] - reference.tips_m[:, 1], axis=-1).mean() < 0.05


def test_clips_that_do_not_fit_are_named(motions: tuple[HandMotion, ...], clips: tuple[Retargeted, ...], tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no retargeted clip of the motion"):
        motion_record.run(shadow(), motions, clips[:1], SMALL, Scratch(tmp_path))
    with pytest.raises(ValueError, match="expected motions"):
        motion_record.run(shadow(), (), (), SMALL, Scratch(tmp_path))
