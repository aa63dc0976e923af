"""The scene: tables, checks, text, and the effects that it requires."""

from .decisions import Decision, TerrainFacts
from .reading import read_scene, scene_from_tables
from .resistance import mu_least
from .resolve import catalogue, resolve
from .scene import Scene
from .text import json_schema, scene_text, template

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
