"""The graph of stages. Composition is typed, so that an edge is a checked call and not a string.

    g = Graph()
    clip   = g.each(g.add(source_read.run, files=g.leaf("video", tree), params=p))
    frames = g.add(frame_decode.run, media=tree, footage=clip, params=q)
    g.target("dataset", g.add(dataset_pack.run, frames=g.collect(frames), params=r))

Every call returns a handle, which type checkers treat as the value that it stands for. A node runs once per path: `each` opens an
axis, a node is spread over the longest axes of its inputs, and the axes of every other input must be a prefix of them (broadcast).
Published, measured and cost labels name values for the summary of a run; they are in no key.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Literal, ParamSpec, TypeVar, cast

P = ParamSpec("P")
T = TypeVar("T")
U = TypeVar("U")
Sort = Literal["leaf", "stage", "each", "collect", "pick", "gather"]


class GraphError(ValueError):
    """The graph is invalid; the message names the call and the remedy."""


@dataclass(frozen=True)
class Node:
    """One line of the graph.

    `inputs` are (argument or part name, node id); `axes` are the `each` nodes over which the node is spread.
    """

    id: int
    sort: Sort
    name: str
    inputs: tuple[tuple[str, int], ...] = ()
    axes: tuple[int, ...] = ()
    value: Any = None
    """leaf: the value; stage: the function; pick: the field"""
    params: Any = None
    wants_ctx: bool = False
    partial: bool = False
    """collect, gather: takes the available elements, also when the rest is deferred to another run"""


class Handle:
    """Placeholder for a value that a run computes; it has none of the value's attributes."""

    def __init__(self, graph: Graph, node: Node) -> None:
        self.__dict__.update(_graph=graph, _node=node)

    def __getattr__(self, name: str) -> Any:
        node = self.__dict__["_node"]
        raise AttributeError(f"the output of {node.name!r} exists only in a run: .{name} cannot be read while the "
                             f"graph is built; read it in a stage, or use g.pick(handle, lambda v: v.{name}) for a bundle")

    def __iter__(self) -> Any:
        name = self.__dict__["_node"].name
        raise TypeError(f"the output of {name!r} cannot be iterated while the graph is built; use g.each(handle)")

    def __repr__(self) -> str:
        return f"<handle {self.__dict__['_node'].name}>"


class _Field:
    """Records which attribute a `pick` reads."""

    def __init__(self) -> None:
        self.__dict__["names"] = []

    def __getattr__(self, name: str) -> _Field:
        self.__dict__["names"].append(name)
        return self


class Graph:
    """A DAG of stages."""

    def __init__(self) -> None:
        self.nodes: list[Node] = []
        self.targets: dict[str, tuple[Any, ...]] = {}
        self.priority: set[int] = set()
        self.published: list[Published] = []
        self.measured: list[Measured] = []
        self.costs: list[Cost] = []
        self._axes: dict[int, Handle] = {}
        self._variant: tuple[str, dict[str, str]] | None = None
        self._part = ""

    def leaf(self, name: str, value: T) -> T:
        """Add a value that is known now; a tuple is a list of values."""
        return cast(T, self._new("leaf", name, value=value))

    @property
    def ctx(self) -> Any:
        """Value to pass as `ctx` of a stage, for type checkers; the runner supplies the context in any case."""
        return None

    def named(self, name: str) -> Named:
        """Name the next stage, to use one function twice: `g.named("b").add(...)`."""
        return Named(self, name)

    @contextmanager
    def variant(self, label: str) -> Iterator[dict[str, str]]:
        """Repeat lines with other parameters.

        Within it, an existing node with the same arguments is reused, and a stage that differs is added as
        `<name>_<label>`. Yields a dict from name to name in this graph, which fills with each added stage.
        """
        names: dict[str, str] = {}
        self._variant = label, names
        try:
            yield names
        finally:
            self._variant = None

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        """Add the lines of one of several combined targets.

        Nodes that the targets share exist once, as in a `variant`. The targets are named `<part>.<name>`, and published and
        measured values belong to the part.
        """
        self._part = name
        try:
            with self.variant(name.replace("-", "_")):
                yield
        finally:
            self._part = ""

    def publish(self, value: T, place: str, as_: str) -> T:
        """Publish a value at a place under the store, with a name for the summary of a run.

        `g.publish(packed, "datasets/{source}", as_="dataset")`: {source} is the name of the run's source, {clip} the shard,
        which gives every shard its own place. A place with a suffix is a single file. Every run that computes the value
        publishes it.
        """
        node = self._node(value, "g.publish")
        self.published.append(Published(node.id, place, as_, self._part))
        return value

    def measure(self, value: T, file: str = "metrics.json", under: str = "") -> T:
        """Show figures from a JSON file of a value, an object of numbers; `under` is prefixed to each name."""
        self.measured.append(Measured(self._node(value, "g.measure").id, file, under, self._part))
        return value

    def cost(self, name: str, stages: Iterable[Any], per: tuple[Any, str], *, shards: Any = None, scale: float = 1.0,
             each: bool = False, rate: bool = False) -> None:  # fmt: skip
        """Add a cost figure: CPU seconds of stages per unit of a measured figure.

        `per` is (measured value, figure in it). `shards`: count only the shards of this stage; `scale`: factor of the unit;
        `each`: also one figure for every stage, as `<name>.<stage>`; `rate`: units per CPU second instead, omitted when no
        time was spent.
        """
        spent = tuple(self._maker(stage) for stage in stages)
        self.costs.append(Cost(name, spent, self._node(per[0], "g.cost").id, per[1],
                               None if shards is None else self._maker(shards), scale, each, rate, self._part))

    def add(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> T:
        """Add a stage, named after its module.

        Inputs are handles or tuples of handles, `params` is a frozen dataclass, and the runner supplies `ctx`. GraphError
        when the arguments do not fit.
        """
        return self._add(fn.__module__.rpartition(".")[2], fn, args, kwargs)

    def _add(self, name: str, fn: Callable[..., T], args: tuple[Any, ...], kwargs: dict[str, Any]) -> T:
        taken = any(node.sort == "stage" and node.name == name for node in self.nodes)
        if taken and not self._variant:
            raise GraphError(f"stage {name!r} is added twice; give the second one a name: g.named('{name}_again').add(...)")
        if "." in fn.__qualname__:
            raise GraphError(f"{name}: expected a function of a module, got {fn.__qualname__}; workers import it by its name")
        bound, wants_ctx = _bind(fn, args, kwargs, name)
        params = bound.pop("params", None)
        if params is not None and not _is_frozen(params):
            raise GraphError(f"{name}: params must be a frozen dataclass, got {type(params).__name__}")
        inputs = tuple((key, self._input(value, f"{name}.{key}").id) for key, value in bound.items())
        own = f"{name}_{self._variant[0]}" if self._variant and taken else name
        made = self._new("stage", name, inputs, self._join(inputs, name), own=own, value=fn, params=params, wants_ctx=wants_ctx)
        if self._variant:
            self._variant[1][name] = made.__dict__["_node"].name
        return cast(T, made)

    def each(self, values: tuple[T, ...]) -> T:
        """Spread a list: every stage that uses the result runs once per element.

        The same list gives the same axis.
        """
        source = self._node(values, "g.each")
        if source.id not in self._axes:
            axes = (*source.axes, len(self.nodes))
            self._axes[source.id] = self._new("each", f"each {source.name}", (("", source.id),), axes)
        return cast(T, self._axes[source.id])

    def first(self, value: T) -> T:
        """Give the tasks behind `value` priority over all others, for quick checks that tell whether the rest is worthwhile."""
        self.priority.add(self._node(value, "g.first").id)
        return value

    def collect(self, value: T, partial: bool = False) -> tuple[T, ...]:
        """Collect all elements over all axes, in order.

        Failed elements are omitted and listed in the report. With `partial`, deferred elements are omitted as well, even
        all of them; without it, one deferred element defers the list.
        """
        source = self._node(value, "g.collect")
        return cast("tuple[T, ...]", self._new("collect", f"collect {source.name}", (("", source.id),), partial=partial))

    def finished(self, name: str, values: Iterable[T]) -> tuple[T, ...]:
        """Collect those handles that have an output, in order; failed and deferred ones are omitted."""
        parts = tuple(values)
        inputs = self._parts(parts, name) if parts else ()
        return cast("tuple[T, ...]", self._new("gather", name, inputs, self._join(inputs, name), partial=True))

    def pick(self, value: T, field: Callable[[T], U]) -> U:
        """Select one field of an output that the codec splits (a bundle): `g.pick(h, lambda v: v.files)`."""
        source = self._node(value, "g.pick")
        seen = _Field()
        field(cast(T, seen))
        names = seen.__dict__["names"]
        if len(names) != 1:
            raise GraphError(f"g.pick on {source.name!r}: expected a function that reads one field, got {names or 'none'}")
        return cast(U, self._new("pick", f"{source.name}.{names[0]}", (("", source.id),), source.axes, value=names[0]))

    def target(self, name: str, *handles: Any) -> None:
        """Name handles as a target of runs."""
        name = f"{self._part}.{name}" if self._part else name
        if name in self.targets:
            raise GraphError(f"target {name!r} is declared twice")
        self.targets[name] = tuple(Handle(self, self._node(handle, f"g.target({name!r})")) for handle in handles)

    def node_of(self, handle: Any) -> Node:
        """Node of a handle of this graph."""
        return self._node(handle, "node_of")

    def upstream(self, wanted: Iterable[Node]) -> list[Node]:
        """`wanted` and all nodes that they depend on, inputs first."""
        need, stack = set(), [node.id for node in wanted]
        while stack:
            at = stack.pop()
            if at not in need:
                need.add(at)
                stack += [source for _, source in self.nodes[at].inputs]
        return [self.nodes[i] for i in sorted(need)]

    def optional(self, wanted: Iterable[Node]) -> frozenset[int]:
        """Ids of nodes that `wanted` can do without, because only partial collections use them."""
        need, stack = set[int](), [node.id for node in wanted]
        while stack:
            node = self.nodes[stack.pop()]
            if node.id not in need:
                need.add(node.id)
                stack += () if node.partial else [source for _, source in node.inputs]
        return frozenset(node.id for node in self.upstream(wanted)) - need

    def stages(self) -> list[Node]:
        """Stages in the order of their definition."""
        return [node for node in self.nodes if node.sort == "stage"]

    def _maker(self, value: Any) -> str:
        """Name of the stage that produces a value, or a field of it."""
        node = self._node(value, "g.cost")
        while node.sort == "pick":
            node = self.nodes[node.inputs[0][1]]
        return node.name

    def _new(self, sort: Sort, name: str, inputs: tuple[tuple[str, int], ...] = (), axes: tuple[int, ...] = (), *, own: str = "",
             **more: Any) -> Handle:
        """Add a node, called `own` if its name is taken; in a variant, reuse an equal node."""
        node = Node(len(self.nodes), sort, name, inputs, axes, **more)
        twin = next((old for old in self.nodes if self._variant and _same(old, node)), None)
        if twin is not None:
            return Handle(self, twin)
        node = replace(node, name=own or name)
        self.nodes.append(node)
        return Handle(self, node)

    def _node(self, handle: Any, where: str) -> Node:
        if not isinstance(handle, Handle):
            raise GraphError(f"{where}: expected a handle of this graph, got {type(handle).__name__}; use g.leaf for values")
        if handle.__dict__["_graph"] is not self:
            raise GraphError(f"{where}: {handle!r} belongs to another graph")
        return cast(Node, handle.__dict__["_node"])

    def _input(self, value: Any, where: str) -> Node:
        """Node of an argument; a tuple of handles becomes a gather node."""
        if not (isinstance(value, (tuple, list)) and value and all(isinstance(item, Handle) for item in value)):
            return self._node(value, where)
        inputs = self._parts(value, where)
        return cast(Node, self._new("gather", where, inputs, self._join(inputs, where)).__dict__["_node"])

    def _parts(self, values: Sequence[Any], where: str) -> tuple[tuple[str, int], ...]:
        """Nodes of the elements of a tuple, under names that keep their order."""
        parts = [self._node(item, where) for item in values]
        return tuple((f"{i:03d}_{part.name}", part.id) for i, part in enumerate(parts))

    def _join(self, inputs: Sequence[tuple[str, int]], where: str) -> tuple[int, ...]:
        """Longest axes of the inputs; GraphError when another input is not on a prefix of them."""
        longest = max((self.nodes[source].axes for _, source in inputs), key=len, default=())
        for name, source in inputs:
            axes = self.nodes[source].axes
            if longest[: len(axes)] != axes:
                spread = " / ".join(self.nodes[axis].name for axis in axes)
                other = " / ".join(self.nodes[axis].name for axis in longest)
                raise GraphError(f"{where}: input {name!r} is spread over [{spread}], which is not part of [{other}], over "
                                 "which the stage runs; use g.collect on it, or derive both from the same g.each")
        return longest


class Named:
    """Graph that adds the next stage under a given name."""

    def __init__(self, graph: Graph, name: str) -> None:
        self._graph, self._name = graph, name

    def add(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> T:
        """Add a stage as `Graph.add` does."""
        return self._graph._add(self._name, fn, args, kwargs)


def _bind(fn: Callable[..., Any], args: tuple[Any, ...], kwargs: dict[str, Any], name: str) -> tuple[dict[str, Any], bool]:
    """Arguments by name, without `ctx`, and a flag for functions that take `ctx`."""
    signature = inspect.signature(fn)
    wants_ctx = "ctx" in signature.parameters
    try:
        bound = signature.bind(*args, **kwargs, **({"ctx": None} if wants_ctx and "ctx" not in kwargs else {}))
    except TypeError as error:
        raise GraphError(f"{name}: {error}; expected run{signature}") from error
    arguments = dict(bound.arguments)
    arguments.pop("ctx", None)
    return arguments, wants_ctx


def _same(a: Node, b: Node) -> bool:
    """Compare two nodes by what they compute, ignoring names unless they have no inputs.

    An `each` node equals no other, since its axis identifies it.
    """
    if a.sort != b.sort or a.sort == "each" or (not a.inputs and a.name != b.name):
        return False
    return (a.inputs, a.value, a.params, a.partial) == (b.inputs, b.value, b.params, b.partial)


def _is_frozen(params: Any) -> bool:
    declared = getattr(type(params), "__dataclass_params__", None)
    return declared is not None and bool(declared.frozen)


@dataclass(frozen=True)
class Published:
    """Value with a published place, see `Graph.publish`."""

    node: int
    place: str
    """path with {source} and {clip} in it"""
    name: str
    """name in the summary of a run"""
    part: str = ""
    """target among several combined ones"""


@dataclass(frozen=True)
class Measured:
    """Value with figures, see `Graph.measure`."""

    node: int
    file: str
    under: str
    part: str = ""


@dataclass(frozen=True)
class Cost:
    """Cost figure of stages, see `Graph.cost`."""

    name: str
    stages: tuple[str, ...]
    measured: int
    per: str
    """figure of the measured value"""
    shards: str | None
    """stage whose shards count; None: all shards"""
    scale: float
    each: bool
    rate: bool
    part: str = ""
