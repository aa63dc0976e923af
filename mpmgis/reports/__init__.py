"""Plots, maps, tables and pages for people to read; facts about any file."""
