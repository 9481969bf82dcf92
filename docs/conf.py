"""Sphinx: `make docs` builds the site in `docs/_build/html`, without a network."""

import re
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

from docutils import nodes
from numpy.typing import ArrayLike
from sphinx.util.typing import stringify_annotation

sys.path.insert(0, str(Path(__file__).parent))

import made_from_code

import rastercov
import rastercov.placement

made_from_code.write_all()

project, author = "rastercov", "the authors of rastercov"
version = release = rastercov.__version__
extensions = [
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx_copybutton",
]
exclude_patterns = ["_build"]

# A link that leads nowhere, in a page or in a docstring, ends the build.
nitpicky = True
nitpick_ignore_regex = [
    (r"py:.*", r"(?!rastercov).*"),  # types of other packages, and words in single backquotes
]
myst_heading_anchors = 4
suppress_warnings = ["myst.header"]  # a changelog has the same headings below each version

ARRAY_LIKE = stringify_annotation(ArrayLike, "smart")
NDARRAY = re.compile(
    r"~?numpy\.ndarray\[tuple\[[^]]*\], ~?numpy\.dtype\[~?(?:numpy\.)?(\w+)(?:\[[^]]*\])?\]\]"
)

default_role = "py:obj"  # `name` in a docstring is code, and a link where there is such a name
autosummary_generate = False
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
python_maximum_signature_line_length = 80
numpydoc_show_class_members = False
numpydoc_xref_param_type = False

smartquotes = False

html_theme = "pydata_sphinx_theme"
html_title = "rastercov"
html_sidebars = {page: [] for page in ("index", "install", "start", "concepts", "faq")}
html_static_path = ["_static"]
html_extra_path = ["llms.txt", "answers.schema.json", "reference/playground.html"]
html_css_files = ["site.css"]
html_search_scorer = str(Path(__file__).parent / "_static" / "scorer.js")
html_copy_source = False
html_show_sourcelink = False
html_show_sphinx = False
html_theme_options: dict[str, Any] = {
    "show_toc_level": 2,
    "navigation_with_keys": False,
    "secondary_sidebar_items": ["page-toc"],
    "header_links_before_dropdown": 7,
    "footer_start": [],
    "footer_end": [],
    "show_prev_next": True,
}
copybutton_prompt_text = r"\$ "
copybutton_prompt_is_regexp = True


def link(app: Any, env: Any, node: Any, words: Any) -> Any:
    """Link of a name to the page of the public name; an unlinked word where it is not public.

    A name of rastercov that cannot be imported is left to Sphinx, which ends the build.
    """
    if node.get("refdomain") != "py":
        return None
    target, python = node["reftarget"], env.get_domain("py")
    own, _, name = target.rpartition(".")
    for home in (rastercov, rastercov.placement):
        if target.startswith("rastercov") and name in home.__all__:
            full = f"{home.__name__}.{name}"
            return python.resolve_xref(env, node["refdoc"], app.builder, "obj", full, node, words)
    command = target.removeprefix("rastercov ").partition(" ")[0]
    if target.startswith("rastercov ") and command in made_from_code.COMMANDS:
        page = f"reference/commands/{command}"
        address = app.builder.get_relative_uri(node["refdoc"], page)
        return nodes.reference("", "", words, refuri=address, internal=True)
    return words if _exists(own, name) else None


def _exists(own: str, name: str) -> bool:
    parts = own.split(".") if own else []
    for cut in range(len(parts), 0, -1):
        try:
            found = import_module(".".join(parts[:cut]))
            for part in [*parts[cut:], name]:
                try:
                    found = getattr(found, part)
                except AttributeError:
                    found = import_module(f"{found.__name__}.{part}")
        except (ImportError, AttributeError):
            continue
        return True
    return False


def shorten(app: Any, kind: str, name: str, value: Any, options: Any, *parts: Any) -> Any:
    """Signature and result type with the names of numpy's types in place of their members."""
    return tuple(
        NDARRAY.sub(r"NDArray[\1]", part.replace(ARRAY_LIKE, "ArrayLike")) if part else part
        for part in parts
    )


def setup(app: Any) -> None:
    """Connect what this project adds to Sphinx."""
    app.connect("autodoc-process-signature", shorten)
    app.connect("missing-reference", link)
