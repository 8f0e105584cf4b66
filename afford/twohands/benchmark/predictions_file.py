"""Parquet file with the predictions of a method for the cases of a benchmark.

The file has one row for each case, with probabilities rounded to 1/255. A case without a row has no prediction.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from schemas.benchmark import Prediction

FILE_NAME = "predictions.parquet"
SCHEMA = pa.schema([
    pa.field("case_id", pa.string(), metadata={"doc": "<protocol>/<video>/<frame>"}),
    pa.field("task", pa.string(), metadata={"doc": "what the method was told"}),
    pa.field("hypotheses", pa.int32()), pa.field("height", pa.int32()), pa.field("width", pa.int32()),
    pa.field("probability", pa.binary(), metadata={"doc": "(2, hypotheses, height, width) uint8, 255 = certain; left, right"}),
    pa.field("score", pa.list_(pa.float32()), metadata={"doc": "(2, hypotheses); each hand's sum is 1"}),
    pa.field("taxonomy", pa.list_(pa.float32()), metadata={"doc": "left, right, both_same, both_different; NaN: it tells none"}),
    pa.field("hands", pa.list_(pa.bool_()), metadata={"doc": "which hands are returned"}),
    pa.field("threshold", pa.float64(), metadata={"doc": "the method's own"}),
    pa.field("calibration", pa.list_(pa.float64()), metadata={"doc": "slope and offset that calibrated the logits"}),
    pa.field("present", pa.float64(), metadata={"doc": "probability that what the task names is in the image"}),
])  # fmt: skip


def write_predictions(path: Path, rows: Iterable[tuple[str, Prediction]]) -> None:
    """Write pairs of case id and prediction, with one row in memory at a time."""
    with pq.ParquetWriter(path, SCHEMA, compression="zstd", compression_level=1, use_dictionary=False) as writer:
        for case_id, prediction in rows:
            writer.write_table(pa.Table.from_pylist([_row(case_id, prediction)], SCHEMA))


def _row(case_id: str, prediction: Prediction) -> dict[str, object]:
    _, k, height, width = prediction.probability.shape
    return {
        "case_id": case_id, "task": prediction.task, "hypotheses": k, "height": height, "width": width,
        "probability": np.rint(prediction.probability * np.float32(255)).astype(np.uint8).tobytes(),
        "score": prediction.score.reshape(-1).tolist(), "taxonomy": prediction.taxonomy.tolist(),
        "hands": prediction.hands.tolist(),
        "threshold": prediction.threshold, "calibration": list(prediction.calibration), "present": prediction.present,
    }  # fmt: skip


class PredictionFile:
    """Predictions of a file, read one at a time."""

    def __init__(self, path: Path) -> None:
        self._file = pq.ParquetFile(path)
        if self._file.schema_arrow.names != SCHEMA.names:
            raise ValueError(f"{path.name}: expected the columns {', '.join(SCHEMA.names)}, "
                             f"got {', '.join(self._file.schema_arrow.names)}; write it with predict_cases")
        names = self._file.read(columns=["case_id"], use_threads=False)["case_id"].to_pylist()
        self._row = {name: number for number, name in enumerate(names)}

    def get(self, case_id: str) -> Prediction | None:
        """Read the prediction for a case; None without a row."""
        if case_id not in self._row:
            return None
        row = self._file.read_row_group(self._row[case_id], use_threads=False).to_pylist()[0]
        shape = 2, row["hypotheses"], row["height"], row["width"]
        probability = np.frombuffer(row["probability"], np.uint8).reshape(shape) / np.float32(255)
        score = np.array(row["score"], np.float32).reshape(shape[:2])
        return Prediction(row["task"], probability, score, np.array(row["taxonomy"], np.float32), np.array(row["hands"], bool),
                          row["threshold"], calibration=tuple(row["calibration"]), present=row["present"])
