"""Negative affordance: projection of part masks on faces, baselines, score, report, export."""
