"""The quality report: what is measured on a clip with ground truth, beside which baselines, and how it is shown."""
