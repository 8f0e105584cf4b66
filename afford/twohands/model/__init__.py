"""Two-hand affordance models: image and task in, where each hand goes out (2HandedAfforder, papers of CITATION.cff).

`config` and `batch` are the contract; the parts (`words`, `encoder`, `twoway`; `tokens`, `dialogue`, `sam`) know nothing of each
other's work; `small`, `clip` and `vlm` assemble them; `build` knows the three by name; `losses`, `select`, `files` and `predictor`
are what one does with a model.
"""
