"""The scene: tables, checks, text, and the effects that it requires."""

from .decision_rules import Decision, TerrainFacts
from .effect_catalogue import catalogue
from .effect_decisions import resolve
from .json_schema import json_schema
from .resistance_effects import mu_least
from .scene import Scene
from .scene_reading import read_scene, scene_from_tables
from .scene_text import scene_text, template

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
