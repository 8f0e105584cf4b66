"""A recorded clip -> an EPIC root of one video with its truth, and the root as file trees."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from blake3 import blake3

from afford.codecs import save
from afford.common.folders import media_of
from afford.common.video.frames import write_video
from afford.synthetic.kitchens import write_epic
from afford.synthetic.kitchens.play import LENGTH, Play, Saying
from afford.synthetic.kitchens.record import Recording
from schemas.files import FileRef, FileTree
from schemas.scene import ClipTruth, RenderedClip, SceneSpec
from schemas.video import Narration


def write_clip(root: Path, spec: SceneSpec, play: Play, recording: Recording, crf: int) -> RenderedClip:
    """Write all files of the clip below `root`; ValueError when the split is neither train nor val."""
    if spec.split not in write_epic.ACTION_FILES:
        raise ValueError(f"SceneSpec.split: expected one of {', '.join(write_epic.ACTION_FILES)}, got {spec.split!r}")
    truth, person = recording.truth, spec.video_id.split("_")[0]
    narrations = [_narration(spec, number, saying) for number, saying in enumerate(play.sayings)]
    write_video(root / "videos" / person / f"{spec.video_id}.MP4", recording.images, crf)
    annotations = root / "GroundTruth-SparseAnnotations" / "annotations" / spec.split / f"{spec.video_id}.json"
    write_epic.write_annotations(annotations, spec.video_id, truth.entities, _keys(spec, truth))
    write_epic.write_actions(root, spec.video_id, spec.split, sorted(narrations, key=lambda n: n.start_frame))
    write_epic.write_classes(root, (noun for saying in play.sayings for noun in saying.nouns))
    height, width = recording.images.shape[1:3]
    write_epic.write_info(root, spec.video_id, spec.frames, width, height)
    folder = root / "truth" / spec.video_id
    folder.mkdir(parents=True, exist_ok=True)
    save(truth, folder)
    return rendered_clip(root, spec.video_id)


def rendered_clip(root: Path, video_id: str) -> RenderedClip:
    """The files of a root of one video as a value."""
    names = sorted(path.relative_to(root).as_posix() for path in root.rglob("*") if path.is_file())
    refs = [_ref(root, name) for name in names]
    files = FileTree(video_id, tuple(ref for ref in refs if not ref.name.startswith("truth/")))
    return RenderedClip(
        files=files,
        media=media_of(files),
        truth=FileTree(video_id, tuple(ref for ref in refs if ref.name.startswith("truth/"))))


def _ref(root: Path, name: str) -> FileRef:
    data = (root / name).read_bytes()
    return FileRef(name, blake3(data).hexdigest(), len(data), root / name)


def _keys(spec: SceneSpec, truth: ClipTruth) -> list[write_epic.KeyMasks]:
    indices = np.arange(0, spec.frames, spec.key_gap)
    return [write_epic.KeyMasks(int(t) + 1, truth.visible[:, t], (int(truth.contact[0, t]), int(truth.contact[1, t])))
            for t in indices]


def _narration(spec: SceneSpec, number: int, saying: Saying) -> Narration:
    start, stop = (round(time * spec.frames / LENGTH) + 1 for time in (saying.start, saying.stop))
    interval = (min(max(1, start), spec.frames), min(max(1, start, stop), spec.frames))
    return write_epic.narration(spec.video_id, number, interval, saying.text, saying.verb, saying.nouns)
