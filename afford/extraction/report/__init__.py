"""The quality report of extraction against ground truth."""
