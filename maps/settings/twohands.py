"""Parameters of the two-hand model, its benchmark and its ablation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from stages.twohands import ablation_report, baseline_cases, benchmark, benchmark_set, model_train, predict_cases, score_cases


@dataclass(frozen=True)
class Twohands:
    """The parameters of every stage of the system, by stage."""

    benchmark_set: benchmark_set.Params = benchmark_set.Params()
    model_train: model_train.Params = model_train.QUICK
    predict_cases: predict_cases.Params = predict_cases.Params()
    baseline_cases: baseline_cases.Params = baseline_cases.Params()
    score_cases: score_cases.Params = score_cases.Params()
    benchmark: benchmark.Params = benchmark.Params()
    ablation_report: ablation_report.Params = ablation_report.Params()


PRESETS: dict[tuple[str, str, str], Any] = {
    ("model_train", "variant", "vlm"): model_train.VLM,
    ("model_train", "variant", "clip"): model_train.CLIP,
    ("model_train", "variant", "small"): model_train.Params(),
    ("model_train", "recipe", "release"): model_train.RELEASE,
}
"""(stage, parameter, value) -> defaults of all parameters of the stage when the parameter has this value"""
MODES: dict[tuple[str, str, str], dict[str, Any]] = {("model_train", "loss_mode", "code"): model_train.CODE}
"""(stage, parameter, value) -> parameters that it changes in a preset of the stage"""
