"""Origin of a run's data: `--source DIR`, or the clips that the target renders."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from afford.common.folders import IMAGE_SUFFIXES, PACK_SUFFIXES, VIDEO_SUFFIXES, entries, media_of
from afford.extraction.sources.discover import Refused, Source, discover
from commands.errors import UsageError, unknown
from commands.targets import ALL
from maps.settings import Origin, Settings
from schemas.files import FileRef, FileTree
from schemas.scene import RenderedClip

OWN_ROOMS = {"train-set": "afford-stills", "benchmark-set": "afford-stills-benchmark", "ablation": "ablation",
             "hands": "hands-finder", "held": "held-objects", "grasp": "grasp", "grasp-full": "grasp-full",
             "grasp-play": "grasp-play", "grasp-household": "grasp-household",
             "negative-affordance": "procedural-objects", "interactions": "interactions",
             "sor3d": "sor3d", "sor3d-ablation": "sor3d-ablation", "static-sets": "static-sets"}
"""targets that always render their own data -> name of their outputs"""
NEEDED = {"motions": "motion of hands or a video of hands, see docs/grasping/motion.md",
          "grasp-prior": "recorded motion and the meshes of its objects, or a video of hands, see docs/grasping/imitation.md",
          "grasp-adapt": "meshes, see docs/grasping/own-meshes.md"}
"""targets that need a source -> description of the source"""
SEQUENCES = ("interactions", "sor3d", "sor3d-ablation")
"""targets that read or render RGB-D sequences"""
MESHES = ("negative-affordance", "grasp", "grasp-adapt")
"""targets that read meshes if a source is given"""
ADAPTED = "grasp-adapt"
"""target whose outputs have names of their own, beside those of `grasp`"""
RENDERED = ("dataset", "recordings", "scenes", "extraction-report")
"""targets that use every rendered clip if no source is given"""
PART = re.compile(r"_s\d+")
"""suffix of a video's name when it is cut into several clips"""


def origin(target: str, source: Path | None, settings: Settings, digest: Callable[[Path], str],
           clips: tuple[str, ...] = ()) -> tuple[Origin, Source | None]:  # fmt: skip
    """Videos of `source`, or the clips that `target` renders.

    From an EPIC root only the videos of `clips` are read, if some are named. UsageError when the folder is not a source, or a
    named rendered clip does not exist.
    """
    if target == ALL:
        return _everything(source, clips, settings, digest), None
    if target in MESHES and source is not None:
        return _meshes(source, digest, "-adapted" if target == ADAPTED else "")
    if target == ADAPTED:
        return Origin(ADAPTED), None
    if target == "motions":
        return _motions(source, settings, digest, clips)
    if target == "grasp-prior":
        return _recorded_grasps(source, settings, digest, clips)
    if target == "static-sets":
        return _pictures(target, source, settings, digest), None
    if target in SEQUENCES:
        return _sequences(target, source, settings, digest), None
    if target in OWN_ROOMS:
        if source is not None:
            raise UsageError(f"--source {source}: {target} renders its own data and reads no source; remove --source")
        return Origin(OWN_ROOMS[target], specs=_synthetic(target, settings).specs), None
    if target == "benchmark":
        return _benchmark(source, settings, digest), None
    if target == "train" and (source is None or _is_dataset(source)):
        return _training_data(source, settings, digest), None
    if source is None:
        rendered = _synthetic(target, settings)
        if target in RENDERED:
            _check_clips(clips, [spec.video_id for spec in rendered.specs])
        return rendered, None
    if not source.exists():
        raise UsageError(f"--source {source}: no such folder; give a folder with videos, see docs/extraction/own-video.md")
    try:
        found = discover(source, digest, clips)
    except ValueError as error:
        raise _refusal(source, error) from error
    videos = tuple(_with_truth(video, found) for video in found.videos)
    if target == "extraction-report" and found.kind == "bare":
        raise UsageError(f"--source {source}: the source has no masks and ground truth to score the extraction by; make the "
                         "data set instead: run dataset --source")
    return Origin(found.name, videos=videos, bare=found.kind == "bare"), found


def _everything(source: Path | None, clips: tuple[str, ...], settings: Settings, digest: Callable[[Path], str]) -> Origin:
    """Origins of the targets that `all` combines; all data are rendered."""
    from maps.everything import CHAIN

    for word, given in (("--source", source), ("--clip", ", ".join(clips))):
        if given:
            raise UsageError(f"{word} {given}: `all` renders the data of every target itself; name one target to use {word}")
    return Origin(ALL, parts=tuple((name, origin(name, None, settings, digest)[0]) for name in CHAIN))


def _refusal(source: Path, error: Exception) -> UsageError:
    """Usage error with the path once, also if the message of the error begins with it."""
    return UsageError(f"--source {source}: {str(error).removeprefix(f'{source}: ')}")


def _check_clips(clips: tuple[str, ...], rendered: list[str]) -> None:
    for clip in clips:
        if not any(clip == name or (clip.startswith(name) and PART.fullmatch(clip[len(name) :])) for name in rendered):
            raise unknown("clip", clip, rendered)


def _benchmark(source: Path | None, settings: Settings, digest: Callable[[Path], str]) -> Origin:
    """Cases in ActAffordance's layout, ours without a source, and folders with predictions of other methods."""
    from afford.dataset.act_affordance import cases, read_tree

    try:
        given = read_tree(source, digest) if source else None
        if given:
            cases(given)
        others = tuple(read_tree(Path(name), digest) for name in settings.twohands.benchmark.predictions)
    except ValueError as error:
        raise UsageError(str(error)) from error
    return Origin(given.name if given else OWN_ROOMS["benchmark-set"], cases=given, predictions=others)


def _motions(source: Path | None, settings: Settings, digest: Callable[[Path], str],
             clips: tuple[str, ...]) -> tuple[Origin, Source | None]:  # fmt: skip
    """Folder or file with hand motion, or a folder with videos; empty where only the graph is needed."""
    from afford.dataset.act_affordance import read_tree

    if source is None:
        return Origin("motions"), None
    if settings.grasping.motion_read.backend == "keypoints" and _has_video(source):
        return _hand_videos(source, settings, digest, clips)
    try:
        files = read_tree(source, digest) if source.is_dir() else None
    except ValueError as error:
        raise UsageError(str(error)) from error
    if files is None and not source.is_file():
        raise UsageError(f"--source {source}: no such file or folder; give hand motion, or a folder with a video of hands")
    if files is None and source.suffix.lower() in VIDEO_SUFFIXES:
        raise UsageError(f"--source {source}: is a video file; give the folder of the video")
    if files is None:
        files = FileTree(source.stem, (FileRef(source.name, digest(source), source.stat().st_size, source),))
    return Origin(files.name, motions=files), None


def _recorded_grasps(source: Path | None, settings: Settings, digest: Callable[[Path], str],
                     clips: tuple[str, ...]) -> tuple[Origin, Source | None]:  # fmt: skip
    """Recorded motion as for `motions`, and the scans in its subfolders named `...meshes`, without those for evaluation."""
    from afford.grasping.imitation.recorded_clips import is_evaluation_scan

    if source is None:
        return Origin("grasp-prior"), None
    data = settings.grasping.human_motion.data
    if data not in ("synthetic", "recorded", "both"):
        raise UsageError(f"human_motion.data: expected synthetic, recorded or both, got {data!r}")
    own = settings.grasping.recordings_read.format
    reading = replace(settings.grasping.motion_read, backend=own)
    found, videos = _motions(source, settings.with_stages(motion_read=reading), digest, clips)
    folders = [one for one in sorted(source.iterdir()) if one.is_dir() and one.name.endswith("meshes")] if source.is_dir() else []
    scans = [tree for folder in folders for tree in _meshes(folder, digest)[0].meshes if not is_evaluation_scan(tree.name)]
    if found.motions is None:
        return found._replace(meshes=tuple(scans)), videos
    kept = tuple(one for one in found.motions.files if one.name.partition("/")[0] not in {folder.name for folder in folders})
    return found._replace(meshes=tuple(scans), motions=FileTree(found.name, kept)), videos


def _has_video(source: Path) -> bool:
    """Return True for a folder with videos or frames; UsageError where it also contains hand motion."""
    found = entries(source) if source.is_dir() else ()
    video = any(one.many or one.suffix in VIDEO_SUFFIXES + PACK_SUFFIXES or (one.suffix in IMAGE_SUFFIXES and not one.top)
                for one in found)  # fmt: skip
    motion = next((one.name for one in found if one.suffix == ".npz"), None)
    if video and motion is not None:
        raise UsageError(f"--source {source}: has both video and hand motion ({motion}); put them into two folders")
    return video


def _hand_videos(source: Path, settings: Settings, digest: Callable[[Path], str],
                 clips: tuple[str, ...]) -> tuple[Origin, Source]:  # fmt: skip
    """Videos of a folder, for the motion of the hands in them."""
    if "hand_landmarks" not in dict(settings.weights):
        raise UsageError(f"--source {source}: hand motion from video needs the landmark networks, which set-up could not fetch; "
                         "run `python install/landmark_files.py`")
    try:
        found = discover(source, digest, clips)
    except ValueError as error:
        raise _refusal(source, error) from error
    return Origin(found.name, videos=tuple(_with_truth(video, found) for video in found.videos), bare=found.kind == "bare"), found


def _meshes(source: Path, digest: Callable[[Path], str], suffix: str = "") -> tuple[Origin, Source]:
    """Objects of a folder of meshes, of one mesh file, or of UniDexGrasp's assets; `suffix` of the name of the run."""
    from afford.surface.meshes import unidexgrasp
    from afford.surface.meshes.discover import discover as find

    try:
        assets = unidexgrasp.find_assets(source)
        found = unidexgrasp.discover(source, assets, digest) if assets else find(source, digest)
    except ValueError as error:
        raise _refusal(source, error) from error
    refused = tuple(Refused(one.name, one.reason) for one in found.refused)
    return Origin(found.name + suffix, meshes=found.objects), Source("meshes", found.name, found.objects, {}, (), refused)


def _sequences(target: str, source: Path | None, settings: Settings, digest: Callable[[Path], str]) -> Origin:
    """Sequences of a root in the layout of SOR3D-AFF, none if they are rendered; action clips for pretraining."""
    from afford.dataset.act_affordance import read_tree
    from afford.dataset.sor3d_layout import discover_sequences as find

    try:
        found = find(source, digest) if source else ()
        actions = read_tree(Path(settings.rgbd.sor3d_report.actions), digest) if settings.rgbd.sor3d_report.actions else None
    except ValueError as error:
        raise (_refusal(source, error) if source else UsageError(f"sor3d_report.actions: {error}")) from error
    name = OWN_ROOMS[target] if source is None else source.resolve().name
    return Origin(name if source is None or target == "interactions" else f"{target}-{name}", sequences=found, actions=actions)


def _pictures(target: str, source: Path | None, settings: Settings, digest: Callable[[Path], str]) -> Origin:
    """Pictures for the static sets, none if they are the last frames of rendered sequences.

    The training data are always rendered.
    """
    from afford.rgbd.readers.static_set import static_root_files

    learned = _sequences(target, None, settings, digest)
    if source is None:
        return learned
    try:
        found = static_root_files(source, settings.rgbd.static_read.backend, digest)
    except ValueError as error:
        raise _refusal(source, error) from error
    return learned._replace(name=f"{target}-{found.name}", pictures=found)


def _is_dataset(source: Path) -> bool:
    """Return True for a folder with samples that a model can be trained on directly."""
    from afford.twohands.train.samples import files_below, splits

    try:
        return bool(splits(files_below(source)))
    except ValueError:
        return False


def _training_data(source: Path | None, settings: Settings, digest: Callable[[Path], str]) -> Origin:
    """Data set to train on; rendered stills if no source is given."""
    from afford.dataset.act_affordance import read_tree

    if source is None:
        return Origin(settings.twohands.model_train.variant)
    given = read_tree(source, digest)
    return Origin(given.name, dataset=given)


def _synthetic(target: str, settings: Settings) -> Origin:
    from afford.synthetic.splits import dataset_specs, hard_specs, standard_specs

    if target != "extraction-report":
        return Origin("synthetic", specs=dataset_specs(settings.synthetic.scene_render.seed))
    report = settings.extraction.extraction_report
    specs = standard_specs(report.eval_seed, report.standard_clips) + hard_specs(report.eval_seed, report.hard_clips)
    return Origin(f"synthetic-eval-{report.eval_seed}", specs=specs)


def _with_truth(video: FileTree, source: Source) -> RenderedClip:
    return RenderedClip(video, media_of(video), source.truths.get(video.name, FileTree(video.name, ())))
