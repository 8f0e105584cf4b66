"""`weights import` of all kinds but the two-hand models: small checkpoints by their published names, and files that are refused."""

from __future__ import annotations

import json
import pickle
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file
from torch import Tensor
from transformers import CLIPModel, LlavaForConditionalGeneration, Sam2VideoModel, Sam3Model, SamConfig, SamModel

from afford.common.registry import load
from afford.extraction.inpaint import lama, vidm_model
from afford.models.importing import Imported
from afford.models.importing.source import RECORD, Source, open_source
from afford.models.importing.write import check_fit
from afford.models.sam import Grid, grid_points, load_model, segment_everything
from commands.weights_import import KINDS, NEEDS, bring, show, verify
from tests.helpers.tiny_inpainters import save_lama, save_vidm
from tests.helpers.tiny_models import bytes_tokenizer, save_backbones, save_sam2_video, save_sam3

Tensors = dict[str, Tensor]
SAM_NAMES = (
    ("vision_encoder.", "image_encoder."), (".layers.", ".blocks."), ("patch_embed.projection", "patch_embed.proj"),
    ("neck.conv1", "neck.0"), ("neck.layer_norm1", "neck.1"), ("neck.conv2", "neck.2"), ("neck.layer_norm2", "neck.3"),
    ("encoder.point_embed.", "encoder.point_embeddings."), ("mask_embed.conv1", "mask_downscaling.0"),
    ("mask_embed.layer_norm1", "mask_downscaling.1"), ("mask_embed.conv2", "mask_downscaling.3"),
    ("mask_embed.layer_norm2", "mask_downscaling.4"), ("mask_embed.conv3", "mask_downscaling.6"),
    ("shared_embedding.positional_embedding", "pe_layer.positional_encoding_gaussian_matrix"),
    ("upscale_conv1", "output_upscaling.0"), ("upscale_layer_norm", "output_upscaling.1"), ("upscale_conv2", "output_upscaling.3"),
    ("layer_norm_final_attn", "norm_final_attn"),
)  # fmt: skip


def published_sam(model: SamModel) -> Tensors:
    """The authors' names, from the other side."""
    out = {}
    for name, tensor in model.state_dict().items():
        if name.startswith("shared_image_embedding"):
            continue
        if "_mlps." in name or "_head." in name:
            name = name.replace(".layers.0.", ".layers.1.").replace("proj_in", "layers.0").replace("proj_out", "layers.2")
        elif name.startswith("mask_decoder.transformer"):
            name = name.replace(".layers.", ".LAYERS.")
        for ours, theirs in SAM_NAMES if not ("_mlps." in name or "_head." in name) else SAM_NAMES[:1]:
            name = name.replace(ours, theirs)
        out[name.replace(".LAYERS.", ".layers.")] = tensor
    return {name if "neck" in name else name.replace(".layer_norm", ".norm"): tensor for name, tensor in out.items()}


def tiny_sam() -> SamModel:
    torch.manual_seed(0)
    return SamModel(SamConfig(
        vision_config={"hidden_size": 32, "output_channels": 32, "num_hidden_layers": 2, "num_attention_heads": 2, "image_size": 64,
                       "global_attn_indexes": [1], "window_size": 2, "num_pos_feats": 16, "mlp_ratio": 4.0},
        prompt_encoder_config={"hidden_size": 32, "image_size": 64},
        mask_decoder_config={"hidden_size": 32, "mlp_dim": 64, "iou_head_hidden_dim": 32})).eval()  # fmt: skip


def test_sam(tmp_path: Path) -> None:
    """The authors' file gives the same masks as the model that it was made from."""
    model = tiny_sam()
    torch.save(published_sam(model), tmp_path / "sam_vit_t.pth")
    assert bring("sam", [tmp_path / "sam_vit_t.pth"], tmp_path / "sam", "float32", False) == 0
    again = load_model(str(tmp_path / "sam"))
    assert same(model, again)
    rgb = np.random.default_rng(0).integers(0, 255, (48, 64, 3)).astype(np.uint8)
    everything = Grid(points=2, least_iou=-9.0, least_stability=-1.0)
    one, other = (segment_everything(each, rgb, everything, grid_points(2, 48, 64)) for each in (model, again))
    assert len(one[0]) == 12 and np.array_equal(one[0], other[0])


@pytest.mark.parametrize(("size", "width", "depth", "heads", "everywhere", "parameters"), [
    ("ViT-B", 768, 12, 12, [2, 5, 8, 11], 93_735_472), ("ViT-L", 1024, 24, 16, [5, 11, 17, 23], 312_342_832),
    ("ViT-H", 1280, 32, 16, [7, 15, 23, 31], 641_090_608)])  # fmt: skip
def test_sam_of_published_size(size: str, width: int, depth: int, heads: int, everywhere: list[int], parameters: int) -> None:
    """Sizes are read off the tensors; as many parameters as the authors' package builds, and as are published."""
    with torch.device("meta"):
        model = SamModel(SamConfig(vision_config={"hidden_size": width, "num_hidden_layers": depth, "num_attention_heads": heads,
                                                  "global_attn_indexes": everywhere}))  # fmt: skip
        made: Imported = load(KINDS, "sam")(Source((), published_sam(model), ()))
    check_fit(made, "sam")
    assert size in made.title and made.counted == parameters
    config = SamConfig.from_dict(json.loads(made.texts["config.json"])).vision_config
    assert (config.num_attention_heads, config.global_attn_indexes, config.window_size) == (heads, everywhere, 14)


def same(one: torch.nn.Module, other: torch.nn.Module) -> bool:
    """Equal names and tensors."""
    a, b = one.state_dict(), other.state_dict()
    return a.keys() == b.keys() and all(torch.equal(a[name], b[name]) for name in a)


FOLDERS: dict[str, tuple[type, Callable[[Path], Path]]] = {
    "sam2": (Sam2VideoModel, save_sam2_video),
    "sam3": (Sam3Model, save_sam3),
    "clip": (CLIPModel, lambda folder: save_backbones(folder) / "clip"),
    "llava": (LlavaForConditionalGeneration, lambda folder: heads(save_backbones(folder) / "vlm")),
    "sam": (SamModel, lambda folder: (tiny_sam().save_pretrained(folder), folder)[1]),
}
"""kind -> class and a folder as `save_pretrained` writes it"""


def heads(folder: Path) -> Path:
    """One head in the image tower, as its width of 32 gives by the published rule."""
    config = json.loads((folder / "config.json").read_text())
    config["vision_config"]["num_attention_heads"] = 1
    (folder / "config.json").write_text(json.dumps(config))
    return folder


@pytest.mark.parametrize("kind", FOLDERS)
@pytest.mark.parametrize("dtype", ["float32", "bfloat16"])
def test_folders_of_transformers(kind: str, dtype: str, tmp_path: Path) -> None:
    """The imported folder is read by `from_pretrained`, with the tensors that went in."""
    cls, write = FOLDERS[kind]
    folder = write(tmp_path / "given")
    assert bring(kind, [folder], tmp_path / "out", dtype, False) == 0
    kept = getattr(torch, dtype)
    one, other = (cls.from_pretrained(place, dtype=kept) for place in (folder, tmp_path / "out"))
    assert same(one, other)
    written = load_file(tmp_path / "out" / "model.safetensors").values()
    assert {tensor.dtype for tensor in written if tensor.is_floating_point()} == {kept}


def openai(model: CLIPModel) -> Tensors:
    """OpenAI's names, from the other side."""
    out: Tensors = {"input_resolution": torch.tensor(64), "context_length": torch.tensor(40)}
    plain = (("vision_model.", "visual."), ("text_model.", ""), ("encoder.layers.", "transformer.resblocks."),
             (".layer_norm", ".ln_"), (".mlp.fc1", ".mlp.c_fc"), (".mlp.fc2", ".mlp.c_proj"),
             (".self_attn.out_proj", ".attn.out_proj"),
             ("embeddings.patch_embedding", "conv1"), ("embeddings.position_embedding.weight", "positional_embedding"),
             ("embeddings.token_embedding", "token_embedding"), ("embeddings.class_embedding", "class_embedding"),
             ("pre_layrnorm", "ln_pre"), ("post_layernorm", "ln_post"), ("final_layer_norm", "ln_final"))  # fmt: skip
    state = model.state_dict()
    for name, tensor in state.items():
        if "_proj." in name and "out_proj" not in name and "self_attn" in name:
            if ".q_proj." in name:
                put = name.replace("q_proj.", "in_proj_").replace("self_attn", "attn")
                tensor = torch.cat([state[name.replace("q_proj", f"{one}_proj")] for one in "qkv"])
            else:
                continue
        elif name.endswith("_projection.weight"):
            put, tensor = {"v": "visual.proj", "t": "text_projection"}[name[0]], tensor.T.contiguous()
        else:
            put = name
        for ours, theirs in plain:
            put = put.replace(ours, theirs)
        out[put] = tensor
    return out


def test_clip_of_openai(tmp_path: Path) -> None:
    """OpenAI's file and a tokenizer give the CLIPModel that it was made from; without the tokenizer one sentence."""
    folder = save_backbones(tmp_path / "given") / "clip"
    model = CLIPModel.from_pretrained(folder)
    torch.save(openai(model), tmp_path / "ViT-T-16.pt")
    made = load(KINDS, "clip")
    with pytest.raises(ValueError, match=r"expected a tokenizer\.json"):
        made(open_source([tmp_path / "ViT-T-16.pt"]))
    (tmp_path / "tokenizer.json").write_text(bytes_tokenizer().to_str())
    found = made(open_source([tmp_path / "ViT-T-16.pt"]))
    check_fit(found, "clip")
    assert all(torch.equal(tensor, model.state_dict()[name]) for name, tensor in found.tensors.items())


def test_llava_of_its_authors(tmp_path: Path) -> None:
    """The authors' names with CLIP beside them, and the older layout of transformers."""
    folder = save_backbones(tmp_path / "given")
    model = LlavaForConditionalGeneration.from_pretrained(folder / "vlm")
    state = model.state_dict()
    older = {name.replace("model.language_model.", "language_model.model.")
             .replace("model.vision_tower.", "vision_tower.vision_model.").replace("model.multi_modal", "multi_modal")
             .replace("lm_head.", "language_model.lm_head."): tensor for name, tensor in state.items()}  # fmt: skip
    authors = {name.replace("model.language_model.", "model.")
               .replace("model.multi_modal_projector.linear_1", "model.mm_projector.0")
               .replace("model.multi_modal_projector.linear_2", "model.mm_projector.2"): tensor for name, tensor in state.items()
               if "vision_tower" not in name}  # fmt: skip
    tower = {name.replace("model.vision_tower.", "vision_model."): tensor for name, tensor in state.items() if "tower" in name}
    extra = {"text_model.final_layer_norm.weight": torch.ones(3), "logit_scale": torch.ones(())}
    for given in (older, authors | tower | extra):
        made: Imported = load(KINDS, "llava")(Source((), given, (folder / "vlm",)))
        check_fit(made, "llava")
        assert all(torch.equal(made.tensors[name], tensor) for name, tensor in state.items())
    with pytest.raises(ValueError, match="give the folder of CLIP too"):
        load(KINDS, "llava")(Source((), authors, (folder / "vlm",)))


def test_inpainters_and_vgg(tmp_path: Path) -> None:
    """VIDM, LaMa and VGG16: what is written is read by their loaders, and is what went in."""
    given = save_vidm(tmp_path / "given")
    assert bring("vidm", [given], tmp_path / "vidm", "float32", False) == 0
    cpu = torch.device("cpu")
    one, other = (vidm_model.load(str(place), cpu, torch.float32) for place in (given, tmp_path / "vidm"))
    assert same(one, other)
    file = save_lama(tmp_path / "best.safetensors")
    assert bring("lama", [file], tmp_path / "lama", "float32", False) == 0
    assert same(lama.load(str(file), cpu, torch.float32), lama.load(str(tmp_path / "lama/model.safetensors"), cpu, torch.float32))
    with torch.device("meta"):
        made: Imported = load(KINDS, "vgg16")(Source((), vgg16(), ()))
    check_fit(made, "vgg16")
    assert sum(tensor.numel() for tensor in vgg16().values()) == 138_357_544  # the published count


def vgg16() -> Tensors:
    """Shapes of the published VGG16."""
    widths = (3, 64, 64, 128, 128, 256, 256, 256, 512, 512, 512, 512, 512, 512)
    layers = (0, 2, 5, 7, 10, 12, 14, 17, 19, 21, 24, 26, 28)
    shapes = {f"features.{n}.weight": (out, inner, 3, 3) for n, inner, out in zip(layers, widths, widths[1:], strict=False)}
    shapes |= {"classifier.0.weight": (4096, 25088), "classifier.3.weight": (4096, 4096), "classifier.6.weight": (1000, 4096)}
    shapes |= {name.replace("weight", "bias"): shape[:1] for name, shape in shapes.items()}
    return {name: torch.empty(shape, device="meta") for name, shape in shapes.items()}


def test_kinds_are_listed() -> None:
    """Every kind has a reader, and says what it needs."""
    assert NEEDS.keys() == KINDS.keys() and all(callable(load(KINDS, kind)) for kind in KINDS)


def test_verify_and_show(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Whole files pass; a changed byte, a missing file and another folder do not; the licence is what the files state."""
    folder = save_backbones(tmp_path / "given") / "clip"
    (folder / "README.md").write_text("---\nlicense: mit\n---\n# CLIP\n")
    assert bring("clip", [folder], tmp_path / "out", "float16", True) == 0
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert (told["licence"], told["dtype"], told["parameters"]) == ("mit", "float16", count(folder)) and len(told["digest"]) == 64
    assert verify(tmp_path / "out", False) == 0 and show(tmp_path / "out", False) == 0
    weights = tmp_path / "out" / "model.safetensors"
    weights.write_bytes(weights.read_bytes()[:-1] + b"\7")
    (tmp_path / "out" / "tokenizer.json").unlink()
    assert verify(tmp_path / "out", False) == 1
    assert "2 of 3 files are missing or differ: model.safetensors, tokenizer.json" in capsys.readouterr().err
    assert verify(folder, False) == 1 and RECORD in capsys.readouterr().err


def count(folder: Path) -> int:
    return sum(tensor.numel() for tensor in load_file(folder / "model.safetensors").values())


def write_truncated(path: Path) -> None:
    save_file({"a": torch.zeros(1000)}, path.with_suffix(".safetensors"))
    path.with_suffix(".safetensors").write_bytes(path.with_suffix(".safetensors").read_bytes()[:500])


class Cheat:
    """Makes a folder when it is unpickled."""

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return Path.mkdir, ("ran",)


def write_pickle(path: Path) -> None:
    with zipfile.ZipFile(path.with_suffix(".pt"), "w") as archive:
        archive.writestr("archive/data.pkl", pickle.dumps({"a": Cheat()}, protocol=2))


def write_zip_bomb(path: Path) -> None:
    with zipfile.ZipFile(path.with_suffix(".pt"), "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("archive/data.pkl", b"\0" * (1 << 28))


def write_float8(path: Path) -> None:
    save_file({"a": torch.zeros(8).to(torch.float8_e4m3fn)}, path.with_suffix(".safetensors"))


def write_other(path: Path) -> None:
    save_file({"features.0.weight": torch.zeros(2)}, path.with_suffix(".safetensors"))


BAD: Mapping[str, tuple[Callable[[Path], None], str]] = {
    "truncated": (write_truncated, "expected a checkpoint"),
    "pickle": (write_pickle, "expected a"),
    "zip bomb": (write_zip_bomb, "expected a checkpoint"),
    "float8": (write_float8, "numbers of type F8_E4M3"),
    "another model": (write_other, "expected a checkpoint of Segment Anything"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_files_get_one_sentence(case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str],
                                    monkeypatch: pytest.MonkeyPatch) -> None:  # fmt: skip
    """Exit code 1, one sentence that names the file or the kind, nothing written, nothing run."""
    write, words = BAD[case]
    monkeypatch.chdir(tmp_path)
    (tmp_path / "given").mkdir()
    write(tmp_path / "given" / "weights")
    assert bring("sam", [tmp_path / "given"], tmp_path / "out", "float32", False) == 1
    told = capsys.readouterr().err.strip().splitlines()
    assert len(told) == 1 and told[0].startswith("error: sam: ") and words in told[0], told
    assert [path.name for path in tmp_path.iterdir()] == ["given"]


def test_a_missing_shard_is_named(tmp_path: Path) -> None:
    """An index with a file that is not there."""
    (tmp_path / "model.safetensors.index.json").write_text(json.dumps({"weight_map": {"a": "model-1.safetensors"}}))
    with pytest.raises(ValueError, match=r"1 of 1 files are missing: model-1\.safetensors"):
        open_source([tmp_path])
