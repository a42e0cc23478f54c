"""Packages whose names are imported when they are first used."""

from toolbox.faces import face as face
