"""Benchmark of two-hand affordance predictions on cases in the layout of ActAffordance.

`cases` and `toras` read the ground truth. `baselines` and `dataset_baselines` make predictions without a network. `answers` brings
the predictions of any method onto the grid of a case. `measures` and `compat` are formulas, `score` applies them to one method, and
`report` compares methods.
"""
