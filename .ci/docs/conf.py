"""Settings of Sphinx for the website of mpmgis; `build.py` of this folder collects the pages and calls it."""

import re
import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE))  # mathml, page_texts

project = "mpmgis"
copyright = "the authors of mpmgis, BSD-3-Clause"
extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
    "mathml",
    "page_texts",
    "IPython.sphinxext.ipython_console_highlighting",  # commands of notebooks, with a leading !
]
root_doc = "index"
default_role = "code"
add_module_names = False
smartquotes_action = "De"  # dashes and ellipses; quotes remain
nitpicky = True
nitpick_ignore_regex = [("py:.*", r"(?!mpmgis\.).*")]  # words such as `float` in types need no link
nitpick_ignore = [  # type variables
    ("py:class", "mpmgis.commands.verb.Asked"),
    ("py:class", "mpmgis.commands.verb_calls.Request"),
    ("py:class", "mpmgis.frames.state_arrays.Arrays"),
    ("py:class", "mpmgis.results.answer_files.Found"),
    ("py:class", "mpmgis.system.option_values.Table"),
]
suppress_warnings = ["mystnb.unknown_mime_type", "ref.python"]  # ref.python: a class name that several modules have

autodoc_preserve_defaults = True
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
python_use_unqualified_type_names = True
napoleon_google_docstring = False
napoleon_use_param = False  # types such as "float64[n, 3] [m]" are words, not links
napoleon_use_rtype = False

myst_enable_extensions = ["deflist", "dollarmath"]
myst_fence_as_directive = ["math"]
myst_update_mathjax = False
html_math_renderer = "mathml"
myst_heading_anchors = 4
nb_execution_mode = "off"  # run_notebooks.py stores their results
nb_merge_streams = True
copybutton_prompt_text = "$ "

html_theme = "pydata_sphinx_theme"
html_title = "mpmgis"
html_static_path = ["static"]
html_css_files = ["mpmgis.css"]
html_show_sourcelink = False
html_show_search_summary = False  # it would read other pages, which browsers refuse on a disk; see search.js
html_search_scorer = str(HERE / "search.js")
html_sidebars = {  # pages without pages below them
    name: []
    for name in (
        *("index", "search", "genindex", "py-modindex", "tutorial", "theory", "validation", "performance", "limits"),
        *("glossary", "contributing", "architecture", "decisions", "changelog"),
    )
}
html_copy_source = False
html_theme_options = {
    "logo": {"text": "mpmgis"},
    "header_links_before_dropdown": 6,
    "navbar_persistent": ["search-button"],
    "navbar_end": ["theme-switcher"],
    "show_toc_level": 2,
    "show_prev_next": True,
    "navigation_depth": 3,
    "footer_start": ["copyright"],
    "footer_end": [],
}

BACKTICKED = re.compile(r"(``.*?``|`[^`]*`)")


def escaped(line):
    """Bars of |U|, stars of `a *= b` and --options as written, where reStructuredText would read markup."""
    parts = BACKTICKED.split(line)
    return "".join(part if part.startswith("`") else _escaped_words(part) for part in parts)


def _escaped_words(words):
    words = re.sub(r"\||(?<!\*)\*(?=[\w=])(?!\*)|(?<=\w)_(?!\w)", r"\\\g<0>", words)
    return re.sub(r"(?<![\w-])--[a-z][\w-]*", r"``\g<0>``", words)


def escape_docstring(app, what, name, thing, options, lines):
    """Docstrings contain formulas as plain text."""
    lines[:] = [escaped(line) for line in lines]
    if lines and what in ("property", "attribute", "data"):  # text before a colon would be read as a type
        lines[0] = lines[0].replace(": ", " -- ", 1)


def skip_fields(app, what, name, thing, skip, options):
    """Fields of named tuples are in the signature already."""
    return True if type(thing).__name__ == "_tuplegetter" else None


def setup(app):
    app.connect("autodoc-skip-member", skip_fields)
    app.connect("autodoc-process-docstring", escape_docstring, priority=400)  # before napoleon
    return {"parallel_read_safe": True}
