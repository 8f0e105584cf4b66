"""Tiny random models that tests save to a folder and load with the real loading code; nothing here is trained."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from tokenizers import Tokenizer, decoders, models, pre_tokenizers, trainers
from transformers import (
    CLIPConfig,
    CLIPImageProcessorPil,
    CLIPModel,
    CLIPVisionConfig,
    LlamaConfig,
    LlavaConfig,
    LlavaForConditionalGeneration,
    LlavaProcessor,
    PreTrainedTokenizerFast,
    Sam2VideoConfig,
    Sam2VideoModel,
    Sam3Config,
    Sam3Model,
    SamConfig,
    SamModel,
)

from afford.models import chat_model
from afford.models.chat_model import inputs, load_model
from afford.models.xmem_network import XMem, XMemConfig

TURNS = ("{% for turn in messages %}{{ turn['role'] }}: {% for one in turn['content'] %}"
         "{% if one['type'] == 'image' %}<image>\n{% else %}{{ one['text'] }}{% endif %}{% endfor %}\n{% endfor %}"
         "{% if add_generation_prompt %}assistant: {% endif %}")  # fmt: skip
"""a chat template"""


def save_sam2_video(folder: Path, seed: int = 0) -> Path:
    """A Sam2VideoModel of about a million parameters at 128 x 128, random from a seed."""
    torch.manual_seed(seed)
    backbone = {
        "model_type": "sam2_hiera_det_model", "hidden_size": 16, "image_size": [128, 128], "blocks_per_stage": [1, 1, 2, 1],
        "embed_dim_per_stage": [16, 32, 64, 128], "num_attention_heads_per_stage": [1, 1, 1, 1],
        "window_size_per_stage": [8, 4, 4, 4], "global_attention_blocks": [3], "num_attention_heads": 1,
    }  # fmt: skip
    vision = {
        "backbone_config": backbone, "backbone_channel_list": [128, 64, 32, 16], "fpn_hidden_size": 128,
        "backbone_feature_sizes": [[32, 32], [16, 16], [8, 8]],
    }  # fmt: skip
    config = Sam2VideoConfig(
        vision_config=vision,
        prompt_encoder_config={"hidden_size": 128, "image_size": 128, "patch_size": 16},
        mask_decoder_config={"hidden_size": 128, "mlp_dim": 64, "num_attention_heads": 4, "iou_head_hidden_dim": 32},
        image_size=128, memory_attention_hidden_size=128, memory_attention_num_layers=1,
        memory_attention_feed_forward_hidden_size=64, memory_attention_rope_feat_sizes=[8, 8], memory_encoder_hidden_size=128,
        memory_encoder_output_channels=64, mask_downsampler_embed_dim=128, memory_fuser_embed_dim=128,
        memory_fuser_intermediate_dim=64, memory_fuser_num_layers=1,
    )  # fmt: skip
    model = Sam2VideoModel(config)
    torch.nn.init.ones_(model.mask_decoder.pred_obj_score_head.proj_out.bias)  # so that no object is ever thought to be hidden
    model.save_pretrained(folder)
    return folder


def save_sam3(folder: Path, seed: int = 0) -> Path:
    """A Sam3Model at 56 x 56 with its tokenizer, random from a seed."""
    torch.manual_seed(seed)
    small = {"hidden_size": 32, "intermediate_size": 64, "num_attention_heads": 2}
    tokenizer = bytes_tokenizer()
    words = {"vocab_size": tokenizer.get_vocab_size(), "pad_token_id": 0, "bos_token_id": 1, "eos_token_id": 2}
    backbone = {"model_type": "sam3_vit_model", **small, "num_hidden_layers": 2, "image_size": 56, "window_size": 2,
                "global_attn_indexes": [1], "pretrain_image_size": 28}  # fmt: skip
    config = Sam3Config(
        vision_config={"backbone_config": backbone, "fpn_hidden_size": 32, "backbone_feature_sizes": [[16, 16], [8, 8], [4, 4]]},
        text_config={**small, **words, "model_type": "clip_text_model", "num_hidden_layers": 2, "max_position_embeddings": 32,
                     "projection_dim": 32},
        geometry_encoder_config={**small, "num_layers": 1}, detr_encoder_config={**small, "num_layers": 1},
        detr_decoder_config={**small, "num_layers": 1, "num_queries": 4},
        mask_decoder_config={"hidden_size": 32, "num_attention_heads": 2, "num_upsampling_stages": 2},
    )  # fmt: skip
    Sam3Model(config).save_pretrained(folder)
    (folder / "tokenizer.json").write_text(tokenizer.to_str())
    return folder


def save_backbones(folder: Path, patch: int = 16, seed: int = 0) -> Path:
    """Save `vlm/` (LLaVA of CLIP and Llama), `clip/` and `sam/` at 64 x 64, random from a seed.

    The byte-level tokenizer was trained on five words.
    """
    torch.manual_seed(seed)
    shape = {"hidden_size": 32, "intermediate_size": 64, "num_hidden_layers": 2, "num_attention_heads": 2}
    vision = CLIPVisionConfig(**shape, image_size=64, patch_size=patch, projection_dim=32)
    tokenizer = bytes_tokenizer()
    words = {"vocab_size": tokenizer.get_vocab_size(), "pad_token_id": 0, "bos_token_id": 1, "eos_token_id": 2}
    text = LlamaConfig(**shape, **words, num_key_value_heads=2)
    image = tokenizer.token_to_id("<image>")
    llava = LlavaConfig(vision_config=vision, text_config=text, image_token_index=image)
    LlavaForConditionalGeneration(llava).save_pretrained(folder / "vlm")
    read = {**shape, **words, "max_position_embeddings": 40}
    CLIPModel(CLIPConfig(text_config=read, vision_config=vision.to_dict(), projection_dim=32)).save_pretrained(folder / "clip")
    sam = SamConfig(
        vision_config={"hidden_size": 32, "output_channels": 32, "num_hidden_layers": 2, "num_attention_heads": 2,
                       "image_size": 64, "global_attn_indexes": [1], "window_size": 2, "num_pos_feats": 16, "mlp_ratio": 2.0,
                       "initializer_range": 0.02},
        prompt_encoder_config={"hidden_size": 32, "image_size": 64},
        mask_decoder_config={"hidden_size": 32, "mlp_dim": 64, "num_attention_heads": 2, "iou_head_hidden_dim": 32},
    )  # fmt: skip
    SamModel(sam).save_pretrained(folder / "sam")
    for name in ("vlm", "clip"):
        (folder / name / "tokenizer.json").write_text(tokenizer.to_str())
    return folder


def bytes_tokenizer(texts: Sequence[str] = (), size: int = 300) -> Tokenizer:
    """Byte-level BPE with <pad>, <s>, </s> and <image>, and without [SEG]; trained on `texts`, or on five words."""
    tokenizer = Tokenizer(models.BPE())
    tokenizer.pre_tokenizer = pre_tokenizers.ByteLevel(add_prefix_space=False)
    special = ["<pad>", "<s>", "</s>", "<image>"]
    alphabet = pre_tokenizers.ByteLevel.alphabet()
    trainer = trainers.BpeTrainer(vocab_size=size, special_tokens=special, initial_alphabet=alphabet, show_progress=False)
    tokenizer.train_from_iterator(texts or ["pour tea from the kettle"], trainer)
    return tokenizer


def save_chat(folder: Path, texts: Sequence[str] = (), seed: int = 0) -> Path:
    """A LLaVA with its processor at 64 x 64, random from a seed, whose byte-level tokenizer has the words of `texts` as tokens."""
    torch.manual_seed(seed)
    shape = {"hidden_size": 64, "intermediate_size": 128, "num_hidden_layers": 2, "num_attention_heads": 4}
    tokenizer = bytes_tokenizer(texts, 1000)
    tokenizer.decoder = decoders.ByteLevel()
    vision = CLIPVisionConfig(**shape, image_size=64, patch_size=16, projection_dim=32)
    text = LlamaConfig(**shape, vocab_size=tokenizer.get_vocab_size(), pad_token_id=0, bos_token_id=1, eos_token_id=2,
                       num_key_value_heads=4)  # fmt: skip
    config = LlavaConfig(vision_config=vision, text_config=text, image_token_index=tokenizer.token_to_id("<image>"))
    LlavaForConditionalGeneration(config).save_pretrained(folder)
    words = PreTrainedTokenizerFast(tokenizer_object=tokenizer, pad_token="<pad>", bos_token="<s>", eos_token="</s>",
                                    extra_special_tokens={"image_token": "<image>"})  # fmt: skip
    pictures = CLIPImageProcessorPil(size={"shortest_edge": 64}, crop_size={"height": 64, "width": 64})
    LlavaProcessor(pictures, words, patch_size=16, vision_feature_select_strategy="default", num_additional_image_tokens=1,
                   chat_template=TURNS).save_pretrained(folder)  # fmt: skip
    return folder


def save_parrot(folder: Path, asked: str, answer: str) -> Path:
    """Save a LLaVA that replies `answer` to a prompt that ends as `asked` in its template, and stops.

    It is constructed and not trained: each word of the answer selects the next one, since layers add nothing and the last
    one holds pairs of words.
    """
    chat = load_model(str(save_chat(folder, (asked, answer))))
    model, tokenizer = chat.model, chat.processor.tokenizer
    words = tokenizer.encode(answer + "</s>", add_special_tokens=False)
    before = [int(inputs(chat, asked, np.zeros((64, 64, 3), np.uint8))["input_ids"][0, -1]), *words[:-1]]
    if len({*before}) != len(before):
        raise ValueError(f"{answer!r}: expected an answer in which no word comes twice, got {before}")
    with torch.no_grad():
        for layer in model.model.language_model.layers:
            layer.self_attn.o_proj.weight.zero_()
            layer.mlp.down_proj.weight.zero_()
        embedded = model.get_input_embeddings().weight
        model.lm_head.weight.zero_()
        model.lm_head.weight[words] = embedded[before] / embedded[before].norm(dim=1, keepdim=True)
    model.save_pretrained(folder)
    chat_model._load_cached.cache_clear()
    return folder


XMEM = XMemConfig(width=4, key_dim=8, value_dim=16, hidden_dim=8)


def save_xmem(path: Path, seed: int = 0) -> Path:
    """An XMem of some two hundred thousand parameters, random from a seed, as the release is saved: a flat state dict."""
    torch.manual_seed(seed)
    path.parent.mkdir(parents=True, exist_ok=True)
    torch.save(XMem(XMEM).state_dict(), path)
    return path
