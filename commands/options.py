"""Arguments and options of the command line, shared by its verbs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

NAMED = "TARGETS"
"""placeholder in help texts, which `main` replaces with the names of the targets"""
Target = Annotated[str | None, typer.Argument(help=f"{NAMED}; default: dataset, or the first that has the stage of --only",
                                              show_default=False)]  # fmt: skip
SourceDir = Annotated[Path | None, typer.Option("--source", help="EPIC root, folder of videos, meshes, RGB-D or pictures; default: "
                                                "rendered data")]
Clips = Annotated[list[str] | None, typer.Option("--clip", help="only this clip (repeatable)")]
Sets = Annotated[list[str] | None, typer.Option("--set", help="STAGE.PARAM=VALUE (repeatable)")]
ParamsFile = Annotated[Path | None, typer.Option("--params", help="TOML or JSON, one table per stage")]
Store = Annotated[Path | None, typer.Option("--store", help="folder of the store; default: artifacts/")]
Remote = Annotated[str | None, typer.Option("--remote", envvar="AFFORD_REMOTE", show_default=False, help="object store or folder "
                                            "that several hosts share: s3://, az://, gs://, file:// or a path")]  # fmt: skip
Device = Annotated[str, typer.Option(help="cpu or cuda")]
Json = Annotated[bool, typer.Option("--json", help="print one JSON object as the last line")]
