"""Typed values that stages exchange: frozen dataclasses with shape, dtype, unit and frame on every array."""
