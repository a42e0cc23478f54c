"""Scenes, their file form, their verdicts."""
