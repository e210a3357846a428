"""comwalk."""
