"""Conversion between messages, bytes and arrays."""
