"""On-disk data set formats: Parquet, 2HANDS, ActAffordance, COCO, WebDataset, SOR3D-AFF."""
