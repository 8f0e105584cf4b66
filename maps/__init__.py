"""Maps: one module per system that defines the graphs of its targets, one line per stage."""
