"""The ``streamdash`` command: one file a command."""
