"""Stages from mesh and task to affordance on its faces."""
