"""Record a policy: the curves of its training, then episodes.

Reads   HandModel; GraspTasks of the episodes; TrainingLog and FileTree of hand_imitation, rl_grasp_refinement or grasp_student
Writes  FileTree of one file, <name>.mcap: a topic per curve with flat doubles, then an episode of some tasks as pictures; the
        parameters
Method  log time is the fixed base of all recordings plus a millisecond per step; the episodes follow at their own rate. MuJoCo,
        the policy's mean action, a software renderer
Fails   when the training has no curve, without tasks, when the files are not a policy
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.grasp import GraspTask
from schemas.hand import HandModel
from schemas.spec import Context
from schemas.training import TrainingLog

LIBRARIES = ("numpy", "numba", "scipy", "torch", "mujoco", "pybullet", "gymnasium", "trimesh", "safetensors", "pillow",
             "opencv-python-headless", "mcap", "mcap-protobuf-support", "foxglove-schemas-protobuf", "protobuf", "zstandard",
             "blake3")  # fmt: skip
THREADS = 1
MEMORY_GIB = 1.5


@dataclass(frozen=True)
class Params:
    """Parameters of `policy_record`."""

    stage: str = "rl_grasp_refinement"
    """stage that trained; its name is the first word of every topic"""
    episodes: int = 2
    """tasks with an episode, spread over all; 0 for curves only"""
    width: int = 320
    """width of the pictures, px"""
    height: int = 240
    """height of the pictures, px"""
    supersample: int = 1
    """samples per pixel and axis"""
    seed: int = 0
    """seed of initial poses"""
    parameters: tuple[tuple[str, str], ...] = ()
    """(stage, its parameters as JSON)"""


def run(hand: HandModel, tasks: tuple[tuple[GraspTask, ...], ...], log: TrainingLog, files: FileTree, params: Params,
        ctx: Context) -> FileTree:  # fmt: skip
    """Run episodes of the policy, draw them, and write the recording."""
    from afford.grasping.env.rendering import GraspRenderer
    from afford.grasping.evaluate.evaluate_policy import example_episodes, spread
    from afford.recording.grasps import record_policy
    from afford.recording.mcap_files import as_tree, write_recording
    from afford.recording.provenance import of_files, with_parameters

    known = [one for some in tasks for one in some]
    if not log.curves or not known:
        raise ValueError(f"policy_record, {log.name}: expected curves and tasks to record, got {len(log.curves)} curves and "
                         f"{len(known)} tasks")
    chosen = spread(known, params.episodes)
    traces = example_episodes(hand, chosen, files, params.seed) if chosen else []
    shown = [GraspRenderer(hand, task, params.width, params.height, params.supersample).episode(trace)
             for task, trace in zip(chosen, traces, strict=True)]  # fmt: skip
    path = ctx.scratch / f"{log.name}.mcap"
    recording = of_files(record_policy(log, params.stage, shown), params.stage, files)
    write_recording(path, with_parameters(recording, params.parameters))
    return as_tree(log.name, path)
