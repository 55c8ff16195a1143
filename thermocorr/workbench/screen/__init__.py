"""Screens: a local server, a notebook's widget, a static page."""
