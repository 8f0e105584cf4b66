"""Two-hand affordance models: training, prediction, benchmark and demo."""
