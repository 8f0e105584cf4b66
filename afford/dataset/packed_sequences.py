"""RGB-D sequences packed for random access by training: one safetensors file each, `<split>/<name>.safetensors`."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save_file

from schemas.interaction import AFFORDANCES, BACKGROUND, ActionClip, InteractionClip, SceneFlow

WORDS = "words"
DEPTH_PER_M = 1e4
"""units per metre of stored depth: tenths of a millimetre, up to 6.5 m"""
FLOWS = {"2d": "flow_2d", "3d": "flow_3d"}


@dataclass(frozen=True)
class PackedSequence:
    """Packed sequence, decoded."""

    name: str
    object_type: str
    affordance: str
    """affordance, or action in a set of actions"""
    rgb: np.ndarray
    """(t, h, w, 3) uint8"""
    depth_m: np.ndarray
    """(t, h, w) float32, 0 = hole"""
    flow: np.ndarray
    """(t - 1, h, w, 3) uint8 flow colours; (0, h, w, 3) when no flow was requested"""
    still: np.ndarray
    """(3,) uint8 colour of zero motion"""
    label: np.ndarray
    """(h, w) uint8 label of the last frame"""


def pack_sequence(root: Path, clip: InteractionClip, flow: SceneFlow) -> None:
    """Pack one sequence. Raises ValueError when the flow belongs to another clip."""
    if clip.name != flow.name or len(flow.colour) != len(clip.rgb) - 1:
        raise ValueError(f"{clip.name}: expected its own scene flow with {len(clip.rgb) - 1} pairs, got {flow.name} with "
                         f"{len(flow.colour)}")
    words = {"name": clip.name, "object_type": clip.object_type, "affordance": clip.affordance}
    _save(root / clip.split, words, clip.rgb, clip.depth_m, flow.colour, flow.colour_px, flow.still, clip.label)


def pack_action(root: Path, clip: ActionClip, split: str) -> None:
    """Pack one clip of an action, which has neither flow nor label."""
    none, label = np.zeros((0, *clip.rgb.shape[1:]), np.uint8), np.full(clip.rgb.shape[1:3], BACKGROUND, np.uint8)
    words = {"name": clip.name, "object_type": "", "affordance": clip.action}
    _save(root / split, words, clip.rgb, clip.depth_m, none, none, np.zeros(6, np.uint8), label)


def _save(folder: Path, words: dict[str, str], rgb: np.ndarray, depth_m: np.ndarray, flow_3d: np.ndarray, flow_2d: np.ndarray,
          still: np.ndarray, label: np.ndarray) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    depth = np.clip(np.round(depth_m * DEPTH_PER_M), 0, 65535).astype(np.uint16)
    save_file({"rgb": rgb, "depth": depth, "flow_3d": flow_3d, "flow_2d": flow_2d, "still": still, "label": label},
              folder / f"{words['name']}.safetensors", {WORDS: json.dumps(words)})  # fmt: skip


def read_sequence(path: Path, flow: str) -> PackedSequence:
    """Read a sequence with its flow `2d`, `3d` or `none`. Raises ValueError for another file."""
    try:
        with safe_open(path, framework="numpy") as file:
            words = json.loads(file.metadata()[WORDS])
            rgb, depth, still, label = (file.get_tensor(name) for name in ("rgb", "depth", "still", "label"))
            colour = file.get_tensor(FLOWS[flow]) if flow in FLOWS else np.zeros((0, *rgb.shape[1:]), np.uint8)
    except (SafetensorError, KeyError, TypeError, OSError) as error:
        raise ValueError(f"{path.name}: not a sequence that interaction_pack wrote ({error})") from error
    part = still[3:] if flow == "2d" else still[:3]
    depth_m = (depth / DEPTH_PER_M).astype(np.float32)
    return PackedSequence(words["name"], words["object_type"], words["affordance"], rgb, depth_m, colour, part, label)


def read_classes(path: Path) -> tuple[str, str]:
    """Read (object type, affordance) of a packed sequence from its header alone."""
    with safe_open(path, framework="numpy") as file:
        words = json.loads(file.metadata()[WORDS])
    return words["object_type"], words["affordance"]


def read_label(path: Path) -> np.ndarray:
    """Read the label (h, w) uint8 of the last frame of a packed sequence."""
    with safe_open(path, framework="numpy") as file:
        found: np.ndarray = file.get_tensor("label")
    return found


def split_files(files: Mapping[str, Path], split: str) -> list[Path]:
    """Return the sequences of a split, sorted by name. Raises ValueError when there is none."""
    found = [files[name] for name in sorted(files) if name.startswith(f"{split}/") and name.endswith(".safetensors")]
    if not found:
        raise ValueError(f"data set: expected sequences {split}/*.safetensors, found none; pack clips of train and val")
    return found


def affordance_index(affordance: str) -> int:
    """Return the class of an affordance, 0..8. Raises ValueError for an unknown one."""
    if affordance not in AFFORDANCES:
        raise ValueError(f"affordance: expected one of {', '.join(AFFORDANCES)}, got {affordance!r}")
    return AFFORDANCES.index(affordance)
