"""Contacts by the hundred on linear bodies: opening, stick and slip in two directions, by time stepping."""

from typing import TYPE_CHECKING

from toolbox.faces import face

if TYPE_CHECKING:
    from toolbox.contacts.contact_run import ContactRun as ContactRun
    from toolbox.contacts.problem import ContactBody as ContactBody
    from toolbox.contacts.problem import ContactProblem as ContactProblem
    from toolbox.contacts.stepping import press_contacts as press_contacts
    from toolbox.contacts.stepping import step_contacts as step_contacts

__getattr__, __dir__ = face()
