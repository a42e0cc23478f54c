"""Compiled steps: a plant is carried from event to event, from sample to sample, or in fixed steps."""
