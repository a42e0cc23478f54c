"""Reports: results, and folders of results, on one page that needs nothing else."""

from typing import TYPE_CHECKING

from toolbox.faces import face

if TYPE_CHECKING:
    from toolbox.reports.writing import report as report

__getattr__, __dir__ = face()
