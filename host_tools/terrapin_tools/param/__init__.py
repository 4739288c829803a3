"""Parameters of a controller over any link: read, written, kept in its flash, as files."""
