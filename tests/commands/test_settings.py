"""Parameters from the command line and files fit their types and bounds, or are refused with the nearest valid name."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import pytest

from afford.dataset.metadata import METHODS
from afford.grasping.sim import engine
from afford.rgbd.model.config import ROWS, VARIANTS
from afford.twohands.model import interface
from commands.errors import UsageError
from commands.params import show
from commands.settings import (
    CHOICES,
    SEQUENCES,
    SHARED_CHOICES,
    blocks,
    check_value,
    field_types,
    parameters_of,
    registry,
    settings,
)
from maps.settings import PRESETS, SYSTEM_OF, SYSTEMS, Settings
from stages.extraction import extraction_report
from stages.rgbd import sor3d_train
from tests.helpers.command import call


def test_the_defaults_hold_without_settings() -> None:
    """No --set and no file."""
    assert settings([], None) == Settings()


def test_the_command_line_wins_over_the_file(tmp_path: Path) -> None:
    """The file changes a default, --set changes it again."""
    file = tmp_path / "p.toml"
    file.write_text("[extraction_report]\neval_seed = 5\nhard_clips = 2\n")
    chosen = settings(["extraction-report.eval_seed=7"], file).extraction.extraction_report
    assert (chosen.eval_seed, chosen.hard_clips) == (7, 2)


def test_lists_are_written_with_commas_or_as_json() -> None:
    """Both forms mean the same; invalid JSON is refused."""
    plain = settings(["grasp_report.rows=teacher, student"], None).grasping.grasp_report.rows
    assert plain == settings(['grasp_report.rows=["teacher","student"]'], None).grasping.grasp_report.rows == ("teacher", "student")
    with pytest.raises(UsageError, match=r"grasp_report\.rows: expected"):
        settings(['grasp_report.rows=["teacher"'], None)


def test_a_variant_brings_its_schedule() -> None:
    """SOR3D-AFF's width sets rate, batch, epochs, loss and rotation, in any order of the words; explicit settings win."""
    paper = settings(["sor3d_train.steps=7", "sor3d_train.variant=paper", "sor3d_train.device=cpu"], None)
    assert paper.rgbd.sor3d_train == dataclasses.replace(sor3d_train.PAPER, steps=7, device="cpu")
    assert paper.rgbd.sor3d_pretrain.variant == "small"
    usual = settings(["sor3d_train.variant=paper"], None).rgbd.sor3d_train
    assert (usual.lr, usual.batch, usual.steps, usual.turn, usual.decay) == (2e-5, 2, 200 * 481, 0.75, False)
    assert (usual.dice_weight, usual.foreground_weight, usual.static_share, usual.height_px) == (0.0, 1.0, 0.0, 300)
    before = settings(["sor3d_pretrain.variant=paper"], None).rgbd.sor3d_pretrain
    assert before.steps * before.batch == 50 * 160
    assert settings(["sor3d_train.variant=small"], None) == Settings()


def test_one_word_brings_the_recipe_of_2handedafforder() -> None:
    """Sizes, losses, rate, batch and schedule of the paper; `code` the released script's; explicit settings win."""
    paper = settings(["model_train.variant=vlm"], None).twohands.model_train
    assert (paper.height_px, paper.hypotheses, paper.batch * paper.accumulate, paper.steps, paper.lr) == (1024, 1, 20, 5000, 3e-4)
    assert (paper.mask_loss, paper.mask_weight, paper.dice_weight, paper.object_weight) == ("focal", 2.0, 0.5, 0.0)
    clip = settings(["model_train.variant=clip"], None).twohands.model_train
    assert paper.checkpointing and paper.bf16 and not clip.checkpointing
    code = settings(["model_train.lr=1", "model_train.loss_mode=code", "model_train.variant=vlm"], None).twohands.model_train
    assert code == dataclasses.replace(paper, loss_mode="code", mask_loss="bce", lr=1.0)
    small = settings(["model_train.loss_mode=code"], None).twohands.model_train
    assert small == dataclasses.replace(Settings().twohands.model_train, loss_mode="code")


def test_differences_from_the_paper(capsys: pytest.CaptureFixture[str]) -> None:
    """`params --diff paper` lists what differs, nothing for the paper's own; a stage without a paper is a usage error."""
    assert show("model_train", True, ("model_train.variant=vlm", "model_train.lr=0.5"), paper=True) == 0
    assert json.loads(capsys.readouterr().out) == [{"stage": "model_train", "name": "lr", "chosen": 0.5, "paper": 3e-4}]
    with pytest.raises(UsageError, match="no paper's parameters are known for key_thin"):
        show("key_thin", False, (), paper=True)


@pytest.mark.parametrize(
    ("word", "hint"),
    [
        ("mask_densfy.radius=1", "did you mean 'mask_densify'"),
        ("extraction_report.eval_sed=1", "did you mean 'eval_seed'"),
        ("extraction_report.eval_seed=x", "expected int, got 'x'"),
        ("extraction_report.eval_seed=1.5", "expected int"),
        ("extraction_report", "expected STAGE.PARAM=VALUE"),
        ("motion_synthesise.reach_s=0.5", r"motion_synthesise\.reach_s: expected .*float, float"),
    ],
)
def test_invalid_settings_are_refused(word: str, hint: str) -> None:
    """Each refusal names the field and the remedy."""
    with pytest.raises(UsageError, match=hint):
        settings([word], None)


def test_a_parameter_of_a_backend_is_set_in_its_block(tmp_path: Path) -> None:
    """Its dotted name, or a table of a file, changes it; the rest of the block and the other blocks stay."""
    file = tmp_path / "p.toml"
    file.write_text("[mask_densify]\nradius = 3\n[mask_densify.sam2]\nmemory_keys = 4\ncache_frames = 2\n")
    chosen = settings(["mask_densify.sam2.memory-keys=5"], file).extraction.mask_densify
    usual = Settings.extraction.mask_densify
    sam2 = dataclasses.replace(usual.sam2, memory_keys=5, cache_frames=2)
    assert chosen == dataclasses.replace(usual, radius=3, sam2=sam2)


@pytest.mark.parametrize(("word", "message"), [
    ("mask_densify.model=DIR", "mask_densify.model belongs to the backends sam2 and xmem; write mask_densify.sam2.model or "
     "mask_densify.xmem.model"),
    ("mask_densify.search_px=2", "mask_densify.search_px belongs to the backend flow; write mask_densify.flow.search_px"),
    ("hand_inpaint.batch=2", "hand_inpaint.batch belongs to the backends vidm and lama; write hand_inpaint.vidm.batch or "
     "hand_inpaint.lama.batch"),
    ("mask_propose.grid=32", "mask_propose.grid holds the parameters of the backend grid; write mask_propose.grid.windows or "
     "mask_propose.grid.least_window; the former mask_propose.grid is now mask_propose.sam.grid"),
    ("part_describe.url=http://me:secret@host", "part_describe.url belongs to the backend endpoint; write "
     "part_describe.endpoint.url"),
    ("mask_densify.sam2.modle=x", "unknown parameter of mask_densify.sam2 'modle'; did you mean 'model'? Valid: cache_frames, "
     "device, dtype, memory_keys, model"),
    ("mask_densify.radius.px=3", "mask_densify.radius.px: mask_densify.radius is one value and has no parameters; write "
     "mask_densify.radius"),
])  # fmt: skip
def test_a_former_parameter_name_is_refused_with_the_present_one(word: str, message: str, tmp_path: Path) -> None:
    """The same holds for a file; no value is shown."""
    with pytest.raises(UsageError) as caught:
        settings([word], None)
    assert str(caught.value) == message
    stage, _, rest = word.partition(".")
    name, _, value = rest.partition("=")
    (tmp_path / "p.json").write_text(json.dumps({stage: {name: value}}))
    with pytest.raises(UsageError) as caught:
        settings([], tmp_path / "p.json")
    assert str(caught.value) == message


def test_old_names_end_with_exit_code_2() -> None:
    """One sentence on the command line."""
    refused = call("run", "dataset", "--dry-run", "--set", "mask_densify.model=DIR")
    assert refused.code == 2 and refused.err.count("\n") == 1 and "write mask_densify.sam2.model" in refused.err


def test_blocks_are_described_and_the_selected_one_is_marked() -> None:
    """Listed by name after the common parameters, with the defaults of the stage."""
    rows = {one.name: one for one in parameters_of(Settings().params("grasp_judge"))}
    assert list(rows)[:2] == ["backend", "frames"] and rows["vlm.new_tokens"].value == rows["endpoint.new_tokens"].value == 256
    assert {name for name, one in rows.items() if not one.selected} == {name for name in rows if name.startswith("endpoint.")}
    shown = {row["name"]: row for row in call("params", "mask_densify", "--json").json}
    assert shown["flow.search_px"]["selected"] and not shown["sam2.model"]["selected"] and shown["radius"]["selected"]


def test_a_damaged_file_is_refused(tmp_path: Path) -> None:
    """The file is named."""
    file = tmp_path / "p.toml"
    file.write_text("[extraction_report\n")
    with pytest.raises(UsageError, match=r"p\.toml"):
        settings([], file)


@pytest.mark.parametrize(("text", "got"), [("[1, 2]", "list"), ("7", "int"), ("null", "NoneType"), ('{"mask_densify": 3}', "int")])
def test_a_file_without_tables_is_refused(text: str, got: str, tmp_path: Path) -> None:
    """JSON may be a list or a number; the file and its type are named."""
    file = tmp_path / "p.json"
    file.write_text(text)
    with pytest.raises(UsageError, match=rf"p\.json: .*expected .*table.*, got {got}"):
        settings([], file)


def test_parameters_have_a_doc_line() -> None:
    """`python pipeline.py params` prints it."""
    for stage in SYSTEM_OF:
        for one in parameters_of(Settings().params(stage)):
            assert one.doc, f"{stage}.{one.name} ({one.type}) has no doc line"


def test_a_stage_belongs_to_one_system() -> None:
    """Its parameters are found by its name alone, and nothing else changes with them."""
    named = [field.name for system in SYSTEMS for field in dataclasses.fields(getattr(Settings(), system))]
    assert len(named) == len(set(named)) and named == list(SYSTEM_OF) and len(SYSTEMS) == 6
    few = extraction_report.Params(hard_clips=1)
    changed = Settings.of(extraction_report=few)
    assert changed.params("extraction_report") is changed.extraction.extraction_report is few
    assert dataclasses.replace(changed, extraction=Settings().extraction) == Settings()
    with pytest.raises(TypeError, match="expected names of stages, got extraction_repord"):
        Settings.of(extraction_repord=few)


def test_former_backends_of_model_train_name_their_stages() -> None:
    """The error names the stage that replaces the backend."""
    for backend, stage in (("sor3d", "sor3d_train"), ("sor3d_actions", "sor3d_pretrain"), ("boxes", "boxes_train")):
        with pytest.raises(UsageError, match=f"{backend} is trained by {stage}"):
            settings([f"model_train.backend={backend}"], None)


def test_defaults_and_presets_are_valid() -> None:
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
def test_values_out_of_bounds_are_refused(word: str, hint: str) -> None:
    """Each refusal names the parameter, the expected and the given value."""
    with pytest.raises(UsageError, match=hint):
        settings([word], None)


@pytest.mark.parametrize("word", ["mask_densify.radius=0", "mask_densify.max_step_frames=0", "hand_inpaint.lama.window_px=0",
                                  "mask_densify.sam2.device=cuda:1", "sor3d_report.steps=0", "hand_inpaint.vidm.ddim_eta=0",
                                  "grasp_report.engines=mujoco", "dataset_pack.val_fraction=0"])  # fmt: skip
def test_values_on_the_bounds_are_accepted(word: str) -> None:
    """0 where it means none, or any."""
    settings([word], None)


def test_the_listed_words_are_those_of_the_code() -> None:
    """A new word of the code is missed here."""
    assert set(CHOICES["model_train", "variant"]) == set(interface.VARIANTS)
    for stage in SEQUENCES:
        assert set(CHOICES[stage, "variant"]) == set(VARIANTS) and CHOICES[stage, "row"] == tuple(ROWS)
    assert set(CHOICES["dataset_pack", "made"]) == set(METHODS) and set(SHARED_CHOICES["engines"]) == set(engine.BACKENDS)


def test_registries_are_named_after_what_chooses_from_them() -> None:
    assert [registry(name) for name in ("backend", "policy")] == ["BACKENDS", "POLICIES"]


@pytest.mark.parametrize("word", ["static_read.crop_px=0", "model_train.validate_every=0"])
def test_zero_is_accepted_where_it_has_a_meaning(word: str) -> None:
    """Whole pictures; no validation."""
    stage, name = word.partition("=")[0].split(".")
    assert getattr(settings([word], None).params(stage), name) == 0
