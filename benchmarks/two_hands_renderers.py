"""Train two-hand models on the pictures of one renderer, test them on those of another; writes benchmarks/two_hands_renderers.md.

    python install/cycles.py                                            # once, for cycles
    PYTHONPATH=. python benchmarks/two_hands_renderers.py [--store DIR] [--variants small,lite] [--renderers raster,cycles]
        [--photographs DIR] [--steps N] [--seeds N] [--cases DIR]

Scenes and masks are the same with both renderers. Every training and every picture is cached,
so that the script can be stopped and run again.
"""

from __future__ import annotations

import argparse
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.pages import ROOT, make

PAGE = ROOT / "benchmarks" / "two_hands_renderers.md"
SIZES = {"small": (128, 160), "lite": (192, 256)}
"""height and width of the input of each variant"""
GROUPS = (("known.", "known kinds"), ("new.", "new kinds"), ("shift.", "workshop, desk"), ("masks.", "whole pictures"))
COLUMNS = (("iou", "", "IoU"), ("precision", "", "precision"), ("iou", "_text_shuffled", "IoU, wrong words"))
"""measure, suffix of the method, title"""


def sets(**values: object) -> list[str]:
    """Arguments that set parameters; STAGE__PARAM=VALUE."""
    return [word for name, value in values.items() for word in ("--set", f"{name.replace('__', '.')}={value}")]


def rendered(renderer: str, photographs: Path | None) -> list[str]:
    """Arguments that choose a renderer of stills."""
    extra = {"still_render__photographs": photographs} if photographs and renderer == "cycles" else {}
    return sets(still_render__backend=renderer, **extra)


def cases(args: argparse.Namespace) -> dict[str, Path]:
    """Render the benchmark with each renderer; a copy of each is kept."""
    out = {}
    for renderer in args.renderers:
        out[renderer] = args.cases / renderer
        found = make("benchmark-set", args.store, *rendered(renderer, args.photographs))
        shutil.rmtree(out[renderer], ignore_errors=True)
        shutil.copytree(found["outputs"]["benchmark"], out[renderer])
    return out


def scores(args: argparse.Namespace, tests: dict[str, Path]) -> Iterator[tuple[tuple[str, str, str], dict[str, float]]]:
    """Yield (variant, renderer of the training, renderer of the test) and its metrics, for every seed."""
    for seed in range(args.seeds):
        for variant in args.variants:
            height, width = SIZES[variant]
            for renderer in args.renderers:
                chosen = sets(model_train__variant=variant, model_train__height_px=height, model_train__width_px=width,
                              model_train__seed=seed, model_train__steps=args.steps,
                              model_train__validate_every=max(args.steps // 3, 1))  # fmt: skip
                for test, folder in tests.items():
                    found = make("benchmark", args.store, "--source", str(folder), *rendered(renderer, args.photographs), *chosen)
                    metrics = found["metrics"]
                    print(f"seed {seed}, {variant} from {renderer} on {test}: IoU {metrics['small.iou']:.3f}", flush=True)
                    yield (variant, renderer, test), metrics


def page(args: argparse.Namespace, found: dict[tuple[str, str, str], list[dict[str, float]]]) -> str:
    """Write the Markdown page."""
    titles = [f"{group}: {title}" for _, group in GROUPS for _, _, title in COLUMNS]
    lines = [f"| model | trained on | tested on | {' | '.join(titles)} |", f"|---|---|---|{'--:|' * len(titles)}"]
    for (variant, renderer, test), runs in found.items():
        cells = [cell([run.get(f"{prefix}small{suffix}.{measure}") for run in runs])
                 for prefix, _ in GROUPS for measure, suffix, _ in COLUMNS]  # fmt: skip
        lines.append(f"| {variant} | {renderer} | {test} | {' | '.join(cells)} |")
    text = (
        f"Written by `benchmarks/two_hands_renderers.py`: {args.steps} steps, mean and standard deviation over {args.seeds} "
        "seed(s)."
    )
    notes = (
        "Strict measures of held-out rooms (docs/twohands/benchmark.md); crops, except whole pictures. `raster` is the fast "
        "renderer, `cycles` path-traces the same scenes."
    )
    return "\n".join(["# Two-hand models between renderers", "", f"{text} {notes}", "", *lines]) + "\n"


def cell(values: list[float | None]) -> str:
    """Mean and standard deviation; '' where nothing was measured."""
    known = [value for value in values if value is not None]
    if not known:
        return ""
    return f"{np.mean(known):.3f}" + (f" ± {np.std(known, ddof=1):.3f}" if len(known) > 1 else "")


def main() -> None:
    """Train and score, then write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--store")
    parser.add_argument("--variants", type=lambda text: text.split(","), default=list(SIZES))
    parser.add_argument("--renderers", type=lambda text: text.split(","), default=["raster", "cycles"])
    parser.add_argument("--photographs", type=lambda text: Path(text).absolute())
    parser.add_argument("--steps", type=int, default=2400)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--cases", type=Path, default=ROOT.parent / "renderer-cases")
    args = parser.parse_args()
    found: dict[tuple[str, str, str], list[dict[str, float]]] = {}
    for row, metrics in scores(args, cases(args)):
        found.setdefault(row, []).append(metrics)
    PAGE.write_text(page(args, found))


if __name__ == "__main__":
    main()
