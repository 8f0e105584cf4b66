"""a data set -> a trained affordance model (two hands in pictures, or RGB-D interactions), with its card and its curves.

Reads   FileTree of a data set: what dataset_pack writes, released 2HANDS (h5 + json), or any folder of `datasets` with the
        columns image, mask_left, mask_right, narration (backend sor3d: what interaction_pack writes); a Recipe, for a row of
        the ablation; for sor3d the files of a pre-training, if there was one; the weights that `backbones` names, if any
Writes  Trained: files (model/config.json, model/model.safetensors, card.md, history.parquet, tensorboard/, previews/) and the
        TrainingLog
Method  AdamW, linear warm-up and decay; order, augmentation and random states are functions of the seed and the step, so that
        a training that was killed goes on to the same weights; the weights of the best validation are kept, and the threshold
        that was best there; several devices by torch.distributed.run
Fails   when a part of the data set is empty or lacks a column, when the loss is not finite any more
Paper   2HandedAfforder, training (LISA's optimiser and schedule; batch and learning rate are ours, for a model without
        pretrained parts); SOR3D-AFF, training (`SOR3D_PAPER`: its rate, batch and epochs)
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from afford.common.registry import load
from schemas.files import FileTree
from schemas.spec import Context
from schemas.training import Recipe, Trained

LIBRARIES = ("numpy", "torch", "transformers", "tokenizers", "peft", "safetensors", "opencv-python-headless", "pyarrow", "h5py",
             "pycocotools", "blake3", "protobuf", "foxglove-schemas-protobuf", "mcap", "mcap-protobuf-support")  # fmt: skip
THREADS = 2
MEMORY_GIB = 2.0
MACHINE = "bf16"  # a CPU without instructions for bfloat16 goes on in single precision

BACKENDS = {
    "twohands": "afford.twohands.train.hands_job:job",
    "sor3d": "afford.rgbd.train.sor3d_job:job",
    "sor3d_actions": "afford.rgbd.train.actions_job:job",
    "boxes": "afford.rgbd.train.boxes_job:job",
}


@dataclass(frozen=True)
class Params:
    backend: str = "twohands"
    """what is trained: twohands; sor3d (SOR3D-AFF's model, on what interaction_pack writes); sor3d_actions (its first encoder
    before, on what action_pack or interaction_pack writes); boxes (a detector of single pictures to compare it with)"""
    variant: str = "small"
    """twohands: small (from nothing, on a CPU), clip (2HAff-CLIP) or vlm (2HandedAfforder); sor3d: small or paper"""
    hypotheses: int = 3
    """regions proposed for each hand; 1 is the paper's model"""
    text: bool = True
    """whether the model is told the task"""
    decoders: int = 2
    """2, or 1: one region for whichever hand, as LISA has it"""
    target: str = "affordance"
    """what is learned: affordance, or object (the complete object of each hand)"""
    row: str = "rgbd_attention_flow3d"
    """sor3d: what it has: rgb, rgb_attention, rgb_attention_flow2d, rgbd, rgbd_attention, rgbd_attention_flow3d"""
    static_share: float = 0.25
    """sor3d: the last frames of this share of a batch are learned beside it, as pictures; 0 in the paper"""
    foreground_weight: float = 1.0
    """sor3d: weight of pixels that afford something, against background; 1 in the paper"""
    turn: float = 0.75
    """sor3d: share of the steps after which regions count as much as the action (before: a quarter of it); 0.75 in the paper"""
    seed: int = 0
    """seed of weights, order and augmentation"""
    backbones: str = ""
    """clip, vlm: folder of pretrained parts or a hub id, tiny random ones without; sor3d: a VGG16 checkpoint for the stream of
    motion"""
    height_px: int = 128
    """height of the model's input; sor3d is square"""
    width_px: int = 160
    """width of the model's input; clip and vlm are square, as high as wide"""
    steps: int = 4500
    """steps of the optimiser, unless validation ends it earlier"""
    coarse_share: float = 0.53
    """share of the steps that come first, at half the size: of small (with twice as many samples) and sor3d"""
    batch: int = 8
    """samples per micro-batch and device"""
    accumulate: int = 2
    """micro-batches per step; those of small are computed at the same time on a CPU"""
    lr: float = 2e-3
    """learning rate after the warm-up"""
    warmup: int = 100
    """steps of linear warm-up"""
    decay: bool = True
    """whether the learning rate falls linearly to 0 after the warm-up; false in the paper of SOR3D-AFF"""
    weight_decay: float = 0.01
    """of AdamW"""
    clip_norm: float = 1.0
    """largest norm of the gradient, 0 for any"""
    bf16: bool = False
    """mixed precision, where the device has instructions for it: GPUs, and CPUs with AMX or AVX512-BF16"""
    validate_every: int = 1500
    """steps between two validations"""
    patience: int = 0
    """validations without a better one that end the training, 0 for never"""
    val_samples: int = 256
    """samples that judge, every second one cropped to its objects"""
    split_by: str = "given"
    """given: the data set's own train and val; video, object: a share of them, by hash, that never meets the rest"""
    val_fraction: float = 0.1
    """share that judges where it is divided by video or object"""
    balance: float = 0.5
    """0: samples as they are; 1: every verb with its taxonomy equally often"""
    flip_share: float = 0.5
    """share of samples that are mirrored, with hands and words"""
    crop_share: float = 0.8
    """share of samples that are cropped around their objects"""
    stretch_share: float = 0.5
    """share of samples that are made wider or narrower"""
    nameless_share: float = 0.0
    """share of samples whose things are called by a word that means nothing; they are cropped, and only the picture tells"""
    colour_share: float = 0.5
    """share of samples whose colours are changed"""
    zoom: float = 2.0
    """samples are kept at this many times the model's size, so that crops stay sharp"""
    loss_mode: str = "paper"
    """paper or code (docs/twohands/models.md): what an idle hand costs, and what the taxonomy loss is taken of"""
    mask_loss: str = "bce"
    """focal or bce; '' is what the mode says (paper: focal); from nothing, bce learns faster"""
    mask_weight: float = 1.0
    """weight of the mask loss; 2 in the paper"""
    dice_weight: float = 2.0
    """weight of the Dice loss; 0.5 in the paper of two hands, 0 in that of SOR3D-AFF"""
    object_weight: float = 1.0
    """weight of telling the complete object of each hand, which small does beside its regions; 0 for the paper's losses"""
    centre_weight: float = 1.0
    """weight of telling where in the whole picture the things are, of which a crop shows a part: left or right hand is a matter
    of that; small tells it beside its regions; 0 for the paper's losses"""
    device: str = "cpu"
    """cpu or cuda"""
    devices: int = 1
    """processes that train together, each with a device of its own"""


SOR3D = Params(backend="sor3d", height_px=72, steps=1300, batch=16, accumulate=1, lr=3e-3, warmup=20, validate_every=325,
               balance=0.0, foreground_weight=3.0, turn=0.5, static_share=0.5, coarse_share=0.45, bf16=True)  # fmt: skip
"""the embedded model of SOR3D-AFF, from nothing on two cores"""
SOR3D_PAPER = Params(backend="sor3d", variant="paper", height_px=300, steps=96200, batch=2, accumulate=1, lr=2e-5, warmup=1,
                     decay=False, weight_decay=0.0, clip_norm=0.0, validate_every=4810, balance=0.0, static_share=0.0,
                     coarse_share=0.0, dice_weight=0.0, flip_share=0.0, crop_share=0.0, colour_share=0.0,
                     device="cuda")  # fmt: skip
"""the paper's: 200 epochs of 962 sequences"""
SOR3D_PAPER_ACTIONS = replace(SOR3D_PAPER, backend="sor3d_actions", steps=4000, validate_every=400)
"""the paper's first encoder before: 50 epochs of 160 clips, which is what action_pack leaves of UTKinect-Action3D to learn from"""


def run(dataset: FileTree, params: Params, ctx: Context, recipe: Recipe | None = None,
        encoder: FileTree | None = None, weights: FileTree | None = None) -> Trained:  # fmt: skip
    """Train in the scratch folder, where a killed training goes on; sor3d from the `encoder` that sor3d_actions left, if any."""
    from afford.common import files
    from afford.models.weights import placed
    from afford.training import curves, fit, launch, written
    from afford.training.repeatable import repeatable

    job = _job(placed(params, weights, "backbones"), recipe)
    if encoder is not None:
        if params.backend != "sor3d":
            raise ValueError(f"model_train: expected backend sor3d for what starts from an encoder, got {params.backend!r}")
        job = job.starting_from(encoder)
    job.prepare({file.name: file.path for file in dataset.files}, ctx.scratch)
    if params.devices > 1:
        launch.launch(job, ctx.scratch, params.devices, ctx.progress)
    with repeatable(THREADS // job.plan.parallel, params.device):
        fitted = fit.fit(job, ctx.scratch, ctx.progress)
    name = recipe.name if recipe else params.variant if params.backend == "twohands" else params.backend
    log = curves.log(name, fitted.state)
    root = written.write(ctx.scratch, name, dataset, job, fitted, log)
    return Trained(files.tree(name, root), log)


def takes_backbones(params: Params) -> bool:
    """Whether the chosen model has pretrained parts to start from."""
    return params.backend == "sor3d" or (params.backend == "twohands" and params.variant != "small")


def _job(params: Params, recipe: Recipe | None = None):  # type: ignore[no-untyped-def]  # Job is a leaf's type
    if params.backbones and not (recipe or takes_backbones(params)):
        raise ValueError(f"model_train: expected no backbones for backend {params.backend}, variant {params.variant}, which starts "
                         f"from nothing, got {params.backbones!r}; leave them out")
    return load(BACKENDS, params.backend)(params, recipe, THREADS)
