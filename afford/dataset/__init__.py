"""On-disk formats: 2HANDS, ActAffordance, COCO, WebDataset, SOR3D-AFF."""
