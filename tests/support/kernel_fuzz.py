"""Calls of the compiled kernel with arguments of every kind: right, wrong, and strange.

A call returns, or raises one of ``REFUSED``. All else is a fault: another exception, a crash, and,
where the kernel is built with sanitizers, what they find. To add a class of the kernel, add how it
is made to ``CONSTRUCTORS`` and how it is called to ``METHODS``.
"""

from __future__ import annotations

import argparse
import sys
import warnings
from collections import Counter
from collections.abc import Callable, Mapping
from functools import cache
from threading import Thread
from types import SimpleNamespace
from typing import Any

import numpy as np

from annik_core.kernel import compiled_kernel

#: What a call may raise. RuntimeError: an attribute that pybind11 can't convert.
REFUSED = (AttributeError, OverflowError, RuntimeError, TypeError, ValueError)
MAX_JOINTS = 32
#: Of each class that many objects are alive; a new one takes the place of another.
ALIVE = 8
#: Calls on the objects that are alive before another object is made.
CALLS_FOR_EACH_OBJECT = 20
NUMBERS = (0.0, -0.0, 1.0, np.pi, np.nan, np.inf, -np.inf, 1e308, -1e308, 1e-308, 5e-324, 1e16)
NO_ARRAYS = (
    None,
    "seven",
    b"7",
    7,
    -1.5,
    object(),
    [],
    [[]],
    [object()],
    {"a": 1},
    [10**400],
    True,
)
TYPES = (">f8", "f4", "f2", "i8", ">i4", "i1", "u8", "c16", "O", "?", "U8", "M8[s]", "f8,i4")


@cache
def search_of(dof: int) -> Any:
    """A search of a made-up robot."""
    kernel, rng, middle = compiled_kernel(), np.random.default_rng(dof), np.zeros(dof)
    placements = np.tile(np.eye(4), (dof + 1, 1, 1))
    placements[:, :3, 3] = rng.normal(size=(dof + 1, 3))
    axes = np.eye(6)[rng.choice([2, 3, 4, 5], dof)]
    chain = kernel.Chain(placements, axes, None, placements, (), middle)
    return kernel.Search(kernel.Refinement(chain, middle - 2.0, middle + 4.0, 5, 5e-7), 20, 1.0)


class Draw:
    """Arguments for an object of ``dof`` joints, some of them spoiled."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng

    def chance(self, probability: float) -> bool:
        return bool(self.rng.random() < probability)

    def one_of(self, values: Any) -> Any:
        return values[int(self.rng.integers(len(values)))]

    def array(self, *shape: int, scale: float = 1.0) -> Any:
        """Numbers of a shape, now and then extreme, of another layout, or of another kind."""
        numbers = scale * self.rng.normal(size=shape)
        if self.chance(0.1) and numbers.size:
            numbers.flat[int(self.rng.integers(numbers.size))] = self.one_of(NUMBERS)
        elif self.chance(0.02):
            numbers[...] = self.one_of(NUMBERS)
        return self.spoiled(numbers) if self.chance(0.1) else numbers

    def spoiled(self, numbers: np.ndarray) -> Any:
        rows = np.atleast_1d(numbers)
        ways: tuple[Callable[[], Any], ...] = (
            # The same numbers in another layout.
            lambda: numbers.T.copy().T,
            lambda: rows[::-1],
            lambda: np.repeat(rows, 2, axis=-1)[..., ::2],
            lambda: np.broadcast_to(rows[:1], rows.shape),
            lambda: np.frombuffer(b"x" + rows.tobytes(), np.uint8)[1:].view("f8"),  # not aligned
            lambda: rows.tolist(),
            # Another type, read-only.
            lambda: self.typed(numbers),
            # Another shape.
            lambda: np.zeros(self.rng.integers(0, 4, int(self.rng.integers(0, 5)))),
            lambda: numbers[np.newaxis],
            lambda: rows[:-1],
            lambda: np.concatenate([rows, rows]),
            lambda: np.empty((0, *rows.shape[1:])),
            lambda: np.empty((*rows.shape[:-1], 0)),
            lambda: np.float64(2.0),
            # No array.
            lambda: self.one_of(NO_ARRAYS),
        )
        return self.one_of(ways)()

    def typed(self, numbers: np.ndarray) -> Any:
        with np.errstate(all="ignore"):
            wanted = self.one_of(TYPES)
            try:
                other = numbers.astype(wanted)
            except (TypeError, ValueError):
                other = np.zeros(numbers.shape, wanted)
        other.setflags(write=False)
        return other

    def number(self, *usual: Any) -> Any:
        """One of the usual numbers, now and then one of any kind."""
        strange = (*NUMBERS, *NO_ARRAYS, -1, 0, 2**31 - 1, -(2**31), 2**31, 2**64)
        return self.one_of(strange if self.chance(0.05) else usual)

    def pose(self) -> Any:
        return self.poses(1)[0] if self.chance(0.9) else self.array(7)

    def poses(self, rows: int) -> np.ndarray:
        poses = self.rng.normal(size=(rows, 7))
        poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
        return poses

    def joints(self, dof: int) -> Any:
        return self.array(dof, scale=10.0 ** int(self.rng.integers(-3, 4)))

    def starts(self, dof: int) -> Any:
        return self.array(self.one_of((0, 0, 1, 3)), dof)

    def placements(self, dof: int) -> Any:
        if self.chance(0.2):
            return self.array(dof + 1, 4, 4, scale=10.0 ** int(self.rng.integers(-2, 155)))
        placements = np.tile(np.eye(4), (dof + 1, 1, 1))
        placements[:, :3, 3] = self.rng.normal(size=(dof + 1, 3))
        return placements

    def axes(self, dof: int) -> Any:
        axes = np.zeros((dof, 6))
        for axis in axes:
            direction = self.rng.normal(size=3)
            part = slice(0, 3) if self.chance(0.2) else slice(3, 6)
            axis[part] = direction / np.linalg.norm(direction)
        return axes if self.chance(0.9) else self.array(dof, 6)

    def corrections(self, dof: int) -> Any:
        if self.chance(0.2):
            return None if self.chance(0.9) else self.one_of(NO_ARRAYS)
        hidden = int(self.rng.integers(0, 8))
        scaling = {"centre": (dof,), "half_width": (dof,)}
        parts = {
            "joint_harmonics": {
                "frequencies": (dof,),
                "sines": (dof, hidden),
                "cosines": (dof, hidden),
            },
            "joint_networks": {
                **scaling,
                "input_weights": (dof, hidden),
                "biases": (dof, hidden),
                "output_weights": (dof, hidden),
            },
            "pose_network": {
                **scaling,
                "input_weights": (hidden, dof),
                "biases": (hidden,),
                "output_weights": (6, hidden),
            },
            "deflection": {"compliances": (dof, dof), "gravity": (3,)},
            "pose_harmonics": {
                "waves": (hidden, dof),
                "cosines": (6, hidden),
                "sines": (6, hidden),
            },
        }
        return SimpleNamespace(**{name: self.part(shapes) for name, shapes in parts.items()})

    def part(self, shapes: Mapping[str, tuple[int, ...]]) -> Any:
        if self.chance(0.5):
            return None
        if self.chance(0.02):
            return self.one_of(NO_ARRAYS)
        arrays = {name: self.array(*shape) for name, shape in shapes.items()}
        if self.chance(0.02):
            del arrays[self.one_of(tuple(arrays))]
        return SimpleNamespace(**arrays)

    def layers(self, dof: int) -> Any:
        """Layers from 13 numbers to those of the joints, now and then such as do not fit."""
        first = self.one_of((1,) * 10 + (0, -1))
        return [
            (0, None, self.array(4, 13), self.array(4), self.chance(0.5)),
            (first, self.one_of((None, None, 1, 1, 1, 3)), self.array(4, 4), self.array(4), True),
            (self.number(2), None, self.array(dof, 4), self.array(dof), self.number(False)),
        ]

    def network_of(self, dof: int) -> Any:
        if self.chance(0.05):
            return self.one_of(NO_ARRAYS)
        weights = self.rng.normal(size=(dof, 13))
        return compiled_kernel().Network(13, [(0, None, weights, np.zeros(dof), True)])

    def search_of(self, dof: int) -> Any:
        return search_of(dof) if self.chance(0.95) else self.one_of(NO_ARRAYS)

    def wrapped(self, dof: int) -> Any:
        count = int(self.rng.integers(0, 3))
        known = tuple(self.rng.integers(0, dof, count).tolist())
        return known if self.chance(0.9) else self.one_of(((dof,), (-1,), (2**70,), None, ("a",)))

    def box(self, dof: int) -> tuple[Any, Any]:
        """Lower and upper bounds, with locked and unbounded joints."""
        lower = self.rng.normal(size=dof)
        upper = lower + self.rng.choice([0.0, 1e-9, 1.0, 3.0, np.inf], dof)
        return (lower, upper) if self.chance(0.9) else (self.array(dof), self.array(dof))


#: How an object of ``dof`` joints is made; ``alive`` gives one of another class.
CONSTRUCTORS: Mapping[str, Callable[[Draw, int, Callable[[str], Any]], tuple[Any, ...]]] = {
    "Chain": lambda draw, dof, _: (
        draw.placements(dof),
        draw.axes(dof),
        draw.corrections(dof),
        draw.placements(dof),
        draw.wrapped(dof),
        draw.array(dof),
    ),
    "Refinement": lambda draw, dof, alive: (
        alive("Chain"),
        *draw.box(dof),
        draw.number(0, 1, 10),
        draw.number(0.0, 5e-7, 1e-12, 1e-3),
    ),
    "ErrorBound": lambda draw, dof, _: (
        draw.array(dof),
        draw.array(dof),
        draw.array(2, 1 + dof + dof * (dof + 1) // 2),
    ),
    "Network": lambda draw, dof, _: (draw.number(13), draw.layers(dof)),
    "BoundSolve": lambda draw, dof, alive: (
        alive("Refinement"),
        draw.array(13),
        draw.joints(dof),
        draw.array(3),
        draw.number(1.0, 3.0, np.inf),
        *draw.box(dof),
        draw.number(1e-3, 1.0, np.inf),
        draw.number(1e-3, 1.0, np.inf),
        draw.number(1e-3, 0.1),
    ),
    "BoundGantry": lambda draw, dof, alive: (
        *(draw.array(6) for _ in range(4)),
        *(draw.array(2, 6) for _ in range(2)),
        draw.number(1e-3, 1.0, np.inf),
        draw.number(1e-3, 1.0, np.inf),
        draw.number(1e-3, 0.1),
    ),
    "Search": lambda draw, _, alive: (
        alive("Refinement"),
        draw.number(0, 1, 20, 100),
        draw.number(0.5, 1.0),
    ),
}

#: How each method of each class is called; all equally often.
METHODS: Mapping[str, Mapping[str, Callable[[Draw, int], tuple[Any, ...]]]] = {
    "Chain": {
        "poses": lambda draw, dof: (draw.array(int(draw.rng.integers(0, 6)), dof),),
        "jacobians": lambda draw, dof: (draw.array(int(draw.rng.integers(0, 6)), dof),),
        "linearise": lambda draw, dof: (draw.joints(dof), draw.pose()),
        "residuals": lambda draw, dof: (draw.joints(dof), draw.pose()),
    },
    "Refinement": {
        "refine": lambda draw, dof: (draw.joints(dof), draw.pose()),
        # Of 20 rows some are another thread's.
        "refine_batch": lambda draw, dof: (
            draw.array(rows := draw.one_of((0, 1, 5, 20)), dof),
            draw.poses(rows) if draw.chance(0.9) else draw.array(rows, 7),
            draw.number(1, 2, 4),
        ),
    },
    "ErrorBound": {"at": lambda draw, dof: (draw.joints(dof),)},
    "Network": {"run": lambda draw, _: (draw.array(13),)},
    "BoundSolve": {
        "prepare": lambda draw, _: (draw.pose(),),
        "finish": lambda draw, _: (draw.pose(),),
        "solve": lambda draw, dof: (draw.network_of(dof), draw.pose()),
        "find": lambda draw, dof: (
            *(draw.search_of(dof), draw.network_of(dof), draw.chance(0.5)),
            *(draw.one_of((0, 1, 40, -1)), draw.pose()),
            draw.joints(dof) if draw.chance(0.5) else None,
        ),
        "find_all": lambda draw, dof: (
            *(draw.search_of(dof), draw.network_of(dof), draw.chance(0.5)),
            *(draw.one_of((0, 1, 40, None)), draw.number(0.0, 0.5), draw.pose()),
            draw.joints(dof),
        ),
    },
    "BoundGantry": {
        "prepare": lambda draw, _: (draw.pose(),),
        "finish": lambda draw, _: (draw.pose(),),
    },
    "Search": {
        "first": lambda draw, dof: (draw.pose(), draw.starts(dof), draw.one_of((0, 1, 40, -1))),
        "all": lambda draw, dof: (
            draw.pose(),
            draw.starts(dof),
            draw.one_of((0, 1, 40, None)),
            draw.number(0.0, 0.5),
        ),
        "follow": lambda draw, dof: (draw.joints(dof), draw.pose()),
        "same_branch": lambda draw, dof: (draw.joints(dof), draw.joints(dof)),
    },
}

ALL_METHODS = tuple((name, method) for name, methods in METHODS.items() for method in methods)


class Objects:
    """Objects of the kernel, with their joints, that threads share."""

    def __init__(self) -> None:
        self.of_class: dict[str, list[tuple[int, Any]]] = {name: [] for name in CONSTRUCTORS}


class Fuzz:
    """A sequence of calls, the same for the same seed as long as no other shares its objects.

    Attributes:
        returned: calls that returned, by class and method.
        refused: calls that raised one of ``REFUSED``.
    """

    def __init__(self, kernel: Any, seed: int, objects: Objects | None = None) -> None:
        self.kernel = kernel
        self.draw = Draw(np.random.default_rng(seed))
        self.objects = objects or Objects()
        self.returned: Counter[str] = Counter()
        self.refused: Counter[str] = Counter()

    def run(self, calls: int) -> None:
        """So many calls, constructors among them; a fault is what is raised."""
        with np.errstate(all="ignore"):
            while sum(self.returned.values()) + sum(self.refused.values()) < calls:
                dof = int(
                    self.draw.rng.integers(1, 9 if self.draw.chance(0.7) else MAX_JOINTS + 1)
                )
                for name in CONSTRUCTORS:
                    self._make(name, dof)
                for _ in range(CALLS_FOR_EACH_OBJECT):
                    self._call(*self.draw.one_of(ALL_METHODS))

    def _make(self, name: str, dof: int) -> None:
        made = getattr(self.kernel, name)

        def alive(other: str) -> Any:
            # The last one is mostly of so many joints.
            known = self.objects.of_class[other]
            return (
                known[-1][1] if known and self.draw.chance(0.95) else self.draw.one_of(NO_ARRAYS)
            )

        if self.draw.chance(0.05):
            new = made.__new__(made)  # its constructor is not called
        else:
            new = self._counted(f"{name}", made, CONSTRUCTORS[name](self.draw, dof, alive))
        if new is not None:
            known = self.objects.of_class[name]
            known.append((dof, new))
            if len(known) > ALIVE:
                # What it was made of, and what was made of it, may live on.
                del known[int(self.draw.rng.integers(ALIVE))]

    def _call(self, name: str, method: str) -> None:
        known = self.objects.of_class[name]
        if not known:
            return
        dof, made = self.draw.one_of(known)
        arguments = METHODS[name][method](self.draw, dof)
        self._counted(f"{name}.{method}", getattr(made, method), arguments)

    def _counted(self, name: str, call: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
        if self.draw.chance(0.005):
            arguments = arguments[:-1]
        try:
            result = call(*arguments)
        except REFUSED:
            self.refused[name] += 1
            return None
        self.returned[name] += 1
        return result


def fuzz(kernel: Any, calls: int, seed: int, threads: int) -> Fuzz:
    """Calls from several threads that share objects; the counts of all.

    Raises:
        Exception: the first fault of any thread.
    """
    objects = Objects()
    workers = [Fuzz(kernel, seed + number, objects) for number in range(threads)]
    faults: list[BaseException] = []

    def run(worker: Fuzz) -> None:
        try:
            worker.run(-(-calls // threads))
        except BaseException as error:
            faults.append(error)

    running = [Thread(target=run, args=(worker,)) for worker in workers]
    for thread in running:
        thread.start()
    for thread in running:
        thread.join()
    if faults:
        raise faults[0]
    for worker in workers[1:]:
        workers[0].returned += worker.returned
        workers[0].refused += worker.refused
    return workers[0]


def main() -> None:
    """Print the counts, a line for each method: name, returned, refused."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--calls", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=3)
    options = parser.parse_args()
    warnings.simplefilter("ignore", np.exceptions.ComplexWarning)
    kernel = compiled_kernel()
    if kernel is None:
        sys.exit("the kernel is not compiled")
    found = fuzz(kernel, options.calls, options.seed, options.threads)
    for name in sorted({*found.returned, *found.refused}):
        print(name, found.returned[name], found.refused[name])


if __name__ == "__main__":
    main()
