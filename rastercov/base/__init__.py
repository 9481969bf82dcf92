"""Helpers without domain words: errors, arguments, files, threads, memory, formats of numbers."""
