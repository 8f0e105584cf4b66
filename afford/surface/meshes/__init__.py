"""Mesh files: discover, read, repair, unwrap, texture, label."""
