"""Tables and pictures of results; the only package that draws."""
