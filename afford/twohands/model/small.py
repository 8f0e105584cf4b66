"""The embedded default: about two million parameters, trained from nothing on a CPU."""

from __future__ import annotations

from torch import Tensor, nn

from afford.models.normalise import normalised
from afford.models.words import Words
from afford.twohands.model.batch import Batch, Output
from afford.twohands.model.common import mlp
from afford.twohands.model.config import ModelConfig
from afford.twohands.model.encoder import Encoder
from afford.twohands.model.model import TwoHands
from afford.twohands.model.twoway import Decoder


class Small(TwoHands):
    """Words, encoder, decoder and the taxonomy head on the left hand's tokens."""

    def __init__(self, config: ModelConfig, words: Words | None, encoder: Encoder, decoder: Decoder, taxonomy: nn.Module) -> None:
        super().__init__()
        self.config = config
        self.words, self.encoder, self.decoder, self.taxonomy = words, encoder, decoder, taxonomy

    def forward(self, batch: Batch) -> Output:
        words, keep = self._read(batch)
        features = self.encoder(normalised(batch.image), words, keep)
        logits, score, tokens, objects, centre = self.decoder(features, keep, self.encoder.place(batch.image))
        both = (-1, 2, -1, -1, -1)
        return Output(logits.expand(both), score.expand(both[:3]), self.taxonomy(tokens[:, 0].flatten(1)), None,
                      objects.expand(both[:4]), centre)

    def _read(self, batch: Batch) -> tuple[Tensor, Tensor]:
        """Word vectors and which of them are real; no words at all for a model that does not read."""
        if self.words is not None:
            vectors, keep = self.words(batch.task)
            return vectors, keep
        none = batch.image.new_zeros(len(batch.image), 0, self.config.widths[2])
        return none, none[..., 0].bool()


def assemble(config: ModelConfig, _pretrained: bool) -> Small:
    """A `Small` with weights drawn from torch's current random state; it has no backbones that could be pretrained."""
    width, hands = config.widths[2], config.decoders
    words = Words(config.text_buckets, config.text_words, width) if config.text else None
    encoder = Encoder(config.size_px, config.widths, config.convolutions, config.depth, config.heads, config.dropout)
    decoder = Decoder(config.widths, config.heads, config.decoder_depth, hands, config.hypotheses)
    return Small(config, words, encoder, decoder, mlp((1 + config.hypotheses) * width, width, 4))
