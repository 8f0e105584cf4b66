"""Laws of videos without masks: one of one's own, or several beside EPIC's tables, become clips without key frames."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import pytest

from afford.common.errors import SourceError
from afford.common.video.frames import decode_clip
from afford.extraction.sources.discover import Source, discover
from schemas.video import Clip
from stages.extraction import clip_footage, source_read
from tests.helpers.tiny_root import digest, row, spelt, write_rows, write_video


def bare(folder: Path, table: str = "") -> Source:
    write_video(folder / "mine.mp4", 30)
    if table:
        (folder / "narrations.csv").write_text(table, encoding="utf-8")
    return discover(folder, digest)


def read(source: Source, **params: int) -> tuple[Clip, ...]:
    (tree,) = source.videos
    return source_read.run(tree, source_read.Params(**params))


def test_a_video_alone_is_a_source(tmp_path: Path) -> None:
    """A video alone gives all its frames, no key frame, the default narration, and a remark."""
    source = bare(tmp_path)
    (clip,) = read(source)
    assert source.kind == "bare" and (clip.clip_id, clip.first_frame, clip.last_frame, clip.key_frames) == ("mine", 1, 30, ())
    (said,) = clip.narrations
    assert (said.text, said.verb, said.noun, said.start_frame, said.stop_frame) == ("hold object", "hold", "object", 1, 30)
    assert any("no masks" in text for text in clip.warnings) and any("'hold object'" in text for text in clip.warnings)


def test_frames_of_a_video_alone_are_decoded(tmp_path: Path) -> None:
    """Frames are decoded although none is a key frame; an error names the expected frames."""
    source = bare(tmp_path)
    (clip,) = read(source)
    footage = clip_footage.run(clip, clip_footage.Params())
    frames = decode_clip(source.videos[0], footage, (128, 64))
    assert frames.frame.tolist() == [spelt(picture) for picture in frames.rgb] == list(range(1, 31))


def test_words_of_its_own_win(tmp_path: Path) -> None:
    """A table says what is done, and nothing is added."""
    (clip,) = read(bare(tmp_path, "start,stop,narration\n0,0.5,pick up the mug\n"))
    assert [n.text for n in clip.narrations] == ["pick up the mug"]


def test_a_long_one_is_cut(tmp_path: Path) -> None:
    """Into clips of at most `max_frames` steps that share a frame; none is lost."""
    clips = read(bare(tmp_path), max_frames=10)
    assert len(clips) > 2 and (clips[0].first_frame, clips[-1].last_frame) == (1, 30)
    for one, two in pairwise(clips):
        assert one.last_frame == two.first_frame and one.last_frame - one.first_frame <= 10


def test_several_videos_beside_tables_of_epic(tmp_path: Path) -> None:
    """Each is a source of its own with its own narrations and its participant; without tables two videos are refused."""
    for video in ("P95_01", "P95_02"):
        write_video(tmp_path / "videos" / f"{video}.MP4", 12)
    with pytest.raises(SourceError, match="exactly one video"):
        discover(tmp_path, digest)
    write_rows(tmp_path / "EPIC_100_train.csv", [row("P95_02", narration="open jar", start_frame=2, stop_frame=9)])
    source = discover(tmp_path, digest)
    first, second = (source_read.run(tree, source_read.Params())[0] for tree in source.videos)
    assert source.kind == "bare" and (first.video_id, second.video_id, second.participant_id) == ("P95_01", "P95_02", "P95")
    assert [n.text for n in first.narrations] == ["hold object"] and [n.text for n in second.narrations] == ["open jar"]
