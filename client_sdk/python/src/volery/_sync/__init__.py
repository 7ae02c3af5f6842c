# Written by generate.py; changes here are lost.
"""The client that waits with `await`."""
