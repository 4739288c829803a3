"""A robot's file from the data sheet of its drive: what the sheet says, what follows from it, and the file's text."""
