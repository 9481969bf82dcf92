"""Warnings, remedies and the sentences of an answer."""
