"""Formulas as MathML: latex2mathml makes it while the website is built, and browsers draw it without a script."""

import re

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.util import logging

LEFT = re.compile(r"\\[A-Za-z]+|(?<=<mi>)&(?=</mi>)")  # what latex2mathml does not know stays as it is


def mathml(node, display):
    """The MathML of a node of LaTeX; `display` is inline or block."""
    latex = node.astext().strip().replace("{aligned}", "{align*}")  # which latex2mathml knows
    made = convert(latex, display=display)
    for command in LEFT.findall(made):
        logging.getLogger(__name__).warning("latex2mathml does not know %s", command, location=node)
    return made


def visit_inline(writer, node):
    writer.body.append(mathml(node, "inline"))
    raise nodes.SkipNode


def visit_block(writer, node):
    writer.body.append(f'<div class="formula">{mathml(node, "block")}</div>\n')
    raise nodes.SkipNode


def setup(app):
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
