"""Pack clips of actions into a data set on which the encoder of SOR3D-AFF's model is pre-trained (sor3d_pretrain).

Reads   ActionClips (UTKinect)
Writes  FileTree: <train or val>/<name>.safetensors in the format of interaction_pack, without flow and label; README.md
Method  a share of the clips is for validation, chosen by the seeded hash of their names
Fails   without clips, or when two clips have one name
Paper   SOR3D-AFF, training: the RGB-D encoder is pre-trained on UTKinect
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.interaction import ActionClip
from schemas.spec import Context

LIBRARIES = ("numpy", "safetensors", "blake3")
THREADS = 1
MEMORY_GIB = 1.0


@dataclass(frozen=True)
class Params:
    """Parameters of `action_pack`."""

    name: str = "actions"
    """name of the data set"""
    licence: str = "unknown"
    """licence of the pictures, which becomes that of the model"""
    val_share: float = 0.2
    """share of the clips for validation"""
    seed: int = 0
    """seed of the choice of validation clips"""


def run(clips: tuple[ActionClip, ...], params: Params, ctx: Context) -> FileTree:
    """Write every clip."""
    from blake3 import blake3

    from afford.common import files
    from afford.dataset import packed_sequences

    names = [clip.name for clip in clips]
    if not names or len(set(names)) < len(names):
        raise ValueError(f"action_pack: expected clips with names of their own, got {len(names)} with {len(set(names))} names")
    root = files.empty_folder(ctx.scratch / "packed")
    for clip in clips:
        chance = int.from_bytes(blake3(f"{params.seed}:{clip.name}".encode()).digest(7), "big") / 2.0**56
        packed_sequences.pack_action(root, clip, "val" if chance < params.val_share else "train")
    (root / "README.md").write_text(f"---\nlicense: {params.licence}\n---\n\n# {params.name}\n\n{len(clips)} clips of actions.\n",
                                    encoding="utf-8", newline="\n")  # fmt: skip
    return files.tree(params.name, root)
