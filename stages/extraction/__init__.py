"""Stages from video to a two-hand affordance data set."""
