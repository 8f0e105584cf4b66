"""From image and task to a region for each hand: model, training, benchmark, prediction, demo."""
