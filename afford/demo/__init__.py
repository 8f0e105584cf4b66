"""A page on this machine where a trained model is asked about a picture."""
