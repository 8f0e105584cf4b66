"""Import released 2HAff and LISA checkpoints as the folder of a `vlm` model.

Released names become those of the model. Tensors that the released format leaves out are made and named: low-rank updates (merged
before release), which then change nothing, and, for LISA, which has one decoder and no taxonomy, a random taxonomy head. The image
tower is always CLIP's own, and is given with the checkpoint. All other tensors must fit.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import torch
from torch import Tensor, nn
from transformers import LlavaConfig, LlavaForConditionalGeneration, SamConfig, SamModel

from afford.models.importing import Imported, shapes_of
from afford.models.importing.llava import CLIP_ONLY, language_fields, llava_name, llava_sizes
from afford.models.importing.sam import config_text, sam_name, sam_sizes, sam_title
from afford.models.importing.source import Source
from afford.models.tokens import IMAGE, SEG, FileTokens
from afford.twohands.model.interface import ModelConfig, TwoHands, build
from afford.twohands.model.model_folder import config_json
from schemas.video import SIDES

IGNORED = re.compile(r"rotary_emb\.inv_freq$|position_ids$|pixel_(mean|std)$")
"""computed buffers that older versions saved"""
GROWS = ("vlm.model.language_model.embed_tokens.weight", "vlm.lm_head.weight")
"""released vocabularies have no row for <image>, which is not used; the model has this row last"""
HANDS = (
    (r"^mask_decoder_left\.\w*(taxonomy|class)\w*\.", "taxonomy."),
    (r"^mask_decoder_left\.", "decoders.0."),
    (r"^mask_decoder_right\.", "decoders.1."),
    (r"^taxonomy\.layers\.0\.", "taxonomy.proj_in."),
    (r"^taxonomy\.layers\.1\.", "taxonomy.layers.0."),
    (r"^taxonomy\.layers\.2\.", "taxonomy.proj_out."),
)
"""(pattern, replacement), one after the other, for SAM's part; the name of the taxonomy head is not documented, so any name with
taxonomy or class is accepted"""
SAM, PROJECTION = "model.visual_model.", "model.text_hidden_fcs.0."


def our_names(name: str, decoders: int = 2) -> list[str]:
    """Names of a released tensor in the model: none for a computed buffer, both decoders for the single one of LISA."""
    if IGNORED.search(name):
        return []
    if ".mask_decoder." in name:
        sides = SIDES[:decoders]
        return [one for side in sides for one in our_names(name.replace(".mask_decoder.", f".mask_decoder_{side}."), decoders)]
    name = re.sub(r"^base_model\.model\.", "", name)
    if name.startswith(SAM):
        name = name.removeprefix(SAM)
        for pattern, replacement in HANDS:
            name = re.sub(pattern, replacement, name)
        return ["regions." + sam_name(name)]
    if name.startswith(PROJECTION):
        return ["project." + name.removeprefix(PROJECTION)]
    placed = llava_name(name)
    if placed == name and not name.startswith("lm_head."):
        return [name]  # unknown: the error gives it as the file has it
    name = f"vlm.{placed}"
    return [name if ".vision_tower." in name else ADAPTED.sub(r".\1.base_layer.weight", name)]


ADAPTED = re.compile(r"\.(q_proj|v_proj)\.weight$")


LORA_A = re.compile(r"\.lora_A\.")
NOTES = {
    "2haff": "the answer is generated, and regions exist only where it contains [SEG]",
    "lisa": "one decoder serves both hands; the taxonomy head is random, since LISA has none: give --hands",
}


def import_2haff(source: Source) -> Imported:
    """Read a released 2HAff checkpoint (`Kind`); tokenizer.json and, where it lacks the image tower, CLIP must be beside it."""
    return _import(source, 2, "2haff", "2HandedAfforder")


def import_lisa(source: Source) -> Imported:
    """Read a released LISA checkpoint (`Kind`), as `import_2haff`."""
    return _import(source, 1, "lisa", "LISA")


def _import(source: Source, decoders: int, kind: str, named: str) -> Imported:
    published = {name: tensor for name, tensor in source.tensors.items() if not CLIP_ONLY.match(name) and our_names(name)}
    given = {ours: tensor for name, tensor in published.items() for ours in our_names(name, decoders)}
    words = source.tokenizer()
    if not words:
        raise ValueError(f"expected a tokenizer.json beside the checkpoint of {named}, found none; load the tokenizer of the "
                         "checkpoint with transformers, add its [SEG], and save_pretrained writes one")
    tokens = FileTokens(words)
    rows = given.get(GROWS[0])
    if rows is not None and tokens.id(SEG) >= len(rows):
        raise ValueError(f"tokenizer.json: expected [SEG] among the {len(rows)} tokens of the checkpoint, got none; add the tokens "
                         "in the order of the training ([SEG], then <im_start> and <im_end>)")
    plain = {name.replace(".base_layer.", "."): tensor for name, tensor in given.items()}
    llava = LlavaConfig(**llava_sizes(plain, "vlm.model.", language_fields(source)), image_token_index=tokens.id(IMAGE))
    sam = SamConfig(**sam_sizes(given, "regions.image_encoder.", "regions.decoders.0.", "regions.prompt_encoder."))
    side = int(sam.vision_config.image_size)
    config = ModelConfig(variant="vlm", size_px=(side, side), hypotheses=1, decoders=decoders, seg_state="code")
    texts = {"vlm/config.json": config_text(llava, LlavaForConditionalGeneration), "vlm/tokenizer.json": tokens.to_json(),
             "sam/config.json": config_text(sam, SamModel)}  # fmt: skip
    model = empty_model(config, texts)
    expected = shapes_of(model)
    grown = {name: _with_row(given[name], len(expected[name])) for name in GROWS if name in given and name in expected}
    fresh = {name: _fresh(name, tensor) for name, tensor in expected.items() if name not in given and FRESH.search(name)}
    count = sum(tensor.numel() for tensor in published.values())
    return Imported(f"{named} {count / 1e9:.1f}B with {sam_title(sam)}", "predict PICTURE TASK --model DIR --dtype bfloat16",
                    {**texts, "config.json": config_json(config)}, {**given, **grown, **fresh}, expected, tuple(sorted(fresh)),
                    counted=count, notes=(NOTES[kind],))  # fmt: skip


FRESH = re.compile(r"\.lora_[AB]\.|^regions\.taxonomy\.")
"""tensors that a released checkpoint may lack, and that an import makes"""


def empty_model(config: ModelConfig, texts: Mapping[str, str]) -> TwoHands:
    """Build a model without memory from the texts of its backbones' configs."""
    with TemporaryDirectory() as scratch:
        for name, text in texts.items():
            (Path(scratch) / name).parent.mkdir(exist_ok=True)
            (Path(scratch) / name).write_text(text, encoding="utf-8")
        fields: dict[str, Any] = {**config.__dict__, "backbones": scratch}
        with torch.device("meta"):
            return build(ModelConfig(**fields), 0, pretrained=False)


def _with_row(tensor: Tensor, rows: int) -> Tensor:
    """Add a row of zeros for <image>, which no published vocabulary has, and no answer contains."""
    return torch.cat([tensor, tensor.new_zeros(1, tensor.shape[1])]) if len(tensor) == rows - 1 else tensor


def _fresh(name: str, like: Tensor) -> Tensor:
    """Values of a tensor that a checkpoint lacks: no update of a projection, or a random layer, by its name alone."""
    made = torch.zeros(like.shape)
    if LORA_A.search(name) or (name.startswith("regions.taxonomy.") and name.endswith(".weight")):
        generator = torch.Generator().manual_seed(sum(name.encode()))
        nn.init.kaiming_uniform_(made, a=math.sqrt(5), generator=generator)
    return made
