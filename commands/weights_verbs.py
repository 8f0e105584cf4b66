"""Options of the verbs of `weights`; the implementations are in `commands.weights_import`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from commands.options import Device, Json, Sets

app = typer.Typer(no_args_is_help=True, help="Import published checkpoints; list, verify, show and plan them.")
Imported = Annotated[Path, typer.Argument(metavar="DIR", help="folder that `weights import` wrote")]


@app.command("import")
def weights_import(
    kind: Annotated[str, typer.Argument(help="2haff, lisa, llava, sam, sam2, sam3, clip, vidm, lama, vgg16 or xmem")],
    files: Annotated[list[Path], typer.Argument(help="files or folders of the checkpoint, and of the parts it lacks")],
    out: Annotated[Path, typer.Option("--out", metavar="DIR", help="new folder for the model")],
    dtype: Annotated[str, typer.Option(help="float32, bfloat16 or float16")] = "float32",
    json: Json = False,
) -> None:
    """Import a published checkpoint, tensor by tensor; nothing of it is run, and every tensor must fit."""
    from commands.weights_import import bring

    raise typer.Exit(bring(kind, files, out, dtype, json))


@app.command("list")
def weights_list(json: Json = False) -> None:
    """List the kinds of checkpoints, and the files that each needs."""
    from commands.weights_import import kinds

    raise typer.Exit(kinds(json))


@app.command("verify")
def weights_verify(folder: Imported, json: Json = False) -> None:
    """Compare the files of an imported model with their digests."""
    from commands.weights_import import verify

    raise typer.Exit(verify(folder, json))


@app.command("show")
def weights_show(folder: Imported, json: Json = False) -> None:
    """Show kind, parameters, number type, digest, licence as stated, and use of an imported model."""
    from commands.weights_import import show

    raise typer.Exit(show(folder, json))


@app.command("plan")
def weights_plan(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="a two-hand model of the variant vlm, or a folder of backbones")],
    device: Device = "cpu",
    batch: Annotated[int, typer.Option(help="pictures in one batch of `predict`")] = 1,
    set_: Sets = None,
    json: Json = False,
) -> None:
    """Say how much memory predictions and trainings of a large model need, before anything is loaded."""
    from commands.weights_plan import plan

    raise typer.Exit(plan(folder, device, batch, set_ or (), json))
