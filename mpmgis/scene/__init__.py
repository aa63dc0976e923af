"""The scene: tables, checks, text, and the effects that it requires."""

from .catalogue import catalogue
from .decisions import Decision, TerrainFacts
from .json_schema import json_schema
from .reading import read_scene, scene_from_tables
from .resistance import mu_least
from .resolve import resolve
from .scene import Scene
from .text import scene_text, template

__all__ = [
    "Decision",
    "Scene",
    "TerrainFacts",
    "catalogue",
    "json_schema",
    "mu_least",
    "read_scene",
    "resolve",
    "scene_from_tables",
    "scene_text",
    "template",
]
