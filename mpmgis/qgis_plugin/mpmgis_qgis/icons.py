"""The plugin's picture, of the provider and of each algorithm."""

from __future__ import annotations

import os

from qgis.PyQt.QtGui import QIcon


def plugin_icon():
    """A new QIcon."""
    return QIcon(os.path.join(os.path.dirname(__file__), "icon.svg"))
