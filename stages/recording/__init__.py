"""Stages that record the outputs of other stages."""
