"""Contacts by the hundred on linear bodies: opening, stick and slip in two directions, by time stepping."""
