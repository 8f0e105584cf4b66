"""2HandedAfforder: a vision-language model answers with [SEG], whose hidden state prompts two SAM mask decoders.

Trained parts: the low-rank updates (LoRA, Hu et al. 2022) of q_proj and v_proj, the embeddings and the output layer of the language
model, the projection, both mask decoders and the taxonomy head. All other weights stay as loaded.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, NamedTuple

import torch
from peft import LoraConfig, inject_adapter_in_model
from torch import Tensor, nn
from torch.nn.functional import cross_entropy
from transformers import LlavaConfig, LlavaForConditionalGeneration, SamModel

from afford.models.normalise import for_tower, normalised
from afford.models.tokens import IMAGE, SEG, HashedTokens, Tokens
from afford.twohands.model.backbones import TINY_VOCABULARY, Regions, backbone, check_size, freeze, tiny_sam, tokens_of
from afford.twohands.model.interface import Batch, ModelConfig, Output, TwoHands

MET = ("published size, random weights, 2026-11: 7B and 13B with SAM ViT-H, a picture in 1496 ms and 2070 ms on an H200; "
       "names of the released checkpoints, written by a test")
QUESTIONS = (
    "Where should each hand touch to {task}? Show the regions.",
    "Which parts does one hold in order to {task}? Mark them.",
    "Somebody wants to {task}. Where do the hands go?",
    "Point out where to put the hands if the task is to {task}.",
)
ANSWERS = (
    "It is [SEG].",
    "The hands go to [SEG].",
    "Here: [SEG].",
    "Sure, the regions are [SEG].",
    "[SEG].",
)
INFERENCE = "Where would you interact with the object to perform action {task}"
"""question outside training, in substance the published one"""
CONVERSATION = "USER: {image}\n{question} ASSISTANT:"
"""text before the answer"""
FRAMED = "<im_start><image><im_end>"
"""the image, for tokenizers with marks around it, such as those of the released models"""


def question(task: str, template: str = INFERENCE, image: str = "<image>") -> str:
    """Text before the answer, with the placeholder of the image."""
    return CONVERSATION.format(image=image, question=template.format(task=task))


IGNORE = -100
"""label of tokens that are not predicted"""


class Dialogue(NamedTuple):
    """Token ids of b questions with answers, padded on the right."""

    ids: Tensor
    """(b, n) int64"""
    keep: Tensor
    """(b, n) bool: False in the padding"""
    labels: Tensor
    """(b, n) int64: the answer's own ids, IGNORE elsewhere"""


def dialogue(tokens: Tokens, pairs: Sequence[tuple[str, str]], image_tokens: int, begin: int, end: int, pad: int) -> Dialogue:
    """Tokenize (question, answer) pairs.

    Every `<image>` becomes as many ids as the vision tower gives tokens, so that ids and hidden states have the same positions.
    """
    rows = []
    for prompt, answered in pairs:
        before, answer = [begin] + _repeat_image(tokens, prompt, image_tokens), tokens.encode(" " + answered) + [end]
        rows.append((before + answer, [IGNORE] * len(before) + answer))
    longest = max(len(ids) for ids, _ in rows)
    ids = torch.tensor([ids + [pad] * (longest - len(ids)) for ids, _ in rows])
    labels = torch.tensor([label + [IGNORE] * (longest - len(label)) for _, label in rows])
    lengths = torch.tensor([len(ids) for ids, _ in rows])
    return Dialogue(ids, torch.arange(longest) < lengths[:, None], labels)


def seg_positions(ids: Tensor, seg: int, state: str = "paper") -> Tensor:
    """Position (b,) of the hidden state of [SEG] in ids (b, n): the token itself (paper), or the one before it (code).

    ValueError when a row does not have exactly one [SEG].
    """
    found = ids == seg
    counts = found.sum(1)
    if (counts != 1).any():
        raise ValueError(f"expected exactly one [SEG] in each row, got {counts.tolist()}")
    return found.int().argmax(1) - int(state == "code")


def _repeat_image(tokens: Tokens, text: str, count: int) -> list[int]:
    image = tokens.id(IMAGE)
    return [one for token in tokens.encode(text) for one in ([token] * count if token == image else [token])]


class Spoken(NamedTuple):
    """A generated answer."""

    text: str
    said: bool
    """it contains [SEG]"""
    state: Tensor
    """(width,) hidden state of its first [SEG], or of its last token without one"""


LONGEST_ANSWER = 32
"""tokens of an answer"""
ADAPTED = r".*language_model\..*\.(q_proj|v_proj)"
TRAINED = re.compile(r"(^|\.)(lora_[AB]\.|lm_head\.|embed_tokens\.)")


class Vlm(TwoHands):
    """Vision-language model, projection and the two-hand decoders of SAM."""

    def __init__(self, config: ModelConfig, vlm: Any, tokens: Tokens, regions: Regions, sam_config: Any) -> None:
        super().__init__()
        self.config, self.tokens = config, tokens
        self.files = {"vlm/config.json": vlm.config.to_json_string(), "vlm/tokenizer.json": tokens.to_json(),
                      "sam/config.json": sam_config.to_json_string()}  # fmt: skip
        width, out = vlm.config.text_config.hidden_size, sam_config.prompt_encoder_config.hidden_size
        self.vlm = with_lora(vlm, config)
        self.project = nn.Sequential(nn.Linear(width, width), nn.ReLU(), nn.Linear(width, out))
        self.regions = regions
        freeze(regions.image_encoder)
        freeze(regions.prompt_encoder)
        for name, parameter in self.vlm.named_parameters():
            parameter.requires_grad_(bool(TRAINED.search(name)))

    def forward(self, batch: Batch) -> Output:
        """Predict the regions of a batch; see `TwoHands`."""
        tokens = self._dialogue(batch)
        hidden = self._hidden(batch.image, tokens)
        where = seg_positions(tokens.ids, self.tokens.id(SEG), self.config.seg_state)
        prompt = self.project(hidden[torch.arange(len(hidden), device=hidden.device), where])[:, None]
        loss = self._text_loss(hidden, tokens.labels) if self.training else None
        logits, score, taxonomy = self._regions(batch.image, prompt)
        return Output(logits, score, taxonomy, loss)

    @torch.no_grad()
    def answer(self, batch: Batch) -> Output:
        """Generate the answer to each task, then decode regions where it contains [SEG]; see `TwoHands`."""
        spoken = [self._generate(image[None], task) for image, task in zip(batch.image, batch.task, strict=True)]
        states = torch.stack([one.state for one in spoken]).to(batch.image.device)
        logits, score, taxonomy = self._regions(batch.image, self.project(states)[:, None])
        said = torch.tensor([one.said for one in spoken], device=batch.image.device)
        return Output(logits, score, taxonomy, answer=tuple(one.text for one in spoken), said=said)

    def _generate(self, image: Tensor, task: str) -> Spoken:
        """Answer about one image (1, 3, H, W), by the most likely token after each other, and the state of its [SEG]."""
        prompt = question(task if self.config.text else "", image=self._image_words())
        begin = self.vlm.config.text_config.bos_token_id
        begun = torch.tensor([[begin, *_repeat_image(self.tokens, prompt, image_tokens(self.vlm.config))]], device=image.device)
        found = self.vlm.generate(
            input_ids=begun, attention_mask=torch.ones_like(begun), pixel_values=self._pixels(image), do_sample=False,
            max_new_tokens=LONGEST_ANSWER, output_hidden_states=True, return_dict_in_generate=True,
            suppress_tokens=[self.tokens.id(IMAGE)])  # fmt: skip
        hidden = [step[-1][:, -1] for step in found.hidden_states]
        ids = found.sequences[0, begun.shape[1] :].tolist()
        seg = self.tokens.id(SEG)
        at = ids.index(seg) if seg in ids else -1
        if at < 0:
            return Spoken(self._words(ids), False, hidden[-1][0])
        if self.config.seg_state == "code":
            return Spoken(self._words(ids), True, hidden[at][0])
        return Spoken(self._words(ids), True, hidden[at + 1][0] if at + 1 < len(hidden) else self._last(image, found.sequences))

    def _words(self, ids: list[int]) -> str:
        end = self.vlm.config.text_config.eos_token_id
        return self.tokens.decode([one for one in ids if one != end])

    def _last(self, image: Tensor, ids: Tensor) -> Tensor:
        """State of the last token of a text, which nothing was generated after."""
        return self._hidden(image, Dialogue(ids, torch.ones_like(ids, dtype=torch.bool), ids))[0, -1]

    def _regions(self, image: Tensor, prompt: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Regions of images (b, 3, H, W) 0..1, in the number type of the weights."""
        dtype = next(self.regions.parameters()).dtype
        found: tuple[Tensor, Tensor, Tensor] = self.regions(normalised(image).to(dtype), prompt)
        return found

    def extra_files(self) -> dict[str, str]:
        """Return the configs of the backbones and the tokenizer."""
        return self.files

    def _dialogue(self, batch: Batch) -> Dialogue:
        """Dialogue about each image.

        In training, question and answer are drawn from torch's random state. Outside training, the question is fixed and the first
        answer is given, because the model has learned the hidden state of its [SEG].
        """
        tasks = [task if self.config.text else "" for task in batch.task]
        image = self._image_words()
        if self.training:
            pairs = [(question(task, _draw(QUESTIONS), image), _draw(ANSWERS)) for task in tasks]
        else:
            pairs = [(question(task, image=image), ANSWERS[0]) for task in tasks]
        text = self.vlm.config.text_config
        pad = text.pad_token_id if text.pad_token_id is not None else text.eos_token_id
        talk = dialogue(self.tokens, pairs, image_tokens(self.vlm.config), text.bos_token_id, text.eos_token_id, pad)
        return Dialogue(*(one.to(batch.image.device) for one in talk))

    def _image_words(self) -> str:
        return IMAGE if self.tokens.find("<im_start>") is None else FRAMED

    def _hidden(self, image: Tensor, talk: Dialogue) -> Tensor:
        """Last hidden states (b, n, width) of the language model."""
        found = self.vlm.model(input_ids=talk.ids, pixel_values=self._pixels(image), attention_mask=talk.keep.long(),
                               use_cache=False)  # fmt: skip
        hidden: Tensor = found.last_hidden_state
        return hidden

    def _pixels(self, image: Tensor) -> Tensor:
        """Images (b, 3, H, W) 0..1 as the image tower takes them."""
        pixels: Tensor = for_tower(image, self.vlm.config.vision_config.image_size).to(self.vlm.model.vision_tower.dtype)
        return pixels

    def _text_loss(self, hidden: Tensor, labels: Tensor) -> Tensor:
        """Mean cross-entropy of the answers' tokens, each predicted from the token before it."""
        wanted = labels[:, 1:] != IGNORE
        return cross_entropy(self.vlm.lm_head(hidden[:, :-1][wanted]).float(), labels[:, 1:][wanted])


def with_lora(vlm: Any, config: ModelConfig) -> Any:
    """Add low-rank updates to q_proj and v_proj of the language model, not of the image tower."""
    lora = LoraConfig(r=config.lora_rank, lora_alpha=config.lora_alpha, lora_dropout=config.lora_dropout, target_modules=ADAPTED)
    return inject_adapter_in_model(lora, vlm)


def image_tokens(config: Any) -> int:
    """Number of tokens of one image: the patches of the tower, and its class token where that is kept."""
    tower = config.vision_config
    side: int = tower.image_size // tower.patch_size
    return side * side + int(config.vision_feature_select_strategy == "full")


def tiny_llava(size_px: int, width: int, heads: int) -> LlavaConfig:
    """Config of a LLaVA that runs on a CPU in milliseconds, with hashed words as its vocabulary."""
    shape = {"hidden_size": width, "intermediate_size": 2 * width, "num_hidden_layers": 2, "num_attention_heads": heads}
    text = {**shape, "model_type": "llama", "vocab_size": TINY_VOCABULARY, "num_key_value_heads": heads, "pad_token_id": 0,
            "bos_token_id": 1, "eos_token_id": 2}  # fmt: skip
    vision = {**shape, "model_type": "clip_vision_model", "image_size": size_px, "patch_size": 16, "projection_dim": width}
    return LlavaConfig(text_config=text, vision_config=vision, image_token_index=HashedTokens.SPECIAL[IMAGE])


def assemble(config: ModelConfig, pretrained: bool, as_stored: bool = False) -> Vlm:
    """Build a `Vlm` over config.backbones, or a tiny random one; with `as_stored`, backbones are in the type of their files."""
    size, width = config.size_px[0], config.widths[2]
    vlm = backbone(LlavaForConditionalGeneration, config.backbones, "vlm", lambda: tiny_llava(size, width, config.heads),
                   pretrained=pretrained, as_stored=as_stored)  # fmt: skip
    sam = backbone(SamModel, config.backbones, "sam", lambda: tiny_sam(size, width, config.heads), pretrained=pretrained,
                   as_stored=as_stored)  # fmt: skip
    check_size(config.size_px, sam.config)
    tokens = tokens_of(config.backbones, "vlm")
    if tokens.id(IMAGE) != vlm.config.image_token_id:
        raise ValueError(f"{config.backbones}/vlm: <image> is id {tokens.id(IMAGE)} of the tokenizer and "
                         f"{vlm.config.image_token_id} of the model")  # fmt: skip
    if tokens.size > vlm.config.text_config.vocab_size:
        vlm.resize_token_embeddings(tokens.size, mean_resizing=False)
    return Vlm(config, vlm, tokens, Regions(sam, config.decoders, config.hypotheses), sam.config)


def _draw(texts: tuple[str, ...]) -> str:
    return texts[int(torch.randint(len(texts), ()))]
