"""What a parameter may be: refused on the command line, before anything runs; what the project itself chooses is never refused."""

from __future__ import annotations

import pytest

from afford.dataset.metadata import METHODS
from afford.grasping.sim import engine
from afford.rgbd.model.config import ROWS, VARIANTS
from afford.twohands.model import interface
from commands.errors import UsageError
from commands.settings import CHOICES, SEQUENCES, SHARED_CHOICES, blocks, check_value, field_types, registry, settings
from maps.settings import PRESETS, SYSTEM_OF, Settings


def test_what_the_project_chooses_is_never_refused() -> None:
    """Defaults of every stage, and presets."""
    chosen = [(stage, Settings().params(stage)) for stage in SYSTEM_OF]
    for stage, params in [*chosen, *((stage, params) for (stage, _, _), params in PRESETS.items())]:
        for one in (params, *blocks(params).values()):
            for name in field_types(one).keys() - blocks(one).keys():
                check_value(stage, name, getattr(one, name), one)


@pytest.mark.parametrize(
    ("word", "hint"),
    [
        ("mask_densify.radius=-1", r"mask_densify\.radius: expected 0 or more, got -1"),
        ("mask_densify.flow.search_px=-1", "expected 0 or more"),
        ("mask_densify.max_step_frames=-3", "expected 0 or more"),
        ("frame_decode.width_px=0", r"frame_decode\.width_px: expected 1 or more, got 0"),
        ("frame_decode.height_px=-5", "expected 1 or more"),
        ("source_read.max_gap_s=nan", r"source_read\.max_gap_s: expected a finite number, got nan"),
        ("affordance_intersect.max_area_px855=inf", "expected a finite number, got inf"),
        ("score_cases.levels=0.1,nan", "expected a finite number, got nan"),
        ("motion_synthesise.reach_s=-1,2", "expected 0 or more, got -1"),
        ("motion_synthesise.rate_hz=0", "expected more than 0, got 0"),
        ("mask_densify.sam2.device=gpu", "expected cpu, cuda or cuda:N, got 'gpu'"),
        ("narration_labelling.policy=lst", "did you mean 'last'"),
        ("dataset_pack.split_by=vidoe", "did you mean 'video'"),
        ("dataset_pack.val_fraction=1.5", "expected a share below 1"),
        ("model_train.variant=smal", "did you mean 'small'"),
        ("sor3d_train.row=rgbdd", "did you mean 'rgbd'"),
        ("model_train.steps=0", "expected 1 or more"),
        ("boxes_train.batch=-1", "expected 1 or more"),
        ("grasp_report.engines=bullet,mujco", "did you mean 'mujoco'"),
        ("train_plan.seed=-1", "expected 0 or more"),
        ("mask_densify.backend=flw", "unknown backend of mask_densify 'flw'; did you mean 'flow'"),
    ],
)
def test_what_cannot_be_is_refused(word: str, hint: str) -> None:
    """Each refusal names the parameter, what was expected and what was said."""
    with pytest.raises(UsageError, match=hint):
        settings([word], None)


@pytest.mark.parametrize("word", ["mask_densify.radius=0", "mask_densify.max_step_frames=0", "hand_inpaint.lama.window_px=0",
                                  "mask_densify.sam2.device=cuda:1", "sor3d_report.steps=0", "hand_inpaint.vidm.ddim_eta=0",
                                  "grasp_report.engines=mujoco", "dataset_pack.val_fraction=0"])  # fmt: skip
def test_what_can_be_is_taken(word: str) -> None:
    """0 where it means none, or any."""
    settings([word], None)


def test_the_words_are_those_of_the_code() -> None:
    """A word that is added there is missed here."""
    assert set(CHOICES["model_train", "variant"]) == set(interface.VARIANTS)
    for stage in SEQUENCES:
        assert set(CHOICES[stage, "variant"]) == set(VARIANTS) and CHOICES[stage, "row"] == tuple(ROWS)
    assert set(CHOICES["dataset_pack", "made"]) == set(METHODS) and set(SHARED_CHOICES["engines"]) == set(engine.BACKENDS)


def test_registries_are_named_after_what_chooses_from_them() -> None:
    assert [registry(name) for name in ("backend", "policy")] == ["BACKENDS", "POLICIES"]


@pytest.mark.parametrize("word", ["static_read.crop_px=0", "model_train.validate_every=0"])
def test_where_nothing_has_a_meaning_it_is_taken(word: str) -> None:
    """Whole pictures; no validation."""
    stage, name = word.partition("=")[0].split(".")
    assert getattr(settings([word], None).params(stage), name) == 0
