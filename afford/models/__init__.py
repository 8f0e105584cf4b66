"""Learned models: loaded with `from_pretrained` from a local folder or a hub id; nothing here carries weights."""
