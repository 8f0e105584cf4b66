"""Settings of the extraction stages, including the hand finder."""

from __future__ import annotations

from dataclasses import dataclass

from stages.extraction import (
    affordance_intersect,
    dataset_pack,
    extraction_report,
    extraction_score,
    frame_decode,
    hand_detect,
    hand_inpaint,
    hand_landmarks,
    hands_train,
    held_train,
    key_thin,
    mask_densify,
    narration_labelling,
    object_completion,
    sample_assemble,
    source_read,
)
from stages.synthetic import hand_lessons, hand_plan


@dataclass(frozen=True)
class Extraction:
    """The parameters of every stage of the system, by stage."""

    source_read: source_read.Params = source_read.Params()
    frame_decode: frame_decode.Params = frame_decode.Params()
    hand_landmarks: hand_landmarks.Params = hand_landmarks.Params()
    hand_detect: hand_detect.Params = hand_detect.Params()
    mask_densify: mask_densify.Params = mask_densify.Params()
    hand_inpaint: hand_inpaint.Params = hand_inpaint.Params()
    object_completion: object_completion.Params = object_completion.Params()
    affordance_intersect: affordance_intersect.Params = affordance_intersect.Params()
    narration_labelling: narration_labelling.Params = narration_labelling.Params()
    sample_assemble: sample_assemble.Params = sample_assemble.Params()
    dataset_pack: dataset_pack.Params = dataset_pack.Params()
    key_thin: key_thin.Params = key_thin.Params()
    extraction_score: extraction_score.Params = extraction_score.Params()
    extraction_report: extraction_report.Params = extraction_report.Params()
    hand_plan: hand_plan.Params = hand_plan.Params()
    hand_lessons: hand_lessons.Params = hand_lessons.Params()
    hands_train: hands_train.Params = hands_train.Params()
    held_train: held_train.Params = held_train.Params()
