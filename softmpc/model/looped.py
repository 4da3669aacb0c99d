"""Jacobians of long chains: small functions called segment by segment, and matrix products.

The recursion of `derivatives` written out for a whole chain is a graph whose size grows with the
square of the number of segments: slow to build, too large to compile. Here segments with the same
parameters share two functions: one that passes the motion on to the next segment, one that passes
forces and sums back and returns the segment's own blocks. The blocks between two segments are
products of two small matrices, motion of the near one and forces of the far one
(`derivatives.motion_stacks`), so those of all pairs are a few dense products.

Entries that are absent in all segments are not passed, not multiplied and not in the result.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, is_dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from softmpc.model.chain import Base, Chain, Link, Segment, State
from softmpc.model.columns import Composite, Frame, gather
from softmpc.model.derivatives import (
    Blocks,
    force_stacks,
    hand_back,
    held_forces,
    motion_stacks,
    own_blocks,
    stumpff_functions,
    tip_load,
)

__all__ = ["differentiate_in_loops"]

SX = Any
MX = Any
# Products that a block above the diagonal is made of, and one below it.
PRODUCTS = {
    "by_q": ("above by_q", "below by_q"),
    "by_dq": ("above by_dq", "below by_dq"),
    "by_ddq": ("mass", "mass"),
    "coriolis": ("above coriolis", "below coriolis"),
}


def differentiate_in_loops(
    chain: Chain, state: State, pressures: list[MX | None], wanted: tuple[str, ...], elastic: bool
) -> list[MX]:
    """What `derivatives.differentiate` returns, only the `wanted` blocks, of MX symbols."""
    return _Loop(chain, state, pressures[0] is not None, wanted, elastic)(state, pressures)


@dataclass
class _Back:
    """The pass back over a segment as expressions, before they become a function."""

    inputs: list[SX]
    passed: SX
    own: list[SX]
    near: dict[str, SX]
    far: dict[str, SX]


class _Loop:
    """The small functions of one chain, and the calls of them."""

    def __init__(
        self, chain: Chain, state: State, driven: bool, wanted: tuple[str, ...], elastic: bool
    ) -> None:
        self.chain, self.wanted, self.elastic = chain, wanted, elastic
        self.driven = driven and "by_q" in wanted
        self.highest = stumpff_functions(state, "by_q" in wanted)
        self.width = len(chain.scene.strains)
        self.present = [not x.is_zero() for x in state.columns]
        self.kinds: list[Segment] = []
        self.kind_of = [self._kind(segment) for segment in chain.segments]
        self._functions()

    def _kind(self, segment: Segment) -> int:
        """Number of the segment's kind: those that differ in place alone are of one kind."""
        states = {kind: j for j, kind in enumerate(segment.kinds)}
        kind = replace(segment, index=0, section_index=0, states=states)
        if kind not in self.kinds:
            self.kinds.append(kind)
        return self.kinds.index(kind)

    # --- small functions ------------------------------------------------------------------------

    def _functions(self) -> None:
        self.x, local = self._symbols()
        self.base = _Passed(replace(self.chain.base(), head=ca.SX(0)))
        self.base.settle(lambda b: [_onward(self._link(k, local, b)) for k in self.kinds])
        base, at = self.base.symbols("base")
        links = [self._link(kind, local, at) for kind in self.kinds]
        ends = [self.base.column(_onward(link)) for link in links]
        names = [f"segment_{i}" for i in range(len(links))]
        self.onward = [
            _function(name, [base, self.x], [end]) for name, end in zip(names, ends, strict=True)
        ]
        self.beyond = _Passed(_beyond(at))
        self.beyond.settle(lambda b: [_back(link, *b) for link in links])
        self.tip = _function("tip", [base], [self.beyond.column(_beyond(at))])
        backs = [self._pass_back(base, link) for link in links]
        products = {name for block in self.wanted for name in PRODUCTS[block]}
        self.products = {name: _Product.of(name, backs) for name in sorted(products)}
        self.own = [_pattern([b.own[i] for b in backs]) for i in range(len(self.wanted))]
        self.back = [
            _function(f"{name}_back", b.inputs, self._outputs(b))
            for name, b in zip(names, backs, strict=True)
        ]

    def _symbols(self) -> tuple[SX, State]:
        """Strains (and rates) of a segment, those that are not zero, as one column."""
        width, columns = self.width, []
        x = ca.SX.sym("x", width * sum(self.present))
        parts = iter(ca.vertsplit(x, width))
        for present in self.present:
            columns.append(next(parts) if present else ca.SX.zeros(width))
        return x, State(*columns)

    def _link(self, kind: Segment, local: State, base: Base) -> Link:
        return self.chain.link(kind, local, base, self.highest)

    def _pass_back(self, base: SX, link: Link) -> _Back:
        segment = link.segment
        column, (force, moment, beyond) = self.beyond.symbols("beyond")
        p = ca.SX.sym("p", segment.section.units) if self.driven else ca.SX(0, 1)
        held = 0.0
        if "by_q" in self.wanted:
            wrench = (link.tip.rotation @ force, link.tip.rotation @ moment)
            own = p if self.driven else None
            held = held_forces(self.chain, link, wrench, own, self.elastic)
        blocks, frame = Blocks.zero(self.width), Frame(link.rotation, link.place)
        screw, columns = own_blocks(blocks, held, link, frame, beyond, self.chain.base().gravity)
        near, far = motion_stacks(screw), force_stacks(columns)
        return _Back(
            [base, column, self.x, p],
            self.beyond.column(_back(link, force, moment, beyond)),
            [getattr(blocks, name) for name in self.wanted],
            {name: ca.vertcat(*near[name]) for name in near},
            {name: ca.vertcat(*far[name]) for name in far},
        )

    def _outputs(self, back: _Back) -> list[SX]:
        outputs = [back.passed, *back.own]
        for name, product in self.products.items():
            outputs += [back.near[name][product.rows, :], back.far[name][product.rows, :]]
        return [ca.densify(x) for x in outputs]

    # --- the chain ------------------------------------------------------------------------------

    def __call__(self, state: State, pressures: list[MX | None]) -> list[MX]:
        split = [ca.vertsplit(x, self.width) for x in state.columns if not x.is_zero()]
        strains = [ca.vertcat(*parts) for parts in zip(*split, strict=True)]
        bases = [ca.MX(ca.evalf(self.base.column(replace(self.chain.base(), head=ca.SX(0)))))]
        for kind, x in zip(self.kind_of, strains, strict=True):
            bases.append(self.onward[kind](bases[-1], x))
        beyond, outputs = self.tip(bases[-1]), []
        for i in reversed(range(len(strains))):
            own = pressures[self.chain.segments[i].section_index]
            p = own if self.driven and own is not None else ca.MX(0, 1)
            beyond, *rest = self.back[self.kind_of[i]](bases[i], beyond, strains[i], p)
            outputs.append(rest)
        columns = list(zip(*reversed(outputs), strict=True))
        own, stacks = columns[: len(self.wanted)], iter(columns[len(self.wanted) :])
        products = {}
        for name in self.products:
            near, far = ca.horzcat(*next(stacks)), ca.horzcat(*next(stacks))
            products[name] = near.T @ far
        return [self._block(i, own[i], products) for i in range(len(self.wanted))]

    def _block(self, i: int, own: tuple[MX, ...], products: dict[str, MX]) -> MX:
        """One of the wanted matrices: its entries lie in the products and in the own blocks."""
        k, n = self.width, self.chain.size
        above, below = PRODUCTS[self.wanted[i]]
        row, column = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
        a, b, near, far = row % k, column % k, row // k, column // k
        place = np.full((n, n), -1)
        for where, pattern, index in (
            (near < far, self.products[above].pattern, row + column * n),
            (near > far, self.products[below].pattern.T, n * n + column + row * n),
            (near == far, self.own[i], 2 * n * n + near * k * k + a + b * k),
        ):
            present = where & pattern[a, b]
            place[present] = index[present]
        found = place.T[place.T >= 0]
        used, found = _compact([n * n, n * n, k * n], found)
        sources = [products[above], products[below], ca.horzcat(*own)]
        source = ca.vertcat(*(ca.vec(sources[j]) for j in used))
        present = np.argwhere(place.T >= 0)
        sparsity = ca.Sparsity.triplet(n, n, present[:, 1].tolist(), present[:, 0].tolist())
        return ca.MX(sparsity, source[found.tolist()]) if len(found) else ca.MX(n, n)


def _compact(sizes: list[int], index: np.ndarray) -> tuple[list[int], np.ndarray]:
    """Which of several columns are used, and the index into those alone."""
    ends = np.cumsum(sizes)
    which = np.searchsorted(ends, index, side="right")
    used = np.unique(which)
    skipped = np.zeros(len(sizes), int)
    for j, size in enumerate(sizes):
        if j not in used:
            skipped[j + 1 :] += size
    return used.tolist(), index - skipped[which]


def _function(name: str, inputs: list[SX], outputs: list[SX]) -> ca.Function:
    return ca.Function(name, inputs, outputs, {"cse": True})


def _onward(link: Link) -> Base:
    return replace(link.onward(), head=ca.SX(0))  # only energies need it


def _beyond(end: Base) -> tuple[SX, SX, Composite]:
    """Wrench and sums beyond the last segment, whose tip is `end`."""
    force, moment = (end.rotation @ x for x in (end.load_force, end.load_moment))
    return -end.load_force, -end.load_moment, tip_load(force, moment, end.place)


def _back(link: Link, force: SX, moment: SX, beyond: Composite) -> tuple[SX, SX, Composite]:
    """The same before a segment, from those at its tip."""
    force, moment = hand_back(link, link.tip.rotation @ force, link.tip.rotation @ moment)
    beyond = replace(beyond)
    gather(beyond, link, Frame(link.rotation, link.place))
    return force, moment, beyond


class _Passed:
    """What passes from segment to segment, as one column of the entries that any segment has."""

    def __init__(self, example: Any) -> None:
        self.example = example
        self.patterns = [leaf.sparsity() for leaf in _leaves(example)]

    def settle(self, steps: Callable[[Any], list[Any]]) -> None:
        """Add the entries that the segments bring, until they bring no new ones."""
        before = None
        while before != self.patterns:
            before = self.patterns
            for thing in steps(self.symbols("any")[1]):
                leaves = zip(self.patterns, _leaves(thing), strict=True)
                self.patterns = [pattern.unite(leaf.sparsity()) for pattern, leaf in leaves]

    def symbols(self, name: str) -> tuple[ca.SX, Any]:
        """A column of symbols, and the thing made of it."""
        sizes = [pattern.nnz() for pattern in self.patterns]
        column = ca.SX.sym(name, sum(sizes))
        parts = ca.vertsplit(column, np.cumsum([0, *sizes]).tolist())
        leaves = (ca.SX(s, part) for s, part in zip(self.patterns, parts, strict=True))
        return column, _like(self.example, leaves)

    def column(self, thing: Any) -> SX:
        leaves = zip(_leaves(thing), self.patterns, strict=True)
        return ca.densify(ca.vertcat(*(ca.vec(ca.project(leaf, s).nz[:]) for leaf, s in leaves)))


def _leaves(thing: Any) -> list[SX]:
    """The matrices in nested dataclasses and lists, in order."""
    if is_dataclass(thing):
        thing = [getattr(thing, item.name) for item in fields(thing)]
    if isinstance(thing, list | tuple):
        return [leaf for item in thing for leaf in _leaves(item)]
    return [ca.sparsify(ca.SX(thing))]


def _like(example: Any, leaves: Iterator[SX]) -> Any:
    """The same nest with other matrices."""
    if is_dataclass(example):
        kind: Any = type(example)
        return kind(*(_like(getattr(example, item.name), leaves) for item in fields(example)))
    if isinstance(example, list | tuple):
        return [_like(item, leaves) for item in example]
    return next(leaves)


@dataclass(frozen=True)
class _Product:
    """The rows of two stacks that are not zero, and the entries of their product (k×k)."""

    rows: list[int]
    pattern: np.ndarray

    @classmethod
    def of(cls, name: str, backs: list[_Back]) -> _Product:
        near, far = (_pattern([getattr(b, s)[name] for b in backs]) for s in ("near", "far"))
        rows = np.flatnonzero(near.any(axis=1) & far.any(axis=1))
        return cls(rows.tolist(), (near[rows].T.astype(int) @ far[rows]) > 0)


def _pattern(matrices: list[SX]) -> np.ndarray:
    """Where any of some matrices of one shape has an entry."""
    found = np.zeros(matrices[0].shape, bool)
    for matrix in matrices:
        found |= np.asarray(ca.DM(ca.sparsify(matrix).sparsity(), 1.0)) != 0
    return found
