"""Record the episodes of one policy, with a film of all of them and a sheet of their key moments.

Reads   HandModel; GraspTasks; GraspEpisodes, of which only those with a trace are shown
Writes  FileTree of <name>.mcap (docs/recordings.md), <name>.mp4 (all traces in a grid) and <name>.png (a row for each trace:
        begin, reach, close, lift, end)
Method  links by forward kinematics from the joints of the trace; a software renderer, no physics engine; no wall clock
Fails   ValueError without a trace, or when the task or hand of a trace is not given
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.episodes import GraspEpisodes
from schemas.files import FileTree
from schemas.grasp import GraspTask
from schemas.hand import HandModel
from schemas.spec import Context

LIBRARIES = ("numpy", "numba", "scipy", "trimesh", "opencv-python-headless", "av", "matplotlib", "pillow", "mcap",
             "mcap-protobuf-support", "foxglove-schemas-protobuf", "protobuf", "zstandard", "blake3")  # fmt: skip
THREADS = 1
MEMORY_GIB = 1.0


@dataclass(frozen=True)
class Params:
    """Parameters of `grasp_record`."""

    width: int = 320
    """width of the pictures, px, even"""
    height: int = 240
    """height of the pictures, px, even"""
    supersample: int = 2
    """samples per pixel and axis"""
    columns: int = 3
    """columns of the film's grid"""
    seed: int = 0
    """seed of the points sampled on the hand's meshes"""


def run(hand: HandModel, tasks: tuple[tuple[GraspTask, ...], ...], episodes: GraspEpisodes, params: Params,
        ctx: Context) -> FileTree:  # fmt: skip
    """Draw each row of each trace once, and write all three files."""
    from afford.common.files import empty_folder, tree
    from afford.grasping.env.rendering import GraspRenderer
    from afford.grasping.evaluate.grasp_sheet import write_film, write_sheet
    from afford.recording.grasps import record_grasps
    from afford.recording.mcap_files import write_recording
    from afford.recording.provenance import of_grasps

    known = {one.name: one for some in tasks for one in some}
    missing = sorted({trace.task for trace in episodes.traces} - set(known))
    if missing or not episodes.traces:
        raise ValueError(f"grasp_record, {episodes.name}: expected traces of the tasks that are given, got "
                         f"{'no trace' if not episodes.traces else f'task {missing[0]}'}; evaluate with traces=6, give its tasks")
    studios = {name: GraspRenderer(hand, known[name], params.width, params.height, params.supersample)
               for name in sorted({trace.task for trace in episodes.traces})}  # fmt: skip
    shown = {f"{episodes.policy} {k}": studios[trace.task].episode(trace) for k, trace in enumerate(episodes.traces, 1)}
    root = empty_folder(ctx.scratch / "grasps")
    recording = record_grasps(episodes, tuple(shown.values()), hand, params.seed)
    write_recording(root / f"{episodes.name}.mcap", of_grasps(recording, episodes, hand))
    write_film(root / f"{episodes.name}.mp4", shown, params.columns)
    write_sheet(root / f"{episodes.name}.png", shown)
    return tree(episodes.name, root)
