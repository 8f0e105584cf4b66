"""a data set -> a trained two-hand affordance model, with its card and its curves.

Reads   FileTree of a data set: what dataset_pack writes, released 2HANDS (h5 + json), or any folder of `datasets` with the
        columns image, mask_left, mask_right, narration; a Recipe, for a row of the ablation; the weights that `backbones` names,
        if any
Writes  Trained: files (model/config.json, model/model.safetensors, card.md, history.parquet, tensorboard/, previews/) and the
        TrainingLog
Method  AdamW, linear warm-up and decay; order, augmentation and random states are functions of the seed and the step, so that
        a resumed training ends in the same weights; the weights and the threshold of the best validation are kept; several
        devices by torch.distributed.run
Fails   when a split of the data set is empty or lacks a column, or when the loss is not finite
Paper   2HandedAfforder, training (LISA's optimiser and schedule; batch and learning rate are ours, for a model without
        pretrained parts)
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from afford.training.params import Optimisation
from schemas.files import FileTree
from schemas.spec import Context
from schemas.training import Recipe, Trained

if TYPE_CHECKING:
    from afford.twohands.train.job import TwoHandsJob

LIBRARIES = ("numpy", "scipy", "torch", "transformers", "tokenizers", "peft", "safetensors", "opencv-python-headless", "pyarrow",
             "h5py", "pycocotools", "blake3", "protobuf", "foxglove-schemas-protobuf", "mcap", "mcap-protobuf-support")  # fmt: skip
THREADS = 2
MEMORY_GIB = 3.0
SCRATCH_GIB = 0.5
MACHINE = "bf16"  # a CPU without instructions for bfloat16 trains in single precision
GPUS = ("device", "devices")


@dataclass(frozen=True)
class Params(Optimisation):
    """Parameters of the stage."""

    variant: str = "small"
    """small (from random weights, on a CPU), lite (small on a pretrained image encoder), clip (2HAff-CLIP) or vlm
    (2HandedAfforder); each brings its size and schedule, the last two the paper's, with its losses"""
    recipe: str = "quick"
    """lite: quick (minutes on two cores) or release (size and schedule of the shipped model)"""
    hypotheses: int = 1
    """regions predicted for each hand; 1, the paper's, has at least the IoU and mAP of 3, which covers more modes"""
    text: bool = True
    """prompt the model with the task"""
    decoders: int = 2
    """2, or 1: one region for either hand, as in LISA"""
    target: str = "affordance"
    """training target: affordance, or object (the complete object of each hand)"""
    backbones: str = ""
    """clip, vlm: folder of pretrained parts or a hub id, tiny random ones without; lite: that of set-up without"""
    start: str = ""
    """small, lite: folder of a trained model of the same sizes, such as weights/twohands, from whose weights the training begins"""
    height_px: int = 128
    """height of the model's input"""
    width_px: int = 160
    """width of the model's input; clip and vlm are square, as high as wide"""
    steps: int = 4500
    coarse_share: float = 0.53
    """small, lite: share of first steps, at half the size with twice as many samples"""
    accumulate: int = 2
    """micro-batches per step; those of small and lite are computed at the same time on a CPU"""
    lr: float = 2e-3
    warmup: int = 100
    validate_every: int = 1500
    val_samples: int = 256
    """validation samples, every second one cropped to its objects"""
    split_by: str = "given"
    """given: train and val of the data set; video, object: split by hash, so that a video or object is in one split only"""
    val_fraction: float = 0.1
    """share for validation when split by video or object"""
    balance: float = 0.5
    """0: samples as they are; 1: every pair of verb and taxonomy equally often"""
    flip_share: float = 0.5
    """share of samples that are mirrored, with hands and words"""
    crop_share: float = 0.8
    """share of samples that are cropped around their objects"""
    wide_share: float = 0.0
    """share of crops that show more around the objects"""
    stretch_share: float = 0.5
    """share of samples that are made wider or narrower"""
    colour_share: float = 0.5
    """share of samples whose colours are changed"""
    residue_share: float = 0.0
    """share of samples with places as inpainting of hands leaves them"""
    pasted_share: float = 0.0
    """share of samples whose objects are shown before the picture of another sample"""
    classes: bool = False
    """lite: let the classifier of the image encoder point at the things that a task names; not without text"""
    unnamed_share: float = 0.4
    """lite with classes: share of samples whose nouns are random words, so that the classes alone say which thing is meant"""
    unseen_share: float = 0.2
    """lite with classes: share of samples without the classes of their things"""
    style_noise: float = 0.0
    """lite: strength of the noise on the style of the encoder's features, for half of the samples; 0 for none"""
    zoom: float = 2.0
    """samples are cached at this many times the input size, so that crops stay sharp"""
    loss_mode: str = "paper"
    """paper or code (docs/twohands/models.md): the mask loss of an idle hand, the input of the taxonomy loss, the state of [SEG];
    with variant=clip or vlm, code also brings the released script's loss and rate"""
    mask_loss: str = "bce"
    """focal or bce; '' follows the mode (paper: focal); from random weights, bce learns faster"""
    mask_weight: float = 1.0
    """weight of the mask loss; 2 in the paper"""
    dice_weight: float = 2.0
    """weight of the Dice loss; 0.5 in the paper"""
    object_weight: float = 1.0
    """small, lite: weight of the loss of the complete object of each hand; 0 for the paper's losses"""
    centre_weight: float = 1.0
    """small, lite: weight of the loss of the objects' position in the whole picture, which decides between left and right hand, but
    is not visible in a crop; 0 for the paper's losses"""
    checkpointing: bool = False
    """vlm: compute the activations of the language model again in the backward pass: less memory, more time"""
    frozen_dtype: str = "float32"
    """vlm: type of the weights that are not trained: float32, bfloat16 or float16; trained ones are float32"""


VLM = Params(variant="vlm", height_px=1024, width_px=1024, steps=5000, batch=2, accumulate=10, lr=3e-4, warmup=100,
             weight_decay=0.0, bf16=True, validate_every=500, coarse_share=0.0, balance=0.0, flip_share=0.0, crop_share=0.0,
             stretch_share=0.0, colour_share=0.0, zoom=1.0, mask_loss="focal", mask_weight=2.0, dice_weight=0.5, object_weight=0.0,
             centre_weight=0.0, checkpointing=True)  # fmt: skip
"""parameters of the paper: ten epochs of 500 steps of LISA's recipe"""
CLIP = replace(VLM, variant="clip", checkpointing=False)
"""the same for 2HAff-CLIP"""
QUICK = Params(variant="lite", height_px=160, width_px=192, steps=1300, validate_every=650, coarse_share=0.25,
                wide_share=0.3, classes=True, style_noise=0.3)  # fmt: skip
"""parameters of `make train`"""
RELEASE = replace(QUICK, recipe="release", height_px=192, width_px=256, steps=3000, validate_every=1000, coarse_share=0.53,
                  wide_share=0.6, pasted_share=0.3, unnamed_share=0.3)  # fmt: skip
"""parameters of the shipped model"""
CODE = {"loss_mode": "code", "mask_loss": "bce", "lr": 1e-3}
"""parameters in which the released script differs from the paper"""
SIZES = ("height_px", "width_px", "coarse_share", "validate_every")
"""parameters that a recipe takes from its `sizes`"""


def run(dataset: FileTree, params: Params, ctx: Context, recipe: Recipe | None = None,
        weights: FileTree | None = None, start: FileTree | None = None) -> Trained:  # fmt: skip
    """Train the model."""
    from afford.models.weights import with_local_weights
    from afford.training.train import train_job

    job = training_job(with_local_weights(with_local_weights(params, weights, "backbones"), start, "start"), recipe)
    threads = 1 if job.config.variant == "vlm" and not job.config.backbones else THREADS  # its layers are too small for two
    return train_job(job, dataset, recipe.name if recipe else params.variant, ctx, threads, params.devices)


def training_job(p: Params, recipe: Recipe | None = None) -> TwoHandsJob:
    """Build the training job from the parameters, with those of a recipe replaced. ValueError for parameters that do not fit."""
    from afford.models.loading import DTYPES
    from afford.training.params import plan_of
    from afford.twohands.model.interface import LIGHT, ModelConfig
    from afford.twohands.model.losses import LossParams
    from afford.twohands.train.augment import Augmentation
    from afford.twohands.train.job import TwoHandsJob
    from afford.twohands.train.samples import Split

    if p.backbones and not (recipe or p.variant != "small"):
        raise ValueError(f"model_train: expected no backbones for variant {p.variant}, which starts from random weights, got "
                         f"{p.backbones!r}; leave them out")
    variant = recipe.variant if recipe else p.variant
    if variant == "lite" and not p.backbones:
        raise ValueError("model_train: variant lite needs the image encoder EfficientNet-Lite0, which set-up could not fetch; run "
                         "`python install/image_encoder.py`, or set model_train.variant=small")
    if recipe is not None:
        sized = {"": p, "small": Params()}[recipe.sizes]
        p = replace(p, variant=recipe.variant, hypotheses=recipe.hypotheses, text=recipe.text, decoders=recipe.decoders,
                    target=recipe.target, seed=recipe.seed, steps=min(recipe.steps or p.steps, p.steps),
                    **{name: getattr(sized, name) for name in SIZES})
    allowed = tuple(DTYPES) if p.variant == "vlm" else ("float32",)
    if p.frozen_dtype not in allowed:
        raise ValueError(f"model_train.frozen_dtype: expected {', '.join(allowed)} for variant {p.variant}, got {p.frozen_dtype!r}")
    light, classes = p.variant in LIGHT, p.classes and p.text and p.variant == "lite"
    if p.start and not light:
        raise ValueError(f"model_train.start: expected none for variant {p.variant}, which begins from backbones, got {p.start!r}")
    return TwoHandsJob(
        config=ModelConfig(variant=p.variant, hypotheses=p.hypotheses, text=p.text, decoders=p.decoders, backbones=p.backbones,
                           size_px=(p.height_px, p.width_px if light else p.height_px), frozen=bool(p.backbones),
                           seg_state=p.loss_mode, classes=classes,
                           style_noise=p.style_noise if p.variant == "lite" else 0.0),
        plan=plan_of(p, _parallel(p, light)),
        loss=LossParams(mode=p.loss_mode, mask=p.mask_loss, mask_weight=p.mask_weight, dice_weight=p.dice_weight,
                        object_weight=p.object_weight, centre_weight=p.centre_weight,
                        taxonomy_weight=float(recipe.taxonomy) if recipe else 1.0),
        division=Split(p.split_by, p.val_fraction, p.seed),
        views=Augmentation(p.flip_share, p.crop_share, wide_share=p.wide_share, stretch_share=p.stretch_share,
                    colour_share=p.colour_share, residue_share=p.residue_share, pasted_share=p.pasted_share,
                    unnamed_share=p.unnamed_share if classes else 0.0, unseen_share=p.unseen_share if classes else 0.0),
        coarse_share=p.coarse_share if light else 0.0,
        batch=p.batch, balance=p.balance, val_samples=p.val_samples, zoom=p.zoom, target=p.target, seed=p.seed,
        checkpointing=p.checkpointing and p.variant == "vlm", frozen_dtype=p.frozen_dtype, start=p.start)  # fmt: skip


def _parallel(p: Params, light: bool) -> int:
    """Number of micro-batches computed in parallel, each on one thread; faster than one micro-batch on two threads."""
    return min(THREADS, p.accumulate) if light and p.device == "cpu" and p.devices == 1 else 1
