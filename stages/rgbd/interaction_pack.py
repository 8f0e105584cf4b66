"""Pack RGB-D interactions and their scene flow into the data set of sor3d_train and boxes_train.

Reads   InteractionClips of both splits, the SceneFlow of each
Writes  FileTree: <split>/<name>.safetensors (colours, depth in 0.1 mm, both flows as colours, label), README.md
Method  one file per sequence; a training reads them in random order
Fails   when a clip has no flow, a flow no clip, or two clips have one name
Paper   SOR3D-AFF, data
"""

from __future__ import annotations

from dataclasses import dataclass

from schemas.files import FileTree
from schemas.interaction import InteractionClip, SceneFlow
from schemas.spec import Context

LIBRARIES = ("numpy", "safetensors", "blake3")
THREADS = 1
MEMORY_GIB = 1.0


@dataclass(frozen=True)
class Params:
    """Parameters of `interaction_pack`."""

    name: str = "interactions"
    """name of the data set"""
    licence: str = "unknown"
    """licence of the pictures, which becomes that of the model"""


def run(clips: tuple[InteractionClip, ...], flows: tuple[SceneFlow, ...], params: Params, ctx: Context) -> FileTree:
    """Write every clip with its flow."""
    from afford.common import files
    from afford.dataset import packed_sequences

    by_name = {flow.name: flow for flow in flows}
    names = [clip.name for clip in clips]
    if len(set(names)) < len(names) or set(names) != by_name.keys():
        wrong = sorted(set(names) ^ by_name.keys()) or sorted({name for name in names if names.count(name) > 1})
        raise ValueError("interaction_pack: expected one clip and one scene flow for each name, got otherwise for "
                         f"{', '.join(wrong[:4])}")
    root = files.empty_folder(ctx.scratch / "packed")
    for done, clip in enumerate(clips, 1):
        packed_sequences.pack_sequence(root, clip, by_name[clip.name])
        ctx.progress(done, len(clips))
    (root / "README.md").write_text(f"---\nlicense: {params.licence}\n---\n\n# {params.name}\n\n{len(clips)} RGB-D interactions.\n",
                                    encoding="utf-8", newline="\n")  # fmt: skip
    return files.tree(params.name, root)
