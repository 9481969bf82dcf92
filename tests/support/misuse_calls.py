"""Every public function with every argument, and values that none of them is meant for.

Used by `test_misuse`, which tries each value alone, and by `benchmarks/attack_misuse`, which spoils
several arguments at once. A call is named for what it calls, and for what is special after a comma.
"""

import ast
import inspect
import warnings
from dataclasses import dataclass, replace
from enum import Enum
from importlib import import_module
from typing import Any

import numpy as np

import rastercov as rc
from rastercov.base.typed import public_names

MODULES = {
    "rastercov": "misuse_package",
    "rastercov.mesh.shapes": "misuse_package",
    "rastercov.mesh.targets": "misuse_package",
    "rastercov.placement": "misuse_placement",
}
"""Documented modules, and the module here that has their calls."""


@dataclass(frozen=True)
class Call:
    """A function with arguments that it takes gladly, each of which may be exchanged.

    Attributes
    ----------
    name : str
        For people.
    function : callable
        What is called with `arguments` by their names.
    arguments : dict
    """

    name: str
    function: Any
    arguments: dict[str, Any]

    def spoiled(self, **values):
        """The same call with other values for some arguments."""
        return replace(self, arguments=self.arguments | values)

    def fault(self):
        """Fault of a call, empty if there is none.

        It must return, or raise one of our errors with one printable line, and warn of nothing.
        """
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                self.function(**self.arguments)
        except rc.RastercovError as error:
            text = str(error)
            if not text or not text.isprintable() or len(text) > 700:
                return f"no line for people: {text[:200]!r}"
            return "calls itself a defect" if "defect of rastercov" in text else ""
        except Exception as error:
            return f"{type(error).__name__}: {error}"[:200]
        return ""


def names_of_calls():
    """Names of all calls, in the order of `calls`, without making one."""
    names = []
    for module in dict.fromkeys(MODULES.values()):
        tree = ast.parse(inspect.getsource(import_module(module)))
        made = (node for node in ast.walk(tree) if isinstance(node, ast.Call))
        names += [
            node.args[0].value
            for node in made
            if isinstance(node.func, ast.Name) and node.func.id == "Call"
        ]
    return names


def calls():
    """Every public call with arguments that are right, by name."""
    found = [
        call for name in dict.fromkeys(MODULES.values()) for call in import_module(name).calls()
    ]
    return {call.name: call for call in found}


def public_callables():
    """Functions, constructors and methods of the documented modules, by their names.

    Not the errors, which are raised; nor the enumerations and protocols, which users do not make.
    """
    found = {}
    for name in MODULES:
        module = import_module(name)
        for thing in (getattr(module, name) for name in public_names(module)):
            if inspect.isfunction(thing):
                found[thing.__name__] = thing
            elif inspect.isclass(thing) and not issubclass(thing, Exception | Enum):
                found |= methods_of(thing)
                if not (getattr(thing, "_is_protocol", False) or inspect.isabstract(thing)):
                    found[thing.__name__] = thing
    return found


def methods_of(kind):
    """Public methods of a class that are our own, by their names."""
    names = set(dir(kind)) - set(getattr(kind, "__dataclass_fields__", ()))
    methods = {name: getattr(kind, name) for name in sorted(names) if not name.startswith("_")}
    return {
        f"{kind.__name__}.{name}": method
        for name, method in methods.items()
        # From Python 3.13 on, a cached property is a routine.
        if inspect.isroutine(method)
        and callable(method)
        and method.__module__.startswith("rastercov.")
    }


def parameters_of(function):
    """Parameters of a callable that a person gives."""
    found = inspect.signature(function).parameters.values()
    return [each for each in found if each.name != "self"]


SLOW = {
    ("optimise", "budget"),
    ("optimise", "population"),
    ("optimise", "cameras"),
    ("refine", "budget"),
    ("refine", "halvings"),
    ("on_sphere", "count"),
    ("on_hemisphere", "count"),
    ("on_box", "spacing"),
    ("on_walls", "spacing"),
    ("on_ceiling", "spacing"),
    ("select_greedy", "effort"),
    ("tolerance", "draws"),
}
"""Arguments that ask for work: a large number is an honest wish for much of it."""


def is_wish_for_much_work(name, argument, value):
    is_number = isinstance(value, int | float | np.integer | np.floating)
    if argument in ("progress", "aim") and callable(value):
        return True  # a function of the caller's own, which fails as it likes
    is_asked = (name, argument) in SLOW and is_number and not isinstance(value, bool)
    return bool(is_asked and (abs(value) > 1e3 or 0 < value < 1e-3))
