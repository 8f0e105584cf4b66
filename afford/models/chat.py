"""Parameters of vision-language models that are shown pictures and asked about them: on this machine, or behind a server."""

from __future__ import annotations

from dataclasses import dataclass

from afford.models.api_key import harmless
from afford.models.params import Pretrained


@dataclass(frozen=True)
class Chat(Pretrained):
    """A vision-language model on this machine."""

    model: str = ""
    """local folder or hub id"""
    new_tokens: int = 1024
    """longest answer"""

    def __post_init__(self) -> None:
        if self.new_tokens < 1:
            raise ValueError(f"expected new_tokens of 1 or more, got {self.new_tokens}")


@dataclass(frozen=True)
class Endpoint:
    """A vision-language model behind an OpenAI-compatible server."""

    model: str = ""
    """what the server calls its model"""
    url: str = ""
    """base address of the server, e.g. http://127.0.0.1:8000/v1"""
    key_variable: str = "OPENAI_API_KEY"
    """name of the environment variable that holds the key; '' for a server that asks for none"""
    timeout_s: float = 120.0
    """longest that a request lasts as a whole, from the connection to the last byte of the reply"""
    retries: int = 3
    """further tries when it cannot be reached, is busy or fails"""
    pause_s: float = 1.0
    """before the first of them; twice as long before each further one"""
    seed: int = 0
    """sent to the server, which may heed it"""
    new_tokens: int = 1024
    """longest answer"""

    def __post_init__(self) -> None:
        """What might be a key is not shown, and is refused before anything is written."""
        harmless(self.url, self.key_variable)
        if self.new_tokens < 1 or self.retries < 0 or self.timeout_s <= 0 or self.pause_s < 0:
            raise ValueError("expected new_tokens of 1 or more, timeout_s above 0, retries and pause_s of 0 or more, got "
                             f"{self.new_tokens}, {self.timeout_s}, {self.retries} and {self.pause_s}")  # fmt: skip
