"""Values to MCAP recordings and back: what a stage made, to be looked at in Foxglove, Rerun or a terminal."""
