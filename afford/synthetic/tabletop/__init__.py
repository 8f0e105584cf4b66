"""Rendered table-top RGB-D interactions with exact scene flow, depth and affordance labels."""
