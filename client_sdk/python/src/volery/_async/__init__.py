"""The client that waits with `await`."""
