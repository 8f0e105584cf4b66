"""Stages that record what other stages made."""
