"""The whole pipeline on a tiny source in EPIC's format."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from mcap.reader import make_reader

from afford.codecs import CODEC
from afford.recording.summary import summarise
from commands.settings import settings
from maps.settings import Origin, Settings
from maps.twohands import ROWS
from pipeline import build
from runner.index import Index
from runner.store import Store
from schemas.scene import SceneSpec
from tests.helpers.command import KEYS, PER_CLIP, PER_RUN, RECORDED, Made, call
from tests.helpers.tiny_source import FRAMES, VIDEOS, media, write_narrations, write_source

AFTER_AFFORDANCE = {"affordance_intersect": 2, "record_affordance_intersect": 2, "clip_record": 2, "sample_assemble": 2,
                    "record_sample_assemble": 2, "dataset_pack": 1, "record_dataset_pack": 1}


@pytest.fixture
def mine(made: Made, tmp_path: Path) -> Made:
    """Copy of the source and the store."""
    return made.copy(tmp_path)


def rows(made: Made, part: str = "") -> list[str]:
    """Video of every sample in the data set, or in the partial one."""
    shards = sorted((made.store / "datasets" / f"{made.source.name}{part}" / "data").glob("*.parquet"))
    return [video for shard in shards for video in pq.read_table(shard, columns=["video"])["video"].to_pylist()]


def recording(made: Made, clip: str) -> Path:
    return made.store / "recordings" / made.source.name / f"{clip}.mcap"


def is_whole(path: Path) -> bool:
    with path.open("rb") as file:
        return sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages()) > FRAMES


def blobs_of(made: Made, stage: str) -> list[Path]:
    """Blobs of a stage's outputs."""
    store = Store(made.store, CODEC)
    outputs = [trace.output for trace in Index(made.store).all() if trace.stage == stage]
    files = [store.manifest(digest).files for digest in outputs]
    return [made.store / "blobs" / blob[:2] / blob[2:] for entries in files for _, blob, *_ in entries]


def flip(path: Path) -> None:
    """Flip one bit in the middle, and keep the modification time."""
    before = path.stat()
    path.chmod(0o644)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))


def times(number: int, stages: Iterable[str]) -> dict[str, int]:
    return dict.fromkeys(stages, number)


# -- a run, and what a second one does ---------------------------------------------------------------------------------


def test_a_run_ends_with_a_data_set_and_recordings(made: Made) -> None:
    """Stages ran once per clip, the data set has both videos, and each clip has a recording with valid checksums."""
    assert set(made.first) == KEYS and made.first["target"] == "dataset"
    assert made.first["ran"] == times(2, PER_CLIP) | times(1, PER_RUN)
    assert made.first["cached"] == made.first["failed"] == {}
    assert Path(made.first["outputs"]["dataset"]).is_dir() and set(rows(made)) == set(VIDEOS)
    assert all(is_whole(recording(made, video)) for video in VIDEOS)


def test_a_run_prints_the_content_of_the_data_set(made: Made) -> None:
    """Samples by split and by hands, and skipped frames by reason, as in its statistics."""
    result = made.run("dataset").words
    samples = len(rows(made))
    left = json.loads((made.store / "datasets" / made.source.name / "statistics.json").read_text())["frames_without_sample"]
    assert f"{samples} samples of 2 video(s): train {samples} hands: right {samples} frames left out: no contact" in result
    assert left and all(f"{reason.replace('_', ' ')} {count}" in result for reason, count in left.items())


def test_the_data_set_and_the_report_are_recorded(made: Made) -> None:
    """Valid recordings with numbers, words and pictures, next to the recordings of the clips."""
    wanted = {"dataset_pack": ("statistics", "contact_sheet", "log"), "extraction_report": ("metrics", "sheet", "log")}
    for name, topics in wanted.items():
        found = summarise(recording(made, name))
        assert {f"/{name}/{topic}" for topic in topics} <= {topic.topic for topic in found.topics}
    assert made.ask("inspect", made.store / "recordings", "--strict", source=False).code == 0


def test_a_second_run_does_nothing(made: Made) -> None:
    """Stages are cached, and the outputs are the same."""
    before, again = made.traces, made.run("dataset")
    assert again.code == 0 and set(again.json) == KEYS
    assert (again.json["ran"], again.json["cached"]) == ({}, made.first["ran"])
    assert again.json["outputs"] == made.first["outputs"] and made.traces == before


def test_targets_share_what_they_have_in_common(made: Made) -> None:
    """The report measures the data set's stages: nothing is extracted twice, and metrics are a flat dict of numbers."""
    report = made.run("extraction-report")
    assert report.json["ran"] == {} and report.json["cached"]["mask_densify"] == 2
    assert all(isinstance(value, (int, float)) for value in report.json["metrics"].values())
    assert {"densify.j.gap15", "inpaint.psnr_db", "affordance.iou", "cpu_s_per_frame"} <= set(report.json["metrics"])


def test_a_source_that_has_moved_is_the_same_source(mine: Made) -> None:
    """The location of files does not count."""
    assert mine.run("dataset").json["ran"] == {}


def test_a_dry_run_runs_nothing(mine: Made) -> None:
    """Tasks and reasons are listed."""
    before = mine.traces
    plan = mine.run("dataset", "--dry-run", "--set", "affordance_intersect.dilate_px855=0")
    shown = {task["stage"]: task for task in plan.json["tasks"] if task["status"] != "cached"}
    assert plan.code == 0 and mine.traces == before and set(shown) == set(AFTER_AFFORDANCE)
    assert shown["affordance_intersect"]["reason"] == "parameter changed: dilate_px855 10.0 -> 0.0"


# -- what a change makes run -------------------------------------------------------------------------------------------


def test_a_parameter_runs_its_stage_and_what_reads_it_and_undo_is_free(mine: Made) -> None:
    """Stages before it are cached; the old value finds its old outputs."""
    assert mine.run("dataset", "--set", "affordance_intersect.dilate_px855=0").json["ran"] == AFTER_AFFORDANCE
    assert mine.run("dataset").json["ran"] == {}


def test_the_same_bytes_stop_a_change(mine: Made) -> None:
    """A limit that no frame reaches changes no output: one stage runs and nothing below it."""
    assert mine.run("dataset", "--set", "affordance_intersect.max_area_px855=90000").json["ran"] == {"affordance_intersect": 2}


def test_a_narration_of_another_video_runs_the_reader_and_nothing_else(mine: Made) -> None:
    """The clips share the table and are read again with the same result. No frame is decoded."""
    write_narrations(mine.source, {video: {} for video in (*VIDEOS, "P96_77")})
    assert mine.run("dataset").json["ran"] == {"source_read": 2}


def test_a_narration_of_a_clip_runs_what_reads_that_clip(mine: Made) -> None:
    """Masks come out as before, so inpainting does not run again and the other clip is left alone."""
    write_narrations(mine.source, {VIDEOS[0]: {}, VIDEOS[1]: {"narration": "put down card"}})
    ran = mine.run("dataset").json["ran"]
    assert ran.pop("source_read") == 2 and set(ran.values()) == {1}
    assert {"mask_densify", "narration_labelling", "sample_assemble", "dataset_pack"} <= set(ran)
    assert not {"frame_decode", "hand_inpaint", "object_completion", "affordance_intersect"} & set(ran)


def test_an_edited_outline_decodes_nothing(mine: Made) -> None:
    """Masks are computed again from the stored frames."""
    path = next(mine.source.rglob(f"{VIDEOS[0]}.json"))
    points = json.loads(path.read_text())
    points["video_annotations"][1]["annotations"][0]["segments"][0][0][0] += 3
    path.write_text(json.dumps(points))
    ran = mine.run("dataset").json["ran"]
    assert ran["source_read"] == ran["mask_densify"] == 1 and "frame_decode" not in ran


def test_clips_can_be_chosen(mine: Made) -> None:
    """Selected clips run alone; the rest of the data set is still cached afterwards."""
    ran = mine.run("recordings", "--clip", VIDEOS[1], "--set", "affordance_intersect.dilate_px855=0").json["ran"]
    assert ran == times(1, set(AFTER_AFFORDANCE) - set(PER_RUN))


def test_one_stage_alone_uses_its_last_inputs_and_reports_stale_ones(mine: Made) -> None:
    """`--only` with `--no-record` runs nothing else."""
    fresh = mine.run("dataset", "--only", "affordance_intersect", "--no-record", "--set", "affordance_intersect.dilate_px855=0")
    assert fresh.json["ran"] == {"affordance_intersect": 2} and "stale" not in fresh.err
    stale = mine.run("dataset", "--only", "object_completion", "--set", "mask_densify.radius=3")
    assert stale.json["ran"] == {} and "its recorded inputs are stale" in stale.words


def test_one_stage_is_recorded_alone_with_a_hint_for_inspection(mine: Made) -> None:
    """Its recorder runs on the new output; a stage without one, or with missing inputs of it, is reported."""
    clip, before = recording(mine, VIDEOS[0]), recording(mine, VIDEOS[0]).read_bytes()
    result = mine.run("dataset", "--only", "affordance_intersect", "--record", "--set", "affordance_intersect.dilate_px855=0")
    folder = mine.store / "recordings" / mine.source.name / "affordance_intersect"
    assert result.code == 0 and result.json["ran"] == times(2, ["affordance_intersect", "record_affordance_intersect"])
    assert result.json["outputs"] == {"recordings": str(folder)} and str(folder) in result.err and clip.read_bytes() == before
    assert {path.name for path in folder.iterdir()} == {f"{video}.mcap" for video in VIDEOS}
    assert all("/affordance/state" in {topic.topic for topic in summarise(path).topics} for path in folder.iterdir())
    bare = mine.run("dataset", "--only", "clip_footage", "--record")
    assert "clip_footage has no recording of its own" in bare.words and bare.words.count("pipeline.py inspect ") == len(VIDEOS)
    stale = mine.run("dataset", "--only", "object_completion", "--record", "--set", "mask_densify.radius=3")
    assert stale.json["ran"] == {} and "is not updated, since " in stale.words
    assert mine.run("dataset", "--record").code == 2


def test_a_forced_stage_runs_and_its_equal_output_stops_there(mine: Made) -> None:
    """`--force` ignores the cache of one stage."""
    assert mine.run("dataset", "--force", "narration-labelling").json["ran"] == {"narration_labelling": 2}


# -- what fails, what is damaged ---------------------------------------------------------------------------------------


def test_a_corrupt_video_fails_alone(mine: Made) -> None:
    """Exit 1, one clear sentence, and a partial data set of the other clip."""
    media(mine.source, VIDEOS[0]).write_bytes(b"no video")
    broken = mine.run("dataset")
    assert broken.code == 1 and sum(broken.json["failed"].values()) == 1
    assert f"{VIDEOS[0]}.MP4" in broken.words and "Traceback" not in broken.err
    assert set(rows(mine, "-part")) == {VIDEOS[1]} and set(rows(mine)) == set(VIDEOS)
    assert f"{VIDEOS[0]}" in mine.ask("status").words


def test_status_tells_failures_of_other_sources_apart(mine: Made, tmp_path: Path) -> None:
    """Those are counted; the failures of the named source and target are listed."""
    broken = write_source(tmp_path / "broken", ("P96_09",))
    points = next(broken.rglob("P96_09.json"))
    points.write_text(points.read_text().replace('"segments": [[[', '"segments": [[["x",', 1))
    failed = call("run", "dataset", "--source", broken, "--store", mine.store, "--jobs", "0", "--json")
    assert failed.code == 1 and failed.json["failed"] == {"source_read": 1}
    here, there = mine.ask("status"), call("status", "--source", broken, "--store", mine.store)
    assert "failed source_read P96_09" in there.words and "P96_09" not in here.words
    elsewhere = "1 task(s) of other sources, targets or settings failed in this store"
    assert elsewhere in here.words and "other sources" not in there.words
    result = mine.ask("status", "--json").json
    assert result["failures"] == [] and [failure["shard"] for failure in result["failures_elsewhere"]] == ["P96_09"]


def test_a_flipped_bit_in_the_store_is_found_and_mended(mine: Made) -> None:
    """`verify` finds it and moves it aside; the next run computes that blob alone."""
    flip(blobs_of(mine, "narration_labelling")[0])
    found = mine.ask("verify", "--json", source=False)
    assert found.code == 1 and len(found.json["damaged"]) == 1 and not found.json["ok"]
    assert len(list((mine.store / "damaged").iterdir())) == 1
    assert mine.run("dataset").json["ran"].keys() <= {"narration_labelling"}
    assert mine.ask("verify", "--json", source=False).json["ok"]


def test_a_run_finds_a_flipped_bit_by_itself(mine: Made) -> None:
    """`verify` is not needed."""
    flip(next(path for path in blobs_of(mine, "affordance_intersect") if path.stat().st_size > 200))
    mended = mine.run("dataset")
    assert mended.code == 0 and mended.json["ran"].keys() == {"affordance_intersect"}
    assert len(list((mine.store / "damaged").iterdir())) == 1


@pytest.mark.parametrize("spoil", [Path.unlink, flip, lambda path: os.truncate(path, 1000)], ids=["deleted", "flipped", "cut"])
def test_a_spoilt_recording_is_written_again_without_its_stages(mine: Made, spoil: object) -> None:
    """The merge of the recording may run again, but no stage before it."""
    spoil(recording(mine, VIDEOS[0]))  # type: ignore[operator]
    again = mine.run("dataset")
    assert again.code == 0 and not set(again.json["ran"]) & set(RECORDED)
    assert is_whole(recording(mine, VIDEOS[0]))


def test_a_deleted_data_set_is_shown_again(mine: Made) -> None:
    """Published again from the store."""
    shutil.rmtree(mine.store / "datasets")
    assert mine.run("dataset").json["ran"] == {} and set(rows(mine)) == set(VIDEOS)


def test_garbage_goes_and_what_is_in_use_stays(mine: Made) -> None:
    """Outputs of an unused parameter are gone, and nothing runs after gc."""
    mine.run("recordings", "--set", "affordance_intersect.dilate_px855=0")
    mine.run("recordings")
    swept = mine.ask("gc", "--json", source=False)
    assert swept.code == 0 and swept.json["files"] > 0 and swept.json["bytes"] > 0
    assert mine.run("dataset").json["ran"] == mine.run("extraction-report").json["ran"] == {}
    assert mine.run("recordings", "--set", "affordance_intersect.dilate_px855=0").json["ran"]["affordance_intersect"] == 2


def test_the_ablation_trains_each_row_on_its_data() -> None:
    """Videos are extracted only for the row that trains on them; the scores of all rows are in one table."""
    spec = SceneSpec("P91_01", "carry", "kitchen", seed=3)
    stages = {}
    usual = Settings.twohands.ablation_report
    assert {"vlm", "lisa", "hotspot", "extracted"} <= set(usual.rows) == set(ROWS)
    for rows in (("full", "k1"), ("extracted",), ("full", "extracted"), usual.rows):
        settings = Settings.of(ablation_report=replace(usual, rows=rows))
        graph = build("ablation", Origin("ablation", specs=(spec,)), settings)
        stages[rows] = {node.name: dict(node.inputs) for node in graph.stages()}
    of_stills = {"train_pack", "model_train", "score_cases"}
    of_videos = {"dataset_pack", "extracted_model_train", "extracted_score_cases"}
    assert stages["full", "k1"].keys() >= of_stills and not stages["full", "k1"].keys() & of_videos
    assert stages["extracted",].keys() >= of_videos and not stages["extracted",].keys() & of_stills
    assert stages["full", "extracted"].keys() >= of_stills | of_videos
    assert ["others" in stages[rows]["ablation_report"] for rows in stages] == [False, False, True, True]


@pytest.mark.parametrize(("words", "sizes"), [((), "small"), (("model_train.recipe=release",), "small"),
    (("model_train.height_px=96",), ""), (("model_train.variant=small",), "")])  # fmt: skip
def test_rows_of_the_ablation_have_the_sizes_that_were_asked_for(words: tuple[str, ...], sizes: str) -> None:
    """The sizes of the variant that `make train` trains belong to its encoder, which no row has."""
    graph = build("ablation", Origin("ablation"), settings(words, None))
    planned = next(node.value for node in graph.nodes if node.name == "recipes")
    assert {recipe.sizes for recipe in planned} == {sizes}
