"""What the vision-language model is asked and answers, in our own words. The answer's [SEG] is where the regions come from."""

from __future__ import annotations

QUESTIONS = (
    "Where should each hand touch to {task}? Show the regions.",
    "Which parts does one hold in order to {task}? Mark them.",
    "Somebody wants to {task}. Where do the hands go?",
    "Point out where to put the hands if the task is to {task}.",
)
ANSWERS = (
    "It is [SEG].",
    "The hands go to [SEG].",
    "Here: [SEG].",
    "Sure, the regions are [SEG].",
    "[SEG].",
)
INFERENCE = "Where would you interact with the object to perform action {task}"
"""the question that is always asked outside training, in substance the published one"""
CONVERSATION = "USER: {image}\n{question} ASSISTANT:"
"""what stands before the answer"""
FRAMED = "<im_start><image><im_end>"
"""the image, for tokenizers that have the marks around it, as the released models do"""


def question(task: str, template: str = INFERENCE, image: str = "<image>") -> str:
    """The text before the answer, the image included."""
    return CONVERSATION.format(image=image, question=template.format(task=task))
