"""Readers of video sources: EPIC/VISOR, own folders, COCO, bare video; masks, narrations."""
