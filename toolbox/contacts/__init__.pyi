from .contact_run import ContactRun as ContactRun
from .problem import ContactBody as ContactBody
from .problem import ContactProblem as ContactProblem
from .stepping import press_contacts as press_contacts
from .stepping import step_contacts as step_contacts
