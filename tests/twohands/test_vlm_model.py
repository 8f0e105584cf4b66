"""2HandedAfforder and 2HAff-CLIP on tiny random backbones: where [SEG] is, what is trained, and the whole way round offline."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from transformers import CLIPTextConfig, LlavaForConditionalGeneration, SamModel

from afford.models.tokens import FileTokens, HashedTokens, read_tokens, text_ends
from afford.twohands.model.backbones import Regions
from afford.twohands.model.interface import Batch, ModelConfig, Output, Target, build
from afford.twohands.model.losses import LossParams, losses
from afford.twohands.model.model_folder import load_model, save_model
from afford.twohands.model.predictor import Predictor
from afford.twohands.model.vlm import IGNORE, dialogue, seg_positions
from tests.helpers.tiny_models import bytes_tokenizer, save_backbones

TRAINED = ("lora_A", "lora_B", "vlm.lm_head.", ".embed_tokens.", "project.", "regions.decoders.", "regions.taxonomy.")


@pytest.fixture(scope="module")
def backbones(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_backbones(tmp_path_factory.mktemp("backbones"))


def config(folder: Path | str, variant: str = "vlm", **change: object) -> ModelConfig:
    return ModelConfig.from_dict({"variant": variant, "size_px": (64, 64), "backbones": str(folder), **change})


def batch() -> Batch:
    return Batch(torch.rand(2, 3, 64, 64, generator=torch.Generator().manual_seed(0)), ("open the jar", "pour tea from the kettle"))


def target() -> Target:
    masks = torch.zeros(2, 2, 64, 64)
    masks[:, :, 16:40, 16:40] = 1
    return Target(masks, torch.tensor([[True, True], [False, True]]), torch.tensor([2, 1]))


def step(model: torch.nn.Module, times: int = 1) -> Output:
    optimiser = torch.optim.AdamW([p for p in model.train().parameters() if p.requires_grad], lr=1e-2, weight_decay=0)
    for _ in range(times):
        o = model(batch())
        losses(o, target(), LossParams())["total"].backward()
        optimiser.step()
        optimiser.zero_grad()
    return o


def trainable(model: torch.nn.Module) -> set[str]:
    return {name for name, parameter in model.named_parameters() if parameter.requires_grad}


@pytest.mark.parametrize("patch", [16, 32])
@pytest.mark.parametrize("asked", ["<image>\nwhere", "where <image> is it", "tell me: <image>"])
@pytest.mark.parametrize("answered", ["[SEG].", "It is [SEG] and no more", "so: [SEG]"])
def test_seg_is_found_for_any_number_of_image_tokens(patch: int, asked: str, answered: str) -> None:
    """Image before, between and after the words, 16 or 4 tokens, [SEG] first, inside or last: it is where its id is."""
    tokens, count = HashedTokens(100), (64 // patch) ** 2
    talk = dialogue(tokens, [(asked, answered), ("a longer question about <image> stands here", "[SEG]")], count, 1, 2, 0)
    where = seg_positions(talk.ids, tokens.id("[SEG]"))
    before = 1 + sum(count if word == "<image>" else 1 for word in asked.replace(":", " :").split())
    assert where[0] == before + answered.replace(".", " .").replace(":", " :").split().index("[SEG]")
    assert torch.equal(seg_positions(talk.ids, tokens.id("[SEG]"), "code"), where - 1)
    assert (talk.ids == tokens.id("<image>")).sum(1).tolist() == [count, count]
    assert (talk.labels[0] != IGNORE).sum() == len(tokens.encode(answered)) + 1


def test_a_row_has_exactly_one_seg() -> None:
    """Rows with no or two [SEG] are refused."""
    with pytest.raises(ValueError, match=r"exactly one \[SEG\] in each row, got \[0, 2\]"):
        seg_positions(torch.tensor([[1, 2, 3], [4, 4, 1]]), 4)


@pytest.mark.parametrize("patch", [16, 32])
@pytest.mark.parametrize("state", ["paper", "code"])
def test_the_prompt_is_the_state_at_seg(tmp_path: Path, patch: int, state: str) -> None:
    """The projection gets the hidden state of the language model at [SEG], for two patch sizes."""
    model = build(config(save_backbones(tmp_path, patch), seg_state=state), 0).eval()
    taken, states = [], []
    model.get_submodule("project").register_forward_pre_hook(lambda _, args: taken.append(args[0]))
    model.get_submodule("vlm.model").register_forward_hook(lambda _, args, out: states.append(out.last_hidden_state))
    talked = []
    model.get_submodule("vlm.model.language_model.embed_tokens").register_forward_pre_hook(lambda _, args: talked.append(args[0]))
    model(batch())
    seg = read_tokens(tmp_path / "vlm" / "tokenizer.json").id("[SEG]")
    where = (talked[0] == seg).nonzero()[:, 1] - int(state == "code")
    assert torch.equal(taken[0], states[0][torch.arange(2), where])
    assert (talked[0] == 3).sum().item() == 2 * (64 // patch) ** 2  # <image> is id 3 of this tokenizer


def test_trained_parameters(backbones: Path) -> None:
    """LoRA, lm_head, embeddings, projection, both decoders and the taxonomy head move; nothing else does."""
    model = build(config(backbones), 0)
    before = {name: tensor.clone() for name, tensor in model.state_dict().items()}
    step(model, 2)  # lora_A moves once lora_B is no longer zero
    moved = {name for name, tensor in model.state_dict().items() if not torch.equal(tensor, before[name])}
    assert moved and all(any(part in name for part in TRAINED) for name in moved), sorted(moved)
    for part in TRAINED + ("regions.decoders.0.", "regions.decoders.1."):
        assert any(part in name for name in moved), part
    assert not any("vision_tower" in name for name in moved)
    assert trainable(model) >= moved


@pytest.mark.parametrize("variant", ["vlm", "clip"])
@pytest.mark.parametrize("hypotheses", [1, 3])
def test_trains_saves_loads_and_predicts_offline(backbones: Path, tmp_path: Path, variant: str, hypotheses: int) -> None:
    """The whole way: backbones from a folder, steps that lower the loss, a folder that needs nothing else, predictions."""
    torch.manual_seed(0)
    model = build(config(backbones, variant, hypotheses=hypotheses), 0)
    first = losses(model.train()(batch()), target(), LossParams())["total"]
    o = step(model, 12)
    assert losses(o, target(), LossParams())["total"] < first
    assert o.logits.shape == (2, 2, hypotheses, 16, 16) and (o.text_loss is not None) is (variant == "vlm")
    save_model(model, tmp_path / "model")
    assert json.loads((tmp_path / "model" / "config.json").read_text())["backbones"] == ""
    again, b = load_model(tmp_path / "model"), batch()
    with torch.inference_mode():
        one, two = model.eval()(b), again(b)
    assert torch.equal(one.logits, two.logits) and torch.equal(one.taxonomy, two.taxonomy)
    assert trainable(model) == trainable(again)
    found = Predictor(tmp_path / "model").predict(np.zeros((48, 80, 3), np.uint8), "open the jar", hands="both")
    assert found.probability.shape == (2, hypotheses, 48, 80)


@pytest.mark.parametrize("variant", ["vlm", "clip"])
def test_tiny_ones_need_no_folder_and_padding_changes_nothing(variant: str) -> None:
    """Random models with hashed words: a prediction does not depend on padding, but on the task."""
    model, b = build(ModelConfig(variant=variant, size_px=(64, 64), widths=(16, 16, 32), depth=1, heads=2), 3).eval(), batch()
    together, alone = model(b), model(Batch(b.image[:1], b.task[:1]))
    assert torch.allclose(together.logits[:1], alone.logits, rtol=1e-3, atol=1e-9)
    other = model(Batch(b.image[:1], b.task[1:]))
    assert not torch.allclose(other.logits, alone.logits, rtol=1e-3, atol=1e-9)


def test_clip_texts_begin_and_end_as_its_tokenizer_says() -> None:
    """The marks of CLIP's tokenizer where it has them, whatever an old config says; else the config's."""
    tokenizer = bytes_tokenizer()
    old = CLIPTextConfig(bos_token_id=0, eos_token_id=2)
    assert text_ends(FileTokens(tokenizer.to_str()), old) == (0, 2)
    tokenizer.add_special_tokens(["<|startoftext|>", "<|endoftext|>"])
    size = tokenizer.get_vocab_size()
    assert text_ends(FileTokens(tokenizer.to_str()), old) == (size - 2, size - 1)


def test_regions_start_as_segment_anything_itself(backbones: Path) -> None:
    """Masks of each hand equal those of SamModel for the same image and prompt before training."""
    sam = SamModel.from_pretrained(backbones / "sam").eval()
    image, prompt = torch.randn(2, 3, 64, 64), torch.randn(2, 1, 32)
    for k, several in ((1, False), (3, True)):
        seen = sam.vision_encoder(image).last_hidden_state
        dense = sam.prompt_encoder.no_mask_embed.weight.view(1, -1, 1, 1).expand_as(seen)
        place = sam.get_image_wide_positional_embeddings().expand(2, -1, -1, -1)
        masks, score = sam.mask_decoder(seen, place, prompt[:, None], dense, several)
        logits, ours, _ = Regions(sam, 2, k).eval()(image, prompt)
        for hand in (0, 1):
            assert torch.allclose(logits[:, hand], masks[:, 0], atol=1e-6)
            assert torch.allclose(ours[:, hand], score[:, 0], atol=1e-6)


def test_half_precision_backbones_are_trained_in_single(tmp_path: Path) -> None:
    """Weights saved as float16 load as float32, train a step, save and load."""
    folder = save_backbones(tmp_path)
    LlavaForConditionalGeneration.from_pretrained(folder / "vlm").half().save_pretrained(folder / "vlm")
    model = build(config(folder), 0)
    assert {parameter.dtype for parameter in model.parameters()} == {torch.float32}
    step(model)
    save_model(model, tmp_path / "model")
    assert torch.equal(load_model(tmp_path / "model")(batch()).logits, model.eval()(batch()).logits)


def test_backbones_that_cannot_be_read_are_refused(tmp_path: Path, backbones: Path) -> None:
    """A missing folder, a missing tokenizer, another input size, too many hypotheses."""
    with pytest.raises(ValueError, match=r"expected config\.json of a LlavaForConditionalGeneration"):
        build(config(tmp_path), 0)
    with pytest.raises(ValueError, match=r"this SAM takes \(64, 64\)"):
        build(config(backbones, size_px=(128, 128)), 0)
    with pytest.raises(ValueError, match="gives 1 to 3, got 4"):
        build(config(backbones, hypotheses=4), 0)
    (save_backbones(tmp_path / "other") / "vlm" / "tokenizer.json").unlink()
    with pytest.raises(ValueError, match=r"tokenizer\.json: expected a tokenizer"):
        build(config(tmp_path / "other"), 0)
