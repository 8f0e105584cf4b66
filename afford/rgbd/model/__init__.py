"""The SOR3D-AFF model: encoders, ConvLSTM, soft attention, decoders."""
