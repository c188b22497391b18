"""Contacts from the forces of many units."""
