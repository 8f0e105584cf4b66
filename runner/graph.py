"""The graph: what is computed from what. Composition is typed, so that an edge is a checked call and not a string.

    g = Graph()
    clip   = g.each(g.add(source_read.run, files=g.leaf("video", tree), params=p))
    frames = g.add(frame_decode.run, media=tree, footage=clip, params=q)
    g.target("dataset", g.add(dataset_pack.run, frames=g.collect(frames), params=r))

Every call returns a handle that type checkers take for the value it will become. A node runs once per path: `each` opens an
axis, a node lives on the longest axes of its inputs, and every other input must lie on a prefix of them (it is broadcast).
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
    """The graph cannot be built as written; the message says which call and what to do."""


@dataclass(frozen=True)
class Node:
    """One line of the graph. `inputs` are (argument or part name, node id); `axes` the `each` nodes it is spread over."""

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
    """collect, gather: made of what is there, also when the rest is left for another run"""


class Handle:
    """Stands for a value that a run will make; it has none of the value's attributes."""

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
    """A recipe."""

    def __init__(self) -> None:
        self.nodes: list[Node] = []
        self.targets: dict[str, tuple[Any, ...]] = {}
        self.early: set[int] = set()
        self.published: list[Published] = []
        self.measured: list[Measured] = []
        self.costs: list[Cost] = []
        self._axes: dict[int, Handle] = {}
        self._variant: tuple[str, dict[str, str]] | None = None
        self._part = ""

    def leaf(self, name: str, value: T) -> T:
        """A value known now; a tuple is a list of them."""
        return cast(T, self._new("leaf", name, value=value))

    @property
    def ctx(self) -> Any:
        """What to pass as `ctx` of a stage that wants one, for type checkers; the runner supplies it, said or not."""
        return None

    def named(self, name: str) -> Named:
        """`g.named("b").add(...)` adds a stage under another name than its module's, to use one function twice."""
        return Named(self, name)

    @contextmanager
    def variant(self, label: str) -> Iterator[dict[str, str]]:
        """Lines that are written again with other parameters. Within it, what is there already with the same arguments is taken
        as it is, and a stage that differs is added as `<name>_<label>`. Gives name -> name in this graph, as it fills.
        """
        names: dict[str, str] = {}
        self._variant = label, names
        try:
            yield names
        finally:
            self._variant = None

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        """Lines of one of several targets that are made together: what they share is one node, as in a `variant`; their targets are
        called `<part>.<name>`, and what they publish and measure belongs to the part.
        """
        self._part = name
        try:
            with self.variant(name.replace("-", "_")):
                yield
        finally:
            self._part = ""

    def publish(self, value: T, place: str, as_: str) -> T:
        """Name where people find a value, and what the summary of a run calls it: `g.publish(packed, "datasets/{source}",
        as_="dataset")`. {source} is the name of what the run is made of, {clip} the shard: then every shard has a place of its own.
        A place with a suffix is that of a single file. The value is published by every run that makes it.
        """
        node = self._node(value, "g.publish")
        self.published.append(Published(node.id, place, as_, self._part))
        return value

    def measure(self, value: T, file: str = "metrics.json", under: str = "") -> T:
        """Name a file of a value with figures that a run shows, an object of numbers in JSON; `under` is set before each name."""
        self.measured.append(Measured(self._node(value, "g.measure").id, file, under, self._part))
        return value

    def cost(self, name: str, stages: Iterable[Any], per: tuple[Any, str], *, shards: Any = None, scale: float = 1.0,
             each: bool = False, rate: bool = False) -> None:  # fmt: skip
        """A figure of what stages cost: their CPU seconds for one of what they are counted in, `per` a measured value and a figure
        of it. `shards`: only in the shards in which this one is made; `scale`: of the unit; `each`: also of every stage as
        `<name>.<stage>`; `rate`: so many a CPU second instead, and none where nothing was spent.
        """
        spent = tuple(self._maker(stage) for stage in stages)
        self.costs.append(Cost(name, spent, self._node(per[0], "g.cost").id, per[1],
                               None if shards is None else self._maker(shards), scale, each, rate, self._part))

    def add(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> T:
        """One stage, named after its module. Inputs are handles, or tuples of handles; `params` a frozen dataclass; `ctx` is
        supplied by the runner. GraphError when the arguments do not fit.
        """
        return self._add(fn.__module__.rpartition(".")[2], fn, args, kwargs)

    def _add(self, name: str, fn: Callable[..., T], args: tuple[Any, ...], kwargs: dict[str, Any]) -> T:
        taken = any(node.sort == "stage" and node.name == name for node in self.nodes)
        if taken and not self._variant:
            raise GraphError(f"stage {name!r} is added twice; name the second one: g.named('{name}_again').add(...)")
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
        """One element of a list; whatever uses it runs once per element. The same list gives the same axis."""
        source = self._node(values, "g.each")
        if source.id not in self._axes:
            axes = (*source.axes, len(self.nodes))
            self._axes[source.id] = self._new("each", f"each {source.name}", (("", source.id),), axes)
        return cast(T, self._axes[source.id])

    def first(self, value: T) -> T:
        """What makes `value` goes before everything else: it is quick, and tells at once whether the rest is worth doing."""
        self.early.add(self._node(value, "g.first").id)
        return value

    def collect(self, value: T, partial: bool = False) -> tuple[T, ...]:
        """All elements over all axes again, in order; those that failed are left out and listed in the report. `partial`: so are
        those that a run with a limit has left for another one, even all of them; without, the list then is left too.
        """
        source = self._node(value, "g.collect")
        return cast("tuple[T, ...]", self._new("collect", f"collect {source.name}", (("", source.id),), partial=partial))

    def finished(self, name: str, values: Iterable[T]) -> tuple[T, ...]:
        """Of these handles those that could be made, in order; what failed or was left for another run is left out."""
        parts = tuple(values)
        inputs = self._parts(parts, name) if parts else ()
        return cast("tuple[T, ...]", self._new("gather", name, inputs, self._join(inputs, name), partial=True))

    def pick(self, value: T, field: Callable[[T], U]) -> U:
        """One field of an output that the codec splits into its fields (a bundle): `g.pick(h, lambda v: v.files)`."""
        source = self._node(value, "g.pick")
        seen = _Field()
        field(cast(T, seen))
        names = seen.__dict__["names"]
        if len(names) != 1:
            raise GraphError(f"g.pick on {source.name!r}: expected a function that reads one field, got {names or 'none'}")
        return cast(U, self._new("pick", f"{source.name}.{names[0]}", (("", source.id),), source.axes, value=names[0]))

    def target(self, name: str, *handles: Any) -> None:
        """Name what a run can be asked for."""
        name = f"{self._part}.{name}" if self._part else name
        if name in self.targets:
            raise GraphError(f"target {name!r} is declared twice")
        self.targets[name] = tuple(Handle(self, self._node(handle, f"g.target({name!r})")) for handle in handles)

    def node_of(self, handle: Any) -> Node:
        """The node behind a handle of this graph."""
        return self._node(handle, "node_of")

    def upstream(self, wanted: Iterable[Node]) -> list[Node]:
        """`wanted` and all they need, inputs first."""
        need, stack = set(), [node.id for node in wanted]
        while stack:
            at = stack.pop()
            if at not in need:
                need.add(at)
                stack += [source for _, source in self.nodes[at].inputs]
        return [self.nodes[i] for i in sorted(need)]

    def spare(self, wanted: Iterable[Node]) -> frozenset[int]:
        """Ids of what `wanted` can do without: all that is asked of it goes through something partial."""
        need, stack = set[int](), [node.id for node in wanted]
        while stack:
            node = self.nodes[stack.pop()]
            if node.id not in need:
                need.add(node.id)
                stack += () if node.partial else [source for _, source in node.inputs]
        return frozenset(node.id for node in self.upstream(wanted)) - need

    def stages(self) -> list[Node]:
        """Every stage, in the order written."""
        return [node for node in self.nodes if node.sort == "stage"]

    def _maker(self, value: Any) -> str:
        """The name of the stage that a value, or a field of it, comes from."""
        node = self._node(value, "g.cost")
        while node.sort == "pick":
            node = self.nodes[node.inputs[0][1]]
        return node.name

    def _new(self, sort: Sort, name: str, inputs: tuple[tuple[str, int], ...] = (), axes: tuple[int, ...] = (), *, own: str = "",
             **more: Any) -> Handle:
        """A node, called `own` where its name is taken; in a variant, the one that is there already with the same arguments."""
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
        """The node of an argument; a tuple of handles becomes a node that gathers them."""
        if not (isinstance(value, (tuple, list)) and value and all(isinstance(item, Handle) for item in value)):
            return self._node(value, where)
        inputs = self._parts(value, where)
        return cast(Node, self._new("gather", where, inputs, self._join(inputs, where)).__dict__["_node"])

    def _parts(self, values: Sequence[Any], where: str) -> tuple[tuple[str, int], ...]:
        """Nodes of the elements of a tuple, under names that keep their order."""
        parts = [self._node(item, where) for item in values]
        return tuple((f"{i:03d}_{part.name}", part.id) for i, part in enumerate(parts))

    def _join(self, inputs: Sequence[tuple[str, int]], where: str) -> tuple[int, ...]:
        """The longest axes of the inputs; GraphError when another input is not on a prefix of them."""
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
    """A graph that adds the next stage under a given name."""

    def __init__(self, graph: Graph, name: str) -> None:
        self._graph, self._name = graph, name

    def add(self, fn: Callable[P, T], /, *args: P.args, **kwargs: P.kwargs) -> T:
        """As `Graph.add`."""
        return self._graph._add(self._name, fn, args, kwargs)


def _bind(fn: Callable[..., Any], args: tuple[Any, ...], kwargs: dict[str, Any], name: str) -> tuple[dict[str, Any], bool]:
    """Arguments by name, without `ctx`, and whether the function wants one."""
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
    """Whether two nodes compute the same, whatever they are called; what has no inputs, also by its name. (An `each` is told by its
    axis.)
    """
    if a.sort != b.sort or a.sort == "each" or (not a.inputs and a.name != b.name):
        return False
    return (a.inputs, a.value, a.params, a.partial) == (b.inputs, b.value, b.params, b.partial)


def _is_frozen(params: Any) -> bool:
    declared = getattr(type(params), "__dataclass_params__", None)
    return declared is not None and bool(declared.frozen)


@dataclass(frozen=True)
class Published:
    """A value with a place of its own, see `Graph.publish`."""

    node: int
    place: str
    """path with {source} and {clip} in it"""
    name: str
    """in the summary of a run"""
    part: str = ""
    """which of several targets that are made together it belongs to"""


@dataclass(frozen=True)
class Measured:
    """A value with figures, see `Graph.measure`."""

    node: int
    file: str
    under: str
    part: str = ""


@dataclass(frozen=True)
class Cost:
    """What stages cost, see `Graph.cost`."""

    name: str
    stages: tuple[str, ...]
    measured: int
    per: str
    """figure of the measured value"""
    shards: str | None
    """stage whose shards count; None: all do"""
    scale: float
    each: bool
    rate: bool
    part: str = ""
