"""Lengths and parameters of functions in C++, as `make lint` counts them, in hostile sources."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

import rastercov

ROOT = Path(rastercov.__file__).parents[1]
COUNTER = ROOT / ".ci" / "functions.py"
pytestmark = pytest.mark.skipif(not COUNTER.is_file(), reason="a wheel has no counter")
LONG = "int f(int a) {{\n{}}}\n"
SOURCES = {
    "comments and texts": (
        "int f(/* a, b */ void) { // {\n\n  /* }\n */\n"
        '  return "}\\"{"[0] + \'{\' + R"x({{)" )x"[0];\n}\n',
        [("f", 3, 0)],
    ),
    "templates": (
        "template <class A, class B = std::map<int, int>>\n"
        "void f(std::map<A, B> a, B b = B{1, 2}, bool c = 1 < 2, bool d = 3 > 2) {\n}\n"
        "template <class T> requires (sizeof(T) > 4 && C<T>) void g(T a, T b) {}\n"
        "template <class T> concept D = requires(T t) { { t.a() } -> C; };\n",
        [("f", 3, 4), ("g", 1, 2)],
    ),
    "comparisons": ("void f(bool c = x < y, bool d = z > (2)) {}", [("f", 1, 2)]),
    "classes": (
        "struct A : B<int, decltype(f(1))> {\n"
        "  A(int a, int b) : x{a}, y(b), z{[](int q) { return q; }(1)} {\n  }\n"
        "  ~A() noexcept(true) {}\n  A &operator=(const A &) = default;\n  int x{3}, y = 2;\n"
        "  bool operator()(int a, int b) const { return a < b; }\n"
        "  operator int() const { return {}; }\n};\n"
        "A::A(int a)\ntry : x(a), Bases(a)... {\n} catch (...) {\n}\n",
        [
            *(("lambda", 1, 1), ("A", 2, 2), ("A", 1, 0)),
            *(("operator", 1, 2), ("operator", 1, 0), ("A", 3, 1)),
        ],
    ),
    "values": (
        "S table[] = {{1}, {2}};\nenum class E { A, B };\n"
        "std::function<int(int, int)> g{nullptr};\nauto h = [](int a) { return a; };\n"
        "int b{f(1)};\nstruct P { int x; } p{1};\nstruct S make(int a) { return S{a}; }\n",
        [("lambda", 1, 1), ("make", 1, 1)],
    ),
    "bodies of macros": (
        "#define F(x) void x(int a) {\nvoid f() {\n  unroll<3>(EACH(k) {\n    g(k);\n  });\n"
        "  if constexpr (A) { x(); } else if (b) { y(); }\n  for (int i = 0; i < 3; i++) { }\n"
        "  switch (a) { case 1: { break; } default: { } }\n  try { } catch (const E &e) { }\n"
        "  struct L { int m(int a, int b, int c) { return 0; } } l = {1};\n}\n",
        [("f", 10, 0), ("EACH", 3, 1), ("m", 1, 3)],
    ),
    "lambdas": (
        "void f() {\n  auto &[a, b] = pair;\n  a[i] = T{1};\n"
        "  run([&, a = b](auto x, int y) mutable noexcept"
        " -> std::pair<int, int> { return {1, 2}; });\n"
        "  [[maybe_unused]] const auto p = [=]<class T>(T a) { return a; };\n"
        "  return [] { return 1; }();\n}\n",
        [("f", 7, 0), ("lambda", 1, 2), ("lambda", 1, 1), ("lambda", 1, 0)],
    ),
    "branches of the preprocessor": (
        "#if A\nvoid f(int a) {\n#else\nvoid f(int a, int b) {\n#endif\n  g();\n}\n"
        "#if A\nint q() { return 1'000; }\n#else\nint q(int a) { return 2; }\n#endif\n",
        [("f", 5, 1), ("q", 1, 0), ("q", 1, 1)],
    ),
    "scopes and attributes": (
        'extern "C" {\n[[nodiscard]] int n(int a) { return 1; }\n}\nnamespace a::b {\n'
        "__attribute__((always_inline)) inline int w(int (*g)(int, int), std::array<int, 3> a) {}\n"
        "auto t(int a) -> decltype(g(a, 1)) { return 1; }\n}\nint c(int a) { return 1; }\n",
        [("n", 1, 1), ("w", 1, 2), ("t", 1, 1), ("c", 1, 1)],
    ),
    "60 lines": (LONG.format("  a++; // x\n\n" * 58), [("f", 60, 1)]),
    "61 lines": (LONG.format("  a++;\n" * 59), [("f", 61, 1)]),
}


def counter():
    spec = importlib.util.spec_from_file_location("functions", COUNTER)
    module = importlib.util.module_from_spec(spec)
    sys.modules["functions"] = module
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", SOURCES)
def test_functions_of_hostile_sources(name):
    source, expected = SOURCES[name]
    items = [(each.name, each.lines, each.parameters) for each in counter().functions_of(source)]
    assert sorted(items) == sorted(expected)


@pytest.mark.parametrize(
    ("source", "fault"),
    [
        (SOURCES["61 lines"][0], "a.cpp:1: f has 61 lines of 60"),
        (f"void f({', '.join(['int'] * 9)}) {{}}\n", "a.cpp:1: f has 9 parameters of 8"),
        ("void f() {\n    a = 1, b = 2;\n}\n", "a.cpp:2: expected one assignment a statement"),
        (SOURCES["60 lines"][0] + f"void g({', '.join(['int'] * 8)}) {{}}\n", ""),
    ],
)
def test_a_fault_has_its_line_and_ends_the_check(tmp_path, source, fault):
    (tmp_path / ".ci").mkdir()
    (tmp_path / ".ci" / "functions.py").write_text(COUNTER.read_text(encoding="utf-8"))
    (tmp_path / "rastercov").mkdir()
    (tmp_path / "rastercov" / "a.cpp").write_text(source)
    command = [sys.executable, tmp_path / ".ci" / "functions.py"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (fault in done.stdout, done.returncode) == (True, bool(fault))
