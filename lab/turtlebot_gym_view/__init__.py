"""Drives in a browser, drawn by Bokeh: a satellite which the product never imports."""
