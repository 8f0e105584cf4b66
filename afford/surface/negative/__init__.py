"""Negative affordance: votes of views on faces, fusion, distance, baselines, score, report."""
