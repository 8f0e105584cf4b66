"""Graph building: valid composition, and errors for misuse."""

from __future__ import annotations

from dataclasses import dataclass

import pytest
from toy import join, pair, shout, split
from toy.values import Word

from runner import Graph, GraphError


@dataclass
class Thawed:
    parts: int = 2


def words(g: Graph, name: str = "words") -> tuple[Word, ...]:
    return g.leaf(name, (Word("a", "x"), Word("b", "y")))


def test_a_handle_has_none_of_the_attributes_of_its_value() -> None:
    """The error for reading a field of an output during graph building gives advice."""
    g = Graph()
    handle = g.leaf("word", Word("a", "x"))
    with pytest.raises(AttributeError, match=r"g\.pick\(handle, lambda v: v\.text\)"):
        _ = handle.text
    with pytest.raises(TypeError, match=r"g\.each"):
        list(words(g))  # type: ignore[call-overload]


@pytest.mark.parametrize(("build", "message"), [
    (lambda g: g.add(split.run, word=Word("a", "x"), params=split.Params()), "expected a handle of this graph, got Word"),
    (lambda g: g.add(split.run, word=g.leaf("w", Word("a", "x")), params=Thawed()), "params must be a frozen dataclass"),
    (lambda g: g.add(split.run, wurd=g.leaf("w", Word("a", "x")), params=split.Params()), "expected run\\(word"),
    (lambda g: g.add(split.run, word=g.leaf("w", Word("a", "x"))), "missing a required argument: 'params'"),
    (lambda g: g.add(lambda word: word, word=g.leaf("w", Word("a", "x"))), "expected a function of a module"),
    (lambda g: g.pick(g.leaf("w", Word("a", "x")), lambda v: v), "a function that reads one field"),
    (lambda g: g.add(pair.run, word=Graph().leaf("w", Word("a", "x"))), "belongs to another graph"),
])
def test_misuse_is_refused_when_the_graph_is_built(build: object, message: str) -> None:
    """Messages are specific to the misuse."""
    with pytest.raises(GraphError, match=message):
        build(Graph())  # type: ignore[operator]


def test_a_stage_is_added_twice_only_under_another_name() -> None:
    """Stage names are unique; `g.named` gives another name."""
    g = Graph()
    word = g.leaf("w", Word("a", "x"))
    g.add(pair.run, word=word)
    with pytest.raises(GraphError, match="added twice"):
        g.add(pair.run, word=word)
    g.named("pair_again").add(pair.run, word=word)
    assert [node.name for node in g.stages()] == ["pair", "pair_again"]


def test_inputs_spread_over_different_lists_are_refused() -> None:
    """Two lists are not zipped by accident; an outer list is broadcast over an inner one."""
    g = Graph()
    one, two = g.each(words(g)), g.each(words(g, "others"))
    with pytest.raises(GraphError, match=r"use g\.collect on it"):
        g.add(shout.run, part=one, word=two, params=shout.Params())
    part = g.each(g.add(split.run, word=one, params=split.Params()))
    both = g.node_of(g.add(shout.run, part=part, word=one, params=shout.Params()))
    assert len(both.axes) == 2
    assert g.node_of(g.collect(part)).axes == ()


def test_the_same_list_gives_the_same_axis() -> None:
    """Two uses of `each` on one list can be combined."""
    g = Graph()
    source = words(g)
    g.add(shout.run, part=g.each(source), word=g.each(source), params=shout.Params())


def test_several_handles_make_one_tuple() -> None:
    """A tuple of handles is gathered into one input."""
    g = Graph()
    word = g.each(words(g))
    node = g.node_of(g.add(join.run, words=(word, word)))  # type: ignore[call-arg]
    assert g.nodes[node.inputs[0][1]].sort == "gather"
    assert node.axes == g.node_of(word).axes


def test_a_variant_shares_what_is_the_same_and_names_what_differs() -> None:
    """Stages above the difference are shared nodes; those below it carry the label."""
    g, found = Graph(), {}
    word = g.each(words(g))
    for label, parts in (("two", 2), ("three", 3)):
        with g.variant(label) as names:
            once = g.add(shout.run, part=word, word=word, params=shout.Params())
            pieces = g.add(split.run, word=once, params=split.Params(parts=parts))
            g.add(join.run, words=g.collect(g.each(pieces)), ctx=g.ctx)
        found[label] = dict(names)
    assert found == {"two": {"shout": "shout", "split": "split", "join": "join"},
                     "three": {"shout": "shout", "split": "split_three", "join": "join_three"}}
    assert len(g.stages()) == 5
    with pytest.raises(GraphError, match="added twice"):
        g.add(shout.run, part=word, word=word, params=shout.Params())
