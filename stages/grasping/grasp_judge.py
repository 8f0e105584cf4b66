"""episodes of one policy, step by step -> how much a vision-language model thinks that they look like a person's.

Reads   HandModel; GraspTasks; GraspEpisodes, of which only those with a trace are shown; files of a model (vlm)
Writes  GraspJudgement: a score of 1 to 10 of each trace
Method  frames of an episode, evenly in time, on one sheet; the model marks trajectory, smoothness and coordination together.
        `vlm` asks a local model, `endpoint` one behind an OpenAI-compatible server. Only where one is named is the stage in a graph
Fails   when there is no model or server, no key where one is asked for, or the answer has no number from 1 to 10
Paper   AffordDex, HLS: Gemini 2.5 Pro on the video, 1 to 10, the same three criteria; our words, and frames instead of a video
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.episodes import GraspEpisodes, GraspJudgement
from schemas.files import FileTree
from schemas.grasp import GraspTask
from schemas.hand import HandModel

LIBRARIES = ("numpy", "numba", "scipy", "torch", "transformers", "safetensors", "pillow",
             "opencv-python-headless", "trimesh", "matplotlib")
THREADS = 1
MEMORY_GIB = 1.5

BACKENDS = {"vlm": "afford.grasping.judge.vlm:judge", "endpoint": "afford.grasping.judge.endpoint:judge"}


@dataclass(frozen=True)
class Params:
    backend: str = "vlm"
    """vlm or endpoint"""
    frames: int = 12
    """moments of an episode that are shown, on one sheet"""
    width: int = 240
    """of each, px"""
    height: int = 180
    """px"""
    model: str = ""
    """vlm: local folder or hub id; endpoint: what the server calls its model; '' and no `url`: nobody is asked"""
    new_tokens: int = 256
    """longest answer"""
    url: str = ""
    """endpoint: base address of the server, e.g. http://127.0.0.1:8000/v1"""
    key_variable: str = "OPENAI_API_KEY"
    """endpoint: name of the environment variable that holds the key; '' for a server that asks for none"""
    timeout_s: float = 120.0
    """endpoint: longest that a request lasts as a whole, from the connection to the last byte of the reply"""
    retries: int = 3
    """endpoint: further tries when it cannot be reached, is busy or fails"""
    pause_s: float = 1.0
    """endpoint: before the first of them; twice as long before each further one"""
    seed: int = 0
    """endpoint: sent to the server, which may heed it"""
    device: str = "cpu"
    """vlm: cpu, cuda or cuda:N; bytes differ between kinds of device"""
    dtype: str = "float32"
    """vlm: float32, bfloat16 or float16"""

    def __post_init__(self) -> None:
        """What might be a key is not shown, and is refused before anything is written."""
        from afford.models.api_key import harmless

        harmless(self)
        if self.frames < 1:
            raise ValueError(f"expected frames of 1 or more, got {self.frames}")


def run(hand: HandModel, tasks: tuple[tuple[GraspTask, ...], ...], episodes: GraspEpisodes, params: Params,
        weights: FileTree | None = None) -> GraspJudgement:  # fmt: skip
    """Ask about every trace."""
    import numpy as np

    from afford.common.registry import load
    from afford.grasping.env.studio import Studio
    from afford.models.weights import placed

    given = placed(params, weights)
    judge, known, scores = load(BACKENDS, params.backend), {one.name: one for some in tasks for one in some}, list[float]()
    for trace in episodes.traces:
        if trace.task not in known:
            raise ValueError(f"grasp_judge, {episodes.name}: expected the tasks of its traces, got none named {trace.task}; "
                             "give it the tasks that the policy was examined on")
        rows = np.linspace(0, len(trace.q) - 1, params.frames).round().astype(int)
        studio = Studio(hand, known[trace.task], params.width, params.height)
        frames = np.stack([studio.shoot(trace, row).rgb for row in rows.tolist()])
        scores.append(judge(trace.name, frames, rows / trace.rate_hz, given))
    return GraspJudgement(episodes.name, episodes.policy, episodes.engine, params.backend, params.model,
                          tuple(trace.name for trace in episodes.traces), np.array(scores, np.float64))  # fmt: skip
