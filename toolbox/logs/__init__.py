"""Logs as recorders write them: tables of text, sheets, LAS and MAT files read into columns with units, and what is wrong with their samples."""
