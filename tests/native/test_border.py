"""No argument crashes Python: every function of every module refuses what it cannot take.

The functions and their arguments are read from the modules, so that new ones are tried, too.
"""

import re
from contextlib import suppress
from types import ModuleType

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from nightly import examples

from rastercov import engine

pytestmark = pytest.mark.native
FUNCTIONS = sorted(
    (name, function)
    for name, topic in engine.TOPICS.items()
    for function, var in vars(topic).items()
    if callable(var) and not isinstance(var, ModuleType)
)
"""Functions and classes; the methods of a class are tried in the tests of what it does."""
ARRAY = re.compile(
    r"dtype=(\w+), (?:shape=\(([^)]*)\), )?order='C', device='cpu'(, writable=False)?"
)
OTHERS = (None, "text", 3, [1.0], (), np.zeros(3, complex), np.zeros((2, 2, 2, 2)))
VALUES = {
    "f": (0.0, -0.0, 1.0, -2.5, 1e-300, 1e300, np.inf, -np.inf, np.nan),
    "i": (0, 1, 2, 3, -1, 7, 10**6, -(2**31), 2**31 - 1),
    "u": (0, 1, 2, 3, 7, 255),
    "b": (0, 1),
}


def split(text):
    """Parts between the commas that no bracket holds."""
    depth, parts = 0, [""]
    for letter in text:
        depth += (letter in "[(") - (letter in "])")
        parts = [*parts, ""] if letter == "," and not depth else [*parts[:-1], parts[-1] + letter]
    return [part.strip() for part in parts if part.strip()]


def signatures(function):
    """Arguments of each overload: text of their types."""
    called = function.__init__ if isinstance(function, type) else function
    for signature in called.__nb_signature__:
        arguments = split(signature[0].split("(", 1)[1].rsplit(") ->", 1)[0])
        yield [part.split(":", 1)[1].strip() for part in arguments if part != "self"]


@st.composite
def scalars(draw, kind):
    if kind == "bool":
        return draw(st.booleans())
    return (
        float(draw(st.sampled_from(VALUES["f"]))) if kind == "float" else draw(st.integers(-9, 9))
    )


@st.composite
def arrays(draw, dtype, shape, rows):
    """Array of a type and shape, with rows of one or two lengths; the values are hostile."""
    lengths = [int(n) if n.isdigit() else draw(st.sampled_from(rows)) for n in shape]
    kind = np.dtype(dtype).kind
    few = VALUES[kind] if draw(st.booleans()) else VALUES[kind][:4]
    seed = draw(st.integers(0, 2**32 - 1))
    with np.errstate(over="ignore"):
        few = np.array(few).astype(dtype)
    return few[np.random.default_rng(seed).integers(0, len(few), lengths)]


@st.composite
def spoilt(draw, array):
    """The array, or one that its place cannot take."""
    ways = (
        lambda: np.zeros(array.shape, np.int16),
        lambda: array.astype(array.dtype.newbyteorder()),
        lambda: np.stack((array, array), axis=-1)[..., 0],
        lambda: array[..., None],
        lambda: np.frombuffer(b"\0" + array.tobytes(), np.uint8)[1:].view(array.dtype),
        lambda: read_only(array),
        lambda: draw(st.sampled_from(OTHERS)),
    )
    return draw(st.sampled_from(ways))()


def read_only(array):
    array.flags.writeable = False
    return array


@st.composite
def calls(draw, wanted, share_of_wrong):
    rows = draw(st.sampled_from(((0,), (1,), (4,), (8,), (2, 4), (3, 8), (0, 5))))
    out = []
    for kind in wanted:
        result = ARRAY.search(kind)
        if kind.startswith("tuple["):
            out.append(tuple(draw(calls(split(kind[6:-1]), share_of_wrong))))
        elif result:
            shape = [n.strip().replace("*", "") for n in (result[2] or "").split(",") if n.strip()]
            array = draw(arrays(result[1], shape, rows))
            is_wrong = draw(st.floats(0, 1)) < share_of_wrong
            out.append(draw(spoilt(array)) if is_wrong else array)
        else:
            out.append(draw(scalars(kind)))
    same = [i for i, array in enumerate(out) if isinstance(array, np.ndarray)]
    if len(same) > 1 and draw(st.floats(0, 1)) < share_of_wrong:
        out[same[-1]] = out[draw(st.sampled_from(same))]
    return out


@pytest.mark.parametrize(("topic", "name"), FUNCTIONS)
@examples(10, at_night=60)
@given(data=st.data(), share_of_wrong=st.sampled_from((0.0, 0.1, 0.5)))
def test_no_argument_crashes(topic, name, data, share_of_wrong):
    function = getattr(engine.TOPICS[topic], name)
    wanted = data.draw(st.sampled_from(list(signatures(function))))
    arguments = data.draw(calls(wanted, share_of_wrong))
    with suppress(TypeError, ValueError):
        function(*arguments)


def tree_arguments(**changed):
    named = {
        "points": np.zeros((1, 3)),
        "corners": np.zeros((1, 3, 3)),
        "nodes": np.zeros((4, 6)),
        "squared": np.zeros(1),
        "triangle": np.zeros(1, np.int64),
        "where": np.zeros((1, 3)),
    }
    return named | changed


@pytest.mark.parametrize(
    "changed",
    [
        {"points": np.zeros((1, 3), np.float32)},
        {"points": np.zeros((1, 4))},
        {"points": np.zeros(3)},
        {"points": np.zeros((2, 6))[:, ::2]},
        {"points": np.zeros((3, 2)).T[:1]},
        {"points": np.zeros((1, 3), ">f8")},
        {"points": np.frombuffer(bytes(25), np.uint8)[1:].view(np.float64).reshape(1, 3)},
        {"points": [[0.0, 0.0, 0.0]]},
        {"triangle": np.zeros(1, np.int32)},
        {"squared": read_only(np.zeros(1))},
    ],
    ids=str,
)
def test_what_an_argument_is_not_is_a_type_error(changed):
    with pytest.raises(TypeError, match="incompatible function arguments"):
        engine.mesh_tree.nearest(**tree_arguments(**changed))


def test_outputs_share_memory_with_nothing():
    memory = np.zeros(12)
    points, where = memory[:3].reshape(1, 3), memory[2:5].reshape(1, 3)
    with pytest.raises(ValueError, match="shares memory"):
        engine.mesh_tree.nearest(**tree_arguments(points=points, where=where))
    engine.mesh_tree.nearest(**tree_arguments(points=points, where=memory[3:6].reshape(1, 3)))


def test_indices_outside_and_lengths_that_differ_are_value_errors():
    points, keys = np.zeros((3, 3)), np.zeros(1, np.uint64)
    for outside in (3, -1, 2**40, -(2**63)):
        with pytest.raises(ValueError, match="faces must hold rows of points"):
            engine.mesh_tree.order_keys(points, np.array([[0, 1, outside]]), keys)
    with pytest.raises(ValueError, match="one row for each face"):
        engine.mesh_tree.order_keys(points, np.zeros((2, 3), np.int64), keys)
