"""`weights import` of a small released 2HAff checkpoint: every tensor in its place, and answers that are generated."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import save_file
from tokenizers import Tokenizer
from torch import Tensor
from transformers import CLIPConfig, CLIPModel, LlavaConfig, SamConfig

from afford.models.importing import Imported, write
from afford.models.importing.source import open_source
from afford.models.importing.write import check_fit, damaged, write_model
from afford.models.tokens import FileTokens
from afford.twohands.model.interface import Batch, ModelConfig, TwoHands, build
from afford.twohands.model.model_folder import find_model, load_model
from afford.twohands.model.predictor import Predictor
from afford.twohands.model.published import GROWS, import_2haff, import_lisa
from afford.twohands.model.vlm import Vlm, question
from tests.helpers.tiny_models import bytes_tokenizer
from tests.twohands.test_published_weights import released

SIDE = 64


@pytest.fixture(scope="module")
def checkpoint(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A released checkpoint of a tiny model in two shards, with tokenizer, config and the CLIP it needs; `ours` beside it."""
    root = tmp_path_factory.mktemp("released")
    model = tiny(root / "ours")
    tensors = released(model)
    names = sorted(tensors)
    folder = root / "2haff"
    folder.mkdir()
    parts = {f"pytorch_model-{n}.bin": {name: tensors[name].contiguous() for name in names[n::2]} for n in (0, 1)}
    for file, own in parts.items():
        torch.save(own, folder / file)
    weight_map = {name: file for file, own in parts.items() for name in own}
    (folder / "pytorch_model.bin.index.json").write_text(json.dumps({"weight_map": weight_map}))
    (folder / "tokenizer.json").write_text(tokenizer())
    (folder / "config.json").write_text(json.dumps({"num_attention_heads": 2, "num_key_value_heads": 2, "rms_norm_eps": 1e-6}))
    (folder / "README.md").write_text("---\nlicense: apache-2.0\n---\n")
    clip(model, root / "clip")
    return root


def tokenizer() -> str:
    found = bytes_tokenizer()
    found.add_special_tokens(["[SEG]"])
    return str(found.to_str())


def tiny(folder: Path) -> TwoHands:
    """A `vlm` with heads as published ones have them: 64 wide in CLIP, eight in SAM's decoders."""
    shape = {"hidden_size": 64, "intermediate_size": 96, "num_hidden_layers": 2, "num_attention_heads": 2}
    tokens = FileTokens(tokenizer())
    text = {**shape, "model_type": "llama", "vocab_size": tokens.size, "num_key_value_heads": 2, "pad_token_id": 0,
            "bos_token_id": 1, "eos_token_id": 2}  # fmt: skip
    vision = {**shape, "num_attention_heads": 1, "model_type": "clip_vision_model", "image_size": SIDE, "patch_size": 16}
    (folder / "vlm").mkdir(parents=True)
    LlavaConfig(text_config=text, vision_config=vision, image_token_index=tokens.id("<image>")).save_pretrained(folder / "vlm")
    (folder / "vlm" / "tokenizer.json").write_text(tokenizer())
    SamConfig(
        vision_config={"hidden_size": 32, "output_channels": 32, "num_hidden_layers": 2, "num_attention_heads": 2,
                       "image_size": SIDE, "global_attn_indexes": [1], "window_size": 2, "num_pos_feats": 16, "mlp_ratio": 4.0},
        prompt_encoder_config={"hidden_size": 32, "image_size": SIDE},
        mask_decoder_config={"hidden_size": 32, "mlp_dim": 64, "num_attention_heads": 8, "iou_head_hidden_dim": 32},
    ).save_pretrained(folder / "sam")  # fmt: skip
    config = ModelConfig(variant="vlm", size_px=(SIDE, SIDE), hypotheses=1, seg_state="code", backbones=str(folder))
    return build(config, 3, pretrained=False).eval()


def clip(model: TwoHands, folder: Path) -> None:
    """The CLIP whose image tower the model has."""
    vision = model.get_submodule("vlm").config.vision_config.to_dict()
    text = {"hidden_size": 64, "intermediate_size": 64, "num_hidden_layers": 1, "num_attention_heads": 1, "vocab_size": 50}
    found = CLIPModel(CLIPConfig(text_config=text, vision_config=vision, projection_dim=32))
    found.vision_model.load_state_dict(model.get_submodule("vlm.model.vision_tower").state_dict())
    found.save_pretrained(folder)


def bring(root: Path, out: Path, dtype: torch.dtype = torch.float32) -> Path:
    source = open_source([root / "2haff", root / "clip"])
    write_model(import_2haff(source), source, "2haff", out, dtype, lambda done, total: None)
    return out


def test_every_tensor_arrives(checkpoint: Path, tmp_path: Path) -> None:
    """The loaded model is the one that was released, to the bit; its fresh updates (LoRA) change nothing."""
    ours, theirs = tiny(tmp_path / "again"), load_model(bring(checkpoint, tmp_path / "model"))
    own = ours.state_dict()
    fresh = {name for name in own if ".lora_" in name}
    assert own.keys() == theirs.state_dict().keys() and fresh
    assert all(torch.equal(own[name], tensor) for name, tensor in theirs.state_dict().items() if name not in fresh)
    batch = Batch(torch.rand(2, 3, SIDE, SIDE), ("open jar", "pour tea"))
    with torch.no_grad():
        for one, other in zip(ours(batch), theirs(batch), strict=True):
            assert one is other is None or torch.equal(one, other)


def test_half_precision_is_kept(checkpoint: Path, tmp_path: Path) -> None:
    """bfloat16 files give a bfloat16 model, which predicts; float32 on request."""
    folder = bring(checkpoint, tmp_path / "model", torch.bfloat16)
    assert {parameter.dtype for parameter in load_model(folder).parameters()} == {torch.bfloat16}
    assert {parameter.dtype for parameter in load_model(folder, "float32").parameters()} == {torch.float32}
    found = Predictor(folder).predict(np.zeros((50, 70, 3), np.uint8), "open jar")
    assert np.isfinite(found.probability).all() and found.probability.dtype == np.float32


def test_shards_are_one_model(checkpoint: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A model in several files is found and loaded as the one in a single file, with or without its record."""
    whole = bring(checkpoint, tmp_path / "whole")
    monkeypatch.setattr(write, "SHARD_BYTES", 100_000)
    parts = bring(checkpoint, tmp_path / "parts")
    assert len(list(parts.glob("model-*.safetensors"))) > 2 and not damaged(parts)
    one, other = load_model(whole).state_dict(), load_model(parts).state_dict()
    assert all(torch.equal(one[name], tensor) for name, tensor in other.items())
    recorded = find_model(parts).digest
    (parts / "weights.json").unlink()
    assert len({recorded, find_model(parts).digest, find_model(whole).digest}) == 3
    next(parts.glob("model-*.safetensors")).unlink()
    with pytest.raises(ValueError, match="files are missing"):
        load_model(parts)


def test_one_bad_tensor_is_named(checkpoint: Path, tmp_path: Path) -> None:
    """Renamed, missing, of another shape: each by its name, and nothing is written."""
    source = open_source([checkpoint / "2haff", checkpoint / "clip"])
    changes: dict[str, tuple[str, Tensor | None]] = {
        "missing vlm.model.language_model.norm.weight": ("model.norm.weight", None),
        "misshaped project.0.bias: expected (64,), got (3,)": ("model.text_hidden_fcs.0.0.bias", torch.zeros(3)),
        "left over model.unheard_of": ("model.unheard_of", torch.zeros(2)),
    }
    for words, (name, tensor) in changes.items():
        tensors = {key: value for key, value in source.tensors.items() if key != name} | ({} if tensor is None else {name: tensor})
        made = import_2haff(type(source)(source.files, tensors, source.folders))
        with pytest.raises(ValueError, match=r"1 of \d+ tensors do not fit") as caught:
            write_model(made, source, "2haff", tmp_path / "model", torch.float32, lambda done, total: None)
        assert words in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_a_checkpoint_without_its_parts_says_what_to_give(checkpoint: Path, tmp_path: Path) -> None:
    """No CLIP; no tokenizer; a tokenizer without [SEG]."""
    with pytest.raises(ValueError, match="give the folder of CLIP too"):
        import_2haff(open_source([checkpoint / "2haff"]))
    source = open_source([checkpoint / "2haff", checkpoint / "clip"])
    with pytest.raises(ValueError, match=r"expected a tokenizer\.json beside the checkpoint"):
        import_2haff(type(source)(source.files, source.tensors, (tmp_path,)))
    (tmp_path / "tokenizer.json").write_text(bytes_tokenizer(size=400).to_str())
    with pytest.raises(ValueError, match=r"expected \[SEG\] among the 100 tokens"):
        rows = {name: tensor[:100] if "embed_tokens" in name else tensor for name, tensor in source.tensors.items()}
        import_2haff(type(source)(source.files, rows, (tmp_path,)))


def test_a_vocabulary_without_the_image_token_grows(checkpoint: Path, tmp_path: Path) -> None:
    """A row of zeros is added to embeddings and output layer where one is missing, and no more than one."""
    source = open_source([checkpoint / "2haff", checkpoint / "clip"])

    def with_tokens(words: str) -> Imported:
        (tmp_path / "tokenizer.json").write_text(words)
        return import_2haff(type(source)(source.files, source.tensors, (tmp_path, *source.folders)))

    words = tokenizer().replace("<image>", "<other>")
    made = with_tokens(words)
    check_fit(made, "2haff")
    for ours, theirs in zip(GROWS, ("model.embed_tokens.weight", "lm_head.weight"), strict=True):
        assert torch.equal(made.tensors[ours][:-1], source.tensors[theirs]) and not made.tensors[ours][-1].any()
    longer = Tokenizer.from_str(words)
    longer.add_special_tokens(["<more>"])
    with pytest.raises(ValueError, match=r"misshaped vlm\.lm_head\.weight"):
        check_fit(with_tokens(longer.to_str()), "2haff")


def test_lisa_has_one_region_and_a_random_taxonomy(checkpoint: Path, tmp_path: Path) -> None:
    """One decoder, and the head that LISA lacks is named as not in the checkpoint."""
    source = open_source([checkpoint / "2haff", checkpoint / "clip"])
    kept = {name.replace("_left", ""): tensor for name, tensor in source.tensors.items()
            if "_right" not in name and "taxonomy" not in name}  # fmt: skip
    made = import_lisa(type(source)(source.files, kept, source.folders))
    check_fit(made, "lisa")
    assert any(name.startswith("regions.taxonomy.") for name in made.fresh)
    record = write_model(made, source, "lisa", tmp_path / "model", torch.float32, lambda done, total: None)
    assert record["licence"] == "apache-2.0" and "LISA" in record["title"]
    left, right = load_model(tmp_path / "model")(Batch(torch.rand(1, 3, SIDE, SIDE), ("open jar",))).logits[0]
    assert torch.equal(left, right)


@pytest.fixture
def talker(tmp_path: Path) -> Vlm:
    model = tiny(tmp_path / "talker")
    assert isinstance(model, Vlm)
    return model


def speak(model: Vlm, words: list[int]) -> None:
    """Replace the output layer: the model says these tokens one after the other, and then ends."""
    head, asked = model.get_submodule("vlm.lm_head"), iter(words)

    def scripted(_module: object, args: tuple[Tensor], logits: Tensor) -> Tensor:
        return torch.nn.functional.one_hot(torch.tensor([[next(asked, 2)]]), logits.shape[-1]).float()

    head.register_forward_hook(scripted)


@pytest.mark.parametrize("state", ["paper", "code"])
def test_regions_are_those_of_the_generated_seg(talker: Vlm, state: str) -> None:
    """The state of the generated [SEG] is that of the whole text read at once: itself (paper), or of the token before it (code)."""
    object.__setattr__(talker.config, "seg_state", state)
    seg, image = talker.tokens.id("[SEG]"), torch.rand(1, 3, SIDE, SIDE)
    speak(talker, [7, 8, seg, 9])
    found = talker.answer(Batch(image, ("open jar",)))
    assert found.said is not None and found.said.all() and found.answer is not None and "[SEG]" in found.answer[0]
    asked = [token for one in talker.tokens.encode(question("open jar")) for token in ([3] * 16 if one == 3 else [one])]
    ids = torch.tensor([[1, *asked, 7, 8, seg]])
    with torch.no_grad():
        pixels = talker._pixels(image)
        states = talker.get_submodule("vlm.model")(input_ids=ids, pixel_values=pixels).last_hidden_state[0]
        wanted, _, _ = talker._regions(image, talker.project(states[-1 if state == "paper" else -2])[None, None])
    torch.testing.assert_close(found.logits, wanted, rtol=1e-4, atol=1e-5)


def test_an_answer_without_seg_has_no_region(talker: Vlm) -> None:
    """No hand is returned, and the answer is in the prediction."""
    speak(talker, [7, 8])
    found = Predictor(talker).predict(np.zeros((40, 60, 3), np.uint8), "open jar")
    assert not found.hands.any() and not found.mask("left").any() and found.answer and "[SEG]" not in found.answer


def test_numbers_that_are_not_finite_are_refused(checkpoint: Path, tmp_path: Path) -> None:
    """The tensor is named; so is one that half floats do not hold."""
    source = open_source([checkpoint / "2haff", checkpoint / "clip"])
    for value, dtype, words in ((float("nan"), torch.float32, "that are not finite"), (1e6, torch.float16, "beyond the range")):
        bad = source.tensors | {"model.norm.weight": torch.full((64,), value)}
        with pytest.raises(ValueError, match=rf"language_model\.norm\.weight: expected finite weights, got numbers {words}"):
            write_model(import_2haff(type(source)(source.files, bad, source.folders)), source, "2haff", tmp_path / "m", dtype,
                        lambda done, total: None)  # fmt: skip
    assert not list(tmp_path.iterdir())


def test_a_tensor_in_two_files_is_refused(checkpoint: Path, tmp_path: Path) -> None:
    """The file and the tensor are named."""
    save_file({"model.norm.weight": torch.zeros(64)}, tmp_path / "more.safetensors")
    with pytest.raises(ValueError, match=r"1 tensors are also in another file, such as model\.norm\.weight"):
        open_source([checkpoint / "2haff", tmp_path / "more.safetensors"])
