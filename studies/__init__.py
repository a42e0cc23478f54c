"""Studies: questions of the field, and measurements of the toolbox itself. `python -m studies` lists them."""
