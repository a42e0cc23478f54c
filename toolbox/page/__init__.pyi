from .served import Page as Page
from .served import explore as explore
