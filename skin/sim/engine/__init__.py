"""Skin on bodies that an engine moves: depths, springs and friction, and wrenches back to it."""
