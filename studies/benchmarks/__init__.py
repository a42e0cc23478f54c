"""Measurements of the toolbox itself: speed, accuracy, start-up, edges, random plants."""
