"""Tools of every room: arguments, files, output."""
