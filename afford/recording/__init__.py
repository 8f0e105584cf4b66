"""Recordings of stages: typed outputs as MCAP files, their checks, contact sheets, Foxglove layouts and Rerun views."""
