"""Stages: one file, one stage, one public function `run`."""
