"""Text of the sections of every page for the search page, which cannot read other pages from a disk."""

import json

from docutils import nodes

NOT_TEXT = (nodes.section, nodes.title, nodes.math_block, nodes.literal_block, nodes.comment, nodes.raw)


def sections(tree):
    """[(id of a section, its own text)] of a page, in their order."""
    for section in tree.findall(nodes.section):
        words = [words for part in section.children for words in text_of(part)]
        yield section["ids"][0], " ".join(" ".join(words).split())


def text_of(node):
    """Text of the paragraphs and cells of a node, without its subsections, code and formulas."""
    if isinstance(node, nodes.TextElement) and not isinstance(node, NOT_TEXT):
        yield "".join(text for text in node.findall(nodes.Text) if not isinstance(text.parent, nodes.math))
    elif not isinstance(node, NOT_TEXT):
        for part in node.children:
            yield from text_of(part)


def write_texts(app, error):
    if error is None and app.builder.format == "html":
        texts = {name: list(sections(app.env.get_doctree(name))) for name in sorted(app.env.found_docs)}
        path = app.outdir / "_static" / "page_texts.js"
        path.write_text(f"var PAGE_TEXTS = {json.dumps(texts, ensure_ascii=False)};\n", encoding="utf-8")


def load_texts(app, page, template, context, tree):
    if page == "search":
        app.add_js_file("page_texts.js")


def setup(app):
    app.connect("html-page-context", load_texts)
    app.connect("build-finished", write_texts)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
