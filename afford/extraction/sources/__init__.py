"""Readers of video sources: EPIC-KITCHENS/VISOR, own folders, COCO, video without masks; masks and narrations."""
