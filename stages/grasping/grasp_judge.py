"""recorded episodes of one policy -> scores of human likeness by a vision-language model.

Reads   HandModel; GraspTasks; GraspEpisodes, of which those with a trace are judged; files of a model (vlm)
Writes  GraspJudgement: a score of 1 to 10 for each trace
Method  frames of an episode, evenly in time, on one sheet; the model marks trajectory, smoothness and coordination together.
        `vlm` asks a local model, `endpoint` one behind an OpenAI-compatible server. Only where one is named is the stage in a graph
Fails   when there is no model or server, no key where one is asked for, or the answer has no number from 1 to 10
Paper   AffordDex, HLS: Gemini 2.5 Pro on the video, 1 to 10, the same three criteria; our words, and frames instead of a video
"""

from __future__ import annotations

from dataclasses import dataclass

from afford.models.chat import Chat, Endpoint
from schemas.episodes import GraspEpisodes, GraspJudgement
from schemas.files import FileTree
from schemas.grasp import GraspTask
from schemas.hand import HandModel

LIBRARIES = ("numpy", "numba", "scipy", "pillow", "opencv-python-headless", "trimesh", "matplotlib")
BACKEND_LIBRARIES = {"vlm": ("torch", "transformers", "safetensors")}
THREADS = 1
MEMORY_GIB = 1.5
BACKEND_MEMORY_GIB = {"vlm": 8.0}
BACKEND_GPUS = {"vlm": "vlm.device"}
GPU_SHARED = True
BACKEND_TIMEOUT_S = {"vlm": 86400.0}  # reports no progress; hours on a CPU

BACKENDS = {"vlm": "afford.grasping.judge:judge_by_model", "endpoint": "afford.grasping.judge:judge_by_server"}


@dataclass(frozen=True)
class Params:
    """Parameters of grasp_judge."""

    backend: str = "vlm"
    """vlm or endpoint"""
    frames: int = 12
    """frames of an episode on one sheet"""
    width: int = 240
    """width of a frame, px"""
    height: int = 180
    """height of a frame, px"""
    vlm: Chat = Chat(new_tokens=256)
    """parameters of vlm"""
    endpoint: Endpoint = Endpoint(new_tokens=256)
    """parameters of endpoint"""

    def __post_init__(self) -> None:
        if self.frames < 1:
            raise ValueError(f"expected frames of 1 or more, got {self.frames}")


def is_named(params: Params) -> bool:
    """Test whether a model or a server is named; without one the stage is not part of a graph."""
    named = {"vlm": params.vlm.model, "endpoint": params.endpoint.model or params.endpoint.url}
    return bool(named.get(params.backend))


def run(hand: HandModel, tasks: tuple[tuple[GraspTask, ...], ...], episodes: GraspEpisodes, params: Params,
        weights: FileTree | None = None) -> GraspJudgement:  # fmt: skip
    """Judge every trace."""
    import numpy as np

    from afford.common.registry import block, load
    from afford.grasping.env.rendering import GraspRenderer
    from afford.models.weights import with_local_weights

    own = block(params, params.backend)
    judge, given = load(BACKENDS, params.backend), with_local_weights(own, weights)
    known, scores = {one.name: one for some in tasks for one in some}, list[float]()
    for trace in episodes.traces:
        if trace.task not in known:
            raise ValueError(f"grasp_judge, {episodes.name}: no task is named {trace.task}; pass the tasks that the policy "
                             "was evaluated on")
        rows = np.linspace(0, len(trace.q) - 1, params.frames).round().astype(int)
        renderer = GraspRenderer(hand, known[trace.task], params.width, params.height)
        frames = np.stack([renderer.render(trace, row).rgb for row in rows.tolist()])
        scores.append(judge(trace.name, frames, rows / trace.rate_hz, given))
    return GraspJudgement(episodes.name, episodes.policy, episodes.engine, params.backend, own.model,
                          tuple(trace.name for trace in episodes.traces), np.array(scores, np.float64))  # fmt: skip
