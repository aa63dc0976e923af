"""The scene: tables, checks, text, and the effects that it requires."""

from .decided_effects import catalogue, resolve
from .decisions import Decision, TerrainFacts
from .json_schema import json_schema, scene_text, template
from .material_file import read_scene, scene_from_tables
from .resistance_effects import mu_least
from .scene import Scene

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
