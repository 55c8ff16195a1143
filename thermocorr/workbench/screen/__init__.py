"""Screens of the workbench: a local server and its process, a notebook's widget, a page that computes."""
